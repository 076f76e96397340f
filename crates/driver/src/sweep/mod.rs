//! The runs of a sweep: which there are, what is left of them, and one after the other. [`jobs`]
//! runs several at the same time, [`table`] says how far they are.

mod ended;
pub mod jobs;
mod lines;
mod selection;
pub mod table;

use std::path::PathBuf;
use std::time::Instant;

use gshear_dem::failure::{Failure, Result};
use gshear_mpi_exchange::Parallel;
use gshear_scene::Source;
use gshear_scene::sweep::{Member, takes_sweep_away};
use gshear_store::status::{RunState, Status};

use crate::calibration;
use crate::estimate::{Estimate, bytes};
use crate::launch::{Task, await_lock, from_the_start, resume_if_begun};
use crate::options::{Options, Outcome, Verbosity};
use crate::preview::{check_continued, doubts};
use crate::say::{self, say_error};
use crate::terminal::progress::duration;
use crate::terminal::ranks;
use ended::Ended;
pub use selection::{ALL, Selection};

/// The runs of a configuration with a sweep.
pub struct Sweep<'a> {
    /// The configuration without its `[sweep]`.
    pub source: Source,
    /// The runs, in order.
    pub members: Vec<Member>,
    /// The overrides `--set`, for all runs.
    pub set: &'a [String],
    /// The folder that contains the folders of the runs.
    pub out: PathBuf,
}

impl<'a> Sweep<'a> {
    /// The sweep of a configuration. `set`: overrides for all runs; `out`: the folder that contains
    /// their folders.
    ///
    /// # Errors
    /// A configuration without a sweep or with an invalid one; an override of a key of the sweep.
    pub fn new(source: &Source, set: &'a [String], out: PathBuf) -> Result<Self> {
        let Some(members) = gshear_scene::sweep::members(source)? else {
            return Err(Failure::input(format!(
                "{}: has no [sweep]; leave out --sweep, or give lists of values, see docs/howto/scene.md",
                source.name()
            )));
        };
        if let Some(set) = set.iter().find(|set| takes_sweep_away(set)) {
            return Err(Failure::input(format!(
                "--set {set}: takes away the sweep whose runs --sweep asks for; leave one of them out"
            )));
        }
        let swept: Vec<&str> = members[0].set.iter().map(|set| key(set)).collect();
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

    /// Prints the chosen runs and what is done of each, and on standard error what is left to do;
    /// collective.
    ///
    /// # Errors
    /// A number without a run, a run with an invalid scene, or more ranks than it has room for.
    pub fn list(
        &self,
        exchange: &dyn Parallel,
        chosen: &Selection,
        options: &Options,
    ) -> Result<()> {
        let numbers = chosen.numbers(self.members.len())?;
        let (mut left, mut work, mut time, mut disk) = (0, 0.0, Some(0.0), 0.0);
        // The runs of a sweep are alike.
        let (mut speed, mut strain_step) = (None, None);
        let quiet = options.verbosity == Verbosity::Quiet;
        // Of each warning the first run, and the number of all.
        let mut doubted: Vec<(String, usize, usize)> = Vec::new();
        for &number in &numbers {
            let member = self.member(number);
            let task = self.task(exchange, member)?;
            let folder = self.folder(member);
            let failed =
                || Status::read(&folder).is_some_and(|status| status.state == RunState::Failed);
            let resumed = resume_if_begun(exchange, &folder, task)?;
            let state = match &resumed {
                None => "done",
                Some(_) if failed() => "failed",
                Some(task) if task.saved().is_some() => "stopped",
                Some(_) => "new",
            };
            if let (Some(task), false) = (&resumed, quiet) {
                let mut estimate = Estimate::of(exchange, task, None);
                if speed.is_none() {
                    speed = Some(calibration::speed(exchange, task, options)?);
                }
                if strain_step.is_none() && estimate.strains() {
                    strain_step = Some(calibration::strain_step(exchange, task, options)?);
                }
                estimate.speed = speed.flatten();
                estimate.strain_step = strain_step.flatten();
                for doubt in doubts(task) {
                    match doubted.iter_mut().find(|(known, ..)| *known == doubt) {
                        Some((_, _, runs)) => *runs += 1,
                        None => doubted.push((doubt, number, 1)),
                    }
                }
                left += 1;
                work += estimate.grain_steps();
                time = time.zip(estimate.time()).map(|(sum, time)| sum + time);
                disk += estimate.disk();
            }
            let line = format!("{number:>4}  {state:<8}{}", member.name);
            say::print(exchange, &line)?;
        }
        if exchange.rank() == 0 && left > 0 {
            let time = time.map_or("an unknown time".into(), duration);
            say_error(&format!(
                "left to do: {left} of {} runs, about {work:.1e} grain-steps, {time} one after the other on {}, {} of files",
                numbers.len(),
                ranks(exchange.size()),
                bytes(disk)
            ));
            for (doubt, first, runs) in doubted {
                let more = match runs {
                    1 => String::new(),
                    runs => format!(" and {} more", runs - 1),
                };
                say_error(&format!("warning: run {first}{more}: {doubt}"));
            }
        }
        Ok(())
    }

    /// Starts or resumes the chosen runs, one after the other, until one stops early; those that
    /// are done are skipped. Goes on after a run that fails by its input or its numbers.
    /// Collective.
    ///
    /// # Errors
    /// A number without a run; an invalid scene, before any run starts; as of `Ended::outcome` if
    /// runs failed; any other failure at once.
    pub fn run(
        &self,
        exchange: &dyn Parallel,
        chosen: &Selection,
        options: &Options,
    ) -> Result<Outcome> {
        let numbers = chosen.numbers(self.members.len())?;
        if let [number] = numbers[..] {
            return self.one(exchange, number, options);
        }
        let begun = Instant::now();
        // Finds invalid scenes before the first run starts.
        for &number in &numbers {
            self.task(exchange, self.member(number))?;
        }
        let mut ended = Ended::default();
        for number in numbers {
            let options = Options {
                wall_time: options.wall_time_after(begun.elapsed()),
                ..options.clone()
            };
            let name = &self.member(number).name;
            match self.one(exchange, number, &options) {
                Ok(Outcome::Done) => ended.add(name, Ok(Outcome::Done)),
                Err(failure @ (Failure::Numbers(_) | Failure::Input(_))) => {
                    say(exchange, &format!("sweep: {name} failed: {failure}"));
                    ended.add(name, Err(failure));
                }
                other => return other,
            }
        }
        ended.outcome()
    }

    /// Starts or resumes a run, unless it is done; collective.
    fn one(&self, exchange: &dyn Parallel, number: usize, options: &Options) -> Result<Outcome> {
        let member = self.member(number);
        let task = self.task(exchange, member)?;
        let mut options = self.options_of(member, options);
        await_lock(exchange, &mut options);
        let resumed = if options.overwrite {
            Some(task)
        } else {
            resume_if_begun(exchange, &options.out, task)?
        };
        let Some(task) = resumed else {
            say(exchange, &format!("sweep: {} is done", member.name));
            return Ok(Outcome::Done);
        };
        let all = self.members.len();
        let line = format!("sweep: run {number} of {all}, {}", member.name);
        say(exchange, &line);
        task.run(exchange, &options)
    }

    /// Prints the scene of a run and what is left to do of it, of several runs a list of them;
    /// collective.
    ///
    /// # Errors
    /// A number without a run, an invalid scene, or more ranks than it has room for.
    pub fn check(
        &self,
        exchange: &dyn Parallel,
        chosen: &Selection,
        options: &Options,
    ) -> Result<()> {
        let [number] = chosen.numbers(self.members.len())?[..] else {
            return self.list(exchange, chosen, options);
        };
        let member = self.member(number);
        let options = self.options_of(member, options);
        check_continued(exchange, || self.task(exchange, member), &options)
    }

    /// The first of some runs, from the start; collective.
    ///
    /// # Errors
    /// A number without a run; an invalid scene.
    pub fn first(&self, exchange: &dyn Parallel, chosen: &Selection) -> Result<Task> {
        let numbers = chosen.numbers(self.members.len())?;
        self.task(exchange, self.member(numbers[0]))
    }

    /// The run of a number that there is, from 1 on.
    fn member(&self, number: usize) -> &Member {
        &self.members[number - 1]
    }

    /// A run from the start.
    fn task(&self, exchange: &dyn Parallel, member: &Member) -> Result<Task> {
        let set: Vec<String> = member.set.iter().chain(self.set).cloned().collect();
        let task = from_the_start(exchange, &self.source, &set);
        task.map_err(|failure| member.place(failure))
    }

    fn options_of(&self, member: &Member, options: &Options) -> Options {
        Options {
            out: self.folder(member),
            ..options.clone()
        }
    }

    fn folder(&self, member: &Member) -> PathBuf {
        self.out.join(&member.name)
    }
}

/// The key of an override.
fn key(set: &str) -> &str {
    set.split('=').next().unwrap_or_default().trim()
}

fn say(exchange: &dyn Parallel, line: &str) {
    if exchange.rank() == 0 {
        say::say(line);
    }
}
