//! What several unit tests of this crate share.

use crate::{Scene, Source, load};
use gshear_dem::failure::Result;

/// The rows of a table with a case a line and `|` between its K cells. `\n` is a line break in a
/// cell; lines that begin with `//` are comments.
pub fn cases<const K: usize>(table: &str) -> Vec<[String; K]> {
    let lines = table.lines().map(str::trim);
    let cells = |line: &str| -> Vec<String> {
        let cells = line.split('|').map(str::trim);
        cells.map(|cell| cell.replace("\\n", "\n")).collect()
    };
    lines
        .filter(|line| !line.is_empty() && !line.starts_with("//"))
        .map(|line| cells(line).try_into().expect("K cells"))
        .collect()
}

/// Overrides with spaces between them, as `--set` gives each.
pub fn overrides(sets: &str) -> Vec<String> {
    sets.split_whitespace().map(Into::into).collect()
}

/// The default scene with overrides.
pub fn embedded(sets: &str) -> Result<Scene> {
    load(&Source::embedded(), &overrides(sets))
}
