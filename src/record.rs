//! What a run leaves in its folder: `run.h5`, `log.csv`, `scene.toml`, checkpoints.

use std::path::Path;

use crate::config::Scene;
use crate::dimension::Dimension;
use crate::domain::Exchange;
use crate::failure::Failure;
use crate::io::checkpoint;
use crate::io::collective::agree;
use crate::io::h5::Attribute;
use crate::io::log::Log;
use crate::io::provenance;
use crate::io::trajectory::{GrainShape, RunHeader, TrajectoryWriter};
use crate::run::Options;
use crate::schedule::Schedule;
use crate::state::{Cell, ContactSample, GrainSample, SeriesRow, Snapshot};
use crate::system::System;

pub const RUN_FILE: &str = "run.h5";
pub const LOG_FILE: &str = "log.csv";
pub const SCENE_FILE: &str = "scene.toml";

/// The files of a run in the shear stage. Every call is collective.
pub struct Recorder {
    trajectory: TrajectoryWriter,
    log: Log,
    /// What failed of the log since the last flush.
    log_state: Result<(), Failure>,
}

impl Recorder {
    /// New files, or those of the run that is gone on with, cut back to the frames and rows `written` at its checkpoint.
    /// Where the folder holds no such run, new ones that begin there.
    pub fn open<E: Exchange, D: Dimension>(
        exchange: &E,
        scene: &Scene,
        schedule: &Schedule,
        system: &System<D>,
        options: &Options,
        written: Option<[u64; 2]>,
    ) -> Result<Self, Failure> {
        folder(exchange, &options.out)?;
        let (run, log) = (options.out.join(RUN_FILE), options.out.join(LOG_FILE));
        let there = exchange.broadcast(vec![u8::from(run.exists())])[0] == 1;
        if let (Some([frames, rows]), true) = (written, there) {
            return Ok(Self {
                trajectory: TrajectoryWriter::open_to_append(exchange, &run, frames, rows)?,
                log: Log::open_to_append(exchange, &log, rows)?,
                log_state: Ok(()),
            });
        }
        let wrote = if exchange.rank() == 0 {
            let path = options.out.join(SCENE_FILE);
            std::fs::write(&path, &scene.toml)
                .map_err(|e| Failure::other(format!("{}: cannot be written: {e}", path.display())))
        } else {
            Ok(())
        };
        agree(exchange, wrote)?;
        let grains: Vec<GrainShape> = (0..system.grains.owned)
            .map(|g| GrainShape {
                id: system.grains.id[g],
                body: system.grains.body[g],
                radius: system.grains.radius[g],
                mass: system.grains.mass[g],
            })
            .collect();
        // What is one number for a run at one speed is that of the first part of a protocol.
        let first = schedule.protocol.segment(0);
        let attributes = [
            ("scene", Attribute::Text(scene.toml.clone())),
            ("version", Attribute::Text(provenance::VERSION.into())),
            ("git_commit", Attribute::Text(provenance::GIT_COMMIT.into())),
            ("ranks", Attribute::Count(exchange.size() as u64)),
            ("processor", Attribute::Text(provenance::processor())),
            ("started", Attribute::Text(provenance::now())),
            ("time_step", Attribute::Number(schedule.step)),
            (
                "frame_strain",
                Attribute::Number(
                    first.velocity * (first.frames as f64 * schedule.step) / schedule.height,
                ),
            ),
            ("steps_per_frame", Attribute::Count(first.frames)),
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
            edges: edges::<D>(system.cell, schedule.height),
            grains: &grains,
            attributes: &attributes,
        };
        Ok(Self {
            trajectory: TrajectoryWriter::create(exchange, &run, &header)?,
            log: Log::create(exchange, &log)?,
            log_state: Ok(()),
        })
    }

    pub fn series<E: Exchange>(
        &mut self,
        exchange: &E,
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

    pub fn frame<E: Exchange>(
        &mut self,
        exchange: &E,
        step: u64,
        time: f64,
        grains: &[GrainSample],
        contacts: &[ContactSample],
    ) -> Result<(), Failure> {
        self.trajectory
            .frame(exchange, step, time, grains, contacts)
    }

    /// Everything to the files. Returns the frames and rows in them.
    pub fn flush<E: Exchange>(&mut self, exchange: &E) -> Result<[u64; 2], Failure> {
        self.trajectory.flush(exchange)?;
        let logged = std::mem::replace(&mut self.log_state, Ok(())).and_then(|()| self.log.flush());
        agree(exchange, logged)?;
        Ok([self.trajectory.frames(), self.trajectory.rows()])
    }

    /// Closes the files; with the digest of the last state and the speed (grain-steps per second and rank) where the run is
    /// complete.
    pub fn finish<E: Exchange>(
        mut self,
        exchange: &E,
        system: &System<impl Dimension>,
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

/// A checkpoint in the run's folder; each contact on the rank that has its first grain.
pub fn checkpoint<E: Exchange>(
    exchange: &E,
    out: &Path,
    scene: &str,
    snapshot: &Snapshot,
) -> Result<(), Failure> {
    folder(exchange, out)?;
    checkpoint::write(exchange, out, scene, snapshot)
}

fn folder<E: Exchange>(exchange: &E, out: &Path) -> Result<(), Failure> {
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
