//! The sample: grains inserted without overlap, and walls cut from it.

use std::ops::Range;

use bytemuck::Zeroable;
use rand::RngExt;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::grains::{ListedRadius, Sample, Sizes, total_weight};
use gshear_dem::contact::{portable_exp, portable_ln};
use gshear_dem::state::{GrainState, body};

/// Room for the largest grain, over its diameter.
const ROOM: f64 = 1.05;

/// Columns of grains up to the given radius (m) that have room in a cell of this length (m).
fn columns(length: f64, radius_max: f64) -> u32 {
    ((length / (2.0 * radius_max * ROOM)) as u32).max(1)
}

/// Columns of loosely stacked grains, jittered as far as each grain's cell allows; ids run up
/// column after column. In three dimensions columns that follow each other along y come one after
/// the other.
#[derive(Debug, Clone)]
pub struct Lattice<'a> {
    sample: &'a Sample,
    radii: Radii<'a>,
    /// Columns along x and along y; in two dimensions one.
    columns: [u32; 2],
    /// Of a column (m), along x and along y; none in two dimensions.
    width: [f64; 2],
}

impl<'a> Lattice<'a> {
    /// The lattice on which the grains of a sample are inserted.
    pub fn new(seed: u64, sample: &'a Sample, sizes: &'a Sizes) -> Self {
        let along = columns(sample.length, sample.radius_max);
        let across = sample.by_dimension(1, columns(sample.width, sample.radius_max));
        let width = sample.length / f64::from(along);
        let depth = sample.width / f64::from(across);
        Self {
            sample,
            radii: Radii::drawn(seed, sample, sizes),
            columns: [along, across],
            width: [width, sample.by_dimension(0.0, depth)],
        }
    }

    /// The ids of a column: the first ones hold one more where the grains do not fill the last row.
    fn ids(&self, column: u32) -> Range<u32> {
        self.first_id(column)..self.first_id(column + 1)
    }

    fn first_id(&self, column: u32) -> u32 {
        let all = self.columns[0] * self.columns[1];
        let (rows, longer) = (self.sample.grains / all, self.sample.grains % all);
        column * rows + column.min(longer)
    }

    /// The grains at rest of this rank's share of the columns. Every grain has its own random
    /// stream, so any rank may make it.
    pub fn insert(&self, rank: usize, ranks: usize) -> Vec<GrainState> {
        let all = u64::from(self.columns[0] * self.columns[1]);
        let [first, end] = [rank, rank + 1].map(|r| (all * r as u64 / ranks as u64) as u32);
        (first..end).flat_map(|c| self.column(c)).collect()
    }

    fn column(&self, column: u32) -> Vec<GrainState> {
        let at = [column / self.columns[1], column % self.columns[1]];
        let periods = [self.sample.length, self.sample.width];
        let up = self.sample.dimension().axes() - 1;
        let mut bottom = 0.0;
        let mut grains = Vec::new();
        for id in self.ids(column) {
            let mut uniform = stream(self.radii.seed, id);
            let radius = self.radii.radius(id, &mut uniform);
            let mut position = [0.0; 3];
            for axis in 0..up {
                let width = self.width[axis];
                let free = width - 2.0 * radius;
                let x = width * f64::from(at[axis]) + radius + free * uniform();
                position[axis] = if x < periods[axis] { x } else { 0.0 };
            }
            let gap = 2.0 * radius * (ROOM - 1.0);
            position[up] = bottom + radius + gap * uniform();
            bottom += 2.0 * radius + gap;
            grains.push(GrainState {
                id,
                position,
                radius,
                ..GrainState::zeroed()
            });
        }
        grains
    }
}

/// The radii of the grains of a sample, the same on every rank.
#[derive(Debug, Clone)]
pub struct Radii<'a> {
    seed: u64,
    sample: &'a Sample,
    sizes: &'a Sizes,
    /// R (m) by id, if the list of radii is exact; else empty, and each is drawn.
    exact: Vec<f64>,
}

impl<'a> Radii<'a> {
    /// Drawn grain by grain, unless they are given.
    pub fn drawn(seed: u64, sample: &'a Sample, sizes: &'a Sizes) -> Self {
        let exact = match sizes {
            Sizes::Given(radii) => shuffled(seed, radii.clone()),
            _ => Vec::new(),
        };
        Self {
            seed,
            sample,
            sizes,
            exact,
        }
    }

    /// Of grains in a box: of a binary mixture exactly as many are large as its fraction says.
    pub fn in_box(seed: u64, sample: &'a Sample, sizes: &'a Sizes) -> Self {
        let mut radii = Self::drawn(seed, sample, sizes);
        if let Sizes::Binary { large_fraction } = sizes {
            let mut exact = vec![sample.radius_min; sample.grains as usize];
            exact[..large(sample.grains, *large_fraction)].fill(sample.radius_max);
            radii.exact = shuffled(seed, exact);
        }
        radii
    }

    /// R (m) of a grain; `uniform` returns the numbers of its [`stream`].
    pub fn radius(&self, id: u32, uniform: &mut impl FnMut() -> f64) -> f64 {
        match self.exact.get(id as usize) {
            Some(radius) => *radius,
            None => drawn_radius(self.sample, self.sizes, uniform),
        }
    }
}

/// Radii in an order drawn from the seed, so that those of a sorted list are mixed: ids ascend
/// along x.
fn shuffled(seed: u64, mut radii: Vec<f64>) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    // A stream of random numbers that no grain uses.
    random.set_stream(u64::MAX);
    radii.shuffle(&mut random);
    radii
}

/// R (m) of one grain; `uniform` returns random numbers in [0, 1).
fn drawn_radius(sample: &Sample, sizes: &Sizes, uniform: &mut impl FnMut() -> f64) -> f64 {
    let (a, b) = (sample.radius_min, sample.radius_max);
    match sizes {
        Sizes::Uniform => a + uniform() * (b - a),
        // By rejection: a radius is taken with the probability e^(-z²/2).
        Sizes::Normal { mean, deviation } => loop {
            let r = a + uniform() * (b - a);
            let z = (r - mean) / deviation;
            // 1 - u is not 0.
            if -2.0 * portable_ln(1.0 - uniform()) >= z * z {
                return r;
            }
        },
        Sizes::Lognormal { mean, deviation } => {
            let wide = portable_ln(a / b);
            loop {
                let below = uniform() * wide;
                let z = (portable_ln(b) + below - mean) / deviation;
                if -2.0 * portable_ln(1.0 - uniform()) >= z * z {
                    return (b * portable_exp(below)).clamp(a, b);
                }
            }
        }
        Sizes::Classes(classes) => {
            let mut left = uniform();
            let last = classes.len() - 1;
            for class in &classes[..last] {
                if left < class.share {
                    return class.quantile(left / class.share);
                }
                left -= class.share;
            }
            let class = &classes[last];
            class.quantile((left / class.share).clamp(0.0, 1.0))
        }
        Sizes::Binary { large_fraction } => {
            if uniform() < *large_fraction {
                b
            } else {
                a
            }
        }
        Sizes::List(listed) => listed_radius(listed, uniform()),
        Sizes::Given(_) => unreachable!("given radii are not drawn"),
    }
}

/// The radius (m) of a list that the part u ∈ [0, 1) of its grains, in its order, ends at.
fn listed_radius(listed: &[ListedRadius], u: f64) -> f64 {
    let mut left = u * total_weight(listed);
    // Rounding may leave something beyond the last one.
    let last = listed.len() - 1;
    for one in &listed[..last] {
        if left < one.weight {
            return one.radius;
        }
        left -= one.weight;
    }
    listed[last].radius
}

/// Random numbers in [0, 1) for one grain: first those of its radius, then those of its position.
pub fn stream(seed: u64, id: u32) -> impl FnMut() -> f64 {
    numbered_stream(seed, u64::from(id))
}

fn numbered_stream(seed: u64, number: u64) -> impl FnMut() -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(number);
    move || random.random::<f64>()
}

/// Random numbers in [0, 1) for the material of one grain.
pub(crate) fn material_stream(seed: u64, id: u32) -> impl FnMut() -> f64 {
    numbered_stream(seed, u64::from(id) + (1 << 32))
}

/// Number of large grains of a binary mixture of `grains`.
fn large(grains: u32, large_fraction: f64) -> usize {
    (large_fraction * f64::from(grains)).round() as usize
}

/// The volume (m³; m² in 2D) of all grains of a box, whose radii are those of [`Radii::in_box`].
/// `volume`: of a radius.
pub(crate) fn volume_in_box(
    seed: u64,
    sample: &Sample,
    sizes: &Sizes,
    volume: impl Fn(f64) -> f64,
) -> f64 {
    let count = f64::from(sample.grains);
    if let Sizes::Binary { large_fraction } = sizes {
        let large = large(sample.grains, *large_fraction) as f64;
        if large == large_fraction * count {
            return count * sample.mean_volume;
        }
        return large * volume(sample.radius_max) + (count - large) * volume(sample.radius_min);
    }
    if let Sizes::Given(_) = sizes {
        return count * sample.mean_volume;
    }
    (0..sample.grains)
        .map(|id| volume(drawn_radius(sample, sizes, &mut stream(seed, id))))
        .sum()
}

/// Makes walls of the grains whose centre is within `thickness` (m) of the `planes` (m) across the
/// axis `up`, the lower one first.
pub fn freeze_walls(grains: &mut [GrainState], up: usize, planes: [f64; 2], material: Option<u64>) {
    for g in grains.iter_mut() {
        g.body = if g.position[up] < planes[0] {
            body::BOTTOM
        } else if g.position[up] > planes[1] {
            body::TOP
        } else {
            body::FREE
        };
    }
    finish_walls(grains, material);
}

/// Sets the velocities of wall grains to 0, and gives them their material, if they have one of
/// their own.
pub(crate) fn finish_walls(grains: &mut [GrainState], material: Option<u64>) {
    for g in grains.iter_mut().filter(|g| g.body != body::FREE) {
        g.velocity = [0.0; 3];
        g.angular_velocity = [0.0; 3];
        g.material = material.unwrap_or(g.material);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grains::SizeClass;
    use crate::sample::Origin;
    use crate::{Source, load};
    use gshear_dem::dimension::{Three, Two};

    const SAMPLE: Sample = Sample::uniform(1003, 0.5e-6, 1e-6, 48e-6);

    const SPHERES: Sample = Sample {
        length: 12e-6,
        width: 9e-6,
        ..SAMPLE
    };

    fn distance(sample: &Sample, a: &GrainState, b: &GrainState) -> f64 {
        let r = match sample.width {
            f64::INFINITY => sample.cell().separation::<Two>(&a.position, &b.position),
            _ => sample.cell().separation::<Three>(&a.position, &b.position),
        };
        gshear_dem::state::length(r)
    }

    #[test]
    fn grains_do_not_overlap_and_their_sizes_are_uniform() {
        for (sample, up) in [(&SAMPLE, 1), (&SPHERES, 2)] {
            let grains = Lattice::new(3, sample, &Sizes::Uniform).insert(0, 1);
            assert_eq!(grains.len(), sample.grains as usize);
            for (k, a) in grains.iter().enumerate() {
                assert_eq!(a.id, k as u32);
                assert!(
                    a.position[up] >= a.radius && (0.0..sample.length).contains(&a.position[0])
                );
                for b in &grains[k + 1..] {
                    let least = (a.radius + b.radius) * (1.0 - 1e-12);
                    assert!(distance(sample, a, b) >= least);
                }
            }
            let mean = grains.iter().map(|g| g.radius).sum::<f64>() / grains.len() as f64;
            // Standard error of the mean of 1,003 uniform numbers is 0.0046 µm.
            assert!((mean / 0.75e-6 - 1.0).abs() < 4.0 * 0.0061);
        }
    }

    /// Means and deviations of 1,003 radii within four standard errors of those of the
    /// distributions.
    #[test]
    fn sizes_are_distributed_as_asked_for() {
        let list = listed(&[(0.5e-6, 1.0), (0.6e-6, 1.0), (1e-6, 1.0)]);
        let weighted = listed(&[(0.5e-6, 5.0), (0.6e-6, 0.5), (1e-6, 2.0)]);
        let normal = Sizes::Normal {
            mean: 0.7e-6,
            deviation: 0.1e-6,
        };
        let binary = Sizes::Binary {
            large_fraction: 0.3,
        };
        let lognormal = Sizes::Lognormal {
            mean: f64::ln(0.7e-6),
            deviation: 0.3,
        };
        let class = |share, between: [f64; 2], exponent| SizeClass {
            share,
            between: between.map(|r| r * 1e-6),
            exponent,
        };
        let power = |exponent| Sizes::Classes(vec![class(1.0, [0.5, 1.0], exponent)]);
        let table = vec![
            class(0.5, [0.5, 0.6], 3.0),
            class(0.3, [0.6, 0.8], 1.0),
            class(0.2, [0.9, 1.0], 3.0),
        ];
        let [falls, level, rises] = [2.5, 1.0, -3.0].map(power);
        let curve = Sizes::Classes(table);
        for sizes in [
            Sizes::Uniform,
            normal,
            lognormal,
            falls,
            level,
            rises,
            curve,
            binary,
            list,
            weighted,
        ] {
            let grains = Lattice::new(5, &SAMPLE, &sizes).insert(0, 1);
            let check_mean = |f: fn(f64) -> f64| {
                let n = grains.len() as f64;
                let values = grains.iter().map(|g| f(g.radius / 1e-6));
                let mean = values.clone().sum::<f64>() / n;
                let square = values.map(|x| x * x).sum::<f64>() / n;
                let error = ((square - mean * mean) / n).sqrt();
                let expected = sizes.mean([0.5e-6, 1e-6], |r| f(r / 1e-6));
                assert!(
                    (mean - expected).abs() < 4.0 * error,
                    "{sizes:?}: {mean} {expected}"
                );
            };
            check_mean(|r| r);
            check_mean(|r| r * r);
            check_mean(|r| r * r * r);
        }
    }

    fn listed(radii_and_weights: &[(f64, f64)]) -> Sizes {
        let listed = radii_and_weights.iter();
        Sizes::List(
            listed
                .map(|&(radius, weight)| ListedRadius { radius, weight })
                .collect(),
        )
    }

    /// ⟨R^n⟩ = Σ w_k R_k^n / Σ w_k, and how often each radius is drawn: within four standard
    /// deviations of a binomial distribution, N p ± 4 √(N p (1-p)).
    #[test]
    fn weights_are_shares_by_number() {
        let sizes = listed(&[(0.5e-6, 6.0), (0.75e-6, 3.0), (1e-6, 1.0)]);
        let mean = sizes.mean([0.5e-6, 1e-6], |r| r / 1e-6);
        assert!((mean - 0.625).abs() < 1e-15, "{mean}");
        let cube = sizes.mean([0.5e-6, 1e-6], |r| (r / 1e-6).powi(3));
        assert!((cube - (0.075 + 0.1265625 + 0.1)).abs() < 1e-15, "{cube}");
        let grains = Lattice::new(8, &SAMPLE, &sizes).insert(0, 1);
        let all = grains.len() as f64;
        for (radius, share) in [(0.5e-6, 0.6), (0.75e-6, 0.3), (1e-6, 0.1)] {
            let count = grains.iter().filter(|g| g.radius == radius).count() as f64;
            let deviation = (all * share * (1.0 - share)).sqrt();
            assert!(
                (count - all * share).abs() < 4.0 * deviation,
                "{radius}: {count}"
            );
        }
    }

    /// Equal weights draw the radius ⌊N u⌋, as lists without weights always did.
    #[test]
    fn equal_weights_divide_the_numbers_evenly() {
        for count in [1, 2, 3, 7, 100] {
            let radii: Vec<_> = (0..count).map(|k| (f64::from(k), 1.0)).collect();
            let Sizes::List(listed) = listed(&radii) else {
                unreachable!()
            };
            let mut uniform = stream(1, count);
            for u in (0..10_000)
                .map(|_| uniform())
                .chain([0.0, 1f64.next_down()])
            {
                let part = (u * f64::from(count)) as u32;
                let expected = f64::from(part.min(count - 1));
                assert_eq!(listed_radius(&listed, u), expected, "{count} {u}");
            }
        }
    }

    /// Each given radius is used exactly once, wherever its grain is inserted, and a sorted list is
    /// mixed: the mean of each half is that of a random half of the list, within four standard
    /// deviations σ/√(2n) √(n/(2n-1)) of n out of 2n without replacement.
    #[test]
    fn given_radii_are_used_once_each_in_a_random_order() {
        let given: Vec<f64> = (0..1000).map(|k| 0.5e-6 + 0.5e-9 * f64::from(k)).collect();
        let sizes = Sizes::Given(given.clone());
        for sample in [SAMPLE, SPHERES] {
            let sample = Sample {
                grains: 1000,
                ..sample
            };
            let lattice = Lattice::new(2, &sample, &sizes);
            let whole = lattice.insert(0, 1);
            let shares: Vec<_> = (0..3).flat_map(|r| lattice.insert(r, 3)).collect();
            assert_eq!(whole, shares);
            let mut radii: Vec<f64> = whole.iter().map(|g| g.radius).collect();
            let mean = |radii: &[f64]| radii.iter().sum::<f64>() / radii.len() as f64;
            let deviation = 0.5e-6 / 12f64.sqrt();
            let error = deviation / 500f64.sqrt() * (500.0 / 999f64).sqrt();
            assert!((mean(&radii[..500]) - mean(&given)).abs() < 4.0 * error);
            assert_ne!(radii, given);
            radii.sort_by(f64::total_cmp);
            assert_eq!(radii, given);
            let boxed = Radii::in_box(2, &sample, &sizes);
            let of_box = |id| boxed.radius(id, &mut || unreachable!());
            assert!(whole.iter().all(|g| of_box(g.id) == g.radius));
        }
    }

    /// Of the grains of a scene so much of the mass passes each sieve as its grading curve says.
    #[test]
    fn a_grading_curve_is_one_of_mass_or_number() {
        let (sieves, passing) = ([0.5e-3, 1e-3, 1.5e-3, 2e-3], [0.0, 0.2, 0.2, 1.0]);
        for (dimension, by, power) in [(2, "mass", 2), (3, "mass", 3), (3, "number", 0)] {
            let width = if dimension == 3 { "width = 0.02" } else { "" };
            let law = ["lee-hurley", "hertz-tsuji"][dimension - 2];
            let damping = ["damping_ratio = 0.1", "restitution = 0.9"][dimension - 2];
            let text = format!(
                "dimension = {dimension}
                material = {{ young_modulus = 1e9, poisson_ratio = 0.2, density = 2500.0 }}
                contact = {{ law = '{law}', friction = 0.5, {damping} }}
                load.pressure = 1e5
                shear = {{ inertial_number = 1e-3, strain = 0.01 }}
                [sample]
                grains = 60000
                length = 0.02
                {width}
                sizes = 'table'
                sieves = {sieves:?}
                passing = {passing:?}
                passing_by = '{by}'"
            );
            let scene = load(&Source::new("s", &text), &[]).expect("a scene");
            let Origin::Insertion(sizes) = &scene.plane_shear("s").expect("walls").origin else {
                panic!("not inserted");
            };
            let grains = Lattice::new(9, &scene.sample, sizes).insert(0, 1);
            let volume = |g: &GrainState| (g.radius / 1e-3).powi(power);
            let all: f64 = grains.iter().map(volume).sum();
            // Half way along the logarithm between the last two, too.
            let middle = (1.5e-3f64 * 2e-3).sqrt();
            for (sieve, share) in [(1e-3, 0.2), (1.5e-3, 0.2), (middle, 0.6)] {
                let fine = grains.iter().filter(|g| 2.0 * g.radius < sieve);
                let found = fine.map(volume).sum::<f64>() / all;
                assert!((found - share).abs() < 0.012, "{by}: {found} at {sieve}");
            }
            let mean = grains.iter().map(|g| 2.0 * g.radius).sum::<f64>() / grains.len() as f64;
            let expected = scene.sample.mean_diameter;
            assert!((mean / expected - 1.0).abs() < 0.01, "{mean} {expected}");
        }
    }

    /// ⟨R^n⟩ of R^-α against its closed form, and the radius below which a part of it is.
    #[test]
    fn means_and_quantiles_of_power_laws() {
        for (exponent, n) in [(2.5, 1), (1.0, 2), (4.0, 3), (-3.0, 2)] {
            let class = SizeClass {
                share: 1.0,
                between: [0.3, 2.0],
                exponent,
            };
            // ∫ R^q dR/R between the bounds.
            let integral = |q: f64, to: f64| {
                if q == 0.0 {
                    (to / 0.3f64).ln()
                } else {
                    (to.powf(q) - 0.3f64.powf(q)) / q
                }
            };
            let p = 1.0 - exponent;
            let expected = integral(p + f64::from(n), 2.0) / integral(p, 2.0);
            let mean = class.mean(|r| r.powi(n));
            assert!(
                (mean / expected - 1.0).abs() < 1e-10,
                "{exponent}: {mean} {expected}"
            );
            for part in [0.0, 0.25, 0.5, 0.9, 1.0] {
                let below = integral(p, class.quantile(part)) / integral(p, 2.0);
                assert!((below - part).abs() < 1e-12, "{exponent}: {below} {part}");
            }
        }
    }

    /// The cut normal distribution against its closed form: ⟨R⟩ = μ + σ (φ(α) - φ(β))/(Φ(β) -
    /// Φ(α)), from tables of the normal one.
    #[test]
    fn mean_of_the_cut_normal_distribution() {
        let sizes = Sizes::Normal {
            mean: 1.0,
            deviation: 0.5,
        };
        // α = -1, β = 2: φ = 0.2419707245, 0.0539909665; Φ(2) - Φ(-1) = 0.8185946141.
        let expected = 1.0
            + 0.5 * (0.241_970_724_519_143_37 - 0.053_990_966_513_188_06) / 0.818_594_614_120_363_6;
        assert!((sizes.mean([0.5, 2.0], |r| r) - expected).abs() < 1e-12);
    }

    #[test]
    fn any_share_is_the_same_as_the_whole() {
        for sample in [&SAMPLE, &SPHERES] {
            let lattice = Lattice::new(3, sample, &Sizes::Uniform);
            let whole = lattice.insert(0, 1);
            let shares: Vec<_> = (0..5).flat_map(|r| lattice.insert(r, 5)).collect();
            assert_eq!(whole, shares);
            let other = Lattice::new(4, sample, &Sizes::Uniform);
            assert_ne!(other.insert(0, 1), whole);
        }
    }
}
