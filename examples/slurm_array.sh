#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Every plant as a task of one Slurm job array, with sbatch alone. Submit it again to go on with what is not done.
#
#   examples/slurm_array.sh field [options of sbatch, e.g. --partition=short]
#
# Each task prints into slurm.log in its plant's folder.
#SBATCH --job-name=cotton3dg
#SBATCH --cpus-per-task=2
#SBATCH --mem=4G
#SBATCH --time=02:00:00
#SBATCH --requeue
#SBATCH --output=/dev/null
set -euo pipefail
field=$(realpath "${1:?folder with a folder for each plant}")
mapfile -d '' plants < <(find "$field" -mindepth 1 -maxdepth 1 -type d -not -name '.*' -print0 | sort -z)
if [ -z "${SLURM_ARRAY_TASK_ID:-}" ]; then
    exec sbatch --array="0-$((${#plants[@]} - 1))" "${@:2}" "$0" "$field"
fi
plant=${plants[$SLURM_ARRAY_TASK_ID]}
exec cotton3dg run "$plant" --wait >>"$plant/slurm.log" 2>&1
