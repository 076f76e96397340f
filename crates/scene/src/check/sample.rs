//! The sample: `[sample]`, and the file it may come from.

use super::{Checker, Key, POSITIVE, UNIT, key};
use crate::ReadPacking;
use crate::derived::{self, LEAST_HEIGHT};
use crate::raw::{self, Number, Numbers, Text, Whole, show};
use crate::scene::*;
use gshear_dem::failure::Failure;

/// The keys of `[sample]`, each checked by itself.
pub(super) struct SampleKeys {
    dimension: Dimensions,
    grains: Key<Whole>,
    radius_min: Key<Number>,
    radius_max: Key<Number>,
    sizes: Option<Sizes>,
    length: Key<Number>,
    width: Key<Number>,
    pub packing: Key<Text>,
    /// Copies of the packing along x and y.
    replicate: [u32; 2],
    pub walls: Option<Walls>,
}

impl SampleKeys {
    /// Those that make the size of the sample, for what they cause together.
    fn places(&self) -> [(&'static str, Option<usize>); 4] {
        [
            (self.grains.path, self.grains.offset()),
            (self.radius_min.path, self.radius_min.offset()),
            (self.radius_max.path, self.radius_max.offset()),
            (self.length.path, self.length.offset()),
        ]
    }
}

pub(super) fn check(c: &mut Checker<'_>, dimension: Dimensions, sample: raw::Sample) -> SampleKeys {
    let walls = key!(sample.walls);
    let packing = key!(sample.packing);
    let length = key!(sample.length);
    let width = key!(sample.width);
    let mut keys = SampleKeys {
        dimension,
        grains: key!(sample.grains),
        radius_min: key!(sample.radius_min),
        radius_max: key!(sample.radius_max),
        sizes: None,
        length,
        width,
        replicate: copies(c, dimension, &key!(sample.replicate), &packing),
        packing,
        walls: c.text(&walls).and_then(|name| {
            let known = Walls::NAMES.into_iter().find(|(known, _)| *known == name);
            if known.is_none() {
                let names = Walls::NAMES.map(|(known, _)| format!("{known:?}"));
                c.refuse(
                    &walls,
                    &format!("unknown walls {name:?}; they are {}", names.join(" or ")),
                );
            }
            known.map(|(_, walls)| walls)
        }),
    };
    let sizes = size_keys!(sample);
    if dimension == Dimensions::Two {
        c.useless(
            &keys.width,
            "is L_y (m) of three dimensions, and dimension = 2",
        );
    }
    // Grains are numbered by u32.
    let most = u32::MAX.into();
    if keys.packing.given.is_some() {
        c.whole(&keys.grains, 1, most);
        for key in [
            &keys.radius_min,
            &keys.radius_max,
            &keys.length,
            &keys.width,
        ] {
            c.number(key, &POSITIVE);
        }
        sizes.useless(c);
        return keys;
    }
    if walls.given.is_some() {
        c.refuse(
            &walls,
            "there is no packing to find walls in; give sample.packing, or leave it out",
        );
    }
    check_inserted(
        c,
        &sizes,
        &keys.grains,
        [&keys.radius_min, &keys.radius_max],
    );
    c.required(&keys.length, &POSITIVE, "L_x (m), such as length = 48e-6");
    if dimension == Dimensions::Three {
        c.required(&keys.width, &POSITIVE, "L_y (m), such as width = 30e-3");
    }
    keys.sizes = Some(sizes.check(c));
    keys
}

/// Copies along x and, in three dimensions, y.
fn copies(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    key: &Key<Numbers>,
    packing: &Key<Text>,
) -> [u32; 2] {
    let Some((_, Numbers(given))) = &key.given else {
        return [1, 1];
    };
    if packing.given.is_none() {
        c.useless(
            key,
            "says how often sample.packing is repeated, which is not given",
        );
    }
    let whole = |x: &f64| x.fract() == 0.0 && (1.0..=1e6).contains(x);
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

/// The keys of [`SizeKeys`], out of the raw table.
macro_rules! size_keys {
    ($sample:ident) => {
        SizeKeys {
            sizes: key!($sample.sizes),
            mean: key!($sample.radius_mean),
            deviation: key!($sample.radius_deviation),
            large_fraction: key!($sample.large_fraction),
            radii: key!($sample.radii),
        }
    };
}
use size_keys;

/// How many grains are inserted, and between which radii.
fn check_inserted(
    c: &mut Checker<'_>,
    sizes: &SizeKeys,
    grains: &Key<Whole>,
    [radius_min, radius_max]: [&Key<Number>; 2],
) {
    // Grains are numbered by u32.
    let most = u32::MAX.into();
    let what = "the number of grains, such as grains = 1000";
    c.required_whole(grains, 1, most, what);
    for (key, what) in [
        (radius_min, "the least R (m), such as radius_min = 0.5e-6"),
        (radius_max, "the greatest R (m), such as radius_max = 1e-6"),
    ] {
        // A list says itself which is the least and which the greatest.
        if sizes.radii.given.is_some() {
            c.useless(key, "is the least or the greatest of sample.radii");
        } else {
            c.required(key, &POSITIVE, what);
        }
    }
}

/// The keys of grains in a box, whose size follows from its solid fraction.
pub(super) struct BoxedKeys {
    dimension: Dimensions,
    grains: Key<Whole>,
    radii: [Key<Number>; 2],
    sizes: Sizes,
}

pub(super) fn check_boxed(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    sample: raw::Sample,
) -> BoxedKeys {
    let why = "follows from box.solid_fraction";
    c.useless(&key!(sample.length), why);
    c.useless(&key!(sample.width), why);
    c.useless(&key!(sample.packing), "is of scenes with walls");
    c.useless(&key!(sample.walls), "is of scenes with walls");
    c.useless(&key!(sample.replicate), "is of scenes with walls");
    let (grains, radius_min, radius_max) = (
        key!(sample.grains),
        key!(sample.radius_min),
        key!(sample.radius_max),
    );
    let sizes = size_keys!(sample);
    check_inserted(c, &sizes, &grains, [&radius_min, &radius_max]);
    BoxedKeys {
        dimension,
        grains,
        radii: [radius_min, radius_max],
        sizes: sizes.check(c),
    }
}

impl BoxedKeys {
    /// The sample in a box as long in every direction, of which its grains fill the part φ.
    pub fn derive(
        self,
        c: &mut Checker<'_>,
        solid_fraction: f64,
    ) -> Result<(Sample, Sizes), Failure> {
        let [a, b] = radii(c, &self.sizes, [&self.radii[0], &self.radii[1]]);
        c.settle()?;
        let grains = self.grains.given.as_ref().map_or(0, |(_, n)| n.0 as u32);
        let mean_volume = self.sizes.mean([a, b], |r| self.dimension.volume(r));
        let volume = f64::from(grains) * mean_volume / solid_fraction;
        let (length, width) = match self.dimension {
            Dimensions::Two => (volume.sqrt(), f64::INFINITY),
            Dimensions::Three => (derived::cube_root(volume), derived::cube_root(volume)),
        };
        let least = 4.4 * b;
        if length < least {
            let places = [(self.grains.path, self.grains.offset())];
            c.refuse_among(
                &places,
                &format!(
                    "the box would be {length:.3e} long, and grains would meet their own images; give more grains, so that it is longer than {least:.3e}"
                ),
            );
        }
        c.settle()?;
        let sample = Sample {
            grains,
            radius_min: a,
            radius_max: b,
            mean_diameter: self.sizes.mean([a, b], |r| 2.0 * r),
            mean_volume,
            length,
            width,
        };
        Ok((sample, self.sizes))
    }
}

/// The least and the greatest radius, and whether they can be.
fn radii(c: &mut Checker<'_>, sizes: &Sizes, keys: [&Key<Number>; 2]) -> [f64; 2] {
    let given = |key: &Key<Number>| key.given.as_ref().map_or(f64::NAN, |(_, x)| x.0);
    let [a, b] = match sizes {
        Sizes::List(radii) => [
            radii.iter().copied().fold(f64::INFINITY, f64::min),
            radii.iter().copied().fold(0.0, f64::max),
        ],
        _ => keys.map(given),
    };
    let places = keys.map(|key| (key.path, key.offset()));
    if a > b {
        c.refuse_among(
            &places,
            &format!("radius_min = {a:?} is greater than radius_max = {b:?}; give radius_min <= radius_max"),
        );
    }
    if let Sizes::Normal { mean, deviation } = sizes
        && (mean + 4.0 * deviation < a || mean - 4.0 * deviation > b)
    {
        c.refuse_among(
            &places,
            &format!("the normal distribution about {mean:?} with deviation {deviation:?} has next to nothing between radius_min and radius_max; give a mean between them"),
        );
    }
    [a, b]
}

/// How the radii of inserted grains are distributed.
struct SizeKeys {
    sizes: Key<Text>,
    mean: Key<Number>,
    deviation: Key<Number>,
    large_fraction: Key<Number>,
    radii: Key<Numbers>,
}

impl SizeKeys {
    fn useless(&self, c: &mut Checker<'_>) {
        let why = "is of inserted grains, and the grains come from sample.packing";
        c.useless(&self.sizes, why);
        c.useless(&self.radii, why);
        for key in [&self.mean, &self.deviation, &self.large_fraction] {
            c.useless(key, why);
        }
    }

    fn check(&self, c: &mut Checker<'_>) -> Sizes {
        let name = c.text(&self.sizes).unwrap_or_else(|| "uniform".into());
        if !Sizes::NAMES.contains(&&*name) {
            let names = Sizes::NAMES.map(|known| format!("{known:?}")).join(", ");
            c.refuse(
                &self.sizes,
                &format!("unknown distribution {name:?}; there are {names}"),
            );
            return Sizes::Uniform;
        }
        for (key, of) in [
            (&self.mean, "normal"),
            (&self.deviation, "normal"),
            (&self.large_fraction, "binary"),
        ] {
            if name != of {
                c.useless(
                    key,
                    &format!("is of sample.sizes = {of:?}, not of {name:?}"),
                );
            }
        }
        if name != "list" {
            let why = format!("is of sample.sizes = \"list\", not of {name:?}");
            c.useless(&self.radii, &why);
        }
        match &*name {
            "normal" => Sizes::Normal {
                mean: c.required(
                    &self.mean,
                    &POSITIVE,
                    "the mean of the uncut distribution (m), such as radius_mean = 1.5e-3",
                ),
                deviation: c.required(
                    &self.deviation,
                    &POSITIVE,
                    "its standard deviation (m), such as radius_deviation = 0.5e-3",
                ),
            },
            "binary" => Sizes::Binary {
                large_fraction: c.required(
                    &self.large_fraction,
                    &UNIT,
                    "the part of the grains that have radius_max, such as large_fraction = 0.5",
                ),
            },
            "list" => {
                let radii = self
                    .radii
                    .given
                    .as_ref()
                    .map_or(Vec::new(), |(_, list)| list.0.clone());
                if self.radii.given.is_none() {
                    c.lacks("sample", "radii: the radii (m), each as likely as the others, such as radii = [1e-3, 1.5e-3]");
                } else if radii.is_empty() || !radii.iter().all(|r| *r > 0.0 && r.is_finite()) {
                    c.refuse(
                        &self.radii,
                        "must hold one radius or more, each greater than 0",
                    );
                }
                Sizes::List(radii)
            }
            _ => Sizes::Uniform,
        }
    }
}

/// The sample and where it comes from; `skip`: it is not compressed.
pub(super) fn derive(
    c: &mut Checker<'_>,
    keys: &SampleKeys,
    skip: bool,
    packing: ReadPacking<'_>,
) -> Result<(Sample, Origin), Failure> {
    let number = |key: &Key<Number>| key.given.as_ref().map(|(_, x)| x.0);
    let Some((at, Text(path))) = &keys.packing.given else {
        let sizes = keys.sizes.clone().unwrap_or(Sizes::Uniform);
        let [a, b] = radii(c, &sizes, [&keys.radius_min, &keys.radius_max]);
        c.settle()?;
        let volume = |r| keys.dimension.volume(r);
        let sample = Sample {
            grains: keys.grains.given.as_ref().map_or(0, |(_, n)| n.0 as u32),
            radius_min: a,
            radius_max: b,
            mean_diameter: sizes.mean([a, b], |r| 2.0 * r),
            mean_volume: sizes.mean([a, b], volume),
            length: number(&keys.length).unwrap_or(f64::NAN),
            width: number(&keys.width).unwrap_or(f64::INFINITY),
        };
        let height = derived::packed_height(&sample);
        check_size(c, &sample, height, &keys.places())?;
        return Ok((sample, Origin::Insertion(sizes)));
    };
    let file = packing(&c.resolve(*at, path), keys.replicate).map_err(|failure| match failure {
        Failure::Input(what) => c.failure(*at, keys.packing.path, &what),
        other => other,
    })?;
    if let Some(n) = c.whole(&keys.grains, 1, u32::MAX.into())
        && n != i64::from(file.grains)
    {
        c.refuse(&keys.grains, &unlike_packing(n, file.grains));
    }
    for (key, of_file) in [
        (&keys.radius_min, file.radius_min),
        (&keys.radius_max, file.radius_max),
        (&keys.length, file.length),
        (&keys.width, file.width.unwrap_or(f64::INFINITY)),
    ] {
        if let Some(x) = c.number(key, &POSITIVE)
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
        let at = [(keys.packing.path, keys.packing.offset())];
        c.refuse_among(&at, &format!("holds {is}; give dimension = {dimension}"));
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
    let place = [(keys.packing.path, keys.packing.offset())];
    check_size(c, &sample, file.height(), &place)?;
    let walls = keys.walls.unwrap_or(if skip && file.wall_types {
        Walls::Types
    } else {
        Walls::Layers
    });
    Ok((sample, Origin::Packing { file, walls }))
}

fn unlike_packing(given: impl std::fmt::Display, of_file: impl std::fmt::Display) -> String {
    format!("is {of_file} in the packing of sample.packing, found {given}; leave it out")
}

/// What the values of `[sample]` must be to each other; `height` (m) with the walls, `places` that cause it.
fn check_size(
    c: &mut Checker<'_>,
    sample: &Sample,
    height: f64,
    places: &[(&str, Option<usize>)],
) -> Result<(), Failure> {
    let least = 8.0 * sample.radius_max;
    if sample.width < least {
        c.refuse_among(
            &[("sample.width", None)],
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
    let needed = LEAST_HEIGHT * sample.mean_diameter;
    if height < needed {
        let least = derived::least_grains(sample);
        let remedy = if least <= f64::from(u32::MAX) {
            format!("give at least {least} grains or a shorter cell")
        } else {
            "give a shorter cell".into()
        };
        c.refuse_among(
            places,
            &format!(
                "box too small for its walls: {} grains fill about {height:.2e} m of height, but two walls of one mean diameter and five between them take {needed:.2e} m; {remedy}",
                sample.grains
            ),
        );
    }
    c.settle()
}
