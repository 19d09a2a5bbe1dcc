#!/bin/sh
# sbatch config/fleet/slurm_array.sh /shared/drives /shared/results; then radcam-depth merge /shared/results --json -
#SBATCH --job-name=radcam-depth
#SBATCH --array=0-15
#SBATCH --cpus-per-task=1
#SBATCH --mem=2G
#SBATCH --requeue
exec radcam-depth evaluate "$1" --out "$2" --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --threads 1 --precision float32
