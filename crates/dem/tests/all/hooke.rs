//! The linear springs, through the program's own step: closed forms of an impact.

use std::f64::consts::PI;

use gshear_dem::dimension::{Three, Two};
use gshear_dem::laws::damping::damping_ratio;
use gshear_dem::laws::hooke::Springs;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::state::Masses;

use crate::common::{Rig, elastic, hooke, minus, norm};

const DENSITY: f64 = 2500.0;
const RADII: [f64; 2] = [0.7e-3, 1e-3];

/// The damped half sine: peak overlap, the time at which the clamped force ends, and the
/// restitution up to there. Below the clamp e = exp(-πα/√(1-α²)) is what one makes of α; the clamp
/// ends the contact a little earlier and faster.
fn impact_is_a_damped_half_sine<D: LawSpace>(restitution: f64) {
    let alpha = damping_ratio(restitution);
    let springs = Springs {
        damping_ratio: alpha,
        ..elastic(1e6, 0.4e6, DENSITY)
    };
    let [a, b] = RADII.map(|r| DENSITY * D::volume(r));
    // ω_0 = √(k_n/m*), λ = αω_0 and ω = √(ω_0²-λ²) of the contact as an oscillator (1/s).
    let free = (springs.normal_stiffness * (1.0 / a + 1.0 / b)).sqrt();
    let decay = alpha * free;
    let frequency = (free * free - decay * decay).sqrt();
    let speed = 0.1;
    let to_peak = (frequency / decay).atan() / frequency;
    let peak = speed / free * (-decay * to_peak).exp();
    // F_n = k δ - γ v_n = 0: tan ωt = -2λω/(ω_0² - 2λ²), and there the speed apart is v e^{-λt}.
    let end = (PI - (2.0 * decay * frequency).atan2(free * free - 2.0 * decay * decay)) / frequency;

    let step = 1e-4 / free;
    // 1 at the origin meets 0, which is at rest.
    let n = [0.8f64.cos(), 0.8f64.sin(), 0.0];
    let distance = RADII[0] + RADII[1] - 1e-4 * step * speed;
    let of = [
        [n.map(|n| distance * n), [0.0; 3], [0.0; 3]],
        [[0.0; 3], n.map(|n| speed * n), [0.0; 3]],
    ];
    let contact = Contact {
        friction: 0.5,
        rolling_friction: 0.3,
        rolling_stiffness: Some(0.4e6),
        rolling_damping_ratio: 0.2,
        ..Contact::NONE
    };
    let law = hooke::<D>(springs, &contact);
    let masses = Masses::Density(DENSITY);
    let mut pair = Rig::couple(law, (masses, step), RADII, of, Vec::new());
    let (mut deepest, mut pressed) = (0.0f64, 0);
    let away = loop {
        pair.advance(1);
        let [a, b] = pair.ends();
        let overlap = RADII[0] + RADII[1] - norm(minus(a.position, b.position));
        if overlap <= 0.0 {
            break norm(minus(a.velocity, b.velocity));
        }
        deepest = deepest.max(overlap);
        let (normal, _) = pair.contact_force().expect("a contact");
        pressed += u64::from(normal > 0.0);
    };
    let close = |name: &str, found: f64, expected: f64, tolerance: f64| {
        assert!(
            (found / expected - 1.0).abs() < tolerance,
            "e = {restitution}: {name} {found:e} is not {expected:e}"
        );
    };
    close("peak overlap", deepest, peak, 1e-7);
    close("restitution", away / speed, (-decay * end).exp(), 1e-6);
    close("contact time", pressed as f64 * step, end, 1e-4);
    let above = away / speed - restitution;
    let most = (2.0 * (1.0 - restitution).powi(2)).min(0.15);
    // Without a damper there is no clamp.
    let fits = if alpha > 0.0 {
        (0.0..most).contains(&above)
    } else {
        above.abs() < 1e-6
    };
    assert!(fits, "{restitution}: {above} above");
}

#[test]
fn an_impact_is_a_damped_half_sine() {
    for restitution in [0.5, 0.75, 0.9, 0.99, 1.0] {
        impact_is_a_damped_half_sine::<Two>(restitution);
        impact_is_a_damped_half_sine::<Three>(restitution);
    }
}
