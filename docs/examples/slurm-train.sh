#!/bin/sh
# Training by several processes: sbatch slurm-train.sh runs/mine
#
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=16
#SBATCH --time=24:00:00
#SBATCH --requeue
set -eu
run=$1
if [ -f "$run/checkpoint.safetensors" ]; then
  # With any number of processes, to the same bits.
  exec srun splatweaver train --resume "$run" --threads "$SLURM_CPUS_PER_TASK"
fi
exec srun splatweaver train --preset small --set optimizer.accumulate=8 --out "$run" --threads "$SLURM_CPUS_PER_TASK"
