//! The command line, and the list of the commands.

mod columns;
pub mod compare;
mod correlate;
pub(crate) mod dmin;
mod events;
mod export;
mod figure_arguments;
mod growth;
mod info;
mod movie;
mod phases;
mod rate_state;
mod regions;
mod replay;
mod report;
mod spectrum;
mod stability;
mod stages;
mod watch;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{Parser, Subcommand};

use crate::printer::Printer;
use gshear_dem::failure::{Failure, Result};
use gshear_store::file_names::folder_of;
use gshear_store::status::{RunState, Status};

/// Reduces runs of gshear-mpi: D²min, stick and slip phases, rate-and-state fits, spectra, reports
///
/// RUN is a run.h5 or the folder that holds one: the first stage of a run. Commands that need a
/// shear take that, whichever it is; info, compare, dmin, events, export, movie, report, spectrum
/// and stability also take a later stage by its path, run.h5/aqs, run.h5/newtonian or run.h5/shear.
/// A run that is under way or was stopped early is read up to its last complete row and frame.
///
/// Exit codes: 0 done; 1 the runs differ (compare), or any other failure; 2 bad input (file or
/// arguments); 3 the numbers failed (no convergence, a replay that differs).
#[derive(Debug, Parser)]
#[command(name = "gshear-reduce", version, max_term_width = 100)]
pub struct Arguments {
    /// Number of threads [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands with their arguments.
#[derive(Debug, Subcommand)]
#[expect(missing_docs, reason = "the help of a command stands at its arguments")]
pub enum Command {
    Info(info::Arguments),
    Watch(watch::Arguments),
    Columns(columns::Arguments),
    Compare(compare::Arguments),
    Dmin(dmin::Arguments),
    Phases(phases::Arguments),
    Regions(regions::Arguments),
    Correlate(correlate::Arguments),
    Stages(stages::Arguments),
    Events(events::Arguments),
    Growth(growth::Arguments),
    Export(export::Arguments),
    Movie(movie::Arguments),
    RateState(rate_state::Arguments),
    Spectrum(spectrum::Arguments),
    Stability(stability::Arguments),
    Replay(replay::Arguments),
    Report(report::Arguments),
}

/// How often a run under way is read that may be in the middle of a flush, and the time between.
const ATTEMPTS: usize = 20;
const PAUSE: Duration = Duration::from_millis(100);

/// Runs the command and prints to `output`. Returns the exit code: 0, or 1 if `compare` has found a
/// difference.
///
/// # Errors
/// Bad files, numbers that fail, output that cannot be written.
pub fn run(arguments: &Arguments, output: &mut impl Write) -> Result<i32> {
    if let Some(threads) = arguments.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global()
            .map_err(|e| Failure::other(format!("threads: {e}")))?;
    }
    let mut printer = Printer::new(output);
    for _ in 1..ATTEMPTS {
        match once(arguments, &mut printer) {
            (runs, Err(Failure::Input(_))) if runs.iter().any(|run| is_under_way(run)) => {
                std::thread::sleep(PAUSE);
            }
            (_, outcome) => return outcome,
        }
    }
    once(arguments, &mut printer).1
}

fn is_under_way(run: &Path) -> bool {
    Status::read(folder_of(run)).is_some_and(|status| status.state == RunState::Running)
}

/// Parses a number greater than 0.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if f64::is_finite(value) && value > 0.0 => Ok(value),
        _ => Err("must be a number greater than 0".into()),
    }
}

/// Parses a shear strain.
fn strain(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if f64::is_finite(value) => Ok(value),
        _ => Err("must be a strain, such as 0.1".into()),
    }
}

/// Runs the command once. Returns the runs that it reads, and the exit code.
fn once<'a>(arguments: &'a Arguments, printer: &mut Printer) -> (Vec<&'a PathBuf>, Result<i32>) {
    // Threads of a replay.
    let threads = arguments.threads.map_or(1, usize::from);
    let (runs, done) = match &arguments.command {
        Command::Compare(command) => return (vec![&command.a, &command.b], command.run(printer)),
        Command::Watch(command) => (Vec::new(), command.run(printer)),
        Command::Columns(command) => (Vec::new(), command.run(printer)),
        Command::Info(command) => (vec![&command.run], command.run(printer)),
        Command::Dmin(command) => (vec![&command.run], command.run(printer)),
        Command::Phases(command) => (vec![&command.run], command.run(printer)),
        Command::Regions(command) => (vec![&command.run], command.run(printer)),
        Command::Correlate(command) => (vec![&command.run], command.run(printer)),
        Command::Stages(command) => (vec![&command.run], command.run(threads, printer)),
        Command::Events(command) => (vec![&command.run], command.run(printer)),
        Command::Growth(command) => (vec![&command.run], command.run(printer)),
        Command::Export(command) => (vec![&command.run], command.run(printer)),
        Command::Movie(command) => (vec![&command.run], command.run(printer)),
        Command::RateState(command) => (command.runs.iter().collect(), command.run(printer)),
        Command::Spectrum(command) => (command.run.iter().collect(), command.run(printer)),
        Command::Stability(command) => (vec![&command.run], command.run(threads, printer)),
        Command::Replay(command) => (vec![&command.run], command.run(threads, printer)),
        Command::Report(command) => (command.runs.iter().collect(), command.run(threads, printer)),
    };
    (runs, done.and_then(|()| printer.flush()).map(|()| 0))
}
