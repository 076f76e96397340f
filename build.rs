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

/// The commit of the checkout. None in a folder that only lies in a checkout of something else.
fn checked_out() -> Option<String> {
    let top = git(&["rev-parse", "--show-toplevel"])?;
    if Path::new(&top).canonicalize().ok()? != Path::new(".").canonicalize().ok()? {
        return None;
    }
    let commit = git(&["rev-parse", "HEAD"])?;
    match git(&["status", "--porcelain", "--untracked-files=no"]).as_deref() {
        Some("") => Some(commit),
        _ => Some(commit + "-dirty"),
    }
}

/// The commit of a tarball, which `git archive` writes into the file.
fn archived() -> Option<String> {
    let text = std::fs::read_to_string("packaging/commit").ok()?;
    Some(text.trim().to_string()).filter(|commit| !commit.starts_with('$'))
}

fn main() {
    println!("cargo::rerun-if-env-changed=GSHEAR_COMMIT");
    let given = std::env::var("GSHEAR_COMMIT").ok();
    let commit = given
        .filter(|commit| !commit.is_empty())
        .or_else(checked_out)
        .or_else(archived);
    println!(
        "cargo::rustc-env=GSHEAR_GIT_COMMIT={}",
        commit.as_deref().unwrap_or("unknown")
    );

    // Again when the sources change, or what is checked out.
    let mut causes: Vec<String> = [
        "build.rs",
        "Cargo.toml",
        "Cargo.lock",
        "src",
        "crates",
        "packaging/commit",
    ]
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
