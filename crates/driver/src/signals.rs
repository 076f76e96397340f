//! Signals by which a batch system or a user requests a stop at a checkpoint.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1, SIGUSR2};

use gshear_dem::failure::Failure;

/// Catches SIGTERM, SIGINT, SIGUSR1 and SIGUSR2, which the run reads after each step. A second
/// SIGINT or SIGTERM ends the program at once.
pub struct Signals(Arc<AtomicBool>);

impl Signals {
    pub fn catch() -> Result<Self, Failure> {
        let flag = Arc::new(AtomicBool::new(false));
        let failed = |e| Failure::other(format!("signals cannot be caught: {e}"));
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register_conditional_shutdown(signal, 1, flag.clone())
                .map_err(failed)?;
        }
        for signal in [SIGTERM, SIGINT, SIGUSR1, SIGUSR2] {
            signal_hook::flag::register(signal, flag.clone()).map_err(failed)?;
        }
        Ok(Self(flag))
    }

    pub fn received(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
