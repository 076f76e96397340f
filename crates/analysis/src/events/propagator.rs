//! The propagator of events: mean displacement and change of stress around an event, in the frame
//! of the shear, and its angular harmonics.
//!
//! A local shear strain in an elastic medium displaces what is around it as a quadrupole (Eshelby,
//! Proc. R. Soc. A 241, 376, 1957), in two dimensions, far away and without compression
//!
//! ```text
//! u_r = a sin 2θ / r,   Δσ = b cos 4θ / r²
//! ```
//!
//! with the angle θ from the direction of flow (Picard, Ajdari, Lequeux & Bocquet, Eur. Phys. J. E
//! 15, 371, 2004; Maloney & Lemaître, Phys. Rev. E 74, 016118, 2006). A rotation is the harmonic 0
//! of u_θ, a dilation that of u_r.

use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::state::Cell;
use nalgebra::{SMatrix, SVector};

/// Greatest order of the harmonics.
const HARMONICS: usize = 4;
/// Functions of the direction: 1, and cos mθ and sin mθ for m from 1 on.
const FUNCTIONS: usize = 2 * HARMONICS + 1;
/// Groups of events that are left out in turn for the errors.
const GROUPS: usize = 20;
/// Distance over the mean diameter from which on all grains count for the far field.
pub(super) const FAR: f64 = 3.0;

/// A quantity around an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Displacement away from the event (m).
    Radial,
    /// Displacement about the event, from the direction of flow to that of the gradient (m).
    Tangential,
    /// Change of the shear stress (Pa), positive against the imposed shear.
    Shear,
    /// Change of the pressure (Pa).
    Pressure,
}

impl Quantity {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Radial, Self::Tangential, Self::Shear, Self::Pressure];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Radial => "radial_displacement",
            Self::Tangential => "tangential_displacement",
            Self::Shear => "shear_stress",
            Self::Pressure => "pressure",
        }
    }

    /// Power of 1/r with which it decays far from an event in so many dimensions.
    fn decay(self, axes: usize) -> i32 {
        match self {
            Self::Radial | Self::Tangential => axes as i32 - 1,
            Self::Shear | Self::Pressure => axes as i32,
        }
    }
}

/// What happens to the grains over an event.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// The cell at its start.
    pub cell: Cell,
    /// `[N]` Places at its start (m).
    pub place: Vec<[f64; 3]>,
    /// `[N]` Non-affine displacements (m).
    pub displacement: Vec<[f64; 3]>,
    /// `[N]` Change of the shear stress (Pa).
    pub shear: Vec<f64>,
    /// `[N]` Change of the pressure (Pa).
    pub pressure: Vec<f64>,
    /// `[N]` Whether a grain counts.
    pub included: Vec<bool>,
}

/// A harmonic of a quantity in a ring around the events, with standard errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Harmonic {
    /// The quantity.
    pub quantity: Quantity,
    /// Whether the ring is that of the far field, from three mean diameters on.
    pub is_far: bool,
    /// Inner and outer radius of the ring (m).
    pub ring: [f64; 2],
    /// The distance at which it has these amplitudes (m).
    pub at: f64,
    /// m.
    pub order: usize,
    /// Amplitude of cos mθ, and its error.
    pub cos: [f64; 2],
    /// Amplitude of sin mθ, and its error; 0 for m = 0.
    pub sin: [f64; 2],
    /// Number of grains in the ring, of all events together.
    pub grains: u64,
}

/// Which of its two amplitudes a harmonic has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Of cos mθ.
    Cos,
    /// Of sin mθ.
    Sin,
}

/// A quantity, the order of a harmonic, and one of its amplitudes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mode {
    /// The quantity.
    pub quantity: Quantity,
    /// m.
    pub order: usize,
    /// cos mθ or sin mθ.
    pub phase: Phase,
}

impl Mode {
    /// Its amplitude with the standard error, if the harmonic is of this quantity and order.
    pub fn amplitude(&self, harmonic: &Harmonic) -> Option<[f64; 2]> {
        if (harmonic.quantity, harmonic.order) != (self.quantity, self.order) {
            return None;
        }
        Some(match self.phase {
            Phase::Cos => harmonic.cos,
            Phase::Sin => harmonic.sin,
        })
    }
}

/// A square of the map of means around the events.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MapCell {
    /// Its centre from the event, along the flow and the gradient (m).
    pub place: [f64; 2],
    /// Mean displacement along the flow and the gradient (m).
    pub displacement: [f64; 2],
    /// Mean change of the shear stress (Pa).
    pub shear: f64,
    /// Mean change of the pressure (Pa).
    pub pressure: f64,
    /// Number of grains.
    pub grains: u64,
}

/// Sums over the grains in a ring.
#[derive(Debug, Clone, Copy)]
struct Sums {
    grains: u64,
    /// Products of the functions, for displacements and for stresses.
    products: [SMatrix<f64, FUNCTIONS, FUNCTIONS>; 2],
    /// Products of the functions and the values, by [`Quantity`].
    values: [SVector<f64, FUNCTIONS>; 4],
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            grains: 0,
            products: [SMatrix::zeros(); 2],
            values: [SVector::zeros(); 4],
        }
    }
}

impl Sums {
    fn plus(&self, other: &Self, sign: f64) -> Self {
        let mut sum = *self;
        for (sum, other) in sum.products.iter_mut().zip(&other.products) {
            *sum += sign * other;
        }
        for (sum, other) in sum.values.iter_mut().zip(&other.values) {
            *sum += sign * other;
        }
        sum
    }

    /// The amplitudes of least squares; NaN if they are not determined.
    fn amplitudes(&self, quantity: Quantity) -> SVector<f64, FUNCTIONS> {
        let products = &self.products[set_of(quantity)];
        let scale = products.diagonal().max();
        let cholesky = products.cholesky().filter(|found| {
            let pivots = found.l_dirty().diagonal().map(|x| x * x);
            pivots.min() > 1e-9 * scale
        });
        match cholesky {
            Some(found) => found.solve(&self.values[quantity as usize]),
            None => SVector::repeat(f64::NAN),
        }
    }
}

/// Which of the two sets of functions a quantity has.
fn set_of(quantity: Quantity) -> usize {
    match quantity {
        Quantity::Radial | Quantity::Tangential => 0,
        Quantity::Shear | Quantity::Pressure => 1,
    }
}

/// Means around events.
///
/// Values v in a ring are fitted by least squares by
///
/// ```text
/// v = Σ_m s^m (c_m cos mθ + s_m sin mθ) (r₀/r)^p
/// ```
///
/// with r₀ the middle of the ring, and the power p of a far field: D - 1 for displacements and D
/// for stresses in D dimensions, but 0 in the innermost ring. θ is the angle in the plane of flow
/// and gradient from the flow, and s the sine of the angle to the vorticity axis (1 in two
/// dimensions): harmonics of the sphere about that axis. All grains of all events count alike.
///
/// Standard errors are those of the jackknife over groups of consecutive events.
#[derive(Debug, Clone)]
pub struct Propagator {
    dimension: Dimensions,
    /// Width of the rings (m).
    width: f64,
    /// Number of rings.
    rings: usize,
    events: usize,
    /// `[groups][rings + 1]`; the last one is of the far field.
    sums: Vec<Vec<Sums>>,
    /// Squares of the map, row by row.
    map: Vec<MapCell>,
}

impl Propagator {
    /// Of a number of events, in rings and squares of this `width` (m), up to `reach` (m).
    pub fn new(dimension: Dimensions, events: usize, width: f64, reach: f64) -> Self {
        let rings = ((reach / width) as usize).max(1);
        let side = 2 * rings;
        let map = (0..side * side).map(|k| MapCell {
            place: [k % side, k / side].map(|at| (at as f64 - rings as f64 + 0.5) * width),
            ..MapCell::default()
        });
        Self {
            dimension,
            width,
            rings,
            events,
            sums: vec![vec![Sums::default(); rings + 1]; events.clamp(1, GROUPS)],
            map: map.collect(),
        }
    }

    /// Adds what happens around an event. `number`: of the event, less than their number; `place`:
    /// its centre (m).
    pub fn add(&mut self, number: usize, place: [f64; 3], change: &Change) {
        match self.dimension {
            Dimensions::Two => self.add_in::<Two>(number, place, change),
            Dimensions::Three => self.add_in::<Three>(number, place, change),
        }
    }

    fn add_in<D: Dimension>(&mut self, number: usize, centre: [f64; 3], change: &Change) {
        let group = number * self.sums.len() / self.events.max(1);
        let far = FAR * self.width;
        let reach = self.rings as f64 * self.width;
        for (n, place) in change.place.iter().enumerate() {
            if !change.included[n] {
                continue;
            }
            let r = change.cell.separation::<D>(place, &centre);
            let u = change.displacement[n];
            let [flow, gradient] = [r[0], r[D::UP]];
            let across = flow.hypot(gradient);
            let distance = gshear_dem::state::length(r);
            if distance >= reach.hypot(reach) || distance == 0.0 {
                continue;
            }
            // In three dimensions of the slice around the plane of flow and gradient.
            if D::AXES == 2 || r[1].abs() < self.width {
                self.add_to_map([flow, gradient], [u[0], u[D::UP]], change, n);
            }
            if distance >= reach {
                continue;
            }
            let radial = (0..D::AXES).map(|k| u[k] * r[k]).sum::<f64>() / distance;
            let tangential = if across > 0.0 {
                (u[D::UP] * flow - u[0] * gradient) / across
            } else {
                0.0
            };
            let values = [radial, tangential, change.shear[n], change.pressure[n]];
            let angular = functions([flow / distance, gradient / distance]);
            let ring = ((distance / self.width) as usize).min(self.rings - 1);
            // The far field has no meaning in the innermost ring, which holds the event itself.
            let closeness = if ring == 0 {
                1.0
            } else {
                self.middle(ring) / distance
            };
            self.sums[group][ring].add(D::AXES, &angular, closeness, values);
            if distance >= far {
                let at = self.middle(self.rings);
                self.sums[group][self.rings].add(D::AXES, &angular, at / distance, values);
            }
        }
    }

    fn add_to_map(&mut self, at: [f64; 2], displacement: [f64; 2], change: &Change, n: usize) {
        let side = 2 * self.rings;
        let [column, row] = at.map(|x| (x / self.width).floor() + self.rings as f64);
        let within = 0.0..side as f64;
        if !within.contains(&column) || !within.contains(&row) {
            return;
        }
        let cell = &mut self.map[row as usize * side + column as usize];
        cell.grains += 1;
        let weight = 1.0 / cell.grains as f64;
        for (mean, value) in cell.displacement.iter_mut().zip(displacement) {
            *mean += weight * (value - *mean);
        }
        cell.shear += weight * (change.shear[n] - cell.shear);
        cell.pressure += weight * (change.pressure[n] - cell.pressure);
    }

    /// Inner and outer radius of a ring (m); the last one is of the far field.
    fn ring(&self, ring: usize) -> [f64; 2] {
        if ring == self.rings {
            return [FAR * self.width, self.rings as f64 * self.width];
        }
        [ring as f64 * self.width, (ring + 1) as f64 * self.width]
    }

    fn middle(&self, ring: usize) -> f64 {
        let [inner, outer] = self.ring(ring);
        f64::midpoint(inner, outer)
    }

    /// Returns the harmonics of all quantities in all rings, and last of the far field, which is
    /// missing if no ring reaches it. NaN where they are not determined; so are errors of one
    /// event.
    pub fn harmonics(&self) -> Vec<Harmonic> {
        let last = if self.rings as f64 > FAR {
            self.rings
        } else {
            self.rings - 1
        };
        let mut found = Vec::new();
        for ring in 0..=last {
            let groups: Vec<&Sums> = self.sums.iter().map(|group| &group[ring]).collect();
            let total = groups.iter().fold(Sums::default(), |sum, group| Sums {
                grains: sum.grains + group.grains,
                ..sum.plus(group, 1.0)
            });
            for quantity in Quantity::ALL {
                let amplitudes = total.amplitudes(quantity);
                let without: Vec<_> = (groups.iter())
                    .map(|group| total.plus(group, -1.0).amplitudes(quantity))
                    .collect();
                let errors = jackknife(&without);
                for order in 0..=HARMONICS {
                    let cos = (2 * order).saturating_sub(1);
                    let mut sin = [0.0; 2];
                    if order > 0 {
                        sin = [amplitudes[2 * order], errors[2 * order]];
                    }
                    found.push(Harmonic {
                        quantity,
                        is_far: ring == self.rings,
                        ring: self.ring(ring),
                        at: self.middle(ring),
                        order,
                        cos: [amplitudes[cos], errors[cos]],
                        sin,
                        grains: total.grains,
                    });
                }
            }
        }
        found
    }

    /// Returns the map of means: squares with grains, row by row.
    pub fn map(&self) -> impl Iterator<Item = &MapCell> {
        self.map.iter().filter(|cell| cell.grains > 0)
    }
}

impl Sums {
    /// Adds a grain. `closeness`: r₀/r.
    fn add(
        &mut self,
        axes: usize,
        angular: &SVector<f64, FUNCTIONS>,
        closeness: f64,
        values: [f64; 4],
    ) {
        self.grains += 1;
        let scaled = [Quantity::Radial, Quantity::Shear]
            .map(|quantity| angular * closeness.powi(quantity.decay(axes)));
        for (products, functions) in self.products.iter_mut().zip(&scaled) {
            *products += functions * functions.transpose();
        }
        for quantity in Quantity::ALL {
            let k = quantity as usize;
            self.values[k] += scaled[set_of(quantity)] * values[k];
        }
    }
}

/// 1, s cos θ, s sin θ, s² cos 2θ, … of a direction: its components along the flow, s cos θ, and
/// the gradient, s sin θ.
fn functions(direction: [f64; 2]) -> SVector<f64, FUNCTIONS> {
    let [x, y] = direction;
    let mut functions = SVector::zeros();
    functions[0] = 1.0;
    let (mut cos, mut sin) = (1.0, 0.0);
    for order in 1..=HARMONICS {
        (cos, sin) = (cos * x - sin * y, cos * y + sin * x);
        functions[2 * order - 1] = cos;
        functions[2 * order] = sin;
    }
    functions
}

/// Standard errors from the amplitudes without each of the groups.
fn jackknife(without: &[SVector<f64, FUNCTIONS>]) -> SVector<f64, FUNCTIONS> {
    let groups = without.len() as f64;
    if without.len() < 2 {
        return SVector::repeat(f64::NAN);
    }
    let mean = without.iter().sum::<SVector<f64, FUNCTIONS>>() / groups;
    let squares = without.iter().map(|found| (found - mean).map(|x| x * x));
    let variance = squares.sum::<SVector<f64, FUNCTIONS>>() * ((groups - 1.0) / groups);
    variance.map(f64::sqrt)
}
