//! What a run in a box leaves in its folder: `aqs.h5` and `newtonian.h5` (H5MD), `spectra.csv`, `scene.toml`, checkpoints.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::newtonian::Moved;
use super::observe::Observed;
use super::spectrum::Eigenvalues;
use super::strain::Row;
use super::{Header, Moving, Progress};
use crate::config::PeriodicScene;
use crate::contact::ContactLaw;
use crate::dimension::Dimension;
use crate::domain::Exchange;
use crate::failure::Failure;
use crate::io::collective::agree;
use crate::io::h5::Attribute;
use crate::io::provenance;
use crate::io::table::{Cell, TableFile};
use crate::io::trajectory::{RunHeader, TrajectoryWriter};
use crate::kernel::ContactForces;
use crate::observe::{digest, frame};
use crate::record::{self, SCENE_FILE, shapes};
use crate::state::{Snapshot, Travel};
use crate::system::System;

pub const AQS_FILE: &str = "aqs.h5";
pub const NEWTONIAN_FILE: &str = "newtonian.h5";
/// Eigenvalues in time: a row each.
pub const SPECTRA_FILE: &str = "spectra.csv";
const SPECTRA_COLUMNS: [&str; 4] = ["time", "real", "imaginary", "verdict"];

/// Columns of the time series of the strain steps; what was not asked for is not a number.
pub const AQS_COLUMNS: [&str; 18] = [
    "strain",
    "image_offset",
    "shear_stress",
    "pressure",
    "elastic_energy",
    "contacts",
    "coordination",
    "sliding_fraction",
    "residual",
    "factorisations",
    "overdamped_steps",
    "fell_back",
    "pairs",
    "imaginary_least",
    "imaginary_greatest",
    "pair_real",
    "least_real",
    "zero_modes",
];

/// Columns of the time series of Newton's equations.
pub const NEWTONIAN_COLUMNS: [&str; 7] = [
    "msd",
    "kinetic_energy",
    "elastic_energy",
    "shear_stress",
    "pressure",
    "contacts",
    "sliding_fraction",
];

/// Checkpoints are written at least so often (s).
const CHECKPOINTS: f64 = 60.0;

/// The files of the strain steps.
pub(super) struct Recorder {
    frame_every: u64,
    trajectory: TrajectoryWriter,
    pub saves: Saves,
}

/// The checkpoints of a folder.
pub(super) struct Saves {
    folder: PathBuf,
    toml: String,
    last: Instant,
}

impl Saves {
    fn new(folder: &Path, scene: &PeriodicScene) -> Self {
        Self {
            folder: folder.into(),
            toml: scene.toml.clone(),
            last: Instant::now(),
        }
    }

    /// Collective: the ranks' clocks differ, and all must do the same.
    pub fn due(&self, exchange: &impl Exchange) -> bool {
        exchange.maximum(self.last.elapsed().as_secs_f64()) > CHECKPOINTS
    }

    fn write<C: ContactLaw, E: Exchange>(
        &mut self,
        exchange: &E,
        system: &System<C::Space>,
        header: &Header,
        travels: Option<Vec<Travel>>,
    ) -> Result<(), Failure> {
        self.last = Instant::now();
        let snapshot = Snapshot {
            header: serde_json::to_string(header).expect("a header of finite numbers"),
            grains: system.grain_states(),
            contacts: system.own_contact_states::<C>(),
            analysed: None,
            travels,
        };
        record::checkpoint(exchange, &self.folder, &self.toml, &snapshot, None)
    }
}

fn attributes<D: Dimension>(
    exchange: &impl Exchange,
    scene: &PeriodicScene,
    system: &System<D>,
) -> Vec<(&'static str, Attribute)> {
    vec![
        ("scene", Attribute::Text(scene.toml.clone())),
        ("version", Attribute::Text(provenance::VERSION.into())),
        ("git_commit", Attribute::Text(provenance::GIT_COMMIT.into())),
        ("ranks", Attribute::Count(exchange.size() as u64)),
        ("processor", Attribute::Text(provenance::processor())),
        ("started", Attribute::Text(provenance::now())),
        ("time_step", Attribute::Number(system.step)),
        ("dimension", Attribute::Count(D::AXES as u64)),
        (
            "mean_diameter",
            Attribute::Number(scene.sample.mean_diameter),
        ),
    ]
}

fn writer<D: Dimension>(
    exchange: &impl Exchange,
    path: &Path,
    series: &[&str],
    system: &System<D>,
    attributes: &[(&str, Attribute)],
) -> Result<TrajectoryWriter, Failure> {
    let mut edges = [0.0; 3];
    edges[..D::UP].copy_from_slice(&system.cell.periods[..D::UP]);
    edges[D::UP] = system.cell.sheared.map_or(0.0, |s| s.height);
    let header = RunHeader {
        axes: D::AXES,
        walls: false,
        series,
        edges,
        grains: &shapes(system),
        attributes,
    };
    TrajectoryWriter::create(exchange, path, &header)
}

impl Recorder {
    /// New files, or those of the run that is gone on with.
    pub fn open<D: Dimension>(
        exchange: &impl Exchange,
        scene: &PeriodicScene,
        system: &System<D>,
        folder: &Path,
        header: &Option<Header>,
    ) -> Result<Self, Failure> {
        record::folder(exchange, folder)?;
        let path = folder.join(AQS_FILE);
        let there = exchange.broadcast(vec![u8::from(path.exists())])[0] == 1;
        let trajectory = match header {
            Some(header) if there => TrajectoryWriter::open_to_append(
                exchange,
                &path,
                &AQS_COLUMNS,
                header.frames,
                header.rows,
            )?,
            _ => {
                let wrote = match exchange.rank() {
                    0 => {
                        let path = folder.join(SCENE_FILE);
                        std::fs::write(&path, &scene.toml).map_err(|e| unwritten(&path, e))
                    }
                    _ => Ok(()),
                };
                agree(exchange, wrote)?;
                let attributes = attributes(exchange, scene, system);
                writer(exchange, &path, &AQS_COLUMNS, system, &attributes)?
            }
        };
        Ok(Self {
            frame_every: scene.aqs.frame_every,
            trajectory,
            saves: Saves::new(folder, scene),
        })
    }

    pub fn strain_row(
        &mut self,
        exchange: &impl Exchange,
        step: u64,
        row: &Row,
    ) -> Result<(), Failure> {
        let nan = f64::NAN;
        let of = |value: fn(&Eigenvalues) -> f64| row.eigenvalues.as_ref().map_or(nan, value);
        let imaginary = of(|e| e.greatest_pair().map_or(0.0, |pair| pair.lambda_i));
        let observed = &row.observed;
        let columns: [f64; AQS_COLUMNS.len()] = [
            row.strain,
            row.offset,
            observed.shear_stress,
            observed.pressure,
            observed.elastic_energy,
            observed.contacts as f64,
            observed.coordination,
            observed.sliding_fraction,
            row.residual,
            row.found.factorisations as f64,
            row.found.steps as f64,
            f64::from(u8::from(row.found.fell_back)),
            of(|e| e.pairs() as f64),
            -imaginary,
            imaginary,
            of(|e| e.greatest_pair().map_or(f64::NAN, |pair| pair.lambda_r)),
            of(Eigenvalues::least_real),
            of(|e| e.zeros() as f64),
        ];
        self.trajectory.series(exchange, step, row.strain, &columns)
    }

    pub fn frame_due(&self, step: u64) -> bool {
        self.frame_every > 0 && step.is_multiple_of(self.frame_every)
    }

    pub fn strain_frame<C: ContactLaw, E: Exchange>(
        &mut self,
        exchange: &E,
        system: &System<C::Space>,
        samples: &ContactForces,
        step: u64,
    ) -> Result<(), Failure> {
        let (grains, contacts) = frame::<C>(system, samples);
        self.trajectory
            .frame(exchange, step, step as f64, &grains, &contacts)
    }

    pub fn flush(&mut self, exchange: &impl Exchange) -> Result<[u64; 2], Failure> {
        self.trajectory.flush(exchange)?;
        Ok([self.trajectory.frames(), self.trajectory.rows()])
    }

    pub fn checkpoint<C: ContactLaw, E: Exchange>(
        &mut self,
        exchange: &E,
        system: &System<C::Space>,
        progress: Progress,
        [frames, rows]: [u64; 2],
    ) -> Result<(), Failure> {
        let header = Header {
            progress,
            frames,
            rows,
            newtonian: None,
        };
        self.saves.write::<C, E>(exchange, system, &header, None)
    }

    /// Closes the file of the strain steps. Returns the digest of the state.
    pub fn finish<C: ContactLaw, E: Exchange>(
        self,
        exchange: &E,
        system: &System<C::Space>,
        progress: &Progress,
    ) -> Result<String, Failure> {
        let offset = progress.offset.to_le_bytes();
        let digest = digest::<C, E>(exchange, system, &offset, progress.steps);
        let mut attributes = vec![
            ("digest", Attribute::Text(digest.clone())),
            ("fell_back", Attribute::Count(progress.fell_back)),
        ];
        if let Some(birth) = &progress.birth {
            attributes.push(("birth_before", Attribute::Number(birth.before)));
            attributes.push(("birth_after", Attribute::Number(birth.after)));
        }
        self.trajectory.finish(exchange, &attributes)?;
        Ok(digest)
    }
}

/// The files of Newton's equations.
pub(super) struct NewtonianRecorder {
    trajectory: TrajectoryWriter,
    /// On rank 0, where eigenvalues are asked for.
    spectra: Option<TableFile>,
    /// Of the eigenvalues' file, that of the names not counted.
    lines: u64,
    pub saves: Saves,
}

impl NewtonianRecorder {
    /// New files, or those of the run that is gone on with.
    pub fn open<D: Dimension>(
        exchange: &impl Exchange,
        scene: &PeriodicScene,
        system: &System<D>,
        folder: &Path,
        header: &Header,
    ) -> Result<Self, Failure> {
        let progress = &header.progress;
        let mut attributes = attributes(exchange, scene, system);
        let strain = scene.aqs.strain_step * progress.steps as f64;
        attributes.push(("strain", Attribute::Number(strain)));
        attributes.push(("image_offset", Attribute::Number(progress.offset)));
        if let Some(pair) = &progress.pair {
            attributes.push(("lambda_r", Attribute::Number(pair.lambda_r)));
            attributes.push(("lambda_i", Attribute::Number(pair.lambda_i)));
            attributes.push(("omega_r", Attribute::Number(pair.omega_r)));
            attributes.push(("omega_i", Attribute::Number(pair.omega_i)));
        }
        let path = folder.join(NEWTONIAN_FILE);
        let trajectory = match &header.newtonian {
            Some(moving) => TrajectoryWriter::open_to_append(
                exchange,
                &path,
                &NEWTONIAN_COLUMNS,
                moving.frames,
                moving.rows,
            )?,
            None => writer(exchange, &path, &NEWTONIAN_COLUMNS, system, &attributes)?,
        };
        let lines = header.newtonian.map_or(0, |moving| moving.lines);
        let path = folder.join(SPECTRA_FILE);
        let asked = scene.newtonian.is_some_and(|n| n.spectra > 0) && exchange.rank() == 0;
        let opened = match (asked, header.newtonian) {
            (false, _) => Ok(None),
            (true, None) => TableFile::create(&path, &SPECTRA_COLUMNS).map(Some),
            (true, Some(_)) => TableFile::open_to_append(&path, &SPECTRA_COLUMNS, lines).map(Some),
        };
        let spectra = agree(exchange, opened)?;
        Ok(Self {
            trajectory,
            spectra,
            lines,
            saves: Saves::new(folder, scene),
        })
    }

    pub fn row(
        &mut self,
        exchange: &impl Exchange,
        step: u64,
        time: f64,
        observed: &Observed,
        moved: &Moved,
    ) -> Result<(), Failure> {
        let columns: [f64; NEWTONIAN_COLUMNS.len()] = [
            moved.msd,
            moved.kinetic_energy,
            observed.elastic_energy,
            observed.shear_stress,
            observed.pressure,
            observed.contacts as f64,
            observed.sliding_fraction,
        ];
        self.trajectory.series(exchange, step, time, &columns)
    }

    pub fn frame<C: ContactLaw, E: Exchange>(
        &mut self,
        exchange: &E,
        system: &System<C::Space>,
        samples: &ContactForces,
        step: u64,
        time: f64,
    ) -> Result<(), Failure> {
        let (grains, contacts) = frame::<C>(system, samples);
        self.trajectory
            .frame(exchange, step, time, &grains, &contacts)
    }

    /// All eigenvalues at a time; as rank 0 alone writes them, its failure is told to all.
    pub fn spectrum(
        &mut self,
        exchange: &impl Exchange,
        time: f64,
        eigenvalues: &Eigenvalues,
    ) -> Result<(), Failure> {
        self.lines += eigenvalues.all().count() as u64;
        let wrote = match &mut self.spectra {
            None => Ok(()),
            Some(file) => eigenvalues.all().try_for_each(|(value, verdict)| {
                file.row([&time as &dyn Cell, &value.re, &value.im, &verdict.name()])
            }),
        };
        agree(exchange, wrote)
    }

    pub fn checkpoint<C: ContactLaw, E: Exchange>(
        &mut self,
        exchange: &E,
        system: &System<C::Space>,
        header: &Header,
        steps: u64,
        travels: Vec<Travel>,
    ) -> Result<(), Failure> {
        self.trajectory.flush(exchange)?;
        let wrote = self.spectra.as_mut().map_or(Ok(()), TableFile::flush);
        agree(exchange, wrote)?;
        let moving = Moving {
            steps,
            frames: self.trajectory.frames(),
            rows: self.trajectory.rows(),
            lines: self.lines,
        };
        let header = Header {
            newtonian: Some(moving),
            ..header.clone()
        };
        self.saves
            .write::<C, E>(exchange, system, &header, Some(travels))
    }

    /// Closes the file. Returns the digest of the state.
    pub fn finish<C: ContactLaw, E: Exchange>(
        self,
        exchange: &E,
        system: &System<C::Space>,
        steps: u64,
    ) -> Result<String, Failure> {
        let offset = system.cell.sheared.map_or(0.0, |s| s.offset).to_le_bytes();
        let digest = digest::<C, E>(exchange, system, &offset, steps);
        let attributes = [("digest", Attribute::Text(digest.clone()))];
        self.trajectory.finish(exchange, &attributes)?;
        Ok(digest)
    }
}

fn unwritten(path: &Path, why: std::io::Error) -> Failure {
    Failure::other(format!("{}: cannot be written: {why}", path.display()))
}
