//! Plane shear between walls: load, compression, shear, and what is computed of its frames.

use std::ops::Bound;

use gshear_dem::laws::keys::{Bounds, NOT_NEGATIVE, POSITIVE};

use super::table::{FROM_ONE, names, table};
use crate::derived::{STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use crate::key::Change;
use crate::kind::{Flag, Number, Parts, Text, Whole};
use crate::scene::Control;

const CONTROL_NAMES: [&str; Control::NAMES.len()] = names(&Control::NAMES);

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
        /// gravity g on the free grains, towards the bottom; see below for τ, P and κ
        gravity: Number { unit: "m/s²", range: NOT_NEGATIVE, default: Some(0.0) },
        /// what moves the top wall along its normal: `"mass"`, the load on the mass of its grains;
        /// `"servo"`, in every step a velocity from the error of the pressure
        control: Text { range: &CONTROL_NAMES, default: Some(CONTROL_NAMES[0]) },
        /// of a servo: velocity over error of the pressure
        servo_gain: Number {
            unit: "m/(s Pa)",
            range: POSITIVE,
            condition: "at most its bound, with `\"servo\"`",
            otherwise: "see below",
        },
        /// of a servo: greatest speed
        servo_speed_max: Number {
            unit: "m/s",
            range: POSITIVE,
            condition: "with `\"servo\"`",
            otherwise: "`servo_gain` times P",
        },
    }
}

table! {
    /// The compression of the sample.
    Pack "pack" {
        /// shear the grains of `sample.packing` as they are
        skip: Flag {
            condition: "true with `sample.packing` only",
            otherwise: "true with `sample.packing`, false without",
            change: Change::Never,
        },
        /// μ_s while the sample is compressed; 0 packs densest
        friction: Number { range: NOT_NEGATIVE, default: Some(0.0) },
        /// drag on grains and planes once the bottom carries the load, over the inverse of
        /// √(m̄/P), in 3D of √(m̄/(P d̄)); 0.25 to 0.6 comes to rest in fewer steps
        drag: Number { range: POSITIVE, default: Some(1.0) },
        /// kinetic energy per grain over P d̄ δ̄ at which the sample is at rest, if the bottom
        /// carries N and the weight up to a share √`tolerance` (at least 1e-3)
        tolerance: Number { range: POSITIVE, default: Some(1e-7) },
        /// steps after which packing is given up; if it is not given, ten times the number that
        /// `--check` expects where that is more
        max_steps: Whole {
            range: FROM_ONE,
            default: Some(5_000_000),
            change: Change::Resume,
        },
    }
}

table! {
    /// The shear.
    Shear "shear" {
        /// inertial number I = γ̇ √(m̄/P) with m̄ per depth, in 3D γ̇ d̄ √(ρ/P)
        inertial_number: Number { range: POSITIVE },
        /// V of the top wall
        velocity: Number { unit: "m/s", range: POSITIVE },
        /// total γ
        strain: Number {
            range: POSITIVE,
            what: "the total gamma",
            example: "0.1",
            change: Change::End,
        },
        /// instead of these three: a list of parts, see below
        protocol: Parts {
            condition: "one part or more",
            otherwise: "none",
            change: Change::End,
        },
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
    /// What the run computes of its frames.
    Analysis "analysis" {
        /// compute the scalars of frames during the run (docs/reduction.md), so that frames need
        /// not be written; 2D only
        scalars: Flag { default: Some(false), change: Change::Resume },
        /// Δγ between these frames
        strain: Number {
            range: POSITIVE,
            condition: "a whole number of `output.series_strain`",
            otherwise: "`output.frame_strain`",
            change: Change::Resume,
        },
        /// γ of the first of them, rounded to a multiple of `analysis.strain`
        start: Number {
            range: NOT_NEGATIVE,
            otherwise: "`output.frame_start`",
            change: Change::Resume,
        },
    }
}
