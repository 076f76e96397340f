//! The command line, and the function that runs each command.

use std::io::Write;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Parser, Subcommand};

use crate::output::cannot_write;
use gshear_analysis as analysis;
use gshear_analysis::correlate::Choices;
use gshear_analysis::jacobian::History;
use gshear_analysis::ranges::Bins;
use gshear_analysis::regions::{GrReading, MinPoints, Reduction};
use gshear_analysis::tau::TauReading;
use gshear_dem::failure::Failure;
use gshear_store::file_names::folder_of;
use gshear_store::run_reader::RunFile;
use gshear_store::status::{RunState, Status};

use super::{
    columns, compare, correlate, dmin, export, growth, info, phases, rate_state, regions, replay,
    report, spectrum, stability, stages, watch,
};

/// Reduces runs of gshear-mpi: D²min, stick and slip phases, rate-and-state fits, spectra, reports
///
/// RUN is a run.h5 or the folder that holds one. Of a run in a box, info, compare, dmin, export,
/// report, spectrum and stability take aqs.h5 (that of its folder) or newtonian.h5. A run that is
/// under way or was stopped early is read up to its last complete row and frame.
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

/// The commands and their options.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show the content of a run
    Info {
        /// A run.h5, aqs.h5 or newtonian.h5, or the folder of a run
        run: PathBuf,
    },
    /// Show the curves of a run under way in the terminal, until it ends
    ///
    /// Reads log.csv and status.json every second, while the run writes: stress ratio and solid
    /// fraction over the strain, or over the time if the strain returns; of a box the shear stress,
    /// from aqs.h5. Ctrl-C leaves the run alone. Without a terminal, and of a run that has ended, it shows the
    /// present state and ends.
    Watch {
        /// The folder of a run
        run: PathBuf,
    },
    /// Print name, unit and meaning of the columns of every table
    ///
    /// Of log.csv, of the tables that this program writes, and of the time series of boxes.
    /// Beside each CSV file the same stands in FILE-metadata.json (CSV on the Web).
    Columns {
        /// Only of this table, such as log.csv or phases.csv
        table: Option<String>,
        /// Dimensions: in 2 forces, energies and masses are per unit depth
        #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(2..=3))]
        dimension: u8,
    },
    /// Compare two runs field by field, to the last bit
    ///
    /// Prints for each field the number of values that differ, and the largest absolute and
    /// relative difference with its place. NaN equals NaN. Frames and rows are compared in their
    /// order, contacts by their ids. Exit code 0 if everything is equal, 1 if anything differs.
    Compare {
        /// A run.h5, aqs.h5 or newtonian.h5, or the folder of a run
        a: PathBuf,
        /// Another one
        b: PathBuf,
    },
    /// Write D²min between consecutive frames into reduced.h5 (Lee & Hurley, appendix B)
    ///
    /// Dataset dmin/value, by frame and grain, in m². NaN in frame 0, for rattlers of the earlier
    /// frame, and for grains with fewer than two neighbours or with all neighbours on one line.
    Dmin {
        /// A run.h5, aqs.h5 or newtonian.h5, or the folder of a run
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Radius of the neighbourhood in mean radii
        #[arg(long, value_name = "R", default_value_t = analysis::dmin::RADIUS, allow_negative_numbers = true)]
        radius: f64,
    },
    /// Write the stick and slip phases of τ into phases.csv
    ///
    /// A phase is a maximal monotone run of τ in the time series. Durations t_p are counted in
    /// intervals Δγ of the series. The options change what τ is; Lee & Hurley leave that open.
    Phases {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Shear strain from which on phases are found
        #[arg(long, value_name = "STRAIN", default_value_t = 0.0)]
        from: f64,
        /// N in τ = S/N
        #[arg(long, value_enum, default_value_t = WhichForce::Measured)]
        normal_force: WhichForce,
        /// Take every Nth row of the time series as the end of an interval
        #[arg(long, value_name = "N", default_value_t = NonZeroUsize::MIN)]
        every: NonZeroUsize,
        /// Average τ over the rows of an interval
        #[arg(long)]
        average: bool,
        /// Round τ to multiples of this
        #[arg(long, value_name = "UNIT", value_parser = positive)]
        round: Option<f64>,
    },
    /// Write the scalars of every frame into regions.csv: GR regions, gD²min, contact angles (Lee &
    /// Hurley, section 3)
    ///
    /// One line per frame, from the frame before it to this one: the greatest D²min and the mean of
    /// the greatest tenth (m²), the number of GR regions for minPts = 1 and 2 of DBSCAN (the point
    /// itself counted), Spearman's rho of |Δσ_p| with D²min and its p, mean and median contact
    /// angle in GR regions (rad).
    Regions {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Write statistics of every phase and their correlation with the change of τ (Lee & Hurley,
    /// section 3.3)
    ///
    /// measures.csv: one line per phase, with the measures of equations 1 to 4. correlations.csv:
    /// Spearman's rho and its two-sided p in ranges of Δτ, Δτ_p and D²min. Phases are those
    /// of τ at the frames; t_p is counted in intervals of the frames.
    Correlate {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Shear strain at which the stick-slip regime begins
        #[arg(long, value_name = "STRAIN", default_value_t = 0.0)]
        from: f64,
        /// Choices that the paper leaves open
        #[command(flatten)]
        choices: StatisticsOptions,
    },
    /// Write the stages of the largest drop of τ, and grains and contacts at steps around it (Lee &
    /// Hurley, section 3.2)
    ///
    /// stages.csv: Stages I, II and III, and the large slips in Stage II. stages-steps.csv,
    /// stages-grains.csv and stages-contacts.csv: up to 18 intervals around the drop, with the
    /// direction of tension, D²min, the grains of the greatest reduction of force, non-affine
    /// displacements, and the changes of the contact forces; they need a frame at both ends of these
    /// intervals. Missing frames are replayed into the folder replay if checkpoints were kept
    /// (output.keep_checkpoints). Phases are those of τ at the frames.
    Stages {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Shear strain at which the stick-slip regime begins
        #[arg(long, value_name = "STRAIN", default_value_t = 0.0)]
        from: f64,
        /// Reduction of force of a grain, by which the grains of GR regions are chosen
        #[arg(long, value_enum, default_value_t = GrainReduction::Net)]
        reduction: GrainReduction,
    },
    /// Fit the growth of the complex pair in newtonian.h5, and say what became of it
    ///
    /// growth.csv, of one line: ω_i and ω_r fitted to the mean square displacement, the aftermath
    /// (catastrophe, saturation or growing) with the changes of stress, pressure, energy and contacts,
    /// and the overlap of the pair's eigenvector with D²min between the first and the last frame.
    /// growth-grains.csv: |v|² and D²min of every grain; without lines if there is no pair or no frame.
    Growth {
        /// A newtonian.h5, or the folder that holds one
        run: PathBuf,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Write frames or a checkpoint in the format of another program
    ///
    /// lammps-data and liggghts-data are data files of one state, of atom_style sphere. In 2D the
    /// density gives each grain the mass of the disk per metre of depth. sample.packing reads both.
    /// The other formats hold any number of frames; lammps-dump and csv write the contacts into
    /// NAME-contacts beside the file. Types in LAMMPS' formats: 1 free grains, 2 bottom wall, 3 top
    /// wall; ids are those of the run plus 1. Everything is in SI units, of a run in a box in its
    /// own ones.
    Export {
        /// A run.h5, aqs.h5 or newtonian.h5, the folder of a run, or a checkpoint
        run: PathBuf,
        /// Format of the file
        #[arg(long, value_enum)]
        format: export::ExportFormat,
        /// One frame: its number, from 0 on, or last [default for data files: last]
        #[arg(long, value_name = "N")]
        frame: Option<export::Which>,
        /// Frames A to B, both included, every Nth of them; .. is all [default: all]
        #[arg(long, value_name = "A..B[:N]", conflicts_with = "frame")]
        frames: Option<export::FrameRange>,
        /// Numbers to compute for every grain
        #[arg(long, value_enum, value_delimiter = ',', value_name = "FIELD,...")]
        fields: Vec<export::GrainField>,
        /// Eigenvectors of spectrum.h5, by their numbers from 0 on: displacement and rotation of
        /// every grain, real and imaginary parts, with the frame they are of
        #[arg(long, value_delimiter = ',', value_name = "K,...")]
        modes: Vec<usize>,
        /// File of the eigenvectors [default: spectrum.h5 in the folder of the run]
        #[arg(long, value_name = "FILE", requires = "modes")]
        spectrum: Option<PathBuf>,
        /// File to write [default: frame-N.data, checkpoint.data, frames.FORMAT, or of a box
        /// aqs-frames.FORMAT or newtonian-frames.FORMAT in the folder of the run]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Fit rate-and-state friction to spring-driven runs: velocity steps and slide-hold-slide tests
    ///
    /// Runs of the same protocol are realisations: their mean is reduced, with bands of 2σ between
    /// realisations. Writes the mean series, tables of segments, steps, holds and fits (CSV),
    /// rate-state.json, and figures. Intervals are 95 % confidence intervals.
    RateState {
        /// A run.h5, or the folder that holds one; several are realisations or further protocols
        #[arg(required = true, value_name = "RUN")]
        runs: Vec<PathBuf>,
        /// Evolution law to fit
        #[arg(long, value_enum, default_value_t = rate_state::Laws::Both)]
        law: rate_state::Laws,
        /// The a of -a ln(1 + k̄ V_i t/a), with which the relaxation in holds is compared [default: of
        /// the fit]
        #[arg(long, value_name = "A", value_parser = positive)]
        direct_effect: Option<f64>,
        /// Folder to write into [default: the first run's folder + /rate-state]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Compute eigenvalues of K v = λ M v, of a run or of matrix files
    ///
    /// K is real and sparse, M diagonal. Without --dense, --all-pairs or --unstable: the
    /// eigenvalues nearest the shift, by shift-invert. Trust a pair only if its verdict is pair;
    /// doubtful pairs may be rounding errors (docs/spectrum.md). Writes spectrum.csv, spectrum.h5
    /// with the eigenvectors, and spectrum.svg.
    Spectrum(spectrum::SpectrumOptions),
    /// Count complex pairs and negative eigenvalues of frames, in stability.csv
    ///
    /// One line per frame, from all eigenvalues of K v = λ M v without vectors, which takes a fifth
    /// of the time of spectrum --dense: up to 6,000 unknowns.
    Stability {
        /// A run.h5, aqs.h5 or newtonian.h5, or the folder of a run
        run: PathBuf,
        /// Frames A to B, both included, every Nth of them; .. is all
        #[arg(long, value_name = "A..B[:N]", default_value = "..")]
        frames: export::FrameRange,
        /// Take J as printed by Bonfanti et al., whose histories do not turn with the contacts
        #[arg(long)]
        paper_form: bool,
        /// Stop at the first of these frames with a complex pair
        #[arg(long)]
        until_pair: bool,
        /// Folder to write into [default: the run's]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Compute a part of a run again, with frames, from the checkpoint before it
    ///
    /// Writes a run.h5 into a folder of its own. The run must have kept its checkpoints
    /// (output.keep_checkpoints); otherwise only its end, from the last two checkpoints on, can be
    /// replayed. The time series is compared with the stored one, to the last bit: exit code 3 if
    /// it differs.
    Replay {
        /// A run.h5, or the folder that holds one
        run: PathBuf,
        /// Range of shear strain, as 0.1005..0.1006: from the first to the last row of the time
        /// series in it
        #[arg(long, value_name = "A..B", value_parser = replay::range, required_unless_present = "time")]
        strain: Option<Strains>,
        /// Range of time in s, as 0.1..0.2: as --strain, for a strain that returns. Of a run in a box
        /// that of Newton's equations; writes newtonian.h5 into the new folder
        #[arg(long, value_name = "A..B", value_parser = replay::range, conflicts_with = "strain")]
        time: Option<Strains>,
        /// Steps between frames, from the first row on [default: one frame per row]
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
        every: Option<u64>,
        /// Folder to write into [default: the run's folder + /replay-A-B]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
    /// Write a report: index.html with all figures, each as SVG with its data as CSV, summary.json
    ///
    /// If no frames show the largest drop of a run between walls but checkpoints were kept
    /// (output.keep_checkpoints), the drop is computed again, with a frame per row. The page of a run
    /// in a periodic box shows what its deformation and Newton's equations have measured.
    Report {
        /// A run.h5, aqs.h5 or newtonian.h5, or the folder of a run
        run: PathBuf,
        /// Folder to write into [default: the run's folder + /report]
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

/// Choices of the statistics in correlate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::Args)]
pub struct StatisticsOptions {
    /// minPts of DBSCAN, the point itself counted: with 1 a single grain is a region, with 2 it
    /// is noise
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    min_points: u8,
    /// Reduction of force of a grain, by which the grains of GR regions are chosen
    #[arg(long, value_enum, default_value_t = GrainReduction::Net)]
    reduction: GrainReduction,
    /// Ranges of Δτ, Δτ_p and D²min; the last one of Δτ and Δτ_p is open
    #[arg(long, value_enum, default_value_t = RangeWidth::Decades)]
    bins: RangeWidth,
}

impl StatisticsOptions {
    fn choices(self) -> Choices {
        let min_points = match self.min_points {
            1 => MinPoints::Itself,
            _ => MinPoints::OneNeighbour,
        };
        Choices {
            regions: GrReading {
                reduction: self.reduction.into(),
                min_points,
            },
            bins: match self.bins {
                RangeWidth::Decades => Bins::Decades,
                RangeWidth::HalfDecades => Bins::HalfDecades,
            },
        }
    }
}

/// The normal force in τ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum WhichForce {
    /// That of the free grains on the top wall
    Measured,
    /// That imposed on it
    Imposed,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if f64::is_finite(value) && value > 0.0 => Ok(value),
        _ => Err("must be a number greater than 0".into()),
    }
}

/// Width of ranges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum RangeWidth {
    /// As the thresholds in the text of Lee & Hurley
    Decades,
    /// Half as wide
    HalfDecades,
}

/// The reduction of force of a grain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum GrainReduction {
    /// Sum over its contacts; gains make up for losses
    Net,
    /// Sum over those of its contacts that lose force
    Losses,
    /// That of the contact that loses most
    GreatestLoss,
}

impl From<GrainReduction> for Reduction {
    fn from(reduction: GrainReduction) -> Self {
        match reduction {
            GrainReduction::Net => Reduction::Net,
            GrainReduction::Losses => Reduction::Losses,
            GrainReduction::GreatestLoss => Reduction::GreatestLoss,
        }
    }
}

/// γ at both ends of a range.
type Strains = [f64; 2];

/// How often a run under way is read that may be in the middle of a flush, and the time between.
const ATTEMPTS: usize = 20;
const PAUSE: Duration = Duration::from_millis(100);

impl Command {
    /// The runs that the command reads once.
    fn runs(&self) -> Vec<&PathBuf> {
        match self {
            Self::Columns { .. } | Self::Watch { .. } => Vec::new(),
            Self::Compare { a, b } => vec![a, b],
            Self::RateState { runs, .. } => runs.iter().collect(),
            Self::Spectrum(options) => options.run.iter().collect(),
            Self::Info { run }
            | Self::Dmin { run, .. }
            | Self::Phases { run, .. }
            | Self::Regions { run, .. }
            | Self::Correlate { run, .. }
            | Self::Stages { run, .. }
            | Self::Growth { run, .. }
            | Self::Export { run, .. }
            | Self::Stability { run, .. }
            | Self::Replay { run, .. }
            | Self::Report { run, .. } => vec![run],
        }
    }
}

/// Runs the command and prints to `output`. Returns the exit code: 0, or 1 if `compare` has found a
/// difference.
///
/// # Errors
/// Bad files, numbers that fail, output that cannot be written.
pub fn run(arguments: &Arguments, output: &mut impl Write) -> Result<i32, Failure> {
    if let Some(threads) = arguments.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.into());
        pool.build_global()
            .map_err(|e| Failure::other(format!("threads: {e}")))?;
    }
    let is_under_way = |run: &&PathBuf| {
        Status::read(folder_of(run)).is_some_and(|status| status.state == RunState::Running)
    };
    for _ in 1..ATTEMPTS {
        match once(arguments, output) {
            Err(Failure::Input(_)) if arguments.command.runs().iter().any(is_under_way) => {
                std::thread::sleep(PAUSE);
            }
            outcome => return outcome,
        }
    }
    once(arguments, output)
}

fn once(arguments: &Arguments, output: &mut impl Write) -> Result<i32, Failure> {
    // Threads of a replay.
    let threads = arguments.threads.map_or(1, usize::from);
    match &arguments.command {
        Command::Info { run } => info::print(&RunFile::open_any(run)?, output)?,
        Command::Columns { table, dimension } => {
            columns::print(table.as_deref(), usize::from(*dimension), output)?;
        }
        Command::Compare { a, b } => {
            let comparison = compare::runs(&RunFile::open_any(a)?, &RunFile::open_any(b)?)?;
            comparison.print(output).map_err(cannot_write)?;
            return Ok(i32::from(!comparison.equal()));
        }
        Command::Dmin { run, out, radius } => {
            let run = RunFile::open_any(run)?;
            let path = dmin::write(&run, out.as_deref().unwrap_or(run.folder()), *radius)?;
            writeln!(output, "wrote {}", path.display()).map_err(cannot_write)?;
        }
        Command::Phases {
            run,
            out,
            from,
            normal_force,
            every,
            average,
            round,
        } => {
            let run = RunFile::open(run)?;
            let request = phases::PhaseRequest {
                normal_force: match normal_force {
                    WhichForce::Measured => phases::NormalForce::Measured,
                    WhichForce::Imposed => phases::NormalForce::Imposed,
                },
                tau: TauReading {
                    every: *every,
                    average: *average,
                    round: *round,
                },
                from: *from,
            };
            let folder = out.as_deref().unwrap_or(run.folder());
            phases::write(&run, &request, folder, output)?;
        }
        Command::Regions { run, out } => {
            let run = RunFile::open(run)?;
            let path = regions::write(&run, out.as_deref().unwrap_or(run.folder()))?;
            writeln!(output, "wrote {}", path.display()).map_err(cannot_write)?;
        }
        Command::Correlate {
            run,
            out,
            from,
            choices,
        } => {
            let run = RunFile::open(run)?;
            let folder = out.as_deref().unwrap_or(run.folder());
            for path in correlate::write(&run, folder, *from, choices.choices())? {
                writeln!(output, "wrote {}", path.display()).map_err(cannot_write)?;
            }
        }
        Command::Stages {
            run,
            out,
            from,
            reduction,
        } => {
            let run = RunFile::open(run)?;
            let folder = out.as_deref().unwrap_or(run.folder());
            let request = stages::StagesRequest {
                from: *from,
                reduction: (*reduction).into(),
                threads,
            };
            for path in stages::write(&run, folder, request)? {
                writeln!(output, "wrote {}", path.display()).map_err(cannot_write)?;
            }
        }
        Command::Growth { run, out } => {
            let folder = out.as_deref().unwrap_or(folder_of(run));
            for path in growth::write(run, folder)? {
                writeln!(output, "wrote {}", path.display()).map_err(cannot_write)?;
            }
        }
        Command::Export {
            run,
            format,
            frame,
            frames,
            fields,
            modes,
            spectrum,
            out,
        } => {
            let request = export::ExportRequest {
                format: *format,
                frame: *frame,
                frames: *frames,
                fields: fields.clone(),
                modes: modes.clone(),
                spectrum: spectrum.clone(),
                out: out.clone(),
            };
            for path in export::write(run, &request)? {
                writeln!(output, "wrote {}", path.display()).map_err(cannot_write)?;
            }
        }
        Command::RateState {
            runs,
            law,
            direct_effect,
            out,
        } => {
            let runs: Vec<RunFile> = runs
                .iter()
                .map(|run| RunFile::open(run))
                .collect::<Result<_, _>>()?;
            let folder = out
                .clone()
                .unwrap_or_else(|| runs[0].folder().join("rate-state"));
            rate_state::write(&runs, (*law, *direct_effect), &folder, output)?;
        }
        Command::Replay {
            run,
            strain,
            time,
            every,
            out,
        } => {
            let rows = match (strain, time) {
                (Some(strain), _) => replay::Rows::Strain(*strain),
                (None, Some(time)) if replay::has_newtonian(run) => {
                    let how = (*every, threads);
                    replay::newtonian(run, *time, how, out.as_deref(), output)?;
                    return Ok(0);
                }
                (None, Some(time)) => replay::Rows::Time(*time),
                (None, None) => {
                    return Err(Failure::input("replay: give --strain A..B or --time A..B"));
                }
            };
            let request = replay::ReplayRequest {
                rows,
                every: *every,
                threads,
            };
            replay::write(&RunFile::open(run)?, request, out.as_deref(), output)?;
        }
        Command::Stability {
            run,
            frames,
            paper_form,
            until_pair,
            out,
        } => {
            let run = RunFile::open_any(run)?;
            let history = if *paper_form {
                History::Unturned
            } else {
                History::Turned
            };
            let folder = out.as_deref().unwrap_or(run.folder());
            let path = stability::write(&run, (*frames, *until_pair), history, folder)?;
            writeln!(output, "wrote {}", path.display()).map_err(cannot_write)?;
        }
        Command::Spectrum(options) => spectrum::write(options, output)?,
        Command::Watch { run } => watch::watch(run, output)?,
        Command::Report { run, out } => {
            let page = report::write(run, out.as_deref(), threads)?;
            writeln!(output, "wrote {}", page.display()).map_err(cannot_write)?;
        }
    }
    output.flush().map_err(cannot_write)?;
    Ok(0)
}
