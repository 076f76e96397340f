//! The keys of `[sample]`, and what the names among their values mean.

use std::ops::Bound;

use gshear_dem::boundary::{KEYS, WALLS_KEYS};
use gshear_dem::laws::keys::{Bounds, Integers, POSITIVE, SHARE, UNIT};

use crate::table::{from_to, names, table};

const SIZES_NAMES: [&str; Distribution::NAMES.len()] = names(&Distribution::NAMES);
const PLACEMENT_NAMES: [&str; Placement::NAMES.len()] = names(&Placement::NAMES);
/// Whether a grain that passes a wall is removed.
pub(crate) const OUTSIDE: [(&str, bool); 2] = [("end", false), ("remove", true)];
const OUTSIDE_NAMES: [&str; OUTSIDE.len()] = names(&OUTSIDE);

/// Whether a grading curve is of the mass or of the number of grains.
const PASSING_NAMES: [&str; 2] = ["mass", "number"];
/// Whether a share is of the number of grains, or of their volume (area in 2D).
const SHARE_NAMES: [&str; 2] = ["number", "volume"];
/// Exponents of a power law of sizes.
const EXPONENT: Bounds = from_to(-10.0, 10.0);
/// Copies of a packing.
const COPIES: Bounds = from_to(1.0, 1e6);
/// Mean diameters. The default is that of runs from before wide sizes had thicker walls, too.
const LAYERS: Bounds = from_to(0.5, 1e6);

table! {
    /// The grains and their cell.
    SAMPLE: SampleKeys "sample" All Never {
        /// number of grains N, those of the walls included
        grains: Whole(Integers { from: 1, to: u32::MAX as i64 }) {
            what: "the number of grains",
            example: "1000",
        },
        /// least radius R
        radius_min: Number(POSITIVE) { unit: "m", what: "the least R", example: "0.5e-6" },
        /// greatest radius R
        radius_max: Number(POSITIVE) {
            unit: "m",
            condition: "≥ `radius_min`",
            what: "the greatest R",
            example: "1e-6",
        },
        /// distribution of R between them; `"binary"` is either of the two
        sizes: Text(&SIZES_NAMES) { default: SIZES_NAMES[0] },
        /// mean of R of the distribution before its ends are cut off
        radius_mean: Number(POSITIVE) {
            unit: "m",
            condition: "with `\"normal\"` and `\"lognormal\"`",
            what: "the mean of R of the distribution before its ends are cut off",
            example: "1.5e-3",
        },
        /// its standard deviation
        radius_deviation: Number(POSITIVE) {
            unit: "m",
            condition: "with `\"normal\"` and `\"lognormal\"`",
            what: "the standard deviation of R of the distribution before its ends are cut off",
            example: "0.5e-3",
        },
        /// α of a number of grains per radius of R^-α
        radius_exponent: Number(EXPONENT) {
            condition: "with `\"power\"`",
            what: "α of a number of grains per radius of R^-α",
            example: "2.5",
        },
        /// mesh widths of a grading curve: diameters, instead of `radius_min` and `radius_max`
        sieves: Numbers(POSITIVE) {
            unit: "m",
            condition: "two or more, ascending, with `\"table\"`",
            what: "the mesh widths of a grading curve (diameters)",
            example: "[0.5e-3, 1e-3, 2e-3]",
        },
        /// share that passes each sieve; straight lines over the logarithm of the width between
        passing: Numbers(SHARE) {
            condition: "0 … 1, ascending, with `\"table\"`",
            what: "the share that passes each of sample.sieves",
            example: "[0.0, 0.4, 1.0]",
        },
        /// what the shares are of
        passing_by: Text(&PASSING_NAMES) {
            condition: "with `\"table\"`",
            default: PASSING_NAMES[0],
        },
        /// share of the grains that have `radius_max`
        large_fraction: Number(UNIT) {
            condition: "with `\"binary\"`",
            what: "the share of the grains that have radius_max",
            example: "0.5",
        },
        /// what that share is of
        large_fraction_by: Text(&SHARE_NAMES) {
            condition: "with `\"binary\"`",
            default: SHARE_NAMES[0],
        },
        /// material of the grains that have `radius_max`
        large_material: Text(&[]) {
            condition: "with `\"binary\"` and several materials",
            otherwise: "as `material.fraction` says",
        },
        /// radii instead of `radius_min` and `radius_max`: those that grains may have, or with
        /// `"given"` that of every grain, each used exactly once in an order drawn from the seed
        radii: Numbers(POSITIVE) {
            unit: "m",
            condition: "one or more, with `\"list\"` and `\"given\"`",
            what: "the radii",
            example: "[1e-3, 1.5e-3]",
        },
        /// how often each of `radii` is drawn: shares of the grains by number, over their sum
        radii_weights: Numbers(POSITIVE) {
            condition: "one for each of `radii`, with `\"list\"`",
            otherwise: "each as likely as the others",
            what: "a weight of each of sample.radii",
            example: "[2.0, 1.0]",
        },
        /// φ, the grains' volume over that of the cell, in which they come to rest without
        /// friction; where strain steps come first, instead of a load
        solid_fraction: Number(Bounds { from: Bound::Excluded(0.3), to: Bound::Excluded(1.2) }) {
            condition: "with `\"periodic\"`; without `packing`",
            what: "phi, the grains' volume over that of the cell",
            example: "0.7",
        },
        /// ratios of the lengths of such a cell: `[L_x, L_y, L_z]`, in 2D `[L_x, L_y]`
        aspect: Numbers(POSITIVE) {
            condition: "with `solid_fraction`",
            otherwise: "a cube (in 2D a square)",
            what: "the ratios of the lengths of the cell",
            example: "[2.0, 1.0]",
        },
        /// where the grains of such a cell begin
        placement: Text(&PLACEMENT_NAMES) {
            condition: "with `solid_fraction`",
            default: PLACEMENT_NAMES[0],
        },
        /// L_x, periodic
        length: Number(POSITIVE) {
            unit: "m",
            condition: "≥ 4 diameters of the largest grain",
            what: "L_x",
            example: "48e-6",
        },
        /// L_y, periodic; 3D only
        width: Number(POSITIVE) {
            unit: "m",
            condition: "≥ 4 diameters of the largest grain",
            what: "L_y",
            example: "30e-3",
        },
        /// file with the grains, instead of insertion: LAMMPS data or dump, a list, or a run
        packing: Text(&[]) { condition: "a path, from the folder of this file", otherwise: "none" },
        /// file with the contacts of the packing and their histories, as `gshear-reduce export
        /// --contacts` writes it; without it contacts begin without history
        contacts: Text(&[]) {
            condition: "a path, with `packing`; without `pack.skip = false` and `replicate`",
            otherwise: "none",
        },
        /// copies of the packing beside each other along its periodic axes: `[n_x]`, in 3D
        /// `[n_x, n_y]`; in a cell that is periodic along its last axis, too, one more
        replicate: Numbers(COPIES) { condition: "whole numbers", otherwise: "once" },
        /// what bounds the sample below and above: walls of its grains; its own images, which
        /// move as a top wall does (Lees and Edwards); `"free"`, a wall below and nothing above
        boundary: Text(&KEYS) { default: KEYS[0] },
        /// what its walls are: its grains near the edges; those of the types 2 and 3 of a packing;
        /// planes, `"flat"`; or such grains below and a plane above, `"flat-top"`
        walls: Text(&WALLS_KEYS) {
            otherwise: "`\"types\"` if a packing has the types 1, 2 and 3, below a free surface 1 and 2, else `\"layers\"`",
        },
        /// material of the walls
        wall_material: Text(&[]) {
            condition: "with several materials",
            otherwise: "those of their grains",
        },
        /// what happens to a grain that passes a wall: it ends the run, or is removed
        outside: Text(&OUTSIDE_NAMES) { default: OUTSIDE_NAMES[0] },
        /// thickness of each wall over d̄: 2 makes walls of two layers; more if R_max > 2 R_min
        wall_thickness: Number(LAYERS) { default: "1.0" },
    }
}

/// The distributions of the radii of inserted grains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Distribution {
    Uniform,
    Normal,
    Lognormal,
    /// A power law.
    Power,
    /// A grading curve.
    Table,
    Binary,
    List,
    /// The radius of every grain.
    Given,
}

impl Distribution {
    /// The names, as `sample.sizes` has them.
    pub(crate) const NAMES: [(&str, Distribution); 8] = [
        ("uniform", Distribution::Uniform),
        ("normal", Distribution::Normal),
        ("lognormal", Distribution::Lognormal),
        ("power", Distribution::Power),
        ("table", Distribution::Table),
        ("binary", Distribution::Binary),
        ("list", Distribution::List),
        ("given", Distribution::Given),
    ];
}

/// Which grains of a sample are its walls, where these are of grains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Walls {
    /// The grains whose centre is within the thickness of a wall of the lowest and of the highest
    /// edge.
    Layers,
    /// Those of a packing of type 2 are the bottom, of type 3 the top.
    Types,
}

impl Walls {
    /// The names, as `sample.walls` has them.
    pub const NAMES: [(&str, Walls); 2] = [("layers", Walls::Layers), ("types", Walls::Types)];
}

/// Where the grains of a cell of a given solid fraction begin, before it is brought to rest without
/// friction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Placement {
    /// On a loose lattice, jittered, in a larger box that is compressed step by step.
    Lattice,
    /// Anywhere in the box itself, each place as likely as the others.
    Random,
}

impl Placement {
    /// The names, as `sample.placement` has them.
    pub const NAMES: [(&str, Placement); 2] = [
        ("lattice", Placement::Lattice),
        ("random", Placement::Random),
    ];
}
