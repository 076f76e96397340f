//! The keys that the contact laws declare.

use gshear_dem::laws::keys::LawKey;
use gshear_dem::laws::{LAWS, LawKind};

use crate::key::{Declared, Entry};
use crate::words::list;

/// The names of the contact laws.
pub const LAW_NAMES: [&str; LAWS.len()] = {
    let mut names = [""; LAWS.len()];
    let mut k = 0;
    while k < LAWS.len() {
        names[k] = LAWS[k].name;
        k += 1;
    }
    names
};

/// The keys of all laws, some more than once.
pub fn law_keys() -> impl Iterator<Item = &'static LawKey> {
    LAWS.iter().flat_map(|kind| kind.keys.iter().copied())
}

/// The laws that take a key.
pub fn laws_with(key: &LawKey) -> Vec<&'static str> {
    let takes = |kind: &&&LawKind| kind.keys.iter().any(|known| known.path == key.path);
    LAWS.iter().filter(takes).map(|kind| kind.name).collect()
}

/// What the contact laws declare of the keys of a table. A key of several laws comes once, with
/// what each of them says.
pub fn law_entries(table: &str) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    for key in law_keys().filter(|key| key.table() == table) {
        let name = key.name();
        if entries.iter().any(|known| known.name == name) {
            continue;
        }
        let laws: Vec<_> = LAWS
            .iter()
            .filter_map(|kind| {
                let own = kind.keys.iter().find(|own| own.path == key.path)?;
                Some((kind.name, own.unit))
            })
            .collect();
        let mut entry = Declared::from(key).entry();
        if laws.iter().any(|(_, unit)| *unit != key.unit) {
            let units = laws.iter().map(|(law, unit)| format!("{law}: {unit}"));
            entry.unit = units.collect::<Vec<_>>().join("; ");
        }
        let names: Vec<&str> = laws.iter().map(|(law, _)| *law).collect();
        match names[..] {
            [law] => entry.doc += &format!("; law {law} only"),
            _ if names.len() < LAWS.len() => {
                entry.doc += &format!("; laws {}", list(&names, "and"));
            }
            _ => {}
        }
        entries.push(entry);
    }
    entries
}
