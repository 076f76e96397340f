#!/bin/bash
# One run under Slurm, or the runs of a sweep as a job array:
#
#   sbatch job-scripts/slurm.sh configs/lee-hurley-small.toml                     a new run
#   sbatch job-scripts/slurm.sh configs/lee-hurley-small.toml RUN                 goes on where that run stopped
#   sbatch --array=1-12 job-scripts/slurm.sh configs/sweep.toml                   the 12 runs of its [sweep]
#
# target/release/gshear-mpi CONFIG.toml --sweep list numbers the runs of a sweep. Their results go to out/<config>/<run>; the same
# line again passes over those that are done and goes on with those that stopped. --array=1-12%4 runs four at a time.
#
# Submit it from the folder of the project, built there before (cargo build --release). Options of sbatch win over the lines
# below: sbatch --ntasks=8 --time=2-00:00:00 job-scripts/slurm.sh ...
#
# Results go to out/<config>-<job id>; a run that goes on writes into its own folder. Before the time is up the run stops at a
# checkpoint, and the job ends with exit code 75: submit it again with its folder. A job that Slurm requeues goes on, too. Any number of ranks may go on,
# to the same bits. Exit codes: 0 done; 2 bad input; 3 the numbers failed; 75 stopped early; 1 anything else.

#SBATCH --job-name=gshear
#SBATCH --output=%x-%j.log
#SBATCH --nodes=1
#SBATCH --ntasks=2
#SBATCH --cpus-per-task=1
#SBATCH --time=24:00:00
# The ranks get SIGUSR1 120 s before the end and stop at a checkpoint. Slurm may send it up to 60 s earlier.
#SBATCH --signal=USR1@120

# Your cluster's modules of the build come here, such as: module load openmpi hdf5

set -u

if [ $# -lt 1 ] || [ $# -gt 2 ]; then
    echo "usage: sbatch job-scripts/slurm.sh CONFIG.toml [FOLDER or CHECKPOINT]" >&2
    exit 2
fi
config=$1
checkpoint=${2:-}
program=${GSHEAR:-target/release/gshear-mpi}
if [ ! -x "$program" ]; then
    echo "error: no $program here ($PWD): submit from the folder of the project, after cargo build --release, or set GSHEAR" >&2
    exit 2
fi

# Threads that nobody asked for would share the cores of the ranks.
export OMP_NUM_THREADS=1 RAYON_NUM_THREADS=1
if [ "$(id -u)" = 0 ]; then # In a container.
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi

if [ -n "$checkpoint" ]; then
    folder=$checkpoint
    [ -d "$folder" ] || folder=$(dirname "$checkpoint")
    arguments=(--resume "$checkpoint")
elif [ -n "${SLURM_ARRAY_TASK_ID:-}" ]; then
    # Without the job's id: the same array again goes on in the same folders.
    folder=out/$(basename "$config" .toml)
    arguments=("$config" --sweep "$SLURM_ARRAY_TASK_ID" --out "$folder")
else
    folder=out/$(basename "$config" .toml)-$SLURM_JOB_ID
    arguments=("$config" --out "$folder" --resume auto)
fi

# One thread for each core that a rank has (#SBATCH --cpus-per-task): for samples of 50,000 grains and more.
arguments+=(--threads "${SLURM_CPUS_PER_TASK:-1}")

# The program's own clock, in case the signal does not come through: what is left of the job, less three minutes for the last
# checkpoint, but at least half of it.
left=$(squeue --noheader --job "$SLURM_JOB_ID" --format %L 2>/dev/null | tr -d ' ')
if [[ $left =~ ^(([0-9]+)-)?(([0-9]+):)?([0-9]+):([0-9]+)$ ]]; then
    seconds=$((((10#${BASH_REMATCH[2]:-0} * 24 + 10#${BASH_REMATCH[4]:-0}) * 60 + 10#${BASH_REMATCH[5]}) * 60 + 10#${BASH_REMATCH[6]}))
    seconds=$((seconds - 180 > seconds / 2 ? seconds - 180 : seconds / 2))
    [ "$seconds" -gt 0 ] && arguments+=(--walltime "${seconds}s")
fi

# srun sends the signal to the ranks. Where Slurm has no pmix (srun --mpi=list), set LAUNCH=mpirun: then the clock above stops it.
case ${LAUNCH:-srun} in
srun) launch=(srun --mpi=pmix) ;;
*) launch=(mpirun) ;;
esac
echo "${launch[*]} $program ${arguments[*]}"
"${launch[@]}" "$program" "${arguments[@]}"
code=$?
if [ "$code" = 75 ] && [ -n "${SLURM_ARRAY_TASK_ID:-}" ]; then
    echo "stopped early; go on with: sbatch --array=$SLURM_ARRAY_TASK_ID job-scripts/slurm.sh $config"
elif [ "$code" = 75 ]; then
    echo "stopped early; go on with: sbatch job-scripts/slurm.sh $config $folder"
fi
exit "$code"
