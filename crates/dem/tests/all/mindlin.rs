//! The smoothed Mindlin law: values by hand, energies.

use gshear_dem::contact::{PairMotion, dissipation};
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::laws::mindlin::{Mindlin, MindlinSprings};
use gshear_dem::state::Masses;

use crate::common::{Evaluated, Vector, evaluate, frictional, splat};

/// In BO's units: k_n = 1, m = 1, the small spheres' diameter 1.
const SPRINGS: MindlinSprings = MindlinSprings {
    normal_stiffness: 1.0,
    tangential_stiffness: 2.0 / 7.0,
    masses: Masses::Equal(1.0),
};

/// A contact with μ = 0.5. `deeper`: by how much the overlap has grown in the step.
fn contact<D: Dimension>([overlap, deeper]: [f64; 2], history: Vector, slip: Vector) -> Evaluated {
    let law = Mindlin::<D, true>::new(&SPRINGS, &frictional(0.5));
    let motion = PairMotion {
        overlap: splat(overlap),
        normal_increment: splat(-deeper),
        tangential_increment: slip.map(splat),
        ..PairMotion::default()
    };
    evaluate(&law, [0.5, 0.7], &motion, history)
}

fn close(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() <= 4e-15 * expected.abs(),
        "{found:e} is not {expected:e}"
    );
}

/// At δ = 0.04, in two dimensions and along a direction in space: F_t, the history and whether the
/// contact slides, all components over those of the direction.
fn along_either(history: f64, slip: f64, [force, after]: [f64; 2], slides: bool) {
    let check = |of: Evaluated, along: Vector| {
        close(of.normal, 0.008);
        assert_eq!(of.slides, slides);
        for (k, along) in along.into_iter().enumerate() {
            close(of.tangential[k], force * along);
            close(of.history[k], after * along);
        }
    };
    let [flat, along] = [[1.0, 0.0, 0.0], [2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0]];
    let both = |along: Vector| [history, slip].map(|x| along.map(|n| x * n));
    let [before, way] = both(flat);
    check(contact::<Two>([0.04, 0.0], before, way), flat);
    let [before, way] = both(along);
    check(contact::<Three>([0.04, 0.0], before, way), along);
}

/// δ = 0.04, μ = 0.5: √δ = 0.2, t* = 0.5 · 3.5 · 0.04 = 0.07, k_t √δ = 2/35, F_n = 0.008.
#[test]
fn values_by_hand() {
    // |t|/t* and 1 + s - s².
    let factors = [1.09, 1.25, 1.09, 1.21, 1.0];
    for (s, factor) in [0.1, 0.5, 0.9, -0.3, 0.0].into_iter().zip(factors) {
        let t = 0.07 * s;
        let expected = -(2.0 / 35.0) * factor * t;
        along_either(0.4 * t, 0.6 * t, [expected, t], false);
    }
}

/// From |t| = t* on |F_t| = μF_n, and t stays at t*.
#[test]
fn exact_saturation() {
    for s in [1.001, 2.0, 50.0] {
        along_either(0.0, -0.07 * s, [0.5 * 0.008, -0.07], true);
    }
    // An overlap that shrinks lowers the limit of a contact that does not move.
    let of = contact::<Two>([0.02, -0.02], [0.06, 0.0, 0.0], [0.0; 3]);
    assert!(of.slides);
    close(of.history[0], 0.035);
    // Nothing is left of a contact that has opened.
    let of = contact::<Three>([-0.02, -0.06], [0.06, 0.0, 0.0], [0.0; 3]);
    assert_eq!(of.history, [0.0; 3]);
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
                let of = contact::<Two>([now, now - last], t, slip);
                t = of.history;
                let [friction, stiffness] = [dissipation::FRICTION, dissipation::STIFFNESS];
                dissipated[part] += of.dissipated[friction] + of.dissipated[stiffness];
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
