//! Every file of `bad_input/` is refused with the very message that it carries.

use std::path::Path;

use gshear_dem::failure::Failure;
use gshear_scene::{Source, load};

/// Where the bad inputs lie. Each file's first line is `# expect: ` and the whole
/// message, without the folder; ` …` at its end stands for a list of keys. Most extend a scene of
/// `bases` and have only what is wrong.
pub const BAD_INPUTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bad_input");

/// Runs every so many bad inputs and compares their messages with those they carry. `run` takes the
/// file's path and returns the message, without the `error: ` that a program puts before it.
pub fn each_bad_input(every: usize, run: impl Fn(&Path) -> String) {
    let mut paths: Vec<_> = std::fs::read_dir(BAD_INPUTS)
        .expect("the folder of the bad inputs")
        .map(|entry| entry.expect("an entry of the folder").path())
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        .collect();
    paths.sort();
    assert!(!paths.is_empty(), "no bad inputs in {BAD_INPUTS}");

    let mut wrong = String::new();
    for path in paths.iter().step_by(every) {
        let text = std::fs::read_to_string(path).expect("a bad input is text");
        let first = text.lines().next().unwrap_or_default();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let expected = first
            .strip_prefix("# expect: ")
            .unwrap_or_else(|| panic!("{name}: the first line is not `# expect: …`"));
        let found = run(path).replace(&format!("{BAD_INPUTS}/"), "");
        // A list of all keys of a table is said by its declarations.
        let fits = match expected.strip_suffix(" …") {
            Some(start) => found.starts_with(start),
            None => found == expected,
        };
        if !fits {
            wrong += &format!("{name}\n  expected: {expected}\n  found:    {found}\n");
        }
    }
    assert!(wrong.is_empty(), "messages differ:\n{wrong}");
}

#[test]
fn load_tells_what_is_wrong() {
    each_bad_input(1, |path| {
        match Source::read(path).and_then(|source| load(&source, &[])) {
            Ok(_) => "no error".into(),
            Err(Failure::Input(message)) => message,
            Err(other) => format!("not a bad input: {other:?}"),
        }
    });
}
