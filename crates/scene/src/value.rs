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
    let found = show(x);
    if !x.is_finite() {
        Some(format!("must be a finite number, found {found}"))
    } else if !bounds.hold(x) {
        Some(format!("{}, found {found}", bounds.words()))
    } else if x != 0.0 && !(least..=most).contains(&x.abs()) {
        Some(format!(
            "must lie between {least:e} and {most:e} in magnitude, found {found}; check its unit"
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
    /// What was expected, and what was found.
    pub fn read(values: Values, found: Spanned<DeValue<'_>>) -> Result<Self, String> {
        let found = toml::Value::deserialize(ValueDeserializer::from(found))
            .map_err(|_| format!("expected {}, found a number out of range", expected(values)))?;
        match (values, &found) {
            (Values::Tables(keys), toml::Value::Array(tables)) => {
                let tables = tables.iter().map(|table| entries(&keys(), table));
                tables.collect::<Result<_, _>>().map(Self::Tables)
            }
            _ => Self::of(values, &found)
                .ok_or_else(|| format!("expected {}, found {}", expected(values), kind(&found))),
        }
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
            Values::Text(_) | Values::Word(_) => Self::Text(found.as_str()?.into()),
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
            Values::Names => {
                let names = found.as_array()?.iter();
                let names = names.map(|name| name.as_str().map(Into::into));
                Self::Names(names.collect::<Option<_>>()?)
            }
            Values::Tables(_) => return None,
        })
    }

    /// What is wrong with a number that its key does not take.
    pub fn out_of_bounds(&self, key: &Key) -> Option<String> {
        match (self, key.values) {
            (&Self::Number(x), Values::Number(bounds)) => refusal(bounds, x),
            (&Self::Whole(n), Values::Whole(range)) if n < range.from || n > range.to => {
                Some(format!("{}, found {n}", range.words()))
            }
            _ => None,
        }
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
            Values::Text(_) | Values::Word(_) => Some(Self::Text(key.default.into())),
            Values::Numbers(_) | Values::Names | Values::Parts(_) | Values::Tables(_) => None,
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
            Self::Names(list) => format!("{list:?}"),
            Self::Parts(parts) => {
                let entry = |(name, x): &(String, f64)| format!("{name} = {}", show(*x));
                lines(parts, entry)
            }
            Self::Tables(tables) => {
                let entry = |(name, x): &(String, Self)| format!("{name} = {}", x.toml());
                lines(tables, entry)
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

/// Tables of these entries as a list of TOML, a line each.
fn lines<T>(tables: &[Vec<T>], entry: impl Fn(&T) -> String) -> String {
    let line = |table: &Vec<T>| {
        let entries: Vec<String> = table.iter().map(&entry).collect();
        format!("    {{ {} }},\n", entries.join(", "))
    };
    format!("[\n{}]", tables.iter().map(line).collect::<String>())
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
        Values::Tables(_) => "a list of tables",
    }
}

/// The entries of a table of a list, in the order of their declarations.
fn entries(keys: &[&'static Key], found: &toml::Value) -> Result<Entries, String> {
    let table = found.as_table();
    let table = table.ok_or_else(|| format!("expected a table, found {}", kind(found)))?;
    let mut entries = Entries::new();
    for (key, found) in table {
        // An unknown one has been refused.
        let Some(declared) = keys.iter().find(|declared| declared.name() == key) else {
            continue;
        };
        let value = Value::of(declared.values, found).ok_or_else(|| {
            let expected = expected(declared.values);
            format!("{key}: expected {expected}, found {}", kind(found))
        })?;
        entries.push((key.clone(), value));
    }
    entries.sort_by_key(|(name, _)| keys.iter().position(|key| key.name() == name));
    Ok(entries)
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
