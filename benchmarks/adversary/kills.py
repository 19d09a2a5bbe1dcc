"""Verbs that are killed at a seeded moment, or that write to a disk that is full or read-only."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import yaml
from rosbags.rosbag2 import StoragePlugin

from benchmarks.adversary.bag_files import good_messages, write_bag
from benchmarks.adversary.cases import DONE, REFUSED, Outcome, Place, generator, text_problems
from benchmarks.adversary.good_files import SMALLEST, write_good
from radcam_depth_ros.bags import BagReader
from radcam_depth_ros.frame import RadcamDepthError

_STOPPED = 130
"""Exit code of a training that was stopped: it can go on."""
_MOST_CPU_S = 8.0
"""Processor seconds after which the latest signal comes; most verbs take less on a small drive."""
_PATIENCE_S = 1500.0
_RECIPE = {
    "architecture": SMALLEST,
    "iterations": 4,
    "precision": "float32",
    "threads": 1,
    "phases": [{"share": 1.0, "crops": [[64, 128]], "batch": 1}],
    "optimiser": {"warm_up_iterations": 1},
    "validation": {"every_iterations": 2, "frames": 1},
}


class KillAttack:
    """Kills verbs, or lets them run into the end of a disk; then runs them again.

    Args:
        seed: What decides on verb, moment and signal.
        place: Where.
    """

    good_every = 1_000_000  # no case leaves anything to the next one
    is_inside = False

    def __init__(self, seed: int, place: Place) -> None:
        self._seed, self._place = seed, place
        write_good(place.kept)
        self._drive = place.kept / "drive"
        other = place.kept / "other_drive"
        for folder in (self._drive, other):
            write_bag(folder, good_messages(), StoragePlugin.MCAP)
        recipe = place.kept / "recipe.yaml"
        recipe.write_text(yaml.safe_dump(_RECIPE), encoding="utf-8")
        out, drive, model = place.outputs, self._drive, ("--model", place.kept / "good.pt")
        run = ("--out", out / "run", "--processes", "1")
        replay = ("replay", drive, out / "depth.mcap", *model, "--overwrite")
        self.verbs: dict[str, tuple[object, ...]] = {
            "replay": replay,
            "replay to a folder": ("replay", drive, out / "depth", *model, "--overwrite", "--compress"),
            "export": ("export", out / "baff.pt", "--model", place.kept / "good.pt"),
            "evaluate": ("evaluate", drive, *model, "--no-baselines", "--json", out / "e.json", "--csv", out / "e.csv"),
            "view": ("view", drive, "--save", out / "drive.mp4", *model, "--width", "480"),
            "view to pictures": ("view", drive, "--save", out / "pictures", *model, "--width", "480"),
            "inspect": ("inspect", drive, "--write-params", out / "node.yaml"),
            "train": (*("train", "--bags", drive, "--validation-bags", other, "--config", recipe), *run),
        }

    def run(self, number: int) -> Outcome:
        """Runs a verb until its end, whichever that is, and again without harm."""
        rng = generator(self._seed, "kills", number)
        verb = rng.choice(list(self.verbs))
        end = rng.choice(("SIGTERM", "SIGTERM", "SIGKILL", "SIGKILL", "full disk", "read-only disk"))
        limited = {"full disk": str(rng.choice((0, 500, 20_000))), "read-only disk": str(self._place.outputs)}.get(
            end, "-"
        )
        found: list[str] = []
        with self._place.watched() as problems:
            code, peak_mib = self._killed(rng, self._started(verb, limited), end, found)
        found += [*problems, *self._problems_of_end(end, verb, code)]
        with self._place.watched() as problems:
            arguments = self.verbs[verb]
            if verb == "train" and (self._place.outputs / "run" / "run.yaml").exists():
                arguments = ("train", "--out", self._place.outputs / "run", "--processes", "1", "--resume")
            elif not verb.startswith("replay"):  # which overwrites
                self._place.clear()
            again = self._run_again(arguments)
        if again:
            found.append(f"run again: {again}")
        return Outcome(f"{verb}, {end}", f"exit code {code}", (*found, *problems), peak_mib)

    def good(self) -> tuple[str, ...]:
        """Each case has its own."""
        return ()

    def close(self) -> None:
        """Nothing was started."""

    def _started(self, verb: str, limited: str) -> subprocess.Popen[bytes]:
        arguments = [str(argument) for argument in self.verbs[verb]]
        command = [sys.executable, "-m", "benchmarks.adversary.victim", limited, *arguments]
        # A pipe, since a file of what it prints would be full as well.
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def _killed(
        self, rng: random.Random, process: subprocess.Popen[bytes], end: str, found: list[str]
    ) -> tuple[int, float]:
        """Ends a process by its signal at its moment, or lets it end; its exit code and peak of memory (MiB)."""
        cpu_s, waits_for_output = rng.uniform(0, _MOST_CPU_S), rng.random() < 0.5
        delay_s = rng.choice((0.0, rng.uniform(0, 0.3)))
        deadline_s, is_sent = time.monotonic() + _PATIENCE_S, False
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                process.returncode = os.waitstatus_to_exitcode(status)
                found += text_problems(_printed(process))
                return process.returncode, usage.ru_maxrss / 1024
            is_due = bool(self._place.left()) if waits_for_output else _cpu_s(process.pid) >= cpu_s
            if is_due and not is_sent and end.startswith("SIG"):
                time.sleep(delay_s)
                os.kill(process.pid, signal.Signals[end])  # Popen.send_signal may reap it, and its memory is lost
                is_sent = True
            if time.monotonic() > deadline_s:
                found.append(f"it did not end within {_PATIENCE_S:.0f} s")
                os.kill(process.pid, signal.SIGKILL)
                deadline_s += _PATIENCE_S
            time.sleep(0.01)

    def _problems_of_end(self, end: str, verb: str, code: int) -> list[str]:
        """What is wrong with the exit code and with what was left."""
        ended = {"SIGTERM": (128 + signal.SIGTERM, -signal.SIGTERM), "SIGKILL": (-signal.SIGKILL,)}
        expected = (DONE, *ended.get(end, (REFUSED,)))
        if verb == "train" and end == "SIGTERM":
            expected += (_STOPPED,)
        left = self._place.left()
        problems = [] if code in expected else [f"exit code {code}, expected one of {', '.join(map(str, expected))}"]
        problems += [f"half a file: {name}" for name in left if _damage(self._place.outputs / name)]
        # A training keeps its folder, SIGKILL lets nobody clear up, and SIGTERM may come when all is written.
        parts = [name for name in left if ".part" in name or (code == REFUSED and verb != "train")]
        if end != "SIGKILL" and parts:
            problems.append(f"left {', '.join(parts)[:200]}")
        return problems

    def _run_again(self, arguments: tuple[object, ...]) -> str:
        """Runs a verb without harm; what was wrong with it, else nothing."""
        command = [sys.executable, "-m", "radcam_depth_ros.cli", *(str(argument) for argument in arguments)]
        done = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=_PATIENCE_S, check=False
        )
        text = done.stdout.decode("utf-8", errors="backslashreplace")
        damaged = [name for name in self._place.left() if ".part" not in name and _damage(self._place.outputs / name)]
        problems = [*text_problems(text), *(f"{name} cannot be read" for name in damaged)]
        if done.returncode != DONE:
            problems.append(f"exit code {done.returncode}: {' '.join(text.split())[-300:]}")
        return "; ".join(problems)


def _printed(process: subprocess.Popen[bytes]) -> str:
    """What an ended process printed; its own processes may still hold the pipe."""
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    with process.stdout:
        return (process.stdout.read() or b"").decode("utf-8", errors="backslashreplace")


def _cpu_s(pid: int) -> float:
    """Processor seconds of a process: moments by them do not depend on what else the machine does."""
    with contextlib.suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def _damage(path: Path) -> str:
    """Why a file under its own name is not whole; empty where it is, or is not under its own name yet."""
    if path.is_dir() or any(".part" in part for part in path.parts):
        return ""
    try:
        if path.suffix == ".mcap":
            with BagReader(path) as reader:
                sum(len(message.raw) for message in reader.messages())
        elif path.suffix == ".pt" and zipfile.ZipFile(path).testzip():
            return "a damaged archive"
        elif path.suffix == ".json":
            json.loads(path.read_text(encoding="utf-8"))
        elif path.suffix == ".yaml":
            yaml.safe_load(path.read_text(encoding="utf-8"))
        elif path.suffix in (".html", ".mp4", ".png") and not path.stat().st_size:
            return "it is empty"
    except (RadcamDepthError, ValueError, OSError, zipfile.BadZipFile, yaml.YAMLError) as error:
        return str(error)
    return ""
