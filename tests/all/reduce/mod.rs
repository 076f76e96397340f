//! `gshear-reduce` through its binary, on made-up runs.

mod compare;
mod correlate;
mod events;
mod export;
mod fixture;
mod laboratory;
mod movie;
mod rate_state;
mod reading;
mod references;
mod results;
mod spectrum;
mod sweep;

use crate::common::reducer;
use std::path::Path;
use std::process::Output;

use fixture::Fixture;
use tempfile::TempDir;

fn reduce(arguments: &[&str]) -> Output {
    reducer()
        .args(arguments)
        .output()
        .expect("the program runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

/// A folder with the run of `fixture` in it.
fn folder_with(fixture: &Fixture) -> (TempDir, String) {
    let folder = tempfile::tempdir().expect("a folder");
    fixture.write(&folder.path().join("run.h5"));
    let path = folder.path().to_str().expect("UTF-8").to_string();
    (folder, path)
}

/// Every column of these tables is described in the file beside it.
fn are_described(folder: &Path, tables: &[&str]) {
    for table in tables {
        let csv = std::fs::read_to_string(folder.join(table)).expect("a table");
        let names = csv.lines().next().expect("a line").split(',');
        let path = folder.join(format!("{table}-metadata.json"));
        let metadata = std::fs::read(path).unwrap_or_else(|e| panic!("{table}: {e}"));
        let metadata: serde_json::Value = serde_json::from_slice(&metadata).expect("JSON");
        let columns = metadata["tableSchema"]["columns"]
            .as_array()
            .expect("columns");
        assert_eq!(metadata["url"], *table);
        assert!(
            columns.iter().map(|column| &column["name"]).eq(names),
            "{table}"
        );
    }
}

/// Asks for exit code 0 and nothing on standard error; returns standard output.
fn done(arguments: &[&str]) -> String {
    let output = reduce(arguments);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{arguments:?}: {}",
        text(&output.stderr)
    );
    assert_eq!(text(&output.stderr), "");
    text(&output.stdout)
}

/// Asks for exit code 2 and one line on standard error; returns it.
fn refused(arguments: &[&str]) -> String {
    let output = reduce(arguments);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    assert!(message.starts_with("error: "), "{message}");
    message
}

#[test]
fn bad_arguments_are_refused() {
    let (_folder, path) = folder_with(&Fixture::small());
    assert!(refused(&["dmin", &path, "--radius", "-1"]).contains("--radius -1"));
    for arguments in [
        &["melt", &path][..],
        &["info"],
        &["info", &path, "--threads", "0"],
    ] {
        assert_eq!(reduce(arguments).status.code(), Some(2), "{arguments:?}");
    }
}
