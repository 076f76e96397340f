//! `--version` of both programs names the program, its libraries and the instruction sets.

use crate::common::{PROGRAM, REDUCER, launcher, program, start, succeed};

#[test]
fn the_version_names_libraries_and_instruction_sets() {
    let mut command = program(1);
    let said = succeed(command.arg("--version"));
    let said = String::from_utf8(said.stdout).expect("text");
    let lines: Vec<&str> = said.lines().collect();
    let [program, mpi, hdf5, instruction_sets] = lines[..] else {
        panic!("{said}");
    };
    let version = concat!("gshear-mpi ", env!("CARGO_PKG_VERSION"), " (");
    assert!(
        program.starts_with(version) && program.ends_with(')'),
        "{program}"
    );

    // Of the launcher, which comes with the library.
    let of_launcher = start(&launcher()[0]).arg("--version").output();
    let of_launcher = of_launcher.expect("mpirun");
    let of_launcher = String::from_utf8_lossy(&of_launcher.stdout).into_owned();
    let number = |word: &&str| word.contains('.') && word.starts_with(|c: char| c.is_ascii_digit());
    let number = of_launcher
        .split_whitespace()
        .find(number)
        .expect("a version");
    assert!(
        mpi.starts_with("MPI: ") && mpi.contains(number),
        "{mpi} {number}"
    );
    assert!(
        hdf5.starts_with("HDF5: 1.") || hdf5.starts_with("HDF5: 2."),
        "{hdf5}"
    );

    let flags = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let has = |flag: &str| flags.split_whitespace().any(|word| word == flag);
    assert!(instruction_sets.ends_with("portable"), "{instruction_sets}");
    assert_eq!(instruction_sets.contains("avx2"), has("avx2") && has("fma"));
    assert_eq!(
        instruction_sets.contains("avx512"),
        has("avx512f") && has("avx512dq")
    );
}

/// The reducer's, which has no ranks, is the same without MPI.
#[test]
fn the_version_of_the_reducer_is_that_of_its_build() {
    let lines = |program: &str| -> Vec<String> {
        let said = succeed(start(program).arg("--version")).stdout;
        let said = String::from_utf8(said).expect("text");
        said.lines().map(String::from).collect()
    };
    let simulation = lines(PROGRAM);
    let mut wanted = simulation.clone();
    wanted.remove(1);
    wanted[0] = wanted[0].replace("gshear-mpi", "gshear-reduce");
    assert_eq!(lines(REDUCER), wanted);
}

/// `make build` begins with it: an older cargo does not say why it cannot read the manifests.
#[test]
fn an_old_cargo_is_told_which_rust_is_needed() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a folder");
    let cargo = folder.path().join("cargo");
    std::fs::write(&cargo, "#!/bin/sh\necho 'cargo 1.9.0 (of old)'\n").expect("written");
    std::fs::set_permissions(&cargo, PermissionsExt::from_mode(0o755)).expect("runnable");
    let path = std::env::var("PATH").expect("a path");
    let found = start(concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/deps"))
        .env("PATH", format!("{}:{path}", folder.path().display()))
        .output()
        .expect("bash");
    let said = String::from_utf8_lossy(&found.stderr);
    assert_eq!(found.status.code(), Some(1), "{said}");
    let needed = concat!(
        "is 1.9.0: the build needs Rust ",
        env!("CARGO_PKG_RUST_VERSION"),
        " or newer"
    );
    assert!(said.contains(needed), "{said}");
}
