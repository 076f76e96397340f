//! The simulation: parse, run, exit code.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;

use gshear::config::{self, Origin, PeriodicScene, Scene, Source, Study};
use gshear::domain::{Exchange, World};
use gshear::failure::{Failure, STOPPED_EARLY};
use gshear::io::checkpoint;
use gshear::io::collective::agree;
use gshear::packing::Packing;
use gshear::periodic::{self, PeriodicRun};
use gshear::run::{Ending, Header, Options, Run, Start};
use gshear::state::Snapshot;

/// Shears a frictional granular packing: mpirun -n RANKS gshear-mpi [CONFIG.toml]
#[derive(Debug, Parser)]
#[command(version, about, max_term_width = 100)]
#[command(after_help = "\
Without CONFIG.toml the embedded default scene runs (configs/plane-shear-2d.toml, the fast version of Lee & Hurley).

Results in the folder of --out: run.h5 (H5MD: frames and time series), log.csv, checkpoint.h5 and the one before it, scene.toml.
Reduce them with gshear-reduce report.

Exit codes: 0 done; 2 bad input; 3 the numbers failed; 75 stopped early at a checkpoint (signal, --walltime or --stop-at: go on
with --resume); 1 anything else.

SIGTERM, SIGINT, SIGUSR1 and SIGUSR2 stop the run at a checkpoint.")]
struct Arguments {
    /// The scene; see docs/config.md
    #[arg(value_name = "CONFIG.toml", conflicts_with = "resume")]
    config: Option<PathBuf>,
    /// Folder of the results [default: out/<name of the config>; with --resume the checkpoint's folder]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replaces a value of the scene, as in --set shear.strain=0.2; may be given many times
    #[arg(long, value_name = "KEY.PATH=VALUE")]
    set: Vec<String>,
    /// Goes on from a checkpoint, exactly, on any number of ranks
    #[arg(long, value_name = "CHECKPOINT")]
    resume: Option<PathBuf>,
    /// Checks the scene, prints it with every default filled in, and ends
    #[arg(long)]
    check: bool,
    /// Stops at a checkpoint after this time, such as 3h50m, 90s or 2:30:00
    #[arg(long, value_name = "TIME", value_parser = wall_time)]
    walltime: Option<Duration>,
    /// Threads inside each rank, which pay for some 50,000 grains per rank and more
    #[arg(long, value_name = "THREADS", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    threads: u16,
    /// Stops at a checkpoint after this step of the shear
    #[arg(long, value_name = "STEP")]
    stop_at: Option<u64>,
}

/// 3h50m, 90s, 45 (minutes, as Slurm), 2:30:00.
fn wall_time(text: &str) -> Result<Duration, String> {
    let wrong = || format!("{text:?} is no time; write 3h50m, 90s, 2:30:00, or minutes");
    let seconds = |parts: &[&str], units: &[u64]| -> Option<u64> {
        parts.iter().zip(units).try_fold(0u64, |sum, (part, unit)| {
            part.parse::<u64>()
                .ok()?
                .checked_mul(*unit)?
                .checked_add(sum)
        })
    };
    let parts: Vec<&str> = text.split(':').collect();
    let total = match parts.len() {
        2 => seconds(&parts, &[60, 1]),
        3 => seconds(&parts, &[3600, 60, 1]),
        1 if text.bytes().all(|b| b.is_ascii_digit()) => seconds(&parts, &[60]),
        1 => {
            let mut rest = text;
            let mut sum = Some(0u64);
            for (letter, unit) in [('d', 86400), ('h', 3600), ('m', 60), ('s', 1)] {
                if let Some((number, after)) = rest.split_once(letter) {
                    rest = after;
                    let part = seconds(&[number], &[unit]);
                    sum = sum.zip(part).and_then(|(a, b)| a.checked_add(b));
                }
            }
            sum.filter(|_| rest.is_empty())
        }
        _ => None,
    };
    total
        .filter(|&s| s > 0)
        .map(Duration::from_secs)
        .ok_or_else(wrong)
}

fn main() -> ExitCode {
    let world = World::start();
    let speaks = world.rank() == 0;
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(e) => {
            if speaks {
                let _ = e.print();
            }
            return ExitCode::from(e.exit_code() as u8);
        }
    };
    let code = match go(&world, &arguments) {
        Ok(Ending::Done) => 0,
        Ok(Ending::Stopped) => STOPPED_EARLY,
        Err(failure) => {
            if speaks {
                eprintln!("error: {failure}");
            }
            if let (Failure::Other(_), true) = (&failure, world.size() > 1) {
                // HDF5 would try to close a broken file while MPI ends, and might wait for ever.
                world.barrier();
                world.abort(failure.exit_code());
            }
            failure.exit_code()
        }
    };
    ExitCode::from(code as u8)
}

fn go(world: &World, arguments: &Arguments) -> Result<Ending, Failure> {
    let (task, out) = set_up(world, arguments)?;
    if arguments.check {
        if world.rank() == 0 {
            print!("{}", task.toml());
        }
        return Ok(Ending::Done);
    }
    let options = Options {
        out,
        stop_at: arguments.stop_at,
        wall_time: arguments.walltime,
        threads: arguments.threads.into(),
        replay: None,
    };
    match task {
        Task::PlaneShear(scene, start) => Run::new(world, &scene, &options)?.run(start),
        Task::Periodic(scene, from) => PeriodicRun::new(world, &scene, &options)?.run(from),
    }
}

/// What is to be run, and what it begins with.
enum Task {
    PlaneShear(Box<Scene>, Start),
    Periodic(Box<PeriodicScene>, Option<Snapshot>),
}

impl Task {
    fn toml(&self) -> &str {
        match self {
            Task::PlaneShear(scene, _) => &scene.toml,
            Task::Periodic(scene, _) => &scene.toml,
        }
    }
}

fn set_up(world: &World, arguments: &Arguments) -> Result<(Task, PathBuf), Failure> {
    if let Some(path) = &arguments.resume {
        let (toml, snapshot) = checkpoint::read(world, path)?;
        let task = if periodic::Header::read(&snapshot).is_some() {
            let scene = periodic::scene_of_checkpoint(path, toml, &arguments.set)?;
            Task::Periodic(Box::new(scene), Some(snapshot))
        } else {
            let scene = Header::read(&snapshot)?.scene(path, toml, &arguments.set)?;
            Task::PlaneShear(Box::new(scene), Start::Checkpoint(snapshot))
        };
        let beside = path.parent().unwrap_or(std::path::Path::new(".")).into();
        return Ok((task, arguments.out.clone().unwrap_or(beside)));
    }
    // One rank reads, so that all run the same scene.
    let read = match &arguments.config {
        Some(path) if world.rank() == 0 => Source::read(path),
        Some(path) => Ok(Source::of_file(path, "")),
        None => Ok(Source::embedded()),
    };
    let source = agree(world, read)?;
    let text = world.broadcast(source.text().as_bytes().to_vec());
    let text = String::from_utf8_lossy(&text);
    let source = match &arguments.config {
        Some(path) => Source::of_file(path, text),
        None => Source::new(source.name(), text),
    };
    let task = from_the_start(world, &source, &arguments.set)?;
    let name = arguments
        .config
        .as_deref()
        .and_then(|p| p.file_stem())
        .map_or("plane-shear-2d".into(), |s| s.to_string_lossy());
    let out = arguments
        .out
        .clone()
        .unwrap_or_else(|| PathBuf::from("out").join(&*name));
    Ok((task, out))
}

/// The scene and, where it has a packing, its grains: rank 0 reads them, the others are told what the scene must know.
fn from_the_start(world: &World, source: &Source, set: &[String]) -> Result<Task, Failure> {
    let mut packing = None;
    let study = config::study(source, set, &mut |path, copies| {
        let read = match world.rank() {
            0 => Packing::read(path, copies).map(Some),
            _ => Ok(None),
        };
        packing = agree(world, read)?;
        let file = packing.as_ref().map(|packing| &packing.file);
        let text = world.broadcast(serde_json::to_vec(&file).expect("a file of finite numbers"));
        Ok(serde_json::from_slice(&text).expect("what rank 0 wrote"))
    })?;
    let scene = match study {
        Study::PlaneShear(scene) => scene,
        Study::Periodic(scene) => return Ok(Task::Periodic(Box::new(scene), None)),
    };
    if let Origin::Insertion(_) = scene.origin {
        return Ok(Task::PlaneShear(Box::new(scene), Start::Insertion));
    }
    let grains = agree(world, packing.map_or(Ok(Vec::new()), |p| p.grains(&scene)))?;
    Ok(Task::PlaneShear(Box::new(scene), Start::Packing(grains)))
}
