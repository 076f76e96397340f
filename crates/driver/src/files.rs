//! The files of a stage in the run's folder: frames and time series, `log.csv`, `scene.toml`.

use gshear_dem::columns::Column;
use gshear_dem::dimension::Dimension;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::FramePart;
use gshear_mpi_exchange::Parallel;
use gshear_scene::schedule::ReplayWindow;
use gshear_store::collective::{agree, exists, on_root, told_by_root};
use gshear_store::disk::unwritten;
use gshear_store::file_names::{LOG_FILE, RUN_FILE, SCENE_FILE, SPECTRA_FILE};
use gshear_store::h5::Attribute;
use gshear_store::log::{Log, LogColumns};
use gshear_store::text_writer;
use gshear_store::trajectory::{FrameFormat, GrainShape, RunHeader, TrajectoryWriter};
use gshear_store::{dictionary, existing, part, provenance};

use crate::folder::Watched;
use crate::frame_analysis::FrameAnalysis;
use crate::header::{UpToCheckpoint, Written};
use crate::options::Outcome;
use crate::output_schedule::DueOutput;
use crate::run::Run;
use crate::stages::assembly::Assembly;
use crate::stages::eigenvalues::Eigenvalues;
use crate::stages::spectra_file::SpectraFile;

/// The files of a stage. Every call is collective.
pub(crate) struct Files {
    /// Frames, time series and scalars.
    trajectory: TrajectoryWriter,
    log: Option<Log>,
    /// The file of eigenvalues, if the stage writes one.
    spectra: Option<SpectraFile>,
    /// Frames that wait for their scalars, if scalars are computed.
    analysis: Option<FrameAnalysis>,
    /// The first failure of the log since the last flush.
    log_state: Result<()>,
    /// Rows of scalars that an earlier part of the run wrote, if none are computed now.
    scalars_before: u64,
    /// The open files of rank 0.
    watched: Vec<Watched>,
}

/// The content of the files of a stage.
pub(crate) struct Format<'a> {
    /// The part of the file of frames and time series.
    pub name: &'a str,
    /// Columns of the time series.
    pub columns: &'a [Column],
    /// The places among them of those of the log.
    pub log_columns: &'a [usize],
    /// Attributes in addition to those of every run.
    pub attributes: Vec<(&'static str, Attribute)>,
    /// Height between the walls, or of the cell (m), of a shear, which has a `log.csv`; `None` of
    /// strain steps and Newton's equations of a box.
    pub height: Option<f64>,
    /// The last analysed frame of the checkpoint, after which scalars go on.
    pub analysed: Option<FramePart>,
    /// Of a stage that writes eigenvalues: the time (s) up to which those of a resumed run stay.
    pub spectra: Option<f64>,
}

/// A step, and its time (s), or strain of strain steps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TimePoint {
    /// Completed steps.
    pub step: u64,
    /// Its time.
    pub time: f64,
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
        let columns = LogColumns {
            series: self.columns,
            places: self.log_columns,
        };
        let log = match last {
            Some(last) => Log::open_to_append(exchange, &path, columns, last, rows)?,
            None => {
                on_root(exchange, || {
                    let names = columns.names();
                    let axes = run.scene.dimension.axes();
                    dictionary::write_metadata_with(LOG_FILE, &path, &names, self.columns, axes)
                })?;
                Log::create(exchange, &path, columns)?
            }
        };
        Ok(Some(log))
    }

    /// Creates the file of eigenvalues of a stage that writes them, or truncates the one of a
    /// resumed run; collective.
    fn open_spectra(&self, run: &Run<'_>, before: UpToCheckpoint) -> Result<Option<SpectraFile>> {
        let Some(time) = self.spectra else {
            return Ok(None);
        };
        let path = run.options.out.join(SPECTRA_FILE);
        // In another folder than the checkpoint's the file begins anew.
        let goes_on = exists(run.exchange, &path)? && before.last.is_some();
        let last = goes_on.then_some(time);
        Ok(Some(SpectraFile::open(run.exchange, &path, last)?))
    }

    /// The open files that must stay where they are; none on other ranks than 0.
    fn watched(&self, run: &Run<'_>) -> Vec<Watched> {
        let mut names = Vec::new();
        if run.exchange.rank() == 0 {
            names.push(RUN_FILE);
            if self.height.is_some() {
                names.push(LOG_FILE);
            }
        }
        let paths = names.iter().map(|name| run.options.out.join(name));
        paths.map(Watched::new).collect()
    }
}

/// Removes the files of an earlier run from the folder, or makes that of a replay; collective.
fn prepare_folder(run: &Run<'_>) -> Result<()> {
    let (exchange, out) = (run.exchange, &run.options.out);
    match &run.folder {
        Some(owned) => owned.clear(exchange),
        // That of a replay.
        None => on_root(exchange, || {
            std::fs::create_dir_all(out)
                .map_err(|e| Failure::other(format!("{}: cannot be made: {e}", out.display())))
        }),
    }
}

impl Files {
    /// Opens the files of a resumed run and truncates them to its checkpoint. Creates new files if
    /// there are none, or nothing was written; the log is kept up to the checkpoint all the same.
    /// A replay always creates its files.
    ///
    /// # Errors
    /// Files that cannot be created, or belong to another run.
    pub(crate) fn open<D: Dimension>(
        run: &Run<'_>,
        assembly: &mut Assembly<'_, D>,
        format: Format<'_>,
        checkpoint: UpToCheckpoint,
    ) -> Result<Self> {
        let exchange = run.exchange;
        let before = match run.options.replay {
            Some(_) => UpToCheckpoint::new(0),
            None => checkpoint,
        };
        prepare_folder(run)?;
        let path = run.options.out.join(format.name);
        let is_there = told_by_root(exchange, || Ok(part::exists(&path)))?;
        let resumed = if is_there { before.last } else { None };
        let mut scalars_before = 0;
        let (mut trajectory, log);
        if let Some(last) = resumed {
            // Counted by steps: a file that was begun anew at a later step holds fewer frames and
            // rows than the checkpoint says.
            let [frames, rows, scalars] =
                told_by_root(exchange, || existing::up_to(&path, format.columns, last))?;
            scalars_before = scalars;
            // The log first: if it does not fit, the other file is left as it is.
            log = format.open_log(run, Some(last), rows)?;
            trajectory =
                TrajectoryWriter::open_to_append(exchange, &path, format.columns, frames, rows)?;
            trajectory.attributes(exchange, &resumed_attributes(run))?;
            write_scene(run)?;
        } else {
            let has_log = exists(exchange, &run.options.out.join(LOG_FILE))?;
            trajectory = create(run, assembly, &format, before)?;
            // Rows of before a lost run.h5 stay.
            log = format.open_log(run, if has_log { before.last } else { None }, 0)?;
        }
        let watched = format.watched(run);
        let spectra = format.open_spectra(run, before)?;
        let computes_scalars = run
            .scene
            .shear()
            .is_some_and(|shear| shear.analysis.scalars);
        let mut analysis = None;
        if computes_scalars {
            trajectory.begin_scalars(exchange, scalars_before)?;
            scalars_before = 0;
            // The first row of new scalars is of a frame without a frame before it.
            let analysed = if resumed.is_some() {
                format.analysed
            } else {
                None
            };
            analysis = Some(FrameAnalysis::new(exchange, &mut assembly.system, analysed));
        }
        Ok(Self {
            trajectory,
            log,
            spectra,
            analysis,
            log_state: Ok(()),
            scalars_before,
            watched,
        })
    }

    /// Writes a row to the time series and to the log.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn row(
        &mut self,
        exchange: &dyn Parallel,
        at: TimePoint,
        row: &impl AsRef<[f64]>,
    ) -> Result<()> {
        self.trajectory.series(exchange, at.step, at.time, row)?;
        // Only rank 0 knows of a failure of the log; the next flush tells all ranks.
        if let (Some(log), Ok(())) = (&mut self.log, &self.log_state) {
            self.log_state = log.row(at.step, at.time, row.as_ref());
        }
        Ok(())
    }

    /// Writes a frame of the last measurement and computes its scalars, as far as these are due.
    /// `height` (m): between the walls; 0 of a cell without walls.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn frame<D: Dimension>(
        &mut self,
        assembly: &mut Assembly<'_, D>,
        due: DueOutput,
        at: TimePoint,
        height: f64,
    ) -> Result<()> {
        if !due.takes_frame() {
            return Ok(());
        }
        let exchange = assembly.exchange;
        let (grains, contacts) = assembly.frame();
        if due.frame {
            let edges = assembly.system.cell.edges::<D>(height);
            let clock = (at.step, at.time);
            self.trajectory
                .frame(exchange, clock, &edges, &grains, &contacts)?;
        }
        if due.scalars
            && let Some(analysis) = &mut self.analysis
        {
            let rows = analysis.frame(exchange, at.step, &grains, &contacts);
            self.trajectory.scalars(exchange, &rows)?;
        }
        Ok(())
    }

    /// Writes the eigenvalues of a state at this time.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn spectrum(
        &mut self,
        exchange: &dyn Parallel,
        time: f64,
        eigenvalues: &Eigenvalues,
    ) -> Result<()> {
        match &mut self.spectra {
            Some(spectra) => spectra.write(exchange, time, eigenvalues),
            None => Ok(()),
        }
    }

    /// Passes the rows of the time series to those who watch a run whose rows come slowly.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn publish_rows(&mut self, exchange: &dyn Parallel) -> Result<()> {
        self.trajectory.publish_rows(exchange)
    }

    /// Passes the rows of the log to the file system, for those who watch the run. Not collective.
    pub(crate) fn publish(&mut self) {
        if let (Some(log), Ok(())) = (&mut self.log, &self.log_state) {
            self.log_state = log.flush();
        }
    }

    /// Passes the scalars of the frames that wait to the file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn write_scalars(&mut self, exchange: &dyn Parallel) -> Result<()> {
        let Some(analysis) = &mut self.analysis else {
            return Ok(());
        };
        let rows = analysis.flush(exchange);
        self.trajectory.scalars(exchange, &rows)
    }

    /// The last analysed frame.
    ///
    /// # Panics
    /// If frames wait for their scalars.
    pub(crate) fn last_analysed(&self) -> Option<FramePart> {
        self.analysis
            .as_ref()
            .and_then(FrameAnalysis::last)
            .cloned()
    }

    /// The number of frames and rows so far, buffered ones included.
    pub(crate) fn written(&self) -> Written {
        Written {
            frames: self.trajectory.frames(),
            rows: self.trajectory.rows(),
            scalars: self.scalars_before + self.trajectory.scalar_rows(),
        }
    }

    /// The number of lines in the file of eigenvalues.
    pub(crate) fn spectra_lines(&self) -> u64 {
        self.spectra.as_ref().map_or(0, SpectraFile::rows)
    }

    /// Writes everything to disk.
    ///
    /// # Errors
    /// A file that cannot be written, or was removed during the run.
    pub(crate) fn flush(&mut self, exchange: &dyn Parallel) -> Result<()> {
        self.write_scalars(exchange)?;
        let there = self.watched.iter().try_for_each(Watched::verify);
        agree(exchange, there)?;
        self.trajectory.flush(exchange)?;
        let log = self.log.as_mut();
        let logged = std::mem::replace(&mut self.log_state, Ok(()))
            .and_then(|()| log.map_or(Ok(()), Log::sync));
        agree(exchange, logged)?;
        match &mut self.spectra {
            Some(spectra) => spectra.flush(exchange),
            None => Ok(()),
        }
    }

    /// Closes the files; `attributes` are those of a stage that is done.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(crate) fn finish(
        mut self,
        exchange: &dyn Parallel,
        outcome: Outcome,
        attributes: &[(&str, Attribute)],
    ) -> Result<()> {
        self.flush(exchange)?;
        let known = match outcome {
            Outcome::Done => attributes,
            Outcome::Stopped => &[],
        };
        self.trajectory.finish(exchange, known)
    }

    /// The files and the outcome of a stage that has not failed. Closes those of a stage that has,
    /// with what led to numbers that failed; after any other failure they are left as they are.
    ///
    /// # Errors
    /// The failure of the stage.
    pub(crate) fn unless_failed(
        self,
        exchange: &dyn Parallel,
        outcome: Result<Outcome>,
    ) -> Result<(Self, Outcome)> {
        match outcome {
            Ok(outcome) => Ok((self, outcome)),
            Err(Failure::Numbers(what)) => {
                let closed = self.finish(exchange, Outcome::Stopped, &[]);
                Err(Failure::Numbers(match closed {
                    Ok(()) => what,
                    Err(lost) => format!("{what}; and what led to it is lost: {lost}"),
                }))
            }
            Err(failure) => Err(failure),
        }
    }
}

/// Writes `scene.toml`, and creates the file of frames and time series.
fn create<D: Dimension>(
    run: &Run<'_>,
    assembly: &mut Assembly<'_, D>,
    format: &Format<'_>,
    before: UpToCheckpoint,
) -> Result<TrajectoryWriter> {
    let (exchange, scene) = (run.exchange, run.scene);
    let (system, layout) = (&mut assembly.system, assembly.law.layout());
    write_scene(run)?;
    let mut attributes = resumed_attributes(run);
    if before.step > 0 {
        attributes.push(("begun_at_step", Attribute::Count(before.step)));
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
    edges[D::UP] = match format.height {
        Some(height) => height,
        None => cell.sheared.map_or(0.0, |sheared| sheared.height),
    };
    let author = scene.author.as_deref();
    let user = match (exchange.rank(), author) {
        (0, None) => provenance::user(),
        _ => String::new(),
    };
    let histories = scene.writes_histories() || run.options.replay.is_some();
    let header = RunHeader {
        author: author.unwrap_or(&user),
        history_unit: layout.history_unit,
        form: FrameFormat {
            removed: scene.removes(),
            walls: scene.flat_walls().is_some(),
            histories,
            ages: histories && layout.has_age(),
            ..FrameFormat::new(D::AXES, layout.has_torques)
        },
        boundary: scene.boundary(),
        units: scene.shear().is_some(),
        series: format.columns,
        edges,
        grains: &GrainShape::owned(system),
        ids: scene.packing().map(|file| &file.ids),
        attributes: &attributes,
    };
    TrajectoryWriter::create(exchange, &run.options.out.join(format.name), &header)
}
