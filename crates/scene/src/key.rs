//! A key of the configuration: what is declared of it, and the value that was given.

use gshear_dem::laws::keys::{self, ANY, Bounds};
use toml::Spanned;

use crate::raw::{Flag, Number, Numbers, Parts, Text, Whole, show};

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

/// What the program knows of a key, declared once in [`crate::raw`] (the laws' keys: in
/// [`gshear_dem::laws::keys`]). Checks, messages, `scene.toml`, the table of docs/config.md and the
/// JSON schema are made from it.
pub(crate) struct Declared<T: Kind> {
    /// The table and the name: `sample.grains`.
    pub path: &'static str,
    /// The meaning, in Markdown.
    pub doc: &'static str,
    /// Empty for a pure number.
    pub unit: &'static str,
    pub range: T::Range,
    /// What else is asked of a value, in Markdown.
    pub condition: &'static str,
    pub default: Option<T::Default>,
    /// What applies if the key is not given and has no constant default, in Markdown.
    pub otherwise: &'static str,
    /// What it is, in a few words, and an example: for the message that it is missing.
    pub what: &'static str,
    pub example: &'static str,
    /// Names that the key had in earlier releases, within its table. They are still taken.
    pub former: &'static [&'static str],
}

impl<T: Kind> Clone for Declared<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T: Kind> Copy for Declared<T> {}

impl<T: Kind> Declared<T> {
    /// A key without a range, a unit or a default.
    pub const PLAIN: Self = Self {
        path: "",
        doc: "",
        unit: "",
        range: T::ALL,
        condition: "",
        default: None,
        otherwise: "",
        what: "",
        example: "",
        former: &[],
    };

    /// The name without the table.
    pub fn name(&self) -> &'static str {
        self.path
            .split_once('.')
            .map_or(self.path, |(_, name)| name)
    }

    /// The table; empty for a key above all tables.
    pub fn table(&self) -> &'static str {
        self.path.split_once('.').map_or("", |(table, _)| table)
    }

    /// What a configuration without this key lacks: `grains: the number of grains, such as …`.
    pub fn lacking(&self) -> String {
        let unit = match self.unit {
            "" => String::new(),
            unit => format!(" ({unit})"),
        };
        let (name, what, example) = (self.name(), self.what, self.example);
        format!("{name}: {what}{unit}, such as {name} = {example}")
    }

    /// The declaration, whatever the kind.
    pub fn entry(&self) -> Entry {
        Entry {
            path: self.path,
            name: self.name(),
            doc: self.doc.trim_start().into(),
            unit: self.unit.into(),
            values: T::values(self.range),
            condition: self.condition,
            default: self.default.map(T::toml),
            otherwise: self.otherwise,
            former: self.former,
        }
    }
}

/// A key that a contact law declares.
impl From<&keys::LawKey> for Declared<Number> {
    fn from(key: &keys::LawKey) -> Self {
        Self {
            path: key.path,
            doc: key.doc,
            unit: key.unit,
            range: key.bounds,
            otherwise: key.default,
            what: key.symbol,
            example: key.example,
            ..Self::PLAIN
        }
    }
}

/// A declaration, whatever its kind.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    pub path: &'static str,
    pub name: &'static str,
    pub doc: String,
    pub unit: String,
    pub values: Values,
    pub condition: &'static str,
    /// As TOML.
    pub default: Option<String>,
    pub otherwise: &'static str,
    pub former: &'static [&'static str],
}

/// A key with its declaration, and the value that may have been given, with its place.
pub(crate) struct Key<T: Kind> {
    pub declared: Declared<T>,
    pub given: Option<(usize, T)>,
}

impl<T: Kind> Key<T> {
    /// A key that was not given.
    pub const fn absent(declared: Declared<T>) -> Self {
        Self {
            declared,
            given: None,
        }
    }

    /// Takes the value of the file.
    pub fn give(&mut self, value: Spanned<T>) {
        self.given = Some((value.span().start, value.into_inner()));
    }

    pub fn is_given(&self) -> bool {
        self.given.is_some()
    }

    pub fn offset(&self) -> Option<usize> {
        self.given.as_ref().map(|(offset, _)| *offset)
    }

    /// The key and its place, for a problem that several keys cause.
    pub fn place(&self) -> (&'static str, Option<usize>) {
        (self.declared.path, self.offset())
    }
}
