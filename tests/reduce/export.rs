//! `export`, on made-up runs; a checkpoint's export is tested where real ones are made (`tests/packing.rs`).

use std::f64::consts::PI;

use gshear_scene::lammps_data::{DataFile, parse};

use crate::fixture::Fixture;
use crate::{alone, done, folder_with, refused};

fn read(path: &str) -> DataFile {
    parse("exported", &std::fs::read_to_string(path).expect(path)).expect("what was written")
}

#[test]
fn a_frame_as_lammps_data() {
    let _alone = alone();
    let fixture = Fixture::small();
    let (_folder, path) = folder_with(&fixture);
    let out = format!("{path}/some/where.data");
    let last = fixture.frames.len() - 1;
    let said = done(&["export", &path, "--format", "lammps-data"]);
    assert_eq!(said, format!("wrote {path}/frame-{last}.data\n"));
    done(&[
        "export",
        &format!("{path}/run.h5"),
        "--format=lammps-data",
        "--frame=2",
        "--out",
        &out,
    ]);
    for (t, file) in [(last, format!("{path}/frame-{last}.data")), (2, out)] {
        let (file, frame, disks) = (read(&file), &fixture.frames[t], &fixture.grains);
        assert_eq!(file.types, 3);
        assert_eq!(file.bounds[0], [0.0, disks.length]);
        assert_eq!(file.atoms.len(), disks.count());
        for (g, a) in file.atoms.iter().enumerate() {
            assert_eq!((a.id, a.kind), (g as u64 + 1, u32::from(disks.body[g]) + 1));
            assert_eq!(a.diameter, 2.0 * disks.radius[g]);
            let ([x, y], [u, v]) = (frame.position[g], frame.velocity[g]);
            assert_eq!((a.position, a.velocity), ([x, y, 0.0], [u, v, 0.0]));
            assert_eq!(a.angular_velocity, [0.0, 0.0, frame.angular_velocity[g]]);
            let mass = a.density * PI / 6.0 * a.diameter.powi(3);
            assert!((mass / disks.mass[g] - 1.0).abs() < 1e-14);
            // LAMMPS loses atoms that are not in its box.
            for (k, [lo, hi]) in file.bounds.into_iter().enumerate() {
                assert!(lo <= a.position[k] && a.position[k] <= hi);
            }
        }
    }
}

/// The same but for the density, of which LIGGGHTS makes a disk's mass.
#[test]
fn a_frame_as_liggghts_data() {
    let _alone = alone();
    let (_folder, path) = folder_with(&Fixture::small());
    let out = format!("{path}/frame.data");
    let mut files = ["lammps-data", "liggghts-data"].map(|format| {
        done(&["export", &path, "--format", format, "--out", &out]);
        read(&out)
    });
    for a in &mut files[1].atoms {
        assert!((a.density / 2500.0 - 1.0).abs() < 1e-14);
        a.density *= 0.75 / (0.5 * a.diameter);
    }
    let [lammps, liggghts] = files;
    for (a, b) in lammps.atoms.iter().zip(&liggghts.atoms) {
        assert!((a.density / b.density - 1.0).abs() < 1e-14);
        assert_eq!((a.position, a.diameter), (b.position, b.diameter));
    }
}

#[test]
fn what_cannot_be_exported_is_refused() {
    let _alone = alone();
    let (_folder, path) = folder_with(&Fixture::small());
    let with = |frame: &str| refused(&["export", &path, "--format=lammps-data", "--frame", frame]);
    assert_eq!(
        with("6"),
        format!("error: --frame 6: {path}/run.h5 has the frames 0 … 5\n")
    );
    let mut empty = Fixture::small();
    empty.frames.clear();
    let (_folder, path) = folder_with(&empty);
    let said = refused(&["export", &path, "--format=lammps-data"]);
    assert_eq!(
        said,
        format!("error: --frame last: {path}/run.h5 has no frames\n")
    );
}
