//! The clock of a thread's processor time.

use rustix::time::{ClockId, clock_gettime};

/// Processor time of this thread (ns).
pub fn processor_time() -> u64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    1_000_000_000 * time.tv_sec as u64 + time.tv_nsec as u64
}
