//! What a test finds does not depend on who runs it, and where: programs are started in one place,
//! which passes on nothing.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::environment::{empty_folder, ignored_in};
use crate::common::{start, succeed};

const INNER: &str = "harness::a_program_has_the_environment_of_the_tests";

/// With which some people and batch systems surround a `make test`.
const STRANGE: [(&str, &str); 14] = [
    ("COLUMNS", "20"),
    ("GSHEAR_NO_SHARED_MEMORY", "1"),
    ("GSHEAR_MPI", "/nonexistent"),
    ("HDF5_DRIVER", "split"),
    ("HDF5_USE_FILE_LOCKING", "TRUE"),
    ("LC_ALL", "tr_TR.UTF-8"),
    ("NO_COLOR", "1"),
    ("OMPI_COMM_WORLD_SIZE", "3"),
    ("OMPI_MCA_mpi_yield_when_idle", "0"),
    ("OMPI_MCA_odls_base_sigkill_timeout", "7"),
    ("PMI_SIZE", "2"),
    ("RUST_BACKTRACE", "full"),
    ("SLURM_NTASKS", "4"),
    ("TERM", "strange"),
];

/// Its variables, working directory and signals.
#[test]
fn a_program_has_the_environment_of_the_tests() {
    let mut shell = start("sh");
    // Without a shell's own variables.
    let variables = succeed(&mut start("env")).stdout;
    let variables = String::from_utf8(variables).expect("text");
    let variables: BTreeMap<&str, &str> = variables
        .lines()
        .filter_map(|line| line.split_once('='))
        .collect();
    for (name, value) in STRANGE {
        let found = variables.get(name);
        assert!(found != Some(&value), "{name}={value}");
    }
    let known = |name: &str| {
        [
            "PATH",
            "LD_LIBRARY_PATH",
            "OPAL_PREFIX",
            "TMPDIR",
            "HOME",
            "HWLOC_COMPONENTS",
        ]
        .contains(&name)
            || name.starts_with("OMPI_ALLOW_RUN_AS_ROOT")
            || name.starts_with("OMPI_MCA_")
    };
    let others: Vec<_> = variables.keys().filter(|name| !known(name)).collect();
    assert!(others.is_empty(), "{others:?}");
    let said = succeed(shell.args(["-c", "pwd -P; cat /proc/self/status"])).stdout;
    let said = String::from_utf8(said).expect("text");
    let folder = Path::new(said.lines().next().expect("a folder"));
    assert_eq!(folder, empty_folder().canonicalize().expect("a folder"));
    let ignored = ignored_in(&said);
    assert!(ignored.is_empty(), "signals {ignored:?} are ignored");
    // A test without --out would find what another one has left.
    let left = std::fs::read_dir(folder).expect("a folder").flatten();
    let left: Vec<_> = left.map(|entry| entry.file_name()).collect();
    assert!(left.is_empty(), "{left:?} is in {}", folder.display());
}

/// As under `nohup`, in a job, in a folder with results of `make run`.
#[test]
fn whoever_runs_the_tests_finds_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::create_dir_all(folder.path().join("out/plane-shear-2d")).expect("a folder");
    let mut caller = start("sh");
    let ignoring = "trap '' HUP INT QUIT TERM USR1 USR2; umask 077; exec \"$0\" \"$@\"";
    caller
        .args(["-c", ignoring])
        .arg(std::env::current_exe().expect("this test"));
    caller
        .args(["--exact", INNER])
        .envs(STRANGE)
        .current_dir(folder.path());
    let said = String::from_utf8(succeed(&mut caller).stdout).expect("text");
    assert!(said.contains("1 passed"), "{said}");
}

/// No test starts a program by itself. Those of batch systems are run by hand.
#[test]
fn programs_are_started_in_one_place() {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let mut folders: Vec<_> = ["all", "common", "exchange", "io_ranks"]
        .map(|name| tests.join(name))
        .into();
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = std::fs::read_to_string(&path).expect("a source");
                if text.contains(concat!("Command::", "new(")) {
                    found.push(path);
                }
            }
        }
    }
    assert_eq!(
        found,
        [tests.join("common/environment.rs")],
        "use common::start"
    );
}
