//! Segments found in a measured displacement.

use super::*;

/// The displacement of a drive at these times, with white noise of standard deviation σ (m).
fn measured(drive: &[DriveSegment], time: &[f64], sigma: f64) -> Vec<f64> {
    let noise = noise(7, time.len(), sigma, 0.0);
    let driven = time.iter().map(|t| {
        let mut left = *t;
        let parts = drive.iter().map(|segment| {
            let within = left.clamp(0.0, segment.duration);
            left -= segment.duration;
            segment.velocity * within
        });
        parts.sum::<f64>()
    });
    driven.zip(noise).map(|(x, noise)| x + noise).collect()
}

fn rows(count: u32, interval: f64) -> Vec<f64> {
    (0..count).map(|k| interval * f64::from(k)).collect()
}

/// Segments as long as their slip allows: times to the noise over the change of the velocity.
#[test]
fn changes_of_the_velocity_are_found_in_noise() {
    let micron = 1e-6;
    let drive = [
        segment(1.0 * micron, 200.0),
        segment(10.0 * micron, 30.0),
        segment(0.0, 100.0),
        segment(10.0 * micron, 20.0),
        segment(3.0 * micron, 100.0),
        segment(4.0 * micron, 50.0),
    ];
    let time = rows(5001, 0.1);
    let sigma = 0.1 * micron;
    let found = of_displacement(&time, &measured(&drive, &time, sigma)).expect("segments");
    assert_eq!(found.len(), drive.len(), "{found:?}");
    let mut ends = [0.0; 2];
    for (found, made) in found.iter().zip(&drive) {
        assert_eq!(found.is_hold(), made.is_hold());
        // The standard error of a slope is σ √(12/n)/T.
        let error = sigma * (12.0 / (10.0 * made.duration)).sqrt() / made.duration;
        let off = (found.velocity - made.velocity).abs();
        assert!(off < 5.0 * error, "{found:?} for {made:?}");
        ends = [ends[0] + found.duration, ends[1] + made.duration];
        assert!((ends[0] - ends[1]).abs() < 0.1, "{ends:?}");
    }
    let changes = [200.0, 230.0, 330.0, 350.0, 450.0];
    let given = with_changes(&time, &measured(&drive, &time, sigma), &changes);
    let given = given.expect("segments");
    let longest = given
        .iter()
        .zip(&drive)
        .map(|(a, b)| (a.duration - b.duration).abs());
    assert!(longest.fold(0.0, f64::max) < 1e-9);
}

/// Blocks of several rows, with the changes inside of them; the last one takes two seconds.
#[test]
fn many_rows_have_the_segments_of_few() {
    let mut drive = vec![
        segment(1e-6, 300.02),
        segment(1e-5, 80.01),
        segment(1e-6, 400.03),
        segment(0.0, 100.04),
        segment(1e-6, 400.0),
    ];
    drive.extend((1..20).map(|k| segment(1e-6 * (1.0 + 0.1 * f64::from(k)), 0.1)));
    drive.push(segment(3e-6, 200.0));
    let time = rows(14_820, 0.1);
    let found = of_displacement(&time, &measured(&drive, &time, 2e-8)).expect("segments");
    assert_eq!(found.len(), 6, "{found:?}");
    for (found, made) in found[..4].iter().zip(&drive) {
        assert!((found.duration - made.duration).abs() < 0.05, "{found:?}");
    }
    assert!((found[5].velocity / 3e-6 - 1.0).abs() < 1e-3, "{found:?}");
}

/// A jump between equal velocities, which one line fits nearly as well as two.
#[test]
fn a_short_fast_segment_is_found() {
    let drive = [
        segment(1e-6, 100.0),
        segment(1e-5, 3.0),
        segment(1e-6, 100.0),
    ];
    let time = rows(2031, 0.1);
    let found = of_displacement(&time, &measured(&drive, &time, 1e-7)).expect("segments");
    assert_eq!(found.len(), 3, "{found:?}");
    assert!((found[1].duration - 3.0).abs() < 0.1, "{found:?}");
}

#[test]
fn a_steady_drive_is_one_segment() {
    let time = rows(3000, 0.1);
    for sigma in [0.0, 1e-6] {
        let drive = measured(&[segment(1e-6, 300.0)], &time, sigma);
        assert_eq!(of_displacement(&time, &drive).expect("a segment").len(), 1);
    }
}

#[test]
fn drives_that_move_backwards_are_refused() {
    let time = rows(400, 0.1);
    let back = [segment(1e-6, 20.0), segment(-1e-6, 20.0)];
    let why = of_displacement(&time, &measured(&back, &time, 0.0)).expect_err("no drive");
    assert!(
        why.contains("moves backwards from 2.0000e1 to 3.9900e1 s, at -1.0000e-6 m/s"),
        "{why}"
    );
    assert!(with_changes(&time, &measured(&back, &time, 0.0), &[50.0]).is_err());
}
