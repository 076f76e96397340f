//! A key of the configuration: what is declared of it, and the value that was given.

use gshear_dem::laws::keys;
use toml::Spanned;

use crate::kind::{Kind, Number, Values};

/// When the value of a key may change after a run has begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Never: the key decides the grains, or what a checkpoint stores of them.
    Never,
    /// Only in a branch, because the key decides the trajectory.
    Branch,
    /// At every resume: the key decides where a stage ends.
    End,
    /// At every resume: output and bookkeeping, which do not reach the trajectory.
    Resume,
}

impl Change {
    /// Whether the key belongs to the identity of a run.
    pub fn is_physics(self) -> bool {
        matches!(self, Change::Never | Change::Branch)
    }

    /// The word in docs/config.md.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Change::Never => "never",
            Change::Branch => "branch",
            Change::End | Change::Resume => "resume",
        }
    }
}

/// What the program knows of a key, declared once in `crate::raw` (the laws' keys: in
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
    /// When it may change after a run has begun.
    pub change: Change,
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
        change: Change::Branch,
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
            change: self.change,
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
            default: key.constant,
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
    pub change: Change,
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

    /// The value, if given.
    pub fn value(&self) -> Option<&T> {
        self.given.as_ref().map(|(_, value)| value)
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
