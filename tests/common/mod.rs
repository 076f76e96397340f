//! How the tests start programs on ranks.

#![allow(dead_code)]

pub mod crossing;
pub mod environment;
pub mod protocols;
pub mod synthetic;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub use environment::start;
use gshear_store::run_reader::RunFile;

/// The programs under test.
pub const PROGRAM: &str = env!("CARGO_BIN_EXE_gshear-mpi");
pub const REDUCER: &str = env!("CARGO_BIN_EXE_gshear-reduce");

/// gshear-reduce.
pub fn reducer() -> Command {
    start(REDUCER)
}

/// gshear-mpi on ranks; on one without mpirun.
pub fn program(ranks: usize) -> Command {
    if ranks > 1 {
        return mpirun(ranks, PROGRAM);
    }
    start(PROGRAM)
}

/// The program that starts ranks, with its options: the environment's MPIRUN, such as
/// `mpirun.mpich`.
pub fn launcher() -> Vec<String> {
    let given = std::env::var("MPIRUN").unwrap_or_default();
    let words: Vec<String> = given.split_whitespace().map(String::from).collect();
    if words.is_empty() {
        vec!["mpirun".into()]
    } else {
        words
    }
}

/// Whether the tests run with Open MPI; its options and limits are not those of others.
pub fn is_open_mpi() -> bool {
    static ANSWER: std::sync::OnceLock<bool> = std::sync::OnceLock::new();
    *ANSWER.get_or_init(|| {
        let said = start(&launcher()[0]).arg("--version").output();
        let said = said.expect("mpirun starts").stdout;
        String::from_utf8_lossy(&said).contains("Open MPI")
    })
}

/// `mpirun -n ranks program`; ended after 600 s, long
/// though ranks wait for each other on cores that others use.
pub fn mpirun(ranks: usize, program: impl AsRef<Path>) -> Command {
    let words = launcher();
    let mut command = start(&words[0]);
    command.args(&words[1..]).args(["--bind-to", "none"]);
    if is_open_mpi() {
        command.args(["--timeout", "600"]);
    } else {
        command.env("MPIEXEC_TIMEOUT", "600");
    }
    command
        .args(["-n", &ranks.to_string()])
        .arg(program.as_ref());
    command
}

/// First argument of a test binary that is to be a rank of the program it tests.
const AS_RANK: &str = "--as-rank";

/// The arguments of this rank, if this process is one.
pub fn rank_arguments() -> Option<Vec<String>> {
    let mut arguments = std::env::args().skip(1);
    (arguments.next().as_deref() == Some(AS_RANK)).then(|| arguments.collect())
}

/// This test binary with the arguments that make it a rank.
pub fn rank_program() -> [PathBuf; 2] {
    let test = std::env::current_exe().expect("path of this test");
    [test, AS_RANK.into()]
}

/// This test binary on so many ranks.
pub fn on_ranks(ranks: usize) -> Command {
    let [test, as_rank] = rank_program();
    let mut command = mpirun(ranks, test);
    command.arg(as_rank);
    command
}

/// Runs the tests of a binary that has a `main` of its own, as Rust's harness does.
pub fn run_tests(tests: &[(&str, fn())]) -> std::process::ExitCode {
    let trials = tests.iter().map(|&(name, test)| {
        libtest_mimic::Trial::test(name, move || {
            test();
            Ok(())
        })
    });
    let arguments = libtest_mimic::Arguments::from_args();
    libtest_mimic::run(&arguments, trials.collect()).exit_code()
}

/// Its output, after it has ended well; else fails with all that it said.
pub fn succeed(command: &mut Command) -> Output {
    let output = command.output().expect("the program starts");
    assert!(
        output.status.success(),
        "{command:?}: {}\n{}{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// How a run of gshear-mpi ended, and all it said.
pub struct Outcome {
    pub code: i32,
    pub text: String,
}

impl Outcome {
    fn of(output: Output) -> Self {
        Self {
            code: output.status.code().unwrap_or(-1),
            text: String::from_utf8_lossy(&output.stdout).into_owned()
                + &String::from_utf8_lossy(&output.stderr),
        }
    }

    /// The digest of a run that ended well.
    pub fn digest(&self) -> String {
        assert_eq!(self.code, 0, "{}", self.text);
        let mut lines = self.text.lines();
        let line = lines.find_map(|l| match l.strip_prefix("digest ") {
            None => Some(l.rsplit_once("; digest ")?.1),
            digest => digest,
        });
        line.unwrap_or_else(|| panic!("no digest in\n{}", self.text))
            .to_string()
    }
}

/// `gshear-mpi arguments` on ranks, with its results in `folder`; on one rank without mpirun.
pub fn gshear_mpi(ranks: usize, folder: &Path, arguments: &[String]) -> Outcome {
    with_environment(&[], ranks, folder, arguments)
}

/// Runs a scene into a folder of this name on one rank, with keys of `--set`.
pub fn run_scene(folder: &Path, name: &str, scene: &str, set: &[&str]) -> RunFile {
    let (file, out) = (folder.join(format!("{name}.toml")), folder.join(name));
    std::fs::write(&file, scene).expect("a scene");
    let mut arguments = vec![file.display().to_string()];
    arguments.extend(set.iter().map(|set| format!("--set={set}")));
    gshear_mpi(1, &out, &arguments).digest();
    RunFile::open_any(&out).expect("a run")
}

/// [`gshear_mpi`] with further variables in the environment.
pub fn with_environment(
    variables: &[(&str, &str)],
    ranks: usize,
    folder: &Path,
    arguments: &[String],
) -> Outcome {
    let mut command = program(ranks);
    command.args(arguments).arg("--out").arg(folder);
    command.envs(variables.iter().copied());
    Outcome::of(command.output().expect("the program starts"))
}

/// What a program says and how it ends; `None` if it takes longer than `limit`, and is killed.
pub fn bounded(command: &mut Command, limit: std::time::Duration) -> Option<Outcome> {
    use std::io::{Read, Seek};
    let mut said = tempfile::tempfile().expect("a file");
    let stream = || said.try_clone().expect("a file");
    command.stdout(stream()).stderr(stream());
    let mut child = command.spawn().expect("the program starts");
    let begun = std::time::Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("its state") {
            break status;
        }
        if begun.elapsed() > limit {
            let _ = child.kill();
            let _ = child.wait();
            return None;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    };
    let mut bytes = Vec::new();
    said.rewind().expect("the start of a file");
    said.read_to_end(&mut bytes).expect("what it said");
    Some(Outcome {
        code: status.code().unwrap_or(-1),
        text: String::from_utf8_lossy(&bytes).into_owned(),
    })
}

/// A folder of files that were kept, compressed, in `tests/files`.
pub fn kept_files(name: &str, folder: &Path) -> PathBuf {
    let from = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/files")).join(name);
    let to = folder.join(name);
    std::fs::create_dir_all(&to).expect("a folder");
    for entry in std::fs::read_dir(&from).expect("kept files").flatten() {
        let path = entry.path();
        let file = path.file_stem().expect("a name");
        let bytes = succeed(start("gzip").arg("-dc").arg(&path)).stdout;
        std::fs::write(to.join(file), bytes).expect("written");
    }
    to
}

/// [`gshear_mpi`] on one rank, asked to stop as soon as it has begun to pack.
pub fn interrupted(folder: &Path, arguments: &[String]) -> Outcome {
    use std::io::{BufRead, BufReader, Read};
    let mut child = program(1)
        .args(arguments)
        .arg("--out")
        .arg(folder)
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut lines = BufReader::new(child.stdout.take().expect("its output"));
    let mut text = String::new();
    while !text.contains("step:") && lines.read_line(&mut text).expect("text") > 0 {}
    // The one of the shell, since a bare Debian has no other.
    succeed(start("sh").args(["-c", &format!("kill -USR1 {}", child.id())]));
    lines.read_to_string(&mut text).expect("text");
    let status = child.wait().expect("its end");
    Outcome {
        code: status.code().unwrap_or(-1),
        text,
    }
}

/// The variable that says which rank a process is, with its equals sign.
fn rank_variable() -> &'static str {
    if is_open_mpi() {
        "OMPI_COMM_WORLD_RANK="
    } else {
        "PMI_RANK="
    }
}

/// Number and process of each rank of the job whose environment has this variable.
pub fn processes(name: &str, value: &Path) -> Vec<(usize, u32)> {
    let wanted = format!("{name}={}", value.display());
    let rank = |entry: std::fs::DirEntry| {
        let process: u32 = entry.file_name().to_str()?.parse().ok()?;
        let environment = std::fs::read(entry.path().join("environ")).ok()?;
        let mut variables = environment.split(|byte| *byte == 0);
        if !variables.clone().any(|v| v == wanted.as_bytes()) {
            return None;
        }
        let rank = variables.find_map(|v| v.strip_prefix(rank_variable().as_bytes()))?;
        Some((std::str::from_utf8(rank).ok()?.parse().ok()?, process))
    };
    let entries = std::fs::read_dir("/proc").expect("processes").flatten();
    entries.filter_map(rank).collect()
}

/// Sends a signal, such as `KILL`, to a process; it may have ended.
pub fn signal(process: u32, name: &str) {
    // The one of the shell, since a bare Debian has no other.
    let mut shell = start("sh");
    let shell = shell.args(["-c", &format!("kill -{name} {process}")]);
    let _ = shell.stderr(std::process::Stdio::null()).status();
}

/// The argument for AVX2, where the processor has it.
pub fn avx2() -> &'static str {
    match gshear_dem::simd::Isa::named("avx2") {
        Some(_) => "--set=bookkeeping.simd=avx2",
        None => "--set=bookkeeping.simd=auto",
    }
}

/// Copies the files of a folder into a new one.
pub fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("a folder").flatten() {
        std::fs::copy(entry.path(), to.join(entry.file_name())).expect("copied");
    }
}

/// Nothing that was being written is left in a folder.
pub fn no_parts(folder: &Path) {
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        let is_part = path.extension().is_some_and(|of| of == "part");
        assert!(!is_part, "{} is left", path.display());
    }
}

/// What the digest does not see of the last checkpoint of a run: the images of the grains, and
/// which limits the contacts are at.
pub fn beyond_the_digest(folder: &Path) -> [Vec<i64>; 2] {
    let file = hdf5::File::open(folder.join("checkpoint.h5")).expect("a checkpoint");
    let read = |name: &str| -> Vec<i64> {
        let dataset = file.dataset(name).expect("a dataset");
        dataset.read_raw().expect("integers")
    };
    let [images, limits] = ["grains/image", "contacts/limits"].map(read);
    assert!(images.iter().any(|image| *image != 0), "no grain crosses");
    [images, limits]
}

/// All datasets of two runs' `run.h5` are the same, to the last bit.
pub fn same_run(a: &Path, b: &Path) {
    let open = |folder: &Path| hdf5::File::open(folder.join("run.h5")).expect("run.h5");
    let (a, b) = (open(a), open(b));
    let sorted = |file| {
        let mut names = datasets(file, "");
        names.sort();
        names
    };
    let names = sorted(&a);
    assert!(names.len() > 30, "{names:?}");
    assert_eq!(names, sorted(&b));
    for name in names {
        let read = |file: &hdf5::File| {
            let dataset = file.dataset(&name).expect("a dataset");
            let kind = dataset.dtype().expect("its type");
            let bytes: Vec<u8> = if kind.is::<f64>() {
                bytemuck::cast_slice(&dataset.read_raw::<f64>().expect("f64")).to_vec()
            } else if kind.is::<u64>() {
                bytemuck::cast_slice(&dataset.read_raw::<u64>().expect("u64")).to_vec()
            } else if kind.is::<u32>() {
                bytemuck::cast_slice(&dataset.read_raw::<u32>().expect("u32")).to_vec()
            } else {
                dataset.read_raw::<u8>().expect("u8")
            };
            (dataset.shape(), bytes)
        };
        assert!(read(&a) == read(&b), "{name} differs");
    }
}

/// Changes an HDF5 file.
pub fn change_file(path: &Path, change: impl FnOnce(&hdf5::File)) {
    let file = hdf5::File::open_rw(path).expect("an HDF5 file");
    change(&file);
    file.close().expect("closed");
}

/// Whether there is no such program here.
pub fn missing(program: &str) -> bool {
    let found = start("sh")
        .args(["-c", &format!("command -v {program}")])
        .output();
    !found.is_ok_and(|found| found.status.success())
}

/// Paths of all datasets below a group.
pub fn datasets(file: &hdf5::File, path: &str) -> Vec<String> {
    let group = if path.is_empty() {
        file.as_group().expect("the root")
    } else {
        file.group(path).expect("a group")
    };
    let mut found = Vec::new();
    for name in group.member_names().expect("members") {
        let child = format!("{path}/{name}");
        if group.dataset(&name).is_ok() {
            found.push(child);
        } else {
            found.extend(datasets(file, &child));
        }
    }
    found
}
