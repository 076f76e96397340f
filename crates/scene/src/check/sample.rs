//! The sample: `[sample]`, and the file it may come from.

use crate::ReadPacking;
use crate::checker::Checker;
use crate::derived;
use crate::key::Key;
use crate::kind::{Number, Numbers, Text};
use crate::raw;
use crate::sample::volume_in_box;
use crate::scene::{Dimensions, Origin, PeriodicBox, Sample, Sizes, Walls};
use crate::words::show;
use gshear_dem::contact::portable_exp;
use gshear_dem::failure::Failure;

/// The keys of `[sample]`, each checked by itself.
pub(super) struct SampleKeys<'r> {
    dimension: Dimensions,
    pub raw: &'r raw::Sample,
    sizes: Option<Sizes>,
    /// Copies of the packing along x and y.
    replicate: [u32; 2],
    pub walls: Option<Walls>,
    /// Thickness of each wall over d̄, if it is given.
    wall_layers: Option<f64>,
}

/// Least standard deviation of radii, over the width of their interval.
const NARROWEST: f64 = 0.01;

/// Least share of random radii in their interval that the normal distribution takes. The others are
/// drawn anew.
const LEAST_TAKEN: f64 = 1e-3;

/// A key's path and place.
type Place = (&'static str, Option<usize>);

pub(super) fn check<'r>(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    raw: &'r raw::Sample,
) -> SampleKeys<'r> {
    let replicate = copies(c, dimension, raw);
    let name = c.choice(&raw.walls);
    let walls = Walls::NAMES.iter().find(|(known, _)| Some(*known) == name);
    let mut keys = SampleKeys {
        dimension,
        raw,
        sizes: None,
        replicate,
        walls: walls.map(|(_, walls)| *walls),
        wall_layers: c.number(&raw.wall_thickness),
    };
    if dimension == Dimensions::Two {
        c.useless(
            &raw.width,
            "is L_y (m) of three dimensions, and dimension = 2",
        );
    }
    c.useless(
        &raw.placement,
        "applies to the grains of a [box]; between walls they fall from above",
    );
    if raw.packing.is_given() {
        c.whole(&raw.grains);
        for key in [&raw.radius_min, &raw.radius_max, &raw.length, &raw.width] {
            c.number(key);
        }
        sizes_are_useless(c, raw);
        return keys;
    }
    if raw.walls.is_given() {
        c.refuse(
            &raw.walls,
            "there is no packing to find walls in; give sample.packing, or leave it out",
        );
    }
    check_inserted(c, raw);
    c.required(&raw.length);
    if dimension == Dimensions::Three {
        c.required(&raw.width);
    }
    keys.sizes = Some(check_sizes(c, raw));
    keys
}

/// Copies along x and, in three dimensions, y.
fn copies(c: &mut Checker<'_>, dimension: Dimensions, sample: &raw::Sample) -> [u32; 2] {
    let key = &sample.replicate;
    let Some(Numbers(given)) = key.value() else {
        return [1, 1];
    };
    if !sample.packing.is_given() {
        c.useless(
            key,
            "says how often sample.packing is repeated, which is not given",
        );
    }
    let whole = |x: &f64| x.fract() == 0.0 && key.declared.range.hold(*x);
    match (dimension, &given[..]) {
        (Dimensions::Two, [x]) if whole(x) => [*x as u32, 1],
        (Dimensions::Three, [x, y]) if whole(x) && whole(y) => [*x as u32, *y as u32],
        _ => {
            let example = match dimension {
                Dimensions::Two => "one whole number, the copies along x, such as replicate = [10]",
                Dimensions::Three => {
                    "two whole numbers, the copies along x and y, such as replicate = [10, 10]"
                }
            };
            c.refuse(key, &format!("must be {example}"));
            [1, 1]
        }
    }
}

/// How many grains are inserted, and between which radii.
fn check_inserted(c: &mut Checker<'_>, sample: &raw::Sample) {
    c.required_count(&sample.grains);
    for key in [&sample.radius_min, &sample.radius_max] {
        // A list says itself which is the least and which the greatest.
        if sample.radii.is_given() {
            c.useless(key, "is the least or the greatest of sample.radii");
        } else {
            c.required(key);
        }
    }
}

/// The keys of grains in a box, whose size follows from its solid fraction. Returns the
/// distribution of their radii.
pub(super) fn check_boxed(c: &mut Checker<'_>, sample: &raw::Sample) -> Sizes {
    let why = "follows from box.solid_fraction";
    c.useless(&sample.length, why);
    c.useless(&sample.width, why);
    let why = "applies to scenes with walls only";
    c.useless(&sample.packing, why);
    c.useless(&sample.walls, why);
    c.useless(&sample.wall_thickness, why);
    c.useless(&sample.replicate, why);
    check_inserted(c, sample);
    check_sizes(c, sample)
}

/// The sample in a cubic box (square in 2D) in which its grains have the solid fraction φ.
pub(super) fn derive_boxed(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    (raw, seed): (&raw::Sample, u64),
    periodic: &PeriodicBox,
) -> Result<Sample, Failure> {
    let sample = inserted(c, dimension, raw, &periodic.sizes)?;
    let volume = |r| dimension.volume(r);
    let grains = volume_in_box(seed, &sample, &periodic.sizes, volume);
    let length = derived::box_length(dimension, grains / periodic.solid_fraction);
    let sample = sample.in_box(dimension, length);
    if !(sample.mean_volume.is_normal() && sample.length.is_normal()) {
        return Err(c.out_of_range(&format!(
            "the mean volume of a grain comes out as {:?} and the length of the box as {:?}; check the units of [sample]",
            sample.mean_volume, sample.length
        )));
    }
    let least = sample.least_box_length();
    if sample.length < least {
        c.refuse_among(
            &[raw.grains.place()],
            &format!(
                "the box would be {:.3e} long, so that grains would touch their own images; give more grains, for a length of at least {least:.3e}",
                sample.length
            ),
        );
    }
    c.settle()?;
    Ok(sample)
}

/// Inserted grains in a cell of the given size.
fn inserted(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    raw: &raw::Sample,
    sizes: &Sizes,
) -> Result<Sample, Failure> {
    let number = |key: &Key<Number>| key.value().map(|x| x.0);
    let [a, b] = radii(c, sizes, raw);
    c.settle()?;
    Ok(Sample {
        grains: raw.grains.value().map_or(0, |n| n.0 as u32),
        radius_min: a,
        radius_max: b,
        mean_diameter: sizes.mean([a, b], |r| 2.0 * r),
        mean_volume: sizes.mean([a, b], |r| dimension.volume(r)),
        length: number(&raw.length).unwrap_or(f64::NAN),
        width: number(&raw.width).unwrap_or(f64::INFINITY),
    })
}

/// The least and the greatest radius, and whether they can be.
fn radii(c: &mut Checker<'_>, sizes: &Sizes, sample: &raw::Sample) -> [f64; 2] {
    let keys = [&sample.radius_min, &sample.radius_max];
    let given = |key: &Key<Number>| key.value().map_or(f64::NAN, |x| x.0);
    let [a, b] = match sizes {
        Sizes::List(radii) => [
            radii.iter().copied().fold(f64::INFINITY, f64::min),
            radii.iter().copied().fold(0.0, f64::max),
        ],
        _ => keys.map(given),
    };
    let places = keys.map(Key::place);
    if a > b {
        c.refuse_among(
            &places,
            &format!("radius_min = {a:?} is greater than radius_max = {b:?}; give radius_min <= radius_max"),
        );
    }
    if let Sizes::Normal { deviation, .. } = sizes
        && a < b
        && *deviation < NARROWEST * (b - a)
    {
        // Radii are drawn between the two until one is in the distribution.
        c.refuse_among(
            &[sample.radius_deviation.place()],
            &format!("must be at least {NARROWEST} (radius_max - radius_min) = {:.3e}, found {deviation:?}; give radius_min and radius_max closer to the mean", NARROWEST * (b - a)),
        );
    } else if let Sizes::Normal { mean, deviation } = sizes
        && taken(*mean, *deviation, [a, b]) < LEAST_TAKEN
    {
        c.refuse_among(
            &places,
            &format!("the normal distribution about {mean:?} with deviation {deviation:?} has hardly a radius between radius_min and radius_max; give a mean between them"),
        );
    }
    [a, b]
}

/// The share of uniform radii in [a, b] that the normal distribution takes.
fn taken(mean: f64, deviation: f64, [a, b]: [f64; 2]) -> f64 {
    let density = |r: f64| {
        let z = (r - mean) / deviation;
        portable_exp(-0.5 * z * z)
    };
    // About ten of them within the least deviation.
    let middle = |k: u32| a + (b - a) * (f64::from(k) + 0.5) / 1000.0;
    (0..1000).map(|k| density(middle(k))).sum::<f64>() / 1000.0
}

/// Refuses a distribution of sizes beside a packing.
fn sizes_are_useless(c: &mut Checker<'_>, sample: &raw::Sample) {
    let why = "applies to inserted grains, but the grains come from sample.packing";
    c.useless(&sample.sizes, why);
    c.useless(&sample.radii, why);
    c.useless(&sample.radius_mean, why);
    c.useless(&sample.radius_deviation, why);
    c.useless(&sample.large_fraction, why);
}

/// How the radii of inserted grains are distributed.
fn check_sizes(c: &mut Checker<'_>, sample: &raw::Sample) -> Sizes {
    let Some(name) = c.choice_or_default(&sample.sizes) else {
        return Sizes::Uniform;
    };
    let useless = |of: &str| format!("applies to sample.sizes = {of:?}, not to {name:?}");
    for (key, of) in [
        (&sample.radius_mean, "normal"),
        (&sample.radius_deviation, "normal"),
        (&sample.large_fraction, "binary"),
    ] {
        if name != of {
            c.useless(key, &useless(of));
        }
    }
    if name != "list" {
        c.useless(&sample.radii, &useless("list"));
    }
    match name {
        "normal" => Sizes::Normal {
            mean: c.required(&sample.radius_mean),
            deviation: c.required(&sample.radius_deviation),
        },
        "binary" => Sizes::Binary {
            large_fraction: c.required(&sample.large_fraction),
        },
        "list" => {
            let Key { declared, given } = &sample.radii;
            let Some((_, Numbers(radii))) = given else {
                c.lacks(declared.table(), &declared.lacking());
                return Sizes::List(Vec::new());
            };
            let hold = |r: &f64| r.is_finite() && declared.range.hold(*r);
            if radii.is_empty() || !radii.iter().all(hold) {
                let what = "must hold one radius or more, each greater than 0";
                c.refuse(&sample.radii, what);
            }
            Sizes::List(radii.clone())
        }
        _ => Sizes::Uniform,
    }
}

/// The sample, where it comes from, and the thickness of each of its walls over d̄; `skip`: it is not
/// compressed.
pub(super) fn derive(
    c: &mut Checker<'_>,
    keys: &SampleKeys<'_>,
    skip: bool,
    packing: ReadPacking<'_>,
) -> Result<(Sample, Origin, f64), Failure> {
    let raw = keys.raw;
    let Some((at, Text(path))) = &raw.packing.given else {
        let sizes = keys.sizes.clone().unwrap_or(Sizes::Uniform);
        let sample = inserted(c, keys.dimension, raw, &sizes)?;
        let height = derived::packed_height(&sample);
        let places = [
            raw.grains.place(),
            raw.radius_min.place(),
            raw.radius_max.place(),
            raw.length.place(),
        ];
        let layers = check_size(c, keys, &sample, height, &places)?;
        return Ok((sample, Origin::Insertion(sizes), layers));
    };
    let file = packing(&c.resolve(*at, path), keys.replicate).map_err(|failure| match failure {
        Failure::Input(what) => c.failure(*at, raw.packing.declared.path, &what),
        other => other,
    })?;
    if let Some(n) = c.whole(&raw.grains)
        && n != i64::from(file.grains)
    {
        c.refuse(&raw.grains, &unlike_packing(n, file.grains));
    }
    for (key, of_file) in [
        (&raw.radius_min, file.radius_min),
        (&raw.radius_max, file.radius_max),
        (&raw.length, file.length),
        (&raw.width, file.width.unwrap_or(f64::INFINITY)),
    ] {
        if let Some(x) = c.number(key)
            && x != of_file
        {
            c.refuse(key, &unlike_packing(show(x), show(of_file)));
        }
    }
    if file.width.is_some() != (keys.dimension == Dimensions::Three) {
        let (is, dimension) = match file.width {
            Some(_) => ("spheres", 3),
            None => ("disks in the plane z = 0", 2),
        };
        c.refuse(
            &raw.packing,
            &format!("holds {is}; give dimension = {dimension}"),
        );
    }
    c.settle()?;
    let sample = Sample {
        grains: file.grains,
        radius_min: file.radius_min,
        radius_max: file.radius_max,
        mean_diameter: file.mean_diameter,
        mean_volume: file.mean_volume,
        length: file.length,
        width: file.width.unwrap_or(f64::INFINITY),
    };
    let places = [raw.packing.place()];
    let layers = check_size(c, keys, &sample, file.height(), &places)?;
    let walls = keys.walls.unwrap_or(if skip && file.wall_types {
        Walls::Types
    } else {
        Walls::Layers
    });
    Ok((sample, Origin::Packing { file, walls }, layers))
}

fn unlike_packing(given: impl std::fmt::Display, of_file: impl std::fmt::Display) -> String {
    format!("is {of_file} in the packing of sample.packing, found {given}; leave it out")
}

/// Refuses a cell too small for its grains and walls. Returns the thickness of these over d̄. `height` (m) includes the walls; `places` are
/// the keys that set the size.
fn check_size(
    c: &mut Checker<'_>,
    keys: &SampleKeys<'_>,
    sample: &Sample,
    height: f64,
    places: &[Place],
) -> Result<f64, Failure> {
    let raw = keys.raw;
    let layers = keys
        .wall_layers
        .unwrap_or_else(|| derived::wall_layers(sample));
    let least = 8.0 * sample.radius_max;
    if sample.width < least {
        c.refuse_among(
            &[raw.width.place()],
            &format!(
                "the cell is too narrow for its grains: width = {} m; give at least 4 diameters of the largest, {least:.3e} m",
                show(sample.width)
            ),
        );
    }
    if sample.length < least {
        // The length first, where it was given.
        let reversed: Vec<_> = places.iter().rev().copied().collect();
        c.refuse_among(
            &reversed,
            &format!(
                "the cell is too narrow for its grains: length = {} m; give at least 4 diameters of the largest, {least:.3e} m",
                show(sample.length)
            ),
        );
    }
    c.settle()?;
    let needed = derived::least_height(layers) * sample.mean_diameter;
    if height < needed {
        let least = derived::least_grains(sample, layers);
        let remedy = if least <= f64::from(u32::MAX) {
            format!("give at least {least} grains or a shorter cell")
        } else {
            "give a shorter cell".into()
        };
        let of_wall = match layers == 1.0 {
            true => "one mean diameter".into(),
            false => format!("{} mean diameters", (1e3 * layers).round() / 1e3),
        };
        let remedy = match layers > 1.0 {
            true => format!("{remedy}, or thinner walls (sample.wall_thickness)"),
            false => remedy,
        };
        let thickness = raw.wall_thickness.place();
        let given = thickness.1.map(|_| thickness);
        let places: Vec<Place> = places.iter().copied().chain(given).collect();
        c.refuse_among(
            &places,
            &format!(
                "the cell is too low for its walls: {} grains fill about {height:.2e} m of height, but two walls of {of_wall} and five between them take {needed:.2e} m; {remedy}",
                sample.grains
            ),
        );
    }
    c.settle()?;
    Ok(layers)
}
