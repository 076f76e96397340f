//! Measures of stick and slip phases (LH equations 1 to 4), from τ and the scalars of the frames.

use super::frame_scalars::FrameScalars;
use super::phases::{self, Phase};
use super::regions::GrReading;

gshear_dem::columns! {
    /// Measures that LH correlate with Δτ_p of a phase; NaN if a scalar that one needs is undefined
    /// in the phase.
    pub struct PhaseMeasures {
        /// mgD²min: greatest gD²min (LH 1)
        dmin_max: "m2",
        /// mg_t10%D²min: greatest g_t10%D²min (LH 2)
        top_max: "m2",
        /// sgD²min: sum of gD²min from t_s on (LH 3)
        dmin_sum: "m2",
        /// sg_t10%D²min: sum of g_t10%D²min from t_s on (LH 4)
        top_sum: "m2",
        /// N_c: least number of GR regions
        regions_least: "1",
        /// mean |θ| in the last interval with N_c regions
        angle_mean: "rad",
        /// median |θ| in the last interval with N_c regions
        angle_median: "rad",
    }
}

/// A phase with its measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The phase.
    pub phase: Phase,
    /// Its measures.
    pub measures: PhaseMeasures,
}

/// Returns the phases of τ(γ), both `[L]`, with their measures.
///
/// `scalars`: `[L]`, row k for the interval from row k-1 to row k. A phase has the rows `start` + 1
/// … `end`, one per interval; t_s is the first of them with N_c regions.
pub fn of(
    strain: &[f64],
    tau: &[f64],
    scalars: &[FrameScalars],
    reading: GrReading,
) -> Vec<Measured> {
    let phases = phases::find(strain, tau);
    let measured = phases.into_iter().map(|phase| Measured {
        phase,
        measures: measure(&scalars[phase.start + 1..=phase.end], reading),
    });
    measured.collect()
}

fn measure(scalars: &[FrameScalars], reading: GrReading) -> PhaseMeasures {
    let regions: Vec<f64> = scalars.iter().map(|s| s.regions(reading)).collect();
    let regions_least = regions.iter().copied().fold(f64::INFINITY, least);
    let first = regions.iter().position(|count| *count == regions_least);
    let last = regions.iter().rposition(|count| *count == regions_least);
    let [angle_mean, angle_median] = match last {
        Some(last) => scalars[last].region_angles(reading.reduction),
        None => [f64::NAN; 2],
    };
    let greatest: Vec<f64> = scalars.iter().map(|s| s.dmin_greatest).collect();
    let top: Vec<f64> = scalars.iter().map(|s| s.dmin_top_tenth).collect();
    PhaseMeasures {
        dmin_max: maximum(&greatest),
        top_max: maximum(&top),
        dmin_sum: first.map_or(f64::NAN, |first| greatest[first..].iter().sum()),
        top_sum: first.map_or(f64::NAN, |first| top[first..].iter().sum()),
        regions_least,
        angle_mean,
        angle_median,
    }
}

/// The greatest of some numbers, or NaN if one is NaN.
fn maximum(values: &[f64]) -> f64 {
    let values = values.iter();
    values.fold(f64::NEG_INFINITY, |a, b| -least(-a, -b))
}

/// The lesser of two numbers, or NaN if either is NaN; `f64::min` would ignore the NaN.
fn least(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phases::PhaseKind;
    use crate::regions::{MinPoints, Reduction};

    /// The measures of phases of τ on γ = 0, 1, 2, … and of scalars with gD²min, g_t10%D²min,
    /// regions and mean angle; the median is twice the mean.
    fn measured<const L: usize>(tau: [f64; L], rows: [[f64; 4]; L]) -> Vec<Measured> {
        of(
            &strain::<L>(),
            &tau,
            &rows.map(scalars),
            GrReading::default(),
        )
    }

    fn strain<const L: usize>() -> [f64; L] {
        std::array::from_fn(|k| k as f64)
    }

    fn scalars([one, top, regions, angle]: [f64; 4]) -> FrameScalars {
        FrameScalars {
            dmin_greatest: one,
            dmin_top_tenth: top,
            regions,
            regions_of_two: 1.0,
            region_angle_mean: angle,
            region_angle_median: 2.0 * angle,
            ..FrameScalars::UNDEFINED
        }
    }

    const NAN: f64 = f64::NAN;

    #[test]
    fn sums_begin_where_the_regions_are_fewest_and_angles_are_of_the_last_such_row() {
        // A slip of four intervals with a plateau, then a stick phase of one interval.
        let tau = [9.0, 7.0, 7.0, 6.0, 2.0, 3.0];
        let rows = [
            [NAN; 4],
            [1.0, 0.5, 4.0, 0.1],
            [8.0, 2.0, 2.0, 0.2],
            [4.0, 3.0, 3.0, 0.3],
            [2.0, 1.0, 2.0, 0.4],
            [7.0, 6.0, 5.0, 0.5],
        ];
        let found = measured(tau, rows);
        assert_eq!(found.len(), 2);
        let first = found[0].phase;
        assert_eq!((first.kind, first.change), (PhaseKind::Slip, -7.0));
        assert!(first.is_long());
        // Greatest, sums, fewest regions, angles.
        let slip = [8.0, 3.0, 8.0 + 4.0 + 2.0, 2.0 + 3.0 + 1.0, 2.0, 0.4, 0.8];
        assert_eq!(found[0].measures.columns(), slip);
        assert_eq!(found[1].phase.duration(), 1);
        let stick = [7.0, 6.0, 7.0, 6.0, 5.0, 0.5, 1.0];
        assert_eq!(found[1].measures.columns(), stick);

        // With the other reading every row has one region, so the sum is over the whole phase.
        let of_two = GrReading {
            min_points: MinPoints::OneNeighbour,
            ..GrReading::default()
        };
        let slip = of(&strain::<6>(), &tau, &rows.map(scalars), of_two)[0].measures;
        assert_eq!((slip.dmin_sum, slip.angle_mean), (15.0, 0.4));

        // By losses the third interval has the fewest regions.
        let mut by_losses = rows.map(scalars);
        for (row, count) in by_losses.iter_mut().zip([0.0, 3.0, 3.0, 1.0, 3.0, 4.0]) {
            row.loss_regions = count;
            row.loss_region_angle_mean = 0.01 * row.dmin_greatest;
            row.loss_region_angle_median = 0.02 * row.dmin_greatest;
        }
        let reading = GrReading {
            reduction: Reduction::Losses,
            ..GrReading::default()
        };
        let slip = of(&strain::<6>(), &tau, &by_losses, reading)[0].measures;
        assert_eq!((slip.dmin_sum, slip.regions_least), (4.0 + 2.0, 1.0));
        assert_eq!((slip.angle_mean, slip.angle_median), (0.04, 0.08));
    }

    #[test]
    fn an_undefined_scalar_leaves_the_measures_of_its_phase_undefined() {
        let rows = [
            [NAN; 4],
            [NAN, 1.0, 3.0, 0.1],
            [2.0, 1.0, 3.0, 0.1],
            [2.0, 1.0, NAN, 0.1],
        ];
        let found = measured([0.0, 1.0, 2.0, 0.0], rows);
        let [stick, slip] = [found[0].measures, found[1].measures];
        assert!(stick.dmin_max.is_nan() && stick.dmin_sum.is_nan());
        assert_eq!((stick.top_max, stick.top_sum), (1.0, 2.0));
        assert!(slip.regions_least.is_nan() && slip.dmin_sum.is_nan() && slip.angle_mean.is_nan());
        assert_eq!(slip.dmin_max, 2.0);
    }

    #[test]
    fn a_tau_that_is_not_a_number_splits_phases_and_their_measures() {
        let rows = [1.0, 2.0, 50.0, 60.0, 3.0].map(|x| [x; 4]);
        let found = measured([0.0, 1.0, NAN, 3.0, 4.0], rows);
        let maxima: Vec<f64> = found.iter().map(|phase| phase.measures.dmin_max).collect();
        assert_eq!(maxima, [2.0, 3.0]);
    }
}
