//! Files of an earlier build, kept in `tests/files`, stay readable: a run and its checkpoint
//! between walls and in a periodic box.

use std::path::Path;

use crate::common::{Outcome, gshear_mpi, kept_files, reducer, succeed};
use gshear_store::run_reader::RunFile;

fn scene(name: &str) -> String {
    format!("{}/tests/files/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

fn reduce(arguments: &[&str], paths: &[&Path]) -> String {
    let mut command = reducer();
    let output = succeed(command.args(arguments).args(paths));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The outputs of the kept run: whole numbers of steps between them, none at its end. This run ends
/// at the last of them.
const OUTPUTS: [&str; 4] = [
    "--set=output.frame_strain=0.01973494563645363",
    "--set=output.series_strain=0.0049337364091134075",
    "--set=analysis.strain=0.009867472818226815",
    "--set=shear.strain=0.09867472818226815",
];

/// Asserts that two runs have the same numbers at the same steps, and other ends.
fn same_until_the_end(kept: &Path, other: &Path) {
    let mut compare = reducer();
    let output = (compare.arg("compare").args([kept, other]).output()).expect("it starts");
    let said = String::from_utf8_lossy(&output.stdout);
    let differing = said.lines().filter(|line| line.starts_with("differs: "));
    let differing: Vec<&str> = differing.collect();
    assert!(
        matches!(differing[..], [only] if only.starts_with("differs: digest: ")),
        "{said}"
    );
}

/// A run from a kept checkpoint.
fn resumed(checkpoint: &Path, out: &Path, ranks: usize) -> Outcome {
    let resume = format!("--resume={}", checkpoint.display());
    gshear_mpi(ranks, out, &[resume])
}

#[test]
fn a_kept_run_is_read_repeated_and_continued() {
    let folder = tempfile::tempdir().expect("a folder");
    let kept = kept_files("walls", folder.path());
    let run = RunFile::open(&kept).expect("a run");
    let digest = run.digest().expect("a digest").to_string();
    let info = reduce(&["info"], &[&kept]);
    for part in [&digest, "48: 38 free", "Kept files"] {
        assert!(info.contains(part), "no {part} in {info}");
    }
    for ranks in [1, 2] {
        let again = folder.path().join(format!("again-{ranks}"));
        let outcome = gshear_mpi(ranks, &again, &[scene("walls")]);
        assert_eq!(outcome.digest(), digest);
        let rows = folder.path().join(format!("rows-{ranks}"));
        let mut arguments = vec![scene("walls")];
        arguments.extend(OUTPUTS.map(String::from));
        assert_eq!(gshear_mpi(ranks, &rows, &arguments).code, 0);
        same_until_the_end(&kept, &rows);
        let on = folder.path().join(format!("on-{ranks}"));
        let outcome = resumed(&kept.join("checkpoint.h5"), &on, ranks);
        assert_eq!(outcome.digest(), digest);
    }
    // With its files, in its folder.
    let both = folder.path().join("both");
    let mut begun = vec![scene("walls")];
    begun.extend(OUTPUTS.map(String::from));
    let mut goes_on = begun.clone();
    begun.push("--stop-at=450".into());
    goes_on.push("--resume=auto".into());
    assert_eq!(gshear_mpi(1, &both, &begun).code, 75);
    std::fs::copy(kept.join("checkpoint.h5"), both.join("checkpoint.h5")).expect("copied");
    assert_eq!(gshear_mpi(2, &both, &goes_on).code, 0);
    same_until_the_end(&kept, &both);
}

/// Temperatures of the fluctuations came after the kept files. Without them a run goes on in its
/// files, which have no columns of them; with them, in new files alone.
#[test]
fn a_kept_run_goes_on_with_and_without_temperatures() {
    let folder = tempfile::tempdir().expect("a folder");
    let kept = kept_files("walls", folder.path());
    let digest = RunFile::open(&kept)
        .expect("a run")
        .digest()
        .map(String::from);
    let has = |run: &Path| {
        ["granular_temperature", "spin_temperature"].map(|name| {
            let run = RunFile::open(run).expect("a run");
            run.series()
                .has(name)
                .then(|| run.series().column(name).to_vec())
        })
    };
    assert_eq!(has(&kept), [None, None]);

    // Its log was not kept: that of the same run, begun now.
    let again = folder.path().join("again");
    assert_eq!(
        Some(gshear_mpi(1, &again, &[scene("walls")]).digest()),
        digest
    );
    std::fs::copy(again.join("log.csv"), kept.join("log.csv")).expect("copied");
    let checkpoint = kept.join("checkpoint.h5");
    let resume = format!("--resume={}", checkpoint.display());
    let temperatures = "--set=output.temperatures=true".to_string();
    let before = std::fs::read(kept.join("run.h5")).expect("bytes");
    let refused = gshear_mpi(1, &kept, &[resume.clone(), temperatures.clone()]);
    assert_eq!(refused.code, 2, "{}", refused.text);
    for part in ["granular_temperature", "output.temperatures has changed"] {
        assert!(refused.text.contains(part), "{}", refused.text);
    }
    assert_eq!(std::fs::read(kept.join("run.h5")).expect("bytes"), before);

    let warm = |ranks: usize| {
        let out = folder.path().join(format!("warm-{ranks}"));
        let outcome = gshear_mpi(ranks, &out, &[resume.clone(), temperatures.clone()]);
        assert_eq!(Some(outcome.digest()), digest);
        has(&out).map(|column| column.expect("a column"))
    };
    let one = warm(1);
    assert!(one.iter().flatten().all(|t| *t > 0.0), "{one:?}");
    assert_eq!(warm(3), one);

    let outcome = gshear_mpi(2, &kept, &[resume]);
    assert_eq!(Some(outcome.digest()), digest);
    assert_eq!(has(&kept), [None, None]);
}

#[test]
fn a_kept_run_in_a_box_is_read_and_continued() {
    let folder = tempfile::tempdir().expect("a folder");
    let kept = kept_files("box", folder.path());
    reduce(&["growth"], &[&kept]);
    for name in ["growth.csv", "growth-grains.csv"] {
        let units = kept.join(format!("{name}-metadata.json"));
        assert!(kept.join(name).exists() && units.exists(), "{name}");
    }
    // From a checkpoint after the strain steps, whose last bits depend on the processor.
    let digest = |text: &str| {
        let (_, digest) = text.rsplit_once("digest ").expect("a digest");
        digest.split_whitespace().next().map(ToString::to_string)
    };
    let from = |ranks: usize| {
        let out = folder.path().join(format!("on-{ranks}"));
        let outcome = resumed(&kept.join("checkpoint.h5"), &out, ranks);
        assert_eq!(outcome.code, 0, "{}", outcome.text);
        digest(&outcome.text)
    };
    let file = hdf5::File::open(kept.join("run.h5")).expect("HDF5");
    let attribute = file
        .group("newtonian/parameters")
        .unwrap()
        .attr("digest")
        .unwrap();
    let stored = attribute.read_scalar::<hdf5::types::VarLenUnicode>();
    let stored = stored.expect("text").to_string();
    assert_eq!(from(1), Some(stored.clone()));
    assert_eq!(from(2), Some(stored));
}
