//! Temperatures of the fluctuations: the kinetic energy about the local mean motion, per degree of
//! freedom, of velocities and of spins.
//!
//! The local mean is a linear profile in each of some layers across the height, as thick as a mean
//! diameter of the free grains. So neither a translation nor a shear of the sample counts, nor a
//! wave that is long compared with a layer. Its coefficients are least squares with the masses
//! (moments of inertia) as weights, so that the kinetic energy is that of the profile and that of
//! the fluctuations. With `n` grains in a layer the profile takes two degrees of freedom of each
//! component:
//!
//! ```text
//! T = Σ m |v - V(z)|² / (d Σ_layers (n - 2))
//! ```
//!
//! If every component of every grain has a normal distribution of variance `T/m` about a linear
//! profile, the mean of this is T, however few grains there are in a layer.

use std::ops::Range;

use crate::dimension::Dimension;
use crate::domain::{Accumulator, Exchange, FixedPoint, LIMBS};
use crate::observe::SampleConstants;
use crate::simd::{Lanes, Work};
use crate::state::{Grains, TemperatureRow, body};
use crate::system::System;

/// The greatest number of layers; those of a higher sample are thicker.
const MOST_LAYERS: f64 = 1000.0;
/// Least variance of the heights in a layer, over the square of its thickness, that determines a
/// gradient: disks of a lattice are at one height but for rounding.
const LEAST_VARIANCE: f64 = 1e-12;
/// Sums of weights, and of weighted velocities, of a layer for its profile.
const WEIGHTS: usize = 3;
const SUMS: usize = WEIGHTS + 2 * 3;
/// Integers of the sums of a layer, for velocities and spins, and of its number of grains.
const INTEGERS: usize = 2 * SUMS * (LIMBS + 1) + 1;

/// The scales of the free grains by which sums over them are made exact.
#[derive(Debug, Clone, Copy)]
pub struct Scales {
    /// Mean diameter (m).
    diameter: f64,
    /// Greatest radius (m) and mass (kg; kg/m in 2D).
    radius: f64,
    mass: f64,
}

impl Scales {
    /// Measures the free grains. Collective.
    pub fn measure<D: Dimension>(exchange: &dyn Exchange, system: &System<D>) -> Self {
        let grains = &system.grains;
        let (mut radius, mut mass) = (0.0f64, 0.0f64);
        for g in free(grains, 0..grains.owned) {
            radius = radius.max(grains.radius[g]);
            mass = mass.max(grains.mass[g]);
        }
        let radius = exchange.maximum(radius);
        let mass = exchange.maximum(mass);
        let fixed = FixedPoint::new(radius);
        let mut sum = Accumulator::default();
        let mut count = 0;
        for g in free(grains, 0..grains.owned) {
            fixed.add(&mut sum, grains.radius[g]);
            count += 1;
        }
        let [sum] = fixed.total(exchange, [sum]);
        let count = crate::domain::total(exchange, count);
        Self {
            diameter: 2.0 * sum / count as f64,
            radius,
            mass,
        }
    }
}

/// The free ones of some grains.
#[inline(always)]
fn free<D: Dimension>(grains: &Grains<D>, some: Range<usize>) -> impl Iterator<Item = usize> {
    some.filter(|g| grains.body[*g] == body::FREE)
}

/// Layers of equal thickness from the lowest to the highest free grain.
struct Layers {
    count: usize,
    /// Height at which the first begins (m), and layers per height (1/m).
    low: f64,
    per_height: f64,
}

impl Layers {
    /// As many as there are mean diameters between the centres. Collective.
    fn between<D: Dimension>(exchange: &dyn Exchange, system: &System<D>, diameter: f64) -> Self {
        let extents = system.by_shares(|_, share| {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for g in free(&system.grains, share) {
                let height = system.grains.fields(g)[D::UP];
                low = low.min(height);
                high = high.max(height);
            }
            [low, high]
        });
        let low = extents
            .iter()
            .fold(f64::INFINITY, |low, [l, _]| low.min(*l));
        let high = extents
            .iter()
            .fold(f64::NEG_INFINITY, |high, [_, h]| high.max(*h));
        let low = -exchange.maximum(-low);
        let high = exchange.maximum(high);
        let count = ((high - low) / diameter).round().clamp(1.0, MOST_LAYERS);
        Self {
            count: count as usize,
            low,
            per_height: count / (high - low).max(f64::MIN_POSITIVE),
        }
    }

    /// The layer of a height, and the distance to its middle over its thickness.
    fn place(&self, height: f64) -> (usize, f64) {
        let scaled = (height - self.low) * self.per_height;
        let layer = (scaled as usize).min(self.count - 1);
        (layer, scaled - layer as f64 - 0.5)
    }
}

/// Sums of the weights w of a layer, and of w s and w s² with the distances s to its middle; and
/// of w v and w s v for three components of v.
#[derive(Debug, Clone, Copy, Default)]
struct ProfileSums([Accumulator; SUMS]);

impl ProfileSums {
    #[inline(always)]
    fn add(&mut self, units: &[FixedPoint; 2], weight: f64, s: f64, v: &[f64]) {
        let [ones, velocities] = units;
        let (weights, moments) = self.0.split_at_mut(WEIGHTS);
        for (sum, power) in weights.iter_mut().zip([1.0, s, s * s]) {
            ones.add(sum, weight * power);
        }
        let (zeroth, first) = moments.split_at_mut(3);
        for (axis, v) in v.iter().enumerate() {
            velocities.add(&mut zeroth[axis], weight * v);
            velocities.add(&mut first[axis], weight * s * v);
        }
    }

    fn merge(&mut self, other: &Self) {
        for (sum, more) in self.0.iter_mut().zip(other.0) {
            sum.merge(more);
        }
    }
}

/// Sums of a layer: of the profiles of velocities and spins, and its number of grains.
#[derive(Debug, Clone, Copy, Default)]
struct LayerSums {
    velocities: ProfileSums,
    spins: ProfileSums,
    count: i64,
}

impl LayerSums {
    fn merge(&mut self, other: &Self) {
        self.velocities.merge(&other.velocities);
        self.spins.merge(&other.spins);
        self.count += other.count;
    }

    /// Those of all ranks. Collective.
    fn total(exchange: &dyn Exchange, layers: &mut [Self]) {
        let mut message = vec![0i64; layers.len() * INTEGERS];
        for (layer, integers) in layers.iter().zip(message.chunks_mut(INTEGERS)) {
            let parts = layer.velocities.0.iter().chain(&layer.spins.0);
            for (part, limbs) in parts.zip(integers.chunks_mut(LIMBS + 1)) {
                part.write(limbs);
            }
            integers[INTEGERS - 1] = layer.count;
        }
        exchange.sum(&mut message);
        for (layer, integers) in layers.iter_mut().zip(message.chunks(INTEGERS)) {
            let parts = layer.velocities.0.iter_mut().chain(&mut layer.spins.0);
            for (part, limbs) in parts.zip(integers.chunks(LIMBS + 1)) {
                *part = Accumulator::read(limbs);
            }
            layer.count = integers[INTEGERS - 1];
        }
    }
}

/// A linear profile in a layer, over the distance to its middle.
#[derive(Debug, Clone, Copy)]
struct Profile {
    /// Where it has its mean.
    centre: f64,
    mean: [f64; 3],
    gradient: [f64; 3],
    /// Its coefficients for each component.
    coefficients: u64,
}

impl Profile {
    /// The least-squares profile of `count` grains with these sums.
    fn fit(units: &[FixedPoint; 2], sums: &ProfileSums, count: u64) -> Self {
        let [ones, velocities] = units;
        let value = |at: usize| {
            let unit = if at < WEIGHTS { ones } else { velocities };
            unit.value(sums.0[at])
        };
        let weight = value(0);
        let centre = value(1) / weight;
        let mean: [f64; 3] = std::array::from_fn(|axis| value(WEIGHTS + axis) / weight);
        let variance = value(2) / weight - centre * centre;
        let has_gradient = count > 1 && variance > LEAST_VARIANCE;
        let gradient = std::array::from_fn(|axis| {
            if has_gradient {
                (value(WEIGHTS + 3 + axis) / weight - centre * mean[axis]) / variance
            } else {
                0.0
            }
        });
        Self {
            centre,
            mean,
            gradient,
            coefficients: count.min(1 + u64::from(has_gradient)),
        }
    }

    /// The square of a velocity at a distance to the middle, less the profile's there.
    #[inline(always)]
    fn square_about(&self, s: f64, v: &[f64]) -> f64 {
        let mut square = 0.0;
        for (axis, v) in v.iter().enumerate() {
            let u = v - (self.mean[axis] + self.gradient[axis] * (s - self.centre));
            square += u * u;
        }
        square
    }
}

/// Free grains in layers.
struct Layered<'a, D: Dimension> {
    system: &'a System<D>,
    scales: &'a Scales,
    constants: &'a SampleConstants,
    layers: Layers,
}

impl<D: Dimension> Layered<'_, D> {
    /// The layer of a grain, and the distance to its middle over its thickness.
    #[inline(always)]
    fn place(&self, g: usize) -> (usize, f64) {
        self.layers.place(self.system.grains.fields(g)[D::UP])
    }

    /// The velocity of a grain.
    #[inline(always)]
    fn velocity(&self, g: usize) -> &[f64] {
        &self.system.grains.fields(g)[D::VELOCITY..D::VELOCITY + D::AXES]
    }

    /// The spins of a grain as velocities at the surface of the greatest one: of the same unit.
    #[inline(always)]
    fn surface_velocity(&self, g: usize) -> [f64; 3] {
        let mut surface = [0.0; 3];
        for (axis, surface) in surface[..D::SPINS].iter_mut().enumerate() {
            *surface = self.system.grains.fields(g)[D::SPIN + axis] * self.scales.radius;
        }
        surface
    }

    /// The moment of inertia of a grain over its mass and the square of the greatest radius.
    #[inline(always)]
    fn inertia(&self, g: usize) -> f64 {
        let lever = self.system.grains.radius[g] / self.scales.radius;
        D::INERTIA * lever * lever
    }

    /// Units of weights and of velocities.
    fn units(&self) -> [FixedPoint; 2] {
        [FixedPoint::new(1.0), self.constants.motion]
    }

    /// Sums for the profiles of every layer, over all ranks. Collective.
    fn sums(&self, exchange: &dyn Exchange) -> Vec<LayerSums> {
        let system = self.system;
        let mut sums = vec![LayerSums::default(); self.layers.count];
        for part in system.by_shares(|_, grains| {
            system.isa.run(ProfilePass {
                layered: self,
                grains,
            })
        }) {
            for (layer, more) in sums.iter_mut().zip(&part) {
                layer.merge(more);
            }
        }
        LayerSums::total(exchange, &mut sums);
        sums
    }

    /// Kinetic energies about these profiles, of velocities and of spins, over all ranks (J; J/m in
    /// 2D). Collective.
    fn energies(&self, exchange: &dyn Exchange, profiles: &[[Profile; 2]]) -> [f64; 2] {
        let system = self.system;
        let mut energies = [Accumulator::default(); 2];
        for part in system.by_shares(|_, grains| {
            system.isa.run(EnergyPass {
                layered: self,
                profiles,
                grains,
            })
        }) {
            for (sum, more) in energies.iter_mut().zip(part) {
                sum.merge(more);
            }
        }
        self.constants.energy.total(exchange, energies)
    }
}

/// Sums for the profiles of every layer over some grains.
struct ProfilePass<'a, D: Dimension> {
    layered: &'a Layered<'a, D>,
    grains: Range<usize>,
}

impl<D: Dimension> Work for ProfilePass<'_, D> {
    type Output = Vec<LayerSums>;

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) -> Vec<LayerSums> {
        let Self { layered, grains } = self;
        let units = layered.units();
        let all = &layered.system.grains;
        let mut sums = vec![LayerSums::default(); layered.layers.count];
        for g in free(all, grains) {
            let (layer, s) = layered.place(g);
            let weight = all.mass[g] / layered.scales.mass;
            let surface = layered.surface_velocity(g);
            let layer = &mut sums[layer];
            layer.velocities.add(&units, weight, s, layered.velocity(g));
            let weight = weight * layered.inertia(g);
            layer.spins.add(&units, weight, s, &surface[..D::SPINS]);
            layer.count += 1;
        }
        sums
    }
}

/// Kinetic energies of some grains about the profiles of their layers, of velocities and of spins.
struct EnergyPass<'a, D: Dimension> {
    layered: &'a Layered<'a, D>,
    profiles: &'a [[Profile; 2]],
    grains: Range<usize>,
}

impl<D: Dimension> Work for EnergyPass<'_, D> {
    type Output = [Accumulator; 2];

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) -> [Accumulator; 2] {
        let layered = self.layered;
        let all = &layered.system.grains;
        let energy = &layered.constants.energy;
        let mut energies = [Accumulator::default(); 2];
        for g in free(all, self.grains) {
            let (layer, s) = layered.place(g);
            let [of_velocities, of_spins] = &self.profiles[layer];
            let half = 0.5 * all.mass[g];
            let square = of_velocities.square_about(s, layered.velocity(g));
            energy.add(&mut energies[0], half * square);
            let surface = layered.surface_velocity(g);
            let square = of_spins.square_about(s, &surface[..D::SPINS]);
            energy.add(&mut energies[1], half * layered.inertia(g) * square);
        }
        energies
    }
}

/// A temperature: twice the energy per degree of freedom. NaN without any.
fn per_freedom(energy: f64, components: usize, free: u64) -> f64 {
    if free == 0 {
        f64::NAN
    } else {
        2.0 * energy / (components as f64 * free as f64)
    }
}

/// Temperatures of the free grains, the same bits on any number of ranks and threads. Collective.
pub fn temperatures<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    scales: &Scales,
    constants: &SampleConstants,
) -> TemperatureRow {
    system.finish_step();
    let system = &*system;
    let layered = Layered {
        system,
        scales,
        constants,
        layers: Layers::between(exchange, system, scales.diameter),
    };
    let units = layered.units();
    let mut profiles = Vec::with_capacity(layered.layers.count);
    let mut free = [0u64; 2];
    for layer in layered.sums(exchange) {
        let count = layer.count as u64;
        let both = [&layer.velocities, &layer.spins].map(|sums| Profile::fit(&units, sums, count));
        for (free, profile) in free.iter_mut().zip(&both) {
            *free += count - profile.coefficients;
        }
        profiles.push(both);
    }
    let [of_velocities, of_spins] = layered.energies(exchange, &profiles);
    TemperatureRow {
        granular_temperature: per_freedom(of_velocities, D::AXES, free[0]),
        spin_temperature: per_freedom(of_spins, D::SPINS, free[1]),
    }
}
