//! All tables and keys, and what messages say of those that are unknown.

use gshear_dem::failure::Result;
use gshear_dem::laws::keys::{Key, Values};
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use crate::checker::Given;
use crate::general::{BookkeepingKeys, SceneKeys};
use crate::law::ContactKeys;
use crate::load::LoadKeys;
use crate::materials::{MaterialKeys, OTHERS};
use crate::output::{AnalysisKeys, OutputKeys};
use crate::periodic::{AqsKeys, BoxKeys, NewtonianKeys, RelaxKeys};
use crate::protocol::ShearKeys;
use crate::sample::SampleKeys;
use crate::source::Input;
use crate::table::{Scenes, Table};
use crate::time::TimeKeys;
use crate::value::Value;
use crate::walls::PackKeys;
use crate::words::{EXTENDS, SWEEP, TAKE_AWAY, known_names, meant, nearest};

/// The keys above all tables.
pub(crate) static TOP: Table = SceneKeys::TABLE;

/// Every table.
pub(crate) static TABLES: [Table; 14] = [
    MaterialKeys::TABLE,
    ContactKeys::TABLE,
    SampleKeys::TABLE,
    LoadKeys::TABLE,
    TimeKeys::TABLE,
    PackKeys::TABLE,
    ShearKeys::TABLE,
    OutputKeys::TABLE,
    BoxKeys::TABLE,
    RelaxKeys::TABLE,
    AqsKeys::TABLE,
    NewtonianKeys::TABLE,
    AnalysisKeys::TABLE,
    BookkeepingKeys::TABLE,
];

/// The top, then every table.
pub(crate) fn tables() -> impl Iterator<Item = &'static Table> {
    std::iter::once(&TOP).chain(&TABLES)
}

/// The table of this name.
pub(crate) fn table(name: &str) -> Option<&'static Table> {
    TABLES.iter().find(|table| table.name == name)
}

/// The declaration of the key of a path, such as `seed` or `sample.grains`.
pub fn key(path: &str) -> Option<&'static Key> {
    let (name, of) = match path.split_once('.') {
        Some((name, of)) => (of, table(name)?),
        None => (path, &TOP),
    };
    of.key(name)
}

/// The values of a tree in which all keys are known.
///
/// # Errors
/// `Failure::Input` with the first value of another kind than its key has.
pub(crate) fn read(tree: DeTable<'_>, input: &Input<'_>) -> Result<Given> {
    let mut given = Given::new();
    let mut take = |key: Option<&'static Key>, value: Spanned<DeValue<'_>>| {
        let Some(key) = key else { return Ok(()) };
        let at = value.span().start;
        let value = Value::read(key.values, value);
        let value = value.map_err(|what| input.failure(at, key.path, &what))?;
        given.insert(key.path, (at, value));
        Ok(())
    };
    for (name, value) in tree {
        let (span, table) = (value.span(), table(name.get_ref()));
        match (table, value.into_inner()) {
            (Some(table), DeValue::Table(inner)) => {
                for (name, value) in inner {
                    take(table.key(name.get_ref()), value)?;
                }
            }
            (Some(table), DeValue::Array(all)) => {
                let mut all = all.into_iter();
                if let Some(DeValue::Table(first)) = all.next().map(Spanned::into_inner) {
                    for (name, value) in first {
                        take(table.key(name.get_ref()), value)?;
                    }
                }
                let others: DeArray<'_> = all.collect();
                if !others.is_empty() {
                    take(Some(&OTHERS), Spanned::new(span, DeValue::Array(others)))?;
                }
            }
            (_, value) => take(TOP.key(name.get_ref()), Spanned::new(span, value))?,
        }
    }
    Ok(given)
}

/// Refuses the tables of scenes with walls in a scene with a box, and the other way round.
pub(crate) fn refuse_others(tree: &DeTable<'_>, input: &Input<'_>, boxed: bool) -> Result<()> {
    let (others, why) = if boxed {
        let why = "is for scenes with walls, but this one has a [box]";
        (Scenes::Walls, why)
    } else {
        let why = "is for scenes with a [box], but this one has none";
        (Scenes::Box, why)
    };
    let found = tree
        .iter()
        .filter(|(key, _)| table(key.get_ref()).is_some_and(|table| table.scenes == others));
    match found.min_by_key(|(key, _)| key.span().start) {
        Some((key, _)) => {
            let table = format!("[{}]", key.get_ref());
            Err(input.failure(key.span().start, &table, &format!("{why}; leave it out")))
        }
        None => Ok(()),
    }
}

/// Refuses the first key of the file that the configuration does not know, and values where tables
/// belong.
pub(crate) fn check_known(tree: &DeTable<'_>, input: &Input<'_>) -> Result<()> {
    let mut problems = Vec::new();
    for (key, value) in tree {
        let name: &str = key.get_ref();
        let offset = key.span().start;
        match (table(name), value.get_ref()) {
            (Some(known), DeValue::Table(table)) => unknown_of(known, table, &mut problems),
            (Some(known), DeValue::Array(tables))
                if known.name == MaterialKeys::TABLE.name && !tables.is_empty() =>
            {
                for table in tables {
                    match table.get_ref() {
                        DeValue::Table(table) => unknown_of(known, table, &mut problems),
                        other => {
                            let kind = other.type_str();
                            let what = format!("must be a table, not a value of type {kind}");
                            problems.push((offset, name.to_string(), what));
                        }
                    }
                }
            }
            (Some(_), DeValue::String(text)) if text == TAKE_AWAY => {}
            (Some(known), other) => {
                let what = format!(
                    "is a table, not a value of type {}; write [{name}] and under it {}",
                    other.type_str(),
                    names(known).join(", ")
                );
                problems.push((offset, name.to_string(), what));
            }
            (None, _) if TOP.key(name).is_some() => {}
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

/// Notes the keys that a table does not know, and those of its lists of tables.
fn unknown_of(known: &Table, table: &DeTable<'_>, problems: &mut Vec<(usize, String, String)>) {
    for (key, value) in table {
        let name: &str = key.get_ref();
        let Some(declared) = known.key(name) else {
            let what = unknown_key(known.name, name);
            problems.push((key.span().start, format!("{}.{name}", known.name), what));
            continue;
        };
        unknown_in_list(declared, value.get_ref(), problems);
    }
}

/// Notes the keys that the tables of a list do not know: places, paths and what to say of them.
pub(crate) fn unknown_in_list(
    declared: &Key,
    value: &DeValue<'_>,
    problems: &mut Vec<(usize, String, String)>,
) {
    let known = match declared.values {
        Values::Tables(keys) => keys(),
        Values::Parts(keys) => keys.to_vec(),
        _ => return,
    };
    let tables = value
        .as_array()
        .into_iter()
        .flat_map(|tables| tables.iter());
    for (n, table) in tables.enumerate() {
        let keys = table.get_ref().as_table().into_iter().flatten();
        for (key, _) in keys.filter(|(key, _)| known.iter().all(|of| of.name() != key.get_ref())) {
            let name = key.get_ref();
            let (path, what) = if let Values::Parts(_) = declared.values {
                let what = format!("part {}: {}", n + 1, unknown_key_of_a_part(name, &known));
                (declared.path.to_string(), what)
            } else {
                let path = format!("{}.{name}", declared.path);
                (path, unknown_key(declared.table(), name))
            };
            problems.push((key.span().start, path, what));
        }
    }
}

/// What to say of a path into a sweep.
const NO_SWEEP: &str = "only a file has a sweep; write [sweep] and its lists into it";

/// The key of a path: `seed` or `sample.grains`.
///
/// # Errors
/// What is wrong with the path, and what would be right.
pub(crate) fn resolve(path: &str) -> Result<&'static Key, String> {
    match path.split_once('.') {
        None if path == EXTENDS => {
            Err("only a file extends another one; write extends at its top".into())
        }
        None if path == SWEEP => Err(NO_SWEEP.into()),
        None => match (TOP.key(path), table(path)) {
            (Some(key), _) => Ok(key),
            (None, Some(known)) => Err(format!(
                "[{path}] is a table; set its keys one by one, such as {}=…",
                known.keys()[0].path
            )),
            (None, None) => Err(unknown_top(path)),
        },
        Some((SWEEP, _)) => Err(NO_SWEEP.into()),
        Some((name, key)) => match table(name) {
            Some(known) => known.key(key).ok_or_else(|| unknown_key(name, key)),
            None => Err(unknown_table(name)),
        },
    }
}

fn names(table: &Table) -> Vec<&'static str> {
    table.keys().into_iter().map(Key::name).collect()
}

/// The table that has a key of this name.
fn home(key: &str) -> Option<&'static str> {
    let table = TABLES.iter().find(|table| table.key(key).is_some())?;
    Some(table.name)
}

fn unknown_key(table: &str, key: &str) -> String {
    let keys = self::table(table).map(names).unwrap_or_default();
    let on_top = key == EXTENDS || TOP.key(key).is_some();
    let hint = match home(key) {
        _ if on_top => "; it belongs at the top, in no table".into(),
        Some(other) => format!("; it belongs in [{other}]"),
        None => meant(key, &keys),
    };
    let intro = format!("[{table}] knows");
    known_names(format!("unknown key{hint}"), &intro, &keys)
}

fn unknown_key_of_a_part(key: &str, known: &[&'static Key]) -> String {
    let names: Vec<&str> = known.iter().map(|of| of.name()).collect();
    let unknown = format!("unknown key {key}{}", meant(key, &names));
    known_names(unknown, "a part knows", &names)
}

fn unknown_table(table: &str) -> String {
    let mut names: Vec<&str> = TABLES.iter().map(|table| table.name).collect();
    names.push(SWEEP);
    let near = nearest(table, &names);
    let hint = near.map_or(String::new(), |near| format!("; did you mean [{near}]?"));
    known_names(format!("unknown table{hint}"), "the tables are", &names)
}

fn unknown_top(key: &str) -> String {
    let mut names = names(&TOP);
    names.push(EXTENDS);
    names.extend(TABLES.iter().map(|table| table.name));
    names.push(SWEEP);
    let hint = match home(key) {
        Some(table) => format!("; it belongs in [{table}]"),
        None => meant(key, &names),
    };
    known_names(format!("unknown key{hint}"), "the top level knows", &names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::cases;

    #[test]
    fn paths() {
        assert_eq!(resolve("seed").map(|key| key.path), Ok("seed"));
        let grains = "sample.grains";
        assert_eq!(resolve(grains).map(|key| key.path), Ok(grains));
        for [path, start] in cases(
            r"
            load.frictoin | unknown key; [load] knows stiffness_number, pressure,
            sample.grain | unknown key; did you mean grains? [sample] knows grains,
            sample.pressure | unknown key; it belongs in [load]; [sample] knows grains,
            contact.seed | unknown key; it belongs at the top, in no table; [contact] knows law,
            load | [load] is a table; set its keys one by one, such as load.stiffness_number=…
            grains | unknown key; it belongs in [sample]; the top level knows title,
            smaple.grains | unknown table; did you mean [sample]? The tables are material, contact,
            ",
        ) {
            let message = resolve(&path).expect_err("no key");
            assert!(message.starts_with(&start), "{message}");
        }
        assert!(resolve("sample.grains.x").is_err());
    }
}
