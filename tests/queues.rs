//! The job scripts: on a Slurm of this machine and on a Flux instance, where they are installed;
//! those of PBS and LSF with stand-ins for the commands of the batch system, which check the flow of
//! the scripts and nothing of PBS and LSF.

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use common::{same_run, succeed};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const PROGRAM: &str = env!("CARGO_BIN_EXE_gshear-mpi");
/// A few seconds of computing.
const LONG: [&str; 3] = [
    "--set=shear.strain=20",
    "--set=output.frame_strain=1",
    "--set=output.series_strain=0.1",
];
const SHORT: [&str; 1] = ["--set=shear.strain=0.1"];
/// Longer than any test.
const ENDLESS: [&str; 2] = ["--set=shear.strain=5000", "--set=output.frame_strain=10"];

/// A folder from which jobs are submitted: the scripts, the program, a scene and a sweep.
struct Project(tempfile::TempDir);

impl Project {
    fn new() -> Self {
        let project = Self(tempfile::tempdir().expect("a folder"));
        let link = |from: &Path, to: &str| {
            let to = project.at(to);
            fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
            std::os::unix::fs::symlink(from, to).expect("a link");
        };
        link(&Path::new(ROOT).join("job-scripts"), "job-scripts");
        link(Path::new(PROGRAM), "target/release/gshear-mpi");
        let scene = fs::read_to_string(common::crossing::SCENE).expect("the scene");
        fs::write(project.at("my.toml"), &scene).expect("a scene");
        let sweep = "\n[sweep]\n\"contact.friction\" = [0.2, 0.5]\nseed = [5, 6]\n";
        fs::write(project.at("sweep.toml"), scene + sweep).expect("a sweep");
        project
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.at(name)).unwrap_or_default()
    }

    /// The program itself, on one rank.
    fn run(&self, arguments: &[&str]) {
        let mut command = Command::new(PROGRAM);
        succeed(command.args(arguments).current_dir(self.path()));
    }
}

/// The folder of a run has it up to its end, with the bits of another run.
fn same(project: &Project, whole: impl AsRef<Path>, run: &str) {
    assert!(!project.at(run).join("run.lock").exists(), "{run}");
    same_run(&project.at("").join(whole), &project.at(run));
}

/// The folder of the long run in one piece.
fn whole() -> &'static Path {
    static WHOLE: OnceLock<PathBuf> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("queues");
        let mut run = Command::new(PROGRAM);
        run.arg(common::crossing::SCENE)
            .args(LONG)
            .arg("--overwrite");
        succeed(run.arg("--out").arg(&folder));
        folder
    })
}

/// LAUNCH for jobs of which the first `stops` stop early.
fn launch(name: &str, stops: usize, ranks: &str) -> String {
    format!("{ROOT}/tests/queues/stops {name} {stops} {ranks}")
}

/// Whether a run was resumed.
fn is_resumed(folder: &Path) -> bool {
    let scene = fs::read_to_string(folder.join("scene.toml")).expect("scene.toml");
    scene.contains("# resumed at ")
}

fn missing(program: &str) -> bool {
    let found = Command::new("sh")
        .args(["-c", &format!("command -v {program}")])
        .output();
    !found.is_ok_and(|found| found.status.success())
}

/// Waits for a value.
fn until<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let begun = Instant::now();
    loop {
        if let Some(value) = look() {
            return value;
        }
        assert!(
            begun.elapsed() < Duration::from_mins(4),
            "waited for {what}"
        );
        std::thread::sleep(Duration::from_millis(100));
    }
}

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
        // Others may use the socket, nobody may write beside it.
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
    let soft = [
        "my.toml",
        "--set=load.stiffness_number=11.0",
        "--out=out/soft",
    ];
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

/// A job as a batch system starts it: with few variables, in another folder, from a copy.
struct Job<'a> {
    project: &'a Project,
    script: PathBuf,
    variables: Vec<(String, String)>,
}

impl Job<'_> {
    /// Its exit code, and what it printed.
    fn run(&self) -> (i32, String) {
        let path = std::env::var("PATH").expect("a path");
        let commands = Path::new(ROOT).join("tests/queues");
        let mut command = Command::new("bash");
        command.arg(&self.script).current_dir("/").env_clear();
        command.env("PATH", format!("{}:{path}", commands.display()));
        command.env("HOME", self.project.path());
        command.env("OMPI_MCA_rmaps_base_oversubscribe", "1");
        command.envs(self.variables.iter().map(|(k, v)| (k, v)));
        let output = command.output().expect("bash starts");
        let text = String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr);
        (output.status.code().unwrap_or(-1), text)
    }
}

/// A PBS with stand-ins for qsub and qstat.
struct Pbs<'a> {
    project: &'a Project,
    queue: PathBuf,
}

impl<'a> Pbs<'a> {
    fn new(project: &'a Project, name: &str) -> Self {
        let queue = project.at(name);
        fs::create_dir(&queue).expect("a folder");
        Self { project, queue }
    }

    fn submit(&self, options: &[&str]) {
        let mut qsub = Command::new(Path::new(ROOT).join("tests/queues/qsub"));
        qsub.env("QUEUE", &self.queue)
            .current_dir(self.project.path());
        succeed(qsub.args(options).arg("job-scripts/pbs.sh"));
    }

    fn value(&self, number: usize, key: &str) -> String {
        let path = self.queue.join(format!("{number}/{key}.txt"));
        fs::read_to_string(path)
            .unwrap_or_default()
            .trim()
            .to_string()
    }

    /// Runs all jobs, and those that they submit, in turn; their exit codes and what they printed.
    fn run(&self) -> Vec<(i32, String)> {
        let mut ended = Vec::new();
        for number in 1.. {
            if !self.queue.join(number.to_string()).exists() {
                break;
            }
            let nodes = self.queue.join(format!("{number}/nodes"));
            let select = self.value(number, "select");
            let ranks = select.rsplit_once("mpiprocs=").expect("ranks").1;
            let ranks = ranks.parse().expect("a number");
            fs::write(&nodes, "localhost\n".repeat(ranks)).expect("written");
            let array = self.value(number, "array");
            let tasks: Vec<String> = match array.split_once('-') {
                Some((first, last)) => {
                    let [first, last] = [first, last].map(|n| n.parse().expect("a number"));
                    (first..=last).map(|task: u32| task.to_string()).collect()
                }
                None => vec![String::new()],
            };
            for task in tasks {
                let given = self.value(number, "environment");
                let given = given.lines().filter_map(|line| line.split_once('='));
                let mut variables: Vec<(String, String)> =
                    given.map(|(k, v)| (k.into(), v.into())).collect();
                let mut id = format!("{number}.server");
                if !task.is_empty() {
                    id = format!("{number}[{task}].server");
                    variables.push(("PBS_ARRAY_INDEX".into(), task));
                }
                for (name, value) in [
                    ("PBS_JOBID", id),
                    ("PBS_JOBNAME", self.value(number, "name")),
                    ("PBS_O_WORKDIR", self.value(number, "cwd")),
                    ("PBS_O_QUEUE", self.value(number, "queue")),
                    ("PBS_NODEFILE", nodes.display().to_string()),
                    ("QUEUE", self.queue.display().to_string()),
                ] {
                    variables.push((name.into(), value));
                }
                let script = self.queue.join(format!("{number}/script"));
                let project = self.project;
                ended.push(
                    Job {
                        project,
                        script,
                        variables,
                    }
                    .run(),
                );
            }
        }
        ended
    }
}

/// The flow of pbs.sh alone: qsub and qstat are stand-ins.
#[test]
fn jobs_of_pbs_with_stand_ins() {
    let project = Project::new();
    let options = LONG.join(" ");
    let (config, set) = (
        "CONFIG=my.toml",
        format!("OPTIONS={options} --out=out/chain"),
    );
    let one = Pbs::new(&project, "one");
    one.submit(&[
        "-v",
        &format!("CONFIG=my.toml,OPTIONS={},THREADS=2", SHORT[0]),
    ]);
    let [(code, text)] = &one.run()[..] else {
        panic!("one job")
    };
    assert_eq!(*code, 0, "{text}");
    for part in ["2 ranks", "--threads 2", "--walltime 862"] {
        assert!(text.contains(part), "no {part} in {text}");
    }
    project.run(&["my.toml", SHORT[0], "--out=whole"]);
    same(&project, "whole", "out/my");

    let chain = Pbs::new(&project, "chain");
    let stops = launch("chain", 2, "mpirun -n 1");
    let variables = format!("{config},{set},CHAIN=30,LAUNCH={stops}");
    let resources = ["select=1:ncpus=1:mpiprocs=1", "walltime=00:01:00"];
    let [select, walltime] = resources;
    let of_chain = [
        "-N", "mine", "-q", "short", "-A", "grains", "-l", select, "-l", walltime,
    ];
    chain.submit(&[&of_chain[..], &["-v", &variables]].concat());
    let jobs = chain.run();
    assert_eq!(jobs.len(), 3);
    for (number, (code, text)) in jobs.iter().enumerate() {
        assert_eq!(*code, 0, "{text}");
        let last = number + 1 == jobs.len();
        assert_eq!(
            text.contains("stopped early; goes on as job"),
            !last,
            "{text}"
        );
        for (key, value) in [
            ("name", "mine"),
            ("queue", "short"),
            ("account", "grains"),
            ("select", "1:ncpus=1:mpiprocs=1"),
            ("walltime", "00:01:00"),
        ] {
            assert_eq!(chain.value(number + 1, key), value);
        }
    }
    same(&project, whole(), "out/chain");

    // Each task of an array goes on by itself, and the chain ends after its last job.
    let array = Pbs::new(&project, "array");
    let stops = launch("array", 2, "mpirun -n 1");
    let variables = format!("CONFIG=sweep.toml,OPTIONS={options},CHAIN=2,LAUNCH={stops}");
    array.submit(&["-J", "2-3", "-l", select, "-l", walltime, "-v", &variables]);
    let jobs = array.run();
    let codes: Vec<i32> = jobs.iter().map(|job| job.0).collect();
    assert_eq!(codes, [0, 0, 75, 75], "{jobs:?}");
    for (job, run) in [(0, 2), (1, 3), (2, 2), (3, 3)] {
        let begins = format!("sweep: run {run} of 4");
        assert!(jobs[job].1.contains(&begins), "{}", jobs[job].1);
    }

    for (variables, code) in [
        ("CONFIG=my.toml,OPTIONS=--set=seed=-1,CHAIN=9", 2),
        ("CHAIN=9", 2),
        ("CONFIG=my.toml,CHAIN=many", 2),
        ("CONFIG=my.toml,JOB_SCRIPTS=nowhere", 2),
        (
            "CONFIG=my.toml,OPTIONS=--set=load.stiffness_number=11.0 --out=out/soft,CHAIN=9",
            3,
        ),
    ] {
        let failing = Pbs::new(&project, &format!("fails {variables}").replace('/', "-"));
        failing.submit(&["-l", select, "-v", variables]);
        let [(found, text)] = &failing.run()[..] else {
            panic!("a chain of failures")
        };
        assert_eq!(*found, code, "{text}");
        assert!(text.contains("error: "), "{text}");
    }
}

/// The flow of lsf.sh alone: bjobs is a stand-in, and this puts jobs back into the queue as bsub -Q.
#[test]
fn jobs_of_lsf_with_stand_ins() {
    let project = Project::new();
    let job = |id: &str, index: &str, more: &[(&str, &str)]| {
        let (name, job) = match index {
            "0" => ("gshear".to_string(), id.to_string()),
            _ => (format!("gshear[{index}]"), format!("{id}[{index}]")),
        };
        let at = project.path().display().to_string();
        let variables = [
            ("LSB_JOBID", id),
            ("LSB_JOBINDEX", index),
            ("LSB_JOBNAME", &name),
            ("LS_SUBCWD", &at),
            ("LSB_DJOB_NUMPROC", "1"),
            ("JOB", &job),
            ("TIME_LEFT", "0:01"),
        ];
        let all = variables.iter().chain(more);
        let script = project.at(&format!("spooled.{id}"));
        fs::copy(Path::new(ROOT).join("job-scripts/lsf.sh"), &script).expect("a copy");
        Job {
            project: &project,
            script,
            variables: all.map(|(k, v)| ((*k).into(), (*v).into())).collect(),
        }
    };
    let (options, stops) = (LONG.join(" "), launch("chain", 2, "mpirun -n 1"));
    let chain = job(
        "7",
        "0",
        &[
            ("CONFIG", "my.toml"),
            ("OPTIONS", &options),
            ("LAUNCH", &stops),
        ],
    );
    let codes = [(); 4].map(|()| chain.run().0);
    assert_eq!(codes, [75, 75, 0, 0]);
    same(&project, whole(), "out/my");
    let log = project.text("gshear-7.log");
    assert!(
        log.contains("--walltime ") && log.contains("the run is finished"),
        "{log}"
    );

    let two = [
        ("CONFIG", "sweep.toml"),
        ("OPTIONS", SHORT[0]),
        ("LSB_DJOB_NUMPROC", "2"),
    ];
    let unknown = [("TIME_LEFT", ""), ("THREADS", "2")];
    assert_eq!(job("8", "3", &[&two[..], &unknown].concat()).run().0, 0);
    let log = project.text("gshear-8-3.log");
    for part in [
        "sweep: run 3 of 4",
        "2 ranks",
        "--threads 2",
        "the time left",
    ] {
        assert!(log.contains(part), "no {part} in {log}");
    }
    for (variables, code) in [
        (vec![("CONFIG", "my.toml"), ("OPTIONS", "--set=seed=-1")], 2),
        (vec![], 2),
        (vec![("CONFIG", "my.toml"), ("CHAIN", "9")], 2),
        (vec![("CONFIG", "my.toml"), ("JOB_SCRIPTS", "nowhere")], 2),
    ] {
        assert_eq!(job("9", "0", &variables).run().0, code, "{variables:?}");
    }
    assert_eq!(project.text("gshear-9.log").matches("error: ").count(), 4);
}

/// On an instance of Flux that is started for it.
#[test]
fn jobs_of_flux() {
    if missing("flux") {
        println!("skipped: Flux is not installed");
        return;
    }
    let project = Project::new();
    let script = format!(
        "batch() {{ flux batch -t 10m --signal=USR1@1s --output=none \"$@\"; }}
        J=job-scripts/flux.sh
        one=$(batch -n 2 --output=one.log $J my.toml {short})
        task=$(batch -n 1 --env=INDEX=3 $J sweep.toml {short})
        bad=$(batch -n 1 --env=CHAIN=9 $J my.toml --set=seed=-1)
        chain=$(batch -n 1 --env=CHAIN=30 '--env=LAUNCH={stops}' $J my.toml {long} --out out/chain)
        for job in $one $task $bad $chain; do
            flux job wait-event -t 300 $job clean >/dev/null
            flux job status --exception-exit-code=99 $job 2>/dev/null
            echo ended $?
        done
        flux queue drain
        echo jobs $(flux jobs -a --no-header --format '{{id}}' | wc -l)
        flux jobs -a --no-header --format 'failed {{result}} {{returncode}}' --filter=failed",
        short = SHORT[0],
        long = LONG.join(" "),
        stops = launch("chain", 2, "flux run -n 1"),
    );
    fs::write(project.at("jobs.sh"), script).expect("written");
    let mut flux = Command::new("flux");
    flux.args(["start", "bash", "jobs.sh"])
        .current_dir(project.path());
    let text = String::from_utf8_lossy(&succeed(&mut flux).stdout).into_owned();
    let ended = text.lines().filter_map(|line| line.strip_prefix("ended "));
    assert_eq!(ended.collect::<Vec<_>>(), ["0", "0", "2", "0"], "{text}");
    let log = project.text("one.log");
    assert!(
        log.contains("2 ranks") && log.contains("--walltime 4"),
        "{log}"
    );
    let jobs = text.lines().find_map(|line| line.strip_prefix("jobs "));
    let jobs: usize = jobs.and_then(|n| n.parse().ok()).expect("a number");
    assert_eq!(jobs, 6, "the chain has three jobs: {text}");
    assert!(text.contains("failed FAILED 2"), "{text}");
    project.run(&["my.toml", SHORT[0], "--out=whole"]);
    same(&project, "whole", "out/my");
    project.run(&["sweep.toml", SHORT[0], "--sweep=3", "--out=sweep"]);
    same(
        &project,
        "sweep/friction-0.5_seed-5",
        "out/sweep/friction-0.5_seed-5",
    );
    same(&project, whole(), "out/chain");
}

#[test]
fn job_scripts_are_clean() {
    let at = |folder: &str| {
        let entries = fs::read_dir(Path::new(ROOT).join(folder)).expect("a folder");
        entries.map(|entry| entry.expect("a script").path())
    };
    let scripts: Vec<PathBuf> = at("job-scripts").chain(at("tests/queues")).collect();
    assert_eq!(scripts.len(), 9, "{scripts:?}");
    for script in &scripts {
        succeed(Command::new("bash").arg("-n").arg(script));
    }
    if missing("shellcheck") {
        println!("skipped: shellcheck is not installed");
        return;
    }
    succeed(Command::new("shellcheck").arg("-x").args(&scripts));
}
