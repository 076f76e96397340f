//! What a table of the configuration is, and how its keys are declared.

use std::ops::Bound;

use gshear_dem::laws::keys::{Bounds, Key};
use gshear_dem::{adhesions, laws, observables};

/// A table of the configuration, or its top.
pub(crate) struct Table {
    /// Empty for the top.
    pub name: &'static str,
    pub about: &'static str,
    pub scenes: Scenes,
    /// Its keys but for those of the adhesions, the contact laws and registered observables.
    pub own: &'static [&'static Key],
}

/// The scenes that have a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Scenes {
    All,
    /// With a shear at a rate.
    Sheared,
    /// With quasi-static strain.
    Strained,
}

impl Table {
    /// Its keys; those of the adhesions, of the contact laws and of registered observables come
    /// last.
    pub(crate) fn keys(&self) -> Vec<&'static Key> {
        let mut keys = self.own.to_vec();
        for key in adhesion_keys().chain(law_keys()).chain(observable_keys()) {
            if key.table() == self.name && keys.iter().all(|known| known.path != key.path) {
                keys.push(key);
            }
        }
        keys
    }

    /// The key of this name.
    pub(crate) fn key(&self, name: &str) -> Option<&'static Key> {
        self.keys().into_iter().find(|key| key.name() == name)
    }
}

/// The keys of all contact laws, some more than once.
pub(crate) fn law_keys() -> impl Iterator<Item = &'static Key> {
    laws::all().flat_map(|kind| kind.keys.iter().copied())
}

/// The keys of all adhesions, some more than once.
pub(crate) fn adhesion_keys() -> impl Iterator<Item = &'static Key> {
    adhesions::all().flat_map(|kind| kind.keys.iter().copied())
}

/// The keys of all observables that the program registers, some more than once.
fn observable_keys() -> impl Iterator<Item = &'static Key> {
    observables::all().flat_map(|kind| kind.keys.iter().copied())
}

/// The contact laws that take a key, and the units that they give it.
pub(crate) fn laws_with(key: &Key) -> Vec<(&'static str, &'static str)> {
    let mut laws = Vec::new();
    for kind in laws::all() {
        if let Some(own) = kind.keys.iter().find(|own| own.path == key.path) {
            laws.push((kind.name, own.unit));
        }
    }
    laws
}

/// The unit of a key. If the laws that take it have several: `hooke: N/m; mindlin: N/m^1.5`.
pub(crate) fn unit(key: &Key) -> String {
    let laws = laws_with(key);
    if laws.iter().all(|(_, unit)| *unit == key.unit) {
        return key.unit.into();
    }
    let units = laws.iter().map(|(law, unit)| format!("{law}: {unit}"));
    units.collect::<Vec<_>>().join("; ")
}

/// Declares a table:
/// `KEYS: Type "name" Scenes Change { key: Values { what is declared of it }, … }`. A key's comment
/// is its meaning in docs/reference/keys.md; the other fields are those of [`Key`], whose
/// `change` is that of the table if it is not declared. Without a name the keys are those of the
/// top, or of a part of a protocol.
macro_rules! table {
    (
        $(#[doc = $about:literal])+
        $keys:ident: $type:ident $table:literal $scenes:ident $change:ident { $($declared:tt)* }
    ) => {
        $crate::table::table! {
            @all (concat!($table, ".")) $table $scenes [$($about)+]
            $keys: $type $change { $($declared)* }
        }
    };
    ($(#[doc = $about:literal])+ $keys:ident: $type:ident $change:ident { $($declared:tt)* }) => {
        $crate::table::table! {
            @all ("") "" All [$($about)+] $keys: $type $change { $($declared)* }
        }
    };
    (
        @all ($prefix:expr) $table:literal $scenes:ident [$($about:literal)+]
        $keys:ident: $type:ident $change:ident {
            $(
                $(#[doc = $doc:literal])+
                $key:ident: $kind:ident $(($values:expr))? {
                    $($field:ident: $value:expr),* $(,)?
                }
            ),* $(,)?
        }
    ) => {
        $(#[doc = $about])+
        pub(crate) struct $type {
            $($(#[doc = $doc])+ pub $key: gshear_dem::laws::keys::Key,)*
        }

        $(#[doc = $about])+
        pub(crate) static $keys: $type = $type {
            $($key: gshear_dem::laws::keys::Key {
                path: concat!($prefix, stringify!($key)),
                doc: concat!($($doc),+),
                values: gshear_dem::laws::keys::Values::$kind $(($values))?,
                $($field: $value,)*
                ..gshear_dem::laws::keys::Key {
                    change: gshear_dem::laws::keys::Change::$change,
                    ..gshear_dem::laws::keys::Key::PLAIN
                }
            },)*
        };

        impl $type {
            pub(crate) const TABLE: $crate::table::Table = $crate::table::Table {
                name: $table,
                about: concat!($($about),+),
                scenes: $crate::table::Scenes::$scenes,
                own: &[$(&$keys.$key),*],
            };
        }
    };
}
pub(crate) use table;

/// The numbers from … to, both included.
pub(crate) const fn from_to(from: f64, to: f64) -> Bounds {
    let [from, to] = [Bound::Included(from), Bound::Included(to)];
    Bounds { from, to }
}

/// The names of a list of names and values.
pub(crate) const fn names<T: Copy, const N: usize>(
    named: &[(&'static str, T); N],
) -> [&'static str; N] {
    let mut names = [""; N];
    let mut k = 0;
    while k < N {
        names[k] = named[k].0;
        k += 1;
    }
    names
}
