//! The job scripts are clean. `make queues` runs them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{self, succeed};

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
        succeed(Command::new("bash").arg("-n").arg(script));
    }
    if common::missing("shellcheck") {
        println!("skipped: shellcheck is not installed");
        return;
    }
    succeed(Command::new("shellcheck").arg("-x").args(&scripts));
}
