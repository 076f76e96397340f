//! `--check`: what a run will take and what is unlikely about it, before anything is written.

use std::path::Path;

use gshear_dem::failure::Failure;
use gshear_mpi_exchange::Parallel;
use gshear_scene::{Boundary, Dimensions, Scene};

use crate::calibration;
use crate::estimate::{Estimate, bytes, cores, dense_height};
use crate::folder::{free, outlook};
use crate::launch::Task;
use crate::memory;
use crate::options::Options;
use crate::say::say_error;

/// Says on standard error what the run of a task takes, what is in its folder, and what is
/// unlikely. Collective.
///
/// # Errors
/// More ranks than the sample has room for.
pub fn check(exchange: &dyn Parallel, task: &Task, options: &Options) -> Result<(), Failure> {
    let mut estimate = Estimate::of(exchange, task)?;
    estimate.speed = calibration::speed(exchange, task, options)?;
    if estimate.strains() {
        estimate.strain_step = calibration::strain_step(exchange, task, options)?;
    }
    let memory = memory::per_rank(exchange);
    if exchange.rank() != 0 {
        return Ok(());
    }
    let (folder, may_write) = outlook(&options.out, &task.claim(None));
    let mut text = estimate.text();
    if may_write {
        text += &format!("{:<12}{folder}\n", "folder");
    }
    say_error(text.trim_end());
    if !may_write {
        say_error(&format!("warning: {folder}"));
    }
    let place = free(&options.out);
    for warning in warnings(&task.scene, &estimate, memory, place, &options.out) {
        say_error(&format!("warning: {warning}"));
    }
    Ok(())
}

fn warnings(
    scene: &Scene,
    estimate: &Estimate,
    memory: Option<f64>,
    free: Option<f64>,
    out: &Path,
) -> Vec<String> {
    let height =
        (dense_height(scene) - 2.0 * scene.sample.mean_diameter).max(scene.sample.mean_diameter);
    let mut warnings = gshear_scene::unlikely::unlikely(scene, height);
    let ranks = estimate.ranks;
    let sensible = sensible_ranks(scene);
    if ranks > sensible {
        warnings.push(format!(
            "{ranks} ranks are more than make sense: slabs are so narrow that ranks mostly exchange the grains at their borders; run it on {sensible}"
        ));
    }
    if ranks > cores() && estimate.hosts == 1 {
        warnings.push(format!(
            "{ranks} ranks share the {} processors of this machine and wait for each other",
            cores()
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
            out.display(),
            bytes(estimate.disk()),
            bytes(free)
        ));
    }
    warnings
}

/// Time that a rank takes for a border grain, and that all take for a step whatever they hold, over
/// that for a grain of its own (docs/speed.md, "Many ranks").
const BORDER: f64 = 1.2;
const STEP: f64 = 20.0;

/// The most ranks of which each spends no more time on its borders than on its grains.
pub fn sensible_ranks(scene: &Scene) -> usize {
    let sample = &scene.sample;
    let diameter = sample.mean_diameter;
    let height = match &scene.boundary {
        Boundary::Walls(_) => dense_height(scene),
        Boundary::Periodic(_) => sample.length,
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
