//! Tests of the measurements that need no law: protocol, realisations, steps, holds, errors of
//! means.

use super::*;

/// The variance of the mean of n values with ρ_l = φ^l is σ²/n (1 + φ)/(1 - φ), up to terms in
/// 1/n². With n/g = 1000 both estimates from one series are known to about 10 %, the mean over 40
/// series to 2 %.
#[test]
fn errors_of_means_count_correlated_values_as_few() {
    for memory in [0.0, 3.0, 10.0] {
        let kept = kept(memory);
        let g = (1.0 + kept) / (1.0 - kept);
        let n = (1000.0 * g) as usize;
        let expected = 0.3 * 0.3 * g / n as f64;
        let [mut blocks, mut sums] = [0.0; 2];
        for seed in 0..40 {
            let values = noise(seed, n, 0.3, memory);
            blocks += block_error(&values).powi(2) / 40.0;
            sums += correlation(&values).spectral_variance() / n as f64 / 40.0;
        }
        assert_near(blocks, expected, 0.1);
        assert_near(sums, expected, 0.1);
    }
    assert!(block_error(&[1.0; 3]).is_nan());
    assert_eq!(block_error(&[1.0; 300]), 0.0);
}

/// A row in which the layer bears nearly no load, with any S/N, weighs by its forces.
#[test]
fn steady_friction_is_the_ratio_of_the_mean_forces() {
    let law = law(Evolution::Aging);
    let drive = [segment(0.01, 1.0), segment(0.1, 1.0)];
    let plain = synthetic(&law, &drive, 1e-3);
    let mut bare = plain.clone();
    let row = bare.halves(1)[1].start + 5;
    (bare.friction[row], bare.load[row]) = (-1e6, 1e-9);
    let of = |record: &SliderRecord| {
        let steady = steady_segments(record)[1].expect("a slide").friction;
        [steady, FitWindow::of(record, 0..2).steady_friction(1)]
    };
    for (a, b) in of(&plain).into_iter().zip(of(&bare)) {
        assert!((a - b).abs() < 1e-3 * a, "{a} {b}");
    }
}

#[test]
fn a_drive_is_cut_where_its_velocity_changes() {
    let made = [
        segment(0.02, 0.1234),
        segment(0.0, 0.5),
        segment(0.1, 0.0777),
    ];
    let time: Vec<f64> = (0..=350).map(|k| 2e-3 * f64::from(k)).collect();
    let [first, second, third] = made;
    let changes = [first.duration, first.duration + second.duration];
    let now = |t: &f64| made[changes.iter().filter(|change| *t > **change).count()].velocity;
    let mut velocity: Vec<f64> = time.iter().map(now).collect();
    let way = |t: &f64| {
        let after = (t - changes[1]).max(0.0);
        first.velocity * t.min(first.duration) + third.velocity * after
    };
    let mut displacement: Vec<f64> = time.iter().map(way).collect();
    let found = of_drive(&time, &velocity, &displacement).expect("a drive");
    assert_eq!(found.len(), 3);
    // The last segment ends with the rows.
    let durations = [first.duration, second.duration, 0.7 - changes[1]];
    for ((found, made), duration) in found.iter().zip(made).zip(durations) {
        assert_eq!(found.velocity, made.velocity);
        assert!((found.duration - duration).abs() < 1e-12);
    }

    // A segment between two rows.
    displacement[20..].iter_mut().for_each(|x| *x += 1e-3);
    velocity[20..].iter_mut().for_each(|v| *v += 1e-3);
    let refused = of_drive(&time, &velocity, &displacement).unwrap_err();
    assert!(refused.contains("between row 19 and row 20"));
    velocity[3] = -1.0;
    let refused = of_drive(&time, &velocity, &displacement).unwrap_err();
    assert!(refused.contains("row 3"));
}

/// Slide-hold-slide without noise: measurements agree with the law.
#[test]
fn steps_and_holds_are_measured() {
    let mut drive = with_holds(0.02, 8.0, &[1.0, 10.0, 100.0]);
    drive.push(segment(0.1, 2.0));
    let law = law(Evolution::Aging);
    let record = synthetic(&law, &drive, 2e-4);
    let steady = steady_segments(&record);
    let holds = holds(&record, &steady, None);
    let durations: Vec<f64> = holds.iter().map(|hold| hold.duration).collect();
    assert_eq!(durations, [1.0, 10.0, 100.0]);
    for hold in &holds {
        assert!((steady[hold.segment - 1].expect("a slide").friction - 0.35).abs() < 1e-4);
        let reslide = hold.reslide.expect("a reslide");
        assert!((reslide.peak - 0.35 - reslide.healing).abs() < 1e-4);
        assert!(reslide.healing > 0.0 && hold.relaxation < 0.0);
    }
    // On a stiff spring long holds heal by b per factor of e (aging law): θ = t_hold, and V at the
    // peak is that of the drive.
    let of_long = &healing(&holds[1..])[0];
    assert_near(of_long.slope, law.b, 0.03);
    assert_eq!(of_long.interval, None);
    assert_eq!(of_long.velocities, [0.02, 0.02]);
    assert!(healing(&holds)[0].interval.expect("of three holds")[1] > law.b * 0.9);

    let steps = steps(&record, &steady, None);
    assert_eq!(steps.len(), 1);
    let (step, ln) = (steps[0], f64::ln(5.0));
    assert!((step.net[0] / ln - (law.a - law.b)).abs() < 1e-4);
    assert_near(step.direct[0], ln * law.a, 0.01);
    assert_near(step.evolution[0], ln * law.b, 0.01);
}

#[test]
fn realisations_are_joined_by_their_protocol() {
    let law = law(Evolution::Slip);
    let one = synthetic(&law, &step_test(), 2e-3);
    let up = |record: &SliderRecord, by: f64| {
        let mut record = record.clone();
        record.friction.iter_mut().for_each(|f| *f += by);
        record.time.iter_mut().for_each(|t| *t += 7.0);
        record
    };
    // One stopped earlier with other rows, and one of another protocol.
    let mut short = up(&synthetic(&law, &step_test(), 1e-3), 0.03);
    for column in [&mut short.time, &mut short.slip, &mut short.friction] {
        column.truncate(4001);
    }
    short.drive[2].duration = 1.7;
    let other = synthetic(&law, &step_test()[..2], 2e-3);
    let joined = merge(&[one.clone(), up(&one, -0.03), other.clone(), short]);
    assert_eq!(joined.len(), 2);
    assert_eq!((&joined[0].1, &joined[1].1), (&vec![0, 1, 3], &vec![2]));
    assert_eq!(joined[1].0.friction, other.friction);
    let mean = &joined[0].0;
    assert_eq!((mean.time.len(), mean.realisations), (2001, 3));
    assert!((mean.drive[2].duration - 1.7).abs() < 1e-9);
    for k in 0..2001 {
        // Rows next to a step are interpolated across it.
        let is_near = (0..one.drive.len()).any(|s| (one.time[k] - one.begin(s)).abs() < 3e-3);
        let close = if is_near { 0.05 } else { 1e-9 };
        assert!((mean.friction[k] - one.friction[k]).abs() < close, "{k}");
        assert!((mean.deviation[k] - 0.03).abs() < close);
    }
}

/// The mean of an exponential decay over 0.05 D_c is 2.5 % below its initial value. The greatest of
/// 2500 rows lies 3.5 standard deviations above a constant; the greatest of 40 means of 13 rows,
/// about 2.2/√13 of one.
#[test]
fn peaks_are_not_those_of_the_noise() {
    let drive = [segment(0.02, 4.0), segment(0.0, 10.0), segment(0.02, 8.0)];
    let clean = synthetic(&law(Evolution::Aging), &drive, 1e-3);
    let healing = |record: &SliderRecord, d_c: Option<f64>| {
        let steady = steady_segments(record);
        holds(record, &steady, d_c)[0].reslide.expect("a reslide")
    };
    let [raw, mean] = [None, Some(0.0053)].map(|d_c| healing(&clean, d_c).healing);
    assert_near(mean, 0.975 * raw, 0.02);

    let mut flat = clean.clone();
    flat.friction = vec![0.35; flat.time.len()];
    let noisy = disturbed(&flat, 3, 5e-3, 0.0);
    let [raw, mean] = [None, Some(0.0053)].map(|d_c| healing(&noisy, d_c));
    let (most, least) = (mean.healing, raw.healing);
    assert!(least > 2.5 * 5e-3 && most < 5e-3, "{least} {most}");
    assert_near(mean.error, 5e-3 / 13f64.sqrt(), 0.2);
}

#[test]
fn what_follows_like_steps_is_averaged_over_steps_and_runs() {
    // Without a spring: after each step μ jumps up or down and then falls linearly over 1 m of
    // slip; each run has its own level.
    let record = |level: f64, jump: f64| {
        let drive = [0.1, 1.0, 0.1, 1.0].map(|v| segment(v, 1.0 / v));
        // Segments count from the first row.
        let (mut time, mut slip, mut friction) = (vec![0.0], vec![0.0], vec![level]);
        let mut now = 0.0;
        for (k, s) in drive.iter().enumerate() {
            for row in 0..1000 {
                let part = (f64::from(row) + 0.5) / 1000.0;
                time.push(now + part * s.duration);
                slip.push(k as f64 + part);
                let sign = [0.0, 1.0, -1.0, 1.0][k];
                friction.push(level + sign * jump * (1.0 - 2.0 * part).max(0.0));
            }
            now += s.duration;
        }
        SliderRecord::of_run(STIFFNESS, drive.to_vec(), [time, slip, friction])
    };
    let found = stacks(&[record(0.3, 0.02), record(0.5, 0.04)]);
    let [up, down] = &found[..] else {
        panic!("two pairs of velocities: {found:?}");
    };
    assert_eq!((up.velocities, down.velocities), ([0.1, 1.0], [1.0, 0.1]));
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-4, "{a} for {b}");
    for (stack, sign, steps) in [(up, 1.0, 4), (down, -1.0, 2)] {
        for piece in &stack.pieces {
            let [from, to] = piece.slip;
            let part = 1.0 - (from + to);
            let part = if from > 0.4 { 0.0 } else { part };
            assert_eq!(piece.steps, steps);
            near(piece.change, sign * 0.03 * part);
            // Half the steps are at 0.02 and half at 0.04: standard deviation 0.01 √(n/(n-1)),
            // divided by √n.
            near(piece.error, 0.01 * part / (steps as f64 - 1.0).sqrt());
        }
        near(stack.pieces.last().expect("pieces").slip[1], 1.0);
    }
}

/// Holds of two realisations that relax as -c ln(1 + t/τ): means and errors at every time, and the
/// change of the direct effect alone, which a slider with b = 0 follows.
#[test]
fn relaxations_are_averaged_over_holds() {
    let relaxing = |c: f64| {
        let mut drive = with_holds(0.1, 0.1, &[0.01, 0.01]);
        drive.pop();
        let time: Vec<f64> = (0..22_000).map(|row| f64::from(row) * 1e-5).collect();
        let of = |t: &f64| {
            let since = [0.1, 0.21].map(|begin| t - begin);
            let since = since.into_iter().find(|since| (0.0..0.01).contains(since));
            since.map_or(0.4, |since| 0.4 - c * (1.0 + since / 1e-4).ln())
        };
        let (slip, friction) = (time.clone(), time.iter().map(of).collect());
        SliderRecord {
            temperature: vec![10.0 * c; time.len()],
            spin_temperature: vec![5.0 * c; time.len()],
            ..SliderRecord::of_run(STIFFNESS, drive, [time, slip, friction])
        }
    };
    let found = relaxations(&[relaxing(0.01), relaxing(0.03)]);
    assert_eq!(found.len(), 7, "{found:?}");
    for (of, expected) in found.iter().zip([1e-5, 3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 0.01]) {
        assert_near(of.time, expected, 1e-9);
    }
    for of in &found[2..] {
        assert_eq!((of.holds, of.before), (4, 0.1));
        let law = -(1.0 + of.time / 1e-4).ln();
        assert_near(of.change, 0.02 * law, 3e-3);
        // 0.01 above and below, two of each: 0.01 √(4/3)/√4.
        assert_near(of.error, 0.01 * law.abs() / 3f64.sqrt(), 3e-3);
        assert!((of.temperature - 0.2).abs() < 1e-12);
        assert!((of.spin_temperature - 0.1).abs() < 1e-12);
    }

    let law = RateStateLaw {
        b: 0.0,
        ..law(Evolution::Aging)
    };
    let record = synthetic(&law, &[segment(0.1, 1.0), segment(0.0, 0.1)], 1e-5);
    let found = relaxations(&[record]);
    let last = found.last().expect("a hold");
    assert_near(last.time, 0.1, 1e-3);
    assert!(last.error.is_nan());
    for of in &found[4..] {
        assert_near(of.change, of.of_direct_effect(law.a, of.stiffness), 0.02);
        assert!(of.reload.is_nan());
    }
}

/// While the slider hardly slips, a reload rises by k̄ of what holds it, here the spring alone.
#[test]
fn a_reload_shows_its_stiffness() {
    let drive = [segment(0.02, 8.0), segment(0.0, 10.0), segment(0.02, 8e-3)];
    let record = synthetic(&law(Evolution::Aging), &drive, 1e-6);
    let found = reload_stiffness(&record, 2).expect("a reload");
    assert_near(found, STIFFNESS, 0.01);
    let of_hold = relaxations(std::slice::from_ref(&record));
    assert_eq!(of_hold[0].reload, found);
    for segment in [1, 3] {
        assert_eq!(reload_stiffness(&record, segment), None);
    }
}

/// On a stiff spring the peak after a long hold has θ = t_hold and the velocity of the drive, so
/// that Δμ = a ln(V_r/V_i) + b ln(V_i t_hold/D_c).
#[test]
fn peaks_grow_by_a_with_the_velocity_of_the_slide() {
    let law = law(Evolution::Aging);
    let test = |velocity: f64| {
        let drive = [
            segment(0.02, 8.0),
            segment(0.0, 100.0),
            segment(velocity, 2.0),
        ];
        let record = synthetic(&law, &drive, 1e-5);
        holds(&record, &steady_segments(&record), None)
    };
    let tests: Vec<Hold> = [0.05, 0.1, 0.3].into_iter().flat_map(test).collect();
    let [growth] = peak_growth(&tests)[..] else {
        panic!("one duration: {tests:?}");
    };
    assert_eq!((growth.peaks, growth.before), (3, 0.02));
    assert_eq!(growth.duration, 100.0);
    assert_near(growth.slope, law.a, 0.03);
    let long = law.b * (0.02 * 100.0 / law.d_c).ln();
    assert_near(growth.intercept, long, 0.03);
    // Weights of a least-squares line: equal errors e give e/√(Σ (x - x̄)²).
    let same = tests.iter().map(|hold| {
        let reslide = hold.reslide.map(|peak| Reslide {
            error: 2e-3,
            ..peak
        });
        Hold { reslide, ..*hold }
    });
    let same: Vec<Hold> = same.collect();
    let growth = peak_growth(&same)[0];
    assert_near(growth.error, 2e-3 / growth.spread.sqrt(), 1e-12);
    // One ratio has no slope.
    assert!(peak_growth(&tests[..1]).is_empty());
}
