//! Which keys exist, and what to say to one that does not.

use strsim::levenshtein;
use toml::de::{DeTable, DeValue};

use super::raw::{TABLES, TOP_KEYS, keys_of};
use super::source::Input;
use gshear_dem::failure::Failure;

/// Refuses the first key of the file that the configuration does not know, and values where tables belong.
pub(super) fn check_known(tree: &DeTable<'_>, input: &Input<'_>) -> Result<(), Failure> {
    let mut problems = Vec::new();
    for (key, value) in tree.iter() {
        let name: &str = key.get_ref();
        let offset = key.span().start;
        match (keys_of(name), value.get_ref()) {
            (Some(keys), DeValue::Table(table)) => {
                for (inner, _) in table.iter() {
                    let inner_name: &str = inner.get_ref();
                    if !keys.contains(&inner_name) {
                        let what = unknown_key(name, inner_name);
                        problems.push((inner.span().start, format!("{name}.{inner_name}"), what));
                    }
                }
            }
            (Some(keys), other) => {
                let what = format!(
                    "is a table, not a value of type {}; write [{name}] and under it {}",
                    other.type_str(),
                    keys.join(", ")
                );
                problems.push((offset, name.to_string(), what));
            }
            (None, DeValue::Table(_)) if !TOP_KEYS.contains(&name) => {
                problems.push((offset, format!("[{name}]"), unknown_table(name)));
            }
            (None, _) if !TOP_KEYS.contains(&name) => {
                problems.push((offset, name.to_string(), unknown_top(name)));
            }
            (None, _) => {}
        }
    }
    match problems.into_iter().min_by_key(|(offset, _, _)| *offset) {
        Some((offset, path, what)) => Err(input.failure(offset, &path, &what)),
        None => Ok(()),
    }
}

/// A key's path as the configuration has it: `seed` or `sample.grains`.
///
/// # Errors
/// What is wrong with the path, and what would be right.
pub(super) fn resolve(path: &str) -> Result<(Option<&str>, &str), String> {
    match path.split_once('.') {
        None if TOP_KEYS.contains(&path) => Ok((None, path)),
        None => Err(match keys_of(path) {
            Some(keys) => format!(
                "[{path}] is a table; set its keys one by one, such as {path}.{}=…",
                keys[0]
            ),
            None => unknown_top(path),
        }),
        Some((table, key)) => match keys_of(table) {
            Some(keys) if keys.contains(&key) => Ok((Some(table), key)),
            Some(_) => Err(unknown_key(table, key)),
            None => Err(unknown_table(table)),
        },
    }
}

fn unknown_key(table: &str, key: &str) -> String {
    let keys = keys_of(table).unwrap_or_default();
    let elsewhere = TABLES.iter().find(|(_, keys)| keys.contains(&key));
    let hint = match (nearest(key, keys), elsewhere) {
        (_, Some((other, _))) => format!("; it belongs in [{other}]"),
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
    let names = TABLES.iter().map(|(name, _)| name);
    let hint = match nearest(table, &names.clone().copied().collect::<Vec<_>>()) {
        Some(near) => format!("; did you mean [{near}]?"),
        None => String::new(),
    };
    list(format!("unknown table{hint}"), "the tables are", names)
}

fn unknown_top(key: &str) -> String {
    let names = TOP_KEYS.iter().chain(TABLES.iter().map(|(name, _)| name));
    let hint = match TABLES.iter().find(|(_, keys)| keys.contains(&key)) {
        Some((table, _)) => format!("; it belongs in [{table}]"),
        None => match nearest(key, &names.clone().copied().collect::<Vec<_>>()) {
            Some(near) => format!("; did you mean {near}?"),
            None => String::new(),
        },
    };
    list(format!("unknown key{hint}"), "the top level knows", names)
}

/// `start; intro a, b, c`, with no semicolon after a question mark.
fn list<'a>(start: String, intro: &str, names: impl Iterator<Item = &'a &'a str>) -> String {
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
            "unknown key; [load] knows stiffness_number, pressure, normal_force, gravity"
        );
        assert_eq!(
            resolve("sample.pressure").unwrap_err(),
            "unknown key; it belongs in [load]; [sample] knows grains, radius_min, radius_max, sizes, radius_mean, radius_deviation, large_fraction, radii, length, width, packing, replicate, walls"
        );
        assert_eq!(
            resolve("load").unwrap_err(),
            "[load] is a table; set its keys one by one, such as load.stiffness_number=…"
        );
        assert_eq!(
            resolve("grains").unwrap_err(),
            "unknown key; it belongs in [sample]; the top level knows title, seed, dimension, material, contact, sample, load, time, pack, shear, output, box, relax, aqs, newtonian, analysis, bookkeeping"
        );
        assert_eq!(
            resolve("smaple.grains").unwrap_err(),
            "unknown table; did you mean [sample]? The tables are material, contact, sample, load, time, pack, shear, output, box, relax, aqs, newtonian, analysis, bookkeeping"
        );
        assert!(resolve("sample.grains.x").is_err());
    }
}
