#!/bin/sh
# One unit of work for each task of a Slurm array:
#
#   splatweaver plan list.toml > commands.txt
#   sbatch --array=1-$(wc -l < commands.txt)%50 slurm-array.sh commands.txt
#
#SBATCH --cpus-per-task=8
#SBATCH --mem=8G
#SBATCH --time=02:00:00
#SBATCH --requeue
set -u
commands=${1:-commands.txt}
line=$(sed -n "${SLURM_ARRAY_TASK_ID}p" "$commands")
# Before the comment with time and memory.
sh -c "${line%%  #*} --threads ${SLURM_CPUS_PER_TASK:-1}"
code=$?
# 75 is a failure of the machine; any other is one of the input, which no retry mends.
if [ "$code" -eq 75 ]; then
  scontrol requeue "${SLURM_ARRAY_JOB_ID}_${SLURM_ARRAY_TASK_ID}"
fi
exit "$code"
