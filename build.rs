//! Hands the program the commit that it is built from.

use std::path::Path;
use std::process::Command;

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git")
        .arg("--no-optional-locks")
        .args(arguments)
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_string())
}

fn main() {
    let commit = git(&["rev-parse", "HEAD"]).map(|commit| {
        match git(&["status", "--porcelain", "--untracked-files=no"]).as_deref() {
            Some("") => commit,
            _ => commit + "-dirty",
        }
    });
    println!(
        "cargo::rustc-env=GSHEAR_GIT_COMMIT={}",
        commit.as_deref().unwrap_or("unknown")
    );

    // Again when the sources change, or what is checked out.
    let mut causes: Vec<String> = ["build.rs", "Cargo.toml", "Cargo.lock", "src", "crates"]
        .map(String::from)
        .into();
    let branch = git(&["rev-parse", "--symbolic-full-name", "HEAD"]);
    for name in ["HEAD", "index", "packed-refs"]
        .into_iter()
        .chain(branch.as_deref())
    {
        causes.extend(git(&["rev-parse", "--git-path", name]));
    }
    for cause in causes.iter().filter(|cause| Path::new(cause).exists()) {
        println!("cargo::rerun-if-changed={cause}");
    }
}
