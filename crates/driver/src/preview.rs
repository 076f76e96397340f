//! `--check`: what a run will take and what is unlikely about it, before anything is written.

use gshear_dem::failure::{Failure, Result};
use gshear_mpi_exchange::Parallel;
use gshear_scene::{Dimensions, Scene, unlikely};

use crate::estimate::{Estimate, bytes, cores, dense_height, height_between};
use crate::folder::{self, free};
use crate::launch::{Task, resume_if_begun};
use crate::layout::{self, Layout, SampleSize};
use crate::options::{Options, Verbosity};
use crate::say::{self, say_error};
use crate::terminal::ranks as in_words;
use crate::{calibration, ends, memory};

/// Prints the scene of a task on standard output and, unless told to be quiet, what its run takes
/// on standard error. Collective.
///
/// # Errors
/// Ends that a checkpoint has passed; more ranks than the sample has room for; standard output that
/// cannot be written.
pub fn check(exchange: &dyn Parallel, task: &Task, options: &Options) -> Result<()> {
    ends::check(task, options.stop_at)?;
    print(exchange, task)?;
    prospects(exchange, task, options, None)
}

/// [`check`] of a run that continues what its folder holds, as `--resume auto` and `--sweep` do.
/// `begin`: the task from the start. Collective.
///
/// # Errors
/// As of [`check`], and an invalid scene.
pub fn check_continued(
    exchange: &dyn Parallel,
    begin: impl Fn() -> Result<Task>,
    options: &Options,
) -> Result<()> {
    match resume_if_begun(exchange, &options.out, begin()?) {
        Ok(Some(task)) => check(exchange, &task, options),
        Ok(None) => {
            print(exchange, &begin()?)?;
            if exchange.rank() == 0 && options.verbosity != Verbosity::Quiet {
                let folder = options.out.display();
                let what = "holds this run, which is finished; nothing is left to do";
                say_error(&format!("{:<12}{folder}: {what}", "folder"));
            }
            Ok(())
        }
        // Another run, or damaged checkpoints.
        Err(refused @ Failure::Input(_)) => {
            let task = begin()?;
            print(exchange, &task)?;
            prospects(exchange, &task, options, Some(refused))
        }
        Err(failure) => Err(failure),
    }
}

/// Prints the scene on standard output. Collective.
fn print(exchange: &dyn Parallel, task: &Task) -> Result<()> {
    say::print(exchange, task.scene.toml.trim_end_matches('\n'))
}

/// Unless told to be quiet, says on standard error what the run of a task takes, what is in its
/// folder, and what is unlikely. `refused`: why it cannot begin there, if that is known.
/// Collective.
fn prospects(
    exchange: &dyn Parallel,
    task: &Task,
    options: &Options,
    refused: Option<Failure>,
) -> Result<()> {
    if options.verbosity == Verbosity::Quiet {
        return Ok(());
    }
    let mut estimate = Estimate::of(exchange, task, options.stop_at);
    estimate.speed = calibration::speed(exchange, task, options)?;
    if estimate.strains() {
        estimate.strain_step = calibration::strain_step(exchange, task, options)?;
    }
    let memory = memory::per_rank(exchange);
    if exchange.rank() != 0 {
        return Ok(());
    }
    let folder = refused.map_or_else(|| folder::preview(&options.out, task), Err);
    let mut text = estimate.text();
    if let Ok(folder) = &folder {
        text += &format!("{:<12}{folder}\n", "folder");
    }
    say_error(text.trim_end());
    if let Err(refused) = folder {
        say_error(&format!("warning: {refused}"));
    }
    let place = free(&options.out);
    for warning in warnings(task, &estimate, memory, place, options) {
        say_error(&format!("warning: {warning}"));
    }
    Ok(())
}

/// What is allowed and unlikely about the scene of a task and its grains, on rank 0.
pub(crate) fn doubts(task: &Task) -> Vec<String> {
    let scene = &task.scene;
    let height = match scene.shear() {
        Some(walls) => height_between(walls, &scene.sample, dense_height(scene)),
        None => dense_height(scene),
    };
    let mut doubts = unlikely::unlikely(scene, height);
    doubts.extend(task.not_at_load());
    doubts
}

/// Grains per rank from which threads are worth it (docs/validation/speed.md, "Threads").
const THREADED: f64 = 5_000.0;

fn warnings(
    task: &Task,
    estimate: &Estimate,
    memory: Option<f64>,
    free: Option<f64>,
    options: &Options,
) -> Vec<String> {
    let scene = &task.scene;
    let mut warnings = doubts(task);
    let (ranks, threads) = (estimate.ranks, options.threads);
    let sensible = sensible_ranks(scene);
    if ranks > sensible {
        warnings.push(format!(
            "{ranks} ranks are more than make sense: slabs are so narrow that ranks mostly exchange the grains at their borders; run it on {sensible}"
        ));
    }
    if ranks <= sensible {
        let given = Layout { ranks, threads };
        warnings.extend(layout::advice(&SampleSize::of(scene), given));
    }
    let per_rank = f64::from(scene.sample.grains) / ranks as f64;
    if threads > 1 && per_rank < THREADED {
        warnings.push(format!(
            "{threads} threads in a rank of {per_rank:.0} grains mostly wait for each other: they are worth it from about {THREADED:.0} grains per rank; leave out --threads"
        ));
    }
    if ranks * threads > cores() && estimate.hosts == 1 {
        let (cores, all) = (cores(), ranks * threads);
        let (all, fewer) = if threads == 1 {
            let fewer = format!("run it on {} here", cores.min(sensible));
            (in_words(ranks), fewer)
        } else {
            let fewer = "give fewer ranks or --threads".into();
            (format!("{all} threads"), fewer)
        };
        warnings.push(format!(
            "{all} share the {cores} processors of this machine and wait for each other; {fewer}"
        ));
    }
    if let Some(memory) = memory.filter(|memory| estimate.memory > 0.9 * memory) {
        warnings.push(format!(
            "a rank needs about {} of memory, and there are {} for each; use more nodes",
            bytes(estimate.memory),
            bytes(memory)
        ));
    }
    if let Some(free) = free.filter(|free| estimate.disk() > *free) {
        warnings.push(format!(
            "{}: the run needs about {}, and {} are free; write fewer frames (output.frame_strain) or give another folder with --out",
            options.out.display(),
            bytes(estimate.disk()),
            bytes(free)
        ));
    }
    warnings
}

/// Time that a rank takes for a border grain, and that all take for a step whatever they hold, over
/// that for a grain of its own (docs/validation/speed.md, "Many ranks").
const BORDER: f64 = 1.2;
const STEP: f64 = 20.0;

/// The most ranks of which each spends no more time on its borders than on its grains.
pub(crate) fn sensible_ranks(scene: &Scene) -> usize {
    let sample = &scene.sample;
    let diameter = sample.mean_diameter;
    let height = match scene.stages.first_strain() {
        Some(quasi_static) => quasi_static.lengths(sample)[2],
        None => dense_height(scene),
    };
    let across = match scene.dimension {
        Dimensions::Two => 1.0,
        Dimensions::Three => sample.width / diameter,
    };
    // Two columns on each side, sent and received.
    let border = 4.0 * height / diameter * across;
    let least = BORDER * border + STEP;
    ((f64::from(sample.grains) / least) as usize).max(1)
}
