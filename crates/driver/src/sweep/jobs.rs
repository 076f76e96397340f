//! Several runs of a sweep at the same time, each in a process of its own that MPI's launcher
//! starts: MPI begins once in a process, and the failure of a run must not end the others.
//!
//! This process runs without MPI. It starts a run when another one has ended, passes a request to
//! stop on to all of them, and says how they ended. A run leaves its files as one that was started
//! by hand does; which runs are done is read from them.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use gshear_dem::domain::Solo;
use gshear_dem::failure::{Failure, Result, STOPPED_EARLY};

use super::ended::Ended;
use super::lines::{Lines, RunLine};
use super::{Selection, Sweep};
use crate::estimate::cores;
use crate::options::{Options, Outcome, Verbosity};
use crate::signals::Signals;
use crate::stored_run::{Ends, StoredRun};
use crate::terminal::progress::duration;
use crate::terminal::ranks;

/// Runs at the same time.
#[derive(Debug, Clone)]
pub struct Jobs {
    /// The most runs at a time.
    pub at_a_time: usize,
    /// Ranks of each run.
    pub ranks: usize,
    /// What names the configuration and its overrides on a command line of the program.
    pub arguments: Vec<OsString>,
}

/// Time between two looks at the processes of runs.
const LOOK: Duration = Duration::from_millis(50);
/// Time between two looks at how far they are.
const DRAW: Duration = Duration::from_millis(500);
/// Time after which a run is asked to stop once more: a launcher that starts may miss a signal.
const ASK_AGAIN: Duration = Duration::from_secs(1);
/// For so long the output of a run that has ended is waited for.
const LAST_WORDS: Duration = Duration::from_secs(2);
/// The launcher of MPI.
const LAUNCHER: &str = "MPIRUN";

/// Settings of Open MPI, which other MPIs ignore, unless the environment has others: ranks of two
/// runs do not share the first cores; hardware threads count as cores; an exit code is not
/// explained.
const OPEN_MPI: [(&str, &str); 3] = [
    ("OMPI_MCA_hwloc_base_binding_policy", "none"),
    ("OMPI_MCA_rmaps_base_oversubscribe", "1"),
    ("OMPI_MCA_orte_execute_quiet", "1"),
];

/// Starts or resumes the chosen runs of a sweep, several at a time; those that are done are
/// skipped. Goes on after a run that fails. After a signal or at the end of the wall time, all runs
/// stop at checkpoints.
///
/// # Errors
/// A number without a run; an invalid scene, before any run starts; a launcher that cannot be
/// started; as of `Ended::outcome` if runs failed.
pub fn run(
    sweep: &Sweep<'_>,
    chosen: &Selection,
    jobs: &Jobs,
    options: &Options,
) -> Result<Outcome> {
    let mut waiting = VecDeque::new();
    let mut ended = Ended::default();
    let lines = Lines::new(options.verbosity);
    for number in chosen.numbers(sweep.members.len())? {
        let member = sweep.member(number);
        let task = sweep.task(&Solo, member)?;
        let stored = StoredRun::read(&sweep.folder(member))?;
        let is_this = stored.require(&task, Ends::Movable).is_ok();
        if !options.overwrite && is_this && stored.is_finished(&task) {
            lines.say(&format!("sweep: {} is done", member.name));
            ended.add(&member.name, Ok(Outcome::Done));
        } else {
            waiting.push_back(number);
        }
    }
    let (sender, receiver) = channel();
    let mut pool = Pool {
        sweep,
        jobs,
        options,
        lines,
        begun: Instant::now(),
        at_a_time: 1,
        waiting,
        running: Vec::new(),
        ended,
        sender,
    };
    pool.fit_cores();
    pool.run(&receiver)
}

/// The runs that go on and those that wait.
struct Pool<'a> {
    sweep: &'a Sweep<'a>,
    jobs: &'a Jobs,
    options: &'a Options,
    lines: Lines,
    begun: Instant,
    /// The most runs at a time.
    at_a_time: usize,
    /// The numbers of runs that have not begun.
    waiting: VecDeque<usize>,
    running: Vec<Running>,
    ended: Ended,
    sender: Sender<Said>,
}

/// A run that goes on.
struct Running {
    number: usize,
    folder: PathBuf,
    child: Child,
    begun: Instant,
    line: RunLine,
    /// How its process ended, and when.
    status: Option<(ExitStatus, Instant)>,
    /// Whether standard output and standard error are still open.
    open: usize,
    digest: Option<String>,
    error: Option<String>,
}

/// What a run says.
struct Said {
    number: usize,
    stream: Stream,
    /// `None` at the end of the stream.
    line: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stream {
    Output,
    Error,
}

impl Pool<'_> {
    /// Lowers the number of runs at a time to those for which there are cores.
    fn fit_cores(&mut self) {
        let (wanted, threads) = (self.jobs.at_a_time, self.options.threads);
        let each = self.jobs.ranks * threads;
        self.at_a_time = wanted.min((cores() / each).max(1));
        if self.at_a_time < wanted.min(self.waiting.len()) {
            let of_threads = match threads {
                1 => String::new(),
                _ => format!(" of {threads} threads"),
            };
            self.lines.say_error(&format!(
                "note: {} at a time instead of {wanted}: each takes {}{of_threads}, and there are {} cores",
                self.at_a_time,
                ranks(self.jobs.ranks),
                cores()
            ));
        }
    }

    fn run(mut self, receiver: &Receiver<Said>) -> Result<Outcome> {
        let signals = Signals::catch()?;
        let mut asked: Option<Instant> = None;
        let mut drawn: Option<Instant> = None;
        loop {
            if signals.received() && asked.is_none_or(|at| at.elapsed() >= ASK_AGAIN) {
                if asked.is_none() {
                    self.lines
                        .say("sweep: asks its runs to stop at checkpoints");
                }
                asked = Some(Instant::now());
                self.ask_to_stop();
            }
            let is_time = (self.time_left()).is_some_and(|time| time.is_zero());
            if asked.is_none() && !is_time {
                self.launch()?;
            }
            match receiver.recv_timeout(LOOK) {
                Ok(said) => {
                    self.hear(said);
                    receiver.try_iter().for_each(|said| self.hear(said));
                }
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
            self.reap(asked.is_some());
            if drawn.is_none_or(|at| at.elapsed() >= DRAW) {
                drawn = Some(Instant::now());
                self.draw();
            }
            let begins_more = !self.waiting.is_empty() && asked.is_none() && !is_time;
            if self.running.is_empty() && !begins_more {
                break;
            }
        }
        self.ended.stopped += self.waiting.len();
        self.lines.clear();
        let time = duration(self.begun.elapsed().as_secs_f64());
        self.lines
            .say(&format!("sweep: {} in {time}", self.ended.text()));
        self.ended.outcome()
    }

    fn time_left(&self) -> Option<Duration> {
        self.options.wall_time_after(self.begun.elapsed())
    }

    /// Starts runs while there is room for more.
    fn launch(&mut self) -> Result<()> {
        while self.running.len() < self.at_a_time
            && let Some(number) = self.waiting.pop_front()
        {
            let name = &self.sweep.member(number).name;
            let all = self.sweep.members.len();
            let mut command = self.command(number);
            match command.spawn() {
                Ok(child) => {
                    self.lines
                        .say(&format!("sweep: run {number} of {all}, {name}"));
                    let running = self.follow(number, child);
                    self.running.push(running);
                }
                Err(why) => {
                    let program = command.get_program().display();
                    let failure = Failure::input(format!(
                        "{program}: cannot be started: {why}; give the launcher of MPI as {LAUNCHER}, such as {LAUNCHER}=mpiexec, or leave out --ranks"
                    ));
                    if self.running.is_empty() && self.ended.failed.is_empty() {
                        return Err(failure);
                    }
                    self.ended.add(name, Err(failure));
                }
            }
        }
        Ok(())
    }

    /// The command of a run.
    fn command(&self, number: usize) -> Command {
        let program = std::env::current_exe()
            .unwrap_or_else(|_| std::env::args_os().next().unwrap_or_default().into());
        let mut command = if self.jobs.ranks == 1 {
            Command::new(program)
        } else {
            let words = launcher(&program);
            let mut command = Command::new(&words[0]);
            command.args(&words[1..]);
            command.arg("-n").arg(self.jobs.ranks.to_string());
            command.arg(program);
            command
        };
        let options = self.options;
        command.args(&self.jobs.arguments);
        command.arg("--sweep").arg(number.to_string());
        command.arg("--out").arg(&self.sweep.out);
        command.arg("--threads").arg(options.threads.to_string());
        if let Some(time) = self.time_left() {
            command.arg("--walltime");
            command.arg(format!("{}ms", time.as_millis().max(1)));
        }
        for (given, flag) in [
            (options.overwrite, "--overwrite"),
            (options.break_lock, "--break-lock"),
            (options.verbosity == Verbosity::Verbose, "--verbose"),
        ] {
            if given {
                command.arg(flag);
            }
        }
        let unset = OPEN_MPI
            .iter()
            .filter(|(name, _)| std::env::var_os(name).is_none());
        command.envs(unset.copied());
        command.stdin(Stdio::null());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C is for this process: launchers would end their ranks within a second.
        command.process_group(0);
        command
    }

    /// Reads what a run says.
    fn follow(&self, number: usize, mut child: Child) -> Running {
        let output = child.stdout.take().map(|stream| {
            self.listen(number, Stream::Output, stream);
        });
        let error = child.stderr.take().map(|stream| {
            self.listen(number, Stream::Error, stream);
        });
        Running {
            number,
            folder: self.sweep.folder(self.sweep.member(number)),
            child,
            begun: Instant::now(),
            line: self.lines.begin(),
            status: None,
            open: output.iter().chain(&error).count(),
            digest: None,
            error: None,
        }
    }

    fn listen(&self, number: usize, stream: Stream, from: impl Read + Send + 'static) {
        let sender = self.sender.clone();
        std::thread::spawn(move || {
            for line in BufReader::new(from).split(b'\n').map_while(Result::ok) {
                let line = String::from_utf8_lossy(&line).into_owned();
                let _ = sender.send(Said {
                    number,
                    stream,
                    line: Some(line),
                });
            }
            let _ = sender.send(Said {
                number,
                stream,
                line: None,
            });
        });
    }

    /// Prints what a run says: notes and errors, the rest if told to print more.
    fn hear(&mut self, said: Said) {
        let Some(run) = (self.running.iter_mut()).find(|run| run.number == said.number) else {
            return;
        };
        let Some(line) = said.line else {
            run.open -= 1;
            return;
        };
        let name = &self.sweep.member(said.number).name;
        let tagged = format!("{name}: {line}");
        match said.stream {
            Stream::Output => {
                if let Some(digest) = line.strip_prefix("digest ") {
                    run.digest = Some(digest.into());
                }
                self.lines.detail(&tagged);
            }
            Stream::Error => {
                if let Some(error) = line.strip_prefix("error: ") {
                    run.error = Some(error.into());
                } else if !line.is_empty() {
                    self.lines.say_error(&tagged);
                }
            }
        }
    }

    /// Notes the runs that have ended. `asked`: whether they were asked to stop.
    fn reap(&mut self, asked: bool) {
        for run in &mut self.running {
            if run.status.is_none()
                && let Ok(Some(status)) = run.child.try_wait()
            {
                run.status = Some((status, Instant::now()));
            }
        }
        let has_ended = |run: &mut Running| {
            let gone = run.status.is_some_and(|(_, at)| at.elapsed() >= LAST_WORDS);
            gone || (run.status.is_some() && run.open == 0)
        };
        let ended: Vec<Running> = self.running.extract_if(.., has_ended).collect();
        for run in ended {
            self.lines.end(&run.line);
            let name = &self.sweep.member(run.number).name;
            let time = duration(run.begun.elapsed().as_secs_f64());
            let ending = run.ending(asked);
            let text = match &ending {
                Ok(Outcome::Done) => match &run.digest {
                    Some(digest) => format!("is done in {time}, digest {digest}"),
                    None => format!("is done in {time}"),
                },
                Ok(Outcome::Stopped) => format!("stopped after {time}"),
                Err(failure) => format!("failed after {time}: {failure}"),
            };
            match ending {
                Err(_) => self.lines.say_error(&format!("sweep: {name} {text}")),
                Ok(_) => self.lines.say(&format!("sweep: {name} {text}")),
            }
            self.ended.add(name, ending);
        }
    }

    /// Asks the runs to stop at checkpoints. Launchers pass this signal on to their ranks; at
    /// others they end them.
    fn ask_to_stop(&self) {
        for run in self.running.iter().filter(|run| run.status.is_none()) {
            let process = Pid::from_raw(run.child.id() as i32);
            let _ = kill(process, Signal::SIGUSR1);
        }
    }

    fn draw(&self) {
        for run in &self.running {
            self.lines.draw(&run.line, run.number, &run.folder);
        }
        let Ended { done, failed, .. } = &self.ended;
        let mut text = format!(
            "sweep: {done} done, {} running, {} waiting",
            self.running.len(),
            self.waiting.len()
        );
        if !failed.is_empty() {
            text += &format!(", {} failed", failed.len());
        }
        self.lines.draw_sweep(&text);
    }
}

impl Running {
    /// How a run whose process has ended has ended. `asked`: whether it was asked to stop.
    fn ending(&self, asked: bool) -> Result<Outcome> {
        let Some((status, _)) = self.status else {
            return Ok(Outcome::Stopped);
        };
        let message = |what: String| self.error.clone().unwrap_or(what);
        match status.code() {
            Some(0) => Ok(Outcome::Done),
            Some(STOPPED_EARLY) => Ok(Outcome::Stopped),
            Some(2) => Err(Failure::Input(message("exit code 2".into()))),
            Some(3) => Err(Failure::Numbers(message("exit code 3".into()))),
            // The signal came before the program could catch it.
            None if asked && status.signal() == Some(Signal::SIGUSR1 as i32) => {
                Ok(Outcome::Stopped)
            }
            Some(code) if asked && code == 128 + Signal::SIGUSR1 as i32 => Ok(Outcome::Stopped),
            Some(code) => Err(Failure::Other(message(format!("exit code {code}")))),
            None => Err(Failure::Other(message(status.to_string()))),
        }
    }
}

/// The command that starts ranks, up to its options: that of the environment, or the one that is
/// installed beside the program, as in an environment of Python, or mpirun.
fn launcher(program: &std::path::Path) -> Vec<OsString> {
    let given = std::env::var(LAUNCHER).unwrap_or_default();
    let words: Vec<OsString> = given.split_whitespace().map(OsString::from).collect();
    if !words.is_empty() {
        return words;
    }
    let beside = program.with_file_name("mpiexec");
    if beside.exists() {
        return vec![beside.into()];
    }
    vec!["mpirun".into()]
}
