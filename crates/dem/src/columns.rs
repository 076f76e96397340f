//! Tables of numbers. Each column is declared once: name, unit, documentation and, as a field of
//! the row, its value.
//!
//! ```
//! gshear_dem::columns! {
//!     /// One row of a table.
//!     pub struct Reading {
//!         /// Pressure on the top wall.
//!         pressure: "Pa",
//!         /// Energy dissipated by sliding.
//!         dissipated: "J",
//!     }
//! }
//!
//! let row = Reading { pressure: 2.0, dissipated: 0.5 };
//! assert_eq!(row.columns(), [2.0, 0.5]);
//! assert_eq!(Reading::from_columns([2.0, 0.5]), row);
//! assert_eq!(Reading::COLUMNS[0].name, "pressure");
//! assert_eq!(Reading::COLUMNS[0].doc, "Pressure on the top wall.");
//! ```

use std::fmt;
use std::sync::{Mutex, PoisonError};

/// A column of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// The field of the row, the dataset in HDF5 files and the head of the column in CSV files.
    pub name: &'static str,
    /// Unit in 3D, as the units module of H5MD writes it: `m s-1`; `1` for pure numbers.
    pub unit: &'static str,
    /// What the column holds; also the text of docs/reference/columns.md.
    pub doc: &'static str,
    /// Whether a scene declares the column, and not the program. Its unit is in any dimension the
    /// one that it has here.
    pub is_own: bool,
}

impl Column {
    /// A column.
    pub const fn new(name: &'static str, unit: &'static str, doc: &'static str) -> Self {
        Self {
            name,
            unit,
            doc,
            is_own: false,
        }
    }

    /// A column that a scene declares. Its texts are kept for as long as the program runs.
    pub fn own(name: &str, unit: &str, doc: &str) -> Self {
        let [name, unit, doc] = [name, unit, doc].map(kept_text);
        Self {
            is_own: true,
            ..Self::new(name, unit, doc)
        }
    }

    /// Unit in so many dimensions, `None` for pure numbers. In 2D forces, energies and masses are
    /// per unit depth.
    pub fn unit_in(&self, axes: usize) -> Option<String> {
        match (self.unit, axes) {
            ("1" | "", _) => None,
            (unit, _) if self.is_own => Some(unit.into()),
            (unit @ ("N" | "J" | "kg"), 2) => Some(format!("{unit} m-1")),
            ("N m", 2) => Some("N".into()),
            (unit, _) => Some(unit.into()),
        }
    }
}

/// The name.
impl AsRef<str> for Column {
    fn as_ref(&self) -> &str {
        self.name
    }
}

/// The name.
impl fmt::Display for Column {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

/// Names of columns with `separator` between them.
pub fn joined_names(columns: &[Column], separator: &str) -> String {
    let names: Vec<&str> = columns.iter().map(|column| column.name).collect();
    names.join(separator)
}

/// Texts and lists of columns that a scene declares, each kept once.
static KEPT_TEXTS: Mutex<Vec<&'static str>> = Mutex::new(Vec::new());
static KEPT_LISTS: Mutex<Vec<&'static [Column]>> = Mutex::new(Vec::new());

fn kept_text(text: &str) -> &'static str {
    let mut kept = KEPT_TEXTS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = kept.iter().find(|known| **known == text) {
        return known;
    }
    let new: &'static str = Box::leak(text.into());
    kept.push(new);
    new
}

/// A list of columns that is kept for as long as the program runs.
pub fn kept(columns: &[Column]) -> &'static [Column] {
    let mut kept = KEPT_LISTS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = kept.iter().find(|known| **known == columns) {
        return known;
    }
    let new: &'static [Column] = Box::leak(columns.into());
    kept.push(new);
    new
}

/// Declares the row of a table: a struct of `f64` with `COLUMNS`, `columns` and `from_columns`.
///
/// A field has a doc comment, its name and its unit (see
/// [`Column::unit`](crate::columns::Column::unit)); see [`columns`](mod@crate::columns). The
/// calling crate needs `bytemuck`.
#[macro_export]
macro_rules! columns {
    (
        $(#[$attribute:meta])*
        $visibility:vis struct $row:ident {
            $(
                $(#[doc = $doc:literal])+
                $name:ident: $unit:literal
            ),+ $(,)?
        }
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(C)]
        $visibility struct $row {
            $($(#[doc = $doc])+ pub $name: f64,)+
        }

        impl $row {
            /// The columns, in the order of the fields.
            pub const COLUMNS: [$crate::columns::Column; size_of::<$row>() / size_of::<f64>()] = [
                $($crate::columns::Column {
                    name: stringify!($name),
                    unit: $unit,
                    doc: concat!($($doc),+).trim_ascii(),
                    is_own: false,
                },)+
            ];

            /// The values, in the order of [`Self::COLUMNS`].
            pub const fn columns(&self) -> [f64; Self::COLUMNS.len()] {
                [$(self.$name),+]
            }

            /// The row with these values, in the order of [`Self::COLUMNS`].
            pub const fn from_columns([$($name),+]: [f64; Self::COLUMNS.len()]) -> Self {
                Self { $($name),+ }
            }
        }

        /// The values, in the order of the columns.
        impl AsRef<[f64]> for $row {
            fn as_ref(&self) -> &[f64] {
                bytemuck::cast_slice(std::slice::from_ref(self))
            }
        }
    };
}

#[cfg(test)]
mod tests {
    crate::columns! {
        /// Two columns.
        struct Pair {
            /// Force along
            /// the wall.
            force: "N",
            /// A number.
            share: "1",
        }
    }

    #[test]
    fn units_in_2d_are_per_unit_depth() {
        let [force, share] = Pair::COLUMNS;
        assert_eq!(force.unit_in(2).as_deref(), Some("N m-1"));
        assert_eq!(force.unit_in(3).as_deref(), Some("N"));
        assert_eq!(share.unit_in(2), None);
        assert_eq!(force.doc, "Force along the wall.");
    }

    #[test]
    fn columns_of_scenes_are_kept_once() {
        let column = || super::Column::own("v", "N", "mean");
        assert_eq!(column().unit_in(2).as_deref(), Some("N"));
        assert!(std::ptr::eq(column().name, column().name));
        let list = || super::kept(&[Pair::COLUMNS[0], column()]);
        assert!(std::ptr::eq(list(), list()));
        assert_eq!(list()[1], column());
    }

    #[test]
    fn values_and_columns_have_the_same_order() {
        let pair = Pair::from_columns([1.0, 2.0]);
        assert_eq!((pair.force, pair.share), (1.0, 2.0));
        assert_eq!(pair.columns(), [1.0, 2.0]);
        assert_eq!(pair.as_ref(), [1.0, 2.0]);
    }
}
