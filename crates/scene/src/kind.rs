//! Kinds of values: what TOML gives, which range a key may declare, and how a default is written.

use gshear_dem::laws::keys::{ANY, Bounds};
use serde::de::{Deserialize, Deserializer, Error};

use crate::words::show;

/// A kind of values. Its range is checked and documented from the declaration.
pub(crate) trait Kind: Sized {
    /// What is allowed of the kind.
    type Range: Copy;
    /// A default value.
    type Default: Copy;
    /// The range of a key that declares none.
    const ALL: Self::Range;

    /// The range, whatever the kind.
    fn values(range: Self::Range) -> Values;
    /// A default as TOML.
    fn toml(default: Self::Default) -> String;
}

/// Integers from … to, both included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Integers {
    pub from: i64,
    pub to: i64,
}

/// n ≥ `from`.
pub(crate) const fn at_least(from: i64) -> Integers {
    Integers { from, to: i64::MAX }
}

impl Integers {
    /// What a number must be, for messages.
    pub fn words(&self) -> String {
        let Integers { from, to } = self;
        match *to {
            i64::MAX => format!("must be {from} or greater"),
            _ => format!("must lie in {from} … {to}"),
        }
    }
}

/// Kind and range of a key's values.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Values {
    Number(Bounds),
    Whole(Integers),
    Flag,
    /// One of these; any string if there are none.
    Text(&'static [&'static str]),
    /// A list of such numbers.
    Numbers(Bounds),
    /// Parts of a protocol.
    Parts,
}

impl Kind for Number {
    type Range = Bounds;
    type Default = f64;
    const ALL: Bounds = ANY;

    fn values(range: Bounds) -> Values {
        Values::Number(range)
    }

    fn toml(default: f64) -> String {
        show(default)
    }
}

impl Kind for Whole {
    type Range = Integers;
    type Default = i64;
    const ALL: Integers = at_least(i64::MIN);

    fn values(range: Integers) -> Values {
        Values::Whole(range)
    }

    fn toml(default: i64) -> String {
        default.to_string()
    }
}

impl Kind for Flag {
    type Range = ();
    type Default = bool;
    const ALL: () = ();

    fn values((): ()) -> Values {
        Values::Flag
    }

    fn toml(default: bool) -> String {
        default.to_string()
    }
}

impl Kind for Text {
    type Range = &'static [&'static str];
    type Default = &'static str;
    const ALL: &'static [&'static str] = &[];

    fn values(range: &'static [&'static str]) -> Values {
        Values::Text(range)
    }

    fn toml(default: &'static str) -> String {
        format!("{default:?}")
    }
}

/// No list has a default.
#[derive(Debug, Clone, Copy)]
pub(crate) enum NoDefault {}

impl Kind for Numbers {
    type Range = Bounds;
    type Default = NoDefault;
    const ALL: Bounds = ANY;

    fn values(range: Bounds) -> Values {
        Values::Numbers(range)
    }

    fn toml(default: NoDefault) -> String {
        match default {}
    }
}

impl Kind for Parts {
    type Range = ();
    type Default = NoDefault;
    const ALL: () = ();

    fn values((): ()) -> Values {
        Values::Parts
    }

    fn toml(default: NoDefault) -> String {
        match default {}
    }
}

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
