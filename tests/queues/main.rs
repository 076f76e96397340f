//! The job scripts: on a Slurm of this machine and on a Flux instance, where they are installed;
//! those of PBS and LSF with stand-ins for the commands of the batch system. Ranks on two hosts.
//!
//! Run by hand: `make queues`.

#[path = "../common/mod.rs"]
mod common;
mod flux;
mod hosts;
mod slurm;
mod stand_ins;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use common::{PROGRAM, program, same_run, succeed};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
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
        let mut command = program(1);
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
        let mut run = program(1);
        run.arg(common::crossing::SCENE)
            .args(LONG)
            .arg("--overwrite");
        succeed(run.arg("--out").arg(&folder));
        folder
    })
}

/// The value of LAUNCH with which the first `stops` jobs stop early.
fn launch(name: &str, stops: usize, ranks: &str) -> String {
    format!("{ROOT}/tests/queues/commands/stops {name} {stops} {ranks}")
}

/// Whether a run was resumed.
fn is_resumed(folder: &Path) -> bool {
    let scene = fs::read_to_string(folder.join("scene.toml")).expect("scene.toml");
    scene.contains("# resumed at ")
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
