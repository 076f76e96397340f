//! What rank 0 reports while a run goes on: the line of progress on the terminal, and `status.json`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use gshear_dem::failure::Failure;
use gshear_scene::Scene;
use gshear_store::provenance;
use gshear_store::status::{self, RunState, Standing, Status};

use crate::options::Outcome;
use crate::progress::Pace;
use crate::record::RunRecord;
use crate::terminal::Terminal;

/// Time between two versions of `status.json`.
const INTERVAL: Duration = Duration::from_secs(1);

/// Reports how far the run has come. On ranks other than 0, and in replays, it does nothing.
#[derive(Debug, Default)]
pub struct Reporter {
    of_root: Option<OfRoot>,
}

#[derive(Debug)]
struct OfRoot {
    folder: PathBuf,
    started: Instant,
    status: Status,
    pace: Pace,
    /// When the file was written last.
    written: Option<Instant>,
}

impl Reporter {
    /// The reporter of rank 0, for the folder of a run.
    pub fn new(folder: PathBuf, record: &RunRecord, scene: &Scene, ranks: usize) -> Self {
        let status = Status {
            version: status::VERSION,
            state: RunState::Running,
            message: None,
            run_id: record.id.clone(),
            title: scene.title.clone(),
            standing: Standing::default(),
            speed: None,
            seconds_left: None,
            seconds: 0.0,
            grains: scene.sample.grains,
            ranks,
            host: provenance::host(),
            pid: std::process::id(),
            started: provenance::now(),
            updated: String::new(),
        };
        Self {
            of_root: Some(OfRoot {
                folder,
                started: Instant::now(),
                status,
                pace: Pace::new(&Standing::default()),
                written: None,
            }),
        }
    }

    /// A stage begins, or resumes.
    pub fn begin(&mut self, terminal: &Terminal, standing: Standing) {
        if let Some(root) = &mut self.of_root {
            root.pace = Pace::new(&standing);
            root.show(terminal, &standing);
            root.write();
        }
    }

    /// Whether to look at the clock after this step of the stage.
    pub fn is_due(&self, step: u64) -> bool {
        let root = self.of_root.as_ref();
        root.is_some_and(|root| root.pace.is_due(step))
    }

    /// Reports, if it is time. Returns whether the file was written.
    pub fn report(&mut self, terminal: &Terminal, standing: Standing) -> bool {
        let Some(root) = &mut self.of_root else {
            return false;
        };
        root.pace.look(standing.step);
        root.show(terminal, &standing);
        let due = root.written.is_none_or(|at| at.elapsed() >= INTERVAL);
        if due {
            root.write();
        }
        due
    }

    /// A stage has ended here.
    pub fn come_to(&mut self, standing: Standing) {
        if let Some(root) = &mut self.of_root {
            root.set(&standing);
        }
    }

    /// The run has ended.
    pub fn end(&mut self, ending: &Result<Outcome, Failure>) {
        let Some(root) = &mut self.of_root else {
            return;
        };
        let (state, message) = match ending {
            Ok(Outcome::Done) => (RunState::Done, None),
            Ok(Outcome::Stopped) => (RunState::Stopped, None),
            Err(failure) => (RunState::Failed, Some(failure.to_string())),
        };
        // A run that never began leaves nothing behind.
        if root.written.is_some() {
            root.status.state = state;
            root.status.message = message;
            root.status.seconds_left = None;
            root.write();
        }
    }
}

impl OfRoot {
    fn set(&mut self, standing: &Standing) {
        let status = &mut self.status;
        status.standing = Standing {
            fraction: standing.fraction(),
            ..standing.clone()
        };
        status.speed = self.pace.speed(standing);
        status.seconds_left = self.pace.left(standing);
    }

    fn show(&mut self, terminal: &Terminal, standing: &Standing) {
        self.set(standing);
        terminal.draw(standing, self.status.speed, self.status.seconds_left);
    }

    /// Writes the file. It is for those who look on: a run goes on without it.
    fn write(&mut self) {
        self.status.seconds = self.started.elapsed().as_secs_f64();
        self.status.updated = provenance::now();
        self.written = Some(Instant::now());
        let _ = self.status.write(&self.folder);
    }
}
