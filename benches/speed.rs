//! Speed of whole runs, through the real program: medians of several repetitions, and ratios of
//! runs taken in turn.
//!
//! `cargo bench` runs the small scenes, `cargo bench -- large` 100,000 and 1,000,000 disks and
//! 96,300 spheres, which are copies of packed samples beside each other, and threads.

use std::path::Path;
use std::process::Command;

const REPETITIONS: usize = 5;
/// Of large scenes.
const FEW_REPETITIONS: usize = 3;

/// A scene packed once, from whose first shear step every run goes on.
struct Packed {
    name: &'static str,
    /// Arguments with which a run begins.
    begin: Vec<String>,
    /// γ of a run.
    strain: f64,
    repetitions: usize,
}

/// What a run says of itself.
struct Said {
    /// Grain-steps per second, all ranks together (millions).
    speed: f64,
    digest: String,
    text: String,
}

fn program(ranks: usize) -> Command {
    let program = env!("CARGO_BIN_EXE_gshear-mpi");
    if ranks == 1 {
        return Command::new(program);
    }
    let mut command = Command::new("mpirun");
    command
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
        .args(["--bind-to", "none", "-n", &ranks.to_string(), program]);
    command
}

fn run(command: &mut Command, ranks: usize, accepted: i32) -> Said {
    let output = command.output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(
        output.status.code(),
        Some(accepted),
        "{command:?}\n{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let after = |word: &str| {
        text.lines()
            .find_map(|l| l.strip_prefix(word))
            .unwrap_or("")
    };
    // Earlier versions print grain-steps per second and rank.
    let unit = if after("speed ").contains("million") {
        1.0
    } else {
        ranks as f64 * 1e-6
    };
    let speed = after("speed ").split(' ').next().unwrap_or("");
    Said {
        speed: speed.parse::<f64>().unwrap_or(f64::NAN) * unit,
        digest: after("digest ").into(),
        text,
    }
}

/// Packs a scene on two ranks, unless it was packed before. `set` belongs to the scene.
fn pack(folder: &Path, name: &'static str, config: &str, set: &[&str], strain: f64) -> Packed {
    // What was packed for another format of checkpoints cannot be gone on with.
    let format = gshear_store::checkpoint::VERSION;
    let out = folder.join(format!("{name}-{format}"));
    let checkpoint = out.join("checkpoint.h5");
    if !checkpoint.exists() {
        eprintln!("packing {name} …");
        let config = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("configs")
            .join(config);
        let mut command = program(2);
        command
            .arg(config)
            .arg("--out")
            .arg(&out)
            // One that was interrupted is packed anew.
            .args(["--overwrite", "--stop-at", "1"]);
        command.args(set.iter().map(|s| format!("--set={s}")));
        run(&mut command, 2, 75);
    }
    Packed {
        name,
        begin: vec!["--resume".into(), checkpoint.display().to_string()],
        strain,
        repetitions: REPETITIONS,
    }
}

/// Copies of a packed sample beside each other, in the scene `config` as changed by `set`.
fn tiled(
    folder: &Path,
    name: &'static str,
    packed: &Packed,
    config: &str,
    set: &[&str],
    strain: f64,
) -> Packed {
    let data = folder.join(format!("{}.data", packed.name));
    let mut export = Command::new(env!("CARGO_BIN_EXE_gshear-reduce"));
    export
        .args([
            "export",
            &packed.begin[1],
            "--format",
            "lammps-data",
            "--out",
        ])
        .arg(&data);
    run(&mut export, 1, 0);
    let config = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("configs")
        .join(config);
    let mut begin = vec![
        config.display().to_string(),
        format!("--set=sample.packing={}", data.display()),
    ];
    begin.extend(set.iter().map(|s| format!("--set={s}")));
    Packed {
        name,
        begin,
        strain,
        repetitions: FEW_REPETITIONS,
    }
}

impl Packed {
    fn run(&self, folder: &Path, ranks: usize, set: &[&str]) -> Said {
        let out = folder.join("run");
        // One sample after another is run there.
        let _ = std::fs::remove_dir_all(&out);
        let mut command = program(ranks);
        command.args(&self.begin);
        // A branch, because some runs change the law of the packed scene.
        let resumed = self.begin[0] == "--resume";
        command
            .arg(if resumed { "--branch" } else { "--out" })
            .arg(&out);
        command.arg(format!("--set=shear.strain={}", self.strain));
        // What begins with a dash is an option of the program.
        command.args(set.iter().map(|s| {
            if s.starts_with('-') {
                s.to_string()
            } else {
                format!("--set={s}")
            }
        }));
        let said = run(&mut command, ranks, 0);
        std::fs::remove_dir_all(&out).expect("the run's folder");
        said
    }

    /// Two kinds of run in turn. Prints both medians and the median ratio of b to a.
    fn pair(&self, folder: &Path, what: &str, a: (usize, &[&str]), b: (usize, &[&str])) {
        let mut speeds = [Vec::new(), Vec::new()];
        let mut ratios = Vec::new();
        let mut digests = Vec::new();
        for _ in 0..self.repetitions {
            let (first, second) = (self.run(folder, a.0, a.1), self.run(folder, b.0, b.1));
            ratios.push(second.speed / first.speed);
            speeds[0].push(first.speed);
            speeds[1].push(second.speed);
            digests.extend([first.digest, second.digest]);
        }
        let equal = digests.iter().all(|d| *d == digests[0]);
        println!(
            "{:<22}{what:<38}{:>9.1}{:>9.1}{:>9.3}{:>16}",
            self.name,
            median(&mut speeds[0]),
            median(&mut speeds[1]),
            median(&mut ratios),
            if equal { "equal" } else { "different" },
        );
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() {
    let large = std::env::args().any(|a| a == "large");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("speed");
    std::fs::create_dir_all(&folder).expect("a folder");
    let quiet = [
        "output.frame_strain=0.0",
        "output.checkpoint_strain=0.0",
        "output.energy=false",
    ];
    let plain = ["output.checkpoint_strain=0.0", "output.energy=false"];
    let budget = [quiet[0], quiet[1]];

    let default = pack(&folder, "default-1000", "plane-shear-2d.toml", &[], 0.01);
    let fast = [
        "shear.inertial_number=2e-4",
        "output.frame_strain=1e-4",
        "output.frame_start=0.0",
    ];
    let five = pack(&folder, "large-5000", "lee-hurley-large.toml", &fast, 0.003);

    let processor = gshear_store::provenance::processor();
    println!(
        "{} repetitions, medians; million grain-steps per second of all ranks; {processor}",
        if large { FEW_REPETITIONS } else { REPETITIONS }
    );
    println!(
        "{:<22}{:<38}{:>9}{:>9}{:>9}{:>16}",
        "scene", "a, b", "a", "b", "b/a", "digests"
    );
    let spheres = pack(
        &folder,
        "spheres-4815",
        "gouge-default.toml",
        &[
            "time.collision_speed=none",
            "shear.protocol=none",
            "shear.spring_number=none",
            "shear.velocity=2.0",
            "shear.strain=0.05",
            "output.series_rows=none",
            "output.frame_rows=none",
            "output.series_strain=1e-4",
        ],
        0.05,
    );
    if large {
        run_large(&folder, &five, &spheres);
        return;
    }
    for scene in [&default, &five] {
        scene.pair(
            &folder,
            "1 rank, 2 ranks; no frames",
            (1, &quiet),
            (2, &quiet),
        );
    }
    default.pair(
        &folder,
        "1 rank; no frames, with frames",
        (1, &quiet),
        (1, &plain),
    );
    default.pair(
        &folder,
        "2 ranks; no frames, with frames",
        (2, &quiet),
        (2, &plain),
    );
    default.pair(
        &folder,
        "1 rank; without the energy budget, with it",
        (1, &quiet),
        (1, &budget),
    );
    let frictionless = [
        quiet[0],
        quiet[1],
        quiet[2],
        "contact.friction=0.0",
        "contact.rolling_friction=0.0",
    ];
    let no_rolling = [quiet[0], quiet[1], quiet[2], "contact.rolling_friction=0.0"];
    default.pair(
        &folder,
        "1 rank; full law, without rolling",
        (1, &quiet),
        (1, &no_rolling),
    );
    default.pair(
        &folder,
        "1 rank; full law, frictionless",
        (1, &quiet),
        (1, &frictionless),
    );
    let avx2 = [quiet[0], quiet[1], quiet[2], "bookkeeping.simd=avx2"];
    default.pair(
        &folder,
        "1 rank; best instructions, avx2",
        (1, &quiet),
        (1, &avx2),
    );
    spheres.pair(
        &folder,
        "1 rank, 2 ranks; no frames",
        (1, &quiet),
        (2, &quiet),
    );
}

fn run_large(folder: &Path, five: &Packed, spheres: &Packed) {
    let of_disks = [
        "sample.grains=none",
        "sample.radius_min=none",
        "sample.radius_max=none",
        "sample.length=none",
        "pack.friction=none",
        "analysis.scalars=false",
        "output.frame_strain=0.0",
        "output.series_strain=1e-5",
        "shear.inertial_number=2e-4",
    ];
    let disks = |name, copies: &'static str, strain| {
        let set = [&of_disks[..], &[copies]].concat();
        tiled(folder, name, five, "lee-hurley-large.toml", &set, strain)
    };
    let of_spheres = [
        "sample.replicate=[4, 5]",
        "output.frame_strain=0.0",
        "output.series_strain=1e-4",
    ];
    let energy = ["output.energy=false"];
    let threads = ["--threads=2", energy[0]];
    for many in [
        disks("disks-100000", "sample.replicate=[20]", 2e-4),
        disks("disks-1000000", "sample.replicate=[200]", 2e-5),
        tiled(
            folder,
            "spheres-96300",
            spheres,
            "packing-million.toml",
            &of_spheres,
            1e-3,
        ),
    ] {
        many.pair(
            folder,
            "1 rank, 2 ranks; no frames",
            (1, &energy),
            (2, &energy),
        );
        many.pair(
            folder,
            "1 rank; 1 thread, 2 threads",
            (1, &energy),
            (1, &threads),
        );
        let memory = many.run(folder, 2, &energy).text;
        let line = memory.lines().find(|l| l.contains("bytes per grain"));
        println!("{}", line.unwrap_or(""));
    }
}
