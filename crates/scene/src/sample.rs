//! The sample: `[sample]`, and the file it may come from.

use std::path::{Path, PathBuf};

use gshear_dem::contact::{portable_exp, portable_ln};
use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::laws::keys::{Bounds, Integers, Key, KeyReader, POSITIVE, SHARE, UNIT, Values};
use gshear_dem::state::{Confinement, Ids};
use serde::{Deserialize, Serialize};

use crate::checker::Checker;
use crate::derived;
use crate::grains::{Sample, SizeClass, Sizes};
use crate::insertion::volume_in_box;
use crate::table::{from_to, names, table};
use crate::value::Value;
use crate::words::{quoted_list, show};

const PLACEMENT_NAMES: [&str; Placement::NAMES.len()] = names(&Placement::NAMES);
/// The names of what bounds the sample, as `sample.boundary` has them.
const CONFINEMENTS: [(&str, Confinement); 3] = [
    ("walls", Confinement::Walls),
    ("periodic", Confinement::Images),
    ("free", Confinement::FreeSurface),
];
const BOUNDARY_NAMES: [&str; CONFINEMENTS.len()] = names(&CONFINEMENTS);
/// Whether a grain that passes a wall is removed.
const OUTSIDE: [(&str, bool); 2] = [("end", false), ("remove", true)];
const OUTSIDE_NAMES: [&str; OUTSIDE.len()] = names(&OUTSIDE);
const WALLS_NAMES: [&str; Walls::NAMES.len()] = names(&Walls::NAMES);

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
        sizes: Text(&Sizes::NAMES) { default: Sizes::NAMES[0] },
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
        /// radii, each as likely as the others, instead of `radius_min` and `radius_max`
        radii: Numbers(POSITIVE) {
            unit: "m",
            condition: "one or more, with `\"list\"`",
            what: "the radii, each as likely as the others",
            example: "[1e-3, 1.5e-3]",
        },
        /// where the grains of a box begin
        placement: Text(&PLACEMENT_NAMES) {
            condition: "with `[box]`",
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
        /// copies of the packing beside each other along its periodic axes: `[n_x]`, in 3D
        /// `[n_x, n_y]`; in a box one more
        replicate: Numbers(COPIES) { condition: "whole numbers", otherwise: "once" },
        /// what bounds the sample below and above: walls of its grains; its own images, which
        /// move as a top wall does (Lees and Edwards); `"free"`, a wall below and nothing above
        boundary: Text(&BOUNDARY_NAMES) { default: BOUNDARY_NAMES[0] },
        /// what its walls are: its grains near the edges; those of the types 2 and 3 of a packing;
        /// or planes, `"flat"`
        walls: Text(&WALLS_NAMES) {
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

/// Returns what a scene must know of the file of a packing. The file may have been read before, or
/// by another rank.
pub type ReadPacking<'a> = &'a mut dyn FnMut(&Path, Arrangement) -> Result<PackingFile>;

/// How a scene takes a packing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrangement {
    /// Copies along the axes that are set beside each other.
    pub copies: [u32; 3],
    /// Whether the cell is periodic along its last axis, too.
    pub boxed: bool,
    /// Whether planes bound it there, those of the file's box.
    pub flat: bool,
}

impl Arrangement {
    /// Once, between walls.
    pub const BETWEEN_WALLS: Self = Self {
        copies: [1; 3],
        boxed: false,
        flat: false,
    };
}

/// Where the grains come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Origin {
    /// They are inserted on a lattice.
    Insertion(Sizes),
    /// A file has them, and this is in it.
    Packing(PackingFile),
}

impl Origin {
    /// The file of the packing, if the grains come from one.
    pub fn file(&self) -> Option<&PackingFile> {
        match self {
            Origin::Insertion(_) => None,
            Origin::Packing(file) => Some(file),
        }
    }
}

/// What a scene needs to know of the file of a packing. A checkpoint holds it, so that going on
/// does not need the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PackingFile {
    /// The path, absolute.
    pub path: PathBuf,
    /// Copies along the axes that are set beside each other; what follows is of all of them.
    #[serde(default)]
    pub replicate: Vec<u32>,
    /// Number of grains.
    pub grains: u32,
    /// Least R (m).
    pub radius_min: f64,
    /// Greatest R (m).
    pub radius_max: f64,
    /// d̄ (m).
    pub mean_diameter: f64,
    /// π⟨R²⟩ (m²) in 2D, (4/3)π⟨R³⟩ (m³) in 3D.
    pub mean_volume: f64,
    /// L_x (m).
    pub length: f64,
    /// L_y (m); `None` in 2D.
    pub width: Option<f64>,
    /// L (m) along the last axis of a periodic box, and its Lees–Edwards offset (m).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub boxed: Option<[f64; 2]>,
    /// Velocity along x of the image above in that box (m/s).
    #[serde(default)]
    pub stream: f64,
    /// Coordinates of the lowest and of the highest edge of a grain, along the last axis (m); those
    /// of the file's box for flat walls.
    pub edges: [f64; 2],
    /// Greatest coordinate of a grain or of its box in the file, in magnitude (m); 0 in checkpoints
    /// of versions without it.
    #[serde(default)]
    pub farthest: f64,
    /// Whether its types are 1, 2 and 3, all three, so that 2 and 3 can be walls.
    pub wall_types: bool,
    /// Whether its types are 1 and 2, both, so that 2 can be the bottom of a free surface.
    #[serde(default)]
    pub bottom_type: bool,
    /// Hash of the file's bytes; empty in checkpoints of versions without it.
    #[serde(default)]
    pub content: String,
    /// Those of the file and its copies, less one.
    #[serde(default)]
    pub ids: Ids,
}

impl PackingFile {
    /// H (m) with its walls; of a box its length along the last axis.
    pub fn height(&self) -> f64 {
        let between = self.edges[1] - self.edges[0];
        self.boxed.map_or(between, |[height, _]| height)
    }
}

/// What the walls of a sample are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Walls {
    /// The grains whose centre is within the thickness of a wall of the lowest and of the highest
    /// edge.
    Layers,
    /// Those of a packing of type 2 are the bottom, of type 3 the top.
    Types,
    /// Rigid planes, which no grain belongs to.
    Flat,
}

impl Walls {
    /// The names, as `sample.walls` has them.
    pub const NAMES: [(&str, Walls); 3] = [
        ("layers", Walls::Layers),
        ("types", Walls::Types),
        ("flat", Walls::Flat),
    ];
}

/// Where the grains of a box begin, before it is brought to rest without friction.
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

/// Least standard deviation of radii, over the width of their interval.
const NARROWEST: f64 = 0.01;

/// Least share of random radii in their interval that the normal distribution takes. The others are
/// drawn anew.
const LEAST_TAKEN: f64 = 1e-3;

/// The grains of a scene, as the keys say by themselves.
pub(crate) enum Grains {
    Inserted(Sizes),
    File(Arrangement),
}

/// Checks each key of a scene between walls by itself.
pub(crate) fn check(c: &mut Checker<'_>) -> Grains {
    let keys = &SAMPLE;
    let periodic = confinement(c) == Confinement::Images;
    let arrangement = arrangement(c, periodic);
    if periodic {
        let why = "is of walls, but sample.boundary = \"periodic\"";
        c.all_useless(&OF_WALLS, why);
    }
    c.choice(&keys.walls);
    c.number(&keys.wall_thickness);
    if is_flat(c) {
        let why = "is of walls of grains, but sample.walls = \"flat\"";
        c.useless(&keys.wall_thickness, why);
    }
    if c.dimension == Dimensions::Two {
        let why = "is L_y (m) of three dimensions, and dimension = 2";
        c.useless(&keys.width, why);
    }
    let why = "applies to the grains of a [box]; between walls they fall from above";
    c.useless(&keys.placement, why);
    if c.is_given(&keys.packing) {
        check_filed(c);
        return Grains::File(arrangement);
    }
    if c.is_given(&keys.walls) && !periodic && !is_flat(c) {
        let what = "there is no packing to find walls in; give sample.packing, or leave it out";
        c.refuse(&keys.walls, what);
    }
    check_inserted(c);
    c.required(&keys.length);
    if c.dimension == Dimensions::Three {
        c.required(&keys.width);
    }
    Grains::Inserted(check_sizes(c))
}

/// Whether the walls are planes.
pub(crate) fn is_flat(c: &mut Checker<'_>) -> bool {
    c.named(&SAMPLE.walls, &Walls::NAMES) == Some(Walls::Flat)
}

/// Whether grains that pass a wall are removed.
pub(crate) fn removes(c: &mut Checker<'_>) -> bool {
    c.named(&SAMPLE.outside, &OUTSIDE) == Some(true)
}

/// What bounds the sample below and above.
pub(crate) fn confinement(c: &mut Checker<'_>) -> Confinement {
    let given = c.named(&SAMPLE.boundary, &CONFINEMENTS);
    given.unwrap_or(Confinement::Walls)
}

/// The keys of walls.
static OF_WALLS: [&Key; 4] = [
    &SAMPLE.walls,
    &SAMPLE.wall_thickness,
    &SAMPLE.wall_material,
    &SAMPLE.outside,
];

/// Keys of inserted grains that apply to some distributions of sizes only, and these.
static OF_SIZES: [(&Key, &[&str]); 10] = [
    (&SAMPLE.radius_mean, &["normal", "lognormal"]),
    (&SAMPLE.radius_deviation, &["normal", "lognormal"]),
    (&SAMPLE.radius_exponent, &["power"]),
    (&SAMPLE.sieves, &["table"]),
    (&SAMPLE.passing, &["table"]),
    (&SAMPLE.passing_by, &["table"]),
    (&SAMPLE.large_fraction, &["binary"]),
    (&SAMPLE.large_fraction_by, &["binary"]),
    (&SAMPLE.large_material, &["binary"]),
    (&SAMPLE.radii, &["list"]),
];

/// Why the keys of inserted grains do not apply to a packing.
const OF_INSERTED: &str = "applies to inserted grains, but the grains come from sample.packing";

/// The keys of inserted grains, where a file has them.
fn check_filed(c: &mut Checker<'_>) {
    let keys = &SAMPLE;
    c.whole(&keys.grains);
    for key in [
        &keys.radius_min,
        &keys.radius_max,
        &keys.length,
        &keys.width,
    ] {
        c.number(key);
    }
    c.useless(&keys.sizes, OF_INSERTED);
    for (key, _) in OF_SIZES {
        c.useless(key, OF_INSERTED);
    }
}

/// How the scene takes its packing.
fn arrangement(c: &mut Checker<'_>, boxed: bool) -> Arrangement {
    let key = &SAMPLE.replicate;
    let mut arrangement = Arrangement {
        boxed,
        flat: !boxed && is_flat(c),
        ..Arrangement::BETWEEN_WALLS
    };
    let (Some(Value::Numbers(given)), Values::Numbers(range)) = (c.value(key), key.values) else {
        return arrangement;
    };
    let given = given.clone();
    if !c.is_given(&SAMPLE.packing) {
        let why = "says how often sample.packing is repeated, which is not given";
        c.useless(key, why);
    }
    let whole = |x: &f64| x.fract() == 0.0 && range.hold(*x);
    let axes = periodic_axes(c, boxed);
    if given.len() == axes && given.iter().all(whole) {
        for (copies, given) in arrangement.copies.iter_mut().zip(given) {
            *copies = given as u32;
        }
    } else {
        let example = [
            "one whole number, the copies along x, such as replicate = [10]",
            "two whole numbers, the copies along x and y, such as replicate = [10, 10]",
            "three whole numbers, the copies along x, y and z, such as replicate = [2, 2, 2]",
        ][axes - 1];
        c.refuse(key, &format!("must be {example}"));
    }
    arrangement
}

/// The number of walls.
pub(crate) fn walls_of(confinement: Confinement) -> f64 {
    match confinement {
        Confinement::Walls => 2.0,
        Confinement::Images => 0.0,
        Confinement::FreeSurface => 1.0,
    }
}

fn periodic_axes(c: &Checker<'_>, boxed: bool) -> usize {
    c.dimension.axes() - usize::from(!boxed)
}

/// How many grains are inserted, and between which radii.
fn check_inserted(c: &mut Checker<'_>) {
    c.required_count(&SAMPLE.grains);
    for key in [&SAMPLE.radius_min, &SAMPLE.radius_max] {
        // A list says itself which is the least and which the greatest, and so do sieves.
        if c.is_given(&SAMPLE.radii) {
            c.useless(key, "is the least or the greatest of sample.radii");
        } else if c.is_given(&SAMPLE.sieves) {
            c.useless(key, "follows from sample.sieves");
        } else {
            c.required(key);
        }
    }
}

/// The keys of grains in a box, whose size follows from its solid fraction or from a file.
pub(crate) fn check_boxed(c: &mut Checker<'_>) -> Grains {
    let keys = &SAMPLE;
    let why = "applies to scenes with walls only";
    c.useless(&keys.boundary, why);
    c.all_useless(&OF_WALLS, why);
    let arrangement = arrangement(c, true);
    if c.is_given(&keys.packing) {
        c.useless(&keys.placement, OF_INSERTED);
        check_filed(c);
        return Grains::File(arrangement);
    }
    let why = "follows from box.solid_fraction";
    c.all_useless(&[&keys.length, &keys.width], why);
    check_inserted(c);
    Grains::Inserted(check_sizes(c))
}

/// The sample of a file in its box.
pub(crate) fn derive_filed(
    c: &mut Checker<'_>,
    arrangement: Arrangement,
    packing: ReadPacking<'_>,
) -> Result<(Sample, PackingFile)> {
    let file = read(c, arrangement, packing)?;
    let sample = of_file(c, &file)?;
    fill_from(c, &file);
    let least = sample.least_box_length();
    let [height, _] = file.boxed.unwrap_or_default();
    let lengths = [sample.length, sample.width, height];
    if let Some(length) = lengths.into_iter().find(|length| *length < least) {
        let what = format!(
            "the box is {length:.3e} long, so that grains would touch their own images; give a packing at least {least:.3e} long, or copies of it (sample.replicate)"
        );
        c.refuse(&SAMPLE.packing, &what);
    }
    c.settle()?;
    Ok((sample, file))
}

/// Reads the file that the scene names.
fn read(
    c: &mut Checker<'_>,
    arrangement: Arrangement,
    packing: ReadPacking<'_>,
) -> Result<PackingFile> {
    let key = &SAMPLE.packing;
    let path = c.text(key).unwrap_or_default();
    let file = packing(&c.resolve(key, path), arrangement);
    file.map_err(|failure| match failure {
        Failure::Input(what) => c.failure(key, &what),
        other => other,
    })
}

/// The sample in a cubic box (square in 2D) in which its grains have the solid fraction φ.
pub(crate) fn derive_boxed(
    c: &mut Checker<'_>,
    seed: u64,
    sizes: &Sizes,
    solid_fraction: f64,
) -> Result<Sample> {
    let dimension = c.dimension;
    let sample = inserted(c, sizes)?;
    let volume = |r| dimension.volume(r);
    let grains = volume_in_box(seed, &sample, sizes, volume);
    let length = derived::box_length(dimension, grains / solid_fraction);
    let sample = sample.in_box(dimension, length);
    if !(sample.mean_volume.is_normal() && sample.length.is_normal()) {
        return Err(c.out_of_range(&format!(
            "the mean volume of a grain comes out as {:?} and the length of the box as {:?}; check the units of [sample]",
            sample.mean_volume, sample.length
        )));
    }
    let least = sample.least_box_length();
    if sample.length < least {
        let what = format!(
            "the box would be {:.3e} long, so that grains would touch their own images; give more grains, for a length of at least {least:.3e}",
            sample.length
        );
        c.refuse(&SAMPLE.grains, &what);
    }
    c.settle()?;
    Ok(sample)
}

/// Inserted grains in a cell of the given size.
fn inserted(c: &mut Checker<'_>, sizes: &Sizes) -> Result<Sample> {
    let dimension = c.dimension;
    let [a, b] = radii(c, sizes);
    c.settle()?;
    Ok(Sample {
        grains: c.whole(&SAMPLE.grains).map_or(0, |n| n as u32),
        radius_min: a,
        radius_max: b,
        mean_diameter: sizes.mean([a, b], |r| 2.0 * r),
        mean_volume: sizes.mean([a, b], |r| dimension.volume(r)),
        length: c.known(&SAMPLE.length),
        width: c.number(&SAMPLE.width).unwrap_or(f64::INFINITY),
    })
}

/// The least and the greatest radius, and whether they can be.
fn radii(c: &mut Checker<'_>, sizes: &Sizes) -> [f64; 2] {
    let keys = [&SAMPLE.radius_min, &SAMPLE.radius_max];
    let [a, b] = match sizes {
        Sizes::List(radii) => [
            radii.iter().copied().fold(f64::INFINITY, f64::min),
            radii.iter().copied().fold(0.0, f64::max),
        ],
        Sizes::Classes(classes) if c.is_given(&SAMPLE.sieves) => [
            classes.first().map_or(0.0, |class| class.between[0]),
            classes.last().map_or(0.0, |class| class.between[1]),
        ],
        _ => keys.map(|key| c.known(key)),
    };
    if a > b {
        let what = format!(
            "radius_min = {a:?} is greater than radius_max = {b:?}; give radius_min <= radius_max"
        );
        c.refuse_among(&keys, &what);
    }
    // What is drawn until one is in the distribution: R, or its logarithm.
    let (name, bell, [from, to]) = match sizes {
        Sizes::Normal { mean, deviation } => ("normal", [*mean, *deviation], [a, b]),
        Sizes::Lognormal { mean, deviation } => {
            ("lognormal", [*mean, *deviation], [a, b].map(portable_ln))
        }
        _ => return [a, b],
    };
    let [mean, deviation] = [&SAMPLE.radius_mean, &SAMPLE.radius_deviation].map(|key| c.known(key));
    let least = NARROWEST * (to - from);
    if a < b && bell[1] < least {
        let least = least * deviation / bell[1];
        c.refuse(
            &SAMPLE.radius_deviation,
            &format!("must be at least {least:.3e} for radii so far apart, found {deviation:?}; give radius_min and radius_max closer to the mean"),
        );
    } else if taken(bell[0], bell[1], [from, to]) < LEAST_TAKEN {
        c.refuse_among(
            &keys,
            &format!("the {name} distribution about {mean:?} with deviation {deviation:?} has hardly a radius between radius_min and radius_max; give a mean between them"),
        );
    }
    [a, b]
}

/// The share of uniform numbers in [a, b] that the normal distribution takes.
fn taken(mean: f64, deviation: f64, [a, b]: [f64; 2]) -> f64 {
    let density = |r: f64| {
        let z = (r - mean) / deviation;
        portable_exp(-0.5 * z * z)
    };
    // About ten of them within the least deviation.
    let middle = |k: u32| a + (b - a) * (f64::from(k) + 0.5) / 1000.0;
    (0..1000).map(|k| density(middle(k))).sum::<f64>() / 1000.0
}

/// How the radii of inserted grains are distributed.
fn check_sizes(c: &mut Checker<'_>) -> Sizes {
    let keys = &SAMPLE;
    let Some(name) = c.choice(&keys.sizes) else {
        return Sizes::Uniform;
    };
    for (key, of) in OF_SIZES {
        if !of.contains(&name) {
            let of = quoted_list(of, "and");
            let why = format!("applies to sample.sizes = {of}, not to {name:?}");
            c.useless(key, &why);
        }
    }
    match name {
        "normal" => Sizes::Normal {
            mean: c.required(&keys.radius_mean),
            deviation: c.required(&keys.radius_deviation),
        },
        "lognormal" => {
            let mean = c.required(&keys.radius_mean);
            let relative = c.required(&keys.radius_deviation) / mean;
            let square = portable_ln(1.0 + relative * relative);
            Sizes::Lognormal {
                mean: portable_ln(mean) - 0.5 * square,
                deviation: square.sqrt(),
            }
        }
        "power" => Sizes::Classes(vec![SizeClass {
            share: 1.0,
            between: [&keys.radius_min, &keys.radius_max].map(|key| c.known(key)),
            exponent: c.required(&keys.radius_exponent),
        }]),
        "table" => Sizes::Classes(check_table(c)),
        "binary" => Sizes::Binary {
            large_fraction: large_fraction(c),
        },
        "list" => Sizes::List(c.required_list(&keys.radii, "radius")),
        _ => Sizes::Uniform,
    }
}

/// The share of the large grains of a binary mixture by number. n_l V_l = φ V and n_s V_s = (1-φ) V
/// give it from their share φ of the volume V.
fn large_fraction(c: &mut Checker<'_>) -> f64 {
    let share = c.required(&SAMPLE.large_fraction);
    if c.choice(&SAMPLE.large_fraction_by) != Some("volume") {
        return share;
    }
    let [small, large] = [&SAMPLE.radius_min, &SAMPLE.radius_max].map(|key| c.known(key));
    let of_one = (small / large).powi(c.dimension.axes() as i32);
    share * of_one / (share * of_one + 1.0 - share)
}

/// The classes of a grading curve that hold grains. The curve is straight over the logarithm of the
/// diameter, so in a class the number of grains per radius goes as 1/R, or as 1/R over the volume
/// if the curve is one of mass.
fn check_table(c: &mut Checker<'_>) -> Vec<SizeClass> {
    let keys = &SAMPLE;
    let sieves = c.required_list(&keys.sieves, "mesh width");
    let passing = c.required_list(&keys.passing, "share");
    let rises = sieves.windows(2).all(|pair| pair[0] < pair[1]);
    if sieves.len() < 2 || !rises {
        let what = "must hold two mesh widths or more, from the finest to the coarsest";
        c.refuse(&keys.sieves, what);
        return Vec::new();
    }
    let rises = passing.windows(2).all(|pair| pair[0] <= pair[1]);
    let ends = [passing.first(), passing.last()] == [Some(&0.0), Some(&1.0)];
    if passing.len() != sieves.len() || !rises || !ends {
        let what = format!(
            "must hold the share that passes each of the {} sieves, from 0.0 to 1.0, such as [0.0, 0.4, 1.0]",
            sieves.len()
        );
        c.refuse(&keys.passing, &what);
        return Vec::new();
    }
    let axes = c.dimension.axes();
    let exponent = match c.choice(&keys.passing_by) {
        Some("number") => 1.0,
        _ => 1.0 + axes as f64,
    };
    let largest = 0.5 * sieves[sieves.len() - 1];
    let mut classes: Vec<SizeClass> = sieves
        .windows(2)
        .zip(passing.windows(2))
        .filter(|(_, passing)| passing[0] < passing[1])
        .map(|(sieves, passing)| SizeClass {
            share: passing[1] - passing[0],
            between: [0.5 * sieves[0], 0.5 * sieves[1]],
            exponent,
        })
        .collect();
    if exponent > 1.0 {
        for class in &mut classes {
            class.share /= class.mean(|r| (r / largest).powi(axes as i32));
        }
        let all: f64 = classes.iter().map(|class| class.share).sum();
        classes.iter_mut().for_each(|class| class.share /= all);
    }
    classes
}

/// The sample, where it comes from, and the thickness of each of its walls over d̄; `skip`: it is
/// not compressed.
pub(crate) fn derive(
    c: &mut Checker<'_>,
    grains: Grains,
    skip: bool,
    packing: ReadPacking<'_>,
) -> Result<(Sample, Origin, (Walls, f64))> {
    let keys = &SAMPLE;
    let flat = is_flat(c).then_some(Walls::Flat);
    let (sample, origin, (walls, layers)) = match grains {
        Grains::Inserted(sizes) => {
            let sample = inserted(c, &sizes)?;
            let height = derived::packed_height(&sample);
            let sized_by = [
                &keys.grains,
                &keys.radius_min,
                &keys.radius_max,
                &keys.length,
            ];
            let layers = check_size(c, &sample, height, &sized_by)?;
            let walls = flat.unwrap_or(Walls::Layers);
            (sample, Origin::Insertion(sizes), (walls, layers))
        }
        Grains::File(arrangement) => {
            let file = read(c, arrangement, packing)?;
            let sample = of_file(c, &file)?;
            let layers = check_size(c, &sample, file.height(), &[&keys.packing])?;
            let types = match confinement(c) {
                Confinement::Walls => file.wall_types,
                Confinement::Images => false,
                Confinement::FreeSurface => file.bottom_type,
            };
            let by_type = skip && types;
            let default = if by_type { Walls::Types } else { Walls::Layers };
            let walls = c.named(&keys.walls, &Walls::NAMES).unwrap_or(default);
            fill_from(c, &file);
            let name = Walls::NAMES.iter().find(|(_, known)| *known == walls);
            c.fill(&keys.walls, name.map_or("", |(name, _)| name));
            (sample, Origin::Packing(file), (walls, layers))
        }
    };
    c.fill(&keys.wall_thickness, layers);
    Ok((sample, origin, (walls, layers)))
}

/// The sample that a file holds, which the keys that are given must agree with.
fn of_file(c: &mut Checker<'_>, file: &PackingFile) -> Result<Sample> {
    let keys = &SAMPLE;
    let unlike = |given: &dyn std::fmt::Display, of_file: &dyn std::fmt::Display| {
        format!("is {of_file} in the packing of sample.packing, found {given}; leave it out")
    };
    if let Some(n) = c.whole(&keys.grains)
        && n != i64::from(file.grains)
    {
        c.refuse(&keys.grains, &unlike(&n, &file.grains));
    }
    let width = file.width.unwrap_or(f64::INFINITY);
    for (key, of_file) in [
        (&keys.radius_min, file.radius_min),
        (&keys.radius_max, file.radius_max),
        (&keys.length, file.length),
        (&keys.width, width),
    ] {
        if let Some(x) = c.number(key)
            && x != of_file
        {
            c.refuse(key, &unlike(&show(x), &show(of_file)));
        }
    }
    if file.width.is_some() != (c.dimension == Dimensions::Three) {
        let (is, dimension) = match file.width {
            Some(_) => ("spheres", 3),
            None => ("disks in the plane z = 0", 2),
        };
        let what = format!("holds {is}; give dimension = {dimension}");
        c.refuse(&keys.packing, &what);
    }
    c.settle()?;
    Ok(Sample {
        grains: file.grains,
        radius_min: file.radius_min,
        radius_max: file.radius_max,
        mean_diameter: file.mean_diameter,
        mean_volume: file.mean_volume,
        length: file.length,
        width,
    })
}

/// Fills in what follows from a file.
fn fill_from(c: &mut Checker<'_>, file: &PackingFile) {
    let keys = &SAMPLE;
    c.fill(&keys.packing, &*file.path.display().to_string());
    let axes = periodic_axes(c, file.boxed.is_some());
    let copies: Vec<u32> = (0..axes)
        .map(|axis| file.replicate.get(axis).copied().unwrap_or(1))
        .collect();
    c.fill(&keys.replicate, &copies[..]);
    c.fill(&keys.grains, u64::from(file.grains));
    c.fill(&keys.radius_min, file.radius_min);
    c.fill(&keys.radius_max, file.radius_max);
    c.fill(&keys.length, file.length);
    if let Some(width) = file.width {
        c.fill(&keys.width, width);
    }
}

/// Refuses a cell too small for its grains and walls. Returns the thickness of these over d̄.
/// `height` (m) includes the walls; `sized_by` are the keys that set the size.
fn check_size(c: &mut Checker<'_>, sample: &Sample, height: f64, sized_by: &[&Key]) -> Result<f64> {
    let keys = &SAMPLE;
    let given = c.number(&keys.wall_thickness);
    let confinement = confinement(c);
    let layers = match confinement {
        Confinement::Images => 0.0,
        _ if is_flat(c) => 0.0,
        _ => given.unwrap_or_else(|| derived::wall_layers(sample)),
    };
    let all_layers = walls_of(confinement) * layers;
    let least = 8.0 * sample.radius_max;
    let narrow = |name: &str, length: f64| {
        format!(
            "the cell is too narrow for its grains: {name} = {} m; give at least 4 diameters of the largest, {least:.3e} m",
            show(length)
        )
    };
    if sample.width < least {
        c.refuse(&keys.width, &narrow("width", sample.width));
    }
    if sample.length < least {
        // The length first, where it was given.
        let reversed: Vec<&Key> = sized_by.iter().rev().copied().collect();
        c.refuse_among(&reversed, &narrow("length", sample.length));
    }
    c.settle()?;
    let mut needed = derived::least_height(all_layers) * sample.mean_diameter;
    let mut of_needed = "five mean diameters";
    if confinement == Confinement::Images && needed < sample.least_box_length() {
        needed = sample.least_box_length();
        of_needed = "2.2 diameters of the largest";
    }
    // Between flat walls one grain is enough.
    if height < needed && !is_flat(c) {
        let least = derived::least_grains(sample, needed);
        let mut remedy = if least <= f64::from(u32::MAX) {
            format!("give at least {least} grains or a shorter cell")
        } else {
            "give a shorter cell".into()
        };
        if layers > 1.0 {
            remedy += ", or thinner walls (sample.wall_thickness)";
        }
        let what = if layers == 0.0 {
            format!(
                "the cell is too low: {} grains fill about {height:.2e} m of height, less than {needed:.2e} m, {of_needed}; {remedy}",
                sample.grains
            )
        } else {
            let of_wall = if layers == 1.0 {
                "one mean diameter".into()
            } else {
                format!("{} mean diameters", (1e3 * layers).round() / 1e3)
            };
            let walls = match confinement {
                Confinement::FreeSurface => format!("a bottom wall of {of_wall} and five above it"),
                _ => format!("two walls of {of_wall} and five between them"),
            };
            format!(
                "the cell is too low for its walls: {} grains fill about {height:.2e} m of height, but {walls} take {needed:.2e} m; {remedy}",
                sample.grains
            )
        };
        c.refuse_among(&[sized_by, &[&keys.wall_thickness]].concat(), &what);
    }
    c.settle()?;
    Ok(layers)
}
