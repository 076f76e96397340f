//! Provenance of a run: program, processor, time.

use std::sync::OnceLock;
use std::time::SystemTime;

/// The version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

static COMMIT: OnceLock<&'static str> = OnceLock::new();

/// Sets the commit that the program was built from, with `-dirty` if its files were changed since.
/// Only the first call counts. The program hands it over at its start, so that a new commit
/// rebuilds the program alone and none of its libraries.
pub fn set_git_commit(commit: &'static str) {
    COMMIT.get_or_init(|| commit);
}

/// Returns the commit of [`set_git_commit`], or `unknown`.
pub fn git_commit() -> &'static str {
    COMMIT.get().copied().unwrap_or("unknown")
}

/// Returns program, version and commit in one line, as printed.
pub fn printed() -> String {
    printed_of("gshear-mpi")
}

/// The same of another program of the package.
pub fn printed_of(program: &str) -> String {
    let (commit, dirty) = match git_commit().split_once('-') {
        Some((commit, _)) => (commit, "-dirty"),
        None => (git_commit(), ""),
    };
    let short = &commit[..commit.len().min(12)];
    format!("{program} {VERSION} ({short}{dirty})")
}

/// Returns the version of the HDF5 library.
pub fn hdf5_version() -> String {
    let (major, minor, patch) = hdf5::library_version();
    format!("{major}.{minor}.{patch}")
}

/// Returns the model name of this machine's processor, or `unknown`.
pub fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let mut lines = text.lines();
    let name = lines.find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or("unknown", |(_, name)| name.trim()).to_string()
}

/// Returns the time now in UTC, as `2026-11-21T09:19:05Z`.
pub fn now() -> String {
    in_utc(SystemTime::now())
}

/// A clock that is not set may be in the years before 1970, which the format lacks.
fn in_utc(time: SystemTime) -> String {
    humantime::format_rfc3339_seconds(time.max(SystemTime::UNIX_EPOCH)).to_string()
}

/// Returns who runs this program: the user of git, or the account.
pub fn user() -> String {
    let git = std::process::Command::new("git")
        .args(["config", "--get", "user.name"])
        .stdin(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .output();
    let of_git = git.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_string());
    let of_account = ["USER", "LOGNAME"].into_iter().flat_map(std::env::var);
    let of_git = of_git.into_iter().filter(|name| !name.is_empty());
    let name = of_git.chain(of_account).next();
    name.unwrap_or_else(|| "unknown".into())
}

/// The name of this machine.
pub fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    match name.trim() {
        "" => std::env::var("HOSTNAME").unwrap_or_else(|_| "unknown".into()),
        name => name.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_is_not_set_is_no_failure() {
        let before = SystemTime::UNIX_EPOCH - std::time::Duration::from_secs(1);
        assert_eq!(in_utc(before), "1970-01-01T00:00:00Z");
    }

    #[test]
    fn says_where_it_came_from() {
        assert!(!processor().is_empty() && !git_commit().is_empty());
        assert!(printed().starts_with("gshear-mpi 0."));
    }
}
