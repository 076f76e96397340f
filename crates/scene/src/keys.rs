//! All tables and keys, and what messages say of those that are unknown.

use std::collections::BTreeMap;

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
use crate::protocol::ShearKeys;
use crate::quasi_static::{AqsKeys, NewtonianKeys, RelaxKeys};
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
pub(crate) static TABLES: [Table; 13] = [
    MaterialKeys::TABLE,
    ContactKeys::TABLE,
    SampleKeys::TABLE,
    LoadKeys::TABLE,
    TimeKeys::TABLE,
    PackKeys::TABLE,
    ShearKeys::TABLE,
    OutputKeys::TABLE,
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
    match path.split_once('.') {
        Some((above, name)) => table(above)?.key(name),
        None => TOP.key(path),
    }
}

/// Where each table and key of the top begins, and each table of a list: `observable 2`.
pub(crate) fn places(tree: &DeTable<'_>) -> BTreeMap<String, usize> {
    let mut places = BTreeMap::new();
    for (key, value) in tree {
        let name = key.get_ref();
        for (n, entry) in value.get_ref().as_array().into_iter().flatten().enumerate() {
            places.insert(format!("{name} {}", n + 1), entry.span().start);
        }
        places.insert(name.to_string(), key.span().start);
    }
    places
}

/// The values of a tree in which all keys are known.
///
/// # Errors
/// `Failure::Input` with the first value of another kind than its key has.
pub(crate) fn read(tree: DeTable<'_>, input: &Input<'_>) -> Result<Given> {
    let mut given = Given::new();
    for (name, value) in tree {
        let (span, table) = (value.span(), table(name.get_ref()));
        match (table, value.into_inner()) {
            (Some(table), DeValue::Table(inner)) => {
                for (name, value) in inner {
                    read_value(table.key(name.get_ref()), value, input, &mut given)?;
                }
            }
            (Some(table), DeValue::Array(all)) => {
                let mut all = all.into_iter();
                if let Some(DeValue::Table(first)) = all.next().map(Spanned::into_inner) {
                    for (name, value) in first {
                        read_value(table.key(name.get_ref()), value, input, &mut given)?;
                    }
                }
                let others: DeArray<'_> = all.collect();
                if !others.is_empty() {
                    let others = Spanned::new(span, DeValue::Array(others));
                    read_value(Some(&OTHERS), others, input, &mut given)?;
                }
            }
            (_, value) => {
                let key = TOP.key(name.get_ref());
                read_value(key, Spanned::new(span, value), input, &mut given)?;
            }
        }
    }
    Ok(given)
}

/// Adds the value of a key; unknown keys have been refused.
fn read_value(
    key: Option<&'static Key>,
    value: Spanned<DeValue<'_>>,
    input: &Input<'_>,
    given: &mut Given,
) -> Result<()> {
    let Some(key) = key else { return Ok(()) };
    let at = value.span().start;
    let value = Value::read(key.values, value);
    let value = value.map_err(|what| input.failure(at, key.path, &what))?;
    given.insert(key.path, (at, value));
    Ok(())
}

/// Refuses the tables of a shear at a rate in a scene without one. Those of strain steps make the
/// stage.
pub(crate) fn refuse_tables_of_shear(tree: &DeTable<'_>, input: &Input<'_>) -> Result<()> {
    let refused = tree.iter().filter(|(key, _)| {
        table(key.get_ref()).is_some_and(|table| table.scenes == Scenes::Sheared)
    });
    let Some((key, _)) = refused.min_by_key(|(key, _)| key.span().start) else {
        return Ok(());
    };
    let table = format!("[{}]", key.get_ref());
    let what = "is of a shear at a rate, and this scene has no [shear]; leave it out";
    Err(input.failure(key.span().start, &table, what))
}

/// Refuses the first key of the file that the configuration does not know, and values where tables
/// belong.
pub(crate) fn check_known(tree: &DeTable<'_>, input: &Input<'_>) -> Result<()> {
    let mut problems = Vec::new();
    for (key, value) in tree {
        let name: &str = key.get_ref();
        let at = key.span().start;
        let problem = match (table(name), value.get_ref()) {
            (Some(known), DeValue::Table(table)) => {
                unknown_in_table(known, table, &mut problems);
                continue;
            }
            (Some(known), DeValue::Array(tables))
                if known.name == MaterialKeys::TABLE.name && !tables.is_empty() =>
            {
                for table in tables {
                    match table.get_ref() {
                        DeValue::Table(table) => unknown_in_table(known, table, &mut problems),
                        other => {
                            let kind = other.type_str();
                            problems.push(KeyProblem {
                                at,
                                path: name.to_string(),
                                what: format!("must be a table, not a value of type {kind}"),
                            });
                        }
                    }
                }
                continue;
            }
            (Some(_), DeValue::String(text)) if text == TAKE_AWAY => continue,
            (None, value) if let Some(known) = TOP.key(name) => {
                unknown_in_list(known, value, &mut problems);
                continue;
            }
            (Some(known), other) => KeyProblem {
                at,
                path: name.to_string(),
                what: format!(
                    "is a table, not a value of type {}; write [{name}] and under it {}",
                    other.type_str(),
                    names(known).join(", ")
                ),
            },
            (None, DeValue::Table(_)) => KeyProblem {
                at,
                path: format!("[{name}]"),
                what: unknown_table(name),
            },
            (None, _) => KeyProblem {
                at,
                path: name.to_string(),
                what: unknown_top(name),
            },
        };
        problems.push(problem);
    }
    match problems.into_iter().min_by_key(|problem| problem.at) {
        Some(problem) => Err(input.failure(problem.at, &problem.path, &problem.what)),
        None => Ok(()),
    }
}

/// Keys of earlier versions that changed the speed alone. They have no effect; the scenes in
/// checkpoints of those versions have them.
const RETIRED: [(&str, &str); 2] = [("bookkeeping", "tune"), ("bookkeeping", "tune_every")];

/// A key that is not known, or a value where a table belongs.
pub(crate) struct KeyProblem {
    at: usize,
    path: String,
    /// What to say of it.
    pub(crate) what: String,
}

/// Notes the keys that a table does not know, and those of its lists of tables.
fn unknown_in_table(known: &Table, table: &DeTable<'_>, problems: &mut Vec<KeyProblem>) {
    for (key, value) in table {
        let name: &str = key.get_ref();
        let Some(declared) = known.key(name) else {
            if RETIRED.contains(&(known.name, name)) {
                continue;
            }
            problems.push(KeyProblem {
                at: key.span().start,
                path: format!("{}.{name}", known.name),
                what: unknown_key(known.name, name),
            });
            continue;
        };
        unknown_in_list(declared, value.get_ref(), problems);
    }
}

/// Notes the keys that the tables of a list do not know.
pub(crate) fn unknown_in_list(declared: &Key, value: &DeValue<'_>, problems: &mut Vec<KeyProblem>) {
    let known = match declared.values {
        Values::Tables(keys) => keys(),
        Values::Parts(keys) => keys.to_vec(),
        _ => return,
    };
    let tables = value.as_array().into_iter().flatten();
    for (n, table) in tables.enumerate() {
        for (key, _) in table.get_ref().as_table().into_iter().flatten() {
            let name: &str = key.get_ref();
            if known.iter().any(|known| known.name() == name) {
                continue;
            }
            let at = key.span().start;
            problems.push(if let Values::Parts(_) = declared.values {
                KeyProblem {
                    at,
                    path: declared.path.to_string(),
                    what: format!("part {}: {}", n + 1, unknown_key_of_a_part(name, &known)),
                }
            } else {
                KeyProblem {
                    at,
                    path: format!("{}.{name}", declared.path),
                    what: if declared.table().is_empty() {
                        unknown_key_of_an_entry(declared, name, &known)
                    } else {
                        unknown_key(declared.table(), name)
                    },
                }
            });
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

/// How the keys of a table of earlier versions are given now.
const BOX: &str = "is not a table any more: give sample.boundary = \"periodic\", box.solid_fraction as sample.solid_fraction, and deformation, pressure, pressure_tolerance and pressure_step under [aqs]";

fn unknown_key_of_a_part(key: &str, known: &[&'static Key]) -> String {
    let names: Vec<&str> = known.iter().map(|known| known.name()).collect();
    let unknown = format!("unknown key {key}{}", meant(key, &names));
    known_names(unknown, "a part knows", &names)
}

fn unknown_key_of_an_entry(list: &Key, key: &str, known: &[&'static Key]) -> String {
    let names: Vec<&str> = known.iter().map(|known| known.name()).collect();
    let unknown = format!("unknown key{}", meant(key, &names));
    known_names(unknown, &format!("[[{}]] knows", list.path), &names)
}

fn unknown_table(table: &str) -> String {
    if table == "box" {
        return BOX.into();
    }
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
