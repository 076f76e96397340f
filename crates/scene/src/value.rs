//! Values of keys: what TOML gives, defaults, and how they are written.

use gshear_dem::laws::keys::{Key, Values};
use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeValue, ValueDeserializer};

use crate::words::show;

/// The value of a key, of the kind that its declaration names.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Value {
    /// An integer of TOML is taken, too.
    Number(f64),
    Numbers(Vec<f64>),
    Whole(i64),
    Wholes(Vec<u32>),
    Flag(bool),
    Text(String),
    /// Names and values in the order of their declarations; unknown names come last.
    Parts(Vec<Vec<(String, f64)>>),
}

impl Value {
    /// The value that TOML gives.
    ///
    /// # Errors
    /// What was expected, and what was found.
    pub fn read(values: Values, found: Spanned<DeValue<'_>>) -> Result<Self, String> {
        let expected = match values {
            Values::Number(_) => "a number",
            Values::Numbers(_) => "a list of numbers",
            Values::Whole(_) => "an integer without decimal point or exponent",
            Values::Flag => "true or false",
            Values::Text(_) => "a string in quotes",
            Values::Parts(_) => "a list of tables of numbers, such as [[shear.protocol]]",
        };
        let found = toml::Value::deserialize(ValueDeserializer::from(found))
            .map_err(|_| format!("expected {expected}, found a number out of range"))?;
        Self::of(values, &found)
            .ok_or_else(|| format!("expected {expected}, found {}", kind(&found)))
    }

    fn of(values: Values, found: &toml::Value) -> Option<Self> {
        Some(match values {
            Values::Number(_) => Self::Number(number(found)?),
            Values::Numbers(_) => {
                let numbers = found.as_array()?.iter().map(number);
                Self::Numbers(numbers.collect::<Option<_>>()?)
            }
            Values::Whole(_) => Self::Whole(found.as_integer()?),
            Values::Flag => Self::Flag(found.as_bool()?),
            Values::Text(_) => Self::Text(found.as_str()?.into()),
            Values::Parts(keys) => {
                let parts = found.as_array()?.iter().map(|part| {
                    let entries = part.as_table()?.iter();
                    let entries = entries.map(|(name, x)| Some((name.clone(), number(x)?)));
                    let mut entries = entries.collect::<Option<Vec<_>>>()?;
                    let place = |name: &str| keys.iter().position(|key| key.path == name);
                    entries.sort_by_key(|(name, _)| place(name).unwrap_or(keys.len()));
                    Some(entries)
                });
                Self::Parts(parts.collect::<Option<_>>()?)
            }
        })
    }

    /// The constant default of a key, if it has one.
    pub fn default_of(key: &Key) -> Option<Self> {
        if key.default.is_empty() {
            return None;
        }
        match key.values {
            Values::Number(_) => key.default_number().map(Self::Number),
            Values::Whole(_) => key.default.parse().ok().map(Self::Whole),
            Values::Flag => key.default.parse().ok().map(Self::Flag),
            Values::Text(_) => Some(Self::Text(key.default.into())),
            Values::Numbers(_) | Values::Parts(_) => None,
        }
    }

    /// The value as TOML.
    pub fn toml(&self) -> String {
        match self {
            Self::Number(x) => show(*x),
            Self::Numbers(list) => {
                let list: Vec<String> = list.iter().map(|x| show(*x)).collect();
                format!("[{}]", list.join(", "))
            }
            Self::Whole(n) => n.to_string(),
            Self::Wholes(list) => format!("{list:?}"),
            Self::Flag(b) => b.to_string(),
            Self::Text(s) => toml::Value::String(s.clone()).to_string(),
            Self::Parts(parts) => {
                let mut list = String::from("[\n");
                for part in parts {
                    let entries = part
                        .iter()
                        .map(|(name, x)| format!("{name} = {}", show(*x)));
                    let entries: Vec<String> = entries.collect();
                    list += &format!("    {{ {} }},\n", entries.join(", "));
                }
                list + "]"
            }
        }
    }
}

impl From<f64> for Value {
    fn from(x: f64) -> Self {
        Self::Number(x)
    }
}

impl From<u64> for Value {
    fn from(n: u64) -> Self {
        Self::Whole(n.cast_signed())
    }
}

impl From<&[u32]> for Value {
    fn from(list: &[u32]) -> Self {
        Self::Wholes(list.to_vec())
    }
}

impl From<bool> for Value {
    fn from(b: bool) -> Self {
        Self::Flag(b)
    }
}

impl From<&str> for Value {
    fn from(s: &str) -> Self {
        Self::Text(s.into())
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    let whole = || value.as_integer().map(|n| n as f64);
    value.as_float().or_else(whole)
}

fn kind(found: &toml::Value) -> String {
    match found {
        toml::Value::String(s) => format!("the string {s:?}"),
        toml::Value::Integer(n) => format!("the integer {n}"),
        toml::Value::Float(x) => format!("the number {}", show(*x)),
        toml::Value::Boolean(b) => format!("the boolean {b}"),
        toml::Value::Datetime(d) => format!("the date {d}"),
        toml::Value::Array(_) => "an array".into(),
        toml::Value::Table(_) => "a table".into(),
    }
}
