#!/bin/sh
# A fit by several processes: sbatch slurm-fit.sh captures/street scenes/street
#
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=1
#SBATCH --cpus-per-task=16
#SBATCH --time=04:00:00
#SBATCH --requeue
set -eu
# A fit that was begun goes on, one that is complete stays; with any number of processes, up to the photos of a step, to the same bits.
exec srun splatweaver fit "$1" -o "$2" --if-complete skip --steps 30000 --set views_per_step=4 --threads "$SLURM_CPUS_PER_TASK"
