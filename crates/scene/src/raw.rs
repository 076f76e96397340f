//! The configuration as it is written: the declaration of every table and key, and the values that
//! were given. Types are checked, nothing else.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Bound;
use std::sync::LazyLock;

use gshear_dem::laws::LAWS;
use gshear_dem::laws::keys::{BELOW_ONE, Bounds, NOT_NEGATIVE, POSITIVE, UNIT};
use serde::de::{Deserialize, Deserializer, Error, MapAccess, Visitor};
use toml::Spanned;

use crate::check::law_keys;
use crate::derived::{STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use crate::key::{Declared, Entry, Integers, Key, at_least};
use crate::periodic::Method;
use crate::scene::{SIMD_NAMES, Sizes, Walls};

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
    fn of<T: KeyTable>() -> Self {
        Self {
            name: T::NAME,
            about: T::ABOUT.trim(),
            keys: T::entries(),
        }
    }
}

/// Reads a table, key by key.
struct Reader<T>(PhantomData<T>);

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
            pub fn tables() -> Vec<TableEntry> {
                vec![$(TableEntry::of::<$type>()),*]
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
            $($(#[doc = $doc])+ pub $key: Key<$kind>,)*
            $(
                /// Names and values of the keys that the contact laws declare.
                pub $laws: Vec<(String, Spanned<Number>)>,
            )?
            $(pub $field: $type,)*
        }

        impl $name {
            /// The keys as they are declared, none of them given.
            pub const KEYS: Self = Self {
                $(
                    $key: Key::absent(Declared {
                        path: concat!($prefix, stringify!($key)),
                        doc: concat!($($doc),+),
                        $($declared: $value,)*
                        ..Declared::PLAIN
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

        impl KeyTable for $name {
            const NAME: &'static str = $table;
            const ABOUT: &'static str = concat!($($about),+);

            fn take<'de, A: MapAccess<'de>>(
                &mut self,
                key: &str,
                map: &mut A,
            ) -> Result<bool, A::Error> {
                match key {
                    $(stringify!($key) => self.$key.give(map.next_value()?),)*
                    $($type::NAME => self.$field = map.next_value()?,)*
                    $(
                        _ if law_entries(Self::NAME).iter().any(|known| known.name == key) => {
                            self.$laws.push((key.into(), map.next_value()?));
                        }
                    )?
                    _ => return Ok(false),
                }
                Ok(true)
            }

            fn entries() -> Vec<Entry> {
                vec![$(Self::KEYS.$key.declared.entry()),*]
                $(
                    .into_iter()
                    .chain(law_entries({
                        stringify!($laws);
                        Self::NAME
                    }))
                    .collect()
                )?
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
                d.deserialize_map(Reader(PhantomData))
            }
        }
    };
}

const FROM_ONE: Integers = at_least(1);
const FROM_ZERO: Integers = at_least(0);

/// Names of former releases in the tests of renamed keys.
const FORMER_OF_TESTS: &[&str] = if cfg!(test) { &["energy_ledger"] } else { &[] };

table! {
    /// The whole file.
    Raw {
        /// name of the run
        title: Text {
            otherwise: "`\"Plane shear\"`, of a box `\"Periodic box\"`",
        },
        /// seed of every random number
        seed: Whole { range: FROM_ZERO, default: Some(1) },
        /// 2: disks, 3: spheres
        dimension: Whole { range: Integers { from: 2, to: 3 }, default: Some(2) },
    }
    tables {
        material: Material,
        contact: Contact,
        sample: Sample,
        load: Load,
        time: Time,
        pack: Pack,
        shear: Shear,
        output: Output,
        r#box: BoxTable,
        relax: Relax,
        aqs: Aqs,
        newtonian: Newtonian,
        analysis: Analysis,
        bookkeeping: Bookkeeping,
    }
}

table! {
    /// The material of the grains.
    Material "material" {}
    laws: of_laws
}

table! {
    /// The contacts of the grains.
    Contact "contact" {
        /// contact law, see below
        law: Text {
            range: &LAW_NAMES,
            otherwise: "`\"lee-hurley\"`, in 3D `\"hertz\"`",
        },
        /// sliding friction μ_s
        friction: Number { range: NOT_NEGATIVE, what: "mu_s", example: "0.7" },
        /// rolling friction μ_r; 2D only, not with the law mindlin
        rolling_friction: Number { range: NOT_NEGATIVE, default: Some(0.0) },
        /// rolling damping ratio η_r; 2D only, not with the law mindlin
        rolling_damping_ratio: Number { range: BELOW_ONE, default: Some(0.0) },
    }
    laws: of_laws
}

table! {
    /// The grains and their cell.
    Sample "sample" {
        /// number of grains N, those of the walls included
        grains: Whole {
            // Grains are numbered by u32.
            range: Integers { from: 1, to: u32::MAX as i64 },
            what: "the number of grains",
            example: "1000",
        },
        /// least radius R
        radius_min: Number {
            unit: "m",
            range: POSITIVE,
            what: "the least R",
            example: "0.5e-6",
        },
        /// greatest radius R
        radius_max: Number {
            unit: "m",
            range: POSITIVE,
            condition: "≥ `radius_min`",
            what: "the greatest R",
            example: "1e-6",
        },
        /// distribution of R between them; `"binary"` is either of the two
        sizes: Text { range: &Sizes::NAMES, default: Some(Sizes::NAMES[0]) },
        /// mean of the normal distribution before its ends are cut off
        radius_mean: Number {
            unit: "m",
            range: POSITIVE,
            condition: "with `\"normal\"`",
            what: "the mean of the normal distribution before its ends are cut off",
            example: "1.5e-3",
        },
        /// its standard deviation
        radius_deviation: Number {
            unit: "m",
            range: POSITIVE,
            condition: "with `\"normal\"`",
            what: "the standard deviation of the normal distribution",
            example: "0.5e-3",
        },
        /// share of the grains that have `radius_max`
        large_fraction: Number {
            range: UNIT,
            condition: "with `\"binary\"`",
            what: "the share of the grains that have radius_max",
            example: "0.5",
        },
        /// radii, each as likely as the others, instead of `radius_min` and `radius_max`
        radii: Numbers {
            unit: "m",
            range: POSITIVE,
            condition: "one or more, with `\"list\"`",
            what: "the radii, each as likely as the others",
            example: "[1e-3, 1.5e-3]",
        },
        /// L_x, periodic
        length: Number {
            unit: "m",
            range: POSITIVE,
            condition: "≥ 4 diameters of the largest grain",
            what: "L_x",
            example: "48e-6",
        },
        /// L_y, periodic; 3D only
        width: Number {
            unit: "m",
            range: POSITIVE,
            condition: "≥ 4 diameters of the largest grain",
            what: "L_y",
            example: "30e-3",
        },
        /// LAMMPS data file with the grains, instead of insertion
        packing: Text {
            condition: "a path, from the folder of this file",
            otherwise: "none",
        },
        /// copies of the packing beside each other along its periodic axes: `[n_x]`, in 3D
        /// `[n_x, n_y]`
        replicate: Numbers {
            range: Bounds { from: Bound::Included(1.0), to: Bound::Included(1e6) },
            condition: "whole numbers",
            otherwise: "once",
        },
        /// which of its grains are walls, see below
        walls: Text { range: &WALLS_NAMES, otherwise: "see below" },
    }
}

table! {
    /// The load on the top wall.
    Load "load" {
        /// κ = d̄/δ̄, mean diameter over mean overlap; in 2D that is k_n/P
        stiffness_number: Number {
            range: Bounds {
                from: Bound::Included(STIFFNESS_NUMBER_MIN),
                to: Bound::Included(STIFFNESS_NUMBER_MAX),
            },
        },
        /// pressure P
        pressure: Number { unit: "Pa", range: POSITIVE, condition: "κ in its range" },
        /// N = P L_x, in 3D P L_x L_y, on the top wall
        normal_force: Number { unit: "N, in 2D N/m", range: POSITIVE, condition: "κ in its range" },
        /// gravity g, towards the bottom
        gravity: Number { unit: "m/s²", range: NOT_NEGATIVE, default: Some(0.0) },
    }
}

table! {
    /// The time step.
    Time "time" {
        /// Δt
        step: Number { unit: "s", range: POSITIVE, condition: "at most the stability limit" },
        /// Δt is a hundredth of the time for which two of the smallest spheres collide at this
        /// speed; law hertz only
        collision_speed: Number {
            unit: "m/s",
            range: POSITIVE,
            condition: "instead of `step`",
            otherwise: "none",
        },
        /// run with a `step` over the limit
        force: Flag { condition: "with `step` or `collision_speed`", default: Some(false) },
    }
}

table! {
    /// The compression of the sample.
    Pack "pack" {
        /// shear the grains of `sample.packing` as they are
        skip: Flag {
            condition: "true with `sample.packing` only",
            otherwise: "true with `sample.packing`, false without",
        },
        /// μ_s while the sample is compressed; 0 packs densest
        friction: Number { range: NOT_NEGATIVE, default: Some(0.0) },
        /// kinetic energy per grain over P d̄ δ̄ at which the sample is at rest, if the bottom
        /// carries N up to a share √`tolerance` (at least 1e-3)
        tolerance: Number { range: POSITIVE, default: Some(1e-7) },
        /// steps after which packing is given up
        max_steps: Whole { range: FROM_ONE, default: Some(5_000_000) },
    }
}

table! {
    /// The shear.
    Shear "shear" {
        /// I = γ̇ √(m̄/P)
        inertial_number: Number { range: POSITIVE },
        /// V of the top wall
        velocity: Number { unit: "m/s", range: POSITIVE },
        /// total γ
        strain: Number { range: POSITIVE, what: "the total gamma", example: "0.1" },
        /// instead of these three: a list of parts, see below
        protocol: Parts { condition: "one part or more", otherwise: "none" },
        /// k of a spring through which the top wall is pulled; without it the wall moves as the
        /// drive does
        spring_stiffness: Number { unit: "N/m, in 2D Pa", range: POSITIVE, otherwise: "none" },
        /// the same as k d̄/N
        spring_number: Number {
            range: POSITIVE,
            condition: "instead of `spring_stiffness`",
            otherwise: "none",
        },
    }
}

table! {
    /// What is written.
    Output "output" {
        /// Δγ between frames; 0 is never
        frame_strain: Number { range: NOT_NEGATIVE, default: Some(1e-4) },
        /// γ of the first frame, rounded to a multiple of `frame_strain`
        frame_start: Number { range: NOT_NEGATIVE, default: Some(0.0) },
        /// Δγ between rows of the time series; 0 is never
        series_strain: Number { range: NOT_NEGATIVE, default: Some(1e-5) },
        /// Δγ between checkpoints; 0 is only at the end
        checkpoint_strain: Number { range: NOT_NEGATIVE, default: Some(0.02) },
        /// keep every checkpoint of the shear as `checkpoint-<step>.h5`, from step 0 on, for
        /// `gshear-reduce replay`; of a box as `checkpoint-aqs-<step>.h5` and
        /// `checkpoint-newtonian-<step>.h5`
        keep_checkpoints: Flag { default: Some(false) },
        /// with a protocol: frames in each part; 0 is none
        frame_rows: Whole { range: FROM_ZERO, default: Some(0) },
        /// with a protocol: rows of the time series in each part; 0 is none
        series_rows: Whole { range: FROM_ZERO, default: Some(1000) },
        /// lines on the terminal over the whole run
        progress_lines: Whole { range: FROM_ZERO, default: Some(20) },
        /// record the energy budget in the time series
        energy: Flag { default: Some(true), former: FORMER_OF_TESTS },
    }
}

table! {
    /// The periodic box.
    BoxTable "box" {
        /// φ, the grains' volume (area in 2D) over that of the box; with it the scene has no walls
        /// (see below)
        solid_fraction: Number {
            range: Bounds { from: Bound::Excluded(0.3), to: Bound::Excluded(1.2) },
            what: "phi, the grains' volume over that of the box",
            example: "0.7",
        },
    }
}

table! {
    /// How mechanical equilibrium is found in a box.
    Relax "relax" {
        /// `"newton"`: Newton's method with the exact K, and overdamped dynamics if it does not
        /// converge; `"overdamped"`: overdamped dynamics only
        method: Text { range: &METHOD_NAMES, default: Some(METHOD_NAMES[0]) },
        /// greatest net force on a grain at rest, and torque over its radius
        tolerance: Number {
            unit: "force",
            range: POSITIVE,
            what: "the greatest residual of a grain at rest",
            example: "5e-14",
        },
        /// η_0 of overdamped dynamics, -η_0 m v on translations
        drag: Number {
            unit: "1/time",
            range: POSITIVE,
            what: "eta_0 of -eta_0 m v",
            example: "0.022",
        },
        /// steps of overdamped dynamics, for one relaxation
        max_steps: Whole { range: FROM_ONE, default: Some(10_000_000) },
    }
}

table! {
    /// Athermal quasi-static shear of a box.
    Aqs "aqs" {
        /// δγ
        strain_step: Number { range: UNIT, what: "delta gamma", example: "1e-4" },
        /// number of strain steps
        steps: Whole { range: FROM_ZERO, what: "the number of strain steps", example: "100" },
        /// strain steps between frames; 0 is never
        frame_every: Whole { range: FROM_ZERO, default: Some(0) },
        /// find all eigenvalues after every step, and the birth of the first complex pair
        spectrum: Flag { default: Some(false) },
        /// precision of the birth in γ, by bisection
        birth_precision: Number {
            range: POSITIVE,
            condition: "with `spectrum`",
            default: Some(1e-10),
        },
        /// the strain steps end when a complex pair is alone and its imaginary part is this or
        /// more; 0 is never
        until_imaginary: Number {
            range: NOT_NEGATIVE,
            condition: "with `spectrum`",
            default: Some(0.0),
        },
    }
}

table! {
    /// Newton's equations in a box, after the strain steps.
    Newtonian "newtonian" {
        /// duration of the last stage, in 1/ω_i of the pair of the greatest imaginary part (without
        /// one, in 1000 Δt); without `[newtonian]` there is none
        growth_times: Number {
            range: POSITIVE,
            what: "the duration, in times 1/omega_i in which the complex pair grows by e",
            example: "20",
        },
        /// rows of its time series at equal intervals, beside two stretches that resolve the
        /// oscillation; 0 is none
        rows: Whole { range: FROM_ZERO, default: Some(20_000) },
        /// frames of it; 0 is none
        frames: Whole { range: FROM_ZERO, default: Some(200) },
        /// times at which all eigenvalues are written; 0 is none
        spectra: Whole { range: FROM_ZERO, default: Some(0) },
    }
}

table! {
    /// What the run computes of its frames.
    Analysis "analysis" {
        /// compute the scalars of frames during the run (docs/reduction.md), so that frames need
        /// not be written; 2D only
        scalars: Flag { default: Some(false) },
        /// Δγ between these frames
        strain: Number {
            range: POSITIVE,
            condition: "a whole number of `output.series_strain`",
            otherwise: "`output.frame_strain`",
        },
        /// γ of the first of them, rounded to a multiple of `analysis.strain`
        start: Number { range: NOT_NEGATIVE, otherwise: "`output.frame_start`" },
    }
}

table! {
    /// What changes speed, not results.
    Bookkeeping "bookkeeping" {
        /// skin of the neighbour list over d̄; changes speed, not results
        skin: Number { range: UNIT, otherwise: "adapted" },
        /// rebuild the list at least every so many steps; 0 is when needed
        rebuild_every: Whole { range: FROM_ZERO, default: Some(0) },
        /// instruction set of the kernel; changes speed, not results
        simd: Text { range: &SIMD_NAMES, default: Some(SIMD_NAMES[0]) },
    }
}

/// The names of the contact laws.
const LAW_NAMES: [&str; LAWS.len()] = {
    let mut names = [""; LAWS.len()];
    let mut k = 0;
    while k < LAWS.len() {
        names[k] = LAWS[k].name;
        k += 1;
    }
    names
};
const WALLS_NAMES: [&str; Walls::NAMES.len()] = names(&Walls::NAMES);
const METHOD_NAMES: [&str; Method::NAMES.len()] = names(&Method::NAMES);

/// The names of a list of names and values.
const fn names<T: Copy, const N: usize>(of: &[(&'static str, T); N]) -> [&'static str; N] {
    let mut names = [""; N];
    let mut k = 0;
    while k < N {
        names[k] = of[k].0;
        k += 1;
    }
    names
}

/// What the contact laws declare of the keys of a table. A key of several laws comes once, with
/// what each of them says.
pub fn law_entries(table: &str) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    for key in law_keys().filter(|key| key.table() == table) {
        let name = key.name();
        if entries.iter().any(|known| known.name == name) {
            continue;
        }
        let laws: Vec<_> = LAWS
            .iter()
            .filter_map(|kind| {
                let own = kind.keys.iter().find(|own| own.path == key.path)?;
                Some((kind.name, own.unit))
            })
            .collect();
        let mut entry = Declared::from(key).entry();
        if laws.iter().any(|(_, unit)| *unit != key.unit) {
            let units = laws.iter().map(|(law, unit)| format!("{law}: {unit}"));
            entry.unit = units.collect::<Vec<_>>().join("; ");
        }
        let names: Vec<&str> = laws.iter().map(|(law, _)| *law).collect();
        match names[..] {
            [law] => entry.doc += &format!("; law {law} only"),
            _ if names.len() < LAWS.len() => {
                entry.doc += &format!("; laws {}", list(&names, "and"));
            }
            _ => {}
        }
        entries.push(entry);
    }
    entries
}

/// `a, b and c`.
pub fn list(names: &[impl AsRef<str>], and: &str) -> String {
    let names: Vec<&str> = names.iter().map(AsRef::as_ref).collect();
    match names.split_last() {
        Some((last, [])) => (*last).into(),
        Some((last, others)) => format!("{} {and} {last}", others.join(", ")),
        None => String::new(),
    }
}

/// Keys outside every table.
pub static TOP_KEYS: LazyLock<Vec<Entry>> = LazyLock::new(Raw::entries);

/// Every table and its keys.
pub static TABLES: LazyLock<Vec<TableEntry>> = LazyLock::new(Raw::tables);

/// The keys of a table.
pub fn keys_of(table: &str) -> Option<&'static [Entry]> {
    TABLES
        .iter()
        .find(|known| known.name == table)
        .map(|known| &known.keys[..])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each table and each key must be one that serde knows, under the path that is declared.
    #[test]
    fn every_declared_key_is_known_to_serde() {
        let tables = TABLES.iter().flat_map(|table| &table.keys);
        for key in TOP_KEYS.iter().chain(tables) {
            let text = format!("{} = 2000-01-01", key.path);
            let e = toml::from_str::<Raw>(&text).err().expect("not a date");
            assert!(e.message().starts_with("expected"), "{}: {e}", key.path);
        }
        for text in ["nonsense = 1", "sample.nonsense = 1", "contact.density = 1"] {
            let e = toml::from_str::<Raw>(text).err().expect("an unknown key");
            assert!(e.message().starts_with("unknown key"), "{e}");
        }
    }
}
