//! Fits to data generated from the law, and the coverage of their intervals.

use super::*;

#[test]
fn without_noise_a_fit_returns_the_law() {
    for evolution in BOTH {
        let law = law(evolution);
        let holds = with_holds(0.02, 2.0, &[1.0, 10.0]);
        for drive in [&step_test()[..], &step_test()[..2], &holds[..]] {
            let record = synthetic(&law, drive, 1e-3);
            let window = FitWindow::of(&record, 0..drive.len());
            let form = FitForm::default();
            let found = fit(&[window], evolution, &form).expect("a fit").model.law;
            assert_near(found.a, law.a, 1e-3);
            assert_near(found.b, law.b, 1e-3);
            assert_near(found.d_c, law.d_c, 1e-3);
            assert_near(found.mu_star, law.mu_star, 1e-3);
        }
    }
}

/// For 60 realisations of the noise: the number of 95 % intervals that contain a, b, D_c and a - b,
/// and the root mean square of their half-width over that of the error of the estimate.
fn coverage(evolution: Evolution, sigma: f64, memory: f64) -> ([usize; 4], [f64; 4]) {
    use rayon::prelude::*;
    let law = law(evolution);
    let clean = synthetic(&law, &step_test(), 2e-3);
    let of = |seed: u64| {
        let record = disturbed(&clean, seed, sigma, memory);
        let windows = [FitWindow::of(&record, 0..3)];
        let fit = fit(&windows, evolution, &FitForm::default()).expect("a fit");
        let found = [Quantity::A, Quantity::B, Quantity::Dc, Quantity::AMinusB];
        let found = found.map(|quantity| fit.estimate(quantity).expect("an estimate"));
        let made = [law.a, law.b, law.d_c, law.a - law.b];
        std::array::from_fn::<_, 4, _>(|c| {
            let (found, made) = (found[c], made[c]);
            let [low, high] = found.interval;
            let (half, error) = (0.5 * (high - low), found.value - made);
            ((low..=high).contains(&made), half * half, error * error)
        })
    };
    let all: Vec<_> = (0..60u64).into_par_iter().map(of).collect();
    let sum =
        |c: usize, of: fn((bool, f64, f64)) -> f64| all.iter().map(|one| of(one[c])).sum::<f64>();
    (
        std::array::from_fn(|c| all.iter().filter(|one| one[c].0).count()),
        std::array::from_fn(|c| (sum(c, |(_, half, _)| half) / sum(c, |(.., error)| error)).sqrt()),
    )
}

/// Fewer than 50 of 60 intervals of 95 % contain the truth with a probability of 2e-4 (binomial),
/// of intervals of 70 % with one of 0.99. So intervals that are much too short are noticed, and
/// right ones pass. The half-width of a right one is 1.96 standard errors, which 60 intervals
/// determine to 9 %.
#[test]
fn intervals_hold_the_law_about_as_often_as_they_say() {
    for evolution in BOTH {
        for memory in [0.0, 5.0, 20.0] {
            let (held, length) = coverage(evolution, 2e-3, memory);
            let often = held.iter().all(|held| *held >= 50);
            let short = memory > 0.0 || length.iter().all(|l| *l < 1.5 * 1.96);
            assert!(
                often && short,
                "{evolution:?} {memory}: {held:?} {length:?}"
            );
        }
    }
}

/// Both laws are fitted to data of one of them; that one has by far the lesser χ².
#[test]
fn chi_squared_tells_the_law() {
    let mut drive = with_holds(0.02, 2.0, &[10.0]);
    drive.push(segment(0.2, 0.3));
    for evolution in BOTH {
        let record = disturbed(&synthetic(&law(evolution), &drive, 2e-3), 5, 1e-3, 3.0);
        let windows = [FitWindow::of(&record, 0..4)];
        let fits = BOTH.map(|e| fit(&windows, e, &FitForm::default()).expect("a fit"));
        let best = usize::from(fits[0].rms >= fits[1].rms);
        assert_eq!(BOTH[best], evolution);
        let [of_best, of_other] =
            [best, 1 - best].map(|k| chi_squared(&windows, &fits[k], &fits[best]));
        assert!((of_best / fits[best].effective - 1.0).abs() < 1e-9);
        assert!(of_other > of_best + 100.0, "{of_best} {of_other}");
    }
}

#[test]
fn data_that_determine_nothing_are_refused() {
    // Steady sliding alone.
    let clean = synthetic(&law(Evolution::Aging), &[segment(0.02, 2.0)], 1e-3);
    let record = disturbed(&clean, 1, 1e-3, 0.0);
    let form = FitForm::default();
    assert!(fit(&[FitWindow::of(&record, 0..1)], Evolution::Aging, &form).is_err());
    assert!(fit(&[], Evolution::Aging, &form).is_err());
}

/// Only a constant in μ differs between the realisations, which no noise within a run shows. μ* is
/// as uncertain as the mean of four such constants, (−3, −1, 1, 3) √0.6 σ, whose jackknife is
/// exact: the half-width is t_3 s/√4 with their variance s² = 4σ². a and b are as certain as
/// before.
#[test]
fn jackknife_sees_what_differs_between_realisations() {
    let clean = synthetic(&law(Evolution::Aging), &step_test(), 4e-3);
    let sigma = 0.01;
    let records = [-3.0, -1.0, 1.0, 3.0].map(|shift| {
        let mut record = clean.clone();
        let by = shift * sigma * f64::sqrt(0.6);
        record.friction.iter_mut().for_each(|f| *f += by);
        record
    });
    let (joined, groups): (Vec<_>, Vec<_>) = merge(&records).into_iter().unzip();
    let form = FitForm::default();
    let all = &fit_all(&joined, &[Evolution::Aging], &form)[0];
    let spread = jackknife(&records, &groups, all, &form).expect("four realisations");
    let fit = spread.fits[0].1.as_ref().expect("a fit");
    let half = |quantity: Quantity| {
        let [low, high] = fit.estimate(quantity).expect("an estimate").interval;
        0.5 * (high - low)
    };
    // Student's t for 3 degrees of freedom, from tables.
    assert_near(half(Quantity::MuStar), 3.182446305284263 * sigma, 1e-6);
    assert!(
        [Quantity::A, Quantity::B, Quantity::Dc]
            .iter()
            .all(|q| half(*q) < 1e-8)
    );
    assert!(jackknife(&records[..2], &[vec![0, 1]], all, &form).is_none());
}

/// Two state variables and a trend come back.
#[test]
fn a_fit_returns_second_state_and_trend() {
    for evolution in BOTH {
        let second = StateVariable {
            b: -0.006,
            d_c: 0.05,
        };
        let law = RateStateLaw {
            second: Some(second),
            ..law(evolution)
        };
        let drive = [segment(0.02, 8.0), segment(0.2, 2.0), segment(0.02, 20.0)];
        let mut record = synthetic(&law, &drive, 5e-3);
        let trend = 0.03;
        for (friction, time) in record.friction.iter_mut().zip(&record.time) {
            *friction += trend * (0.02 * time + 0.18 * (time - 8.0).clamp(0.0, 2.0));
        }
        let form = FitForm {
            two_states: true,
            detrends: true,
            ..FitForm::default()
        };
        let found = fit(&[FitWindow::of(&record, 0..3)], evolution, &form).expect("a fit");
        let made = [
            (Quantity::A, law.a),
            (Quantity::B, law.b),
            (Quantity::Dc, law.d_c),
            (Quantity::SecondB, second.b),
            (Quantity::SecondDc, second.d_c),
            (Quantity::AMinusB, law.a - law.b - second.b),
            (Quantity::Trend, trend),
        ];
        assert_returned(&found, &made);
        assert_eq!(found.model.law.critical_stiffness(), None);
    }
}

/// k̄ comes back from a spring that is soft enough to decide the shape of the peaks.
#[test]
fn a_fit_returns_the_stiffness() {
    for evolution in BOTH {
        let (law, stiffness) = (law(evolution), 500.0);
        let mut record = on_spring(&law, stiffness, &step_test(), 1e-4);
        record.stiffness = f64::NAN;
        let form = FitForm {
            fits_stiffness: true,
            ..FitForm::default()
        };
        let found = fit(&[FitWindow::of(&record, 0..3)], evolution, &form).expect("a fit");
        let made = [
            (Quantity::A, law.a),
            (Quantity::B, law.b),
            (Quantity::Dc, law.d_c),
            (Quantity::Stiffness, stiffness),
        ];
        assert_returned(&found, &made);
    }
}

/// Two state variables, a trend and k̄ together come back, from noise too, within their intervals.
#[test]
fn a_fit_returns_everything_together() {
    let (stiffness, trend, sigma) = (500.0, 0.03, 2e-4);
    for evolution in BOTH {
        let second = StateVariable {
            b: 0.006,
            d_c: 0.05,
        };
        let law = RateStateLaw {
            second: Some(second),
            ..law(evolution)
        };
        let drive = [
            segment(0.02, 8.0),
            segment(0.2, 2.0),
            segment(0.02, 10.0),
            segment(0.0, 10.0),
            segment(0.02, 10.0),
        ];
        let clean = on_spring(&law, stiffness, &drive, 2e-3);
        let mut record = disturbed(&clean, 7, sigma, 0.0);
        for (friction, time) in record.friction.iter_mut().zip(&record.time) {
            let held = (time - 20.0).clamp(0.0, 10.0);
            *friction += trend * (0.02 * (time - held) + 0.18 * (time - 8.0).clamp(0.0, 2.0));
        }
        record.stiffness = f64::NAN;
        let form = FitForm {
            two_states: true,
            detrends: true,
            fits_stiffness: true,
            ..FitForm::default()
        };
        let found = fit(&[FitWindow::of(&record, 0..5)], evolution, &form).expect("a fit");
        assert!(found.rms < sigma, "{}", found.rms);
        for (quantity, made) in [
            (Quantity::A, law.a),
            (Quantity::B, law.b),
            (Quantity::Dc, law.d_c),
            (Quantity::SecondB, second.b),
            (Quantity::SecondDc, second.d_c),
            (Quantity::AMinusB, law.a - law.b - second.b),
            (Quantity::Stiffness, stiffness),
            (Quantity::Trend, trend),
        ] {
            let estimate = found.estimate(quantity).expect("an estimate");
            let [low, high] = estimate.interval;
            let text = format!("{evolution:?} {}: {estimate:?} for {made}", quantity.name());
            // Twice as long an interval leaves a right value out once in 1e4 times.
            assert!((estimate.value - made).abs() < high - low, "{text}");
            assert!(high - low < 0.2 * made.abs(), "{text}");
        }
    }
}

/// So they do on a spring so soft that the slider swings after every step, b > a.
#[test]
fn a_slider_that_swings_is_fitted() {
    let second = StateVariable {
        b: -0.0096,
        d_c: 127e-6,
    };
    let law = RateStateLaw {
        evolution: Evolution::Aging,
        mu_star: 0.6,
        a: 0.0154,
        b: 0.0181,
        d_c: 14.8e-6,
        second: Some(second),
        v_star: 1e-6,
    };
    let drive = [1.0, 10.0, 1.0, 0.0, 1.0].map(|v| 1e-6 * v);
    let durations = [200.0, 60.0, 300.0, 50.0, 200.0];
    let drive: Vec<_> = (drive.iter().zip(durations))
        .map(|(velocity, duration)| segment(*velocity, duration))
        .collect();
    let stiffness = 970.0;
    let record = disturbed(&on_spring(&law, stiffness, &drive, 0.1), 6, 3e-4, 0.0);
    let form = FitForm {
        two_states: true,
        detrends: true,
        fits_stiffness: true,
        ..FitForm::default()
    };
    let found = fit(&[FitWindow::of(&record, 0..5)], law.evolution, &form).expect("a fit");
    assert!(found.rms < 3e-4, "{}", found.rms);
    for (quantity, made) in [
        (Quantity::A, law.a),
        (Quantity::B, law.b),
        (Quantity::Dc, law.d_c),
        (Quantity::SecondB, second.b),
        (Quantity::SecondDc, second.d_c),
        (Quantity::Stiffness, stiffness),
        (Quantity::Trend, 0.0),
    ] {
        let estimate = found.estimate(quantity).expect("an estimate");
        let [low, high] = estimate.interval;
        let text = format!("{}: {estimate:?} for {made}", quantity.name());
        assert!((estimate.value - made).abs() < high - low, "{text}");
        assert!(made == 0.0 || high - low < 0.2 * made.abs(), "{text}");
    }
}

/// Rows every 5 ms do not show the slip of 0.025 µm in which a spring this stiff loads the slider:
/// k̄ is not determined, only bounded from below, and all else is.
#[test]
fn a_spring_too_stiff_for_the_rows_is_not_determined() {
    let stiffness = 1e6;
    for evolution in BOTH {
        let law = law(evolution);
        let drive = [segment(0.02, 2.0), segment(0.2, 0.5), segment(0.02, 3.0)];
        let clean = on_spring(&law, stiffness, &drive, 5e-3);
        let record = disturbed(&clean, 2, 1e-4, 0.0);
        let windows = [FitWindow::of(&record, 0..3)];
        let form = FitForm {
            fits_stiffness: true,
            ..FitForm::default()
        };
        let found = fit(&windows, evolution, &form).expect("a fit");
        assert_eq!(found.undetermined(), ["stiffness"]);
        let [low, high] = found.estimate(Quantity::Stiffness).expect("one").interval;
        assert!(low < stiffness && high == f64::INFINITY, "{low} {high}");
        // A spring on which the slider takes 0.1 s, 20 rows, to follow the step is seen to be soft.
        assert!(low > law.a / (0.1 * 0.2), "{low}");
        for (quantity, made) in [
            (Quantity::A, law.a),
            (Quantity::B, law.b),
            (Quantity::Dc, law.d_c),
        ] {
            let estimate = found.estimate(quantity).expect("an estimate");
            let [low, high] = estimate.interval;
            let text = format!("{}: {low} {high}", quantity.name());
            // Twice as long an interval leaves a right value out once in 1e4 times.
            assert!((estimate.value - made).abs() < high - low, "{text}");
            assert!(high - low < 0.05 * made, "{text}");
        }
    }
}

/// In data of one state variable b_2 may be 0, and a - b is as well known as with one.
#[test]
fn a_second_state_that_is_not_there_may_be_nothing() {
    for evolution in BOTH {
        let law = law(evolution);
        let record = disturbed(&synthetic(&law, &step_test(), 1e-3), 4, 5e-4, 0.0);
        let windows = [FitWindow::of(&record, 0..3)];
        let form = FitForm {
            two_states: true,
            ..FitForm::default()
        };
        let found = fit(&windows, evolution, &form).expect("a fit");
        let single = fit(&windows, evolution, &FitForm::default()).expect("a fit");
        assert!(found.rms <= single.rms);
        let interval = |fit: &Fit, q: Quantity| fit.estimate(q).expect("an estimate").interval;
        let [low, high] = interval(&found, Quantity::SecondB);
        assert!(low < 0.0 && 0.0 < high, "{evolution:?} {low} {high}");
        let [low, high] = interval(&found, Quantity::AMinusB);
        let [least, most] = interval(&single, Quantity::AMinusB);
        assert!(high - low < 1.5 * (most - least), "{low} {high}");
        assert!(low < law.a - law.b && law.a - law.b < high, "{low} {high}");
    }
}

/// Fails unless the estimates are what the data were made of.
fn assert_returned(fit: &Fit, made: &[(Quantity, f64)]) {
    for (quantity, made) in made {
        let value = fit.estimate(*quantity).expect("an estimate").value;
        let off = (value / made - 1.0).abs();
        assert!(off < 0.01, "{}: {value} for {made}", quantity.name());
    }
}

/// With everything given but μ*, the fit is the mean of what is left, and the model the law.
#[test]
fn a_given_law_is_not_fitted() {
    let law = law(Evolution::Aging);
    let record = disturbed(&synthetic(&law, &step_test(), 2e-3), 3, 1e-3, 0.0);
    let form = FitForm {
        given: vec![
            (Quantity::A, law.a),
            (Quantity::B, law.b),
            (Quantity::Dc, law.d_c),
        ],
        ..FitForm::default()
    };
    let found = fit(&[FitWindow::of(&record, 0..3)], Evolution::Aging, &form).expect("a fit");
    assert_eq!(found.given, [Quantity::A, Quantity::B, Quantity::Dc]);
    for quantity in found.given.iter().copied() {
        let estimate = found.estimate(quantity).expect("an estimate");
        assert_eq!(estimate.interval, [estimate.value; 2]);
    }
    let mu_star = found.estimate(Quantity::MuStar).expect("an estimate");
    let [low, high] = mu_star.interval;
    assert!(
        low < law.mu_star && law.mu_star < high && high - low < 4e-4,
        "{mu_star:?}"
    );
    let fitted = fit(
        &[FitWindow::of(&record, 0..3)],
        Evolution::Aging,
        &FitForm::default(),
    );
    assert!(found.rms > fitted.expect("a fit").rms);
}

/// The k̄ of a given law with two state variables comes back, also if one of them alone would be
/// fitted best on no spring at all.
#[test]
fn the_stiffness_of_a_given_law_is_fitted() {
    let law = RateStateLaw {
        evolution: Evolution::Slip,
        mu_star: 0.6,
        a: 0.0489,
        b: 0.0432,
        d_c: 0.22e-6,
        second: Some(StateVariable {
            b: 0.0061,
            d_c: 15e-6,
        }),
        v_star: 3e-6,
    };
    let stiffness = 2400.0;
    let drive = [segment(3e-6, 70.0), segment(1e-5, 50.0)];
    let record = disturbed(&on_spring(&law, stiffness, &drive, 0.05), 8, 3e-4, 0.0);
    let form = FitForm {
        two_states: true,
        fits_stiffness: true,
        given: vec![
            (Quantity::A, law.a),
            (Quantity::B, law.b),
            (Quantity::Dc, law.d_c),
            (Quantity::SecondB, 0.0061),
            (Quantity::SecondDc, 15e-6),
        ],
        ..FitForm::default()
    };
    let found = fit(&[FitWindow::of(&record, 0..2)], law.evolution, &form).expect("a fit");
    let estimate = found.estimate(Quantity::Stiffness).expect("an estimate");
    let [low, high] = estimate.interval;
    assert!(
        (estimate.value - stiffness).abs() < high - low && high - low < 0.1 * stiffness,
        "{estimate:?}"
    );
}
