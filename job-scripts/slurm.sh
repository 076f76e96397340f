#!/usr/bin/env bash
# Slurm: one run, the runs of a sweep, and chains of jobs.
#
#   sbatch job-scripts/slurm.sh my.toml                            one run, results in out/my
#   sbatch job-scripts/slurm.sh my.toml --out out/other            options of gshear-mpi follow the scene
#   sbatch --array=1-12%4 job-scripts/slurm.sh my.toml             the 12 runs of its [sweep], 4 at a time
#   RUNS=4 sbatch --array=1-3 --ntasks=8 job-scripts/slurm.sh my.toml
#                                                                  these 12 runs, 4 at a time in each job
#   CHAIN=20 sbatch job-scripts/slurm.sh my.toml                   a chain of at most 20 jobs
#   CHAIN=20 sbatch --array=1-12 job-scripts/slurm.sh my.toml      a chain for each run of the sweep
#
# Submit from the folder of the project. Options of sbatch take precedence over the lines below:
# sbatch --ntasks=8 --cpus-per-task=4 --time=2-00:00:00 job-scripts/slurm.sh my.toml. A rank runs
# --cpus-per-task threads. In a chain a run that stops early puts its job back into the queue; a
# failure ends the chain. docs/howto/cluster.md says more, common.sh lists more settings.

#SBATCH --job-name=gshear
#SBATCH --output=%x-%j.log
#SBATCH --open-mode=append
#SBATCH --requeue
#SBATCH --nodes=1
#SBATCH --ntasks=2
#SBATCH --cpus-per-task=1
#SBATCH --time=24:00:00
# The ranks get SIGUSR1 120 s before the end, or up to 60 s earlier, and stop at a checkpoint.
#SBATCH --signal=USR1@120

# The modules of the build come here, such as: module load openmpi hdf5

set -euo pipefail
# Slurm runs a copy of this script in a folder of its own.
# shellcheck source-path=SCRIPTDIR source=common.sh
source "${JOB_SCRIPTS:-${SLURM_SUBMIT_DIR:-.}/job-scripts}/common.sh" || {
    echo "error: submit from the folder of the project, or set JOB_SCRIPTS to its job-scripts" >&2
    exit 2
}
usage="usage: sbatch [--array=1-N] job-scripts/slurm.sh CONFIG.toml [OPTIONS of gshear-mpi]"
in_job Slurm "${SLURM_JOB_ID:-}" "$usage"
read_arguments "$usage" "$@"

index=${SLURM_ARRAY_TASK_ID:-}
# Not SLURM_JOB_ID: of one task of an array it is the id of the whole array.
job=${index:+${SLURM_ARRAY_JOB_ID}_$index}
job=${job:-$SLURM_JOB_ID}
threads=${SLURM_CPUS_PER_TASK:-1}
left=$(seconds "$(squeue --noheader --job "$job" --format %L 2>/dev/null || true)")

nodes=${SLURM_JOB_NUM_NODES:-1}
lay_out "$index" "$nodes" "${SLURM_NTASKS:-1}" "$threads"
# Without pmix in Slurm (srun --mpi=list) set LAUNCH=mpirun. srun does not inherit --cpus-per-task.
launch=(srun --mpi=pmix --cpus-per-task="$threads")
if [[ -n ${LAYOUT:-} ]]; then
    launch+=(--ntasks="$ranks" --ntasks-per-node=$((ranks / nodes)))
fi
run "$index" "$left" "$threads" "$ranks" "${launch[@]}"

if goes_on $((${SLURM_RESTART_COUNT:-0} + 1)); then
    echo "stopped early; job $job goes back into the queue"
    # Slurm ends this script while it takes the job back.
    if scontrol requeue "$job"; then
        exit 0
    fi
    echo "error: job $job cannot be requeued; submit the same line again to continue" >&2
fi
exit "$code"
