//! The keys above all tables, and `[bookkeeping]`.

use gshear_dem::laws::keys::{
    Change, FROM_ONE, FROM_ZERO, Integers, KeyReader, NOT_NEGATIVE, UNIT,
};
use gshear_dem::simd::Isa;
use gshear_dem::system::{ListSettings, SweepSettings};

use crate::checker::Checker;
use crate::observable_keys::ObservableKeys;
use crate::table::table;

table! {
    /// The whole file.
    SCENE: SceneKeys Never {
        /// name of the run
        title: Text(&[]) {
            otherwise: "`\"Plane shear\"`, without `[shear]` `\"Periodic box\"`",
            change: Change::Resume,
        },
        /// who made the run, as the HDF5 files name the author
        author: Text(&[]) {
            otherwise: "`user.name` of git, or the account",
            change: Change::Resume,
        },
        /// seed of every random number
        seed: Whole(FROM_ZERO) { default: "1" },
        /// 2: disks, 3: spheres
        dimension: Whole(Integers { from: 2, to: 3 }) { default: "2" },
        /// the order in which the stages run, where a scene both shears (`"shear"`) and strains
        /// quasi-statically (`"aqs"`, and `"newtonian"` after it)
        stages: Names {
            condition: "the tables that are there",
            otherwise: "`[\"shear\", \"aqs\", \"newtonian\"]`",
        },
        /// columns of your own in the time series of a shear, each as `[[observable]]`; they begin
        /// with a file, so at a resume they change only in another folder (`--out`)
        observable: Tables(|| ObservableKeys::TABLE.keys()) {
            condition: "with `[shear]`",
            otherwise: "none",
            change: Change::Resume,
        },
    }
}

table! {
    /// What changes speed, not results.
    BOOKKEEPING: BookkeepingKeys "bookkeeping" All Resume {
        /// skin of the neighbour list over d̄; changes speed, not results
        skin: Number(UNIT) { otherwise: "adapted" },
        /// rebuild the list at least every so many steps; 0 is when needed
        rebuild_every: Whole(FROM_ZERO) { default: "0" },
        /// grains of a band, a layer along the last axis; changes speed, not results
        band_grains: Whole(FROM_ONE) { otherwise: "by the cache" },
        /// steps that follow each other through the bands, at most; changes speed, not results
        steps_at_once: Whole(FROM_ONE) { default: "8" },
        /// instruction set of the kernel; changes speed, not results
        simd: Text(&SIMD_NAMES) { default: SIMD_NAMES[0] },
        /// a run ends if a rank has not answered for so long; 0 is never
        watchdog: Number(NOT_NEGATIVE) { unit: "s", default: "600.0" },
    }
}

/// What changes speed, not results.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bookkeeping {
    /// Skin and rebuilds of the neighbour list.
    pub list: ListSettings,
    /// Bands, and steps through them.
    pub sweep: SweepSettings,
    /// Instruction set of the kernel: one of `SIMD_NAMES`.
    pub simd: &'static str,
    /// Time after which a rank that does not answer ends the run (s); 0 is never.
    pub watchdog: f64,
}

/// The instruction sets that may be asked for; `auto` is the best that the processor has.
pub const SIMD_NAMES: [&str; 4] = ["auto", "avx512", "avx2", "portable"];

pub(crate) fn check_bookkeeping(c: &mut Checker<'_>) -> Bookkeeping {
    let keys = &BOOKKEEPING;
    let skin = c.number(&keys.skin);
    let rebuild_every = c.count(&keys.rebuild_every);
    let sweep = SweepSettings {
        band: c
            .whole(&keys.band_grains)
            .map(|n| n.unsigned_abs() as usize),
        steps: c.count(&keys.steps_at_once),
    };
    let simd = c.choice(&keys.simd);
    let watchdog = c.number_or_default(&keys.watchdog);
    if let Some(name) = simd.filter(|name| Isa::named(name).is_none()) {
        let what =
            format!("this processor has no {name}; give \"auto\", which takes the best it has");
        c.refuse(&keys.simd, &what);
    }
    Bookkeeping {
        list: ListSettings {
            skin,
            rebuild_every,
        },
        sweep,
        simd: simd.unwrap_or("auto"),
        watchdog,
    }
}
