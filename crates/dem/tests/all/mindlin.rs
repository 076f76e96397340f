//! The smoothed Mindlin law: values by hand, closed forms of an impact, energies, order in Δt.

use gshear_dem::contact::{Blocks, CARRY, ContactLaw, PairMotion, Response, dissipation};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::laws::mindlin::Mindlin;
use gshear_dem::laws::mindlin::MindlinSprings;
use gshear_dem::simd::{LANES, Lanes16, Portable, PortableToken};
use gshear_dem::state::Masses;

use crate::common::{Rig, Vector, frictional, minus, norm};

/// In BO's units: k_n = 1, m = 1, the small spheres' diameter 1.
const SPRINGS: MindlinSprings = MindlinSprings {
    normal_stiffness: 1.0,
    tangential_stiffness: 2.0 / 7.0,
    masses: Masses::Equal(1.0),
};
const RADII: [f64; 2] = [0.5, 0.7];

/// One evaluation: F_n, F_t, history, sliding, losses. `deeper`: by how much the overlap has grown
/// in the step.
fn evaluate<D: Dimension>(
    friction: f64,
    overlap: f64,
    deeper: f64,
    history: Vector,
    slip: Vector,
) -> (f64, Vector, Vector, bool, [f64; dissipation::KINDS]) {
    let law = Mindlin::<D, true>::new(&SPRINGS, &frictional(friction));
    let splat = |v: f64| Lanes16([v; LANES]);
    let mut lanes = history.map(splat);
    let mut response = [Response::default()];
    law.evaluate::<Portable, true>(
        PortableToken,
        &mut Blocks {
            parameters: &[],
            history: &mut lanes[..D::SPINS],
            per_step: 0.0,
            turning: &mut [],
            motion: &[PairMotion {
                overlap: splat(overlap),
                normal_increment: splat(-deeper),
                tangential_increment: slip.map(splat),
                ..PairMotion::default()
            }],
            carry: &mut [[Lanes16::ZERO; CARRY]],
            response: &mut response,
            jumps: &[],
        },
    );
    let [r] = response;
    let mut tangential = r.tangential.map(|lanes| lanes.0[3]);
    let mut after = lanes.map(|lanes| lanes.0[3]);
    for k in D::SPINS..3 {
        (tangential[k], after[k]) = (0.0, 0.0);
    }
    let dissipated = r.dissipated.map(|lanes| lanes.0[3]);
    (r.normal.0[3], tangential, after, r.sliding != 0, dissipated)
}

fn close(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() <= 4e-15 * expected.abs(),
        "{found:e} is not {expected:e}"
    );
}

/// δ = 0.04, μ = 0.5: √δ = 0.2, t* = 0.5 · 3.5 · 0.04 = 0.07, k_t √δ = 2/35, F_n = 0.008.
#[test]
fn values_by_hand() {
    // |t|/t* and 1 + s - s².
    for (s, factor) in [
        (0.1, 1.09),
        (0.5, 1.25),
        (0.9, 1.09),
        (-0.3, 1.21),
        (0.0, 1.0),
    ] {
        let t = 0.07 * s;
        let expected = -(2.0 / 35.0) * factor * t;
        let (normal, f, history, sliding, _) =
            evaluate::<Two>(0.5, 0.04, 0.0, [0.4 * t, 0.0, 0.0], [0.6 * t, 0.0, 0.0]);
        close(normal, 0.008);
        close(f[0], expected);
        close(history[0], t);
        assert!(!sliding);
        // The same along a direction in space.
        let along = [2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0];
        let (normal, f, history, sliding, _) = evaluate::<Three>(
            0.5,
            0.04,
            0.0,
            along.map(|n| 0.4 * t * n),
            along.map(|n| 0.6 * t * n),
        );
        close(normal, 0.008);
        assert!(!sliding);
        for k in 0..3 {
            close(f[k], expected * along[k]);
            close(history[k], t * along[k]);
        }
    }
}

/// From |t| = t* on |F_t| = μF_n, and t stays at t*.
#[test]
fn exact_saturation() {
    for s in [1.001, 2.0, 50.0] {
        let (normal, f, history, sliding, _) =
            evaluate::<Two>(0.5, 0.04, 0.0, [0.0; 3], [-0.07 * s, 0.0, 0.0]);
        assert!(sliding);
        close(f[0], 0.5 * normal);
        close(history[0], -0.07);
        let (normal, f, history, sliding, _) =
            evaluate::<Three>(0.5, 0.04, 0.0, [0.0; 3], [0.042 * s, 0.0, -0.056 * s]);
        assert!(sliding);
        close(f[0], -0.6 * 0.5 * normal);
        close(f[2], 0.8 * 0.5 * normal);
        assert_eq!(f[1], 0.0);
        close(history[0], 0.042);
        close(history[2], -0.056);
    }
    // An overlap that shrinks lowers the limit of a contact that does not move.
    let (_, _, history, sliding, _) = evaluate::<Two>(0.5, 0.02, -0.02, [0.06, 0.0, 0.0], [0.0; 3]);
    assert!(sliding);
    close(history[0], 0.035);
    // Nothing is left of a contact that has opened.
    let (_, _, history, ..) = evaluate::<Three>(0.5, -0.02, -0.06, [0.06, 0.0, 0.0], [0.0; 3]);
    assert_eq!(history, [0.0; 3]);
}

/// U(δ, t) = k_t √δ t² (1/2 + s/3 - s²/4), μ = 0.5.
fn stored(overlap: f64, t: f64) -> f64 {
    let s = t.abs() / (0.5 * 3.5 * overlap);
    2.0 / 7.0 * overlap.sqrt() * t * t * (0.5 + s / 3.0 - s * s / 4.0)
}

/// At constant δ nothing is dissipated before sliding, and then μF_n per length; under a t that
/// stays what is stored changes with δ, which is the loss.
#[test]
fn energies_lost() {
    let legs = |steps: usize| {
        let n = steps as f64;
        let mut dissipated = [0.0; 3];
        let mut t = [0.0; 3];
        let mut leg = |part: usize, overlap: &dyn Fn(f64) -> f64, slip: f64| {
            for k in 1..=steps {
                let (now, last) = (overlap(k as f64 / n), overlap((k as f64 - 1.0) / n));
                let slip = [slip / n, 0.0, 0.0];
                let (_, _, after, _, of) = evaluate::<Two>(0.5, now, now - last, t, slip);
                t = after;
                dissipated[part] += of[dissipation::FRICTION] + of[dissipation::STIFFNESS];
            }
        };
        leg(0, &|_| 0.04, 0.05);
        leg(1, &|part| 0.04 + 0.02 * part, 0.0);
        leg(2, &|_| 0.06, 0.2);
        dissipated
    };
    let (coarse, fine) = (legs(200), legs(400));
    let sliding = 0.05 + 0.2 - 0.5 * 3.5 * 0.06;
    let expected = [
        0.0,
        stored(0.04, 0.05) - stored(0.06, 0.05),
        0.5 * 0.06f64.powf(1.5) * sliding,
    ];
    for k in 0..3 {
        let errors = [coarse, fine].map(|dissipated| (dissipated[k] - expected[k]).abs());
        assert!(errors[1] < 1e-5 * expected[2], "leg {k}: {errors:?}");
        assert!(
            errors[1] <= 0.3 * errors[0] || errors[1] < 1e-15,
            "leg {k}: {errors:?}"
        );
    }
}

fn couple<D: Dimension>(friction: f64, step: f64, of: [[Vector; 3]; 2]) -> Rig<D> {
    let law = Mindlin::<D, true>::new(&SPRINGS, &frictional(friction));
    Rig::couple(Box::new(law), (SPRINGS.masses, step), RADII, of, Vec::new())
}

/// Peak overlap (5m*v²/(4k_n))^(2/5), all energy back, and 2.9432 δ_max/v for the time.
#[test]
fn a_head_on_impact() {
    const SPEED: f64 = 0.02;
    // Two equal masses of 1, whatever their radii.
    let deepest = (1.25 * 0.5 * SPEED * SPEED).powf(0.4);
    let time = 2.943_275_194_3 * deepest / SPEED;
    let of = [
        [[-RADII[0], 0.0, 0.0], [0.5 * SPEED, 0.0, 0.0], [0.0; 3]],
        [[RADII[1], 0.0, 0.0], [-0.5 * SPEED, 0.0, 0.0], [0.0; 3]],
    ];
    let errors = [1000, 2000].map(|steps| {
        let step = time / f64::from(steps);
        let mut pair = couple::<Three>(0.5, step, of);
        let (mut peak, mut energy, mut steps) = (0.0f64, 0.0f64, 0);
        loop {
            pair.advance();
            let [a, b] = [0, 1].map(|g| pair.system.grains().state(g));
            let overlap = 1.2 - (b.position[0] - a.position[0]);
            let kinetic = 0.5 * (a.velocity[0].powi(2) + b.velocity[0].powi(2));
            if overlap < 0.0 {
                let parted = b.velocity[0] - a.velocity[0];
                let took = f64::from(steps) * step;
                assert!((took / time - 1.0).abs() < 4e-3, "{took} is not {time}");
                break [peak / deepest - 1.0, energy, parted / SPEED - 1.0];
            }
            let whole = kinetic + 0.4 * overlap.powf(2.5);
            energy = energy.max((whole / (0.25 * SPEED * SPEED) - 1.0).abs());
            peak = peak.max(overlap);
            steps += 1;
        }
        .map(f64::abs)
    });
    for (k, fine) in errors[1].iter().enumerate() {
        assert!(*fine < 1e-5, "{errors:?}");
        assert!(
            *fine < 0.35 * errors[0][k] || *fine < 1e-8,
            "number {k}: {errors:?}"
        );
    }
}

/// Differences to a run of 12,800 steps fall by four from 200 steps on, twice. Returns whether the
/// contact slides at the end.
fn is_of_second_order<D: Dimension>(friction: f64, of: [[Vector; 3]; 2]) -> bool {
    let end = |steps: usize| {
        let mut pair = couple::<D>(friction, 4.0 / steps as f64, of);
        (0..steps).for_each(|_| pair.advance());
        assert!(pair.system.contacts.touching().next().is_some());
        (
            pair.system.grains().state(0),
            pair.system.contacts.limits[0][0] != 0,
        )
    };
    let (reference, sliding) = end(12800);
    let errors = [200, 400, 800].map(|steps| {
        let (found, _) = end(steps);
        let off = |a: Vector, b: Vector| norm(minus(a, b));
        off(found.angular_velocity, reference.angular_velocity)
            + off(found.velocity, reference.velocity)
    });
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((1.85..2.4).contains(&order), "{errors:?}");
    }
    sliding
}

#[test]
fn sticking_spheres_are_of_second_order() {
    let at = |part: f64| [1.0, 0.4, -0.2].map(|n| part * 0.99 * n / norm([1.0, 0.4, -0.2]));
    let of = [
        [at(RADII[0]), [-0.02, 0.03, 0.01], [0.04, -0.02, 0.05]],
        [at(-RADII[1]), [0.02, -0.01, 0.01], [-0.02, 0.06, 0.02]],
    ];
    assert!(!is_of_second_order::<Three>(10.0, of));
}

/// In space a direction of t that turns while the contact slides is followed to first order only,
/// as in every law here.
#[test]
fn sliding_disks_are_of_second_order() {
    let at = |part: f64| [0.6 * 0.99 * part, 0.8 * 0.99 * part, 0.0];
    let of = [
        [at(RADII[0]), [-0.02, 0.01, 0.0], [0.0, 0.0, 0.05]],
        [at(-RADII[1]), [0.02, -0.01, 0.0], [0.0, 0.0, 0.06]],
    ];
    assert!(is_of_second_order::<Two>(0.05, of));
}
