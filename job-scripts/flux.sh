#!/usr/bin/env bash
# Flux: one run, the runs of a sweep, and chains of jobs.
#
#   flux batch job-scripts/flux.sh my.toml                    one run, results in out/my
#   flux batch job-scripts/flux.sh my.toml --out out/other    options of gshear-mpi follow the scene
#   for i in {1..12}; do flux batch --env=INDEX=$i job-scripts/flux.sh my.toml; done
#                                                             the 12 runs of its [sweep]
#   for i in {1..3}; do flux batch -n 8 --env=RUNS=4 --env=INDEX=$i job-scripts/flux.sh my.toml; done
#                                                             them, 4 at a time in each job
#   flux batch --env=CHAIN=20 job-scripts/flux.sh my.toml     a chain of at most 20 jobs
#
# Submit from the folder of the project. Options of flux batch take precedence over the lines below.
# A slot is a rank, and its cores are the threads: flux batch -n 8 -c 4 --env=THREADS=4 ... In a
# chain a run that stops early submits its own job again; a failure ends the chain.
# docs/howto/cluster.md says more, common.sh lists more settings.

#flux: --job-name=gshear
#flux: --output=gshear-{{id}}.log
#flux: --nslots=2
#flux: --time-limit=24h
# The ranks get SIGUSR1 before the end and stop at a checkpoint.
#flux: --signal=USR1@2m

# The modules of the build come here, such as: module load openmpi hdf5

set -euo pipefail
# Flux runs a copy of this script, in the folder from which it was submitted.
# shellcheck source-path=SCRIPTDIR source=common.sh
source "${JOB_SCRIPTS:-job-scripts}/common.sh" || {
    echo "error: submit from the folder of the project, or set JOB_SCRIPTS to its job-scripts" >&2
    exit 2
}
usage="usage: flux batch [--env=INDEX=I] [--env=RUNS=N] [--env=CHAIN=N] job-scripts/flux.sh CONFIG.toml [OPTIONS of gshear-mpi]"
in_job Flux "$(flux getattr jobid 2>/dev/null || true)" "$usage"
read_arguments "$usage" "$@"

threads=${THREADS:-1}
cores=$(flux resource list --states=up --no-header --format='{ncores}')
((threads <= cores)) || fail "THREADS=$threads: this job has $cores cores"
# Whole seconds; about 2^32 without a limit.
left=$(flux job timeleft 2>/dev/null || true)
((${left:-0} < 4000000000)) || left=

nodes=$(flux resource list --states=up --no-header --format='{nnodes}')
lay_out "${INDEX:-}" "$nodes" $((cores / threads)) "$threads"
run "${INDEX:-}" "$left" "$threads" "$ranks" \
    flux run --ntasks="$ranks" --cores-per-task="$threads"

# with_chain N: the job on standard input, with CHAIN=N.
with_chain() {
    flux python -c '
import json, sys
job = json.load(sys.stdin)
job["attributes"]["system"]["environment"]["CHAIN"] = sys.argv[1]
json.dump(job, sys.stdout)' "$1"
}

if goes_on 1; then
    job=$(flux getattr jobid)
    # The same job in the instance around this one: script, arguments and resources.
    next=$(flux --parent job info --original "$job" jobspec | with_chain $((CHAIN - 1)) |
        flux --parent job submit) && {
        echo "stopped early; goes on as job $next"
        exit 0
    }
    echo "error: the next job cannot be submitted; submit the same line again to continue" >&2
fi
exit "$code"
