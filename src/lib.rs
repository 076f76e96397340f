//! The program `gshear-mpi` as a library: [`simulate`] is its `main`, which programs with laws of
//! their own call, and [`CommandLine`] its command line, of which `packaging/manual` makes
//! completions and manual pages.

mod new_scene;
mod simulate;

use std::ffi::OsStr;
use std::path::PathBuf;
use std::time::Duration;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Parser, Subcommand};

use gshear_driver::layout::Cores;
use gshear_driver::sweep::{ALL, Selection};
use gshear_scene::templates::{TEMPLATES, Template, template};
pub use simulate::simulate;

/// Shears a frictional granular packing: mpirun -n RANKS gshear-mpi [CONFIG.toml]
#[derive(Debug, Parser)]
#[command(
    version,
    about,
    max_term_width = 100,
    args_conflicts_with_subcommands = true
)]
#[command(after_help = "\
mpirun -n RANKS gshear-mpi CONFIG.toml runs a scene on RANKS ranks, to the same bits on any number; \
without mpirun it runs on one.

Without CONFIG.toml the embedded default scene runs (configs/plane-shear-2d.toml, the fast version of \
Lee & Hurley). gshear-mpi new NAME writes a scene to start from.

Results in the folder of --out: run.h5 (H5MD: frames and time series), log.csv, the last two \
checkpoints, scene.toml. A sweep writes a folder for each run; --sweep skips runs that are done and \
resumes those that were stopped; with --jobs it runs several at a time. Reduce results with gshear-reduce.

Exit codes: 0 done; 2 bad input; 3 the numbers failed; 75 stopped early at a checkpoint by a signal, \
--walltime or --stop-at (continue with --resume); 1 any other failure.

SIGTERM, SIGINT, SIGHUP, SIGUSR1, SIGUSR2 and SIGXCPU stop the run at a checkpoint.")]
#[expect(clippy::struct_excessive_bools, reason = "flags of a command line")]
pub struct CommandLine {
    /// Scene; see docs/reference/config.md
    #[arg(value_name = "CONFIG.toml")]
    pub config: Option<PathBuf>,
    /// Folder of the results [default: out/NAME of the config, with --resume the checkpoint's
    /// folder]. It must not hold another run
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace a value of the scene, as in --set shear.strain=0.2; can be repeated
    #[arg(long, value_name = "KEY.PATH=VALUE")]
    pub set: Vec<String>,
    /// Resume from a checkpoint, or from the newest good one of a folder, to the same bits on any
    /// number of ranks. auto: run the scene, from the newest good checkpoint in the folder of the
    /// results if there is one; do nothing if the run is finished. --set may change output and
    /// ends
    #[arg(long, value_name = "CHECKPOINT|FOLDER|auto")]
    pub resume: Option<PathBuf>,
    /// With --resume: begin a new run in this folder, in which --set may also change what decides
    /// the trajectory
    #[arg(
        long,
        value_name = "NEW_FOLDER",
        requires = "resume",
        conflicts_with = "out"
    )]
    pub branch: Option<PathBuf>,
    /// Remove the run that the folder of the results holds, its report too
    #[arg(long, conflicts_with = "check")]
    pub overwrite: bool,
    /// Take the folder of the results over from a process that is gone, although its lock
    /// (run.lock) says otherwise
    #[arg(long)]
    pub break_lock: bool,
    /// Of a scene with a sweep: list its runs, show how far they are, or run all of them or those
    /// of these numbers, such as 3, 5-8 or 1,3,5-8, one after the other unless --jobs is given
    #[arg(long, value_name = "list|status|all|RUNS", value_parser = ChoiceParser, hide_possible_values = true, conflicts_with_all = ["resume", "stop_at"])]
    pub sweep: Option<Choice>,
    /// Run so many runs of the sweep at a time, as far as there are cores for them, each started
    /// as a program of its own: without mpirun, which --ranks starts
    #[arg(long, value_name = "JOBS", value_parser = clap::value_parser!(u16).range(1..), requires = "sweep", conflicts_with_all = ["check", "profile"])]
    pub jobs: Option<u16>,
    /// Ranks of each run of --jobs. The environment's MPIRUN starts them, or else mpirun
    #[arg(long, value_name = "RANKS", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..), requires = "jobs")]
    pub ranks: u16,
    /// Check the scene, or with --sweep one of its runs: print it with every default filled in.
    /// Unless --quiet, print on standard error the steps, time, memory and disk that it takes on
    /// these ranks, and what is unlikely
    #[arg(long)]
    pub check: bool,
    /// Print which numbers of ranks and threads use these cores best, by a model, the best first,
    /// as CSV with the time of a step (s) and the share of it that counts: 4x32 are 32 cores on
    /// each of 4 nodes. Of a sweep for the first of the runs of --sweep
    #[arg(long, value_name = "[NODESx]CORES", conflicts_with_all = ["check", "resume", "jobs", "overwrite", "profile"])]
    pub layouts: Option<Cores>,
    /// Print notes and errors alone
    #[arg(long, short)]
    pub quiet: bool,
    /// Print more: checkpoints, every check of the packing
    #[arg(long, short, conflicts_with = "quiet")]
    pub verbose: bool,
    /// Stop at a checkpoint after this time: 3h50m, 90s, 2:30:00, or minutes
    #[arg(long, value_name = "TIME", value_parser = wall_time)]
    pub walltime: Option<Duration>,
    /// Threads per rank, worth it from about 5,000 grains per rank
    #[arg(long, value_name = "THREADS", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: u16,
    /// Print at the end of a shear what every rank did: a row of CSV each with grains, pairs,
    /// messages, bytes and processor times. Takes some microseconds a step
    #[arg(long)]
    pub profile: bool,
    /// Stop at a checkpoint after this step; those of a shear, of strain steps and of Newton's
    /// equations are counted one after the other
    #[arg(long, value_name = "STEP")]
    pub stop_at: Option<u64>,
    /// What to do instead of a run.
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// What the program does instead of a run.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a commented scene to start from
    ///
    /// Check it with gshear-mpi FILE --check, change it, and run it.
    #[command(name = NEW)]
    New {
        /// Which scene
        #[arg(value_name = "NAME", value_parser = TemplateParser)]
        template: &'static Template,
        /// File of the scene, which must not exist [default: NAME.toml]
        #[arg(value_name = "FILE.toml")]
        file: Option<PathBuf>,
    },
}

/// Parses the name of a [`Template`]; the names are known to completions of the shells.
#[derive(Debug, Clone)]
struct TemplateParser;

impl TypedValueParser for TemplateParser {
    type Value = &'static Template;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        text: &OsStr,
    ) -> Result<&'static Template, clap::Error> {
        let names = TEMPLATES.map(|template| template.name);
        let name = PossibleValuesParser::new(names).parse_ref(command, argument, text)?;
        Ok(template(&name).expect("one of the names"))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        let value = |template: &Template| PossibleValue::new(template.name).help(template.summary);
        Some(Box::new(TEMPLATES.iter().map(value)))
    }
}

/// The command that writes a scene.
pub const NEW: &str = "new";

/// Value of `--resume` that looks for the run in the folder of the results.
pub const AUTO: &str = "auto";

/// What to do with the runs of a sweep.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Choice {
    /// List them, with what is done of each and what is left.
    List,
    /// Show how far they are.
    Status,
    /// Run some of them.
    Run(Selection),
}

/// Parses a [`Choice`]; its words are known to completions of the shells.
#[derive(Debug, Clone)]
struct ChoiceParser;

impl TypedValueParser for ChoiceParser {
    type Value = Choice;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        text: &OsStr,
    ) -> Result<Choice, clap::Error> {
        choice.parse_ref(command, argument, text)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        let words = [
            ("list", "the runs of the sweep"),
            ("status", "how far they are"),
            (ALL, "run all of them"),
        ];
        let words = words.map(|(word, help)| PossibleValue::new(word).help(help));
        Some(Box::new(words.into_iter()))
    }
}

fn choice(text: &str) -> Result<Choice, String> {
    match text {
        "list" => Ok(Choice::List),
        "status" => Ok(Choice::Status),
        _ => text.parse().map(Choice::Run),
    }
}

/// Parses 45 (minutes) and 2:30:00 as Slurm does, and 3h50m or 90s as humantime does.
fn wall_time(text: &str) -> Result<Duration, String> {
    let parts: Vec<&str> = text.split(':').collect();
    let sum = |units: &[u64]| -> Option<Duration> {
        let seconds = parts.iter().zip(units).try_fold(0u64, |sum, (part, unit)| {
            part.parse::<u64>()
                .ok()?
                .checked_mul(*unit)?
                .checked_add(sum)
        });
        seconds.map(Duration::from_secs)
    };
    let time = match parts.len() {
        2 => sum(&[60, 1]),
        3 => sum(&[3600, 60, 1]),
        1 if text.bytes().all(|b| b.is_ascii_digit()) => sum(&[60]),
        _ => humantime::parse_duration(text).ok(),
    };
    time.filter(|time| !time.is_zero())
        .ok_or_else(|| format!("{text:?} is not a time; write 3h50m, 90s, 2:30:00, or minutes"))
}
