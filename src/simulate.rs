//! The program `gshear-mpi`: parses the command line, runs the simulation, returns the exit code.

use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use clap::error::{ContextKind, ContextValue, ErrorKind};

use gshear_dem::domain::{Exchange, Solo};
use gshear_dem::failure::{Failure, Result, STOPPED_EARLY};
use gshear_driver::folder::{named, same_folder};
use gshear_driver::launch::{self, Changes, Task};
use gshear_driver::layout::{Cores, print_layouts};
use gshear_driver::options::{Options, Outcome, Verbosity};
use gshear_driver::preview::{check, check_continued};
use gshear_driver::say::{say, say_error};
use gshear_driver::signals::Signals;
use gshear_driver::sweep::jobs::{self, Jobs};
use gshear_driver::sweep::{Selection, Sweep, table};
use gshear_driver::version;
use gshear_mpi_exchange::{ForeignLauncher, Parallel, World, launcher_variable};
use gshear_scene::Source;
use gshear_scene::packing::split_frame;
use gshear_store::collective::{on_root, told_by_root};
use gshear_store::file_names::is_reduced;
use gshear_store::{h5, provenance};

use crate::{AUTO, Choice, Command, CommandLine, new_scene};

/// The program `gshear-mpi`, and of programs with laws of their own
/// ([`register`](gshear_dem::laws::register)). `commit` names the sources in the files of a run.
pub fn simulate(commit: &'static str) -> ExitCode {
    // Before MPI starts, which takes a while: a signal without a handler ends the program at once.
    let signals = Signals::catch();
    provenance::set_git_commit(commit);
    if let Ok(arguments) = CommandLine::try_parse()
        && launcher_variable().is_none()
    {
        // Without MPI: the launchers of the runs would take this process for a rank.
        if let Some(at_a_time) = arguments.jobs {
            let outcome = signals.and_then(|_| run_at_a_time(&arguments, at_a_time.into()));
            return ExitCode::from(exit_code(&outcome, true) as u8);
        }
        // A job script asks before its ranks start.
        if let Some(cores) = arguments.layouts {
            let outcome = print_layouts_of(&Solo, &arguments, cores);
            return ExitCode::from(exit_code(&outcome, true) as u8);
        }
    }
    if let Some(foreign) = ForeignLauncher::find() {
        foreign.give_way();
        let outcome = Err(Failure::input(&foreign.message));
        return ExitCode::from(exit_code(&outcome, foreign.is_first) as u8);
    }
    let world = World::start();
    let speaks = world.rank() == 0;
    let arguments = match CommandLine::try_parse() {
        Ok(arguments) => arguments,
        Err(mut e) => {
            // Ranks are asked for of the launcher.
            if e.get(ContextKind::InvalidArg) == Some(&ContextValue::String("-n".into())) {
                let tip = "mpirun gives the ranks: mpirun -n RANKS gshear-mpi CONFIG.toml";
                let tip = ContextValue::StyledStrs(vec![tip.into()]);
                e.insert(ContextKind::Suggested, tip);
            }
            if speaks && e.kind() == ErrorKind::DisplayVersion {
                say(version::text().trim_end());
            } else if speaks {
                let _ = e.print();
            }
            return ExitCode::from(e.exit_code() as u8);
        }
    };
    let launched = world.check_launcher();
    let outcome = signals.and(launched).and_then(|()| go(&world, &arguments));
    let code = exit_code(&outcome, speaks);
    // All ranks know the outcome, but only one may have a file that it could not close.
    let left_open = world.maximum(f64::from(u8::from(h5::is_left_open()))) > 0.0;
    if left_open || matches!(outcome, Err(Failure::Other(_))) {
        // When MPI ends, HDF5 would try to close the file: it could wait for ever, or crash.
        world.barrier();
        world.abort(code);
    }
    ExitCode::from(code as u8)
}

/// The exit code of an outcome; `speaks`: whether to say why it failed.
fn exit_code(outcome: &Result<Outcome>, speaks: bool) -> i32 {
    match outcome {
        Ok(Outcome::Done) => 0,
        Ok(Outcome::Stopped) => STOPPED_EARLY,
        Err(failure) => {
            if speaks {
                say_error(&format!("error: {failure}"));
            }
            failure.exit_code()
        }
    }
}

/// The options of the command line, with the default folder of the results.
fn options(arguments: &CommandLine) -> Options {
    let config = arguments.config.as_deref().and_then(Path::file_stem);
    let name = config.map_or("plane-shear-2d".into(), |stem| stem.to_string_lossy());
    let out = arguments.out.clone();
    Options {
        out: out.unwrap_or_else(|| Path::new("out").join(&*name)),
        stop_at: arguments.stop_at,
        wall_time: arguments.walltime,
        threads: arguments.threads.into(),
        overwrite: arguments.overwrite,
        break_lock: arguments.break_lock,
        profile: arguments.profile,
        verbosity: match (arguments.quiet, arguments.verbose) {
            (true, _) => Verbosity::Quiet,
            (_, true) => Verbosity::Verbose,
            _ => Verbosity::Normal,
        },
        replay: None,
    }
}

/// Runs several runs of a sweep at a time. Not collective.
fn run_at_a_time(arguments: &CommandLine, at_a_time: usize) -> Result<Outcome> {
    let Some(Choice::Run(chosen)) = &arguments.sweep else {
        return Err(Failure::input(
            "--jobs is for runs of a sweep; give it with --sweep all, or with the numbers of runs",
        ));
    };
    let options = options(arguments);
    let source = read(&Solo, arguments)?;
    let sweep = Sweep::new(&source, &arguments.set, options.out.clone())?;
    let config = arguments.config.iter().map(OsString::from);
    let set = arguments
        .set
        .iter()
        .map(|set| format!("--set={set}").into());
    let jobs = Jobs {
        at_a_time,
        ranks: arguments.ranks.into(),
        arguments: config.chain(set).collect(),
    };
    jobs::run(&sweep, chosen, &jobs, &options)
}

/// Prints the layouts for the scene, or for the first of the chosen runs of its sweep. Collective.
fn print_layouts_of(
    exchange: &dyn Parallel,
    arguments: &CommandLine,
    cores: Cores,
) -> Result<Outcome> {
    let source = read(exchange, arguments)?;
    let task = match &arguments.sweep {
        None => launch::from_the_start(exchange, &source, &arguments.set)?,
        Some(choice) => {
            let chosen = match choice {
                Choice::Run(chosen) => chosen,
                Choice::List | Choice::Status => &Selection::All,
            };
            let out = options(arguments).out;
            Sweep::new(&source, &arguments.set, out)?.first(exchange, chosen)?
        }
    };
    print_layouts(exchange, &task.scene, cores)?;
    Ok(Outcome::Done)
}

fn go(world: &World, arguments: &CommandLine) -> Result<Outcome> {
    if let Some(Command::New { template, file }) = &arguments.command {
        let written = on_root(world, || new_scene::write(template, file.as_deref()))?;
        if world.rank() == 0 {
            let path = written.display();
            say(&format!(
                "wrote {path}; next: gshear-mpi {path} --check, then mpirun -n 2 gshear-mpi {path}"
            ));
        }
        return Ok(Outcome::Done);
    }
    if let (Some(_), Some(variable)) = (arguments.jobs, launcher_variable()) {
        return Err(Failure::input(format!(
            "--jobs starts each run itself, and {variable} says that a launcher started this program; leave out mpirun or srun, give the ranks of a run with --ranks, or remove {variable} from the environment"
        )));
    }
    if let Some(cores) = arguments.layouts {
        return print_layouts_of(world, arguments, cores);
    }
    let mut options = options(arguments);
    let resume = arguments.resume.as_deref();
    let auto = resume == Some(Path::new(AUTO));
    if let Some(path) = resume
        && !auto
    {
        return resume_from(world, arguments, options, path);
    }
    if auto && (arguments.branch.is_some() || arguments.overwrite) {
        return Err(Failure::input(
            "--resume auto continues the run in the folder; leave out --branch and --overwrite, or give --resume a checkpoint",
        ));
    }
    let source = read(world, arguments)?;
    let Some(choice) = &arguments.sweep else {
        let begin = || launch::from_the_start(world, &source, &arguments.set);
        if auto && arguments.check {
            return check_continued(world, begin, &options).map(|()| Outcome::Done);
        }
        let task = begin()?;
        if !auto {
            return check_or_run(world, arguments, &options, task);
        }
        launch::await_lock(world, &mut options);
        return match launch::resume_if_begun(world, &options.out, task)? {
            Some(task) => task.run(world, &options),
            None => Ok(finished(world, &options.out)),
        };
    };
    let sweep = Sweep::new(&source, &arguments.set, options.out.clone())?;
    match choice {
        Choice::List => sweep
            .list(world, &Selection::All, &options)
            .map(|()| Outcome::Done),
        Choice::Status => table::status(&sweep, world, &options).map(|()| Outcome::Done),
        // The list checks every scene, and says what they take together.
        Choice::Run(chosen) if arguments.check => {
            sweep.check(world, chosen, &options).map(|()| Outcome::Done)
        }
        Choice::Run(chosen) => sweep.run(world, chosen, &options),
    }
}

/// Resumes from a checkpoint or from the newest one of a folder.
fn resume_from(
    world: &World,
    arguments: &CommandLine,
    mut options: Options,
    path: &Path,
) -> Result<Outcome> {
    if let Some(config) = &arguments.config {
        return Err(Failure::input(format!(
            "{}: --resume {} takes the scene from the checkpoint; leave the scene out and change it with --set, or give --resume auto",
            config.display(),
            path.display()
        )));
    }
    let changes = match arguments.branch {
        Some(_) => Changes::Branch(&arguments.set),
        None => Changes::Set(&arguments.set),
    };
    // The folder of `checkpoint.h5` alone is the present one.
    let folder = match path.parent() {
        _ if path.is_dir() => path,
        folder => named(folder.unwrap_or(path)),
    };
    let other = arguments.branch.as_ref().or(arguments.out.as_ref());
    options.out = other.cloned().unwrap_or_else(|| folder.into());
    if options.overwrite && same_folder(&options.out, folder) {
        return Err(Failure::input(format!(
            "--overwrite would remove {} itself; give another folder with --out",
            path.display()
        )));
    }
    match launch::resume(world, path, changes)? {
        Some(task) => check_or_run(world, arguments, &options, task),
        None if other.is_none() => Ok(finished(world, folder)),
        None => Err(Failure::input(format!(
            "{}: holds a finished run; give a later end with --set, or one of its checkpoints",
            path.display()
        ))),
    }
}

/// Says that there is nothing left to do.
fn finished(world: &World, folder: &Path) -> Outcome {
    if world.rank() == 0 {
        say(&format!("{}: the run is finished", folder.display()));
    }
    Outcome::Done
}

/// Whether a packing is the run in this folder, or was made of it.
fn is_within(packing: &Path, folder: &Path) -> bool {
    let (file, _) = split_frame(packing);
    let name = file.file_name().and_then(|name| name.to_str());
    let is_h5 = file.extension().is_some_and(|extension| extension == "h5");
    let of_a_run = is_h5 || name.is_some_and(is_reduced);
    let place = if file.is_dir() {
        Some(&*file)
    } else if of_a_run {
        file.parent()
    } else {
        None
    };
    place.is_some_and(|place| same_folder(place, folder))
}

fn check_or_run(
    world: &World,
    arguments: &CommandLine,
    options: &Options,
    task: Task,
) -> Result<Outcome> {
    let begins_with = task.scene.packing().map(|file| file.path.as_path());
    if let Some(path) =
        begins_with.filter(|path| options.overwrite && is_within(path, &options.out))
    {
        return Err(Failure::input(format!(
            "--overwrite would remove {}, with which the run begins; give another folder with --out",
            path.display()
        )));
    }
    if arguments.check {
        return check(world, &task, options).map(|()| Outcome::Done);
    }
    task.run(world, options)
}

/// Reads the configuration on one rank, so that all ranks run the same scene.
fn read(exchange: &dyn Parallel, arguments: &CommandLine) -> Result<Source> {
    let read = || match &arguments.config {
        Some(path) => Source::read(path).map(Some),
        None => Ok(Some(Source::embedded())),
    };
    let source = told_by_root(exchange, read)?;
    Ok(source.expect("rank 0 has read it"))
}
