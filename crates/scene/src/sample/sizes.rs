//! Checks of the distribution of the radii of inserted grains.

use gshear_dem::contact::{portable_exp, portable_ln};
use gshear_dem::laws::keys::{Key, KeyReader};

use super::keys::{Distribution, SAMPLE, SampleKeys};
use crate::checker::Checker;
use crate::grains::{ListedRadius, SizeClass, Sizes};
use crate::words::quoted_list;

/// Least standard deviation of radii, over the width of their interval.
const NARROWEST: f64 = 0.01;

/// Least share of random radii in their interval that the normal distribution takes. The others are
/// drawn anew.
const LEAST_TAKEN: f64 = 1e-3;

impl Distribution {
    /// The name, as `sample.sizes` has it.
    fn name(self) -> &'static str {
        let known = Self::NAMES.iter().find(|(_, known)| *known == self);
        known.map_or("", |(name, _)| name)
    }

    /// The keys that apply to it and not to all distributions.
    fn keys(self) -> Vec<&'static Key> {
        let keys = &SAMPLE;
        match self {
            Distribution::Uniform => vec![],
            Distribution::Normal | Distribution::Lognormal => {
                vec![&keys.radius_mean, &keys.radius_deviation]
            }
            Distribution::Power => vec![&keys.radius_exponent],
            Distribution::Table => vec![&keys.sieves, &keys.passing, &keys.passing_by],
            Distribution::Binary => vec![
                &keys.large_fraction,
                &keys.large_fraction_by,
                &keys.large_material,
            ],
            Distribution::List => vec![&keys.radii, &keys.radii_weights],
            Distribution::Given => vec![&keys.radii],
        }
    }
}

/// A key of inserted grains that applies to some distributions of radii only.
pub(super) struct SizeKey {
    pub(super) key: &'static Key,
    /// These distributions.
    applies_to: Vec<Distribution>,
}

impl SizeKey {
    /// All of them, in the order of their declarations.
    pub(super) fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for &key in SampleKeys::TABLE.own {
            let applies_to: Vec<Distribution> = Distribution::NAMES
                .into_iter()
                .map(|(_, distribution)| distribution)
                .filter(|distribution| distribution.keys().iter().any(|own| own.path == key.path))
                .collect();
            if !applies_to.is_empty() {
                all.push(SizeKey { key, applies_to });
            }
        }
        all
    }

    /// The names of the distributions.
    fn names(&self) -> Vec<&'static str> {
        self.applies_to.iter().map(|known| known.name()).collect()
    }
}

/// How many grains are inserted, of which radii.
pub(super) fn check(c: &mut Checker<'_>) -> Sizes {
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
    let sizes = check_distribution(c);
    match &sizes {
        Sizes::Given(radii) => check_count(c, radii.len()),
        _ => {
            c.required_count(&SAMPLE.grains);
        }
    }
    sizes
}

/// The number of grains, if the radius of each is given.
fn check_count(c: &mut Checker<'_>, radii: usize) {
    let key = &SAMPLE.grains;
    match c.whole(key) {
        Some(grains) if grains != radii as i64 => {
            let what = format!(
                "must be the number of sample.radii, {radii}, as each is used once, found {grains}; leave it out"
            );
            c.refuse(key, &what);
        }
        _ => c.fill(key, radii as u64),
    }
}

/// How the radii of inserted grains are distributed.
fn check_distribution(c: &mut Checker<'_>) -> Sizes {
    let keys = &SAMPLE;
    let Some(distribution) = c.named(&keys.sizes, &Distribution::NAMES) else {
        return Sizes::Uniform;
    };
    for size_key in SizeKey::all() {
        if !size_key.applies_to.contains(&distribution) {
            let names = quoted_list(size_key.names(), "and");
            let name = distribution.name();
            let why = format!("applies to sample.sizes = {names}, not to {name:?}");
            c.useless(size_key.key, &why);
        }
    }
    match distribution {
        Distribution::Uniform => Sizes::Uniform,
        Distribution::Normal => Sizes::Normal {
            mean: c.required(&keys.radius_mean),
            deviation: c.required(&keys.radius_deviation),
        },
        Distribution::Lognormal => {
            let mean = c.required(&keys.radius_mean);
            let relative = c.required(&keys.radius_deviation) / mean;
            let square = portable_ln(1.0 + relative * relative);
            Sizes::Lognormal {
                mean: portable_ln(mean) - 0.5 * square,
                deviation: square.sqrt(),
            }
        }
        Distribution::Power => Sizes::Classes(vec![SizeClass {
            share: 1.0,
            between: [&keys.radius_min, &keys.radius_max].map(|key| c.known(key)),
            exponent: c.required(&keys.radius_exponent),
        }]),
        Distribution::Table => Sizes::Classes(check_table(c)),
        Distribution::Binary => Sizes::Binary {
            large_fraction: large_fraction(c),
        },
        Distribution::List => Sizes::List(check_list(c)),
        Distribution::Given => Sizes::Given(c.required_list(&keys.radii, "radius")),
    }
}

/// The radii of a list with their weights, which are 1 if they are not given.
fn check_list(c: &mut Checker<'_>) -> Vec<ListedRadius> {
    let radii = c.required_list(&SAMPLE.radii, "radius");
    let weights = if c.is_given(&SAMPLE.radii_weights) {
        c.required_list(&SAMPLE.radii_weights, "weight")
    } else {
        vec![1.0; radii.len()]
    };
    if weights.len() != radii.len() {
        let what = format!(
            "must hold a weight for each of the {} radii of sample.radii, found {}",
            radii.len(),
            weights.len()
        );
        c.refuse(&SAMPLE.radii_weights, &what);
    }
    let listed = radii.into_iter().zip(weights);
    listed
        .map(|(radius, weight)| ListedRadius { radius, weight })
        .collect()
}

/// The least and the greatest radius (m). Refuses limits that cut off nearly all of the
/// distribution.
pub(super) fn radius_limits(c: &mut Checker<'_>, sizes: &Sizes) -> [f64; 2] {
    let keys = [&SAMPLE.radius_min, &SAMPLE.radius_max];
    let [least, greatest] = match sizes {
        Sizes::List(listed) => extremes(listed.iter().map(|one| one.radius)),
        Sizes::Given(radii) => extremes(radii.iter().copied()),
        Sizes::Classes(classes) if c.is_given(&SAMPLE.sieves) => [
            classes.first().map_or(0.0, |class| class.between[0]),
            classes.last().map_or(0.0, |class| class.between[1]),
        ],
        _ => keys.map(|key| c.known(key)),
    };
    if least > greatest {
        let what = format!(
            "radius_min = {least:?} is greater than radius_max = {greatest:?}; give radius_min <= radius_max"
        );
        c.refuse_among(&keys, &what);
    }
    let limits = [least, greatest];
    if let Some(normal) = TruncatedNormal::new(sizes, limits) {
        normal.check(c);
    }
    limits
}

/// The least and the greatest of these radii (m).
fn extremes(radii: impl Iterator<Item = f64>) -> [f64; 2] {
    radii.fold([f64::INFINITY, 0.0], |[least, greatest], radius| {
        [least.min(radius), greatest.max(radius)]
    })
}

/// A normal distribution of R, or of its logarithm, of which uniform numbers between two limits are
/// drawn until one is taken.
struct TruncatedNormal {
    name: &'static str,
    mean: f64,
    deviation: f64,
    /// The limits of what is drawn.
    limits: [f64; 2],
}

impl TruncatedNormal {
    /// The distribution of R between these limits (m), if it is a normal one.
    fn new(sizes: &Sizes, limits: [f64; 2]) -> Option<Self> {
        match *sizes {
            Sizes::Normal { mean, deviation } => Some(Self {
                name: "normal",
                mean,
                deviation,
                limits,
            }),
            Sizes::Lognormal { mean, deviation } => Some(Self {
                name: "lognormal",
                mean,
                deviation,
                limits: limits.map(portable_ln),
            }),
            _ => None,
        }
    }

    /// Refuses a distribution of which hardly a number is taken.
    fn check(&self, c: &mut Checker<'_>) {
        let mean = c.known(&SAMPLE.radius_mean);
        let deviation = c.known(&SAMPLE.radius_deviation);
        let [from, to] = self.limits;
        let least = NARROWEST * (to - from);
        if from < to && self.deviation < least {
            let least = least * deviation / self.deviation;
            c.refuse(
                &SAMPLE.radius_deviation,
                &format!("must be at least {least:.3e} for radii so far apart, found {deviation:?}; give radius_min and radius_max closer to the mean"),
            );
        } else if self.taken() < LEAST_TAKEN {
            c.refuse_among(
                &[&SAMPLE.radius_min, &SAMPLE.radius_max],
                &format!("the {} distribution about {mean:?} with deviation {deviation:?} has hardly a radius between radius_min and radius_max; give a mean between them", self.name),
            );
        }
    }

    /// The share of uniform numbers between the limits that the distribution takes.
    fn taken(&self) -> f64 {
        let [from, to] = self.limits;
        // About ten of them within the least deviation.
        let sum: f64 = (0..1000)
            .map(|k| {
                let x = from + (to - from) * (f64::from(k) + 0.5) / 1000.0;
                let z = (x - self.mean) / self.deviation;
                portable_exp(-0.5 * z * z)
            })
            .sum();
        sum / 1000.0
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
    let volume_ratio = (small / large).powi(c.dimension.axes() as i32);
    share * volume_ratio / (share * volume_ratio + 1.0 - share)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// What the documentation says of a key is what its check says.
    #[test]
    fn conditions_name_the_distributions_of_a_key() {
        for size_key in SizeKey::all() {
            let condition = size_key.key.condition.split("`\"").skip(1);
            let named: Vec<_> = condition
                .filter_map(|rest| rest.split_once("\"`"))
                .collect();
            let named: Vec<_> = named.iter().map(|(name, _)| *name).collect();
            assert_eq!(named, size_key.names(), "{}", size_key.key.path);
        }
    }
}
