//! How the tests start programs on ranks.

#![allow(dead_code)]

pub mod synthetic;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// `mpirun -n ranks program`, also as root and on fewer cores than ranks; ended after 120 s.
pub fn mpirun(ranks: usize, program: impl AsRef<Path>) -> Command {
    let mut command = Command::new("mpirun");
    command
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
        .env("OMPI_MCA_rmaps_base_oversubscribe", "1")
        .args(["--bind-to", "none", "--timeout", "120"])
        .args(["-n", &ranks.to_string()])
        .arg(program.as_ref());
    command
}

/// A program of `examples/`, brought up to date first: only a `cargo test` without a choice of targets builds them by itself.
pub fn example(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("path of this test");
    let folder = test
        .parent()
        .and_then(Path::parent)
        .expect("target/<profile>/deps");
    let profile = if folder.ends_with("release") {
        "release"
    } else {
        "test"
    };
    succeed(
        Command::new(env!("CARGO"))
            .args(["build", "--quiet", "--profile", profile, "--example", name])
            .current_dir(env!("CARGO_MANIFEST_DIR")),
    );
    folder.join("examples").join(name)
}

/// Its output, after it has ended well; else fails with all that it said.
pub fn succeed(command: &mut Command) -> Output {
    let output = command.output().expect("the program starts");
    assert!(
        output.status.success(),
        "{command:?}: {}\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}
