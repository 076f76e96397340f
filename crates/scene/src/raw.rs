//! The configuration as it is written: every key optional, types checked, nothing else.

use std::fmt;
use std::sync::LazyLock;

use gshear_dem::laws::keys::Key;
use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use toml::Spanned;

use crate::check::law_keys;

/// A TOML number: an integer is taken as one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number(pub f64);

/// A TOML integer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Whole(pub i64);

/// A TOML string.
#[derive(Debug, Clone, PartialEq)]
pub struct Text(pub String);

/// A TOML boolean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flag(pub bool);

/// Any TOML value, kept if `take` finds the kind that is expected.
fn take<'de, D: Deserializer<'de>, T>(
    d: D,
    expected: &str,
    take: impl Fn(&toml::Value) -> Option<T>,
) -> Result<T, D::Error> {
    let out_of_range =
        |_| D::Error::custom(format!("expected {expected}, found a number out of range"));
    let value = toml::Value::deserialize(d).map_err(out_of_range)?;
    take(&value).ok_or_else(|| D::Error::custom(mismatch(expected, &value)))
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        take(d, "a number", |value| number(value).map(Number))
    }
}

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        take(d, "an integer without decimal point or exponent", |value| {
            value.as_integer().map(Whole)
        })
    }
}

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        take(d, "a string in quotes", |value| {
            value.as_str().map(|s| Text(s.into()))
        })
    }
}

impl<'de> Deserialize<'de> for Flag {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        take(d, "true or false", |value| value.as_bool().map(Flag))
    }
}

/// A list of numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(pub Vec<f64>);

impl<'de> Deserialize<'de> for Numbers {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        take(d, "a list of numbers", |value| {
            let numbers = value.as_array()?.iter().map(number);
            numbers.collect::<Option<_>>().map(Numbers)
        })
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    match value {
        toml::Value::Float(x) => Some(*x),
        toml::Value::Integer(n) => Some(*n as f64),
        _ => None,
    }
}

/// A list of tables of numbers: the parts of a protocol.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts(pub Vec<Vec<(String, f64)>>);

impl<'de> Deserialize<'de> for Parts {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        let expected = "a list of tables of numbers, such as [[shear.protocol]]";
        take(d, expected, |value| {
            let part = |value: &toml::Value| {
                let entry =
                    |(key, value): (&String, &toml::Value)| Some((key.clone(), number(value)?));
                value
                    .as_table()?
                    .iter()
                    .map(entry)
                    .collect::<Option<Vec<_>>>()
            };
            let parts = value.as_array()?.iter().map(part);
            parts.collect::<Option<_>>().map(Parts)
        })
    }
}

fn mismatch(expected: &str, found: &toml::Value) -> String {
    let found = match found {
        toml::Value::String(s) => format!("the string {s:?}"),
        toml::Value::Integer(n) => format!("the integer {n}"),
        toml::Value::Float(x) => format!("the number {}", show(*x)),
        toml::Value::Boolean(b) => format!("the boolean {b}"),
        toml::Value::Datetime(d) => format!("the date {d}"),
        toml::Value::Array(_) => "an array".into(),
        toml::Value::Table(_) => "a table".into(),
    };
    format!("expected {expected}, found {found}")
}

/// The shortest decimal that reads back to the same bits, without many zeros.
pub fn show(x: f64) -> String {
    if x.is_finite() && x.abs() >= 1e7 {
        format!("{x:e}")
    } else {
        format!("{x:?}")
    }
}

/// A table of optional keys that remember their place, and the names of its keys.
macro_rules! table {
    ($(#[$doc:meta])* $name:ident { $($key:ident: $kind:ty),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Default, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $(pub $key: Option<Spanned<$kind>>,)*
        }

        impl $name {
            fn keys() -> Vec<&'static str> {
                vec![$(stringify!($key)),*]
            }
        }
    };
}

/// A table of optional keys of its own, and the numbers that the contact laws declare.
macro_rules! law_table {
    ($name:ident, $table:literal { $($key:ident: $kind:ty),* $(,)? }) => {
        #[derive(Debug, Default)]
        pub struct $name {
            $(pub $key: Option<Spanned<$kind>>,)*
            /// Names and values of the laws' keys.
            pub of_laws: Vec<(String, Spanned<Number>)>,
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
                struct Table;

                impl<'de> Visitor<'de> for Table {
                    type Value = $name;

                    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                        f.write_str("a table")
                    }

                    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<$name, A::Error> {
                        let mut table = $name::default();
                        while let Some(key) = map.next_key::<String>()? {
                            match key.as_str() {
                                $(stringify!($key) => table.$key = Some(map.next_value()?),)*
                                _ => table.of_laws.push((key, map.next_value()?)),
                            }
                        }
                        Ok(table)
                    }
                }

                d.deserialize_map(Table)
            }
        }

        impl $name {
            fn keys() -> Vec<&'static str> {
                let of_laws = law_keys().filter(|key| key.table() == $table);
                let mut keys = vec![$(stringify!($key)),*];
                for name in of_laws.map(Key::name) {
                    if !keys.contains(&name) {
                        keys.push(name);
                    }
                }
                keys
            }
        }
    };
}
law_table!(Material, "material" {});
law_table!(Contact, "contact" {
    law: Text,
    friction: Number,
    rolling_friction: Number,
    rolling_damping_ratio: Number,
});
table!(Sample {
    grains: Whole,
    radius_min: Number,
    radius_max: Number,
    sizes: Text,
    radius_mean: Number,
    radius_deviation: Number,
    large_fraction: Number,
    radii: Numbers,
    length: Number,
    width: Number,
    packing: Text,
    replicate: Numbers,
    walls: Text,
});
table!(Load {
    stiffness_number: Number,
    pressure: Number,
    normal_force: Number,
    gravity: Number,
});
table!(Time {
    step: Number,
    collision_speed: Number,
    force: Flag
});
table!(Pack {
    skip: Flag,
    friction: Number,
    tolerance: Number,
    max_steps: Whole
});
table!(Shear {
    inertial_number: Number,
    velocity: Number,
    strain: Number,
    protocol: Parts,
    spring_stiffness: Number,
    spring_number: Number,
});
table!(Output {
    frame_strain: Number,
    frame_start: Number,
    series_strain: Number,
    checkpoint_strain: Number,
    keep_checkpoints: Flag,
    frame_rows: Whole,
    series_rows: Whole,
    progress_lines: Whole,
    energy: Flag,
});
table!(BoxTable {
    solid_fraction: Number
});
table!(Relax {
    method: Text,
    tolerance: Number,
    drag: Number,
    max_steps: Whole,
});
table!(Aqs {
    strain_step: Number,
    steps: Whole,
    frame_every: Whole,
    spectrum: Flag,
    birth_precision: Number,
    until_imaginary: Number,
});
table!(Newtonian {
    growth_times: Number,
    rows: Whole,
    frames: Whole,
    spectra: Whole,
});
table!(Analysis {
    scalars: Flag,
    strain: Number,
    start: Number,
});
table!(Bookkeeping {
    skin: Number,
    rebuild_every: Whole,
    simd: Text,
});

/// The whole file.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Raw {
    pub title: Option<Spanned<Text>>,
    pub seed: Option<Spanned<Whole>>,
    pub dimension: Option<Spanned<Whole>>,
    pub material: Material,
    pub contact: Contact,
    pub sample: Sample,
    pub load: Load,
    pub time: Time,
    pub pack: Pack,
    pub shear: Shear,
    pub output: Output,
    pub r#box: BoxTable,
    pub relax: Relax,
    pub aqs: Aqs,
    pub newtonian: Newtonian,
    pub analysis: Analysis,
    pub bookkeeping: Bookkeeping,
}

/// Keys outside every table.
pub const TOP_KEYS: &[&str] = &["title", "seed", "dimension"];

/// Every table and its keys.
pub static TABLES: LazyLock<Vec<(&'static str, Vec<&'static str>)>> = LazyLock::new(|| {
    vec![
        ("material", Material::keys()),
        ("contact", Contact::keys()),
        ("sample", Sample::keys()),
        ("load", Load::keys()),
        ("time", Time::keys()),
        ("pack", Pack::keys()),
        ("shear", Shear::keys()),
        ("output", Output::keys()),
        ("box", BoxTable::keys()),
        ("relax", Relax::keys()),
        ("aqs", Aqs::keys()),
        ("newtonian", Newtonian::keys()),
        ("analysis", Analysis::keys()),
        ("bookkeeping", Bookkeeping::keys()),
    ]
});

/// The keys of a table.
pub fn keys_of(table: &str) -> Option<&'static [&'static str]> {
    TABLES
        .iter()
        .find(|(name, _)| *name == table)
        .map(|(_, keys)| keys.as_slice())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `TABLES` is a second list beside `Raw`: each table and each key of it must be one that serde knows.
    #[test]
    fn every_listed_key_is_known_to_serde() {
        for key in TOP_KEYS {
            let text = format!("{key} = 2000-01-01");
            let e = toml::from_str::<Raw>(&text).unwrap_err();
            assert!(e.message().starts_with("expected"), "{key}: {e}");
        }
        for (table, keys) in TABLES.iter() {
            for key in keys {
                let text = format!("{table}.{key} = 2000-01-01");
                let e = toml::from_str::<Raw>(&text).unwrap_err();
                assert!(e.message().starts_with("expected"), "{table}.{key}: {e}");
            }
        }
        let e = toml::from_str::<Raw>("nonsense = 1").unwrap_err();
        for name in TOP_KEYS.iter().chain(TABLES.iter().map(|(name, _)| name)) {
            assert!(e.message().contains(&format!("`{name}`")), "{name}: {e}");
        }
        assert_eq!(
            e.message().matches('`').count() / 2,
            1 + TOP_KEYS.len() + TABLES.len()
        );
    }
}
