//! Signals by which a batch system or a user requests a stop at a checkpoint.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU, SIGXFSZ};

use gshear_dem::failure::{Failure, Result};

/// Catches SIGTERM, SIGINT, SIGHUP, SIGUSR1, SIGUSR2 and SIGXCPU, which the run reads after each
/// step. A second SIGINT or SIGTERM ends the program at once.
#[derive(Clone)]
pub struct Signals(Arc<AtomicBool>);

static CAUGHT: OnceLock<Signals> = OnceLock::new();

impl Signals {
    /// Installs the handlers at the first call, which should be the first of the program: a signal
    /// before it ends the program without a message.
    ///
    /// # Errors
    /// Signals that cannot be caught.
    pub fn catch() -> Result<Self> {
        if let Some(caught) = CAUGHT.get() {
            return Ok(caught.clone());
        }
        let flag = Arc::new(AtomicBool::new(false));
        let failed = |e| Failure::other(format!("signals cannot be caught: {e}"));
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register_conditional_shutdown(signal, 1, flag.clone())
                .map_err(failed)?;
        }
        outlive_full_files();
        // A run under nohup goes on when its terminal closes.
        let hangup = (!is_ignored(SIGHUP)).then_some(SIGHUP);
        for signal in [SIGTERM, SIGINT, SIGUSR1, SIGUSR2, SIGXCPU]
            .into_iter()
            .chain(hangup)
        {
            signal_hook::flag::register(signal, flag.clone()).map_err(failed)?;
        }
        Ok(CAUGHT.get_or_init(|| Self(flag)).clone())
    }

    /// Whether a signal came.
    pub fn received(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Makes a write beyond the limit of the size of files fail with a reason; its signal would end the
/// program without one.
pub fn outlive_full_files() {
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::default());
}

/// Whether the process was started with this signal ignored.
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}
