//! The configuration: raw (serde, unknown keys denied), then checked (a scene in which nothing is optional any more).
//!
//! [`load`] is the way in. Every message names file and line, or the `--set` it comes from.

mod check;
mod checker;
pub mod derived;
mod keys;
mod overrides;
mod raw;
mod scene;
mod source;
mod write;

use serde::Deserialize;
use toml::Spanned;
use toml::de::DeTable;

pub use scene::*;
pub use source::Source;

use crate::failure::Failure;
use source::Input;

/// Reads a configuration, replaces values by the overrides (`key.path=value`, as of `--set`), checks it and derives the rest.
///
/// An override's value is TOML, or a bare word taken as a string; `none` takes a key away.
///
/// # Errors
/// `Failure::Input` with the first problem: where it is, what is wrong, and what would be right.
pub fn load(source: &Source, overrides: &[String]) -> Result<Scene, Failure> {
    let input = Input { source, overrides };
    let mut tree = DeTable::parse(source.text())
        .map_err(|e| {
            let offset = e.span().map_or(0, |span| span.start);
            let what = format!("not TOML: {}", e.message());
            input.failure(offset, "", &what)
        })?
        .into_inner();
    keys::check_known(&tree, &input)?;
    let tables = tree
        .keys()
        .map(|key| (key.get_ref().to_string(), key.span().start))
        .collect();
    overrides::apply(&mut tree, &input)?;

    let paths = paths(&tree);
    let all = 0..input.override_offset(overrides.len());
    let raw =
        raw::Raw::deserialize(toml::Deserializer::from(Spanned::new(all, tree))).map_err(|e| {
            let offset = e.span().map_or(0, |span| span.start);
            let path = paths.iter().find(|(at, _)| *at == offset);
            input.failure(offset, path.map_or("", |(_, path)| path), e.message())
        })?;
    check::scene(raw, input, tables)
}

/// Where each value begins, and its key's path.
fn paths(tree: &DeTable<'_>) -> Vec<(usize, String)> {
    let mut all = Vec::new();
    for (key, value) in tree.iter() {
        match value.get_ref().as_table() {
            Some(table) => all.extend(
                table
                    .iter()
                    .map(|(k, v)| (v.span().start, format!("{}.{}", key.get_ref(), k.get_ref()))),
            ),
            None => all.push((value.span().start, key.get_ref().to_string())),
        }
    }
    all
}
