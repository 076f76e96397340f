//! The lock of a run's folder: one job at a time writes into it.

use std::fs::{self, File, Metadata, OpenOptions, TryLockError};
use std::hash::{BuildHasher, RandomState};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use rustix::fs::OFlags;
use serde::{Deserialize, Serialize};

use gshear_dem::failure::{Failure, Result};
use gshear_store::{provenance, sound};

/// Name of the lock in the folder of a run.
pub(crate) const LOCK_FILE: &str = "run.lock";
/// Interval at which the owner renews the time of the file.
const HEARTBEAT: Duration = Duration::from_secs(30);
/// A lock of which the kernel knows nothing is stale if it is older.
const STALE: Duration = Duration::from_mins(5);
/// Bytes of a lock.
const LONGEST: u64 = 64 << 10;
/// How often a lock is tried, and the pause between.
const TRIES: usize = 10;
const PAUSE: Duration = Duration::from_millis(20);

/// The process that holds a lock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Holder {
    host: String,
    pid: u32,
    /// UTC.
    started: String,
    /// The boot of the machine: host names and process ids occur twice, in containers and after a
    /// restart.
    #[serde(default)]
    boot: String,
    /// Whether the kernel holds a lock on the file for as long as the process lives.
    #[serde(default)]
    locked: bool,
    /// No other lock has the same.
    #[serde(default)]
    token: u64,
}

impl Holder {
    fn this(locked: bool) -> Self {
        let pid = std::process::id();
        Self {
            host: provenance::host(),
            pid,
            started: provenance::now(),
            boot: boot(),
            locked,
            token: RandomState::new().hash_one(pid),
        }
    }

    /// Whether the kernel tells if the process lives.
    fn is_known_here(&self) -> bool {
        self.locked && !self.boot.is_empty() && self.boot == boot()
    }
}

fn boot() -> String {
    fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default()
}

/// Whether the process of a lock is known to be gone. `tried`: the outcome of a try to lock the
/// file. It may fail for other reasons than that the process holds the lock, such as a full table
/// of locks; then only the age tells.
fn is_gone(holder: Option<&Holder>, tried: &Result<(), TryLockError>, age: Duration) -> bool {
    match (holder, tried) {
        (Some(holder), Ok(()) | Err(TryLockError::WouldBlock)) if holder.is_known_here() => {
            tried.is_ok()
        }
        (Some(_), _) => age > STALE,
        // An owner locks the file before it writes its name: this one was killed in between, or is
        // about to write it where the kernel has no locks.
        (None, _) => tried.is_ok() || age > HEARTBEAT,
    }
}

/// Whether the run that writes into a folder is known to have died: its lock is there, and its
/// process is gone.
pub(crate) fn is_abandoned(folder: &Path) -> bool {
    let Ok(mut file) = open(&folder.join(LOCK_FILE), false) else {
        return false;
    };
    let (_, holder) = read(&mut file);
    let age = age(file.metadata());
    holder.is_some_and(|holder| is_gone(Some(&holder), &file.try_lock_shared(), age))
}

/// Whether no run writes into a folder: it has no lock, or that of a process that is gone.
pub(crate) fn is_left(folder: &Path) -> bool {
    !folder.join(LOCK_FILE).exists() || is_abandoned(folder)
}

/// Opens an existing lock, which is a file: a link is not followed, a pipe not waited for.
fn open(path: &Path, write: bool) -> std::io::Result<File> {
    let mut options = OpenOptions::new();
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    options.read(true).write(write);
    let file = options.custom_flags(flags.bits() as i32).open(path)?;
    sound::is_regular(file.metadata()?.file_type())?;
    Ok(file)
}

/// The text of a lock, and its holder.
fn read(file: &mut File) -> (String, Option<Holder>) {
    let mut text = String::new();
    let _ = file.take(LONGEST).read_to_string(&mut text);
    let holder = serde_json::from_str(&text).ok();
    (text, holder)
}

/// The text of the lock at a path.
fn text_at(path: &Path) -> std::io::Result<String> {
    Ok(read(&mut open(path, false)?).0)
}

/// What a lock says at a time.
#[derive(PartialEq)]
struct LockState {
    text: String,
    modified: SystemTime,
    holder: Holder,
}

impl LockState {
    /// Reads the lock at a path; `None` if there is none that names its holder.
    fn read(path: &Path) -> Option<Self> {
        let mut file = open(path, false).ok()?;
        let modified = file.metadata().ok()?.modified().ok()?;
        let (text, holder) = read(&mut file);
        Some(Self {
            text,
            modified,
            holder: holder?,
        })
    }
}

/// A lock that this process holds. Dropping it removes the file.
pub(crate) struct Lock {
    path: PathBuf,
    text: String,
    /// The kernel holds its lock until this is closed.
    _file: Arc<File>,
    /// Renews the time of the file until what stops it is dropped.
    heartbeat: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Lock {
    /// Takes the lock of a folder, which must exist. A stale lock is taken over, with a note.
    /// `force`: take over any lock.
    ///
    /// # Errors
    /// [`Failure::Input`] if another process holds it, or the folder cannot be written.
    pub fn take(folder: &Path, force: bool, notes: &mut Vec<String>) -> Result<Self> {
        let path = folder.join(LOCK_FILE);
        let mut refused = None;
        // A lock may vanish or appear between two looks at it, and who looks at one locks it for a
        // moment.
        for _ in 0..TRIES {
            match File::create_new(&path) {
                Ok(file) => match Self::hold(&path, file) {
                    Ok(Some(lock)) => return Ok(lock),
                    Ok(None) => {}
                    Err(e) => {
                        let _ = fs::remove_file(&path);
                        return Err(unwritable(folder, &e));
                    }
                },
                Err(e) if e.kind() == ErrorKind::AlreadyExists => {
                    refused = Self::clear(folder, &path, force, notes)?;
                    if refused.is_none() {
                        continue;
                    }
                }
                Err(e) => return Err(unwritable(folder, &e)),
            }
            std::thread::sleep(PAUSE);
        }
        Err(refused.unwrap_or_else(|| {
            Failure::input(format!(
                "{}: several programs take this lock in turn; try again",
                path.display()
            ))
        }))
    }

    /// Waits until it is known whether the process that holds the lock lives: the process renews
    /// the lock or removes it, or the lock becomes stale. Returns at once if the kernel tells.
    /// `note`: is told that this waits.
    pub(crate) fn await_verdict(folder: &Path, note: impl Fn(&str)) {
        let path = folder.join(LOCK_FILE);
        let Some(first) = LockState::read(&path) else {
            return;
        };
        let holder = &first.holder;
        let tried = open(&path, false).map(|file| file.try_lock_shared());
        let tells = !matches!(tried, Ok(Err(TryLockError::Error(_))));
        if holder.is_known_here() && tells {
            return;
        }
        let begun = Instant::now();
        // The second bound holds if the clocks of the hosts differ.
        for looks in 0.. {
            let age = age(fs::metadata(&path));
            if age > STALE
                || begun.elapsed() > STALE
                || LockState::read(&path).as_ref() != Some(&first)
            {
                return;
            }
            if looks == 1 {
                let Holder { host, pid, .. } = holder;
                note(&format!(
                    "{}: held by process {pid} on {host}; waits until that process renews it or it is {} minutes old",
                    path.display(),
                    STALE.as_secs() / 60
                ));
            }
            std::thread::sleep(Duration::from_secs(1));
        }
    }

    /// Removes a lock whose process is gone. Returns the message that refuses another one.
    fn clear(
        folder: &Path,
        path: &Path,
        force: bool,
        notes: &mut Vec<String>,
    ) -> Result<Option<Failure>> {
        let mut file = match open(path, true) {
            Ok(file) => file,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => {
                let path = path.display();
                return Err(Failure::input(format!(
                    "{path}: the lock of the folder cannot be opened: {e}; remove it, or give another folder with --out"
                )));
            }
        };
        // Kept until the lock is removed: of several programs only one removes it.
        let tried = file.try_lock();
        let (seen, holder) = read(&mut file);
        let gone = is_gone(holder.as_ref(), &tried, age(file.metadata()));
        let whose = match &holder {
            Some(Holder {
                host, pid, started, ..
            }) => format!("process {pid} on {host}, started {started}"),
            None => "an unknown process".into(),
        };
        if !gone && !force {
            return Ok(Some(Failure::input(format!(
                "{}: {whose}, writes into this folder; wait until it has ended or give another --out. \
                 --break-lock takes the folder over from a process that has died",
                folder.display()
            ))));
        }
        // Without locks of the kernel, two programs may take over at once: only the lock that was
        // seen is removed.
        let aside = folder.join(format!("{LOCK_FILE}.{:x}", Holder::this(false).token));
        if fs::rename(path, &aside).is_ok() {
            let same = text_at(&aside).is_ok_and(|text| text == seen);
            if !same {
                let _ = fs::hard_link(&aside, path);
            }
            let _ = fs::remove_file(&aside);
            if same {
                let why = if gone {
                    "is gone"
                } else {
                    "loses it by --break-lock"
                };
                let path = path.display();
                notes.push(format!("{path}: {whose}, {why}; took the lock over"));
            }
        }
        Ok(None)
    }

    /// Takes a lock that this process has just created; `None` if another one was faster.
    fn hold(path: &Path, mut file: File) -> std::io::Result<Option<Self>> {
        let locked = match file.try_lock() {
            Ok(()) => true,
            Err(TryLockError::WouldBlock) => return Ok(None),
            // Not every file system has locks.
            Err(TryLockError::Error(_)) => false,
        };
        let text = serde_json::to_string(&Holder::this(locked)).expect("texts and numbers");
        file.write_all(text.as_bytes())?;
        if text_at(path).ok().as_ref() != Some(&text) {
            return Ok(None);
        }
        let file = Arc::new(file);
        let (stop, stopped) = mpsc::channel();
        let renewed = file.clone();
        let heartbeat = std::thread::Builder::new().spawn(move || {
            while let Err(RecvTimeoutError::Timeout) = stopped.recv_timeout(HEARTBEAT) {
                let _ = renewed.set_modified(SystemTime::now());
            }
        });
        Ok(Some(Self {
            path: path.into(),
            text,
            _file: file,
            heartbeat: heartbeat.ok().map(|thread| (stop, thread)),
        }))
    }

    /// Checks that this process still holds the lock.
    ///
    /// # Errors
    /// [`Failure::Other`] if the folder or the lock is gone, or another process holds it.
    pub fn verify(&self) -> Result<()> {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(Failure::other(format!(
                "{}: the folder of the results was removed during the run; what the run wrote is gone",
                folder.display()
            )));
        }
        let what = match text_at(&self.path) {
            Ok(text) if text == self.text => return Ok(()),
            Ok(_) => "another gshear-mpi took this folder over; nothing more is written".into(),
            Err(e) => format!(
                "the lock of this run cannot be read ({e}); another program may have emptied the folder"
            ),
        };
        let path = self.path.display();
        Err(Failure::other(format!("{path}: {what}")))
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        if let Some((stop, heartbeat)) = self.heartbeat.take() {
            drop(stop);
            let _ = heartbeat.join();
        }
        if text_at(&self.path).is_ok_and(|text| text == self.text) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// The failure of a folder that cannot be written.
pub(crate) fn unwritable(folder: &Path, why: &std::io::Error) -> Failure {
    Failure::input(format!(
        "{}: the folder of the results cannot be written: {why}; give another one with --out",
        folder.display()
    ))
}

/// Time since the last heartbeat.
fn age(metadata: std::io::Result<Metadata>) -> Duration {
    let modified = metadata.and_then(|file| file.modified());
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

    fn elsewhere() -> Holder {
        Holder {
            boot: "another".into(),
            ..Holder::this(true)
        }
    }

    #[test]
    fn a_lock_is_held_once_and_removed() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        // Takes the lock and gives it back; returns the notes.
        let take = |force| {
            let mut notes = Vec::new();
            Lock::take(folder, force, &mut notes).map(|_| notes)
        };
        let mut notes = Vec::new();
        let lock = Lock::take(folder, false, &mut notes).unwrap();
        let refused = take(false).expect_err("taken twice");
        let pid = std::process::id().to_string();
        assert!(refused.to_string().contains(&pid), "{refused}");
        lock.verify().unwrap();
        drop(lock);
        assert!(!folder.join(LOCK_FILE).exists() && notes.is_empty());

        // Another machine, also of the same name.
        let elsewhere = elsewhere();
        write(folder, &elsewhere, Duration::ZERO);
        assert!(take(false).is_err());
        let notes = take(true).unwrap();
        assert!(notes[0].contains("--break-lock"), "{notes:?}");
        write(folder, &elsewhere, 2 * STALE);
        assert_eq!(take(false).unwrap().len(), 1);
        // The kernel has no lock of this machine's.
        write(folder, &Holder::this(true), Duration::ZERO);
        assert_eq!(take(false).unwrap().len(), 1);
        // It was killed before it had written its name.
        fs::write(folder.join(LOCK_FILE), "{\"host").unwrap();
        let notes = take(false).unwrap().concat();
        assert!(notes.contains("an unknown process, is gone"), "{notes}");
        // It could not have one.
        write(folder, &Holder::this(false), Duration::ZERO);
        assert!(take(false).is_err());
        // A link into another folder is neither followed nor replaced.
        let (path, other) = (folder.join(LOCK_FILE), folder.join("other"));
        fs::rename(&path, &other).unwrap();
        std::os::unix::fs::symlink(&other, &path).unwrap();
        assert!(take(true).is_err() && !is_abandoned(folder));
        assert_eq!(fs::read_dir(folder).unwrap().count(), 2);
    }

    #[test]
    fn a_lock_of_another_host_is_watched() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let path = folder.join(LOCK_FILE);
        let elsewhere = elsewhere();
        let waited = |holder: &Holder, age: Duration, meanwhile: &dyn Fn()| {
            write(folder, holder, age);
            let begun = Instant::now();
            std::thread::scope(|scope| {
                let waits = scope.spawn(|| Lock::await_verdict(folder, |_| {}));
                meanwhile();
                waits.join().unwrap();
            });
            begun.elapsed()
        };
        let soon = Duration::from_millis(500);
        assert!(waited(&Holder::this(true), Duration::ZERO, &|| {}) < soon);
        assert!(waited(&elsewhere, 2 * STALE, &|| {}) < soon);
        // It becomes stale.
        let almost = STALE.checked_sub(Duration::from_secs(2)).unwrap();
        let time = waited(&elsewhere, almost, &|| {});
        assert!(time > Duration::from_secs(1) && time < Duration::from_secs(10));
        // Its owner renews it.
        let time = waited(&elsewhere, Duration::from_mins(1), &|| {
            std::thread::sleep(soon);
            write(folder, &elsewhere, Duration::ZERO);
        });
        assert!(time > soon && time < Duration::from_secs(10));
        // Its owner ends.
        let time = waited(&elsewhere, Duration::ZERO, &|| {
            std::thread::sleep(soon);
            fs::remove_file(&path).unwrap();
        });
        assert!(time > soon && time < Duration::from_secs(10));
        assert_eq!(fs::read_dir(folder).unwrap().count(), 0);
    }
}
