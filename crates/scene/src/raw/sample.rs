//! The grains: their material, their contacts and their cell.

use std::ops::Bound;

use gshear_dem::laws::keys::{BELOW_ONE, Bounds, NOT_NEGATIVE, POSITIVE, UNIT};

use super::table::{names, table};
use crate::key::Change;
use crate::kind::{Integers, Number, Numbers, Text, Whole};
use crate::law_keys::LAW_NAMES;
use crate::scene::{Placement, Sizes, Walls};

const PLACEMENT_NAMES: [&str; Placement::NAMES.len()] = names(&Placement::NAMES);
const WALLS_NAMES: [&str; Walls::NAMES.len()] = names(&Walls::NAMES);

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
            change: Change::Never,
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
            change: Change::Never,
        },
        /// least radius R
        radius_min: Number {
            unit: "m",
            range: POSITIVE,
            what: "the least R",
            example: "0.5e-6",
            change: Change::Never,
        },
        /// greatest radius R
        radius_max: Number {
            unit: "m",
            range: POSITIVE,
            condition: "≥ `radius_min`",
            what: "the greatest R",
            example: "1e-6",
            change: Change::Never,
        },
        /// distribution of R between them; `"binary"` is either of the two
        sizes: Text {
            range: &Sizes::NAMES,
            default: Some(Sizes::NAMES[0]),
            change: Change::Never,
        },
        /// mean of the normal distribution before its ends are cut off
        radius_mean: Number {
            unit: "m",
            range: POSITIVE,
            condition: "with `\"normal\"`",
            what: "the mean of the normal distribution before its ends are cut off",
            example: "1.5e-3",
            change: Change::Never,
        },
        /// its standard deviation
        radius_deviation: Number {
            unit: "m",
            range: POSITIVE,
            condition: "with `\"normal\"`",
            what: "the standard deviation of the normal distribution",
            example: "0.5e-3",
            change: Change::Never,
        },
        /// share of the grains that have `radius_max`
        large_fraction: Number {
            range: UNIT,
            condition: "with `\"binary\"`",
            what: "the share of the grains that have radius_max",
            example: "0.5",
            change: Change::Never,
        },
        /// radii, each as likely as the others, instead of `radius_min` and `radius_max`
        radii: Numbers {
            unit: "m",
            range: POSITIVE,
            condition: "one or more, with `\"list\"`",
            what: "the radii, each as likely as the others",
            example: "[1e-3, 1.5e-3]",
            change: Change::Never,
        },
        /// where the grains of a box begin (see below)
        placement: Text {
            range: &PLACEMENT_NAMES,
            condition: "with `[box]`",
            default: Some(PLACEMENT_NAMES[0]),
            change: Change::Never,
        },
        /// L_x, periodic
        length: Number {
            unit: "m",
            range: POSITIVE,
            condition: "≥ 4 diameters of the largest grain",
            what: "L_x",
            example: "48e-6",
            change: Change::Never,
        },
        /// L_y, periodic; 3D only
        width: Number {
            unit: "m",
            range: POSITIVE,
            condition: "≥ 4 diameters of the largest grain",
            what: "L_y",
            example: "30e-3",
            change: Change::Never,
        },
        /// LAMMPS data file with the grains, instead of insertion
        packing: Text {
            condition: "a path, from the folder of this file",
            otherwise: "none",
            change: Change::Never,
        },
        /// copies of the packing beside each other along its periodic axes: `[n_x]`, in 3D
        /// `[n_x, n_y]`
        replicate: Numbers {
            range: Bounds { from: Bound::Included(1.0), to: Bound::Included(1e6) },
            condition: "whole numbers",
            otherwise: "once",
            change: Change::Never,
        },
        /// which of its grains are walls, see below
        walls: Text {
            range: &WALLS_NAMES,
            otherwise: "see below",
            change: Change::Never,
        },
        /// thickness of each wall over d̄: 2 makes walls of two layers; more if R_max > 2 R_min, see below
        wall_thickness: Number {
            range: Bounds { from: Bound::Included(0.5), to: Bound::Included(1e6) },
            // Of runs from before wide sizes had thicker walls, too.
            default: Some(1.0),
            change: Change::Never,
        },
    }
}
