//! The sizes of the grains, and their cell.

use gshear_dem::contact::{portable_exp, portable_ln};
use gshear_dem::dimension::Dimensions;
use gshear_dem::state::{Cell, Sheared};

/// Grains in a cell of `length` L_x along x and, in 3D, `width` L_y along y, both periodic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Number of grains N, those of the walls included.
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
    /// L_y (m); infinite in 2D.
    pub width: f64,
    /// L_y/L_x (of spheres) and that of the last axis, of a box of a given solid fraction.
    pub aspect: [f64; 2],
}

impl Sample {
    /// Disks of R uniform in [`radius_min`, `radius_max`]: d̄ = R_min + R_max.
    pub const fn uniform(grains: u32, radius_min: f64, radius_max: f64, length: f64) -> Self {
        let (a, b) = (radius_min, radius_max);
        Self {
            grains,
            radius_min,
            radius_max,
            mean_diameter: a + b,
            mean_volume: std::f64::consts::PI * (a * a + a * b + b * b) / 3.0,
            length,
            width: f64::INFINITY,
            aspect: [1.0; 2],
        }
    }

    /// The cell between walls.
    pub fn cell(&self) -> Cell {
        Cell::between_walls([self.length, self.width])
    }

    /// The sample in a box of this L_x (m) with its ratios of lengths.
    pub fn in_box(self, dimension: Dimensions, length: f64) -> Self {
        let width = match dimension {
            Dimensions::Two => f64::INFINITY,
            Dimensions::Three => length * self.aspect[0],
        };
        Self {
            length,
            width,
            ..self
        }
    }

    /// Lengths (m) along the axes of a box of this L_x (m); the second is 1 in 2D.
    pub fn box_lengths(&self, length: f64) -> [f64; 3] {
        let [width, height] = self.aspect.map(|ratio| length * ratio);
        [length, self.by_dimension(1.0, width), height]
    }

    /// The lengths (m) along the axes of a box of this L_x (m), as many as there are.
    pub fn box_axes(&self, length: f64) -> Vec<f64> {
        let [length, width, height] = self.box_lengths(length);
        self.by_dimension(vec![length, height], vec![length, width, height])
    }

    /// A box of this L_x (m), its images straight above each other.
    pub fn box_cell(&self, length: f64) -> Cell {
        let [length, width, height] = self.box_lengths(length);
        Cell {
            periods: [length, self.by_dimension(f64::INFINITY, width)],
            sheared: Some(Sheared::upright(height)),
        }
    }

    /// The least length of a box (m), in which no grain touches its own image.
    pub fn least_box_length(&self) -> f64 {
        4.4 * self.radius_max
    }

    /// Disks, in a cell without a width, or spheres.
    pub fn dimension(&self) -> Dimensions {
        match self.width {
            f64::INFINITY => Dimensions::Two,
            _ => Dimensions::Three,
        }
    }

    /// One of two values.
    pub(crate) fn by_dimension<T>(&self, disks: T, spheres: T) -> T {
        match self.dimension() {
            Dimensions::Two => disks,
            Dimensions::Three => spheres,
        }
    }

    /// Length of a wall L_x (m), in 3D its area L_x L_y (m²).
    pub fn base(&self) -> f64 {
        self.by_dimension(self.length, self.length * self.width)
    }

    /// d̄ (m), in 3D d̄² (m²): a mean grain carries the force F = P d̄, in 3D P d̄².
    pub fn mean_section(&self) -> f64 {
        self.by_dimension(1.0, self.mean_diameter) * self.mean_diameter
    }
}

/// How the radii of inserted grains are distributed, between the sample's least and greatest.
#[derive(Debug, Clone, PartialEq)]
pub enum Sizes {
    /// Each radius between them is as likely as the others.
    Uniform,
    /// A normal distribution, cut off at both ends.
    Normal {
        /// Its mean before it is cut off (m).
        mean: f64,
        /// Its standard deviation before it is cut off (m).
        deviation: f64,
    },
    /// A normal distribution of ln R, cut off at both ends.
    Lognormal {
        /// Its mean before it is cut off, of R in m.
        mean: f64,
        /// Its standard deviation before it is cut off.
        deviation: f64,
    },
    /// Classes of sizes that follow each other: a power law or a grading curve.
    Classes(Vec<SizeClass>),
    /// The greatest or the least.
    Binary {
        /// Share of the grains that have the greatest.
        large_fraction: f64,
    },
    /// Either of these.
    List(Vec<ListedRadius>),
    /// The radius of every grain (m), each used once.
    Given(Vec<f64>),
}

/// A radius of a list, and how often it is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ListedRadius {
    /// R (m).
    pub radius: f64,
    /// The share of the grains by number that have it, over the sum of all weights.
    pub weight: f64,
}

/// Radii between two bounds, as many of each as R to the power of -`exponent`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SizeClass {
    /// The share of all grains.
    pub share: f64,
    /// The bounds (m).
    pub between: [f64; 2],
    /// α.
    pub exponent: f64,
}

impl SizeClass {
    /// The radius (m) that the part u ∈ [0, 1] of the class is smaller than: with p = 1 - α,
    ///
    /// ```text
    /// R = b (t + u (1-t))^(1/p),  t = (a/b)^p,  or b (a/b)^(1-u) if p = 0
    /// ```
    pub(crate) fn quantile(&self, u: f64) -> f64 {
        let [a, b] = self.between;
        let (p, wide) = (1.0 - self.exponent, portable_ln(a / b));
        if (p * wide).abs() < 1e-9 {
            return b * portable_exp((1.0 - u) * wide);
        }
        let t = if p > 0.0 {
            portable_exp(p * wide)
        } else {
            1.0 / portable_exp(-p * wide)
        };
        let exponent = portable_ln(t + u * (1.0 - t)) / p;
        // Rounding must not make it greater than b.
        (b * portable_exp(exponent.min(0.0))).clamp(a, b)
    }

    /// ⟨f(R)⟩.
    pub fn mean(&self, f: impl Fn(f64) -> f64) -> f64 {
        let [a, b] = self.between;
        let p = 1.0 - self.exponent;
        // Of R^p, one of whose ends is 1.
        let end = if p > 0.0 { b } else { a };
        weighted_by_logarithm(a, b, f, |x| portable_exp(p * (x - portable_ln(end))))
    }
}

impl Sizes {
    /// ⟨f(R)⟩ between these limits (m). Polynomials of third order are exact but for rounding where
    /// R is uniform, binary, a list or given.
    pub fn mean(&self, limits: [f64; 2], f: impl Fn(f64) -> f64) -> f64 {
        let [a, b] = limits;
        match self {
            Sizes::Uniform => weighted(a, b, 2, f, |_| 1.0),
            Sizes::Normal { mean, deviation } => weighted(a, b, 2000, f, |r| {
                let z = (r - mean) / deviation;
                portable_exp(-0.5 * z * z)
            }),
            Sizes::Lognormal { mean, deviation } => weighted_by_logarithm(a, b, f, |x| {
                let z = (x - mean) / deviation;
                portable_exp(-0.5 * z * z)
            }),
            Sizes::Classes(classes) => classes
                .iter()
                .map(|class| class.share * class.mean(&f))
                .sum(),
            Sizes::Binary { large_fraction } => {
                large_fraction * f(b) + (1.0 - large_fraction) * f(a)
            }
            Sizes::List(listed) => {
                let sum: f64 = listed.iter().map(|one| one.weight * f(one.radius)).sum();
                sum / total_weight(listed)
            }
            Sizes::Given(radii) => radii.iter().map(|&r| f(r)).sum::<f64>() / radii.len() as f64,
        }
    }
}

/// The sum of the weights of a list.
pub(crate) fn total_weight(listed: &[ListedRadius]) -> f64 {
    listed.iter().map(|one| one.weight).sum()
}

/// Mean of f over [a, b] with these weights, by Simpson's rule with an even number of intervals.
fn weighted(
    a: f64,
    b: f64,
    intervals: usize,
    f: impl Fn(f64) -> f64,
    weight: impl Fn(f64) -> f64,
) -> f64 {
    let (mut sum, mut all) = (0.0, 0.0);
    for k in 0..=intervals {
        let r = a + (b - a) * k as f64 / intervals as f64;
        let is_end = k == 0 || k == intervals;
        let share = if is_end { 1.0 } else { [2.0, 4.0][k % 2] };
        let w = share * weight(r);
        sum += w * f(r);
        all += w;
    }
    sum / all
}

/// Mean of f(R) over R ∈ [a, b] (m), with these weights of x = ln R per dx.
fn weighted_by_logarithm(
    a: f64,
    b: f64,
    f: impl Fn(f64) -> f64,
    weight: impl Fn(f64) -> f64,
) -> f64 {
    let (from, to) = (portable_ln(a), portable_ln(b));
    weighted(
        from,
        to,
        2000,
        |x| f(b * portable_exp((x - to).min(0.0))),
        weight,
    )
}
