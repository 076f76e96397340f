//! `run.h5` of a run that has ended is compressed: the same numbers, whatever the ranks.

use std::path::Path;

use crate::common::crossing::{SCENE, whole};
use crate::common::{self, gshear_mpi, reducer, same_run, succeed};
use crate::faults::shim;
use hdf5::filters::Filter;

const SET: [&str; 3] = [
    "output.frame_strain=2e-4",
    "output.series_strain=5e-4",
    "shear.strain=0.01",
];

/// The filters of the frames of a run.
fn filters(run: &Path) -> Vec<Filter> {
    let file = hdf5::File::open(run.join("run.h5")).expect("HDF5");
    let positions = file.dataset("particles/trajectory/position/value");
    positions.expect("positions").filters()
}

fn size(run: &Path) -> u64 {
    std::fs::metadata(run.join("run.h5")).expect("a file").len()
}

/// A compressed run holds what a plain one does, and as it ended so it goes on: with the files of
/// one that was never compressed.
#[test]
fn a_run_that_has_ended_is_compressed() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let plain = at("plain");
    let set = [&SET[..], &["output.compress=false"]].concat();
    let digest = whole(&plain, 1, &set).digest();
    assert_eq!(filters(&plain), []);
    let longer = ["--set=shear.strain=0.015".to_string()];
    let beyond = |run: &Path, ranks: usize| {
        let resume = [format!("--resume={}", run.join("checkpoint.h5").display())];
        gshear_mpi(ranks, run, &[&resume[..], &longer].concat())
    };
    for ranks in [1, 2, 3] {
        let run = at(&format!("compressed-{ranks}"));
        assert_eq!(whole(&run, ranks, &SET).digest(), digest);
        assert_eq!(filters(&run), [Filter::shuffle(), Filter::deflate(1)]);
        same_run(&plain, &run);
        assert!(size(&run) < size(&plain) * 3 / 4, "{}", size(&run));
        let mut compare = reducer();
        succeed(compare.arg("compare").args([&plain, &run]));
    }
    let digest = beyond(&plain, 1).digest();
    for (from, ranks) in [(1, 3), (3, 1)] {
        let run = at(&format!("compressed-{from}"));
        assert_eq!(beyond(&run, ranks).digest(), digest);
        assert_eq!(filters(&run), [Filter::shuffle(), Filter::deflate(1)]);
        same_run(&plain, &run);
        let names = std::fs::read_dir(&run).expect("a folder").flatten();
        let names: Vec<_> = names.map(|entry| entry.file_name()).collect();
        let parts = names
            .iter()
            .filter(|name| name.to_string_lossy().contains(".part"));
        assert_eq!(parts.count(), 0, "{names:?}");
    }
}

/// Without histories in the frames the numbers are the same, and K needs a checkpoint.
#[test]
fn frames_do_without_histories() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let digest = whole(&at("with"), 1, &SET).digest();
    let set = [&SET[..], &["output.histories=false"]].concat();
    assert_eq!(whole(&at("without"), 2, &set).digest(), digest);
    let names = |name: &str| {
        let file = hdf5::File::open(at(name).join("run.h5")).expect("HDF5");
        let mut names = common::datasets(&file, "");
        names.sort();
        names
    };
    let missing = ["rolling_history", "tangential_history"];
    let missing = missing.map(|name| format!("/connectivity/contacts/{name}"));
    let mut with = names("with");
    with.retain(|name| !missing.contains(name));
    assert_eq!(names("without"), with);
    let mut compare = reducer();
    succeed(compare.arg("compare").args([at("with"), at("without")]));
    let mut spectrum = reducer();
    spectrum.arg("spectrum").arg(at("without"));
    let refused = spectrum.output().expect("the program starts");
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("give a checkpoint, or a replay"), "{said}");
    let mut spectrum = reducer();
    spectrum.arg("spectrum").arg(at("without/checkpoint.h5"));
    succeed(spectrum.arg("--out").arg(at("spectrum")));
}

/// Without room for the compressed copy the file stays as it was written, and the run has ended
/// well.
#[test]
fn a_full_disk_leaves_a_plain_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let library = shim(folder.path());
    let at = |name: &str| folder.path().join(name);
    let plain = at("plain");
    let digest = whole(&plain, 1, &[&SET[..], &["output.compress=false"]].concat()).digest();
    // Calls that write into the folder: as many with a plain file, then those of the copy.
    let counts = at("counts");
    let count = |out: &Path, compress: bool| -> u64 {
        let _ = std::fs::remove_file(&counts);
        let mut command = common::program(1);
        command.arg(SCENE).arg("--out").arg(out);
        command.args(SET.map(|set| format!("--set={set}")));
        command.arg(format!("--set=output.compress={compress}"));
        command.env("LD_PRELOAD", &library).env("FAULT_PATH", out);
        succeed(command.env("FAULT_COUNT", &counts));
        let text = std::fs::read_to_string(&counts).expect("counts");
        let counts = text
            .lines()
            .filter_map(|line| line.split(' ').nth(1)?.parse().ok());
        counts.max().expect("a count")
    };
    let (before, all) = (count(&at("counted"), false), count(&at("counted-2"), true));
    assert!(all > before + 20, "{before} {all}");
    for call in [before + 6, before + 15, u64::midpoint(before, all)] {
        let run = at(&format!("full-{call}"));
        let mut command = common::program(1);
        command.arg(SCENE).arg("--out").arg(&run);
        command.args(SET.map(|set| format!("--set={set}")));
        command.env("LD_PRELOAD", &library).env("FAULT_PATH", &run);
        command.env("FAULT_KIND", "enospc").env("FAULT_RANK", "0");
        command.env("FAULT_CALL", call.to_string());
        let ended = command.output().expect("the program starts");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(0), "{call}: {said}");
        assert!(
            said.contains("warning: run.h5 is whole but not compressed"),
            "{said}"
        );
        assert!(said.contains("No space left on device"), "{said}");
        assert_eq!(filters(&run), []);
        same_run(&plain, &run);
        let file = gshear_store::run_reader::RunFile::open(&run).expect("a run");
        assert_eq!(file.digest(), Some(&*digest));
    }
}
