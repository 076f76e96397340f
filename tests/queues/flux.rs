//! On an instance of Flux that is started for the test, if it is installed.

use std::fs;
use std::process::Command;

use crate::common::{missing, succeed};
use crate::{LONG, Project, SHORT, launch, same, whole};

/// On an instance of Flux that is started for it.
#[test]
fn jobs_of_flux() {
    if missing("flux") {
        println!("skipped: Flux is not installed");
        return;
    }
    let project = Project::new();
    let script = format!(
        "batch() {{ flux batch -t 10m --signal=USR1@1s --output=none \"$@\"; }}
        J=job-scripts/flux.sh
        one=$(batch -n 2 --output=one.log $J my.toml {short})
        task=$(batch -n 1 --env=INDEX=3 $J sweep.toml {short})
        bad=$(batch -n 1 --env=CHAIN=9 $J my.toml --set=seed=-1)
        chain=$(batch -n 1 --env=CHAIN=30 '--env=LAUNCH={stops}' $J my.toml {long} --out out/chain)
        for job in $one $task $bad $chain; do
            flux job wait-event -t 300 $job clean >/dev/null
            flux job status --exception-exit-code=99 $job 2>/dev/null
            echo ended $?
        done
        flux queue drain
        echo jobs $(flux jobs -a --no-header --format '{{id}}' | wc -l)
        flux jobs -a --no-header --format 'failed {{result}} {{returncode}}' --filter=failed",
        short = SHORT[0],
        long = LONG.join(" "),
        stops = launch("chain", 2, "flux run -n 1"),
    );
    fs::write(project.at("jobs.sh"), script).expect("written");
    let mut flux = Command::new("flux");
    flux.args(["start", "bash", "jobs.sh"])
        .current_dir(project.path());
    let text = String::from_utf8_lossy(&succeed(&mut flux).stdout).into_owned();
    let ended = text.lines().filter_map(|line| line.strip_prefix("ended "));
    assert_eq!(ended.collect::<Vec<_>>(), ["0", "0", "2", "0"], "{text}");
    let log = project.text("one.log");
    assert!(
        log.contains("2 ranks") && log.contains("--walltime 4"),
        "{log}"
    );
    let jobs = text.lines().find_map(|line| line.strip_prefix("jobs "));
    let jobs: usize = jobs.and_then(|n| n.parse().ok()).expect("a number");
    assert_eq!(jobs, 6, "the chain has three jobs: {text}");
    assert!(text.contains("failed FAILED 2"), "{text}");
    project.run(&["my.toml", SHORT[0], "--out=whole"]);
    same(&project, "whole", "out/my");
    project.run(&["sweep.toml", SHORT[0], "--sweep=3", "--out=sweep"]);
    same(
        &project,
        "sweep/friction-0.5_seed-5",
        "out/sweep/friction-0.5_seed-5",
    );
    same(&project, whole(), "out/chain");
}
