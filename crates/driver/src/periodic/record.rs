//! What a run in a box leaves in its folder: `aqs.h5` and `newtonian.h5` (H5MD), `spectra.csv`, `scene.toml`, checkpoints.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use super::newtonian::Moved;
use super::observe::Observed;
use super::spectrum::Eigenvalues;
use super::strain::Row;
use super::{Header, Moving, Progress};
use gshear_scene::PeriodicScene;
use gshear_dem::kernel::PairForce;
use gshear_dem::dimension::Dimension;
use gshear_mpi_exchange::Parallel;
use gshear_dem::failure::Failure;
use gshear_store::collective::agree;
use gshear_store::h5::Attribute;
use gshear_dem::columns::Column;
use gshear_store::columns::{
    AQS_COLUMNS, AQS_FILE, AqsRow, NEWTONIAN_COLUMNS, NEWTONIAN_FILE, NewtonianRow, SPECTRA_FILE,
};
use gshear_store::provenance;
use gshear_store::trajectory::{RunHeader, TrajectoryWriter};
use gshear_dem::kernel::ContactForces;
use gshear_dem::observe::{digest, frame};
use crate::record::{self, SCENE_FILE, shapes};
use gshear_dem::state::{Snapshot, Travel};
use gshear_dem::system::System;

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
    pub fn due(&self, exchange: &dyn Parallel) -> bool {
        exchange.maximum(self.last.elapsed().as_secs_f64()) > CHECKPOINTS
    }

    fn write<D: Dimension>(
        &mut self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        header: &Header,
        travels: Option<Vec<Travel>>,
    ) -> Result<(), Failure> {
        self.last = Instant::now();
        let snapshot = Snapshot {
            header: serde_json::to_string(header).expect("a header of finite numbers"),
            grains: system.grain_states(),
            contacts: system.own_contact_states(law),
            analysed: None,
            travels,
        };
        record::checkpoint(exchange, &self.folder, &self.toml, &snapshot, None)
    }
}

fn attributes<D: Dimension>(
    exchange: &dyn Parallel,
    scene: &PeriodicScene,
    system: &mut System<D>,
) -> Vec<(&'static str, Attribute)> {
    vec![
        ("scene", Attribute::Text(scene.toml.clone())),
        ("version", Attribute::Text(provenance::VERSION.into())),
        ("git_commit", Attribute::Text(provenance::git_commit().into())),
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
    exchange: &dyn Parallel,
    path: &Path,
    series: &[Column],
    system: &mut System<D>,
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
        exchange: &dyn Parallel,
        scene: &PeriodicScene,
        system: &mut System<D>,
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
        exchange: &dyn Parallel,
        step: u64,
        row: &Row,
    ) -> Result<(), Failure> {
        let nan = f64::NAN;
        let of = |value: fn(&Eigenvalues) -> f64| row.eigenvalues.as_ref().map_or(nan, value);
        let imaginary = of(|e| e.greatest_pair().map_or(0.0, |pair| pair.lambda_i));
        let observed = &row.observed;
        let columns = AqsRow {
            strain: row.strain,
            image_offset: row.offset,
            shear_stress: observed.shear_stress,
            pressure: observed.pressure,
            elastic_energy: observed.elastic_energy,
            contacts: observed.contacts as f64,
            coordination: observed.coordination,
            sliding_fraction: observed.sliding_fraction,
            residual: row.residual,
            factorisations: row.found.factorisations as f64,
            overdamped_steps: row.found.steps as f64,
            fell_back: f64::from(u8::from(row.found.fell_back)),
            pairs: of(|e| e.pairs() as f64),
            imaginary_least: -imaginary,
            imaginary_greatest: imaginary,
            pair_real: of(|e| e.greatest_pair().map_or(f64::NAN, |pair| pair.lambda_r)),
            least_real: of(Eigenvalues::least_real),
            zero_modes: of(|e| e.zeros() as f64),
        };
        self.trajectory.series(exchange, step, row.strain, &columns)
    }

    pub fn frame_due(&self, step: u64) -> bool {
        self.frame_every > 0 && step.is_multiple_of(self.frame_every)
    }

    pub fn strain_frame<D: Dimension>(
        &mut self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        samples: &ContactForces,
        step: u64,
    ) -> Result<(), Failure> {
        let (grains, contacts) = frame(system, law, samples);
        self.trajectory
            .frame(exchange, step, step as f64, &grains, &contacts)
    }

    pub fn flush(&mut self, exchange: &dyn Parallel) -> Result<[u64; 2], Failure> {
        self.trajectory.flush(exchange)?;
        Ok([self.trajectory.frames(), self.trajectory.rows()])
    }

    pub fn checkpoint<D: Dimension>(
        &mut self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        progress: Progress,
        [frames, rows]: [u64; 2],
    ) -> Result<(), Failure> {
        let header = Header {
            progress,
            frames,
            rows,
            newtonian: None,
        };
        self.saves.write(exchange, system, law, &header, None)
    }

    /// Closes the file of the strain steps. Returns the digest of the state.
    pub fn finish<D: Dimension>(
        self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        progress: &Progress,
    ) -> Result<String, Failure> {
        let offset = progress.offset.to_le_bytes();
        let digest = digest(exchange, system, law, &offset, progress.steps);
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
    spectra: Option<BufWriter<File>>,
    path: PathBuf,
    /// Of the eigenvalues' file, that of the names not counted.
    lines: u64,
    pub saves: Saves,
}

impl NewtonianRecorder {
    /// New files, or those of the run that is gone on with.
    pub fn open<D: Dimension>(
        exchange: &dyn Parallel,
        scene: &PeriodicScene,
        system: &mut System<D>,
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
            (true, None) => File::create(&path)
                .map(BufWriter::new)
                .and_then(|mut file| {
                    writeln!(file, "time,real,imaginary,verdict")?;
                    Ok(Some(file))
                }),
            (true, Some(_)) => cut(&path, lines).map(Some),
        };
        let spectra = agree(exchange, opened.map_err(|e| unwritten(&path, e)))?;
        Ok(Self {
            trajectory,
            spectra,
            path,
            lines,
            saves: Saves::new(folder, scene),
        })
    }

    pub fn row(
        &mut self,
        exchange: &dyn Parallel,
        step: u64,
        time: f64,
        observed: &Observed,
        moved: &Moved,
    ) -> Result<(), Failure> {
        let columns = NewtonianRow {
            msd: moved.msd,
            kinetic_energy: moved.kinetic_energy,
            elastic_energy: observed.elastic_energy,
            shear_stress: observed.shear_stress,
            pressure: observed.pressure,
            contacts: observed.contacts as f64,
            sliding_fraction: observed.sliding_fraction,
        };
        self.trajectory.series(exchange, step, time, &columns)
    }

    pub fn frame<D: Dimension>(
        &mut self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        samples: &ContactForces,
        step: u64,
        time: f64,
    ) -> Result<(), Failure> {
        let (grains, contacts) = frame(system, law, samples);
        self.trajectory
            .frame(exchange, step, time, &grains, &contacts)
    }

    /// All eigenvalues at a time; as rank 0 alone writes them, its failure is told to all.
    pub fn spectrum(
        &mut self,
        exchange: &dyn Parallel,
        time: f64,
        eigenvalues: &Eigenvalues,
    ) -> Result<(), Failure> {
        self.lines += eigenvalues.all().count() as u64;
        let wrote = match &mut self.spectra {
            None => Ok(()),
            Some(file) => eigenvalues.all().try_for_each(|(value, verdict)| {
                writeln!(
                    file,
                    "{time:?},{:?},{:?},{}",
                    value.re,
                    value.im,
                    verdict.name()
                )
            }),
        };
        agree(exchange, wrote.map_err(|e| unwritten(&self.path, e)))
    }

    pub fn checkpoint<D: Dimension>(
        &mut self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        header: &Header,
        steps: u64,
        travels: Vec<Travel>,
    ) -> Result<(), Failure> {
        self.trajectory.flush(exchange)?;
        let wrote = self.spectra.as_mut().map_or(Ok(()), BufWriter::flush);
        agree(exchange, wrote.map_err(|e| unwritten(&self.path, e)))?;
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
            .write(exchange, system, law, &header, Some(travels))
    }

    /// Closes the file. Returns the digest of the state.
    pub fn finish<D: Dimension>(
        self,
        exchange: &dyn Parallel,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        steps: u64,
    ) -> Result<String, Failure> {
        let offset = system.cell.sheared.map_or(0.0, |s| s.offset).to_le_bytes();
        let digest = digest(exchange, system, law, &offset, steps);
        let attributes = [("digest", Attribute::Text(digest.clone()))];
        self.trajectory.finish(exchange, &attributes)?;
        Ok(digest)
    }
}

/// A file of lines to go on after its names and so many lines more; what is behind them is cut off.
fn cut(path: &Path, lines: u64) -> std::io::Result<BufWriter<File>> {
    let mut file = OpenOptions::new().read(true).write(true).open(path)?;
    let mut reader = BufReader::new(&file);
    let mut length = 0;
    for _ in 0..=lines {
        match reader.skip_until(b'\n')? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            bytes => length += bytes as u64,
        }
    }
    file.set_len(length)?;
    file.seek(SeekFrom::Start(length))?;
    Ok(BufWriter::new(file))
}

fn unwritten(path: &Path, why: std::io::Error) -> Failure {
    Failure::other(format!("{}: cannot be written: {why}", path.display()))
}
