//! Checkpoints: every bit comes back, and no damage goes unnoticed.

use crate::common::synthetic::snapshot;
use gshear_dem::domain::Solo;
use gshear_dem::failure::Failure;
use gshear_dem::state::Snapshot;
use gshear_store::checkpoint::{NAME, PREVIOUS, VERSION, read, write};
use std::path::Path;

const TEXTS: [&str; 2] = ["{\"step\":1}", "seed = 1 # µ\n"];

fn refused(path: &Path) -> String {
    match read(&Solo, path) {
        Err(Failure::Input(message)) => message,
        other => panic!("not refused as input: {other:?}"),
    }
}

#[test]
fn every_bit_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut whole = snapshot(3, 50);
    // Bits that arithmetic or text would lose.
    whole.grains[0].torque[1] = f64::from_bits(0x7ff8_0000_dead_beef);
    whole.grains[1].force = [-0.0, f64::MIN_POSITIVE / 2.0, f64::MAX];
    write(&Solo, folder.path(), TEXTS, &whole).unwrap();
    let (texts, back) = read(&Solo, &folder.path().join(NAME)).unwrap();
    assert_eq!(texts, TEXTS);
    let bytes = |s: &Snapshot| {
        let contacts: Vec<u8> = bytemuck::cast_slice(&s.contacts).into();
        (bytemuck::cast_slice(&s.grains).to_vec(), contacts)
    };
    let (a, b): ((Vec<u8>, Vec<u8>), _) = (bytes(&back), bytes(&whole));
    assert!(a == b && !whole.contacts.is_empty());
}

#[test]
fn no_contacts_are_no_damage() {
    let folder = tempfile::tempdir().unwrap();
    let whole = Snapshot {
        analysed: None,
        displacements: None,
        contacts: Vec::new(),
        ..snapshot(3, 2)
    };
    write(&Solo, folder.path(), ["", ""], &whole).unwrap();
    assert_eq!(
        read(&Solo, &folder.path().join(NAME)).unwrap(),
        ([String::new(), String::new()], whole)
    );
}

#[test]
fn the_one_before_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    for t in 1..=3 {
        write(&Solo, folder.path(), TEXTS, &snapshot(t, 10)).unwrap();
    }
    assert_eq!(
        read(&Solo, &folder.path().join(NAME)).unwrap().1,
        snapshot(3, 10)
    );
    assert_eq!(
        read(&Solo, &folder.path().join(PREVIOUS)).unwrap().1,
        snapshot(2, 10)
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn a_flipped_bit_in_any_dataset_is_named() {
    let folder = tempfile::tempdir().unwrap();
    write(&Solo, folder.path(), TEXTS, &snapshot(3, 20)).unwrap();
    let path = folder.path().join(NAME);
    let whole = std::fs::read(&path).unwrap();
    let mut places = Vec::new();
    let file = hdf5::File::open(&path).unwrap();
    for (group, part) in [
        ("/", "its"),
        ("grains", "its grains"),
        ("contacts", "its contacts"),
        ("analysed/grains", "its grains of the analysed frame"),
        ("analysed/contacts", "its contacts of the analysed frame"),
        ("travels", "its displacements"),
    ] {
        for dataset in file.group(group).unwrap().datasets().unwrap() {
            let start = dataset.offset().unwrap() as usize;
            let end = start + dataset.size() * dataset.dtype().unwrap().size();
            places.extend([
                (start, part),
                (usize::midpoint(start, end), part),
                (end - 1, part),
            ]);
        }
    }
    drop(file);
    assert_eq!(places.len(), 3 * (2 + 10 + 6 + 4 + 4 + 5));
    for (place, part) in places {
        let mut damaged = whole.clone();
        damaged[place] ^= 1;
        std::fs::write(&path, damaged).unwrap();
        let message = refused(&path);
        assert!(
            message.contains(NAME) && message.contains("damaged: the checksum of"),
            "{message}"
        );
        assert!(message.contains(part), "{message}");
    }
}

/// Also where the file's structure is hit: refused, or nothing that matters was hit and the same
/// comes back; never a crash.
#[test]
fn a_flipped_bit_anywhere_changes_nothing_silently() {
    let folder = tempfile::tempdir().unwrap();
    let state = snapshot(3, 6);
    write(&Solo, folder.path(), TEXTS, &state).unwrap();
    let path = folder.path().join(NAME);
    let whole = std::fs::read(&path).unwrap();
    let (mut refusals, mut tries) = (0, 0);
    for place in (0..whole.len()).step_by(3) {
        let mut damaged = whole.clone();
        damaged[place] ^= 1 << (place % 8);
        std::fs::write(&path, damaged).unwrap();
        tries += 1;
        match read(&Solo, &path) {
            Ok(back) => assert_eq!(
                back,
                (TEXTS.map(String::from), state.clone()),
                "byte {place}"
            ),
            Err(Failure::Input(_)) => refusals += 1,
            Err(other) => panic!("byte {place}: {other}"),
        }
    }
    assert!(refusals > 0 && refusals < tries);
}

#[test]
fn what_is_no_whole_checkpoint_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(NAME);
    assert!(refused(&path).contains("there is no such checkpoint"));
    write(&Solo, folder.path(), TEXTS, &snapshot(3, 20)).unwrap();
    let whole = std::fs::read(&path).unwrap();
    for length in [0, 1, 100, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(
            refused(&path).contains("not an HDF5 file, or damaged"),
            "{length} bytes"
        );
    }
    std::fs::write(&path, "seed = 1\n").unwrap();
    assert!(refused(&path).contains("not an HDF5 file"));
    hdf5::File::create(&path)
        .unwrap()
        .create_group("grains")
        .unwrap();
    assert!(refused(&path).contains("not a checkpoint of gshear-mpi"));
    std::fs::write(&path, &whole).unwrap();
    let file = hdf5::File::open_rw(&path).unwrap();
    file.attr("format_version")
        .unwrap()
        .write_scalar(&(VERSION + 1))
        .unwrap();
    file.close().unwrap();
    let message = format!(
        "format version {}; this program reads version {VERSION}",
        VERSION + 1
    );
    assert!(refused(&path).contains(&message));
}

#[test]
fn a_folder_that_cannot_be_written_is_named() {
    let folder = Path::new("no/such/folder");
    let failure = write(&Solo, folder, TEXTS, &snapshot(3, 5)).unwrap_err();
    assert!(
        matches!(&failure, Failure::Other(m) if m.contains("no/such/folder")),
        "{failure}"
    );
}
