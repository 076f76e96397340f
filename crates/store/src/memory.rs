//! Memory that a command asks for in large pieces. The system gives an address to almost any
//! request and ends the program when it uses what is not there, or the allocator aborts it; both
//! without a word about what was too large. So large pieces are asked for here first.

use std::fs::read_to_string;

use gshear_dem::failure::{Failure, Result};

/// Below this (bytes) nothing is checked: what the system has free changes as much.
const SMALL: f64 = 64e6;

/// Checks that this process can have so many bytes more for `what`, such as "the matrix K of 12,000
/// unknowns"; `advice`: what to do instead.
///
/// # Errors
/// [`Failure::Other`] if the machine, the limit of the process or that of its control group has
/// fewer.
pub fn require(bytes: f64, what: &str, advice: &str) -> Result<()> {
    if bytes < SMALL {
        return Ok(());
    }
    let free = free();
    if free.is_none_or(|free| bytes <= free) && is_given(bytes) {
        return Ok(());
    }
    let there = free.map_or_else(String::new, |free| {
        format!(", and {:.1} GB are free", free / 1e9)
    });
    Err(Failure::other(format!(
        "{what} takes {:.1} GB of memory{there}; {advice}",
        bytes / 1e9
    )))
}

/// Whether the system gives so many bytes: a test for limits that are told in no file.
fn is_given(bytes: f64) -> bool {
    let count = if bytes < isize::MAX as f64 {
        bytes as usize
    } else {
        usize::MAX
    };
    Vec::<u8>::new().try_reserve_exact(count).is_ok()
}

/// Bytes that all processes of this machine, or of the control group of this one, may have, and
/// this process at most; `None` if the system does not tell.
pub fn total() -> Option<f64> {
    let machine = in_meminfo("MemTotal:");
    let all = [machine, in_group("memory.max"), address_space()];
    all.into_iter().flatten().reduce(f64::min)
}

/// Bytes that this process may still take, if the system tells.
fn free() -> Option<f64> {
    let swap = in_meminfo("SwapFree:").unwrap_or(0.0);
    let of_machine = in_meminfo("MemAvailable:").map(|available| available + swap);
    let of_group = in_group("memory.max").zip(in_group("memory.current"));
    let status = read_to_string("/proc/self/status").unwrap_or_default();
    let used = number_after(&status, "VmSize:").map(|kilobytes| 1024.0 * kilobytes);
    let of_process = address_space().zip(used);
    let left = [of_group, of_process].map(|place| place.map(|(limit, used)| limit - used));
    let all = left.into_iter().flatten().chain(of_machine);
    all.reduce(f64::min).map(|free| free.max(0.0))
}

fn in_meminfo(name: &str) -> Option<f64> {
    let text = read_to_string("/proc/meminfo").ok()?;
    number_after(&text, name).map(|kilobytes| 1024.0 * kilobytes)
}

/// A number of the control group of a container or a job; "max" is none.
fn in_group(name: &str) -> Option<f64> {
    let text = read_to_string(format!("/sys/fs/cgroup/{name}")).ok()?;
    text.trim().parse().ok()
}

/// The limit of the addresses of this process (`ulimit -v`), if it has one.
fn address_space() -> Option<f64> {
    let limits = read_to_string("/proc/self/limits").ok()?;
    number_after(&limits, "Max address space")
}

/// The first number of the line that begins with a name; `None` for "unlimited".
fn number_after(text: &str, name: &str) -> Option<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_large_is_named() {
        require(1e3, "a list", "").unwrap();
        let message = require(1e18, "the matrix K", "give --shift").unwrap_err();
        let message = message.to_string();
        let expected = "the matrix K takes 1000000000.0 GB of memory";
        assert!(message.starts_with(expected), "{message}");
        assert!(message.ends_with("; give --shift"), "{message}");
    }

    #[test]
    fn limits_are_those_of_the_system() {
        assert_eq!(
            number_after("MemTotal:   16384 kB\nB: 1\n", "MemTotal:"),
            Some(16384.0)
        );
        assert!(total().is_none_or(|bytes| bytes > 1e7));
        let text = "Max cpu time   unlimited\nMax address space   1048576   unlimited   bytes\n";
        assert_eq!(number_after(text, "Max address space"), Some(1_048_576.0));
        assert_eq!(number_after(text, "Max cpu time"), None);
        assert!(free().is_none_or(|free| free > 0.0));
    }
}
