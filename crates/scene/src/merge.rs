//! `extends = "base.toml"`: a file has the keys of another one, and its own take precedence.

use toml::Spanned;
use toml::de::{DeTable, DeValue, Error};

use super::source::Input;
use super::words::{EXTENDS, SWEEP, TAKE_AWAY};
use super::{keys, sweep, words};
use gshear_dem::failure::{Failure, Result};

/// The merged tree of a file and those that it extends, without `extends` and `[sweep]`. Unknown
/// keys are refused.
pub(super) fn tree<'a>(input: &Input<'a>) -> Result<DeTable<'a>> {
    let source = input.source;
    let mut merged = DeTable::new();
    // Whether a sweep was found or taken away; those of bases do not count then.
    let mut sweeps = input
        .overrides
        .iter()
        .any(|set| sweep::takes_sweep_away(set));
    for (n, part) in source.parts.iter().enumerate() {
        let tree = DeTable::parse(&part.padded).map_err(|e| not_toml(input, &e))?;
        let mut tree = tree.into_inner();
        let sweep = tree.remove_entry(SWEEP);
        if let Some((key, value)) = sweep
            && !sweeps
            && !source.member
        {
            sweeps = true;
            if value.get_ref().as_str() != Some(TAKE_AWAY) {
                let what = sweep::not_one_run(source)?;
                return Err(input.failure(key.span().start, SWEEP, &what));
            }
        }
        let base = tree.remove_entry(EXTENDS);
        if let Some((key, _)) = base
            && n + 1 == source.parts.len()
        {
            let what = "only a file can extend another one; leave it out";
            return Err(input.failure(key.span().start, EXTENDS, what));
        }
        keys::check_known(&tree, input)?;
        merge(&mut merged, tree);
    }
    take_away(&mut merged);
    Ok(merged)
}

/// Adds the keys of `base` that the tree does not have.
fn merge<'a>(tree: &mut DeTable<'a>, base: DeTable<'a>) {
    for (key, value) in base {
        match tree.get_mut(&**key.get_ref()).map(Spanned::get_mut) {
            None => {
                tree.insert(key, value);
            }
            Some(DeValue::Table(inner)) => {
                if let DeValue::Table(base) = value.into_inner() {
                    merge(inner, base);
                }
            }
            Some(_) => {}
        }
    }
}

/// Removes the keys whose value says so.
fn take_away(tree: &mut DeTable<'_>) {
    let mut away = Vec::new();
    for (key, value) in tree.iter_mut() {
        match value.get_mut() {
            DeValue::Table(inner) => take_away(inner),
            DeValue::String(text) if text == TAKE_AWAY => away.push(key.get_ref().to_string()),
            _ => {}
        }
    }
    for key in away {
        tree.remove(&key[..]);
    }
}

fn not_toml(input: &Input<'_>, e: &Error) -> Failure {
    let offset = e.span().map_or(0, |span| span.start);
    let message = e.message().trim_end_matches(", expected nothing");
    let what = match input.text_of_line(offset).map(str::trim) {
        None | Some("") => format!("not TOML: {message}"),
        Some(line) => format!("not TOML: {message}: `{}`", words::shortened(line)),
    };
    input.failure(offset, "", &what)
}
