//! The lock of a run's folder: one job at a time writes into it.

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use serde::{Deserialize, Serialize};

use gshear_dem::failure::Failure;
use gshear_store::provenance;

/// Name of the lock in the folder of a run.
pub const LOCK_FILE: &str = "run.lock";
/// Interval at which the owner renews the time of the file.
const HEARTBEAT: Duration = Duration::from_secs(30);
/// A lock of another machine is stale if it is older.
const STALE: Duration = Duration::from_mins(5);

/// The process that holds a lock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Holder {
    host: String,
    pid: u32,
    /// Start of the process in ticks since boot, because process ids are used again.
    ticks: Option<u64>,
    /// UTC.
    started: String,
}

impl Holder {
    fn this() -> Self {
        let pid = std::process::id();
        Self {
            host: provenance::host(),
            pid,
            ticks: start_of(pid),
            started: provenance::now(),
        }
    }

    /// Whether it is a process of this host, which can be looked up.
    fn is_here(&self) -> bool {
        self.host == provenance::host() && Path::new("/proc/self/stat").exists()
    }

    /// Whether the process is known to be gone. `age`: time since the last heartbeat.
    fn is_gone(&self, age: Duration) -> bool {
        if self.is_here() {
            let ticks = start_of(self.pid);
            return ticks.is_none() || ticks != self.ticks;
        }
        age > STALE
    }
}

/// When a process of this machine started, in ticks since boot; `None` if it has ended.
fn start_of(pid: u32) -> Option<u64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name before it, in parentheses, may have spaces.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    // A zombie holds nothing; its parent has not asked for its exit code yet.
    (*fields.first()? != "Z").then(|| fields.get(19)?.parse().ok())?
}

/// Whether the run that writes into a folder is known to have ended without a word: its lock is
/// there, and its process is gone.
pub fn is_abandoned(folder: &Path) -> bool {
    let path = folder.join(LOCK_FILE);
    let holder = fs::read_to_string(&path).ok();
    let holder = holder.and_then(|text| serde_json::from_str::<Holder>(&text).ok());
    holder.is_some_and(|holder| holder.is_gone(age(&path)))
}

/// A lock that this process holds. Dropping it removes the file.
pub struct Lock {
    path: PathBuf,
    text: String,
    stop: Option<Sender<()>>,
    heartbeat: Option<JoinHandle<()>>,
}

impl Lock {
    /// Takes the lock of a folder, which must exist. A stale lock is taken over, with a note.
    /// `force`: take over any lock.
    ///
    /// # Errors
    /// [`Failure::Input`] if another process holds it, or the folder cannot be written.
    pub fn take(folder: &Path, force: bool, notes: &mut Vec<String>) -> Result<Self, Failure> {
        let path = folder.join(LOCK_FILE);
        let text = serde_json::to_string(&Holder::this()).expect("texts and numbers");
        // A lock may vanish or appear between two looks at it.
        for _ in 0..10 {
            match create(&path, &text) {
                Ok(()) => return Ok(Self::held(path, text)),
                Err(e) if e.kind() == ErrorKind::AlreadyExists => {
                    Self::take_over(folder, &path, force, notes)?;
                }
                Err(e) => return Err(unwritable(folder, &e)),
            }
        }
        Err(Failure::input(format!(
            "{}: several programs take this lock in turn; try again",
            path.display()
        )))
    }

    /// Waits until it is known whether a process of another host still holds the lock: the process
    /// renews the lock or removes it, or the lock becomes stale. Returns at once if the holder is of
    /// this host. `note`: is told that this waits.
    pub fn await_verdict(folder: &Path, note: impl Fn(&str)) {
        let path = folder.join(LOCK_FILE);
        let look = || {
            let modified = fs::metadata(&path).and_then(|file| file.modified()).ok()?;
            Some((fs::read_to_string(&path).ok()?, modified))
        };
        let Some(first) = look() else { return };
        let Ok(holder) = serde_json::from_str::<Holder>(&first.0) else {
            return;
        };
        if holder.is_here() {
            return;
        }
        let begun = Instant::now();
        // The second bound holds if the clocks of the hosts differ.
        for looks in 0.. {
            if age(&path) > STALE || begun.elapsed() > STALE || look().as_ref() != Some(&first) {
                return;
            }
            if looks == 1 {
                let Holder { host, pid, .. } = &holder;
                note(&format!(
                    "{}: held by process {pid} on {host}; waits until that process renews it or it is {} minutes old",
                    path.display(),
                    STALE.as_secs() / 60
                ));
            }
            std::thread::sleep(Duration::from_secs(1));
        }
    }

    /// Removes a stale lock.
    fn take_over(
        folder: &Path,
        path: &Path,
        force: bool,
        notes: &mut Vec<String>,
    ) -> Result<(), Failure> {
        let Ok(found) = fs::read_to_string(path) else {
            return Ok(());
        };
        let age = age(path);
        let holder: Option<Holder> = serde_json::from_str(&found).ok();
        let gone = match &holder {
            Some(holder) => holder.is_gone(age),
            // Its owner may be about to write it.
            None => age > HEARTBEAT,
        };
        let whose = match &holder {
            Some(Holder {
                host, pid, started, ..
            }) => format!("process {pid} on {host}, started {started}"),
            None => "an unknown process".into(),
        };
        if !gone && !force {
            return Err(Failure::input(format!(
                "{}: {whose}, writes into this folder; wait until it has ended or give another --out. \
                 If that process is gone, --break-lock takes the folder over",
                folder.display()
            )));
        }
        // Two programs may take over at once: only the lock that was seen is removed.
        let aside = folder.join(format!("{LOCK_FILE}.{}", std::process::id()));
        if fs::rename(path, &aside).is_ok() {
            let same = fs::read_to_string(&aside).is_ok_and(|text| text == found);
            if !same {
                let _ = fs::hard_link(&aside, path);
            }
            let _ = fs::remove_file(&aside);
            if same {
                let why = match gone {
                    true => "is gone",
                    false => "loses it by --break-lock",
                };
                notes.push(format!(
                    "{}: {whose}, {why}; took the lock over",
                    path.display()
                ));
            }
        }
        Ok(())
    }

    fn held(path: PathBuf, text: String) -> Self {
        let (stop, stopped) = mpsc::channel();
        let file = path.clone();
        let beat = move || {
            while let Err(RecvTimeoutError::Timeout) = stopped.recv_timeout(HEARTBEAT) {
                let open = OpenOptions::new().write(true).open(&file);
                let _ = open.and_then(|file: File| file.set_modified(SystemTime::now()));
            }
        };
        Self {
            path,
            text,
            stop: Some(stop),
            heartbeat: std::thread::Builder::new().spawn(beat).ok(),
        }
    }

    /// Checks that this process still holds the lock.
    ///
    /// # Errors
    /// [`Failure::Other`] if the folder or the lock is gone, or another process holds it.
    pub fn verify(&self) -> Result<(), Failure> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(Failure::other(format!(
                "{}: the folder of the results was removed during the run; what the run wrote is gone",
                folder.display()
            )));
        }
        match fs::read_to_string(&self.path) {
            Ok(text) if text == self.text => Ok(()),
            Ok(_) => Err(Failure::other(format!(
                "{}: another gshear-mpi took this folder over; nothing more is written",
                self.path.display()
            ))),
            Err(e) => Err(Failure::other(format!(
                "{}: the lock of this run cannot be read ({e}); another program may have emptied the folder",
                self.path.display()
            ))),
        }
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(heartbeat) = self.heartbeat.take() {
            let _ = heartbeat.join();
        }
        if fs::read_to_string(&self.path).is_ok_and(|text| text == self.text) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Creates a lock with its text, both at once, so that a killed process leaves no empty lock.
fn create(path: &Path, text: &str) -> std::io::Result<()> {
    let part = path.with_extension(format!("lock.{}.part", std::process::id()));
    let linked = fs::write(&part, text).and_then(|()| fs::hard_link(&part, path));
    let _ = fs::remove_file(&part);
    match linked {
        // Not every file system has hard links.
        Err(e)
            if matches!(
                e.kind(),
                ErrorKind::Unsupported | ErrorKind::PermissionDenied
            ) =>
        {
            let mut file = OpenOptions::new().write(true).create_new(true).open(path)?;
            file.write_all(text.as_bytes()).inspect_err(|_| {
                let _ = fs::remove_file(path);
            })
        }
        other => other,
    }
}

/// The failure of a folder that cannot be written.
pub fn unwritable(folder: &Path, why: &std::io::Error) -> Failure {
    Failure::input(format!(
        "{}: the folder of the results cannot be written: {why}; give another one with --out",
        folder.display()
    ))
}

/// Time since the last heartbeat.
fn age(path: &Path) -> Duration {
    let modified = fs::metadata(path).and_then(|file| file.modified());
    modified.map_or(Duration::ZERO, |at| at.elapsed().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, holder: &Holder, age: Duration) {
        let path = folder.join(LOCK_FILE);
        fs::write(&path, serde_json::to_string(holder).unwrap()).unwrap();
        let file = OpenOptions::new().write(true).open(&path).unwrap();
        file.set_modified(SystemTime::now() - age).unwrap();
    }

    #[test]
    fn a_lock_is_held_once_and_removed() {
        let folder = std::env::temp_dir().join(format!("gshear-lock-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let mut notes = Vec::new();
        let lock = Lock::take(&folder, false, &mut notes).unwrap();
        let Err(refused) = Lock::take(&folder, false, &mut notes) else {
            panic!("taken twice")
        };
        let pid = std::process::id().to_string();
        assert!(refused.to_string().contains(&pid), "{refused}");
        lock.verify().unwrap();
        drop(lock);
        assert!(!folder.join(LOCK_FILE).exists() && notes.is_empty());

        let elsewhere = Holder {
            host: "elsewhere".into(),
            ..Holder::this()
        };
        write(&folder, &elsewhere, Duration::ZERO);
        assert!(Lock::take(&folder, false, &mut notes).is_err());
        drop(Lock::take(&folder, true, &mut notes).unwrap());
        assert!(notes[0].contains("--break-lock"), "{notes:?}");
        write(&folder, &elsewhere, 2 * STALE);
        drop(Lock::take(&folder, false, &mut notes).unwrap());
        // The process id is used again by another process.
        let before = Holder {
            ticks: Some(1),
            ..Holder::this()
        };
        write(&folder, &before, Duration::ZERO);
        drop(Lock::take(&folder, false, &mut notes).unwrap());
        assert_eq!(notes.len(), 3);
        fs::remove_dir(&folder).unwrap();
    }

    #[test]
    fn a_lock_of_another_host_is_watched() {
        let folder = std::env::temp_dir().join(format!("gshear-watched-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let path = folder.join(LOCK_FILE);
        let elsewhere = Holder {
            host: "elsewhere".into(),
            ..Holder::this()
        };
        let waited = |holder: &Holder, age: Duration, meanwhile: &dyn Fn()| {
            write(&folder, holder, age);
            let begun = Instant::now();
            std::thread::scope(|scope| {
                let waits = scope.spawn(|| Lock::await_verdict(&folder, |_| {}));
                meanwhile();
                waits.join().unwrap();
            });
            begun.elapsed()
        };
        let soon = Duration::from_millis(500);
        assert!(waited(&Holder::this(), Duration::ZERO, &|| {}) < soon);
        assert!(waited(&elsewhere, 2 * STALE, &|| {}) < soon);
        // It becomes stale.
        let almost = STALE.checked_sub(Duration::from_secs(2)).unwrap();
        let time = waited(&elsewhere, almost, &|| {});
        assert!(time > Duration::from_secs(1) && time < Duration::from_secs(10));
        // Its owner renews it.
        let time = waited(&elsewhere, Duration::from_mins(1), &|| {
            std::thread::sleep(soon);
            write(&folder, &elsewhere, Duration::ZERO);
        });
        assert!(time > soon && time < Duration::from_secs(10));
        // Its owner ends.
        let time = waited(&elsewhere, Duration::ZERO, &|| {
            std::thread::sleep(soon);
            fs::remove_file(&path).unwrap();
        });
        assert!(time > soon && time < Duration::from_secs(10));
        fs::remove_dir(&folder).unwrap();
    }
}
