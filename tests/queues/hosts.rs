//! Ranks on two hosts: network namespaces of this machine, joined by a link, with names of their
//! own. Ranks of different hosts share no memory and talk over TCP; the file system is shared.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use crate::common::crossing::SCENE;
use crate::common::{Outcome, PROGRAM, gshear_mpi, mpirun, same_run, succeed};

const SHORT: &str = "--set=shear.strain=0.1";
/// Longer than any test, with checkpoints.
const LONG: [&str; 2] = [
    "--set=shear.strain=1000",
    "--set=output.checkpoint_strain=0.1",
];

/// Two hosts. A process keeps the namespaces of each.
struct Hosts {
    kept: Vec<Child>,
    names: [String; 2],
    folder: tempfile::TempDir,
}

const ADDRESSES: [&str; 2] = ["10.77.0.1", "10.77.0.2"];

impl Hosts {
    /// `None`, with a message, where this process may not make namespaces.
    fn new() -> Option<Self> {
        let id = std::process::id();
        let names = ["a", "b"].map(|name| format!("gshear-{name}-{id}"));
        let mut hosts = Self {
            kept: Vec::new(),
            names: names.clone(),
            folder: tempfile::tempdir().expect("a folder"),
        };
        for name in &names {
            // A dead connection ends after seconds instead of a quarter of an hour.
            // A machine of its own has booted by itself.
            let boot = hosts.folder.path().join(name);
            std::fs::write(&boot, name).expect("written");
            let boot = boot.display();
            let setup = format!(
                "mount --bind {boot} /proc/sys/kernel/random/boot_id && hostname {name} && ip link set lo up && echo 4 > /proc/sys/net/ipv4/tcp_retries2 && echo up && exec sleep 1000"
            );
            let mut command = Command::new("unshare");
            command.args(["--net", "--uts", "--mount", "sh", "-c", &setup]);
            command.stdout(Stdio::piped()).stderr(Stdio::piped());
            match command.spawn() {
                Ok(child) => hosts.kept.push(child),
                Err(e) => return skipped(&e.to_string()),
            }
            let mut said = [0; 3];
            let out = hosts.kept.last_mut().and_then(|c| c.stdout.as_mut());
            if std::io::Read::read_exact(out.expect("its output"), &mut said).is_err() {
                let mut why = String::new();
                let err = hosts.kept.last_mut().and_then(|c| c.stderr.as_mut());
                let _ = std::io::Read::read_to_string(err.expect("its messages"), &mut why);
                return skipped(why.trim());
            }
        }
        let [a, b] = [0, 1].map(|k| hosts.kept[k].id().to_string());
        let link = "link add up0 type veth peer name up0 netns";
        let linked = hosts.on(0, "ip").args(link.split(' ')).arg(&b).output();
        let linked = linked.expect("ip starts");
        if !linked.status.success() {
            return skipped(String::from_utf8_lossy(&linked.stderr).trim());
        }
        for (k, address) in ADDRESSES.iter().enumerate() {
            let address = format!("{address}/24");
            succeed(
                hosts
                    .on(k, "ip")
                    .args(["addr", "add", &address, "dev", "up0"]),
            );
            succeed(hosts.on(k, "ip").args(["link", "set", "up0", "up"]));
        }
        // Starts what mpirun runs on the other host, as ssh would.
        let agent = format!("#!/bin/sh\nshift\nexec nsenter -t {b} -n -u -m sh -c \"$*\"\n");
        std::fs::write(hosts.agent(), agent).expect("written");
        succeed(Command::new("chmod").arg("+x").arg(hosts.agent()));
        assert_ne!(a, b);
        Some(hosts)
    }

    fn agent(&self) -> PathBuf {
        self.folder.path().join("agent")
    }

    /// A program on a host.
    fn on(&self, host: usize, program: impl AsRef<Path>) -> Command {
        let mut command = Command::new("nsenter");
        let kept = self.kept[host].id().to_string();
        command
            .args(["-t", &kept, "-n", "-u", "-m"])
            .arg(program.as_ref());
        command
    }

    /// gshear-mpi on so many ranks of each host, started on the first.
    fn both(&self, ranks: [usize; 2], arguments: &[String]) -> Command {
        let job = mpirun(ranks[0] + ranks[1], PROGRAM);
        let mut command = self.on(0, job.get_program());
        for (name, value) in job.get_envs() {
            match value {
                Some(value) => command.env(name, value),
                None => command.env_remove(name),
            };
        }
        let hosts = [0, 1].map(|k| format!("{}:{}", ADDRESSES[k], ranks[k]));
        command.args(["--mca", "plm", "rsh", "--mca", "plm_rsh_agent"]);
        command.arg(self.agent()).args(["--host", &hosts.join(",")]);
        command.args(job.get_args()).args(arguments);
        command
    }
}

impl Drop for Hosts {
    fn drop(&mut self) {
        for child in &mut self.kept {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn skipped(why: &str) -> Option<Hosts> {
    println!("skipped: no network namespaces here: {why}");
    None
}

fn outcome(command: &mut Command) -> Outcome {
    let output = command.output().expect("the program starts");
    Outcome {
        code: output.status.code().unwrap_or(-1),
        text: String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr),
    }
}

/// Waits until this holds.
fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(
            begun.elapsed() < Duration::from_mins(4),
            "waited for {what}"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// One test at a time: ranks that wait for each other spin, and links are cut in time.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Processes whose arguments name this folder.
fn processes(folder: &Path) -> usize {
    let folder = folder.display().to_string();
    let entries = std::fs::read_dir("/proc").expect("processes").flatten();
    entries
        .filter(|entry| {
            let arguments = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
            String::from_utf8_lossy(&arguments).contains(&folder)
        })
        .count()
}

#[test]
fn ranks_on_two_hosts_give_the_same_bits() {
    let _alone = alone();
    let Some(hosts) = Hosts::new() else { return };
    let at = |name: &str| hosts.folder.path().join(name);
    let packed = [SCENE, SHORT, "--stop-at=1"].map(String::from);
    assert_eq!(gshear_mpi(1, &at("packed"), &packed).code, 75);
    let from = [format!("--resume={}", at("packed/checkpoint.h5").display())];
    let digest = gshear_mpi(1, &at("one"), &from).digest();
    // One rank on each; two on one host, which share memory, and one on the other.
    for ranks in [[1, 1], [2, 1]] {
        let out = at(&format!("two-{}", ranks[0]));
        let arguments = [from[0].clone(), format!("--out={}", out.display())];
        let run = outcome(&mut hosts.both(ranks, &arguments));
        assert_eq!(run.digest(), digest, "{ranks:?}");
        same_run(&at("one"), &out);
    }
}

#[test]
fn a_cut_link_ends_all_ranks() {
    let _alone = alone();
    let Some(hosts) = Hosts::new() else { return };
    let at = |name: &str| hosts.folder.path().join(name);
    let end = "--set=shear.strain=0.3";
    let digest = gshear_mpi(1, &at("one"), &[SCENE, end].map(String::from)).digest();
    let packed = [SCENE, end, "--stop-at=1"].map(String::from);
    assert_eq!(gshear_mpi(1, &at("cut"), &packed).code, 75);
    let checkpoint = at("cut/checkpoint.h5");
    let modified = || std::fs::metadata(&checkpoint).and_then(|file| file.modified());
    let before = modified().expect("a time");
    let out = format!("--out={}", at("cut").display());
    let set = ["bookkeeping.watchdog=1", "output.checkpoint_strain=0.002"];
    let mut arguments: Vec<String> = set.iter().map(|set| format!("--set={set}")).collect();
    arguments.extend([SCENE.into(), end.into(), "--resume=auto".into(), out]);
    let mut job = hosts.both([2, 1], &arguments);
    job.stdout(Stdio::null()).stderr(Stdio::piped());
    let job = job.spawn().expect("mpirun starts");
    until("a checkpoint on both hosts", || {
        modified().is_ok_and(|time| time != before)
    });
    succeed(hosts.on(0, "ip").args(["link", "set", "up0", "down"]));
    let cut = Instant::now();
    let ended = job.wait_with_output().expect("its end");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert!(
        said.contains("error: a rank of another node does not answer"),
        "{said}"
    );
    // Those of the other host, too. Ten times the limit for ranks that cannot be seen.
    until("the end of all ranks", || processes(&at("cut")) == 0);
    assert!(
        cut.elapsed() < Duration::from_mins(1),
        "{:?}",
        cut.elapsed()
    );
    succeed(hosts.on(0, "ip").args(["link", "set", "up0", "up"]));
    let resumed = outcome(&mut hosts.both([1, 1], &arguments[1..]));
    assert_eq!(resumed.digest(), digest);
}

/// A program that ends with its test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A run with its results in `out`, started on one rank of a host.
fn started(hosts: &Hosts, host: usize, out: &Path) -> Running {
    let mut run = hosts.on(host, PROGRAM);
    run.arg(SCENE).args(LONG).arg("--out").arg(out);
    let run = run.stdout(Stdio::null()).spawn();
    let run = Running(run.expect("the program starts"));
    until("a checkpoint", || out.join("checkpoint.h5").exists());
    run
}

#[test]
fn a_lock_holds_on_the_other_host() {
    let _alone = alone();
    let Some(hosts) = Hosts::new() else { return };
    let out = hosts.folder.path().join("out");
    let lock = out.join("run.lock");
    let owner = started(&hosts, 0, &out);
    let beside = |more: &[&str]| {
        let mut run = hosts.on(1, PROGRAM);
        outcome(run.arg(SCENE).args(LONG).arg("--out").arg(&out).args(more))
    };
    let refused = |run: &Outcome| {
        assert_eq!(run.code, 2, "{}", run.text);
        let holder = format!("process {} on {}", owner.0.id(), hosts.names[0]);
        assert!(run.text.contains(&holder), "{}", run.text);
    };
    let folder = format!("--resume={}", out.display());
    let mut continued = hosts.on(1, PROGRAM);
    let begun = Instant::now();
    refused(&outcome(continued.arg(&folder)));
    assert!(begun.elapsed() < Duration::from_secs(10), "at once");
    // As a job that is requeued: once the owner has renewed its lock.
    let requeued = beside(&["--resume=auto"]);
    refused(&requeued);
    assert!(requeued.text.contains("note: "), "{}", requeued.text);
    assert!(lock.exists());

    // The host fails: nobody removes the lock, and no process of it can be seen from the other.
    drop(owner);
    let mut continued = hosts.on(1, PROGRAM);
    let run = outcome(continued.arg(&folder));
    assert_eq!(run.code, 2, "{}", run.text);
    // Five minutes later.
    let age = |seconds: u64| {
        let file = std::fs::OpenOptions::new().write(true).open(&lock);
        let then = SystemTime::now() - Duration::from_secs(seconds);
        file.and_then(|file| file.set_modified(then)).expect("aged");
    };
    age(297);
    let begun = Instant::now();
    let run = beside(&["--resume=auto", "--walltime=5s"]);
    assert_eq!(run.code, 75, "{}", run.text);
    assert!(
        run.text.contains("is gone; took the lock over"),
        "{}",
        run.text
    );
    // What it waited for the lock counts.
    let time = begun.elapsed();
    assert!(
        time > Duration::from_secs(2) && time < Duration::from_secs(30),
        "{time:?}"
    );
    assert!(!lock.exists());
}
