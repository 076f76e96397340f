//! Temperatures of fluctuations: closed forms of motions whose fluctuations are known.

use crate::common::{Rig, SPACING, Vector, dot, gas, gas_law, random, setup};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::fluctuations::{Scales, temperatures};
use gshear_dem::laws::LawSpace;
use gshear_dem::observe::SampleConstants;
use gshear_dem::state::{GrainState, TemperatureRow};

/// Grains along every axis: few enough in a layer for the degrees of freedom of its profile to
/// count.
const SIDE: usize = 6;

/// Temperatures of grains as they are, on so many threads.
fn measured_on<D: LawSpace>(threads: usize, grains: Vec<GrainState>) -> TemperatureRow {
    let mut setup = setup::<D>(SIDE, 0.0, (0.1, 0));
    setup.threads = threads;
    let mut rig = Rig::<D>::new(setup, gas_law(), NoWalls, (grains, Vec::new()));
    let system = &mut rig.system;
    let scales = Scales::measure(&Solo, system);
    let constants = SampleConstants::measure(&Solo, system, 0.0, 1e-6);
    temperatures(&Solo, system, &scales, &constants)
}

/// Temperatures of grains as they are.
fn measured<D: LawSpace>(grains: Vec<GrainState>) -> TemperatureRow {
    measured_on::<D>(1, grains)
}

/// The gas, with these velocities and spins at every height over the spacing.
fn streaming<D: Dimension>(of: impl Fn(f64) -> [Vector; 2]) -> Vec<GrainState> {
    let mut grains = gas::<D>(SIDE, 0.5, 3);
    for grain in &mut grains {
        let [velocity, spin] = of(grain.position[D::UP] / SPACING);
        let [v, w] = components::<D>(velocity, spin);
        (grain.velocity, grain.angular_velocity) = (v, w);
    }
    grains
}

/// The components that there are.
fn components<D: Dimension>(mut velocity: Vector, spin: Vector) -> [Vector; 2] {
    velocity[D::AXES..].fill(0.0);
    let mut there = [0.0; 3];
    there[3 - D::SPINS..].copy_from_slice(&spin[3 - D::SPINS..]);
    [velocity, there]
}

/// The greatest mass (kg; kg/m in 2D) and moment of inertia.
fn inertia<D: Dimension>(grain: &GrainState) -> [f64; 2] {
    let mass = 2500.0 * D::volume(grain.radius);
    [mass, D::INERTIA * mass * grain.radius * grain.radius]
}

fn translation_and_shear<D: LawSpace>() {
    for gradient in [0.0, 3.0] {
        let grains = streaming::<D>(|z| {
            let at = |value: f64| value * (1.0 + gradient * z);
            [[at(2.0), -1.0, at(0.5)], [40.0, -30.0, at(500.0)]]
        });
        let [mass, moment] = inertia::<D>(&grains[0]);
        let found = measured::<D>(grains);
        // Rounding of velocities of 40 m/s and spins of 1e4 /s: 1e-15 of them.
        assert!(
            found.granular_temperature <= 1e-27 * mass * 1600.0,
            "{found:?}"
        );
        assert!(found.spin_temperature <= 1e-27 * moment * 1e8, "{found:?}");
    }
}

#[test]
fn translation_and_shear_have_no_temperature() {
    translation_and_shear::<Two>();
    translation_and_shear::<Three>();
}

/// Two numbers of a normal distribution of variance 1 (Box and Muller).
fn normal(random: &mut impl FnMut() -> f64) -> [f64; 2] {
    let [radius, angle] = [random(), random()].map(|x| 0.5 * (x + 1.0));
    let radius = (-2.0 * (1.0 - radius).ln()).sqrt();
    let (sine, cosine) = (std::f64::consts::TAU * angle).sin_cos();
    [radius * cosine, radius * sine]
}

/// The mean over many samples of velocities and spins of these temperatures, on a shear.
fn maxwellian<D: LawSpace>() {
    const SAMPLES: u32 = 100;
    let expected = [2e-6, 5e-7];
    let mut random = random(7);
    let mut means = [0.0; 2];
    for _ in 0..SAMPLES {
        let mut grains = streaming::<D>(|z| [[2.0 * z, 0.0, 0.0], [0.0, 0.0, -100.0]]);
        for grain in &mut grains {
            let inertia = inertia::<D>(grain);
            let mut more = [[0.0; 3]; 2];
            for (kind, more) in more.iter_mut().enumerate() {
                let width = (expected[kind] / inertia[kind]).sqrt();
                let [[x, y], [z, _]] = [normal(&mut random), normal(&mut random)];
                *more = [x, y, z].map(|x| width * x);
            }
            let [velocity, spin] = components::<D>(more[0], more[1]);
            for (sum, more) in grain.velocity.iter_mut().zip(velocity) {
                *sum += more;
            }
            for (sum, more) in grain.angular_velocity.iter_mut().zip(spin) {
                *sum += more;
            }
        }
        let found = measured::<D>(grains);
        means[0] += found.granular_temperature / f64::from(SAMPLES);
        means[1] += found.spin_temperature / f64::from(SAMPLES);
    }
    // The variance of a square sum of n normal deviates is 2n; a profile takes two in a layer.
    let per_layer = SIDE.pow(D::UP as u32) - 2;
    for (kind, components) in [D::AXES, D::SPINS].into_iter().enumerate() {
        let freedom = (components * SIDE * per_layer) as f64 * f64::from(SAMPLES);
        let error = (2.0 / freedom).sqrt();
        let ratio = means[kind] / expected[kind];
        // Without the degrees of freedom of the profiles it were 2/per_layer of 1 below.
        assert!((ratio - 1.0).abs() < 4.0 * error, "{ratio} ± {error}");
        assert!(
            4.0 * error < 1.0 / (per_layer + 2) as f64,
            "too few samples"
        );
    }
}

#[test]
fn maxwellian_velocities_and_spins_have_their_temperatures() {
    maxwellian::<Two>();
    maxwellian::<Three>();
}

/// Of a sine profile, piecewise lines of length h leave the share (kh)⁴/720 of its square.
#[test]
fn long_waves_hardly_count() {
    let k = std::f64::consts::TAU / SIDE as f64;
    let grains = streaming::<Three>(|z| [[0.0, 0.0, (k * z).sin()], [0.0; 3]]);
    let energy: f64 = grains
        .iter()
        .map(|grain| inertia::<Three>(grain)[0] * dot(grain.velocity, grain.velocity))
        .sum();
    let as_a_whole = energy / (3 * grains.len()) as f64;
    let found = measured::<Three>(grains).granular_temperature / as_a_whole;
    let bound = k.powi(4) / 720.0;
    assert!(found > 0.0 && found < 4.0 * bound, "{found:e} {bound:e}");
}

/// Grains of one height in a layer determine no gradient: the mean alone is taken.
#[test]
fn layers_of_one_height_have_a_mean_alone() {
    let mut grains = gas::<Two>(SIDE, 0.5, 3);
    let mut square = 0.0;
    for layer in 0..SIDE {
        let row = &mut grains[layer * SIDE..][..SIDE];
        for grain in row.iter_mut() {
            grain.position[1] = (layer as f64 + 0.5) * SPACING;
        }
        let masses = || row.iter().map(|grain| inertia::<Two>(grain)[0]);
        let total: f64 = masses().sum();
        for axis in 0..2 {
            let velocities = || row.iter().map(|grain| grain.velocity[axis]);
            let momentum: f64 = masses().zip(velocities()).map(|(m, v)| m * v).sum();
            let about = |v: f64| (v - momentum / total) * (v - momentum / total);
            square += masses()
                .zip(velocities())
                .map(|(m, v)| m * about(v))
                .sum::<f64>();
        }
    }
    let expected = square / (2 * SIDE * (SIDE - 1)) as f64;
    let found = measured::<Two>(grains).granular_temperature;
    // A layer holds one row at most: rows are farther apart than a mean diameter.
    assert!(
        (found / expected - 1.0).abs() < 1e-12,
        "{found:e} {expected:e}"
    );
}

#[test]
fn threads_do_not_change_a_bit() {
    let of = |threads| {
        (
            measured_on::<Two>(threads, gas::<Two>(SIDE, 0.5, 3)),
            measured_on::<Three>(threads, gas::<Three>(SIDE, 0.5, 3)),
        )
    };
    let (disks, spheres) = of(1);
    let both = [disks.granular_temperature, spheres.granular_temperature];
    assert!(both.iter().all(|t| *t > 0.0), "{both:?}");
    assert_eq!(of(3), (disks, spheres));
}
