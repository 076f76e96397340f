# shellcheck shell=bash
# What the job scripts of all batch systems share. They source it; it is not submitted itself.
#
# A job runs the scene CONFIG, or one run of its [sweep]. If the folder of the results holds that
# run already, the job continues it: submit the same line again after a job that stopped early.
# These variables of the environment change a job:
#
#   CHAIN=N       at most N jobs, one after the other: a run that stops early goes on in another job
#   RUNS=N        N runs of the sweep at a time, which share the cores of the job, on one node: in a
#                 job array each job has N runs, without one the job has all runs
#   MARGIN=S      the run stops S seconds before the job must end (180), but not before half of its
#                 time if MARGIN is not set
#   GSHEAR=PATH   the program, if it is neither target/release/gshear-mpi beside job-scripts/ nor
#                 gshear-mpi in the path
#   LAUNCH=CMD    starts the ranks, instead of what is usual for the batch system
#   BIND=core     on whole nodes, with Open MPI's mpirun (PBS, LSF): each rank keeps to as many cores
#                 as it has threads, and so to the memory beside them; not with RUNS
#   LAYOUT=auto   runs all cores of the job with those numbers of ranks and threads that are best
#                 by the model (gshear-mpi --layouts); for whole, equal nodes; not with RUNS
#   JOB_SCRIPTS=DIR   this folder, if the job is not submitted from the folder of the project

scripts=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
program=${GSHEAR:-${scripts%/*}/target/release/gshear-mpi}
if [[ -z ${GSHEAR:-} && ! -x $program ]] && command -v gshear-mpi >/dev/null; then
    program=$(command -v gshear-mpi) # An installed package.
fi

fail() {
    echo "error: $*" >&2
    exit 2
}

# in_job SYSTEM ID USAGE: refuses to go on outside of a job, which has an ID.
in_job() {
    [[ -n $2 ]] ||
        fail "this is not a job of $1; $3; without a batch system: mpirun -n 2 $program my.toml"
}

# read_arguments USAGE ARGUMENT...: takes the scene and the options of gshear-mpi from the script's
# arguments, or from CONFIG and OPTIONS.
read_arguments() {
    local usage=$1
    shift
    if (($# == 0)) && [[ -n ${CONFIG:-} ]]; then
        local options
        read -r -a options <<<"${OPTIONS:-}"
        set -- "$CONFIG" ${options[@]+"${options[@]}"}
    fi
    (($#)) || fail "$usage"
    [[ $1 == *.toml ]] || fail "$1 is not a scene (*.toml); $usage"
    [[ -x $program ]] ||
        fail "no program $program; build it with cargo build --release, or set GSHEAR to its path"
    [[ ${CHAIN:-1} =~ ^[1-9][0-9]*$ ]] || fail "CHAIN=$CHAIN: must be a number of jobs, from 1 on"
    [[ ${MARGIN:-0} =~ ^[0-9]+$ ]] || fail "MARGIN=$MARGIN: must be a number of seconds"
    [[ ${RUNS:-1} =~ ^[1-9][0-9]*$ ]] ||
        fail "RUNS=$RUNS: must be a number of runs at a time, from 1 on"
    [[ ${THREADS:-1} =~ ^[1-9][0-9]*$ ]] ||
        fail "THREADS=$THREADS: must be a number of threads for each rank, from 1 on"
    arguments=("$@")
}

# lay_out INDEX NODES RANKS THREADS: sets `ranks` and `threads` to these, or with LAYOUT=auto to
# those that use the same cores best. INDEX: of the run of a sweep, or empty.
lay_out() {
    ranks=$3 threads=$4
    case ${LAYOUT:-} in
    '') return ;;
    auto) ;;
    *) fail "LAYOUT=$LAYOUT: must be auto" ;;
    esac
    [[ -z ${RUNS:-} ]] || fail "LAYOUT=auto is for one run at a time; leave out RUNS"
    local per_node=$((ranks * threads / $2)) index=() best
    [[ -z $1 ]] || index=(--sweep "$1")
    # Of the options of gshear-mpi, those that change the scene.
    local changes=() option next=
    for option in "${arguments[@]:1}"; do
        if [[ -n $next || $option == --set=* || $option == --set ]]; then
            changes+=("$option")
        fi
        next=
        [[ $option != --set ]] || next=value
    done
    best=$("$program" "${arguments[0]}" ${changes[@]+"${changes[@]}"} ${index[@]+"${index[@]}"} \
        --layouts "$2x$per_node") || exit 2
    IFS=, read -r ranks threads _ <<<"$(sed -n 2p <<<"$best")"
    echo "layout: $ranks ranks of $threads threads on $2 nodes of $per_node cores"
}

# place_ranks THREADS RANKS: sets `place` to the options of Open MPI's mpirun that say where ranks of
# so many threads run, so many on each node. Other jobs of a shared node may have the same cores, so
# ranks are bound only if that is asked for.
place_ranks() {
    local where=slot
    if [[ -n ${LAYOUT:-} ]]; then
        where=ppr:$2:node
    fi
    case ${BIND:-none} in
    none)
        place=(--bind-to none)
        [[ -z ${LAYOUT:-} ]] || place+=(--map-by "$where")
        ;;
    core) place=(--map-by "$where:PE=$1" --bind-to core) ;;
    *) fail "BIND=$BIND: must be core or none" ;;
    esac
}

# Prints a time such as 1-02:03:04, 02:03:04 or 03:04 in seconds; nothing for any other text.
seconds() {
    if [[ $1 =~ ^[[:space:]]*(([0-9]+)-)?(([0-9]+):)?([0-9]+):([0-9]+)[[:space:]]*$ ]]; then
        local days=${BASH_REMATCH[2]:-0} hours=${BASH_REMATCH[4]:-0}
        local minutes=${BASH_REMATCH[5]} rest=${BASH_REMATCH[6]}
        echo $((((10#$days * 24 + 10#$hours) * 60 + 10#$minutes) * 60 + 10#$rest))
    fi
}

# run INDEX LEFT THREADS RANKS LAUNCHER...: runs the scene, or run INDEX of its sweep, or with RUNS
# the INDEX-th RUNS runs, and sets `code` to its exit code. LEFT: seconds until the job must end;
# empty if that is unknown. RANKS: of the whole job.
run() {
    local index=$1 left=$2 threads=$3 ranks=$4
    shift 4
    local launch=("$@")
    if [[ -n ${LAUNCH:-} ]]; then
        read -r -a launch <<<"$LAUNCH"
    fi
    # A run of a sweep continues without being told.
    if [[ -n ${RUNS:-} ]]; then
        ((RUNS <= ranks)) || fail "RUNS=$RUNS: this job has $ranks ranks, one for each run at least"
        local runs=all
        [[ -z $index ]] || runs=$(((index - 1) * RUNS + 1))-$((index * RUNS))
        arguments+=(--sweep "$runs" --jobs "$RUNS" --ranks $((ranks / RUNS)))
        # The program starts the ranks of each run itself.
        [[ -z ${LAUNCH:-} ]] || export MPIRUN=$LAUNCH
        launch=()
    elif [[ -n $index ]]; then
        arguments+=(--sweep "$index")
    else
        arguments+=(--resume auto)
    fi
    arguments+=(--threads "$threads")
    # The program's own clock stops it in time, whether or not a signal of the batch system arrives.
    if [[ -n $left ]]; then
        local time=$((left - 10#${MARGIN:-180}))
        if [[ -z ${MARGIN:-} ]] && ((time < left / 2)); then
            time=$((left / 2))
        fi
        arguments+=(--walltime "$((time > 0 ? time : 1))s")
    else
        echo "note: the time left for this job is unknown; the run may be killed at its end" >&2
    fi
    # Threads that nobody asked for would take the cores of the ranks.
    export OMP_NUM_THREADS=1 RAYON_NUM_THREADS=1
    if ((EUID == 0)); then # In a container.
        export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
    fi
    # The signal before the end of the job is for the ranks; the script waits for them.
    trap : USR1 USR2
    launch+=("$program" "${arguments[@]}")
    echo "$(date '+%F %T') ${launch[*]}"
    code=0
    "${launch[@]}" || code=$?
    echo "$(date '+%F %T') exit code $code"
}

# goes_on N: whether the chain goes on after its N-th job.
goes_on() {
    ((code == 75)) || return 1
    if [[ -z ${CHAIN:-} ]]; then
        echo "stopped early; submit the same line again to continue"
        return 1
    fi
    if (($1 >= CHAIN)); then
        echo "stopped early, after the last job of the chain (CHAIN=$CHAIN); submit the same line again to continue"
        return 1
    fi
}
