//! The identity of a run: the hash of all that decides its trajectory. Files of a run carry it, so
//! that two runs are never mixed in one folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use toml::{Table, Value};
use xxhash_rust::xxh3::xxh3_128;

use crate::keys::key;
use crate::protocol::SHEAR;
use crate::quasi_static::AQS;
use crate::sample::SAMPLE;
use crate::scene::Scene;
use crate::stages::RunStage;
use crate::value::Value as KeyValue;
use gshear_dem::laws::keys::{Change, Key};

/// Returns whether any pair of materials of a scene, given as TOML, has sliding friction.
pub fn has_friction(scene: &str) -> bool {
    let scene = scene.parse::<Table>().unwrap_or_default();
    let tables = ["contact", "material"].into_iter();
    tables.filter_map(|name| scene.get(name)).any(is_frictional)
}

fn is_frictional(value: &Value) -> bool {
    match value {
        Value::Table(table) => table.iter().any(|(name, value)| match value {
            Value::Float(value) if name == "friction" => *value > 0.0,
            Value::Integer(value) if name == "friction" => *value > 0,
            _ => is_frictional(value),
        }),
        Value::Array(values) => values.iter().any(is_frictional),
        _ => false,
    }
}

/// Returns the 128-bit xxh3 hash of these bytes as 32 hexadecimal digits.
pub fn hash(bytes: &[u8]) -> String {
    format!("{:032x}", xxh3_128(bytes))
}

/// Returns the identity of a run of this scene from its first grain.
///
/// Two scenes have the same identity if they agree in every key that is physics ([`Change`]), in
/// the time step and in the bytes of the packing, wherever that file is. Output, bookkeeping and
/// the end of the last stage do not count.
pub fn identity(scene: &Scene) -> String {
    let mut text = String::new();
    for (path, value) in values(&scene.toml) {
        if counts(&path, scene) {
            text += &format!("{path} = {value}\n");
        }
    }
    // Derived steps follow from the physics, but their formula may change with a version.
    text += &format!("step {:016x}\n", scene.time_step.step.to_bits());
    if let Some(file) = scene.packing() {
        text += &format!("packing {}\n", file.content);
        if let Some(contacts) = &file.contacts {
            text += &format!("contacts {}\n", contacts.content);
        }
    }
    hash(text.as_bytes())
}

/// Whether a key belongs to the identity of the scene.
fn counts(path: &str, scene: &Scene) -> bool {
    // Its parts are the drive; a protocol is only ever continued.
    let is_drive = path == SHEAR.protocol.path;
    // A stage begins where the one before it ends.
    let ends_before_the_last = scene.stages.order.iter().any(|stage| {
        let ends: &[&Key] = match stage {
            RunStage::Shear => &[&SHEAR.strain],
            RunStage::Strain => &[&AQS.steps, &AQS.until_imaginary],
            RunStage::Newtonian => &[],
        };
        *stage != scene.stages.last() && ends.iter().any(|key| key.path == path)
    });
    // The packing counts by its content.
    !is_of_a_packing(path) && (change_of(path).is_physics() || is_drive || ends_before_the_last)
}

/// A key whose value differs between two scenes.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyChange {
    /// Table and name: `shear.strain`.
    pub path: String,
    /// The value before, as TOML; `None`: the key was not given.
    pub before: Option<String>,
    /// The value after.
    pub after: Option<String>,
    /// When the key may change.
    pub change: Change,
}

impl KeyChange {
    /// Whether it is of the path of a packing, which counts by its content.
    pub fn is_of_a_packing(&self) -> bool {
        is_of_a_packing(&self.path)
    }
}

fn is_of_a_packing(path: &str) -> bool {
    [SAMPLE.packing.path, SAMPLE.contacts.path].contains(&path)
}

impl fmt::Display for KeyChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values = [&self.before, &self.after];
        let [before, after] = values.map(|value| value.as_deref().unwrap_or("none"));
        write!(f, "{} from {before} to {after}", self.path)
    }
}

/// Returns the keys whose values differ between two scenes as TOML, in the order of their paths.
pub fn changes(before: &str, after: &str) -> Vec<KeyChange> {
    let [before, after] = [before, after].map(values);
    let paths: BTreeSet<&String> = before.keys().chain(after.keys()).collect();
    let differing = paths
        .into_iter()
        .filter(|path| before.get(*path) != after.get(*path));
    differing
        .map(|path| KeyChange {
            path: path.clone(),
            before: value_or_default(&before, path),
            after: value_or_default(&after, path),
            change: change_of(path),
        })
        .collect()
}

/// The value of a key; of one without a value its default, if that is a constant.
fn value_or_default(values: &BTreeMap<String, String>, path: &str) -> Option<String> {
    values.get(path).cloned().or_else(|| default(path))
}

/// Returns the values of a scene as TOML by their paths, without those that are the constant
/// default of their key, so that a key of a later version does not tell two scenes apart.
pub fn values(toml: &str) -> BTreeMap<String, String> {
    let table: Table = toml::from_str(toml).unwrap_or_default();
    let mut values = BTreeMap::new();
    for (name, value) in &table {
        match value {
            Value::Table(inner) => {
                for (key, value) in inner {
                    values.insert(format!("{name}.{key}"), value.to_string());
                }
            }
            value => {
                values.insert(name.clone(), value.to_string());
            }
        }
    }
    values.retain(|path, text| default(path).as_ref() != Some(text));
    values
}

/// The constant default of a key, written as [`values`] writes it.
fn default(path: &str) -> Option<String> {
    let text = KeyValue::default_of(key(path)?)?.toml();
    let table: Table = toml::from_str(&format!("x = {text}")).ok()?;
    table.get("x").map(Value::to_string)
}

fn change_of(path: &str) -> Change {
    key(path).map_or(Change::Branch, |key| key.change)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::embedded;

    fn scene(sets: &str) -> Scene {
        embedded(sets).unwrap()
    }

    #[test]
    fn physics_counts_and_the_rest_does_not() {
        let identity = |sets: &str| identity(&scene(sets));
        let first = identity("");
        assert_eq!(first.len(), 32);
        // The sliding damping came after the first runs.
        let other = "title=other shear.strain=0.7 output.frame_strain=0 output.energy=false
            bookkeeping.skin=0.3 bookkeeping.simd=portable pack.max_steps=7000000
            analysis.scalars=true contact.sliding_damping=0";
        for set in other.split_whitespace() {
            assert_eq!(identity(set), first, "{set}");
        }
        let physics = "seed=2 sample.grains=900 contact.friction=0.6 contact.sliding_damping=0.5
            pack.tolerance=1e-6 load.gravity=1.0 shear.inertial_number=1e-4
            shear.spring_number=0.1";
        for set in physics.split_whitespace() {
            assert_ne!(identity(set), first, "{set}");
        }
    }

    #[test]
    fn changed_keys_are_named_with_their_values() {
        let [before, after] = ["", "shear.strain=0.2 contact.friction=0.6"].map(scene);
        let found = changes(&before.toml, &after.toml);
        let [friction, strain] = &found[..] else {
            panic!("{found:?}")
        };
        assert_eq!(friction.to_string(), "contact.friction from 0.7 to 0.6");
        assert_eq!(strain.to_string(), "shear.strain from 0.1 to 0.2");
        assert_eq!(
            [friction.change, strain.change],
            [Change::Branch, Change::End]
        );
        let silent = scene("output.energy=false");
        let of_default = &changes(&silent.toml, &before.toml)[0];
        assert_eq!(of_default.to_string(), "output.energy from false to true");
        assert_eq!(changes(&before.toml, &before.toml), []);
    }
}
