//! Unknown keys: what the messages suggest.

use strsim::levenshtein;
use toml::de::{DeTable, DeValue};

use super::key::Entry;
use super::overrides::TAKE_AWAY;
use super::raw::{TABLES, TOP_KEYS, keys_of};
use super::source::{EXTENDS, Input};
use super::sweep::SWEEP;
use gshear_dem::failure::Failure;

/// The key of this name.
fn find<'a>(keys: &'a [Entry], name: &str) -> Option<&'a Entry> {
    keys.iter().find(|key| key.name == name)
}

/// Refuses the first key of the file that the configuration does not know, and values where tables
/// belong.
pub(super) fn check_known(tree: &DeTable<'_>, input: &Input<'_>) -> Result<(), Failure> {
    let mut problems = Vec::new();
    for (key, value) in tree {
        let name: &str = key.get_ref();
        let offset = key.span().start;
        match (keys_of(name), value.get_ref()) {
            (Some(keys), DeValue::Table(table)) => {
                for (inner, _) in table {
                    let inner_name: &str = inner.get_ref();
                    if find(keys, inner_name).is_none() {
                        let what = unknown_key(name, inner_name);
                        problems.push((inner.span().start, format!("{name}.{inner_name}"), what));
                    }
                }
            }
            (Some(_), DeValue::String(text)) if text == TAKE_AWAY => {}
            (Some(keys), other) => {
                let what = format!(
                    "is a table, not a value of type {}; write [{name}] and under it {}",
                    other.type_str(),
                    names(keys).join(", ")
                );
                problems.push((offset, name.to_string(), what));
            }
            (None, _) if find(&TOP_KEYS, name).is_some() => {}
            (None, DeValue::Table(_)) => {
                problems.push((offset, format!("[{name}]"), unknown_table(name)));
            }
            (None, _) => problems.push((offset, name.to_string(), unknown_top(name))),
        }
    }
    match problems.into_iter().min_by_key(|(offset, _, _)| *offset) {
        Some((offset, path, what)) => Err(input.failure(offset, &path, &what)),
        None => Ok(()),
    }
}

/// What to say of a path into a sweep.
const NO_SWEEP: &str = "only a file has a sweep; write [sweep] and its lists into it";

/// The table and the name of the key of a path: `seed` or `sample.grains`.
///
/// # Errors
/// What is wrong with the path, and what would be right.
pub(super) fn resolve(path: &str) -> Result<(Option<&'static str>, &'static str), String> {
    match path.split_once('.') {
        None if path == EXTENDS => {
            Err("only a file extends another one; write extends at its top".into())
        }
        None if path == SWEEP => Err(NO_SWEEP.into()),
        None => match (find(&TOP_KEYS, path), keys_of(path)) {
            (Some(key), _) => Ok((None, key.name)),
            (None, Some(keys)) => Err(format!(
                "[{path}] is a table; set its keys one by one, such as {}=…",
                keys[0].path
            )),
            (None, None) => Err(unknown_top(path)),
        },
        Some((SWEEP, _)) => Err(NO_SWEEP.into()),
        Some((table, key)) => match TABLES.iter().find(|known| known.name == table) {
            Some(known) => match find(&known.keys, key) {
                Some(key) => Ok((Some(known.name), key.name)),
                None => Err(unknown_key(table, key)),
            },
            None => Err(unknown_table(table)),
        },
    }
}

fn names(keys: &[Entry]) -> Vec<&'static str> {
    keys.iter().map(|key| key.name).collect()
}

/// The table that has a key of this name.
fn home(key: &str) -> Option<&'static str> {
    let table = TABLES
        .iter()
        .find(|table| names(&table.keys).contains(&key))?;
    Some(table.name)
}

fn unknown_key(table: &str, key: &str) -> String {
    let keys = names(keys_of(table).unwrap_or_default());
    let on_top = key == EXTENDS || find(&TOP_KEYS, key).is_some();
    let hint = match (nearest(key, &keys), home(key)) {
        _ if on_top => "; it belongs at the top, in no table".into(),
        (_, Some(other)) => format!("; it belongs in [{other}]"),
        (Some(near), None) => format!("; did you mean {near}?"),
        (None, None) => String::new(),
    };
    list(
        format!("unknown key{hint}"),
        &format!("[{table}] knows"),
        keys.iter(),
    )
}

fn unknown_table(table: &str) -> String {
    let mut names: Vec<&str> = TABLES.iter().map(|table| table.name).collect();
    names.push(SWEEP);
    let hint = match nearest(table, &names) {
        Some(near) => format!("; did you mean [{near}]?"),
        None => String::new(),
    };
    list(
        format!("unknown table{hint}"),
        "the tables are",
        names.iter(),
    )
}

fn unknown_top(key: &str) -> String {
    let mut names = names(&TOP_KEYS);
    names.push(EXTENDS);
    names.extend(TABLES.iter().map(|table| table.name));
    names.push(SWEEP);
    let hint = match home(key) {
        Some(table) => format!("; it belongs in [{table}]"),
        None => match nearest(key, &names) {
            Some(near) => format!("; did you mean {near}?"),
            None => String::new(),
        },
    };
    list(
        format!("unknown key{hint}"),
        "the top level knows",
        names.iter(),
    )
}

/// `start; intro a, b, c`, with no semicolon after a question mark.
pub(super) fn list<'a>(
    start: String,
    intro: &str,
    names: impl Iterator<Item = &'a &'a str>,
) -> String {
    let names: Vec<&str> = names.copied().collect();
    let names = names.join(", ");
    if start.ends_with('?') {
        let mut intro = intro.to_string();
        intro[..1].make_ascii_uppercase();
        format!("{start} {intro} {names}")
    } else {
        format!("{start}; {intro} {names}")
    }
}

/// What follows a message about a word that none of these names is: the one that is meant, perhaps.
pub(super) fn meant(word: &str, names: &[&str]) -> String {
    nearest(word, names).map_or(String::new(), |near| format!("; did you mean {near}?"))
}

/// The name nearest by Levenshtein's distance, if it is near enough to be a misspelling.
fn nearest<'a>(word: &str, names: &[&'a str]) -> Option<&'a str> {
    let (distance, name) = names
        .iter()
        .map(|name| (levenshtein(word, name), *name))
        .min()?;
    (2 * distance <= word.chars().count().max(name.len())).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_far_name_is_not_suggested() {
        assert_eq!(
            nearest("radius", &["radius_min", "length"]),
            Some("radius_min")
        );
        assert_eq!(nearest("gravity", &["radius_min", "length"]), None);
    }

    #[test]
    fn paths() {
        assert_eq!(resolve("seed"), Ok((None, "seed")));
        assert_eq!(resolve("sample.grains"), Ok((Some("sample"), "grains")));
        assert_eq!(
            resolve("load.frictoin").unwrap_err(),
            "unknown key; [load] knows stiffness_number, pressure, normal_force, gravity, control, servo_gain, servo_speed_max"
        );
        assert_eq!(
            resolve("sample.pressure").unwrap_err(),
            "unknown key; it belongs in [load]; [sample] knows grains, radius_min, radius_max, sizes, radius_mean, radius_deviation, large_fraction, radii, placement, length, width, packing, replicate, walls, wall_thickness"
        );
        assert_eq!(
            resolve("load").unwrap_err(),
            "[load] is a table; set its keys one by one, such as load.stiffness_number=…"
        );
        assert_eq!(
            resolve("grains").unwrap_err(),
            "unknown key; it belongs in [sample]; the top level knows title, author, seed, dimension, extends, material, contact, sample, load, time, pack, shear, output, box, relax, aqs, newtonian, analysis, bookkeeping, sweep"
        );
        assert_eq!(
            resolve("smaple.grains").unwrap_err(),
            "unknown table; did you mean [sample]? The tables are material, contact, sample, load, time, pack, shear, output, box, relax, aqs, newtonian, analysis, bookkeeping, sweep"
        );
        assert!(resolve("sample.grains.x").is_err());
    }
}
