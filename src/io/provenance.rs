//! Where a run came from: which program, on what, when.

use std::time::SystemTime;

/// Of the package.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Commit the program was built from, with `-dirty` where its files were changed since; `unknown` outside a repository.
pub const GIT_COMMIT: &str = env!("GSHEAR_GIT_COMMIT");

/// Program, version and commit, as printed.
pub fn printed() -> String {
    let commit = GIT_COMMIT
        .split_once('-')
        .map_or((GIT_COMMIT, ""), |(c, _)| (c, "-dirty"));
    let short = &commit.0[..commit.0.len().min(12)];
    format!("{} {VERSION} ({short}{})", env!("CARGO_PKG_NAME"), commit.1)
}

/// Model name of this machine's processor, else `unknown`.
pub fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or("unknown", |(_, name)| name.trim()).to_string()
}

/// Now, in UTC, as `2026-11-21T09:19:05Z`.
pub fn now() -> String {
    humantime::format_rfc3339_seconds(SystemTime::now()).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn says_where_it_came_from() {
        assert!(!processor().is_empty() && !GIT_COMMIT.is_empty());
        assert!(printed().starts_with("gshear-mpi 0."));
    }
}
