//! The job scripts are clean, and say so outside of a job. `make queues` runs them.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{self, start, succeed};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

#[test]
fn job_scripts_are_clean() {
    let at = |folder: &str| {
        let entries = fs::read_dir(Path::new(ROOT).join(folder)).expect("a folder");
        entries.map(|entry| entry.expect("a script").path())
    };
    let scripts: Vec<PathBuf> = at("job-scripts")
        .chain(at("tests/queues/commands"))
        .collect();
    assert_eq!(scripts.len(), 9, "{scripts:?}");
    for script in &scripts {
        succeed(start("bash").arg("-n").arg(script));
    }
    if common::missing("shellcheck") {
        println!("skipped: shellcheck is not installed");
        return;
    }
    succeed(start("shellcheck").arg("-x").args(&scripts));
}

/// Submitted by hand, as with `bash`, on a machine without the batch system.
#[test]
fn a_script_outside_of_a_job_says_how_to_submit_it() {
    for (name, system, submit) in [
        ("slurm", "Slurm", "usage: sbatch "),
        ("pbs", "PBS", "usage: qsub "),
        (
            "lsf",
            "LSF",
            "usage: CONFIG=my.toml [OPTIONS=\"...\"] bsub ",
        ),
        ("flux", "Flux", "usage: flux batch "),
    ] {
        let mut bash = start("bash");
        bash.arg(format!("job-scripts/{name}.sh")).arg("my.toml");
        let ended = bash.current_dir(ROOT).output().expect("bash");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(2), "{said}");
        let wanted = format!("error: this is not a job of {system}; {submit}");
        assert!(
            said.starts_with(&wanted) && said.lines().count() == 1,
            "{said}"
        );
        assert!(
            said.contains("; without a batch system: mpirun -n 2 "),
            "{said}"
        );
    }
}

/// Jobs of PBS get the variables by name; those of the other systems have the environment.
#[test]
fn the_next_job_of_a_chain_has_every_variable_of_the_first() {
    let script = |name: &str| {
        let path = Path::new(ROOT).join("job-scripts").join(name);
        fs::read_to_string(path).expect("a script")
    };
    let pbs = script("pbs.sh");
    let passed = pbs.lines().find(|line| line.contains("for name in "));
    let passed: Vec<&str> = passed.expect("their names").split_whitespace().collect();
    let common = script("common.sh");
    let documented = common.lines().filter_map(|line| {
        let (name, _) = line.strip_prefix("#   ")?.split_once('=')?;
        (!name.starts_with(' ')).then_some(name)
    });
    let documented: Vec<&str> = documented.collect();
    assert!(documented.contains(&"CHAIN") && documented.contains(&"BIND"));
    for name in documented {
        assert!(passed.contains(&name), "{name} is not passed on");
    }
}
