//! Provenance of a run: program, processor, time.

use std::sync::OnceLock;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// The version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

static COMMIT: OnceLock<&'static str> = OnceLock::new();

/// Sets the commit that the program was built from, with `-dirty` if its files were changed since.
/// Only the first call counts. The program hands it over at its start, so that a new commit rebuilds
/// the program alone and none of its libraries.
pub fn set_git_commit(commit: &'static str) {
    COMMIT.get_or_init(|| commit);
}

/// Returns the commit of [`set_git_commit`], or `unknown`.
pub fn git_commit() -> &'static str {
    COMMIT.get().copied().unwrap_or("unknown")
}

/// Returns program, version and commit in one line, as printed.
pub fn printed() -> String {
    let commit = git_commit();
    let commit = commit
        .split_once('-')
        .map_or((commit, ""), |(c, _)| (c, "-dirty"));
    let short = &commit.0[..commit.0.len().min(12)];
    format!("gshear-mpi {VERSION} ({short}{})", commit.1)
}

/// Returns the model name of this machine's processor, or `unknown`.
pub fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or("unknown", |(_, name)| name.trim()).to_string()
}

/// Returns the time now in UTC, as `2026-11-21T09:19:05Z`.
pub fn now() -> String {
    utc(SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default())
}

/// A time since 1970 in UTC.
fn utc(since_1970: Duration) -> String {
    let seconds = since_1970.as_secs();
    let (days, second) = (seconds / 86_400, seconds % 86_400);
    // Years from March on, so that the leap day is the last: 400 years have 146,097 days.
    let day = days + 719_468;
    let (era, of_era) = (day / 146_097, day % 146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 {
        from_march + 3
    } else {
        from_march - 9
    };
    let year = 400 * era + year_of_era + u64::from(month <= 2);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_calendar_holds() {
        let known = [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_399, "2000-02-28T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_164_800, "2024-02-29T00:00:00Z"),
            (1_735_689_599, "2024-12-31T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ];
        for (seconds, text) in known {
            assert_eq!(utc(Duration::from_secs(seconds)), text);
        }
    }

    #[test]
    fn says_where_it_came_from() {
        assert!(!processor().is_empty() && !git_commit().is_empty());
        assert!(printed().starts_with("gshear-mpi 0."));
    }
}
