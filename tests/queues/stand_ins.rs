//! PBS and LSF with stand-ins for their commands, which check the flow of the scripts and nothing
//! of PBS and LSF.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::succeed;
use crate::{LONG, Project, ROOT, SHORT, launch, same, whole};

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
        let commands = Path::new(ROOT).join("tests/queues/commands");
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
        let mut qsub = Command::new(Path::new(ROOT).join("tests/queues/commands/qsub"));
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
    let laid_out = Pbs::new(&project, "laid out");
    let variables = format!(
        "CONFIG=my.toml,OPTIONS={} --out=out/laid,LAYOUT=auto",
        SHORT[0]
    );
    laid_out.submit(&["-v", &variables]);
    let [(code, text)] = &laid_out.run()[..] else {
        panic!("one job")
    };
    assert_eq!(*code, 0, "{text}");
    assert!(
        text.contains("layout: 2 ranks of 1 threads on 1 nodes of 2 cores"),
        "{text}"
    );
    assert!(text.contains("--map-by ppr:2:node"), "{text}");
    project.run(&["my.toml", SHORT[0], "--out=whole"]);
    same(&project, "whole", "out/laid");
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

    // Two runs at a time in each of two jobs; the second one has the rest of them.
    let packed = Pbs::new(&project, "packed");
    let variables = format!(
        "CONFIG=sweep.toml,OPTIONS={} --out=out/packed,RUNS=3",
        SHORT[0]
    );
    let of_three = "select=1:ncpus=3:mpiprocs=3";
    packed.submit(&[
        "-J", "1-2", "-l", of_three, "-l", walltime, "-v", &variables,
    ]);
    for ((code, text), said) in packed.run().iter().zip([
        ["--sweep 1-3 --jobs 3 --ranks 1", "3 of 3 runs are done"],
        ["--sweep 4-6 --jobs 3 --ranks 1", "1 of 1 runs are done"],
    ]) {
        assert_eq!(*code, 0, "{text}");
        for part in said {
            assert!(text.contains(part), "no {part} in {text}");
        }
    }

    for (variables, code) in [
        ("CONFIG=my.toml,OPTIONS=--set=seed=-1,CHAIN=9", 2),
        ("CONFIG=sweep.toml,RUNS=2", 2),
        ("CHAIN=9", 2),
        ("CONFIG=my.toml,CHAIN=many", 2),
        ("CONFIG=my.toml,JOB_SCRIPTS=nowhere", 2),
        (
            "CONFIG=my.toml,OPTIONS=--set=pack.max_steps=2000 --out=out/soft,CHAIN=9",
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

/// The flow of lsf.sh alone: bjobs is a stand-in, and this puts jobs back into the queue as bsub
/// -Q.
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
        (vec![("CONFIG", "my.toml"), ("THREADS", "0")], 2),
    ] {
        assert_eq!(job("9", "0", &variables).run().0, code, "{variables:?}");
    }
    assert_eq!(project.text("gshear-9.log").matches("error: ").count(), 5);
}
