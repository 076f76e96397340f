use super::*;
use crate::h5::{Attribute, each_dataset};
use crate::run_header::{GrainShape, RunHeader};
use crate::trajectory::{FrameFormat, TrajectoryWriter};
use bytemuck::Zeroable;
use gshear_dem::boundary::FLAT_WALLS;
use gshear_dem::state::{ContactSample, GrainSample, SeriesRow};
use hdf5::Dataset;
use hdf5::filters::Filter;
use std::ops::Range;

const GRAINS: usize = 700;

/// A number of every place, with as many digits as a double has.
fn mixed(n: u64) -> f64 {
    (n.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11) as f64 * 1e-16
}

fn grains(step: u64) -> Vec<GrainSample> {
    let grain = |id: u32| {
        let n = step << 20 | u64::from(id) << 4;
        GrainSample {
            id,
            position: [mixed(n), mixed(n + 1), 0.0],
            velocity: [mixed(n + 2), mixed(n + 3), 0.0],
            angular_velocity: [0.0, 0.0, mixed(n + 4)],
            image: [step as i64 % 3 - 1, 0, 0],
            ..GrainSample::zeroed()
        }
    };
    (0..GRAINS as u32).map(grain).collect()
}

/// So many that the last chunk is not full, and some with flat walls.
fn contacts(step: u64) -> Vec<ContactSample> {
    let contact = |j: u32| {
        let n = step << 20 | u64::from(j) << 4;
        ContactSample {
            i: j - 1,
            j: if j.is_multiple_of(50) {
                GRAINS as u32 + j / 50 % 2
            } else {
                j
            },
            normal_force: mixed(n + 5),
            tangential_force: [mixed(n + 6), 0.0, 0.0],
            overlap: mixed(n + 7),
            tangential_history: [mixed(n + 8), 0.0, 0.0],
            rolling_history: mixed(n + 9),
            sliding: u64::from(j) % 2,
            ..ContactSample::zeroed()
        }
    };
    (1..GRAINS as u32 - (step % 7) as u32)
        .map(contact)
        .collect()
}

fn write(writer: &mut TrajectoryWriter, steps: Range<u64>) {
    for step in steps {
        let clock = (step, step as f64);
        let (grains, contacts) = (grains(step), contacts(step));
        let written = writer.frame(&Solo, clock, &[[0.0; 3]; 3], &grains, &contacts);
        written.unwrap();
        let row = [mixed(step); SeriesRow::COLUMNS.len()];
        writer.series(&Solo, step, step as f64, &row).unwrap();
    }
}

fn file(path: &Path, frames: u64) {
    let shapes: Vec<GrainShape> = (0..GRAINS as u32)
        .map(|id| GrainShape {
            id,
            radius: 1.0,
            mass: 1.0,
            ..GrainShape::zeroed()
        })
        .collect();
    let header = RunHeader {
        form: FrameFormat {
            walls: true,
            ..FrameFormat::new(2, false)
        },
        boundary: &FLAT_WALLS,
        units: true,
        series: &SeriesRow::COLUMNS,
        edges: [2.0, 3.0, 0.0],
        grains: &shapes,
        attributes: &[("scene", "seed = 1".into()), ("ranks", 3.into())],
        ..RunHeader::default()
    };
    let mut writer = TrajectoryWriter::create(&Solo, path, &header).unwrap();
    write(&mut writer, 0..frames);
    let end = [("digest", Attribute::Text("d1".into()))];
    writer.finish(&Solo, &end).unwrap();
}

/// Names and numbers of all datasets, and their chunks.
fn content(path: &Path) -> Vec<(String, Vec<u8>, Option<Vec<usize>>)> {
    let file = File::open(path).unwrap();
    let mut all = Vec::new();
    each_dataset(&file, &mut |dataset: Dataset| {
        let places: Vec<Range<usize>> = dataset.shape().iter().map(|&n| 0..n).collect();
        let bytes = blocks::read_bytes(&dataset, &places).unwrap();
        all.push((dataset.name(), bytes, dataset.chunk()));
    })
    .unwrap();
    all.sort();
    all
}

fn attributes(path: &Path, object: &str) -> Vec<(String, Vec<u8>)> {
    let file = File::open(path).unwrap();
    let location = file.group(object).unwrap();
    let attribute = |name: String| {
        let stored = location.attr(&name).unwrap();
        let text = format!("{:?}", stored.dtype().unwrap().to_descriptor().unwrap());
        let value = crate::parameter::attributes(&location)
            .unwrap()
            .remove(&name);
        (name, format!("{text} {value:?}").into_bytes())
    };
    let names = location.attr_names().unwrap();
    names.into_iter().map(attribute).collect()
}

/// A compressed file has the same content and names, in filters that every reader has; expanded it
/// is as the run wrote it, and goes on as that.
#[test]
fn files_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (plain, path) = (at("plain.h5"), at("run.h5"));
    file(&plain, 150);
    std::fs::copy(&plain, &path).unwrap();
    expand(&path).unwrap();
    assert!(std::fs::read(&path).unwrap() == std::fs::read(&plain).unwrap());
    compress(&Solo, &path).unwrap();
    let [before, after] = [&plain, &path].map(|path| std::fs::metadata(path).unwrap().len());
    assert!(after < before * 7 / 10, "{after} of {before}");
    let numbers = |path: &Path| -> Vec<(String, Vec<u8>)> {
        let content = content(path).into_iter();
        content.map(|(name, bytes, _)| (name, bytes)).collect()
    };
    assert!(numbers(&plain) == numbers(&path));
    for object in ["parameters", "h5md/author", "particles/trajectory/box"] {
        assert_eq!(attributes(&path, object), attributes(&plain, object));
    }
    {
        let file = File::open(&path).unwrap();
        let filters = [Filter::shuffle(), Filter::deflate(1)];
        for (name, chunk) in [
            ("particles/trajectory/position/value", vec![16, GRAINS, 1]),
            (
                "particles/trajectory/angular_velocity/value",
                vec![64, GRAINS],
            ),
            ("connectivity/contacts/normal_force", vec![32_768]),
            ("connectivity/wall_contacts/wall", vec![1024]),
        ] {
            let dataset = file.dataset(name).unwrap();
            assert_eq!(dataset.filters(), filters, "{name}");
            assert_eq!(dataset.chunk(), Some(chunk), "{name}");
        }
        let unit = file.dataset("connectivity/contacts/overlap").unwrap();
        assert_eq!(unit.attr_names().unwrap(), ["unit"]);
        // Two names of one object stay so, and the reference is one to the grains.
        let place = |name: &str| file.loc_info_by_name(name).unwrap().token;
        let steps = [
            "particles/trajectory/velocity/step",
            "connectivity/contacts/step",
        ];
        assert_eq!(place(steps[0]), place(steps[1]));
        let contacts = file.group("connectivity/contacts").unwrap();
        let reference = contacts.attr("particles_group").unwrap();
        let reference = reference.read_scalar::<hdf5::ObjectReference1>().unwrap();
        let hdf5::ReferencedObject::Group(grains) = contacts.dereference(&reference).unwrap()
        else {
            panic!("no group");
        };
        assert_eq!(grains.name(), "/particles/trajectory");
    }
    let run = RunFile::open(&path).unwrap();
    for step in [0, 77, 149] {
        let frame = run.frame(step).unwrap();
        let is_of_wall = |contact: &ContactSample| contact.wall(GRAINS).is_some();
        let (of_walls, between): (Vec<_>, Vec<_>) =
            contacts(step as u64).into_iter().partition(is_of_wall);
        assert_eq!(frame.grains, grains(step as u64));
        assert_eq!((frame.contacts, frame.wall_contacts), (between, of_walls));
    }
    drop(run);

    // As a file that was never compressed goes on, and in a file linked to another disk.
    std::fs::create_dir(at("disk")).unwrap();
    std::fs::rename(&path, at("disk/run.h5")).unwrap();
    std::os::unix::fs::symlink(at("disk/run.h5"), &path).unwrap();
    for path in [&plain, &path] {
        let columns = &SeriesRow::COLUMNS;
        let mut writer = TrajectoryWriter::open_to_append(&Solo, path, columns, 77, 90).unwrap();
        write(&mut writer, 77..140);
        writer.finish(&Solo, &[]).unwrap();
    }
    assert!(path.is_symlink());
    assert!(content(&plain) == content(&path), "chunks as well");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
}

/// A flipped bit of compressed numbers is refused, and the file stays; or deflate does not use it,
/// and the numbers are the same.
#[test]
fn damaged_numbers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    file(&path, 20);
    let plain = content(&path);
    compress(&Solo, &path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let places = {
        let file = File::open(&path).unwrap();
        let mut places = Vec::new();
        each_dataset(&file, &mut |dataset: Dataset| {
            if dataset.name().contains("velocity") || dataset.name().contains("force") {
                places.extend((0..dataset.num_chunks().unwrap_or(0)).map(|k| {
                    let chunk = dataset.chunk_info(k).unwrap();
                    chunk.addr as usize + chunk.size as usize / 2
                }));
            }
        })
        .unwrap();
        places
    };
    assert!(places.len() > 6, "{places:?}");
    let mut refused = 0;
    for &place in &places {
        let mut bytes = whole.clone();
        bytes[place] ^= 4;
        std::fs::write(&path, &bytes).unwrap();
        let Err(failure) = expand(&path) else {
            assert!(content(&path) == plain);
            continue;
        };
        refused += 1;
        assert!(matches!(failure, Failure::Input(_)), "{failure}");
        let said = failure.to_string();
        assert!(
            said.contains("run.h5") && said.contains("cannot be read"),
            "{said}"
        );
        assert!(std::fs::read(&path).unwrap() == bytes);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
    assert!(refused > places.len() / 2, "{refused} of {}", places.len());
}
