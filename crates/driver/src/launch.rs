//! The start of a run: from a scene and its grains, or from a checkpoint.

use std::path::Path;

use gshear_dem::dimension::{Three, Two};
use gshear_dem::failure::Failure;
use gshear_dem::laws::LawSpace;
use gshear_mpi_exchange::Parallel;
use gshear_scene::packing::Packing;
use gshear_scene::{Boundary, Dimensions, Scene, Source};
use gshear_store::checkpoint;
use gshear_store::collective::agree;
use gshear_store::columns::{AQS_FILE, NEWTONIAN_FILE};

use crate::files::RUN_FILE;
use crate::header::Header;
use crate::memory;
use crate::run::{Options, Outcome, Run, Start};
use crate::stages::{periodic, walls};

/// A scene, and the state from which its run starts.
pub struct Task {
    /// The scene.
    pub scene: Scene,
    /// The initial state.
    pub start: Start,
}

impl Task {
    /// Runs to the end; collective.
    ///
    /// # Errors
    /// Bad input, numbers that fail, or files that cannot be written.
    pub fn run(self, exchange: &dyn Parallel, options: &Options) -> Result<Outcome, Failure> {
        let Self { scene, start } = self;
        let mut run = Run::new(exchange, &scene.toml, &scene.bookkeeping, options)?;
        run.terminal.header(exchange, &scene, run.isa);
        match scene.dimension {
            Dimensions::Two => stages::<Two>(&mut run, &scene, start),
            Dimensions::Three => stages::<Three>(&mut run, &scene, start),
        }
    }

    /// The file of the last stage, whose attribute `digest` marks a finished run.
    pub(crate) fn last_file(&self) -> &'static str {
        match &self.scene.boundary {
            Boundary::Walls(_) => RUN_FILE,
            Boundary::Periodic(periodic) if periodic.newtonian.is_some() => NEWTONIAN_FILE,
            Boundary::Periodic(_) => AQS_FILE,
        }
    }
}

fn stages<D: LawSpace>(run: &mut Run<'_>, scene: &Scene, start: Start) -> Result<Outcome, Failure> {
    match &scene.boundary {
        Boundary::Walls(plane_shear) => walls::run::<D>(run, scene, plane_shear, start),
        Boundary::Periodic(periodic) => periodic::run::<D>(run, scene, periodic, start),
    }
}

/// Loads a scene and, if it has a packing, its grains, which rank 0 reads. Collective.
///
/// # Errors
/// An invalid configuration or packing.
///
/// # Panics
/// If the packing holds a number that is not finite, which [`Packing::read`] refuses.
pub fn from_the_start(
    exchange: &dyn Parallel,
    source: &Source,
    set: &[String],
) -> Result<Task, Failure> {
    let mut packing = None;
    let limit = memory::limit(exchange);
    let scene = gshear_scene::load_within(source, set, &limit, &mut |path, copies| {
        let read = match exchange.rank() {
            0 => Packing::read_at_most(path, copies, &limit).map(Some),
            _ => Ok(None),
        };
        packing = agree(exchange, read)?;
        let file = packing.as_ref().map(|packing| &packing.file);
        let text = exchange.broadcast(serde_json::to_vec(&file).expect("a file of finite numbers"));
        Ok(serde_json::from_slice(&text).expect("what rank 0 wrote"))
    })?;
    let start = match &scene.boundary {
        Boundary::Walls(plane_shear) if plane_shear.origin.file().is_some() => {
            let grains = packing.map_or(Ok(Vec::new()), |p| p.grains(&scene));
            Start::Grains(agree(exchange, grains)?)
        }
        _ => Start::Insertion,
    };
    Ok(Task { scene, start })
}

/// Loads a checkpoint: its scene with the overrides `set`, and its state. Collective.
///
/// # Errors
/// A checkpoint that is damaged or of another version, or an invalid override.
pub fn from_checkpoint(
    exchange: &dyn Parallel,
    path: &Path,
    set: &[String],
) -> Result<Task, Failure> {
    let (toml, snapshot) = checkpoint::read(exchange, path)?;
    let scene = Header::read(&snapshot)?.scene(path, toml, set)?;
    Ok(Task {
        scene,
        start: Start::Checkpoint(snapshot),
    })
}
