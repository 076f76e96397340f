//! Unknown and former keys: what the messages suggest.

use std::borrow::Cow;

use strsim::levenshtein;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::key::Entry;
use super::overrides::TAKE_AWAY;
use super::raw::{TABLES, TOP_KEYS, keys_of};
use super::source::{EXTENDS, Input};
use super::sweep::SWEEP;
use gshear_dem::failure::Failure;

/// Gives keys under a former name their present one. Returns a note for each.
///
/// # Errors
/// `Failure::Input` if a key is given under both names.
pub(super) fn rename(tree: &mut DeTable<'_>, input: &Input<'_>) -> Result<Vec<String>, Failure> {
    let mut notes = rename_in(tree, &TOP_KEYS, "", input)?;
    for table in TABLES.iter() {
        if let Some(DeValue::Table(inner)) = tree.get_mut(table.name).map(Spanned::get_mut) {
            let prefix = format!("{}.", table.name);
            notes.extend(rename_in(inner, &table.keys, &prefix, input)?);
        }
    }
    Ok(notes)
}

fn rename_in(
    table: &mut DeTable<'_>,
    keys: &[Entry],
    prefix: &str,
    input: &Input<'_>,
) -> Result<Vec<String>, Failure> {
    let mut notes = Vec::new();
    for (key, former) in keys
        .iter()
        .flat_map(|key| key.former.iter().map(move |former| (key, *former)))
    {
        let Some((found, value)) = table.remove_entry(former) else {
            continue;
        };
        let at = found.span().start;
        let path = format!("{prefix}{former}");
        if let Some((other, _)) = table.get_key_value(key.name) {
            let what = format!(
                "is the former name of {}, which {} gives; leave this one out",
                key.path,
                input.mention(other.span().start)
            );
            return Err(input.failure(at, &path, &what));
        }
        notes.push(input.message(at, &path, &renamed(key.path)));
        table.insert(Spanned::new(found.span(), Cow::Borrowed(key.name)), value);
    }
    Ok(notes)
}

/// What to say of a key under a former name.
fn renamed(path: &str) -> String {
    format!("is now called {path}; write that, the next release refuses the former name")
}

/// The note on the path of a `--set`, if it is a former name.
pub(super) fn note(path: &str) -> Option<String> {
    let (table, key) = resolve(path).ok()?;
    let present = match table {
        Some(table) => format!("{table}.{key}"),
        None => key.into(),
    };
    (present != path).then(|| renamed(&present))
}

/// The key of this present or former name.
fn find<'a>(keys: &'a [Entry], name: &str) -> Option<&'a Entry> {
    keys.iter()
        .find(|key| key.name == name || key.former.contains(&name))
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

/// The table and the present name of the key of a path: `seed` or `sample.grains`.
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
    use crate::{Source, load, notes};

    #[test]
    fn a_far_name_is_not_suggested() {
        assert_eq!(
            nearest("radius", &["radius_min", "length"]),
            Some("radius_min")
        );
        assert_eq!(nearest("gravity", &["radius_min", "length"]), None);
    }

    /// `output.energy` has the former name `energy_ledger` in tests.
    #[test]
    fn a_former_name_is_taken_with_a_note() {
        let off = "[output]\nenergy_ledger = false";
        let source = |text: &str| {
            let scene = include_str!("../../../configs/plane-shear-2d.toml");
            let scene = scene.replacen("[output]", text, 1);
            assert!(scene.contains(text));
            Source::new("s.toml", scene)
        };
        let energy = |text: &str, sets: &[String]| {
            let scene = load(&source(text), sets).unwrap();
            scene.plane_shear("s.toml").unwrap().output.energy
        };
        assert!(!energy(off, &[]));
        let [note] = &notes(&source(off), &[])[..] else {
            panic!("one note");
        };
        assert!(note.starts_with("s.toml:"), "{note}");
        assert!(note.contains(": output.energy_ledger: is now called output.energy;"));

        let set = ["output.energy_ledger=false".to_string()];
        assert!(!energy("[output]", &set));
        assert_eq!(
            notes(&source("[output]"), &set),
            [
                "--set output.energy_ledger=false: is now called output.energy; write that, the next release refuses the former name"
            ]
        );
        assert_eq!(notes(&source("[output]"), &["seed=2".into()]), [""; 0]);

        let both = format!("{off}\nenergy = true");
        let refused = load(&source(&both), &[]).unwrap_err().to_string();
        assert!(refused.contains("output.energy_ledger: is the former name of output.energy"));
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
