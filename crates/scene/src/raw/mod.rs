//! The configuration as it is written: the declaration of every table and key, and the values that
//! were given. Types are checked, nothing else.

pub(crate) mod part;
mod periodic;
mod sample;
mod table;
mod walls;

use std::sync::LazyLock;

use gshear_dem::laws::keys::{NOT_NEGATIVE, POSITIVE, UNIT};

use crate::key::{Change, Entry};
use crate::kind::{Flag, Integers, Number, Text, Whole};
use crate::scene::SIMD_NAMES;
pub use periodic::{Aqs, BoxTable, Newtonian, Relax};
pub use sample::{Contact, Material, Sample};
use table::{FROM_ZERO, table};
pub use table::{KeyTable, TableEntry};
pub use walls::{Analysis, Load, Pack, Shear};

table! {
    /// The whole file.
    Raw {
        /// name of the run
        title: Text {
            otherwise: "`\"Plane shear\"`, of a box `\"Periodic box\"`",
            change: Change::Resume,
        },
        /// who made the run, as the HDF5 files name the author
        author: Text { otherwise: "`user.name` of git, or the account", change: Change::Resume },
        /// seed of every random number
        seed: Whole { range: FROM_ZERO, default: Some(1), change: Change::Never },
        /// 2: disks, 3: spheres
        dimension: Whole {
            range: Integers { from: 2, to: 3 },
            default: Some(2),
            change: Change::Never,
        },
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
        force: Flag {
            condition: "with `step` or `collision_speed`",
            default: Some(false),
            change: Change::Resume,
        },
    }
}

table! {
    /// What is written.
    Output "output" {
        /// Δγ between frames; 0 is never
        frame_strain: Number {
            range: NOT_NEGATIVE,
            default: Some(1e-4),
            change: Change::Resume,
        },
        /// γ of the first frame, rounded to a multiple of `frame_strain`
        frame_start: Number {
            range: NOT_NEGATIVE,
            default: Some(0.0),
            change: Change::Resume,
        },
        /// Δγ between rows of the time series; 0 is never
        series_strain: Number {
            range: NOT_NEGATIVE,
            default: Some(1e-5),
            change: Change::Resume,
        },
        /// Δγ between checkpoints; 0 is only at the end
        checkpoint_strain: Number {
            range: NOT_NEGATIVE,
            default: Some(0.02),
            change: Change::Resume,
        },
        /// keep every checkpoint of the shear as `checkpoint-<step>.h5`, from step 0 on, for
        /// `gshear-reduce replay`; of a box as `checkpoint-aqs-<step>.h5` and
        /// `checkpoint-newtonian-<step>.h5`
        keep_checkpoints: Flag { default: Some(false), change: Change::Resume },
        /// with a protocol: frames in each part; 0 is none
        frame_rows: Whole { range: FROM_ZERO, default: Some(0), change: Change::Resume },
        /// with a protocol: rows of the time series in each part; 0 is none
        series_rows: Whole {
            range: FROM_ZERO,
            default: Some(1000),
            change: Change::Resume,
        },
        /// lines of progress over the whole run; a terminal has one that is drawn anew
        progress_lines: Whole {
            range: FROM_ZERO,
            default: Some(20),
            change: Change::Resume,
        },
        /// record the energy budget in the time series
        energy: Flag {
            default: Some(true),
            change: Change::Resume,
        },
    }
}

table! {
    /// What changes speed, not results.
    Bookkeeping "bookkeeping" {
        /// skin of the neighbour list over d̄; changes speed, not results
        skin: Number { range: UNIT, otherwise: "adapted", change: Change::Resume },
        /// rebuild the list at least every so many steps; 0 is when needed
        rebuild_every: Whole {
            range: FROM_ZERO,
            default: Some(0),
            change: Change::Resume,
        },
        /// instruction set of the kernel; changes speed, not results
        simd: Text {
            range: &SIMD_NAMES,
            default: Some(SIMD_NAMES[0]),
            change: Change::Resume,
        },
        /// a run ends if a rank has not answered for so long; 0 is never
        watchdog: Number {
            unit: "s",
            range: NOT_NEGATIVE,
            default: Some(600.0),
            change: Change::Resume,
        },
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
