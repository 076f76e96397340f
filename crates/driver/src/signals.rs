//! Signals by which a batch system or a user requests a stop at a checkpoint.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use nix::sys::signal::{SigSet, SigmaskHow, Signal};
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
        let caught = while_held(Self::install)?;
        Ok(CAUGHT.get_or_init(|| caught).clone())
    }

    fn install() -> Result<Self> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGTERM, SIGINT] {
            let registered =
                signal_hook::flag::register_conditional_shutdown(signal, 1, flag.clone());
            registered.map_err(|e| uncaught(&e))?;
        }
        outlive_full_files();
        // A run under nohup goes on when its terminal closes.
        let hangup = (!is_ignored(SIGHUP)).then_some(SIGHUP);
        for signal in [SIGTERM, SIGINT, SIGUSR1, SIGUSR2, SIGXCPU]
            .into_iter()
            .chain(hangup)
        {
            let registered = signal_hook::flag::register(signal, flag.clone());
            registered.map_err(|e| uncaught(&e))?;
        }
        Ok(Self(flag))
    }

    /// Whether a signal came.
    pub fn received(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// The result of `install`, which installs handlers. Signals that come meanwhile wait until it
/// ends: between the parts of a handler they would be lost.
fn while_held<T>(install: impl FnOnce() -> Result<T>) -> Result<T> {
    let held: SigSet = [
        Signal::SIGTERM,
        Signal::SIGINT,
        Signal::SIGHUP,
        Signal::SIGUSR1,
        Signal::SIGUSR2,
        Signal::SIGXCPU,
    ]
    .into_iter()
    .collect();
    let before = held.thread_swap_mask(SigmaskHow::SIG_BLOCK);
    let before = before.map_err(|e| uncaught(&e.into()))?;
    let installed = install();
    before.thread_set_mask().map_err(|e| uncaught(&e.into()))?;
    installed
}

fn uncaught(why: &std::io::Error) -> Failure {
    Failure::other(format!("signals cannot be caught: {why}"))
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
