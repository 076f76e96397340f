#!/usr/bin/env bash
# PBS Pro and OpenPBS: one run, the runs of a sweep, and chains of jobs.
#
#   qsub -v CONFIG=my.toml job-scripts/pbs.sh                            one run, results in out/my
#   qsub -v CONFIG=my.toml,OPTIONS="--out out/other" job-scripts/pbs.sh  options of gshear-mpi
#   qsub -J 1-12 -v CONFIG=my.toml job-scripts/pbs.sh                    the 12 runs of its [sweep]
#   qsub -J 1-3 -l select=1:ncpus=8:mpiprocs=8 -v CONFIG=my.toml,RUNS=4 job-scripts/pbs.sh
#                                                                        them, 4 at a time in each job
#   qsub -v CONFIG=my.toml,CHAIN=20 job-scripts/pbs.sh                   a chain of at most 20 jobs
#   qsub -J 1-12 -v CONFIG=my.toml,CHAIN=20 job-scripts/pbs.sh           a chain for each run
#
# Submit from the folder of the project. Options of qsub take precedence over the lines below. For 4
# threads per rank: qsub -l select=2:ncpus=32:mpiprocs=8 -v CONFIG=my.toml,THREADS=4 ... In a chain
# a run that stops early submits the next job, with the same resources; a failure ends the chain.
# docs/howto/cluster.md says more, common.sh lists more settings.

#PBS -N gshear
#PBS -j oe
#PBS -r y
#PBS -l select=1:ncpus=2:mpiprocs=2
#PBS -l walltime=24:00:00

# The modules of the build come here, such as: module load openmpi hdf5

set -euo pipefail
# PBS starts a copy of this script in the home folder.
cd "${PBS_O_WORKDIR:-.}"
# shellcheck source-path=SCRIPTDIR source=common.sh
source "${JOB_SCRIPTS:-job-scripts}/common.sh" || {
    echo "error: submit from the folder of the project, or set JOB_SCRIPTS to its job-scripts" >&2
    exit 2
}
usage="usage: qsub [-J 1-N] -v CONFIG=my.toml[,OPTIONS=\"...\"][,RUNS=N][,CHAIN=N] job-scripts/pbs.sh"
in_job PBS "${PBS_JOBID:-}" "$usage"
read_arguments "$usage" "$@"

# attribute NAME: of this job; long values are folded at a tab.
attributes=$(qstat -f "$PBS_JOBID" 2>/dev/null | sed -e ':a;N;$!ba;s/\n\t//g' || true)
attribute() {
    sed -n "s/^ *$1 = //p" <<<"$attributes"
}

# In a chain the task of an array goes on as a job of its own.
index=${PBS_ARRAY_INDEX:-${INDEX:-}}
threads=${THREADS:-1}
walltime=$(attribute Resource_List.walltime)
left=$(seconds "$walltime")
ranks=$(wc -l <"$PBS_NODEFILE")

nodes=$(sort -u "$PBS_NODEFILE" | wc -l)
lay_out "$index" "$nodes" "$ranks" "$threads"
place_ranks "$threads" $((ranks / nodes))
run "$index" "${left:+$((left - SECONDS))}" "$threads" "$ranks" \
    mpirun "${place[@]}" --hostfile "$PBS_NODEFILE" -n "$ranks"

if goes_on 1; then
    export CHAIN=$((CHAIN - 1)) INDEX=$index
    names=()
    for name in CONFIG OPTIONS CHAIN INDEX RUNS MARGIN THREADS LAYOUT BIND GSHEAR LAUNCH JOB_SCRIPTS SCRIPT; do
        [[ -z ${!name:-} ]] || names+=("$name")
    done
    resources=(-l "select=$(attribute Resource_List.select)")
    [[ -z $walltime ]] || resources+=(-l "walltime=$walltime")
    account=$(attribute Account_Name)
    [[ -z $account ]] || resources+=(-A "$account")
    # This run has ended and left its folder, so the next job may start at once.
    next=$(IFS=, && qsub -q "$PBS_O_QUEUE" -N "$PBS_JOBNAME" "${resources[@]}" \
        -v "${names[*]}" "${SCRIPT:-$scripts/pbs.sh}") && {
        echo "stopped early; goes on as job $next"
        exit 0
    }
    echo "error: the next job cannot be submitted; submit the same line again to continue" >&2
fi
exit "$code"
