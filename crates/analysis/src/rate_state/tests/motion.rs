//! Tests of the forward model against closed forms and SciPy.

use super::*;

/// θ (s).
fn theta_of(law: &RateStateLaw, state: LogState) -> f64 {
    law.d_c / law.v_star * state.ln_theta.exp()
}

#[test]
fn sliding_becomes_steady_at_the_friction_of_the_law() {
    for evolution in BOTH {
        let law = law(evolution);
        let slider = RateStateSlider::new(law, STIFFNESS);
        for velocity in [2e-4, 0.1] {
            // 40 D_c.
            let drive = [segment(velocity, 40.0 * law.d_c / velocity)];
            let state = moved(slider, 0.02, &drive, &[drive[0].duration])[0];
            let steady = 0.35 + (0.0247 - 0.0178) * (velocity / 0.02).ln();
            assert!((law.friction(state) - steady).abs() < 1e-8);
            assert_near(law.velocity(state), velocity, 1e-6);
            assert_near(theta_of(&law, state), law.d_c / velocity, 1e-6);
        }
    }
}

/// With k̄ → ∞ the slider stands still in a hold: θ = θ_0 + t by the aging law, θ = θ_0 by the slip
/// law.
#[test]
fn stationary_contacts_age_by_the_aging_law_only() {
    let times = [1e-3, 1.0, 1e3];
    for evolution in BOTH {
        let law = law(evolution);
        let slider = RateStateSlider::new(law, 1e9);
        let states = moved(slider, 0.02, &[segment(0.0, 1e3)], &times);
        for (time, state) in times.into_iter().zip(states) {
            let aged = match evolution {
                Evolution::Aging => time,
                Evolution::Slip => 0.0,
            };
            let theta = theta_of(&law, law.steady(0.02)) + aged;
            // It still slips a/k̄ per factor of e by which V falls; by the slip law θ then falls
            // with ln(Vθ/D_c) of about -25.
            let slip = (0.35 - law.friction(state)) / 1e9;
            assert!(slip / law.d_c < 1e-6);
            assert_near(theta_of(&law, state), theta, 30.0 * slip / law.d_c + 1e-7);
        }
    }
}

/// The extension of the spring balances the friction: μ - μ_0 = k̄ (X_drive - slip).
#[test]
fn the_spring_is_in_balance() {
    let law = law(Evolution::Slip);
    let drive = [segment(0.0, 0.5), segment(0.2, 0.05)];
    let times: Vec<f64> = (0..=110_000).map(|k| 5e-6 * f64::from(k)).collect();
    let states = moved(RateStateSlider::new(law, 300.0), 0.02, &drive, &times);
    let velocity: Vec<f64> = states.iter().map(|s| law.velocity(*s)).collect();
    let slip: f64 = velocity.windows(2).map(|v| 2.5e-6 * (v[0] + v[1])).sum();
    let pulled = (law.friction(states[110_000]) - 0.35) / 300.0;
    let off = (slip + pulled - drive[1].distance()).abs();
    assert!(off < 1e-8, "{slip} {pulled}");
}

/// Linear stability (Ruina 1983), for both laws: perturbations of steady sliding grow if k̄ < k̄_c
/// = (b - a)/D_c and decay if k̄ > k̄_c. At k̄_c they oscillate with the angular frequency √(k̄_c
/// V²/(a D_c)) = (V/D_c) √((b - a)/a).
#[test]
fn oscillations_grow_below_the_critical_stiffness_only() {
    for evolution in BOTH {
        let law = RateStateLaw {
            a: 0.01,
            b: 0.015,
            ..law(evolution)
        };
        let critical = law.critical_stiffness().expect("one state variable");
        let (v, d_c) = (0.02, law.d_c);
        // λ² + λ (V/a)(k̄ - k̄_c) + k̄ V²/(a D_c) = 0
        let growth = |stiffness: f64| -0.5 * (v / law.a) * (stiffness - critical);
        let omega =
            |stiffness: f64| (stiffness * v * v / (law.a * d_c) - growth(stiffness).powi(2)).sqrt();
        for share in [0.9, 1.0, 1.1] {
            let stiffness = share * critical;
            let start = LogState {
                ln_v: 1e-4,
                ln_theta: 0.0,
                ln_second: 0.0,
            };
            let period = 2.0 * std::f64::consts::PI / omega(stiffness);
            let times = [period, 2.0 * period, 3.0 * period];
            let slider = RateStateSlider {
                tolerance: 1e-11,
                ..RateStateSlider::new(law, stiffness)
            };
            let states = slider.motion(&[segment(v, 1.0)], start, &times);
            for (state, time) in states.expect("a motion").into_iter().zip(times) {
                let expected = 1e-4 * (growth(stiffness) * time).exp();
                // Terms of second order are 1e-4.
                assert_near(state.ln_v, expected, 2e-3);
            }
        }
    }
}

/// Reference: SciPy 1.x `solve_ivp`, method Radau, rtol 1e-12, atol 1e-13, for the same two
/// equations from steady sliding at 0.02 m/s: 10 s of hold, then 2 s at 0.02, 0.2 s at 0.2 and 2 s
/// at 0.02 m/s; ln V and ln θ at the end of each.
#[test]
fn a_protocol_gives_the_states_of_scipy() {
    const SCIPY: [[[f64; 2]; 4]; 2] = [
        [
            [-14.796037978424602, 3.6567387227214767],
            [4.684522979887356e-07, 0.019719678096723807],
            [2.3025852088585204, -2.2977438122886453],
            [-1.1389017192755086e-08, -0.00047461581281471436],
        ],
        [
            [-13.941223040519311, 0.003233708263442478],
            [4.163566387769072e-11, 1.7354902752502116e-06],
            [2.3025851221348566, -2.301370416430549],
            [-2.9125282847983598e-08, -0.001214029342224186],
        ],
    ];
    let drive = [
        segment(0.0, 10.0),
        segment(0.02, 2.0),
        segment(0.2, 0.2),
        segment(0.02, 2.0),
    ];
    for (evolution, expected) in BOTH.into_iter().zip(SCIPY) {
        let error = |tolerance: f64| -> f64 {
            let states = within(evolution, tolerance, &drive, &[10.0, 12.0, 12.2, 14.2]);
            let pairs = states.into_iter().zip(expected);
            let off =
                pairs.map(|(s, [v, theta])| (s.ln_v - v).abs().max((s.ln_theta - theta).abs()));
            off.fold(0.0, f64::max)
        };
        let errors = [1e-5, 1e-7, 1e-9].map(error);
        // Errors of μ are 100 times less.
        let small = errors[0] < 1e-3 && errors[1] < 3e-5 && errors[2] < 1e-6;
        assert!(small, "{errors:?}");
    }
}

/// The states at these times with steps of this tolerance.
fn within(
    evolution: Evolution,
    tolerance: f64,
    drive: &[DriveSegment],
    times: &[f64],
) -> Vec<LogState> {
    let mut slider = RateStateSlider::new(law(evolution), STIFFNESS);
    slider.tolerance = tolerance;
    moved(slider, 0.02, drive, times)
}

#[test]
fn states_between_the_steps_are_as_good_as_those_at_their_ends() {
    let drive = [segment(0.02, 0.1), segment(0.2, 0.1), segment(0.0, 1.0)];
    let times: Vec<f64> = (1..1200).map(|k| 1e-3 * f64::from(k)).collect();
    for evolution in BOTH {
        let [coarse, fine] = [1e-9, 1e-11].map(|tolerance| {
            let states = within(evolution, tolerance, &drive, &times);
            assert_eq!(states.len(), times.len());
            states
        });
        let friction = |state| law(evolution).friction(state);
        for (coarse, fine) in coarse.into_iter().zip(fine) {
            let off = (friction(coarse) - friction(fine)).abs();
            assert!(off < 1e-7, "{off:e}");
        }
    }
}

/// On springs that are stiff beyond measure the slider moves as the drive does, and μ jumps by
/// a ln(V/V_0) while θ is what it was.
#[test]
fn stiff_springs_impose_the_velocity() {
    for evolution in BOTH {
        let law = law(evolution);
        for stiffness in (0..40).map(|k| 1e7 * f64::powf(1.5, f64::from(k))) {
            let drive = [segment(0.02, 1.0), segment(0.2, 1.0), segment(0.02, 1.0)];
            // 10 slips of a/k̄ after the step, over which V becomes that of the drive.
            let soon = 1.0 + 10.0 * law.a / stiffness / 0.2;
            let times = [0.5, soon, 1.5, 2.9];
            let slider = RateStateSlider::new(law, stiffness);
            let states = moved(slider, 0.02, &drive, &times);
            for (state, imposed) in states.iter().zip([0.02, 0.2, 0.2, 0.02]) {
                assert_near(law.velocity(*state), imposed, 1e-3);
            }
            let jump = law.friction(states[1]) - law.friction(states[0]);
            assert_near(jump, law.a * f64::ln(10.0), 1e-3);
        }
    }
}
