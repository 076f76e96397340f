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

/// With `LAYOUT=auto` a job has the first layout that the program prints for its nodes, of the
/// scene as the options of the job change it.
#[test]
fn a_layout_is_that_of_the_program() {
    let scene = "configs/plane-shear-2d.toml";
    let wide = ["--set=sample.grains=100000", "--set", "sample.length=5e-4"];
    let mut asked = start(env!("CARGO_BIN_EXE_gshear-mpi"));
    asked.current_dir(ROOT).arg(scene).args(wide);
    let printed = succeed(asked.args(["--layouts", "2x12"])).stdout;
    let printed = String::from_utf8(printed).expect("text");
    let mut rows = printed.lines();
    assert_eq!(rows.next(), Some("ranks,threads,step_s,efficiency"));
    let best: Vec<&str> = rows.next().expect("a layout").split(',').collect();
    let counts: Vec<usize> = best[..2]
        .iter()
        .map(|n| n.parse().expect("a count"))
        .collect();
    assert_eq!(counts[0] * counts[1], 24, "{printed}");
    assert_ne!(counts, [8, 3], "the layout that the job has anyway");

    let lay_out = |layout: &str, runs: &str| {
        let mut bash = start("bash");
        bash.arg("-c").arg(
            r#"source job-scripts/common.sh
            read_arguments usage "$@"
            lay_out "" 2 8 3 >/dev/null
            echo "$ranks,$threads""#,
        );
        bash.arg("job").arg(scene).args(wide).arg("--out=elsewhere");
        bash.env("GSHEAR", env!("CARGO_BIN_EXE_gshear-mpi"));
        bash.env("LAYOUT", layout)
            .env("RUNS", runs)
            .current_dir(ROOT);
        bash.output().expect("bash")
    };
    let said = |layout: &str| String::from_utf8(lay_out(layout, "").stdout).expect("text");
    assert_eq!(said("auto").trim(), best[..2].join(","));
    assert_eq!(said("").trim(), "8,3");
    for (layout, runs, wanted) in [
        ("best", "", "error: LAYOUT=best: must be auto"),
        ("auto", "2", "error: LAYOUT=auto is for one run at a time"),
    ] {
        let refused = lay_out(layout, runs);
        let text = String::from_utf8_lossy(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{text}");
        assert!(text.starts_with(wanted), "{text}");
    }
}
