//! Values of keys: what TOML gives, defaults, and how they are written.

use gshear_dem::laws::keys::{Bounds, Key, Values};
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
    Names(Vec<String>),
    /// Names and values in the order of their declarations; unknown names come last.
    Parts(Vec<Vec<(String, f64)>>),
    Tables(Vec<Entries>),
}

/// Magnitudes between which every number of a scene lies that is not 0, whatever its unit: products
/// of some of them stay within the range of numbers.
pub(crate) const MAGNITUDES: [f64; 2] = [1e-30, 1e30];

/// What is wrong with a number that its key does not take.
pub(crate) fn refusal(bounds: Bounds, x: f64) -> Option<String> {
    let [least, most] = MAGNITUDES;
    let value = show(x);
    if !x.is_finite() {
        Some(format!("must be a finite number, found {value}"))
    } else if !bounds.hold(x) {
        Some(format!("{}, found {value}", bounds.words()))
    } else if x != 0.0 && !(least..=most).contains(&x.abs()) {
        Some(format!(
            "must lie between {least:e} and {most:e} in magnitude, found {value}; check its unit"
        ))
    } else {
        None
    }
}

/// The keys of a table of a list, and their values.
pub(crate) type Entries = Vec<(String, Value)>;

impl Value {
    /// The value that TOML gives.
    ///
    /// # Errors
    /// What was expected, and what was given.
    pub(crate) fn read(values: Values, given: Spanned<DeValue<'_>>) -> Result<Self, String> {
        let given = toml::Value::deserialize(ValueDeserializer::from(given))
            .map_err(|_| format!("expected {}, found a number out of range", expected(values)))?;
        match (values, &given) {
            (Values::Tables(keys), toml::Value::Array(tables)) => {
                let tables = tables.iter().map(|table| entries(&keys(), table));
                tables.collect::<Result<_, _>>().map(Self::Tables)
            }
            _ => Self::simple(values, &given)
                .ok_or_else(|| format!("expected {}, found {}", expected(values), kind(&given))),
        }
    }

    /// A value of any kind but a list of tables.
    fn simple(values: Values, given: &toml::Value) -> Option<Self> {
        Some(match values {
            Values::Number(_) => Self::Number(number(given)?),
            Values::Numbers(_) => {
                let numbers = given.as_array()?.iter().map(number);
                Self::Numbers(numbers.collect::<Option<_>>()?)
            }
            Values::Whole(_) => Self::Whole(given.as_integer()?),
            Values::Flag => Self::Flag(given.as_bool()?),
            Values::Text(_) | Values::Word(_) => Self::Text(given.as_str()?.into()),
            Values::Parts(keys) => {
                let parts = given.as_array()?.iter().map(|part| {
                    let entries = part.as_table()?.iter();
                    let entries = entries.map(|(name, x)| Some((name.clone(), number(x)?)));
                    let mut entries = entries.collect::<Option<Vec<_>>>()?;
                    entries.sort_by_key(|(name, _)| {
                        let place = keys.iter().position(|key| key.path == name);
                        place.unwrap_or(keys.len())
                    });
                    Some(entries)
                });
                Self::Parts(parts.collect::<Option<_>>()?)
            }
            Values::Names => {
                let names = given.as_array()?.iter();
                let names = names.map(|name| name.as_str().map(Into::into));
                Self::Names(names.collect::<Option<_>>()?)
            }
            Values::Tables(_) => return None,
        })
    }

    /// What is wrong with a number that its key does not take.
    pub(crate) fn out_of_bounds(&self, key: &Key) -> Option<String> {
        match (self, key.values) {
            (&Self::Number(x), Values::Number(bounds)) => refusal(bounds, x),
            (&Self::Whole(n), Values::Whole(range)) if n < range.from || n > range.to => {
                Some(format!("{}, found {n}", range.words()))
            }
            _ => None,
        }
    }

    /// The constant default of a key, if it has one.
    pub(crate) fn default_of(key: &Key) -> Option<Self> {
        if key.default.is_empty() {
            return None;
        }
        match key.values {
            Values::Number(_) => key.default_number().map(Self::Number),
            Values::Whole(_) => key.default.parse().ok().map(Self::Whole),
            Values::Flag => key.default.parse().ok().map(Self::Flag),
            Values::Text(_) | Values::Word(_) => Some(Self::Text(key.default.into())),
            Values::Numbers(_) | Values::Names | Values::Parts(_) | Values::Tables(_) => None,
        }
    }

    /// The value as TOML.
    pub(crate) fn toml(&self) -> String {
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
            Self::Names(list) => format!("{list:?}"),
            Self::Parts(parts) => lines(parts, |x| show(*x)),
            Self::Tables(tables) => lines(tables, Self::toml),
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

/// Tables as a list of TOML, a line each.
fn lines<T>(tables: &[Vec<(String, T)>], toml: impl Fn(&T) -> String) -> String {
    let mut text = String::from("[\n");
    for table in tables {
        let entries = table.iter();
        let entries = entries.map(|(name, value)| format!("{name} = {}", toml(value)));
        let entries: Vec<String> = entries.collect();
        text += &format!("    {{ {} }},\n", entries.join(", "));
    }
    text + "]"
}

/// What a key of this kind takes.
fn expected(values: Values) -> &'static str {
    match values {
        Values::Number(_) => "a number",
        Values::Numbers(_) => "a list of numbers",
        Values::Whole(_) => "an integer without decimal point or exponent",
        Values::Flag => "true or false",
        Values::Text(_) | Values::Word(_) => "a string in quotes",
        Values::Names => "a list of strings in quotes",
        Values::Parts(_) => "a list of tables of numbers, such as [[shear.protocol]]",
        Values::Tables(_) => "a list of tables, in double brackets",
    }
}

/// The entries of a table of a list, in the order of their declarations.
fn entries(keys: &[&'static Key], given: &toml::Value) -> Result<Entries, String> {
    let table = given.as_table();
    let table = table.ok_or_else(|| format!("expected a table, found {}", kind(given)))?;
    let mut entries = Entries::new();
    for (key, given) in table {
        // An unknown one has been refused.
        let Some(declared) = keys.iter().find(|declared| declared.name() == key) else {
            continue;
        };
        let value = Value::simple(declared.values, given).ok_or_else(|| {
            let expected = expected(declared.values);
            format!("{key}: expected {expected}, found {}", kind(given))
        })?;
        entries.push((key.clone(), value));
    }
    entries.sort_by_key(|(name, _)| keys.iter().position(|key| key.name() == name));
    Ok(entries)
}

fn number(value: &toml::Value) -> Option<f64> {
    match value {
        toml::Value::Integer(n) => Some(*n as f64),
        _ => value.as_float(),
    }
}

fn kind(given: &toml::Value) -> String {
    match given {
        toml::Value::String(s) => format!("the string {s:?}"),
        toml::Value::Integer(n) => format!("the integer {n}"),
        toml::Value::Float(x) => format!("the number {}", show(*x)),
        toml::Value::Boolean(b) => format!("the boolean {b}"),
        toml::Value::Datetime(d) => format!("the date {d}"),
        toml::Value::Array(_) => "an array".into(),
        toml::Value::Table(_) => "a table".into(),
    }
}
