//! What a run leaves in its folder: `run.h5`, `log.csv`, `scene.toml`, checkpoints.

use std::path::Path;

use gshear_analysis::frame_scalars::FrameScalars;
use gshear_scene::Scene;
use gshear_dem::dimension::Dimension;
use gshear_mpi_exchange::Parallel;
use gshear_dem::failure::Failure;
use gshear_store::checkpoint;
use gshear_store::collective::agree;
use gshear_store::h5::Attribute;
use gshear_store::log::Log;
use gshear_store::provenance;
use gshear_store::trajectory::{GrainShape, RunHeader, TrajectoryWriter};
use crate::run::Options;
use gshear_scene::schedule::Schedule;
use gshear_dem::state::{Cell, ContactSample, GrainSample, SERIES_COLUMNS, SeriesRow, Snapshot};
use gshear_dem::system::System;

pub const RUN_FILE: &str = "run.h5";
pub const LOG_FILE: &str = "log.csv";
pub const SCENE_FILE: &str = "scene.toml";

/// The files of a run in the shear stage. Every call is collective.
pub struct Recorder {
    trajectory: TrajectoryWriter,
    log: Log,
    /// What failed of the log since the last flush.
    log_state: Result<(), Failure>,
    /// Rows of scalars before, where none are computed now.
    scalars_before: u64,
    /// Whether the files are those of the run that is gone on with.
    pub goes_on: bool,
}

/// How much of each is in the files.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Written {
    pub frames: u64,
    /// Of the time series.
    pub rows: u64,
    /// Rows of the scalars of frames.
    pub scalars: u64,
}

impl Recorder {
    /// New files, or those of the run that is gone on with, cut back to what was `written` at its checkpoint.
    /// Where the folder holds no such run, new ones that begin there.
    pub fn open<D: Dimension>(
        exchange: &dyn Parallel,
        scene: &Scene,
        schedule: &Schedule,
        system: &mut System<D>,
        options: &Options,
        written: Option<Written>,
    ) -> Result<Self, Failure> {
        folder(exchange, &options.out)?;
        let (run, log) = (options.out.join(RUN_FILE), options.out.join(LOG_FILE));
        let there = exchange.broadcast(vec![u8::from(run.exists())])[0] == 1;
        if let (Some(written), true) = (written, there) {
            let Written { frames, rows, .. } = written;
            let trajectory =
                TrajectoryWriter::open_to_append(exchange, &run, &SERIES_COLUMNS, frames, rows)?;
            return Self {
                trajectory,
                log: Log::open_to_append(exchange, &log, rows)?,
                log_state: Ok(()),
                scalars_before: written.scalars,
                goes_on: true,
            }
            .with_scalars(exchange, scene);
        }
        let wrote = if exchange.rank() == 0 {
            let path = options.out.join(SCENE_FILE);
            std::fs::write(&path, &scene.toml)
                .map_err(|e| Failure::other(format!("{}: cannot be written: {e}", path.display())))
        } else {
            Ok(())
        };
        agree(exchange, wrote)?;
        let grains = shapes(system);
        // What is one number for a run at one speed is that of the first part of a protocol.
        let first = schedule.protocol.segments()[0];
        let frames = schedule.intervals[0].frames;
        let attributes = [
            ("scene", Attribute::Text(scene.toml.clone())),
            ("version", Attribute::Text(provenance::VERSION.into())),
            ("git_commit", Attribute::Text(provenance::git_commit().into())),
            ("ranks", Attribute::Count(exchange.size() as u64)),
            ("processor", Attribute::Text(provenance::processor())),
            ("started", Attribute::Text(provenance::now())),
            ("time_step", Attribute::Number(schedule.step)),
            (
                "frame_strain",
                Attribute::Number(
                    first.velocity * (frames as f64 * schedule.step) / schedule.height,
                ),
            ),
            ("steps_per_frame", Attribute::Count(frames)),
            (
                "inertial_number",
                Attribute::Number(schedule.inertial_number(scene, first.velocity)),
            ),
            (
                "stiffness_number",
                Attribute::Number(scene.load.stiffness_number),
            ),
            ("dimension", Attribute::Count(D::AXES as u64)),
            ("wall_speed", Attribute::Number(first.velocity)),
            ("normal_force", Attribute::Number(scene.load.normal_force)),
            ("pressure", Attribute::Number(scene.load.pressure)),
            ("height_start", Attribute::Number(schedule.height)),
        ];
        let spring = scene.shear.spring;
        let spring = spring.map(|s| ("spring_stiffness", Attribute::Number(s.stiffness)));
        let attributes: Vec<_> = attributes.into_iter().chain(spring).collect();
        let header = RunHeader {
            axes: D::AXES,
            walls: true,
            series: &SERIES_COLUMNS,
            edges: edges::<D>(system.cell, schedule.height),
            grains: &grains,
            attributes: &attributes,
        };
        Self {
            trajectory: TrajectoryWriter::create(exchange, &run, &header)?,
            log: Log::create(exchange, &log)?,
            log_state: Ok(()),
            scalars_before: 0,
            goes_on: false,
        }
        .with_scalars(exchange, scene)
    }

    fn with_scalars(mut self, exchange: &dyn Parallel, scene: &Scene) -> Result<Self, Failure> {
        if scene.analysis.scalars {
            self.trajectory
                .begin_scalars(exchange, self.scalars_before)?;
            self.scalars_before = 0;
        }
        Ok(self)
    }

    pub fn series(
        &mut self,
        exchange: &dyn Parallel,
        step: u64,
        time: f64,
        row: &SeriesRow,
    ) -> Result<(), Failure> {
        self.trajectory.series(exchange, step, time, row)?;
        // A failure of the log is rank 0's alone: all are told at the next flush.
        self.log_state = std::mem::replace(&mut self.log_state, Ok(()))
            .and_then(|()| self.log.row(step, time, row));
        Ok(())
    }

    pub fn frame(
        &mut self,
        exchange: &dyn Parallel,
        step: u64,
        time: f64,
        grains: &[GrainSample],
        contacts: &[ContactSample],
    ) -> Result<(), Failure> {
        self.trajectory
            .frame(exchange, step, time, grains, contacts)
    }

    /// The next scalars of frames, the same on every rank.
    pub fn scalars(
        &mut self,
        exchange: &dyn Parallel,
        rows: &[(u64, FrameScalars)],
    ) -> Result<(), Failure> {
        self.trajectory.scalars(exchange, rows)
    }

    /// Everything to the files. Returns what is in them.
    pub fn flush(&mut self, exchange: &dyn Parallel) -> Result<Written, Failure> {
        self.trajectory.flush(exchange)?;
        let logged = std::mem::replace(&mut self.log_state, Ok(())).and_then(|()| self.log.flush());
        agree(exchange, logged)?;
        Ok(Written {
            frames: self.trajectory.frames(),
            rows: self.trajectory.rows(),
            scalars: self.scalars_before + self.trajectory.scalar_rows(),
        })
    }

    /// Closes the files; with the digest of the last state and the speed (grain-steps per second and rank) where the run is
    /// complete.
    pub fn finish(
        mut self,
        exchange: &dyn Parallel,
        system: &mut System<impl Dimension>,
        speed: f64,
        digest: &str,
        complete: bool,
    ) -> Result<(), Failure> {
        self.flush(exchange)?;
        let attributes = [
            ("digest", Attribute::Text(digest.into())),
            ("speed", Attribute::Number(speed)),
            ("rank_map", Attribute::Numbers(system.slabs.cuts.clone())),
        ];
        let known = if complete { &attributes[..] } else { &[] };
        self.trajectory.finish(exchange, known)
    }
}

/// What never changes of the own grains.
pub fn shapes<D: Dimension>(system: &mut System<D>) -> Vec<GrainShape> {
    let grains = system.grains();
    let shape = |g: usize| GrainShape {
        id: grains.id[g],
        body: grains.body[g],
        radius: grains.radius[g],
        mass: grains.mass[g],
    };
    (0..grains.owned).map(shape).collect()
}

/// A checkpoint in the run's folder, under the name of its step as well where it is to be kept; each contact on the rank that has
/// its first grain.
pub fn checkpoint(
    exchange: &dyn Parallel,
    out: &Path,
    scene: &str,
    snapshot: &Snapshot,
    keep: Option<u64>,
) -> Result<(), Failure> {
    folder(exchange, out)?;
    checkpoint::write(exchange, out, scene, snapshot)?;
    let kept = match (keep, exchange.rank()) {
        (Some(step), 0) => checkpoint::keep(out, step),
        _ => Ok(()),
    };
    agree(exchange, kept)
}

pub fn folder(exchange: &dyn Parallel, out: &Path) -> Result<(), Failure> {
    let made = if exchange.rank() == 0 {
        std::fs::create_dir_all(out)
            .map_err(|e| Failure::other(format!("{}: cannot be made: {e}", out.display())))
    } else {
        Ok(())
    };
    agree(exchange, made)
}

/// L_x, height and nothing; in three dimensions L_x, L_y and height (m).
fn edges<D: Dimension>(cell: Cell, height: f64) -> [f64; 3] {
    let mut edges = [0.0; 3];
    edges[..D::UP].copy_from_slice(&cell.periods[..D::UP]);
    edges[D::UP] = height;
    edges
}
