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
