//! On a Slurm of this machine that is started for the tests, if it is installed.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{missing, succeed};
use crate::{ENDLESS, LONG, Project, SHORT, is_resumed, launch, same, until, whole};

/// A Slurm of one node with its daemons.
struct Slurm {
    daemons: Vec<Child>,
    folder: tempfile::TempDir,
}

impl Slurm {
    /// `None`, with a message, where it is not installed or does not start.
    fn start() -> Option<Self> {
        for program in ["munged", "slurmctld", "slurmd", "sbatch"] {
            if missing(program) {
                println!("skipped: Slurm is not installed: no {program}");
                return None;
            }
        }
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let host = fs::read_to_string("/proc/sys/kernel/hostname").expect("a name");
        let host = host.trim().split('.').next().expect("a name").to_string();
        let listeners = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").expect("a port"));
        let [control, node] = listeners.map(|l| l.local_addr().expect("a port").port());
        let user = succeed(Command::new("id").arg("-un")).stdout;
        let user = String::from_utf8_lossy(&user).trim().to_string();
        let path = folder.path().display();
        // A requeued job waits for cred_expire.
        let configuration = format!(
            "ClusterName=test\nSlurmctldHost={host}(127.0.0.1)\n\
             SlurmctldPort={control}\nSlurmdPort={node}\nSlurmUser={user}\nSlurmdUser={user}\n\
             AuthType=auth/munge\nAuthInfo=socket={path}/munge.socket,cred_expire=6\n\
             ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\n\
             SelectType=select/cons_tres\nSelectTypeParameters=CR_Core\n\
             JobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\n\
             ReturnToService=2\nMpiDefault=pmix\nKillWait=20\nSlurmdParameters=config_overrides\n\
             StateSaveLocation={path}/state\nSlurmdSpoolDir={path}/spool\n\
             SlurmctldPidFile={path}/slurmctld.pid\nSlurmdPidFile={path}/slurmd.pid\n\
             SchedulerParameters=sched_interval=1,batch_sched_delay=1,sched_min_interval=100000\n\
             NodeName={host} NodeAddr=127.0.0.1 CPUs=16 State=UNKNOWN\n\
             PartitionName=test Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n"
        );
        fs::write(at("slurm.conf"), configuration).expect("written");
        let mut key = [0; 1024];
        let random = fs::File::open("/dev/urandom");
        let read = random.and_then(|mut random| random.read_exact(&mut key));
        read.and_then(|()| fs::write(at("munge.key"), key))
            .expect("a key");
        succeed(Command::new("chmod").arg("0400").arg(at("munge.key")));
        // Every user may connect to the socket; only the owner may write into its folder.
        succeed(Command::new("chmod").arg("0755").arg(folder.path()));
        let mut munge = Command::new("munged");
        munge.args(["--foreground", "--force"]);
        for (option, name) in [
            ("socket", "munge.socket"),
            ("key-file", "munge.key"),
            ("pid-file", "munge.pid"),
            ("seed-file", "munge.seed"),
        ] {
            munge.arg(format!("--{option}={}", at(name).display()));
        }
        let mut slurmctld = Command::new("slurmctld");
        let mut slurmd = Command::new("slurmd");
        slurmctld.arg("-D");
        slurmd.args(["-D", "-N", &host]);
        let mut slurm = Self {
            daemons: Vec::new(),
            folder,
        };
        for (name, daemon) in [
            ("munged", &mut munge),
            ("slurmctld", &mut slurmctld),
            ("slurmd", &mut slurmd),
        ] {
            let log = fs::File::create(slurm.at(&format!("{name}.log"))).expect("a log");
            let again = log.try_clone().expect("a log");
            daemon.env("SLURM_CONF", slurm.at("slurm.conf"));
            let daemon = daemon.stdout(log).stderr(again).stdin(Stdio::null());
            slurm.daemons.push(daemon.spawn().expect("a daemon"));
            let begun = Instant::now();
            while name == "munged"
                && !slurm.at("munge.socket").exists()
                && begun.elapsed() < Duration::from_secs(10)
            {
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        let begun = Instant::now();
        while !slurm
            .says("sinfo", &["--noheader", "--format=%T"])
            .contains("idle")
        {
            if begun.elapsed() > Duration::from_secs(30) {
                println!("skipped: Slurm does not start:");
                for name in ["munged", "slurmctld", "slurmd"] {
                    let log = fs::read_to_string(slurm.at(&format!("{name}.log")));
                    println!("{}", log.unwrap_or_default());
                }
                return None;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        if !slurm.says("srun", &["--mpi=list"]).contains("pmix") {
            println!("skipped: this Slurm has no pmix");
            return None;
        }
        Some(slurm)
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("SLURM_CONF", self.at("slurm.conf"));
        command
    }

    fn says(&self, program: &str, arguments: &[&str]) -> String {
        let output = self.command(program).args(arguments).output();
        let output = output.expect("a command of Slurm");
        String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr)
    }

    /// Submits slurm.sh from the project and returns the id of the job.
    fn submit(
        &self,
        project: &Project,
        variables: &[(&str, &str)],
        options: &[&str],
        arguments: &[&str],
    ) -> String {
        let mut sbatch = self.command("sbatch");
        sbatch.envs(variables.iter().copied()).arg("--parsable");
        sbatch
            .args(options)
            .arg("job-scripts/slurm.sh")
            .args(arguments);
        let id = succeed(sbatch.current_dir(project.path())).stdout;
        String::from_utf8_lossy(&id).trim().to_string()
    }

    /// What Slurm says of a job, or of every task of an array.
    fn show(&self, job: &str) -> Vec<BTreeMap<String, String>> {
        let text = self.says("scontrol", &["--oneliner", "show", "job", job]);
        let fields = |line: &str| {
            let words = line.split_whitespace();
            let pairs = words.filter_map(|word| word.split_once('='));
            pairs.map(|(k, v)| (k.to_string(), v.to_string())).collect()
        };
        text.lines().map(fields).collect()
    }

    /// State, exit code and number of restarts of a job that has ended.
    fn ended(&self, job: &str) -> String {
        until(&format!("the end of job {job}"), || {
            let found = self.show(job);
            let all = found.iter().map(|task| {
                let field = |name: &str| task.get(name).map_or("", String::as_str);
                format!(
                    "{} {} {}",
                    field("JobState"),
                    field("ExitCode"),
                    field("Restarts")
                )
            });
            let mut all: Vec<String> = all.collect();
            all.dedup();
            let ends = [
                "COMPLETED ",
                "FAILED ",
                "CANCELLED ",
                "TIMEOUT ",
                "NODE_FAIL ",
            ];
            let ended = all
                .iter()
                .all(|state| ends.iter().any(|end| state.starts_with(end)));
            ended.then(|| all.join(", "))
        })
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // After a test that failed.
        self.says("scancel", &["--partition=test"]);
        for _ in 0..100 {
            if self.says("squeue", &["--noheader"]).is_empty() {
                break;
            }
            std::thread::sleep(Duration::from_millis(100));
        }
        for daemon in self.daemons.iter_mut().rev() {
            let _ = Command::new("sh")
                .args(["-c", &format!("kill {}", daemon.id())])
                .status();
            let _ = daemon.wait();
        }
    }
}

/// Everything on one Slurm, all jobs at once: they wait more than they compute.
#[test]
fn jobs_of_slurm() {
    let Some(slurm) = Slurm::start() else { return };
    let cases: [fn(&Slurm); 6] = [
        slurm_runs_one_job,
        slurm_runs_an_array,
        slurm_runs_a_chain,
        slurm_requeues_a_job,
        slurm_cancels_a_chain,
        slurm_sees_how_jobs_end,
    ];
    std::thread::scope(|scope| {
        let cases: Vec<_> = cases
            .iter()
            .map(|case| scope.spawn(|| case(&slurm)))
            .collect();
        for case in cases {
            if let Err(failure) = case.join() {
                std::panic::resume_unwind(failure);
            }
        }
    });
}

fn slurm_runs_one_job(slurm: &Slurm) {
    let project = Project::new();
    let options = ["--cpus-per-task=2", "--job-name=one"];
    let job = slurm.submit(&project, &[], &options, &["my.toml", SHORT[0]]);
    assert_eq!(slurm.ended(&job), "COMPLETED 0:0 0");
    project.run(&["my.toml", SHORT[0], "--out=whole"]);
    same(&project, "whole", "out/my");
    let log = project.text(&format!("one-{job}.log"));
    for part in [
        "--cpus-per-task=2",
        "--threads 2",
        "--walltime 86",
        "2 ranks",
    ] {
        assert!(log.contains(part), "no {part} in {log}");
    }
    // The same line again.
    let again = slurm.submit(&project, &[], &options, &["my.toml", SHORT[0]]);
    assert_eq!(slurm.ended(&again), "COMPLETED 0:0 0");
    let log = project.text(&format!("one-{again}.log"));
    assert!(log.contains("the run is finished"), "{log}");
}

fn slurm_runs_an_array(slurm: &Slurm) {
    let project = Project::new();
    let options = ["--ntasks=1", "--array=1-4"];
    let job = slurm.submit(&project, &[], &options, &["sweep.toml", SHORT[0]]);
    project.run(&["sweep.toml", SHORT[0], "--sweep=all", "--out=whole"]);
    assert_eq!(slurm.ended(&job), "COMPLETED 0:0 0");
    let entries = fs::read_dir(project.at("whole")).expect("the runs");
    let names = entries.map(|e| e.expect("a run").file_name().into_string().expect("a name"));
    let names: Vec<String> = names.collect();
    assert_eq!(names.len(), 4);
    for name in names {
        same(
            &project,
            format!("whole/{name}"),
            &format!("out/sweep/{name}"),
        );
    }
    let tasks = slurm.show(&job);
    assert_eq!(tasks.len(), 4);
    for task in tasks {
        let log = project.text(&format!("gshear-{}.log", task["JobId"]));
        assert!(log.contains("--walltime 86"), "{log}");
    }
}

fn slurm_runs_a_chain(slurm: &Slurm) {
    let project = Project::new();
    let arguments = [&["my.toml"], &LONG[..]].concat();
    let of_stops = |name, stops| launch(name, stops, "srun --mpi=pmix --cpus-per-task=1");
    let one = ["--ntasks=1"];
    let chain = slurm.submit(
        &project,
        &[("CHAIN", "30"), ("LAUNCH", &of_stops("chain", 2))],
        &one,
        &arguments,
    );
    // One that is too short: it stops early, and Slurm sees it.
    let more = [&arguments[..], &["--out=out/short"]].concat();
    let short = slurm.submit(
        &project,
        &[("CHAIN", "2"), ("LAUNCH", &of_stops("short", 2))],
        &one,
        &more,
    );
    assert_eq!(slurm.ended(&chain), "COMPLETED 0:0 2");
    same(&project, whole(), "out/my");
    assert!(is_resumed(&project.at("out/my")));
    let log = project.text(&format!("gshear-{chain}.log"));
    let stops = log.matches("goes back into the queue").count();
    assert_eq!(stops, 2, "{log}");
    assert_eq!(slurm.ended(&short), "FAILED 75:0 1");
    let log = project.text(&format!("gshear-{short}.log"));
    let last = "after the last job of the chain (CHAIN=2)";
    assert!(log.contains(last), "{log}");
}

/// As an administrator, a preemption or a failed node do.
fn slurm_requeues_a_job(slurm: &Slurm) {
    let project = Project::new();
    let arguments = [&["my.toml"], &LONG[..]].concat();
    let job = slurm.submit(&project, &[], &["--ntasks=1"], &arguments);
    let shears = || project.at("out/my/run.h5").exists().then_some(());
    until("the shear", shears);
    slurm.says("scontrol", &["requeue", &job]);
    assert_eq!(slurm.ended(&job), "COMPLETED 0:0 1");
    same(&project, whole(), "out/my");
    assert!(is_resumed(&project.at("out/my")), "it started again");
}

fn slurm_cancels_a_chain(slurm: &Slurm) {
    let project = Project::new();
    let arguments = [&["my.toml"], &LONG[..]].concat();
    let chain = [("CHAIN", "9")];
    let job = slurm.submit(&project, &chain, &["--ntasks=1"], &arguments);
    until("the shear", || {
        project.at("out/my/run.h5").exists().then_some(())
    });
    slurm.says("scancel", &[&job]);
    let ended = slurm.ended(&job);
    assert!(
        ended.starts_with("CANCELLED ") && ended.ends_with(" 0"),
        "{ended}"
    );
    assert!(project.at("out/my/checkpoint.h5").exists());
    assert!(!project.at("out/my/run.lock").exists());
    let again = slurm.submit(&project, &chain, &["--ntasks=1"], &arguments);
    assert_eq!(slurm.ended(&again), "COMPLETED 0:0 0");
    same(&project, whole(), "out/my");
    assert!(is_resumed(&project.at("out/my")));
}

fn slurm_sees_how_jobs_end(slurm: &Slurm) {
    let project = Project::new();
    let chain = [("CHAIN", "9")];
    let submit = |variables: &[(&str, &str)], options: &[&str], arguments: &[&str]| {
        let options = [&["--ntasks=1"], options].concat();
        slurm.submit(&project, variables, &options, arguments)
    };
    let bad = submit(&chain, &[], &["my.toml", "--set=seed=-1"]);
    let soft = ["my.toml", "--set=pack.max_steps=2000", "--out=out/soft"];
    let failing = submit(&chain, &[], &soft);
    let nothing = submit(&chain, &[], &[]);
    let elsewhere = submit(&[("JOB_SCRIPTS", "nowhere")], &[], &["my.toml"]);
    // Slurm's signal, since the program's own clock leaves it all of the time.
    let stopped = submit(
        &[("MARGIN", "0")],
        &["--time=1", "--signal=USR1@50"],
        &["my.toml", ENDLESS[0], ENDLESS[1], "--out=out/stopped"],
    );
    let killed = submit(
        &chain,
        &[],
        &["my.toml", ENDLESS[0], ENDLESS[1], "--out=out/killed"],
    );
    // The rank is killed, as by a machine without memory.
    let lock = until("the shear", || {
        let shears = project.at("out/killed/run.h5").exists();
        shears.then(|| project.text("out/killed/run.lock"))
    });
    let (_, process) = lock.split_once("\"pid\":").expect("a process");
    let process: String = process.chars().take_while(char::is_ascii_digit).collect();
    succeed(Command::new("sh").args(["-c", &format!("kill -KILL {process}")]));
    for (job, code) in [
        (bad, 2),
        (failing, 3),
        (nothing, 2),
        (elsewhere, 2),
        (stopped, 75),
    ] {
        assert_eq!(slurm.ended(&job), format!("FAILED {code}:0 0"));
        let log = project.text(&format!("gshear-{job}.log"));
        assert!(log.contains("error: ") || code == 75, "{log}");
    }
    assert_eq!(slurm.ended(&killed), "FAILED 137:0 0");
}
