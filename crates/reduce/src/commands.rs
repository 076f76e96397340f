//! The command line, and which command does what.

use std::io::Write;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

use gshear_analysis as analysis;
use gshear_analysis::regions::MinPoints;
use gshear_dem::failure::Failure;
use gshear_report as report;
use gshear_report::lee_hurley::Choice;
use gshear_store::run_reader::Run;

use super::{
    compare, correlate, dmin, export, info, phases, rate_state, regions, replay, spectrum, study,
};

/// Reduces the runs of gshear-mpi: what is in them, D²min, stick and slip phases, and a report with figures.
///
/// RUN is a run.h5 or the folder that holds one. Runs that were stopped early are read as far as they go.
///
/// Exit codes: 0 done; 1 the runs differ (compare), or anything not named here; 2 bad input (file or arguments); 3 the numbers
/// failed (a replay that differs).
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
    /// Write a table of the scalars of every frame into regions.csv: GR regions, gD²min, contact angles (Lee & Hurley, section 3)
    ///
    /// A line a frame, each between it and the frame before: the greatest D²min and the mean of the greatest tenth (m²), the number
    /// of GR regions in both readings of DBSCAN's minPts (1 and 2, the point itself counted), Spearman's rho of |Δσ_p| with D²min
    /// and its p, mean and median contact angle in GR regions (rad).
    Regions {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Write what happened in every phase and how it goes with the change of τ (Lee & Hurley, section 3.3)
    ///
    /// measures.csv: a line a phase, with the measures of equations 1 to 4. correlations.csv: Spearman's rho and its two-sided p in
    /// half-decades of Δτ, Δτ_p and D²min. Phases are those of τ at the frames, whose interval is the Δγ that t_p is counted in.
    Correlate {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Shear strain at which the stick-slip regime begins
        #[arg(long, value_name = "STRAIN", default_value_t = 0.0)]
        from: f64,
        /// Points within reach that make a core point of DBSCAN, the point itself counted: 1, or 2, by which a grain alone is noise
        #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
        min_points: u8,
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
    /// Compute a stretch of a run again, with frames, from the checkpoint before it: run.h5 in a folder of its own
    ///
    /// The run must have kept its checkpoints (output.keep_checkpoints); what lies after its last one or two is there in any case.
    /// Its time series from the checkpoint on is compared with the one stored, to the last bit: exit code 3 where it differs.
    Replay {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// From the first to the last row of the time series in this stretch of shear strain, as 0.1005..0.1006
        #[arg(long, value_name = "A..B", value_parser = replay::strains, required_unless_present = "time")]
        strain: Option<Strains>,
        /// Of a run in a box: a stretch of the time of Newton's equations, into newtonian.h5 of the new folder
        #[arg(long, value_name = "A..B", value_parser = replay::strains, conflicts_with = "strain")]
        time: Option<Strains>,
        /// Steps between frames, from the first row on [default: a frame for every row]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
        every: Option<u64>,
        /// Folder to write into [default: the run's folder + /replay-A-B]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Write a report: index.html with all figures in it, the figures as SVG, summary.json
    ///
    /// With --study lee-hurley instead, of one run or of several: every figure of Lee & Hurley that rests on data, under its number,
    /// as fig-NN.svg with fig-NN.csv; the paper's numbers beside ours in numbers.csv; the largest drops in drops.csv; index.html that
    /// shows them. Frames around the largest drop that are missing are replayed where checkpoints were kept. Samples of more
    /// than 2,236 disks count as the paper's large one. The series of the phases is τ at the frames.
    ///
    /// With --study bonfanti, of the folder of one run in a periodic box: figures 1 to 5 of Bonfanti et al. with their data.
    Report {
        /// A run.h5, or the folder that holds one; several for a study
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// Folder to write into [default: the first run's folder + /report, or + /lee-hurley]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Repeat a published study
        #[arg(long, value_enum)]
        study: Option<Study>,
        /// Shear strain at which the stick-slip regime of a study begins [default: the paper's, 0.022 small and 0.054 large]
        #[arg(long, value_name = "STRAIN", requires = "study")]
        from: Option<f64>,
        /// Points within reach that make a core point of DBSCAN, as for correlate
        #[arg(long, value_name = "N", default_value_t = 1, requires = "study", value_parser = clap::value_parser!(u8).range(1..=2))]
        min_points: u8,
    },
}

/// γ of both ends of a stretch.
type Strains = [f64; 2];

/// A study that can be repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Study {
    /// Lee & Hurley: microscopic dynamics of rearrangement and stick-slip
    LeeHurley,
    /// Bonfanti et al.: oscillatory instabilities, of the folder of a run in a periodic box
    Bonfanti,
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
    // Of a single run that is computed again.
    let threads = arguments.threads.map_or(1, usize::from);
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
        Command::Regions { run, out } => {
            let run = Run::open(run)?;
            let path = regions::write(&run, out.as_deref().unwrap_or(run.folder()))?;
            writeln!(output, "wrote {}", path.display()).map_err(lost)?;
        }
        Command::Correlate {
            run,
            out,
            from,
            min_points,
        } => {
            let run = Run::open(run)?;
            let folder = out.as_deref().unwrap_or(run.folder());
            for path in correlate::write(&run, folder, *from, reading(*min_points))? {
                writeln!(output, "wrote {}", path.display()).map_err(lost)?;
            }
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
        Command::Replay {
            run,
            strain,
            time,
            every,
            out,
        } => {
            if let Some(time) = time {
                let how = (*every, threads);
                replay::newtonian(run, *time, how, out.as_deref(), output)?;
                return Ok(0);
            }
            let Some(strain) = strain else {
                return Err(Failure::input("replay: give --strain A..B or --time A..B"));
            };
            let wanted = replay::Wanted {
                strain: *strain,
                every: *every,
                threads,
            };
            replay::write(&Run::open(run)?, wanted, out.as_deref(), output)?;
        }
        Command::Spectrum(options) => spectrum::write(options, output)?,
        Command::Report {
            runs,
            out,
            study,
            from,
            min_points,
        } => {
            if let Some(Study::Bonfanti) = study {
                let page = study::bonfanti(runs, out.as_deref())?;
                writeln!(output, "wrote {}", page.display()).map_err(lost)?;
                return Ok(0);
            }
            let first = Run::open(&runs[0])?;
            let folder = |name: &str| out.clone().unwrap_or_else(|| first.folder().join(name));
            let page = match study {
                Some(_) => {
                    let choice = Choice {
                        onset: *from,
                        min_points: reading(*min_points),
                    };
                    study::lee_hurley(runs, &folder("lee-hurley"), choice, threads)?
                }
                None if runs.len() > 1 => {
                    return Err(Failure::input(format!(
                        "report: {} runs: without --study it takes one",
                        runs.len()
                    )));
                }
                None => report::write(&first, &folder("report"))?,
            };
            writeln!(output, "wrote {}", page.display()).map_err(lost)?;
        }
    }
    output.flush().map_err(lost)?;
    Ok(0)
}

fn reading(min_points: u8) -> MinPoints {
    match min_points {
        1 => MinPoints::Itself,
        _ => MinPoints::OneNeighbour,
    }
}

/// Output that could not be written, to a terminal or a pipe.
pub(super) fn lost(error: std::io::Error) -> Failure {
    Failure::other(format!("standard output: {error}"))
}
