//! The files of a stage in the run's folder: frames and time series, `log.csv`, `scene.toml`.

use gshear_dem::columns::Column;
use gshear_dem::dimension::Dimension;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::Confinement;
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::ReplayWindow;
use gshear_store::collective::{agree, exists, on_root, told_by_root};
use gshear_store::disk::unwritten;
use gshear_store::file_names::{LOG_FILE, RUN_FILE, SCENE_FILE};
use gshear_store::h5::Attribute;
use gshear_store::log::Log;
use gshear_store::text_writer;
use gshear_store::trajectory::{Form, GrainShape, RunHeader, TrajectoryWriter};
use gshear_store::{dictionary, existing, part, provenance};

use crate::folder::Watched;
use crate::header::{UpToCheckpoint, Written};
use crate::run::Run;
use crate::stages::assembly::Assembly;

/// The files of a stage. Every call is collective.
pub struct Files {
    /// Frames, time series and scalars.
    pub trajectory: TrajectoryWriter,
    log: Option<Log>,
    /// The first failure of the log since the last flush.
    log_state: Result<()>,
    /// Rows of scalars that an earlier part of the run wrote, if none are computed now.
    scalars_before: u64,
    /// Whether the files of a resumed run were opened.
    pub resumed: bool,
    /// The open files of rank 0.
    watched: Vec<Watched>,
}

/// The content of the files of a stage.
pub struct Format<'a> {
    /// The part of the file of frames and time series.
    pub name: &'a str,
    /// Columns of the time series.
    pub columns: &'a [Column],
    /// Attributes in addition to those of every run.
    pub attributes: Vec<(&'static str, Attribute)>,
    /// Height between the walls, or of the cell (m), of a shear, which has a `log.csv`; `None` of
    /// strain steps and Newton's equations of a box.
    pub height: Option<f64>,
}

/// The attributes that a resume writes again: what is really run, and by whom.
fn resumed_attributes(run: &Run<'_>) -> Vec<(&'static str, Attribute)> {
    let mut attributes = run.record.attributes();
    attributes.push(("scene", Attribute::Text(run.scene.toml.clone())));
    if let Some(ReplayWindow { first, last, .. }) = run.options.replay {
        let window = format!("steps {first} to {last}");
        attributes.push(("replay", Attribute::Text(window)));
    }
    attributes
}

/// Writes `scene.toml`; collective.
fn write_scene(run: &Run<'_>) -> Result<()> {
    on_root(run.exchange, || {
        let path = run.options.out.join(SCENE_FILE);
        text_writer::replace(&path, run.record.comments() + &run.scene.toml)
            .map_err(|e| unwritten(&path, &e))
    })
}

impl Format<'_> {
    /// Creates the log, or opens it to continue after the step `last` and at least so many `rows`;
    /// collective.
    fn open_log(&self, run: &Run<'_>, last: Option<u64>, rows: u64) -> Result<Option<Log>> {
        if self.height.is_none() {
            return Ok(None);
        }
        let (exchange, path) = (run.exchange, run.options.out.join(LOG_FILE));
        let log = match last {
            Some(last) => Log::open_to_append(exchange, &path, self.columns, last, rows)?,
            None => {
                on_root(exchange, || {
                    let names = Log::names(self.columns);
                    let axes = run.scene.dimension.axes();
                    dictionary::write_metadata(LOG_FILE, &path, &names, axes)
                })?;
                Log::create(exchange, &path, self.columns)?
            }
        };
        Ok(Some(log))
    }
}

impl Files {
    /// Opens the files of a resumed run and truncates them to its checkpoint. Creates new files if
    /// there are none, or nothing was written; the log is kept up to the checkpoint all the same.
    ///
    /// # Errors
    /// Files that cannot be created, or belong to another run.
    pub(crate) fn open<D: Dimension>(
        run: &Run<'_>,
        assembly: &mut Assembly<'_, D>,
        format: &Format<'_>,
        before: Option<UpToCheckpoint>,
    ) -> Result<Self> {
        let (exchange, out) = (run.exchange, &run.options.out);
        match &run.folder {
            Some(owned) => owned.clear(exchange)?,
            // That of a replay.
            None => on_root(exchange, || {
                let made = std::fs::create_dir_all(out);
                made.map_err(|e| Failure::other(format!("{}: cannot be made: {e}", out.display())))
            })?,
        }
        let path = out.join(format.name);
        let is_there = told_by_root(exchange, || Ok(part::exists(&path)))?;
        let resumed = before.and_then(|before| before.last).filter(|_| is_there);
        let (mut trajectory, log, mut scalars_before) = match resumed {
            Some(last) => {
                // Counted by steps: a file that was begun anew at a later step holds fewer frames
                // and rows than the checkpoint says.
                let counts = || existing::up_to(&path, format.columns, last);
                let [frames, rows, scalars] = told_by_root(exchange, counts)?;
                // The log first: if it does not fit, the other file is left as it is.
                let log = format.open_log(run, Some(last), rows)?;
                let (series, path) = (format.columns, &path);
                let mut trajectory =
                    TrajectoryWriter::open_to_append(exchange, path, series, frames, rows)?;
                trajectory.attributes(exchange, &resumed_attributes(run))?;
                write_scene(run)?;
                (trajectory, log, scalars)
            }
            None => {
                let log_there = exists(exchange, &out.join(LOG_FILE))?;
                let trajectory = create(run, assembly, format, before)?;
                // Rows of before a lost run.h5 stay.
                let last = before.filter(|_| log_there).and_then(|before| before.last);
                let log = format.open_log(run, last, 0)?;
                (trajectory, log, 0)
            }
        };
        let open = [Some(RUN_FILE), format.height.map(|_| LOG_FILE)];
        let open = open.into_iter().flatten().filter(|_| exchange.rank() == 0);
        let open = open.map(|name| out.join(name));
        if (run.scene.boundary.walls()).is_some_and(|of| of.analysis.scalars) {
            trajectory.begin_scalars(exchange, std::mem::take(&mut scalars_before))?;
        }
        Ok(Self {
            trajectory,
            log,
            log_state: Ok(()),
            scalars_before,
            resumed: resumed.is_some(),
            watched: open.map(Watched::new).collect(),
        })
    }

    /// Writes a row to the log.
    pub fn log(&mut self, step: u64, time: f64, row: &[f64]) {
        // Only rank 0 knows of a failure of the log; the next flush tells all ranks.
        if let (Some(log), Ok(())) = (&mut self.log, &self.log_state) {
            self.log_state = log.row(step, time, row);
        }
    }

    /// Passes the rows of the log to the file system, for those who watch the run. Not collective.
    pub fn publish(&mut self) {
        if let (Some(log), Ok(())) = (&mut self.log, &self.log_state) {
            self.log_state = log.flush();
        }
    }

    /// The number of frames and rows so far, buffered ones included.
    pub fn written(&self) -> Written {
        Written {
            frames: self.trajectory.frames(),
            rows: self.trajectory.rows(),
            scalars: self.scalars_before + self.trajectory.scalar_rows(),
        }
    }

    /// Writes everything to disk.
    ///
    /// # Errors
    /// A file that cannot be written, or was removed during the run.
    pub fn flush(&mut self, exchange: &dyn Parallel) -> Result<()> {
        let there = self.watched.iter().try_for_each(Watched::verify);
        agree(exchange, there)?;
        self.trajectory.flush(exchange)?;
        let log = self.log.as_mut();
        let logged = std::mem::replace(&mut self.log_state, Ok(()))
            .and_then(|()| log.map_or(Ok(()), Log::sync));
        agree(exchange, logged)
    }

    /// Closes the files; `attributes` are those of a stage that is done.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(
        mut self,
        exchange: &dyn Parallel,
        attributes: &[(&str, Attribute)],
    ) -> Result<()> {
        self.flush(exchange)?;
        self.trajectory.finish(exchange, attributes)
    }

    /// Closes the files of a stage that has failed, with what led to numbers that failed. After any
    /// other failure they are left as they are. Returns the failure.
    pub fn fail(self, exchange: &dyn Parallel, failure: Failure) -> Failure {
        let Failure::Numbers(what) = failure else {
            return failure;
        };
        Failure::Numbers(match self.finish(exchange, &[]) {
            Ok(()) => what,
            Err(lost) => format!("{what}; and what led to it is lost: {lost}"),
        })
    }
}

/// Writes `scene.toml`, and creates the file of frames and time series.
fn create<D: Dimension>(
    run: &Run<'_>,
    assembly: &mut Assembly<'_, D>,
    format: &Format<'_>,
    before: Option<UpToCheckpoint>,
) -> Result<TrajectoryWriter> {
    let (exchange, scene) = (run.exchange, run.scene);
    let (system, layout) = (&mut assembly.system, assembly.law.layout());
    write_scene(run)?;
    let mut attributes = resumed_attributes(run);
    if let Some(UpToCheckpoint { step, .. }) = before.filter(|before| before.step > 0) {
        attributes.push(("begun_at_step", Attribute::Count(step)));
    }
    attributes.extend([
        ("version", provenance::VERSION.into()),
        ("git_commit", provenance::git_commit().into()),
        ("ranks", (exchange.size() as u64).into()),
        ("processor", provenance::processor().into()),
        ("started", provenance::now().into()),
        ("time_step", system.step.into()),
        ("dimension", (D::AXES as u64).into()),
    ]);
    attributes.extend(format.attributes.iter().cloned());
    // L_x, height, 0; in three dimensions L_x, L_y, height.
    let mut edges = [0.0; 3];
    // Strain steps may change the cell before a stop and after it.
    let is_strained = format.height.is_none() && format.name == RUN_FILE;
    let cell = if is_strained {
        scene.cell()
    } else {
        system.cell
    };
    edges[..D::UP].copy_from_slice(&cell.periods[..D::UP]);
    let of_box = || cell.sheared.map_or(0.0, |sheared| sheared.height);
    edges[D::UP] = format.height.unwrap_or_else(of_box);
    let author = scene.author.as_deref();
    let user = match (exchange.rank(), author) {
        (0, None) => provenance::user(),
        _ => String::new(),
    };
    let plane_shear = scene.boundary.walls();
    let header = RunHeader {
        author: author.unwrap_or(&user),
        history_unit: layout.history_unit,
        form: Form::new(D::AXES, layout.has_torques),
        walls: plane_shear.is_some_and(|of| of.confinement != Confinement::Images),
        units: plane_shear.is_some(),
        series: format.columns,
        edges,
        grains: &GrainShape::owned(system),
        ids: scene.packing().map(|file| &file.ids),
        attributes: &attributes,
    };
    TrajectoryWriter::create(exchange, &run.options.out.join(format.name), &header)
}
