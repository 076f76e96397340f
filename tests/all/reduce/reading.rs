//! What is read, and what is refused.

use gshear_dem::state::Frame;
use gshear_store::run_reader::RunFile;

use super::fixture::{Fixture, strain_of};
use super::{done, folder_with, refused};

#[test]
fn what_was_written_is_read() {
    let fixture = Fixture::small();
    let (folder, _) = folder_with(&fixture);
    let run = RunFile::open(folder.path()).expect("a run");
    assert_eq!(*run.grains(), fixture.grains);
    assert_eq!(run.records(0..6).expect("frames"), fixture.frames);
    assert_eq!(run.frame(4).expect("a frame"), fixture.frames[4]);
    assert_eq!(run.records(2..2).expect("no frames"), Vec::<Frame>::new());
    assert_eq!(run.series().columns, fixture.series);
    assert_eq!(run.series().step, fixture.series_step);
    assert_eq!(
        (run.height(), run.digest()),
        (fixture.height, Some("00c0ffee00c0ffee"))
    );
    let strains = run.frame_strains().expect("strains");
    for (frame, strain) in fixture.frames.iter().zip(strains) {
        let expected = strain_of(frame.step, fixture.height);
        assert!(
            (strain - expected).abs() <= 1e-15 * expected,
            "{strain} against {expected}"
        );
    }
}

#[test]
fn a_run_that_was_stopped_early_is_read_as_far_as_it_goes() {
    let mut fixture = Fixture::small();
    fixture.digest = None;
    let (folder, path) = folder_with(&fixture);
    // As if the run had died between two datasets of a batch.
    let file = hdf5::File::open_rw(folder.path().join("run.h5")).expect("the file");
    file.dataset("particles/trajectory/angular_velocity/value")
        .expect("it")
        .resize([4, 48])
        .expect("resized");
    file.dataset("observables/coordination/value")
        .expect("it")
        .resize([33])
        .expect("resized");
    file.close().expect("closed");
    let run = RunFile::open(folder.path()).expect("a run");
    assert_eq!((run.frames(), run.series().rows()), (4, 33));
    assert_eq!(run.records(0..4).expect("frames"), fixture.frames[..4]);
    assert!(done(&["info", &path]).contains("unfinished: no digest"));
    drop(run);

    // Contacts that were not all written end the frames as well.
    let file = hdf5::File::open_rw(folder.path().join("run.h5")).expect("the file");
    let two: usize = fixture.frames[..2]
        .iter()
        .map(|frame| frame.contacts.len())
        .sum();
    file.dataset("connectivity/contacts/overlap")
        .expect("it")
        .resize([two + 1])
        .expect("resized");
    file.close().expect("closed");
    assert_eq!(RunFile::open(folder.path()).expect("a run").frames(), 2);
}

/// A run of one rank locks its file, and between two flushes the file may not be whole.
#[test]
fn a_run_under_way_is_read() {
    let (folder, path) = folder_with(&Fixture::sheared(16, 12, 30));
    let file = folder.path().join("run.h5");
    // As HDF5 locks a file that it writes.
    let writing = std::fs::File::open(&file).expect("the file");
    writing.lock().expect("a lock");
    for command in ["info", "dmin", "phases", "regions", "correlate", "report"] {
        done(&[command, &path]);
    }
    done(&["compare", &path, &path]);
    done(&["export", &path, "--format", "csv"]);
    drop(writing);

    let status = serde_json::json!({
        "version": 1, "state": "running", "run_id": "", "title": "", "stage": "shear", "step": 1,
        "seconds": 1.0, "grains": 192, "ranks": 1, "host": "", "pid": 1, "started": "", "updated": "",
    });
    std::fs::write(folder.path().join("status.json"), status.to_string()).expect("written");
    let aside = folder.path().join("aside");
    std::fs::rename(&file, &aside).expect("renamed");
    let whole = std::fs::read(&aside).expect("the file");
    std::fs::write(&file, &whole[..whole.len() / 2]).expect("written");
    let flush = std::thread::spawn(move || {
        std::thread::sleep(std::time::Duration::from_millis(300));
        std::fs::rename(aside, file).expect("renamed");
    });
    done(&["info", &path]);
    flush.join().expect("flushed");
}

#[test]
fn info_tells_what_is_there() {
    let (_folder, path) = folder_with(&Fixture::small());
    let told = done(&["info", &path]);
    for part in [
        "48: 32 free, 8 in the bottom wall, 8 in the top wall",
        "6: step 0 … 5000",
        "51: step 0",
        "00c0ffee00c0ffee",
        "seed = 1",
    ] {
        assert!(told.contains(part), "{part} is not in\n{told}");
    }
}

#[test]
fn a_missing_or_foreign_file_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| {
        folder
            .path()
            .join(name)
            .to_str()
            .expect("UTF-8")
            .to_string()
    };
    assert!(refused(&["info", &at("none.h5")]).contains("none.h5: cannot be read"));
    assert!(refused(&["info", &at("")]).contains("run.h5: cannot be read"));
    std::fs::write(at("text.h5"), "step,time\n0,0\n").expect("written");
    assert!(refused(&["report", &at("text.h5")]).contains("text.h5: is not an HDF5 file"));
    std::fs::write(at("empty.h5"), "").expect("written");
    assert!(refused(&["dmin", &at("empty.h5")]).contains("empty.h5: is not an HDF5 file"));
    hdf5::File::create(at("other.h5"))
        .expect("made")
        .close()
        .expect("closed");
    let message = refused(&["phases", &at("other.h5")]);
    assert!(
        message.contains("other.h5: parameters is missing: not a run of gshear-mpi"),
        "{message}"
    );
    assert!(
        !folder.path().join("phases.csv").exists(),
        "nothing is written"
    );
}

/// Message about a run after a change of its file.
fn refusal(change: impl Fn(&hdf5::File) -> hdf5::Result<()>) -> String {
    let (folder, path) = folder_with(&Fixture::small());
    let file = hdf5::File::open_rw(folder.path().join("run.h5")).expect("the file");
    change(&file).expect("changed");
    file.close().expect("closed");
    let message = refused(&["dmin", &path]);
    assert!(
        message.contains("run.h5: ") && !folder.path().join("reduced.h5").exists(),
        "{message}"
    );
    message
}

#[test]
fn a_damaged_run_is_refused_and_the_object_named() {
    let (folder, path) = folder_with(&Fixture::small());
    let file = folder.path().join("run.h5");
    let bytes = std::fs::read(&file).expect("bytes");
    std::fs::write(&file, &bytes[..bytes.len() / 2]).expect("cut");
    assert!(refused(&["info", &path]).contains("run.h5: is damaged"));

    let cases: [(&str, &str); 4] = [
        ("particles/trajectory/position/value", "is missing"),
        ("connectivity", "connectivity/contacts/offset is missing"),
        (
            "observables/stress_ratio",
            "observables/stress_ratio/value is missing",
        ),
        ("parameters", "parameters is missing"),
    ];
    for (object, expected) in cases {
        let message = refusal(|file| file.unlink(object));
        assert!(
            message.contains(object) && message.contains(expected),
            "{message}"
        );
    }
    let message = refusal(|file| {
        file.dataset("particles/trajectory/velocity/value")?
            .resize([5, 48, 3])
    });
    assert!(
        message.contains("velocity/value: holds 5 frames where") && message.contains("holds 6"),
        "{message}"
    );
    let message = refusal(|file| {
        file.dataset("particles/trajectory/velocity/value")?
            .resize([6, 48, 2])
    });
    assert!(
        message.contains("velocity/value: has the shape [6, 48, 2]"),
        "{message}"
    );
    let message = refusal(|file| {
        file.dataset("connectivity/contacts/j")?
            .write_slice(&[48u32], 0..1)
    });
    assert!(
        message.contains("connectivity/contacts: row 0") && message.contains("i < j < 48"),
        "{message}"
    );
    let message = refusal(|file| {
        file.dataset("connectivity/contacts/offset")?
            .write_slice(&[9_999_999u64], 1..2)
    });
    assert!(
        message.contains("connectivity/contacts/offset: decreases at frame 2"),
        "{message}"
    );
}
