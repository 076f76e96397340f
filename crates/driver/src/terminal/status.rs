//! What rank 0 tells while a run goes on: the line of progress on the terminal, and `status.json`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use gshear_dem::failure::Result;
use gshear_mpi_exchange::Parallel;
use gshear_scene::Scene;
use gshear_store::provenance;
use gshear_store::status::{self, RunState, StageProgress, Status};

use super::Terminal;
use super::progress::Pace;
use crate::cores::Cores;
use crate::options::Outcome;
use crate::run_record::RunRecord;

/// Time between two versions of `status.json`.
const INTERVAL: Duration = Duration::from_secs(1);

/// Runs that are shorter say nothing of the cores that they had.
const SHORTEST: Duration = Duration::from_secs(3);

/// How far a run has come, and the file that says so.
pub(super) struct StatusFile {
    folder: PathBuf,
    started: Instant,
    cores: Cores,
    status: Status,
    pace: Pace,
    /// When the file was written last.
    written: Option<Instant>,
}

/// On ranks other than 0, and in replays, nothing is told.
impl Terminal {
    /// Tells from now on how far the run comes, also in the folder of the run. For rank 0.
    pub fn follow(
        &mut self,
        folder: PathBuf,
        record: &RunRecord,
        scene: &Scene,
        exchange: &dyn Parallel,
    ) {
        let status = Status {
            version: status::VERSION,
            state: RunState::Running,
            message: None,
            run_id: record.id.clone(),
            title: scene.title.clone(),
            progress: StageProgress::default(),
            speed: None,
            seconds_left: None,
            seconds: 0.0,
            grains: scene.sample.grains,
            ranks: exchange.size(),
            waited_for_cores: None,
            host: provenance::host(),
            pid: std::process::id(),
            started: provenance::now(),
            updated: String::new(),
        };
        self.status = Some(StatusFile {
            folder,
            started: Instant::now(),
            cores: Cores::of(exchange.processes()),
            status,
            pace: Pace::new(&StageProgress::default()),
            written: None,
        });
    }

    /// A stage begins, or resumes.
    pub fn begin(&mut self, progress: &StageProgress) {
        if let Some(file) = &mut self.status {
            file.pace = Pace::new(progress);
        }
        self.show(progress);
        self.status.iter_mut().for_each(StatusFile::write);
    }

    /// Whether to look at the clock after this step of the stage.
    pub fn is_due(&self, step: u64) -> bool {
        let file = self.status.as_ref();
        file.is_some_and(|file| file.pace.is_due(step))
    }

    /// Tells how far the stage has come, if it is time. Returns whether the file was written.
    pub fn progress(&mut self, progress: &StageProgress) -> bool {
        if let Some(file) = &mut self.status {
            file.pace.look(progress.step);
        }
        self.show(progress);
        match &mut self.status {
            Some(file) if file.written.is_none_or(|at| at.elapsed() >= INTERVAL) => {
                file.write();
                true
            }
            _ => false,
        }
    }

    /// How far the stage has come, for the next version of the file.
    pub fn set(&mut self, progress: &StageProgress) {
        if let Some(file) = &mut self.status {
            file.set(progress);
        }
    }

    /// The run has ended.
    pub(crate) fn run_ended(&mut self, ending: &Result<Outcome>) {
        self.clear();
        // A run that never began leaves nothing behind.
        let Some(file) = self.status.as_mut().filter(|file| file.written.is_some()) else {
            return;
        };
        let (state, message) = match ending {
            Ok(Outcome::Done) => (RunState::Done, None),
            Ok(Outcome::Stopped) => (RunState::Stopped, None),
            Err(failure) => (RunState::Failed, Some(failure.to_string())),
        };
        file.status.state = state;
        file.status.message = message;
        file.status.seconds_left = None;
        file.write();
        // A start alone may wait for a core.
        let is_long = file.started.elapsed() >= SHORTEST && ending.is_ok();
        if let (Some(waited), true) = (file.status.long_wait(), is_long) {
            let advice = file.cores.advice(waited);
            self.say(format!("note: {advice}"));
        }
    }

    fn show(&mut self, progress: &StageProgress) {
        self.set(progress);
        if let Some(StatusFile { status, .. }) = &self.status {
            self.draw(progress, status.speed, status.seconds_left);
        }
    }
}

impl StatusFile {
    fn set(&mut self, progress: &StageProgress) {
        let status = &mut self.status;
        status.progress = StageProgress {
            fraction: progress.fraction(),
            ..progress.clone()
        };
        status.speed = self.pace.speed(progress);
        status.seconds_left = self.pace.left(progress);
    }

    /// Writes the file. It is for those who look on: a run goes on without it.
    fn write(&mut self) {
        self.status.seconds = self.started.elapsed().as_secs_f64();
        self.status.waited_for_cores = self.cores.waited();
        self.status.updated = provenance::now();
        self.written = Some(Instant::now());
        let _ = self.status.write(&self.folder);
    }
}
