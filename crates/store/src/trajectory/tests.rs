use super::*;
use crate::layout::OBSERVABLES;
use crate::run_reader::RunFile;
use bytemuck::Zeroable;
use gshear_dem::domain::Solo;
use gshear_dem::failure::Failure;
use gshear_dem::state::{SeriesRow, body};

fn row(k: u64) -> SeriesRow {
    SeriesRow::from_columns(std::array::from_fn(|c| (100 * k + c as u64) as f64))
}

/// A file with the rows `0..rows` and one frame of one grain.
fn create(path: &Path, rows: u64) {
    let grains = [GrainShape {
        radius: 1.0,
        mass: 1.0,
        ..GrainShape::zeroed()
    }];
    let header = RunHeader {
        form: FrameFormat::new(2, false),
        units: true,
        series: &SeriesRow::COLUMNS,
        edges: [2.0, 3.0, 0.0],
        grains: &grains,
        attributes: &[("scene", "seed = 1".into())],
        ..RunHeader::default()
    };
    let mut writer = TrajectoryWriter::create(&Solo, path, &header).unwrap();
    let (clock, edges, grain) = ((0, 0.0), [[0.0; 3]; 3], GrainSample::zeroed());
    let written = writer.frame(&Solo, clock, &edges, &[grain], &[]);
    written.unwrap();
    (0..rows).for_each(|k| writer.series(&Solo, k, k as f64, &row(k)).unwrap());
    writer.finish(&Solo, &[]).unwrap();
}

/// Gives a column another name, or takes it away (`None`).
fn rename(path: &Path, from: &str, to: Option<&str>) {
    let file = hdf5::File::open_rw(path).unwrap();
    let group = file.group(OBSERVABLES).unwrap();
    match to {
        Some(to) => group.relink(from, to).unwrap(),
        None => group.unlink(from).unwrap(),
    }
}

fn append(path: &Path, frames: u64, rows: u64) -> Result<TrajectoryWriter> {
    TrajectoryWriter::open_to_append(&Solo, path, &SeriesRow::COLUMNS, frames, rows)
}

/// A file whose frames do not say which grains are removed, of an earlier version, is read and
/// continued as that version wrote it: by images along the axis that walls bound.
#[test]
fn removed_grains_are_read_as_each_version_wrote_them() {
    let folder = tempfile::tempdir().unwrap();
    let grains: [GrainShape; 2] = std::array::from_fn(|id| GrainShape {
        id: id as u32,
        radius: 1.0,
        mass: 1.0,
        ..GrainShape::zeroed()
    });
    let samples: [GrainSample; 2] = std::array::from_fn(|id| GrainSample {
        id: id as u32,
        removed: id as u32,
        image: [3, 0, 0],
        ..GrainSample::zeroed()
    });
    for removed in [true, false] {
        let path = folder.path().join(format!("{removed}.h5"));
        let header = RunHeader {
            form: FrameFormat {
                removed,
                ..FrameFormat::new(2, false)
            },
            series: &SeriesRow::COLUMNS,
            edges: [2.0, 3.0, 0.0],
            grains: &grains,
            attributes: &[("scene", "seed = 1".into())],
            ..RunHeader::default()
        };
        let mut writer = TrajectoryWriter::create(&Solo, &path, &header).unwrap();
        let edges = [[0.0; 3]; 3];
        let written = writer.frame(&Solo, (0, 0.0), &edges, &samples, &[]);
        written.unwrap();
        writer.finish(&Solo, &[]).unwrap();
        let mut writer = append(&path, 1, 0).unwrap();
        let written = writer.frame(&Solo, (1, 0.5), &edges, &samples, &[]);
        written.unwrap();
        writer.finish(&Solo, &[]).unwrap();

        let run = RunFile::open(&path).unwrap();
        assert_eq!(run.frames(), 2);
        for t in 0..2 {
            let frame = run.frame(t).unwrap();
            assert_eq!(frame.grains, samples, "{removed} {t}");
            let bodies: Vec<u32> = run.state(t).unwrap().0.iter().map(|g| g.body).collect();
            assert_eq!(bodies, [body::FREE, body::REMOVED]);
        }
        let file = hdf5::File::open(&path).unwrap();
        let images = file.dataset("particles/trajectory/image/value").unwrap();
        let images: Vec<i32> = images.read_raw().unwrap();
        let of_wall = i32::from(!removed);
        assert_eq!(images[..6], [3, 0, 0, 3, of_wall, 0]);
        assert_eq!(file.link_exists("particles/trajectory/removed"), removed);
    }
}

/// What bounds the sample and the box that a file has must fit.
#[test]
fn a_boundary_that_the_box_is_not_of_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    create(&path, 1);
    assert!(RunFile::open(&path).is_ok());
    for (name, why) in [
        ("periodic", "box/edges/value: is not of a sample"),
        ("walls of glass", "is none that this version knows"),
    ] {
        create(&path, 1);
        let writer = append(&path, 1, 1).unwrap();
        let written = writer.finish(&Solo, &[("boundary", name.into())]);
        let refused = written.err().unwrap().to_string();
        assert!(refused.contains(why), "{refused}");
        let refused = RunFile::open(&path).err().unwrap().to_string();
        assert!(refused.contains(why), "{refused}");
    }
}

#[test]
fn a_file_of_other_columns_is_not_continued() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |from: &str, to: Option<&str>| {
        let path = folder.path().join("run.h5");
        create(&path, 3);
        rename(&path, from, to);
        match append(&path, 1, 3) {
            Err(Failure::Input(message)) => message,
            _ => panic!("not refused"),
        }
    };
    assert!(refused("slip_rate", None).contains("no column slip_rate"));
    assert!(refused("strain", None).contains("no column strain"));
    assert!(refused("slip", Some("offset")).contains("no column slip;"));
    let path = folder.path().join("run.h5");
    create(&path, 3);
    let file = hdf5::File::open_rw(&path).unwrap();
    for name in ["temperature", "gshear"] {
        file.create_group(&format!("{OBSERVABLES}/{name}")).unwrap();
    }
    drop(file);
    let message = append(&path, 1, 3).err().unwrap().to_string();
    assert!(message.contains("its column temperature"), "{message}");
}

#[test]
fn values_have_units_per_unit_depth() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.h5");
    create(&path, 1);
    let file = hdf5::File::open(&path).unwrap();
    let unit = |name: &str| {
        let values = file.dataset(&format!("{OBSERVABLES}/{name}/value"));
        let unit = values.unwrap().attr("unit").ok()?;
        Some(unit.read_scalar::<h5::Word>().unwrap().to_string())
    };
    assert_eq!(unit("slip_rate").as_deref(), Some("m s-1"));
    assert_eq!(unit("work_load").as_deref(), Some("J m-1"));
    assert_eq!(unit("strain"), None);
}

/// Frame `step` of grains and contacts with numbers of their own.
fn numbered(step: u64) -> (Vec<GrainSample>, Vec<ContactSample>) {
    let mixed = |n: u64| (n.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11) as f64 * 1e-16;
    let grains = (0..GRAINS as u32).map(|id| {
        let n = step << 20 | u64::from(id) << 4;
        GrainSample {
            id,
            position: [mixed(n), mixed(n + 1), 0.0],
            velocity: [mixed(n + 2), mixed(n + 3), 0.0],
            angular_velocity: [0.0, 0.0, mixed(n + 4)],
            image: [step as i64 % 3 - 1, 0, 0],
            ..GrainSample::zeroed()
        }
    });
    // As many as chunks do not have by a whole number.
    let contacts = (1..GRAINS as u32 - (step % 7) as u32).map(|j| {
        let n = step << 20 | u64::from(j) << 4;
        ContactSample {
            i: j - 1,
            j,
            normal_force: mixed(n + 5),
            tangential_force: [mixed(n + 6), 0.0, 0.0],
            overlap: mixed(n + 7),
            tangential_history: [mixed(n + 8), 0.0, 0.0],
            rolling_history: mixed(n + 9),
            sliding: u64::from(j) % 2,
            ..ContactSample::zeroed()
        }
    });
    (grains.collect(), contacts.collect())
}

const GRAINS: usize = 700;

fn numbered_file(path: &Path, histories: bool) -> TrajectoryWriter {
    let grains: Vec<GrainShape> = (0..GRAINS as u32)
        .map(|id| GrainShape {
            id,
            radius: 1.0,
            mass: 1.0,
            ..GrainShape::zeroed()
        })
        .collect();
    let header = RunHeader {
        form: FrameFormat {
            histories,
            ..FrameFormat::new(2, false)
        },
        series: &SeriesRow::COLUMNS,
        edges: [2.0, 3.0, 0.0],
        grains: &grains,
        attributes: &[("scene", "seed = 1".into())],
        ..RunHeader::default()
    };
    TrajectoryWriter::create(&Solo, path, &header).unwrap()
}

fn write_numbered(writer: &mut TrajectoryWriter, steps: std::ops::Range<u64>) {
    for step in steps {
        let (grains, contacts) = numbered(step);
        let clock = (step, step as f64);
        let written = writer.frame(&Solo, clock, &[[0.0; 3]; 3], &grains, &contacts);
        written.unwrap();
    }
}

/// The first `frames` frames have the numbers of [`numbered`], bit for bit.
fn assert_numbered(path: &Path, frames: u64, histories: bool) {
    let run = RunFile::open(path).unwrap();
    assert!(run.frames() as u64 >= frames);
    for step in 0..frames {
        let frame = run.frame(step as usize).unwrap();
        let (grains, mut contacts) = numbered(step);
        if !histories {
            for contact in &mut contacts {
                (contact.tangential_history, contact.rolling_history) = ([0.0; 3], 0.0);
            }
        }
        assert_eq!(frame.grains, grains, "frame {step}");
        assert_eq!(frame.contacts, contacts, "frame {step}");
    }
}

/// Frames are compressed with filters that every reader has, one component in a chunk, and come
/// back as they were: after flushes within chunks, and of a file that was cut and continued.
#[test]
fn compressed_frames_come_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for histories in [true, false] {
        let path = folder.path().join(format!("{histories}.h5"));
        let mut writer = numbered_file(&path, histories);
        write_numbered(&mut writer, 0..11);
        writer.flush(&Solo).unwrap();
        write_numbered(&mut writer, 11..150);
        writer.finish(&Solo, &[]).unwrap();
        assert_numbered(&path, 150, histories);
        let mut writer = append(&path, 77, 0).unwrap();
        assert_eq!(writer.columns.form.histories, histories);
        write_numbered(&mut writer, 77..140);
        writer.finish(&Solo, &[]).unwrap();
        assert_numbered(&path, 140, histories);

        let file = hdf5::File::open(&path).unwrap();
        let filters = [
            hdf5::filters::Filter::shuffle(),
            hdf5::filters::Filter::deflate(1),
        ];
        let contacts: usize = (0..140).map(|step| GRAINS - 1 - step % 7).sum();
        for (name, shape, chunk) in [
            (
                "particles/trajectory/position/value",
                vec![140, GRAINS, 3],
                vec![32, GRAINS, 1],
            ),
            (
                "particles/trajectory/angular_velocity/value",
                vec![140, GRAINS],
                vec![32, GRAINS],
            ),
            (
                "connectivity/contacts/normal_force",
                vec![contacts],
                vec![32_768],
            ),
        ] {
            let dataset = file.dataset(name).unwrap();
            assert_eq!(dataset.filters(), filters, "{name}");
            assert_eq!(
                (dataset.shape(), dataset.chunk()),
                (shape, Some(chunk)),
                "{name}"
            );
        }
        for name in ["tangential_history", "rolling_history"] {
            assert_eq!(file.link_exists(&layout::contact_dataset(name)), histories);
        }
    }
}

/// A kill at any time after a checkpoint leaves what it counts on: chunks that were not full then
/// get new places, and their old ones are used for other numbers.
#[test]
fn compressed_frames_survive_a_kill_after_a_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let [path, killed, again] =
        ["run.h5", "killed.h5", "again.h5"].map(|name| folder.path().join(name));
    // As a kill leaves it.
    let copy = |from: &Path, to: &Path| {
        std::fs::copy(from, to).unwrap();
        std::fs::copy(journal::path_of(from), journal::path_of(to)).unwrap();
    };
    let mut writer = numbered_file(&path, true);
    let mut from = 0;
    for (checkpoint, to) in [(45, 60), (70, 71), (72, 200), (200, 233)] {
        write_numbered(&mut writer, from..checkpoint);
        writer.flush(&Solo).unwrap();
        write_numbered(&mut writer, checkpoint..to);
        writer.write_frames(&Solo).unwrap();
        writer.flush_file(&Solo).unwrap();
        from = to;
        copy(&path, &killed);
        let mut notes = Vec::new();
        crate::existing::recover(&killed, &mut notes).unwrap();
        assert_eq!(notes, Vec::<String>::new());
        assert_numbered(&killed, checkpoint, true);
        // As it goes on from an earlier checkpoint, and is killed again.
        let mut resumed = append(&killed, checkpoint - 9, 0).unwrap();
        write_numbered(&mut resumed, checkpoint - 9..checkpoint + 40);
        resumed.write_frames(&Solo).unwrap();
        resumed.flush_file(&Solo).unwrap();
        copy(&killed, &again);
        crate::existing::recover(&again, &mut notes).unwrap();
        assert_numbered(&again, checkpoint - 9, true);
        resumed.finish(&Solo, &[]).unwrap();
        assert_numbered(&killed, checkpoint + 40, true);
    }
    writer.finish(&Solo, &[]).unwrap();
    assert_numbered(&path, 233, true);
}
