#!/usr/bin/env bash
# LSF: one run, the runs of a sweep, and chains of jobs.
#
#   CONFIG=my.toml bsub < job-scripts/lsf.sh                            one run, results in out/my
#   CONFIG=my.toml OPTIONS="--out out/other" bsub < job-scripts/lsf.sh  options of gshear-mpi
#   CONFIG=my.toml bsub -J "gshear[1-12]%4" < job-scripts/lsf.sh        the 12 runs of its [sweep]
#   CONFIG=my.toml RUNS=4 bsub -n 8 -J "gshear[1-3]" < job-scripts/lsf.sh
#                                                                       them, 4 at a time in each job
#   CONFIG=my.toml bsub -Q 75 < job-scripts/lsf.sh                      a chain of jobs
#   CONFIG=my.toml bsub -Q 75 -J "gshear[1-12]" < job-scripts/lsf.sh    a chain for each run
#
# Submit from the folder of the project. Options of bsub take precedence over the lines below. For 4
# threads per rank: CONFIG=my.toml THREADS=4 bsub -n 8 -R "affinity[core(4)]" < job-scripts/lsf.sh.
# With -Q 75 LSF puts a job whose run stops early back into the queue, as often as MAX_JOB_REQUEUE of
# the queue allows; any other failure ends the chain. docs/howto/cluster.md says more, common.sh
# lists more settings.

#BSUB -J gshear
#BSUB -o /dev/null
#BSUB -n 2
#BSUB -R "span[hosts=1]"
#BSUB -W 24:00
# The ranks get SIGUSR1 3 minutes before the end and stop at a checkpoint.
#BSUB -wa USR1
#BSUB -wt 3
# After the failure of a host the job runs again and continues.
#BSUB -r

# The modules of the build come here, such as: module load openmpi hdf5

set -euo pipefail
cd "${LS_SUBCWD:-.}"
# 0 if the job is no array.
index=${LSB_JOBINDEX:-0}
index=${index#0}
# LSF discards what a job printed before it is requeued.
[[ -z ${LSB_JOBID:-} ]] || exec >>"${LSB_JOBNAME%%\[*}-$LSB_JOBID${index:+-$index}.log" 2>&1
# LSF runs a copy of this script in a folder of its own.
# shellcheck source-path=SCRIPTDIR source=common.sh
source "${JOB_SCRIPTS:-job-scripts}/common.sh" || {
    echo "error: submit from the folder of the project, or set JOB_SCRIPTS to its job-scripts" >&2
    exit 2
}
usage="usage: CONFIG=my.toml [OPTIONS=\"...\"] bsub [-Q 75] [-J \"gshear[1-N]\"] < job-scripts/lsf.sh"
in_job LSF "${LSB_JOBID:-}" "$usage"
[[ -z ${CHAIN:-} ]] || fail "LSF makes chains by itself: give bsub -Q 75 instead of CHAIN"
read_arguments "$usage" "$@"

# Hours and minutes, such as 23:59 L.
left=$(bjobs -noheader -o time_left "$LSB_JOBID${index:+[$index]}" 2>/dev/null || true)
left=${left%% [A-Z]*}
left=$(seconds "${left:+$left:00}")

# Pairs of a host and its slots.
nodes=$(wc -w <<<"${LSB_MCPU_HOSTS:-localhost 1}")
nodes=$((nodes / 2))
lay_out "$index" "$nodes" "$LSB_DJOB_NUMPROC" "${THREADS:-1}"
place_ranks "$threads" $((ranks / nodes))
run "$index" "$left" "$threads" "$ranks" mpirun "${place[@]}" -n "$ranks"
((code != 75)) || echo "stopped early; goes on if the job was submitted with -Q 75"
exit "$code"
