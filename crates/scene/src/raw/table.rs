//! What a table is: its declaration, and how serde reads it.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, MapAccess, Visitor};

use crate::key::Entry;
use crate::kind::{Integers, at_least};

pub(super) const FROM_ONE: Integers = at_least(1);
pub(super) const FROM_ZERO: Integers = at_least(0);

/// A table of the file, or the file itself.
pub trait KeyTable: Default {
    /// The name; empty for the file.
    const NAME: &'static str;
    /// What it is about.
    const ABOUT: &'static str;

    /// Takes the value of a key. `false`: the table has no such key.
    fn take<'de, A: MapAccess<'de>>(&mut self, key: &str, map: &mut A) -> Result<bool, A::Error>;

    /// What is declared of its keys.
    fn entries() -> Vec<Entry>;
}

/// What is declared of a table.
pub struct TableEntry {
    pub name: &'static str,
    pub about: &'static str,
    pub keys: Vec<Entry>,
}

impl TableEntry {
    pub(super) fn of<T: KeyTable>() -> Self {
        Self {
            name: T::NAME,
            about: T::ABOUT.trim(),
            keys: T::entries(),
        }
    }
}

/// Reads a table, key by key.
pub(super) struct Reader<T>(pub PhantomData<T>);

impl<'de, T: KeyTable> Visitor<'de> for Reader<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<T, A::Error> {
        let mut table = T::default();
        while let Some(key) = map.next_key::<String>()? {
            if !table.take(&key, &mut map)? {
                return Err(A::Error::custom(format!("unknown key {key}")));
            }
        }
        Ok(table)
    }
}

/// Declares a table: `Name "name" { key: Kind { what is declared of it }, … }`. A key's comment is
/// its meaning in docs/config.md; the other fields are those of [`Declared`]. After the table,
/// `laws: field` names the field for the numbers that contact laws declare there. Without a name in
/// quotes it is the file, followed by its tables.
macro_rules! table {
    (
        $(#[doc = $about:literal])+
        $name:ident $table:literal { $($keys:tt)* } $(laws: $laws:ident)?
    ) => {
        table! { @all (concat!($table, ".")) $table [$($about)+] $name { $($keys)* } [$($laws)?] [] }
    };
    (
        $(#[doc = $about:literal])+
        $name:ident { $($keys:tt)* } tables { $($field:ident: $type:ident),* $(,)? }
    ) => {
        table! { @all ("") "" [$($about)+] $name { $($keys)* } [] [$($field: $type)*] }

        impl $name {
            /// Every table and its keys.
            pub fn tables() -> Vec<$crate::raw::table::TableEntry> {
                vec![$($crate::raw::table::TableEntry::of::<$type>()),*]
            }
        }
    };
    (
        @all ($prefix:expr) $table:literal [$($about:literal)+]
        $name:ident {
            $(
                $(#[doc = $doc:literal])+
                $key:ident: $kind:ident { $($declared:ident: $value:expr),* $(,)? }
            ),* $(,)?
        }
        [$($laws:ident)?] [$($field:ident: $type:ident)*]
    ) => {
        $(#[doc = $about])+
        pub struct $name {
            $($(#[doc = $doc])+ pub $key: $crate::key::Key<$kind>,)*
            $(
                /// Names and values of the keys that the contact laws declare.
                pub $laws: Vec<(String, toml::Spanned<$crate::kind::Number>)>,
            )?
            $(pub $field: $type,)*
        }

        impl $name {
            /// The keys as they are declared, none of them given.
            pub const KEYS: Self = Self {
                $(
                    $key: $crate::key::Key::absent($crate::key::Declared {
                        path: concat!($prefix, stringify!($key)),
                        doc: concat!($($doc),+),
                        $($declared: $value,)*
                        ..$crate::key::Declared::PLAIN
                    }),
                )*
                $($laws: Vec::new(),)?
                $($field: $type::KEYS,)*
            };
        }

        impl Default for $name {
            fn default() -> Self {
                Self::KEYS
            }
        }

        impl $crate::raw::table::KeyTable for $name {
            const NAME: &'static str = $table;
            const ABOUT: &'static str = concat!($($about),+);

            fn take<'de, A: serde::de::MapAccess<'de>>(
                &mut self,
                key: &str,
                map: &mut A,
            ) -> Result<bool, A::Error> {
                match key {
                    $(stringify!($key) => self.$key.give(map.next_value()?),)*
                    $($type::NAME => self.$field = map.next_value()?,)*
                    $(
                        _ if $crate::law_keys::law_entries(Self::NAME).iter().any(|known| known.name == key) => {
                            self.$laws.push((key.into(), map.next_value()?));
                        }
                    )?
                    _ => return Ok(false),
                }
                Ok(true)
            }

            fn entries() -> Vec<$crate::key::Entry> {
                vec![$(Self::KEYS.$key.declared.entry()),*]
                $(
                    .into_iter()
                    .chain($crate::law_keys::law_entries({
                        stringify!($laws);
                        Self::NAME
                    }))
                    .collect()
                )?
            }
        }

        impl<'de> serde::de::Deserialize<'de> for $name {
            fn deserialize<D: serde::de::Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
                d.deserialize_map($crate::raw::table::Reader(std::marker::PhantomData))
            }
        }
    };
}

pub(super) use table;

/// The names of a list of names and values.
pub(super) const fn names<T: Copy, const N: usize>(
    of: &[(&'static str, T); N],
) -> [&'static str; N] {
    let mut names = [""; N];
    let mut k = 0;
    while k < N {
        names[k] = of[k].0;
        k += 1;
    }
    names
}
