//! `export`, on made-up runs; a checkpoint's export is tested where real ones are made
//! (`tests/all/packing.rs`).

use std::f64::consts::PI;
use std::path::Path;

use gshear_scene::lammps_data::{DataFile, parse};

use super::fixture::Fixture;
use super::{are_described, done, folder_with, refused};
use crate::common::{start, succeed};

fn read(path: &str) -> DataFile {
    parse("exported", &std::fs::read_to_string(path).expect(path)).expect("what was written")
}

#[test]
fn a_frame_as_lammps_data() {
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
        assert_eq!(file.bounds[0], [0.0, fixture.length]);
        assert_eq!(file.atoms.len(), disks.count());
        for (g, a) in file.atoms.iter().enumerate() {
            assert_eq!((a.id, a.kind), (g as u64 + 1, u32::from(disks.body[g]) + 1));
            assert_eq!(a.diameter, 2.0 * disks.radius[g]);
            let grain = &frame.grains[g];
            assert_eq!((a.position, a.velocity), (grain.position, grain.velocity));
            assert_eq!(a.angular_velocity, grain.angular_velocity);
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

/// The lines of a file, split into words.
fn words(path: &str, separator: char) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).expect(path);
    let split = |line: &str| line.split(separator).map(String::from).collect();
    text.lines().map(split).collect()
}

fn number(word: &str) -> f64 {
    word.parse().expect("a number")
}

/// Every number of the tables is that of the frame, to the last bit, and D²min that of `dmin`.
#[test]
fn frames_as_tables() {
    let fixture = Fixture::small();
    let (_folder, path) = folder_with(&fixture);
    let out = format!("{path}/tables/some.csv");
    let said = done(&[
        "export",
        &path,
        "--format=csv",
        "--frames=1..5:2",
        "--fields=dmin,contacts",
        "--out",
        &out,
    ]);
    let contacts = format!("{path}/tables/some-contacts.csv");
    assert_eq!(said, format!("wrote {out}\nwrote {contacts}\n"));
    let tables = Path::new(&path).join("tables");
    are_described(&tables, &["some.csv", "some-contacts.csv"]);
    done(&["dmin", &path]);
    let reduced = hdf5::File::open(format!("{path}/reduced.h5")).expect("reduced.h5");
    let dmin = reduced.dataset("dmin/value").expect("dmin");
    let dmin = dmin.read_2d::<f64>().expect("numbers");

    let [head, rows @ ..] = &words(&out, ',')[..] else {
        panic!("an empty table");
    };
    let grains = &fixture.grains;
    assert_eq!(rows.len(), 3 * grains.count());
    let column = |name: &str| head.iter().position(|n| n == name).expect(name);
    let [frame, id, x, v_y, spin, d, z] = [
        "frame",
        "id",
        "x",
        "velocity_y",
        "angular_velocity_z",
        "dmin",
        "contacts",
    ]
    .map(column);
    for (k, row) in rows.iter().enumerate() {
        let (t, g) = (1 + 2 * (k / grains.count()), k % grains.count());
        assert_eq!(
            (number(&row[frame]), number(&row[id])),
            (t as f64, g as f64)
        );
        let stored = &fixture.frames[t];
        let grain = &stored.grains[g];
        assert_eq!(number(&row[x]), grain.position[0]);
        assert_eq!(number(&row[v_y]), grain.velocity[1]);
        assert_eq!(number(&row[spin]), grain.angular_velocity[2]);
        assert_eq!(number(&row[d]).to_bits(), dmin[[t, g]].to_bits());
        let touching = stored
            .contacts
            .iter()
            .filter(|c| [c.i, c.j].contains(&(g as u32)));
        assert_eq!(number(&row[z]), touching.count() as f64);
    }

    let [head, rows @ ..] = &words(&contacts, ',')[..] else {
        panic!("an empty table");
    };
    let all = [1, 3, 5].map(|t| &fixture.frames[t].contacts);
    let all: Vec<_> = all.into_iter().flatten().collect();
    assert_eq!(rows.len(), all.len());
    let column = |name: &str| head.iter().position(|n| n == name).expect(name);
    let [i, j, force, overlap] = ["i", "j", "normal_force", "overlap"].map(column);
    for (row, contact) in rows.iter().zip(all) {
        assert_eq!(
            (&row[i], &row[j]),
            (&contact.i.to_string(), &contact.j.to_string())
        );
        assert_eq!(number(&row[force]), contact.normal_force);
        assert_eq!(number(&row[overlap]), contact.overlap);
    }
}

#[test]
fn frames_as_a_dump_and_as_xyz() {
    let fixture = Fixture::small();
    let (_folder, path) = folder_with(&fixture);
    done(&["export", &path, "--format=lammps-dump"]);
    done(&["export", &path, "--format=xyz", "--frame=last"]);
    let (grains, frames) = (&fixture.grains, &fixture.frames);
    let n = grains.count();

    let dump = words(&format!("{path}/frames.dump"), ' ');
    assert_eq!(dump.len(), frames.len() * (9 + n));
    for (frame, lines) in frames.iter().zip(dump.chunks(9 + n)) {
        assert_eq!(lines[0], ["ITEM:", "TIMESTEP"]);
        assert_eq!(lines[1], [frame.step.to_string()]);
        assert_eq!(lines[4], ["ITEM:", "BOX", "BOUNDS", "pp", "ff", "pp"]);
        assert_eq!(number(&lines[5][1]), fixture.length);
        assert_eq!(lines[8][..5], ["ITEM:", "ATOMS", "id", "type", "x"]);
        for (g, line) in lines[9..].iter().enumerate() {
            assert_eq!(number(&line[0]), (g + 1) as f64);
            assert_eq!(number(&line[1]), f64::from(grains.body[g]) + 1.0);
            let grain = &frame.grains[g];
            assert_eq!([number(&line[2]), number(&line[3])], grain.position[..2]);
            assert_eq!(number(&line[10]), grain.angular_velocity[2]);
            assert_eq!(number(&line[11]), grains.radius[g]);
        }
    }
    let contacts: usize = frames.iter().map(|frame| frame.contacts.len()).sum();
    let local = words(&format!("{path}/frames-contacts.dump"), ' ');
    assert_eq!(local.len(), frames.len() * 9 + contacts);

    let last = frames.last().expect("frames");
    let xyz = words(&format!("{path}/frames.xyz"), ' ');
    assert_eq!(xyz.len(), 2 + n);
    for (g, line) in xyz[2..].iter().enumerate() {
        let place = [number(&line[1]), number(&line[2]), number(&line[3])];
        assert_eq!((line[0].as_str(), place), ("X", last.grains[g].position));
    }
}

/// Cells and offsets of a temporal PolyData, as the specification has them. That VTK reads it is
/// tested in `python/`.
#[test]
fn frames_as_vtkhdf() {
    let fixture = Fixture::small();
    let (_folder, path) = folder_with(&fixture);
    done(&["export", &path, "--format=vtkhdf", "--frames=..:2"]);
    let file = hdf5::File::open(format!("{path}/frames.vtkhdf")).expect("a file");
    let root = file.group("VTKHDF").expect("VTKHDF");
    let version = root.attr("Version").and_then(|a| a.read_1d::<i64>());
    assert_eq!(version.expect("a version").to_vec(), [2, 0]);
    let read = |name: &str| {
        let dataset = root.dataset(name).expect(name);
        dataset.read_raw::<i64>().expect(name)
    };
    let frames: Vec<_> = fixture.frames.iter().step_by(2).collect();
    let n = fixture.grains.count() as i64;
    let contacts: Vec<i64> = frames.iter().map(|f| f.contacts.len() as i64).collect();
    assert_eq!(read("Lines/NumberOfCells"), contacts);
    assert_eq!(read("Vertices/NumberOfCells"), vec![n; frames.len()]);
    let cells: Vec<i64> = (0..frames.len())
        .flat_map(|k| [n * k as i64, contacts[..k].iter().sum(), 0, 0])
        .collect();
    assert_eq!(read("Steps/CellOffsets"), cells);
    let points = read("NumberOfPoints");
    let before: Vec<i64> = (0..frames.len())
        .map(|k| points[..k].iter().sum())
        .collect();
    assert_eq!(read("Steps/PointOffsets"), before);
    assert_eq!(read("Steps/PointDataOffsets/radius"), before);
    let forces = root.dataset("CellData/normal_force").expect("forces");
    let forces = forces.read_raw::<f64>().expect("forces");
    let mut first = 0;
    for frame in frames {
        let [of_grains, of_contacts] = [n as usize, frame.contacts.len()];
        assert!(forces[first..first + of_grains].iter().all(|f| f.is_nan()));
        first += of_grains;
        let of = frame.contacts.iter().map(|c| c.normal_force);
        assert!(of.eq(forces[first..first + of_contacts].iter().copied()));
        first += of_contacts;
    }
    assert_eq!(first, forces.len());
}

#[test]
fn what_cannot_be_exported_is_refused() {
    let (_folder, path) = folder_with(&Fixture::small());
    let with = |frame: &str| refused(&["export", &path, "--format=lammps-data", "--frame", frame]);
    assert_eq!(
        with("6"),
        format!("error: --frame 6: {path}/run.h5 has the frames 0 … 5\n")
    );
    let with = |frames: &str| refused(&["export", &path, "--format=csv", "--frames", frames]);
    assert_eq!(
        with("4..6"),
        format!("error: --frames 4..6: {path}/run.h5 has the frames 0 … 5\n")
    );
    let said = refused(&["export", &path, "--format=lammps-data", "--frames=.."]);
    assert!(
        said.contains("a data file holds the state of one frame"),
        "{said}"
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

/// Where a file cannot be written to its end, an export says so and leaves nothing.
#[test]
fn a_file_that_cannot_grow_is_a_failure() {
    let (_folder, path) = folder_with(&Fixture::small());
    let formats = ["lammps-data", "lammps-dump", "vtkhdf", "xyz", "npz", "csv"];
    for format in formats {
        let out = format!("{path}/cut");
        // Half a kilobyte or one, as the shell counts.
        let command =
            format!("ulimit -f 1; exec \"$0\" export '{path}' --format {format} --out '{out}'");
        let output = start("sh")
            .args(["-c", &command, crate::common::REDUCER])
            .output()
            .expect("a shell");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{format}: {said}");
        assert!(said.starts_with("error: "), "{format}: {said}");
        assert!(!Path::new(&out).exists(), "{format}");
    }
}

/// The files of the run itself are no place for its export, nor is what is no file.
#[test]
fn an_export_does_not_replace_its_run() {
    let (_folder, path) = folder_with(&Fixture::small());
    for name in ["scene.toml", "log.csv", "status.json"] {
        std::fs::write(format!("{path}/{name}"), "of the run").expect("a file");
    }
    for format in ["csv", "vtkhdf", "npz", "xyz"] {
        for name in ["run.h5", "scene.toml", "log.csv", "status.json"] {
            let file = format!("{path}/{name}");
            let before = std::fs::read(&file).expect("a file");
            let said = refused(&["export", &path, "--format", format, "--out", &file]);
            let expected = "is of a run, which would be lost; give another file";
            assert!(said.contains(expected), "{format}: {said}");
            assert!(std::fs::read(&file).expect("a file") == before, "{format}");
        }
        let pipe = format!("{path}/pipe-{format}");
        succeed(start("mkfifo").arg(&pipe));
        let said = refused(&["export", &path, "--format", format, "--out", &pipe]);
        assert!(
            said.contains("is a device or a pipe; give a file"),
            "{said}"
        );
        assert!(!Path::new(&pipe).is_file());
    }
}
