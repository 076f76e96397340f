//! `watch`: curves of a run under way in the terminal, from `log.csv`, or `run.h5` of a box, and
//! `status.json`, which can be read while the run writes.

use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use console::Term;

use gshear_dem::failure::{Failure, Result, printable};
use gshear_driver::progress::line;
use gshear_driver::say::fold_for;
use gshear_driver::stored_run::condition_by_status;
use gshear_store::checkpoint;
use gshear_store::file_names::{LOG_FILE, RUN_FILE, STATUS_FILE, folder_of};
use gshear_store::run_reader::{RunFile, RunStage};
use gshear_store::sound;
use gshear_store::status::{RunCondition, RunState, Status};

use crate::braille::plot;
use crate::printer::Printer;

/// Time between two looks at the run.
const INTERVAL: Duration = Duration::from_secs(1);
/// Time without a new status after which a run may have been killed.
const SILENT: Duration = Duration::from_secs(30);
/// How often a file is opened again that may be in the middle of a flush, and the time between.
const ATTEMPTS: usize = 5;
const PAUSE: Duration = Duration::from_millis(50);
/// The least width (characters) of a line that has room for a wait for cores.
const WIDE: usize = 100;
/// The widest picture (characters), and the least size of one.
const WIDEST: usize = 120;
const LEAST: [usize; 2] = [30, 8];

/// Show the curves of a run under way in the terminal, until it ends
///
/// Reads log.csv and status.json every second, while the run writes: stress ratio and solid
/// fraction over the strain, or over the time if the strain returns or there is none; of a box the
/// shear stress, from run.h5. Ctrl-C leaves the run alone. Without a terminal, and of a run that
/// has ended, it shows the present state and ends.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The folder of a run
    run: PathBuf,
}

impl Arguments {
    /// # Errors
    /// A folder without a run, output that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = &self.run;
        let folder = folder_of(run);
        let mut curves = Curves::new(folder);
        let term = Term::stdout();
        let shown = term.is_term() && term.size_checked().is_some();
        let colours = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        let (mut drawn, mut size) = (0, term.size());
        loop {
            let begun = Instant::now();
            let status = Status::read(folder);
            let condition = condition_by_status(folder);
            let running = condition == Some(RunCondition::Running);
            let killed = condition == Some(RunCondition::Killed);
            curves.read(status.as_ref())?;
            if status.is_none() && curves.rows() == 0 {
                let what = if run.exists() {
                    let folder = folder.display();
                    format!("{folder}: holds neither {STATUS_FILE} nor {LOG_FILE}")
                } else {
                    format!("{}: no such folder", run.display())
                };
                return Err(Failure::input(format!("{what}; give the folder of a run")));
            }
            let width = if shown {
                usize::from(term.size().1).saturating_sub(1)
            } else {
                usize::MAX
            };
            let headed = status.as_ref().zip(condition.as_ref());
            let mut text = vec![headline(headed, width, shown && colours)];
            if shown {
                let height = usize::from(term.size().0);
                text.extend(curves.pictures(width.min(WIDEST), height.saturating_sub(3)));
                // The last picture is drawn over, but for one that the terminal has broken anew.
                if size != term.size() {
                    size = term.size();
                    write!(printer, "\x1b[H\x1b[2J")?;
                } else if drawn > 0 {
                    write!(printer, "\x1b[{drawn}A")?;
                }
                drawn = text.len();
            }
            for line in &text {
                let clear = if shown { "\x1b[2K" } else { "" };
                writeln!(printer, "{clear}{line}")?;
            }
            if shown {
                write!(printer, "\x1b[J")?;
            }
            if killed || condition == Some(RunCondition::Stopped) {
                let mut states = [checkpoint::NAME, checkpoint::PREVIOUS].into_iter();
                let has_state = states.any(|name| folder.join(name).exists());
                let next = if has_state {
                    format!("continue with --resume {}", folder.display())
                } else {
                    "there is no checkpoint yet: begin again with --resume auto".into()
                };
                writeln!(printer, "{}", fold_for(&term, &printable(&next)))?;
            }
            printer.flush()?;
            if !shown || !running {
                return Ok(());
            }
            std::thread::sleep(INTERVAL.saturating_sub(begun.elapsed()));
        }
    }
}

/// What the run does, in a line.
fn headline(run: Option<(&Status, &RunCondition)>, width: usize, colours: bool) -> String {
    let Some((status, condition)) = run else {
        let text = "the state is unknown: an earlier version wrote this run";
        return text.chars().take(width).collect();
    };
    let running = *condition == RunCondition::Running;
    let words = match condition {
        RunCondition::Running => match age(status) {
            Some(age) if age > SILENT => format!("no news for {}s, ", age.as_secs()),
            _ => String::new(),
        },
        RunCondition::Failed(_) => return condition.to_string().chars().take(width).collect(),
        _ => format!("{}: ", condition.name()),
    };
    let waits = match status.long_wait() {
        Some(waited) if running && width >= WIDE => {
            format!(", waits {:.0} % of the time for cores", 100.0 * waited)
        }
        _ => String::new(),
    };
    let room = width.saturating_sub(words.chars().count() + waits.chars().count());
    // Of a run that has ended nothing is left to wait for.
    let left = if running { status.seconds_left } else { None };
    words + &line(&status.progress, status.speed, left, room, colours) + &waits
}

/// Time since the status was written.
fn age(status: &Status) -> Option<Duration> {
    let written = humantime::parse_rfc3339(&status.updated).ok()?;
    SystemTime::now().duration_since(written).ok()
}

/// A point of every curve, by the strain or, if that returns, by the time or the strain step.
struct Curves {
    log: Tail,
    strains: StrainSteps,
    /// Names of the curves, and of what they are drawn over.
    names: [String; 2],
    over: &'static str,
    points: [Vec<[f64; 2]>; 2],
}

impl Curves {
    fn new(folder: &Path) -> Self {
        Self {
            log: Tail {
                path: folder.join(LOG_FILE),
                ..Tail::default()
            },
            strains: StrainSteps {
                path: folder.join(RUN_FILE),
                ..StrainSteps::default()
            },
            names: ["tau", "phi"].map(String::from),
            over: "strain",
            points: [Vec::new(), Vec::new()],
        }
    }

    fn rows(&self) -> usize {
        self.points[0].len()
    }

    /// Reads what is new.
    fn read(&mut self, status: Option<&Status>) -> Result<()> {
        self.log.read();
        // Strain steps write no log, but may follow a shear.
        let strains = status.is_some_and(|status| status.progress.stage == RunStage::Strain.name());
        if !self.log.rows.is_empty() && !strains {
            let [strain, time] = ["strain", "time"].map(|name| self.log.column(name));
            let (over, x) = if strain.is_empty() || returns(&strain) || stands_still(&strain) {
                ("time", time)
            } else {
                ("strain", strain)
            };
            self.over = over;
            let drawn = self.log.drawn();
            self.points = [0, 1].map(|k| {
                let y = drawn.get(k).map(|name| self.log.column(name));
                let points = x.iter().zip(y.unwrap_or_default());
                points.map(|(x, y)| [*x, y]).collect()
            });
            self.names = [0, 1].map(|k| symbol(drawn.get(k).copied().unwrap_or_default()));
            return Ok(());
        }
        let Some(status) = status else { return Ok(()) };
        self.strains.read(status)?;
        let [step, strain, stress] =
            [0, 1, 2].map(|k| self.strains.all().map(|row| row[k]).collect::<Vec<f64>>());
        let (over, x) = if returns(&strain) {
            ("strain step", step)
        } else {
            ("strain", strain)
        };
        (self.names, self.over) = (["stress", ""].map(String::from), over);
        self.points[0] = x.into_iter().zip(stress).map(|(x, y)| [x, y]).collect();
        Ok(())
    }

    /// The lines of the pictures, one above the other if there is room.
    fn pictures(&self, width: usize, height: usize) -> Vec<String> {
        if width < LEAST[0] || height < LEAST[1] || self.rows() < 2 {
            return Vec::new();
        }
        if self.points[1].len() > 1 && height >= 2 * LEAST[1] + 4 {
            // The stress has twice the room.
            let lower = (height / 3).max(LEAST[1]);
            let upper = self.picture(0, [width, height - lower]);
            [upper, self.picture(1, [width, lower])].concat()
        } else {
            self.picture(0, [width, height])
        }
    }

    /// The lines of the picture of a curve.
    fn picture(&self, k: usize, size: [usize; 2]) -> Vec<String> {
        let (points, name) = (&self.points[k], &self.names[k]);
        plot(points, name, self.over, size, speaks_utf8())
    }
}

/// Whether the terminal takes more than ASCII.
fn speaks_utf8() -> bool {
    let names = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter();
    let mut values = names.filter_map(|name| std::env::var(name).ok());
    let value = values.find(|value| !value.is_empty());
    let value = value.unwrap_or_default().to_lowercase();
    value.contains("utf-8") || value.contains("utf8")
}

/// What a column is called in a picture.
fn symbol(column: &str) -> String {
    match column {
        "stress_ratio" => "tau",
        "solid_fraction" => "phi",
        other => other,
    }
    .into()
}

/// Whether there is no shear, as below a free surface.
fn stands_still(strain: &[f64]) -> bool {
    strain.len() > 1 && strain.iter().all(|x| *x == 0.0)
}

fn returns(strain: &[f64]) -> bool {
    strain.windows(2).any(|pair| pair[1] < pair[0])
}

/// The strain steps of a box, each with its number, the strain and the shear stress: those in its
/// file, which the run writes every few seconds, and then those that were seen since.
#[derive(Default)]
struct StrainSteps {
    path: PathBuf,
    /// What changes when the file does.
    signature: Option<(u64, u64, i64, i64)>,
    stored: Vec<[f64; 3]>,
    seen: Vec<[f64; 3]>,
}

impl StrainSteps {
    fn all(&self) -> impl Iterator<Item = &[f64; 3]> {
        self.stored.iter().chain(&self.seen)
    }

    /// Reads what is new.
    ///
    /// # Errors
    /// A damaged file of a run that does not write it any more.
    fn read(&mut self, status: &Status) -> Result<()> {
        let file = std::fs::metadata(&self.path).ok();
        let signature = file.map(|file| (file.ino(), file.len(), file.mtime(), file.mtime_nsec()));
        if signature.is_some() && signature != self.signature {
            let mut opened = RunFile::open_any(&self.path);
            for _ in 0..ATTEMPTS {
                if opened.is_ok() || status.state != RunState::Running {
                    break;
                }
                std::thread::sleep(PAUSE);
                opened = RunFile::open_any(&self.path);
            }
            let opened = opened.and_then(|run| match run.stage() {
                RunStage::Strain => Ok(Some(run)),
                _ => run.part(RunStage::Strain),
            });
            match opened {
                Ok(Some(run)) => {
                    self.signature = signature;
                    let series = run.series();
                    let (strain, stress) = (series.column("strain"), series.column("shear_stress"));
                    self.stored = (series.step.iter().enumerate())
                        .map(|(k, step)| [*step as f64, strain[k], stress[k]])
                        .collect();
                }
                Ok(None) => {}
                // Another look finds it whole.
                Err(_) if status.state == RunState::Running => {}
                Err(failure) => return Err(failure),
            }
        }
        let progress = &status.progress;
        let step = progress.step as f64;
        if let (Some(strain), Some(stress)) = (progress.strain, progress.shear_stress) {
            self.seen.retain(|row| row[0] < step);
            self.seen.push([step, strain, stress]);
        }
        let last = self.stored.last().map_or(-1.0, |row| row[0]);
        self.seen.retain(|row| row[0] > last);
        Ok(())
    }
}

/// A table that grows: reads its new lines. A table that is cut or replaced, as at a resume, is
/// read again.
#[derive(Default)]
struct Tail {
    path: PathBuf,
    file: (u64, u64),
    read: u64,
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Tail {
    fn column(&self, name: &str) -> Vec<f64> {
        match self.names.iter().position(|known| known == name) {
            Some(column) => self.rows.iter().map(|row| row[column]).collect(),
            None => Vec::new(),
        }
    }

    /// The two columns that are drawn: stress ratio and solid fraction; where `output.columns` has
    /// left out one of them, the first others.
    fn drawn(&self) -> Vec<&str> {
        let names = self.names.iter().map(String::as_str);
        let usual = ["stress_ratio", "solid_fraction"];
        let (first, others): (Vec<&str>, Vec<&str>) = names.partition(|name| usual.contains(name));
        let clock = ["step", "time", "strain"];
        let others = others.into_iter().filter(|name| !clock.contains(name));
        let mut drawn: Vec<&str> = usual
            .into_iter()
            .filter(|name| first.contains(name))
            .collect();
        drawn.extend(others);
        drawn.truncate(2);
        drawn
    }

    /// Reads the complete lines that are new; a file that cannot be read has none.
    fn read(&mut self) {
        let Ok(mut file) = sound::regular(&self.path) else {
            return;
        };
        let Ok(metadata) = file.metadata() else {
            return;
        };
        let id = (metadata.dev(), metadata.ino());
        if id != self.file || metadata.len() < self.read {
            *self = Self {
                file: id,
                path: std::mem::take(&mut self.path),
                ..Self::default()
            };
        }
        if file.seek(SeekFrom::Start(self.read)).is_err() {
            return;
        }
        let mut reader = BufReader::new(file);
        let mut line = String::new();
        while reader.read_line(&mut line).is_ok_and(|bytes| bytes > 0) && line.ends_with('\n') {
            self.read += line.len() as u64;
            self.take(line.trim_end());
            line.clear();
        }
    }

    fn take(&mut self, line: &str) {
        let cells = line.split(',');
        if self.names.is_empty() {
            self.names = cells.map(String::from).collect();
            return;
        }
        let values: Option<Vec<f64>> = cells.map(|cell| cell.parse().ok()).collect();
        let whole = values.filter(|values| values.len() == self.names.len());
        self.rows.extend(whole);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_read_as_it_grows() {
        let path = std::env::temp_dir().join(format!("gshear-watch-{}.csv", std::process::id()));
        let mut tail = Tail {
            path: path.clone(),
            ..Tail::default()
        };
        tail.read();
        assert!(tail.rows.is_empty());
        let write = |text: &str| std::fs::write(&path, text).expect("written");
        write("step,strain\n0,0\n10,0.5\n20,0.");
        tail.read();
        assert_eq!(tail.column("strain"), [0.0, 0.5]);
        write("step,strain\n0,0\n10,0.5\n20,0.75\n");
        tail.read();
        assert_eq!(tail.column("strain"), [0.0, 0.5, 0.75]);
        // Cut at a resume.
        write("step,strain\n0,0\n");
        tail.read();
        assert_eq!(tail.column("strain"), [0.0]);
        std::fs::remove_file(&path).expect("removed");
    }
}
