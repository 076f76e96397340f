//! Folders have owners, through the real program: what a run may write into, and what it leaves
//! alone.

mod identity;
mod links;
mod pipes;
mod resume;
mod under_way;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::common::{Outcome, gshear_mpi, program};
use gshear_driver::header::Header;
use gshear_store::checkpoint;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/crossing.toml");
const BOX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/periodic.toml");
const SHORT: &str = "--set=shear.strain=0.1";
/// Long enough to be interrupted.
const LONG: &str = "--set=shear.strain=500";

fn run(folder: &Path, arguments: &[&str]) -> Outcome {
    let arguments: Vec<String> = arguments.iter().map(ToString::to_string).collect();
    gshear_mpi(1, folder, &arguments)
}

/// Without `--out`.
fn plain(at: &Path, arguments: &[&str]) -> Outcome {
    let mut command = program(1);
    let output = command.args(arguments).current_dir(at).output();
    let output = output.expect("the program starts");
    Outcome {
        code: output.status.code().unwrap_or(-1),
        text: String::from_utf8_lossy(&output.stdout).into_owned()
            + &String::from_utf8_lossy(&output.stderr),
    }
}

fn ended(outcome: &Outcome, code: i32, words: &[&str]) {
    assert_eq!(outcome.code, code, "{}", outcome.text);
    for word in words {
        assert!(
            outcome.text.contains(word),
            "no {word:?} in {}",
            outcome.text
        );
    }
    let errors = outcome.text.matches("error: ").count();
    assert_eq!(
        errors,
        usize::from(![0, 75].contains(&code)),
        "{}",
        outcome.text
    );
}

/// Every file of a folder with its bytes.
fn bytes(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let paths = entries.map(|entry| entry.expect("an entry").path());
    paths
        .filter(|path| path.is_file())
        .map(|path| (path.clone(), std::fs::read(path).expect("a file")))
        .collect()
}

/// An attribute of `parameters` that is text.
fn attribute(file: &Path, name: &str) -> Option<String> {
    let part = file.ends_with("newtonian").then(|| file.parent()).flatten();
    let (file, group) = part.map_or((file, ""), |file| (file, "newtonian/"));
    let file = hdf5::File::open(file).expect("a file of the run");
    let parameters = (file.group(&format!("{group}parameters"))).expect("parameters");
    let value = parameters.attr(name).ok()?;
    let value = value.read_scalar::<hdf5::types::VarLenUnicode>();
    Some(value.expect("text").to_string())
}

fn id_of_checkpoint(path: &Path) -> String {
    let [header, _] = checkpoint::read_texts(path).expect("a checkpoint");
    let (_, record, _) = Header::parse(path, &header).expect("a header");
    record.id
}

fn stopped(folder: &Path, step: &str, more: &[&str]) -> PathBuf {
    let outcome = run(
        folder,
        &[&[SCENE, SHORT, "--stop-at", step][..], more].concat(),
    );
    ended(&outcome, 75, &[]);
    folder.join("checkpoint.h5")
}

fn resume(path: &Path) -> String {
    format!("--resume={}", path.display())
}
