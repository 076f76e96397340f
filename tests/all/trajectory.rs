//! `run.h5` of a single rank: what is refused, what is cut off, what can be read meanwhile.

use crate::common::synthetic::{
    at_the_end, attributes, contact, edges, grain, header, pairs, row, shapes,
};
use gshear_dem::domain::Solo;
use gshear_dem::failure::Failure;
use gshear_dem::state::SeriesRow;
use gshear_store::trajectory::{RunHeader, TrajectoryWriter};
use std::path::Path;

const GRAINS: u64 = 11;

fn create(path: &Path) -> TrajectoryWriter {
    let (shapes, attributes) = (shapes(GRAINS), attributes());
    let header = RunHeader {
        attributes: &attributes,
        ..header(&shapes)
    };
    TrajectoryWriter::create(&Solo, path, &header).unwrap()
}

fn frames(writer: &mut TrajectoryWriter, times: std::ops::Range<u64>) {
    for t in times {
        let grains: Vec<_> = (0..GRAINS).map(|id| grain(t, id)).collect();
        let contacts: Vec<_> = pairs(t, GRAINS)
            .into_iter()
            .map(|p| contact(t, p))
            .collect();
        writer
            .frame(&Solo, (t, t as f64), &edges(t), &grains, &contacts)
            .unwrap();
        writer.series(&Solo, t, t as f64, &row(t)).unwrap();
    }
}

fn length(file: &hdf5::File, name: &str) -> usize {
    file.dataset(name).unwrap().shape()[0]
}

#[test]
fn whatever_was_flushed_survives_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    let mut writer = create(&path);
    frames(&mut writer, 0..70);
    writer.flush(&Solo).unwrap();
    // As a killed program leaves it: a copy taken while the file is open and more frames wait.
    frames(&mut writer, 70..80);
    let killed = folder.path().join("killed.h5");
    std::fs::copy(&path, &killed).unwrap();
    let file = hdf5::File::open(&killed).unwrap();
    assert_eq!(length(&file, "particles/trajectory/position/value"), 70);
    assert_eq!(length(&file, "observables/stress_ratio/value"), 70);
    drop(file);

    let mut writer2 =
        TrajectoryWriter::open_to_append(&Solo, &killed, &SeriesRow::COLUMNS, 70, 70).unwrap();
    frames(&mut writer2, 70..80);
    writer.finish(&Solo, &at_the_end()).unwrap();
    writer2.finish(&Solo, &at_the_end()).unwrap();
    let [a, b] = [&path, &killed].map(|p| {
        let file = hdf5::File::open(p).unwrap();
        let values = file
            .dataset("particles/trajectory/velocity/value")
            .unwrap()
            .read_raw::<f64>()
            .unwrap();
        let forces = file
            .dataset("connectivity/contacts/overlap")
            .unwrap()
            .read_raw::<f64>()
            .unwrap();
        (
            values,
            forces,
            file.dataset("connectivity/contacts/offset")
                .unwrap()
                .read_raw::<u64>()
                .unwrap(),
        )
    });
    assert!(a == b && a.2.len() == 81);
}

#[test]
fn frames_beyond_those_that_count_are_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    let mut writer = create(&path);
    frames(&mut writer, 0..20);
    writer.finish(&Solo, &at_the_end()).unwrap();
    drop(TrajectoryWriter::open_to_append(&Solo, &path, &SeriesRow::COLUMNS, 13, 7).unwrap());
    let file = hdf5::File::open(&path).unwrap();
    let contacts = (0..13).map(|t| pairs(t, GRAINS).len()).sum::<usize>();
    assert_eq!(
        length(&file, "particles/trajectory/angular_velocity/value"),
        13
    );
    assert_eq!(length(&file, "connectivity/contacts/time"), 13);
    assert_eq!(length(&file, "connectivity/contacts/offset"), 14);
    assert_eq!(length(&file, "connectivity/contacts/sliding"), contacts);
    assert_eq!(length(&file, "observables/sliding_fraction/step"), 7);
    // It is not over any more.
    let parameters = file.group("parameters").unwrap();
    assert!(parameters.attr("digest").is_err() && parameters.attr("scene").is_ok());
}

#[test]
fn what_cannot_be_gone_on_with_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    let refused = |frames, rows| match TrajectoryWriter::open_to_append(
        &Solo,
        &path,
        &SeriesRow::COLUMNS,
        frames,
        rows,
    ) {
        Err(Failure::Input(message)) => message,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("not refused"),
    };
    assert!(refused(0, 0).contains("run.h5: there is no such file"));
    std::fs::write(&path, "text").unwrap();
    assert!(refused(0, 0).contains("not the run.h5 of a run, or damaged"));
    hdf5::File::create(&path).unwrap().close().unwrap();
    assert!(refused(0, 0).contains("not the run.h5 of a run, or damaged"));
    let mut writer = create(&path);
    frames(&mut writer, 0..5);
    writer.finish(&Solo, &[]).unwrap();
    assert!(refused(6, 5).contains("it holds 5 frames and 5 rows, the checkpoint counts 6 and 5"));
    assert!(refused(5, 9).contains("5 rows"));
}

#[test]
fn a_folder_that_cannot_be_written_is_named() {
    let shapes = shapes(2);
    let made = TrajectoryWriter::create(&Solo, Path::new("no/such/run.h5"), &header(&shapes));
    // The first of its files is the journal.
    let journal = "no/such/run.h5.journal: cannot be written";
    assert!(matches!(made, Err(Failure::Other(m)) if m.contains(journal)));
}
