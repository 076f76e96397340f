//! From a configuration to runs: what a run begins with, and the runs of a sweep one by one.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use gshear_scene::sweep::Member;
use gshear_scene::{Origin, PeriodicScene, Scene, Source, Study};
use gshear_mpi_exchange::Parallel;
use gshear_dem::failure::Failure;
use gshear_store::checkpoint;
use gshear_store::collective::agree;
use gshear_store::run_reader;
use gshear_scene::packing::Packing;
use crate::periodic::{self, PeriodicRun};
use gshear_store::columns::{AQS_FILE, NEWTONIAN_FILE};
use crate::record::RUN_FILE;
use crate::run::{Ending, Header, Options, Run, Start};
use gshear_dem::state::Snapshot;

/// What is to be run, and what it begins with.
pub enum Task {
    PlaneShear(Box<Scene>, Start),
    /// From a checkpoint, or from insertion.
    Periodic(Box<PeriodicScene>, Option<Snapshot>),
}

impl Task {
    /// The whole configuration as TOML.
    pub fn toml(&self) -> &str {
        match self {
            Task::PlaneShear(scene, _) => &scene.toml,
            Task::Periodic(scene, _) => &scene.toml,
        }
    }

    /// To the end. Collective.
    pub fn run(self, exchange: &dyn Parallel, options: &Options) -> Result<Ending, Failure> {
        match self {
            Task::PlaneShear(scene, start) => Run::new(exchange, &scene, options)?.run(start),
            Task::Periodic(scene, from) => PeriodicRun::new(exchange, &scene, options)?.run(from),
        }
    }

    /// The file of its folder that has a digest when all is done.
    fn last_file(&self) -> &'static str {
        match self {
            Task::PlaneShear(..) => RUN_FILE,
            Task::Periodic(scene, _) if scene.newtonian.is_some() => NEWTONIAN_FILE,
            Task::Periodic(..) => AQS_FILE,
        }
    }
}

/// The scene and, where it has a packing, its grains: rank 0 reads them, the others are told what the scene must know. Collective.
pub fn from_the_start(
    exchange: &dyn Parallel,
    source: &Source,
    set: &[String],
) -> Result<Task, Failure> {
    let mut packing = None;
    let study = gshear_scene::study(source, set, &mut |path, copies| {
        let read = match exchange.rank() {
            0 => Packing::read(path, copies).map(Some),
            _ => Ok(None),
        };
        packing = agree(exchange, read)?;
        let file = packing.as_ref().map(|packing| &packing.file);
        let text = exchange.broadcast(serde_json::to_vec(&file).expect("a file of finite numbers"));
        Ok(serde_json::from_slice(&text).expect("what rank 0 wrote"))
    })?;
    let scene = match study {
        Study::PlaneShear(scene) => scene,
        Study::Periodic(scene) => return Ok(Task::Periodic(Box::new(scene), None)),
    };
    let start = match scene.origin {
        Origin::Insertion(_) => Start::Insertion,
        Origin::Packing { .. } => Start::Packing(agree(
            exchange,
            packing.map_or(Ok(Vec::new()), |p| p.grains(&scene)),
        )?),
    };
    Ok(Task::PlaneShear(Box::new(scene), start))
}

/// The scene of a checkpoint, and its state to go on from. Collective.
pub fn from_checkpoint(
    exchange: &dyn Parallel,
    path: &Path,
    set: &[String],
) -> Result<Task, Failure> {
    let (toml, snapshot) = checkpoint::read(exchange, path)?;
    if periodic::Header::read(&snapshot).is_some() {
        let scene = periodic::scene_of_checkpoint(path, toml, set)?;
        return Ok(Task::Periodic(Box::new(scene), Some(snapshot)));
    }
    let scene = Header::read(&snapshot)?.scene(path, toml, set)?;
    let start = Start::Checkpoint(snapshot);
    Ok(Task::PlaneShear(Box::new(scene), start))
}

/// The runs of a configuration with a sweep.
pub struct Sweep<'a> {
    pub source: Source,
    pub members: Vec<Member>,
    /// `--set`, of all runs.
    pub set: &'a [String],
    /// The folder with those of the runs.
    pub out: PathBuf,
}

/// How far a run of a sweep has come.
#[derive(Debug, Clone, PartialEq)]
enum Progress {
    New,
    /// With this checkpoint.
    Stopped(PathBuf),
    Done,
}

impl<'a> Sweep<'a> {
    /// Errors: a configuration without a sweep, or with a wrong one; a `--set` of a key of the sweep.
    pub fn new(source: &Source, set: &'a [String], out: PathBuf) -> Result<Self, Failure> {
        let Some(members) = gshear_scene::sweep::members(source)? else {
            return Err(Failure::input(format!(
                "{}: has no [sweep]; leave out --sweep, or give lists of values, see docs/config.md",
                source.name()
            )));
        };
        let key = |set: &str| set.split('=').next().unwrap_or_default().trim().to_string();
        let swept: Vec<String> = members[0].set.iter().map(|set| key(set)).collect();
        if let Some(set) = set.iter().find(|set| swept.contains(&key(set))) {
            return Err(Failure::input(format!(
                "--set {set}: {} is a key of the sweep; leave it out of one of the two",
                key(set)
            )));
        }
        Ok(Sweep {
            source: source.of_member(),
            members,
            set,
            out,
        })
    }

    /// Says what the runs are, by rank 0. Errors: a scene of one of them that will not do. Collective.
    pub fn list(&self, exchange: &dyn Parallel) -> Result<(), Failure> {
        for (k, member) in self.members.iter().enumerate() {
            let task = from_the_start(exchange, &self.source, &self.values(member))?;
            let state = match self.progress(exchange, member, &task)? {
                Progress::New => "new",
                Progress::Stopped(_) => "stopped",
                Progress::Done => "done",
            };
            say(
                exchange,
                &format!("{:>4}  {state:<8}{}", k + 1, member.name),
            );
        }
        Ok(())
    }

    /// One of the runs, from 1: from its start or its checkpoint, if it is not done. Collective.
    pub fn one(
        &self,
        exchange: &dyn Parallel,
        number: usize,
        options: &Options,
    ) -> Result<Ending, Failure> {
        let member = number.checked_sub(1).and_then(|k| self.members.get(k));
        let Some(member) = member else {
            return Err(Failure::input(format!(
                "--sweep {number}: there are the runs 1 to {}",
                self.members.len()
            )));
        };
        let task = from_the_start(exchange, &self.source, &self.values(member))?;
        let task = match self.progress(exchange, member, &task)? {
            Progress::Done => {
                say(exchange, &format!("sweep: {} is done", member.name));
                return Ok(Ending::Done);
            }
            Progress::Stopped(path) => from_checkpoint(exchange, &path, &[])?,
            Progress::New => task,
        };
        let all = self.members.len();
        say(
            exchange,
            &format!("sweep: run {number} of {all}, {}", member.name),
        );
        let options = Options {
            out: self.out.join(&member.name),
            ..options.clone()
        };
        task.run(exchange, &options)
    }

    /// All of the runs, one after the other, until one is stopped. One whose numbers fail is told, and the others are run all
    /// the same. Collective.
    pub fn all(&self, exchange: &dyn Parallel, options: &Options) -> Result<Ending, Failure> {
        let begun = Instant::now();
        // Scenes that will not do are told before hours have passed.
        for member in &self.members {
            from_the_start(exchange, &self.source, &self.values(member))?;
        }
        let mut failed = Vec::new();
        for (k, member) in self.members.iter().enumerate() {
            let left = |time: Duration| time.saturating_sub(begun.elapsed());
            let options = Options {
                wall_time: options.wall_time.map(left),
                ..options.clone()
            };
            match self.one(exchange, k + 1, &options) {
                Ok(Ending::Done) => {}
                Err(Failure::Numbers(what)) => {
                    say(exchange, &format!("sweep: {} failed: {what}", member.name));
                    failed.push(format!("{}: {what}", member.name));
                }
                other => return other,
            }
        }
        match failed.first() {
            None => Ok(Ending::Done),
            Some(first) => Err(Failure::numbers(format!(
                "{} of {} runs of the sweep failed, first {first}",
                failed.len(),
                self.members.len()
            ))),
        }
    }

    /// The values of a run, those of `--set` among them.
    pub fn values(&self, member: &Member) -> Vec<String> {
        member.set.iter().chain(self.set).cloned().collect()
    }

    /// What is in the run's folder. Errors: a run of another scene. Collective.
    fn progress(
        &self,
        exchange: &dyn Parallel,
        member: &Member,
        task: &Task,
    ) -> Result<Progress, Failure> {
        let folder = self.out.join(&member.name);
        let [run, newest] = [task.last_file(), checkpoint::NAME].map(|name| folder.join(name));
        let there = [u8::from(run.exists()), u8::from(newest.exists())];
        let there = exchange.broadcast(there.to_vec());
        let same = |toml: &str| match toml == task.toml() {
            true => Ok(()),
            false => Err(Failure::input(format!(
                "{}: holds a run of another scene (its scene.toml is not what --check prints now); give another --out",
                folder.display()
            ))),
        };
        if there[0] == 1 {
            let read = match exchange.rank() {
                0 => run_reader::scene_of_finished(&run)
                    .map(|scene| scene.map_or_else(Vec::new, String::into_bytes)),
                _ => Ok(Vec::new()),
            };
            let toml = exchange.broadcast(agree(exchange, read)?);
            if !toml.is_empty() {
                same(&String::from_utf8_lossy(&toml))?;
                return Ok(Progress::Done);
            }
        }
        if there[1] == 0 {
            return Ok(Progress::New);
        }
        same(&checkpoint::read(exchange, &newest)?.0)?;
        Ok(Progress::Stopped(newest))
    }
}

fn say(exchange: &dyn Parallel, line: &str) {
    if exchange.rank() == 0 {
        println!("{line}");
    }
}
