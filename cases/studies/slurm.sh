#!/usr/bin/env bash
# A study on several machines, as a Slurm job array. Submit the parts, and what puts them together behind them:
#   parts=$(sbatch --parsable cases/studies/slurm.sh cases/studies/bed.toml out/study-bed)
#   sbatch --dependency=afterany:$parts --array=0 --wrap \
#     "target/release/voidage study cases/studies/bed.toml --out out/study-bed --quiet"
# A part that was cut off by the limit of time goes on where it stopped when it is submitted again.
#SBATCH --job-name=voidage-study
#SBATCH --array=0-3
#SBATCH --cpus-per-task=1
#SBATCH --time=01:00:00
# Times are compared: all parts on machines of one kind, and no other job beside them.
#SBATCH --exclusive
set -euo pipefail

study=$1 out=$2
exec "${VOIDAGE:-target/release/voidage}" study "$study" --out "$out" --quiet \
    --index "$SLURM_ARRAY_TASK_ID" --count "$SLURM_ARRAY_TASK_COUNT"
