//! The periodic box: its size, mechanical equilibrium, strain steps, and Newton's equations.

use std::ops::Bound;

use gshear_dem::laws::keys::{Bounds, NOT_NEGATIVE, POSITIVE, UNIT};

use super::table::{FROM_ONE, FROM_ZERO, names, table};
use crate::key::Change;
use crate::kind::{Flag, Number, Numbers, Text, Whole};
use crate::scene::{Deformation, Method};

const METHOD_NAMES: [&str; Method::NAMES.len()] = names(&Method::NAMES);
const DEFORMATION_NAMES: [&str; Deformation::NAMES.len()] = names(&Deformation::NAMES);

table! {
    /// The periodic box.
    BoxTable "box" {
        /// φ, the grains' volume (area in 2D) over that of the box; with it the scene has no walls
        /// (see below)
        solid_fraction: Number {
            range: Bounds { from: Bound::Excluded(0.3), to: Bound::Excluded(1.2) },
            what: "phi, the grains' volume over that of the box",
            example: "0.7",
            change: Change::Never,
        },
        /// what a strain step does to the box (see below)
        deformation: Text {
            range: &DEFORMATION_NAMES,
            default: Some(DEFORMATION_NAMES[0]),
            change: Change::Never,
        },
        /// the packing is compressed or expanded to this pressure, with the scene's friction, before
        /// the first strain step; with `"biaxial"` the lateral stress, too
        pressure: Number {
            unit: "pressure",
            range: POSITIVE,
            otherwise: "that of the solid fraction; required with `\"biaxial\"`",
            what: "the lateral stress",
            example: "1e-3",
            change: Change::Never,
        },
        /// greatest relative error of these pressures, and of `aqs.pressures`
        pressure_tolerance: Number {
            range: Bounds { from: Bound::Excluded(0.0), to: Bound::Excluded(1.0) },
            default: Some(1e-4),
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
        max_steps: Whole {
            range: FROM_ONE,
            default: Some(10_000_000),
            change: Change::Resume,
        },
    }
}

table! {
    /// Athermal quasi-static deformation of a box.
    Aqs "aqs" {
        /// δγ, or δε of a biaxial box; of a box at a pressure also the greatest relative change of
        /// a length between two relaxations
        strain_step: Number { range: UNIT, what: "delta gamma", example: "1e-4" },
        /// number of strain steps
        steps: Whole {
            range: FROM_ZERO,
            condition: "not with `\"compression\"`",
            otherwise: "number of `pressures`",
            what: "the number of strain steps",
            example: "100",
            change: Change::End,
        },
        /// pressures that the strain steps of a compression reach, one after the other, up or down
        pressures: Numbers {
            unit: "pressure",
            range: POSITIVE,
            condition: "each, one or more, with `\"compression\"`",
            what: "the pressures that the packing is to reach",
            example: "[1e-4, 1e-3]",
        },
        /// strain steps between frames; 0 is never
        frame_every: Whole { range: FROM_ZERO, default: Some(0), change: Change::Resume },
        /// find all eigenvalues after every step, and the birth of the first complex pair; simple
        /// shear only
        spectrum: Flag { default: Some(false) },
        /// precision of the birth in γ, by bisection
        birth_precision: Number {
            range: POSITIVE,
            condition: "with `spectrum`",
            default: Some(1e-10),
            change: Change::Resume,
        },
        /// the strain steps end when a complex pair is alone and its imaginary part is this or
        /// more; 0 is never
        until_imaginary: Number {
            range: NOT_NEGATIVE,
            condition: "with `spectrum`",
            default: Some(0.0),
            change: Change::End,
        },
    }
}

table! {
    /// Newton's equations in a box, after the strain steps.
    Newtonian "newtonian" {
        /// duration of the last stage, in 1/ω_i of the complex pair that grows fastest (without one,
        /// in 1000 Δt); without `[newtonian]` there is none
        growth_times: Number {
            range: POSITIVE,
            what: "the duration, in times 1/omega_i in which the complex pair grows by e",
            example: "20",
            change: Change::End,
        },
        /// rows of its time series at equal intervals, beside two stretches that resolve the
        /// oscillation; 0 is none
        rows: Whole { range: FROM_ZERO, default: Some(20_000), change: Change::Resume },
        /// frames of it; 0 is none
        frames: Whole { range: FROM_ZERO, default: Some(200), change: Change::Resume },
        /// times at which all eigenvalues are written; 0 is none
        spectra: Whole { range: FROM_ZERO, default: Some(0), change: Change::Resume },
    }
}
