//! What is in a run's files does not depend on the number of ranks that wrote them: this test
//! starts itself under mpirun, as
//! [`program`].

#[path = "../common/mod.rs"]
mod common;
mod program;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

use common::synthetic::{attributes, contact, edges, grain, pairs, row, shapes};
use common::{mpirun, on_ranks, rank_arguments, rank_program, run_tests, succeed};
use hdf5::types::{FloatSize, IntSize, TypeDescriptor, VarLenUnicode};

fn main() -> ExitCode {
    if let Some(arguments) = rank_arguments() {
        program::run(&arguments);
        return ExitCode::SUCCESS;
    }
    run_tests(&[
        (
            "files_are_the_same_from_any_number_of_ranks",
            files_are_the_same_from_any_number_of_ranks,
        ),
        (
            "damage_gives_one_message_on_all_ranks",
            damage_gives_one_message_on_all_ranks,
        ),
        (
            "a_full_disk_ends_every_rank_with_one_reason",
            a_full_disk_ends_every_rank_with_one_reason,
        ),
    ])
}

/// Every dataset of a file: shape and bytes.
fn datasets(path: &Path) -> BTreeMap<String, (Vec<usize>, Vec<u8>)> {
    fn walk(group: &hdf5::Group, found: &mut BTreeMap<String, (Vec<usize>, Vec<u8>)>) {
        for dataset in group.datasets().unwrap() {
            let bytes: Vec<u8> = match dataset.dtype().unwrap().to_descriptor().unwrap() {
                TypeDescriptor::Float(FloatSize::U8) => {
                    bytemuck::cast_slice(&dataset.read_raw::<f64>().unwrap()).into()
                }
                TypeDescriptor::Unsigned(IntSize::U8) => {
                    bytemuck::cast_slice(&dataset.read_raw::<u64>().unwrap()).into()
                }
                TypeDescriptor::Unsigned(IntSize::U4) => {
                    bytemuck::cast_slice(&dataset.read_raw::<u32>().unwrap()).into()
                }
                TypeDescriptor::Integer(IntSize::U8) => {
                    bytemuck::cast_slice(&dataset.read_raw::<i64>().unwrap()).into()
                }
                TypeDescriptor::Integer(IntSize::U4) => {
                    bytemuck::cast_slice(&dataset.read_raw::<i32>().unwrap()).into()
                }
                TypeDescriptor::Unsigned(IntSize::U1) => dataset.read_raw::<u8>().unwrap(),
                other => panic!("{}: {other}", dataset.name()),
            };
            found.insert(dataset.name(), (dataset.shape(), bytes));
        }
        group.groups().unwrap().iter().for_each(|g| walk(g, found));
    }
    let mut found = BTreeMap::new();
    walk(&hdf5::File::open(path).unwrap(), &mut found);
    found
}

fn files_are_the_same_from_any_number_of_ranks() {
    for grains in [3, 37] {
        let folders: Vec<_> = [1, 2, 3, 5]
            .map(|ranks| {
                let folder = tempfile::tempdir().unwrap();
                succeed(on_ranks(ranks).arg(folder.path()).arg(grains.to_string()));
                folder
            })
            .into();
        let files = |name: &str| {
            folders
                .iter()
                .map(|f| f.path().join(name))
                .collect::<Vec<_>>()
        };
        let texts: Vec<_> = files("log.csv")
            .iter()
            .map(|p| std::fs::read_to_string(p).unwrap())
            .collect();
        assert!(texts.iter().all(|t| *t == texts[0]) && texts[0].lines().count() == 1201);
        for name in ["run.h5", "checkpoint.h5", "checkpoint.previous.h5"] {
            let paths = files(name);
            let first = datasets(&paths[0]);
            for path in &paths[1..] {
                let other = datasets(path);
                assert!(first.keys().eq(other.keys()));
                for (object, values) in &first {
                    assert!(
                        *values == other[object],
                        "{name} of {grains} grains: {object}"
                    );
                }
            }
        }
        for path in files("run.h5") {
            content(&path, grains);
        }
        common::no_parts(folders[0].path());
    }
}

/// Number by number what the ranks have written.
fn content(path: &Path, grains: u64) {
    let file = hdf5::File::open(path).unwrap();
    let numbers = |name: &str| file.dataset(name).unwrap().read_raw::<f64>().unwrap();
    let ids = |name: &str| file.dataset(name).unwrap().read_raw::<u64>().unwrap();
    let frames = 0..150u64;
    let shapes = shapes(grains);
    let of_grains = |part: &str| numbers(&format!("particles/trajectory/{part}"));
    assert_eq!(
        of_grains("radius"),
        shapes.iter().map(|g| g.radius).collect::<Vec<_>>()
    );
    assert_eq!(
        of_grains("mass"),
        shapes.iter().map(|g| g.mass).collect::<Vec<_>>()
    );
    assert!(
        of_grains("box/edges/value")
            .chunks(3)
            .eq((0..150).map(|t| { [20.0, edges(t)[1][1], 1.0] }))
    );
    let body = file
        .dataset("particles/trajectory/body")
        .unwrap()
        .read_raw::<u8>()
        .unwrap();
    assert!(
        body.iter()
            .zip(&shapes)
            .all(|(&b, g)| u32::from(b) == g.body)
            && body.len() == shapes.len()
    );

    let all = frames
        .clone()
        .flat_map(|t| (0..grains).map(move |id| grain(t, id)));
    let position: Vec<f64> = all.clone().flat_map(|g| g.position).collect();
    assert_eq!(of_grains("position/value"), position);
    let velocity: Vec<f64> = all.clone().flat_map(|g| g.velocity).collect();
    assert_eq!(of_grains("velocity/value"), velocity);
    let images = file.dataset("particles/trajectory/image/value").unwrap();
    let images: Vec<i64> = images.read_raw().unwrap();
    let expected: Vec<i64> = all.clone().flat_map(|g| g.image).collect();
    assert_eq!(images, expected);
    assert_eq!(
        of_grains("angular_velocity/value"),
        all.map(|g| g.angular_velocity[2]).collect::<Vec<_>>()
    );
    for element in [
        "particles/trajectory/position",
        "particles/trajectory/angular_velocity",
        "connectivity/contacts",
    ] {
        assert!(
            ids(&format!("{element}/step"))
                .into_iter()
                .eq(frames.clone().map(|t| 10 * t))
        );
        assert!(
            numbers(&format!("{element}/time"))
                .into_iter()
                .eq(frames.clone().map(|t| t as f64 * 0.1))
        );
    }

    let contacts: Vec<_> = frames
        .clone()
        .flat_map(|t| pairs(t, grains).into_iter().map(move |p| contact(t, p)))
        .collect();
    let offset = ids("connectivity/contacts/offset");
    let counts = frames.map(|t| pairs(t, grains).len() as u64);
    assert!(offset[0] == 0 && offset.windows(2).map(|w| w[1] - w[0]).eq(counts));
    let of_contacts = |part: &str| numbers(&format!("connectivity/contacts/{part}"));
    assert_eq!(
        of_contacts("normal_force"),
        contacts.iter().map(|c| c.normal_force).collect::<Vec<_>>()
    );
    assert_eq!(
        of_contacts("tangential_force"),
        contacts
            .iter()
            .map(|c| c.tangential_force[0])
            .collect::<Vec<_>>()
    );
    assert_eq!(
        of_contacts("tangential_history"),
        contacts
            .iter()
            .map(|c| c.tangential_history[0])
            .collect::<Vec<_>>()
    );
    assert_eq!(
        of_contacts("rolling_history"),
        contacts
            .iter()
            .map(|c| c.rolling_history)
            .collect::<Vec<_>>()
    );
    assert_eq!(
        of_contacts("overlap"),
        contacts.iter().map(|c| c.overlap).collect::<Vec<_>>()
    );
    assert!(
        ids("connectivity/contacts/i")
            .into_iter()
            .eq(contacts.iter().map(|c| u64::from(c.i)))
    );
    assert!(
        ids("connectivity/contacts/j")
            .into_iter()
            .eq(contacts.iter().map(|c| u64::from(c.j)))
    );
    assert!(
        ids("connectivity/contacts/sliding")
            .into_iter()
            .eq(contacts.iter().map(|c| c.sliding))
    );
    assert!(
        ids("connectivity/contacts/rolling")
            .into_iter()
            .eq(contacts.iter().map(|c| c.rolling))
    );

    for (c, name) in gshear_dem::state::SeriesRow::COLUMNS.iter().enumerate() {
        assert!(
            ids(&format!("observables/{name}/step"))
                .into_iter()
                .eq((0..1200).map(|k| 5 * k))
        );
        let values = numbers(&format!("observables/{name}/value"));
        assert!(
            values
                .into_iter()
                .eq((0..1200).map(|k| row(k).columns()[c]))
        );
    }

    let parameters = file.group("parameters").unwrap();
    let text = |name: &str| {
        parameters
            .attr(name)
            .unwrap()
            .read_scalar::<VarLenUnicode>()
            .unwrap()
    };
    assert!(attributes()[0].1 == gshear_store::h5::Attribute::Text(text("scene").to_string()));
    assert_eq!(text("digest").as_str(), "0123456789abcdef");
    assert_eq!(
        parameters
            .attr("ranks")
            .unwrap()
            .read_scalar::<u64>()
            .unwrap(),
        7
    );
    assert_eq!(
        parameters
            .attr("time_step")
            .unwrap()
            .read_scalar::<f64>()
            .unwrap(),
        6.0e-11
    );
    assert_eq!(
        parameters
            .attr("rank_map")
            .unwrap()
            .read_raw::<f64>()
            .unwrap(),
        [0.0, 10.0, 20.0]
    );
    assert_eq!(
        file.group("h5md")
            .unwrap()
            .attr("version")
            .unwrap()
            .read_raw::<i32>()
            .unwrap(),
        [1, 1]
    );
}

fn damage_gives_one_message_on_all_ranks() {
    let folder = tempfile::tempdir().unwrap();
    succeed(on_ranks(2).arg(folder.path()).arg("37"));
    let path = folder.path().join("checkpoint.h5");
    let whole = std::fs::read(&path).unwrap();
    let message = |ranks| {
        let output = succeed(on_ranks(ranks).arg("damaged").arg(&path));
        String::from_utf8(output.stdout).unwrap()
    };
    // In the half of the contacts' histories that only the last rank reads.
    let history = hdf5::File::open(&path)
        .unwrap()
        .dataset("contacts/history")
        .unwrap();
    let place = history.offset().unwrap() as usize + history.size() * 8 - 3;
    drop(history);
    let mut flipped = whole.clone();
    flipped[place] ^= 4;
    std::fs::write(&path, flipped).unwrap();
    assert!(message(3).contains("checkpoint.h5: damaged: the checksum of its contacts"));
    std::fs::write(&path, &whole[..whole.len() - 100]).unwrap();
    assert!(message(3).contains("not an HDF5 file, or damaged"));
    std::fs::remove_file(&path).unwrap();
    assert!(message(2).contains("there is no such checkpoint"));
}

fn a_full_disk_ends_every_rank_with_one_reason() {
    let folder = tempfile::tempdir().unwrap();
    for ranks in [1, 2] {
        // Beyond the limit a write fails, as on a full disk.
        let limited = "trap '' XFSZ; ulimit -f 65536; exec \"$0\" \"$@\"";
        let mut command = mpirun(ranks, "sh");
        command.args(["-c", limited]).args(rank_program());
        let output = command.arg("time").arg(folder.path()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            said.contains("time.h5: ") && said.contains(": cannot "),
            "{said}"
        );
    }
}
