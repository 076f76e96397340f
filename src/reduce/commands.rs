//! The command line, and which command does what.

use std::io::Write;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

use crate::failure::Failure;
use crate::io::run_reader::Run;
use crate::{analysis, report};

use super::{compare, dmin, export, info, phases, rate_state, spectrum};

/// Reduces the runs of gshear-mpi: what is in them, D²min, stick and slip phases, and a report with figures.
///
/// RUN is a run.h5 or the folder that holds one. Runs that were stopped early are read as far as they go.
///
/// Exit codes: 0 done; 1 the runs differ (compare), or anything not named here; 2 bad input (file or arguments).
#[derive(Debug, Parser)]
#[command(name = "gshear-reduce", version, max_term_width = 100)]
pub struct Arguments {
    /// Threads that work on frames [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show what is in a run
    Info {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
    },
    /// Compare two runs field by field, to the last bit
    ///
    /// Prints for every field how many values differ, the largest absolute and relative difference and where it is.
    /// NaN equals NaN. Frames are compared one by one in their order, contacts by their ids.
    /// Exit code 0 where all is equal, 1 where anything differs.
    Compare {
        /// A run.h5, or the folder that holds one
        a: PathBuf,
        /// Another run.h5, or the folder that holds one
        b: PathBuf,
    },
    /// Write D²min between consecutive frames into reduced.h5 (Lee & Hurley, appendix B)
    ///
    /// Dataset dmin/value[frame][grain] in m²; NaN in frame 0, for rattlers of the earlier frame, and where fewer than
    /// two neighbours or neighbours on one line leave it undefined.
    Dmin {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Radius of the neighbourhood in mean radii of the grains
        #[arg(long, value_name = "R", default_value_t = analysis::dmin::RADIUS, allow_negative_numbers = true)]
        radius: f64,
    },
    /// Write a table of the stick and slip phases of τ into phases.csv
    ///
    /// Phases are the maximal monotone runs of τ in the time series, whose interval is the Δγ that t_p is counted in.
    Phases {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Write one state of a run in a format of other programs
    ///
    /// lammps-data and liggghts-data: a data file of atom_style sphere; types are 1 free grains, 2 bottom wall, 3 top wall, and
    /// the density is such that the program gives each grain the mass that the disk has per metre of depth. sample.packing
    /// reads either back.
    Export {
        /// A run.h5, the folder that holds one, or a checkpoint
        run: PathBuf,
        #[arg(long, value_enum)]
        format: export::Format,
        /// last, or the number of a frame, from 0 on [default: last]
        #[arg(long, value_name = "N")]
        frame: Option<export::Which>,
        /// File to write [default: frame-N.data or checkpoint.data beside the run]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Fit rate-and-state friction to runs under a spring: velocity steps and slide-hold-slide
    ///
    /// Runs of the same protocol are realisations: their mean is reduced, with bands of 2σ among them. Writes the mean series, tables of
    /// segments, steps, holds and fits (CSV), rate-state.json, and figures. Intervals are of 95 %.
    RateState {
        /// Each a run.h5, or the folder that holds one
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// Evolution of the state to fit
        #[arg(long, value_enum, default_value_t = rate_state::Laws::Both)]
        law: rate_state::Laws,
        /// Folder to write into [default: the first run's folder + /rate-state]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Eigenvalues of K v = λ M v, of matrix files: spectrum.csv, spectrum.h5 with the eigenvectors, spectrum.svg
    ///
    /// K is real and sparse, M a diagonal. Without --dense or --all-pairs: those nearest the shift, by shift-invert. A pair is evidence
    /// only where the verdict says pair; doubtful ones may be the work of rounding (docs/spectrum.md).
    Spectrum(spectrum::Options),
    /// Write a report: index.html with all figures in it, the figures as SVG, summary.json
    Report {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's folder + /report]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

/// Does what the command line asks for; what it finds goes to `output`.
///
/// Returns the exit code: 0, or 1 where `compare` found a difference. Errors: bad files, or output that cannot be written.
pub fn run(arguments: &Arguments, output: &mut impl Write) -> Result<i32, Failure> {
    if let Some(threads) = arguments.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global()
            .map_err(|e| Failure::other(format!("threads: {e}")))?;
    }
    match &arguments.command {
        Command::Info { run } => info::print(&Run::open(run)?, output)?,
        Command::Compare { a, b } => {
            let comparison = compare::runs(&Run::open(a)?, &Run::open(b)?)?;
            comparison.print(output).map_err(lost)?;
            return Ok(i32::from(!comparison.equal()));
        }
        Command::Dmin { run, out, radius } => {
            let run = Run::open(run)?;
            let path = dmin::write(&run, out.as_deref().unwrap_or(run.folder()), *radius)?;
            writeln!(output, "wrote {}", path.display()).map_err(lost)?;
        }
        Command::Phases { run, out } => {
            let run = Run::open(run)?;
            phases::write(&run, out.as_deref().unwrap_or(run.folder()), output)?;
        }
        Command::Export {
            run,
            format,
            frame,
            out,
        } => {
            let path = export::write(run, *format, *frame, out.as_deref())?;
            writeln!(output, "wrote {}", path.display()).map_err(lost)?;
        }
        Command::RateState { runs, law, out } => {
            let runs: Vec<Run> = runs
                .iter()
                .map(|run| Run::open(run))
                .collect::<Result<_, _>>()?;
            let folder = out
                .clone()
                .unwrap_or_else(|| runs[0].folder().join("rate-state"));
            rate_state::write(&runs, *law, &folder, output)?;
        }
        Command::Spectrum(options) => spectrum::write(options, output)?,
        Command::Report { run, out } => {
            let run = Run::open(run)?;
            let folder = out.clone().unwrap_or_else(|| run.folder().join("report"));
            let page = report::write(&run, &folder)?;
            writeln!(output, "wrote {}", page.display()).map_err(lost)?;
        }
    }
    output.flush().map_err(lost)?;
    Ok(0)
}

/// Output that could not be written, to a terminal or a pipe.
pub(super) fn lost(error: std::io::Error) -> Failure {
    Failure::other(format!("standard output: {error}"))
}
