//! The scalars of one interval between two frames that the statistics of LH section 3.3 use:
//! gD²min, g_t10%D²min, the number of GR regions, the correlation of |Δσ_p| with D²min, and the
//! contact-force angles in GR regions.

use super::dmin::{self, NonAffine};
use super::interval::Interval;
use super::regions::{GrReading, MinPoints, Reduction, Regions};
use super::spearman::{Spearman, sort_key};
use super::stress::largest_principals;
use gshear_dem::state::{Frame, GrainConstants};

/// Share of the defined D²min, the greatest ones, that g_t10%D²min averages.
const TOP: f64 = 0.1;

gshear_dem::columns! {
    /// Scalars of the interval between a frame and the frame before it.
    pub struct FrameScalars {
        /// gD²min: the greatest D²min; NaN if no grain has one
        dmin_greatest: "m2",
        /// g_t10%D²min: mean of the greatest 10 % of the D²min
        dmin_top_tenth: "m2",
        /// number of GR regions with minPts = 1, the point itself included
        regions: "1",
        /// number of GR regions with minPts = 2: single grains are noise
        regions_of_two: "1",
        /// Spearman's ρ of |Δσ_p| with D²min, over the grains that have one
        stress_dmin_rho: "1",
        /// two-sided p of `stress_dmin_rho`
        stress_dmin_p: "1",
        /// mean |θ| of the contacts of grains in GR regions; NaN if none
        region_angle_mean: "rad",
        /// median |θ| of the same contacts; NaN if none
        region_angle_median: "rad",
        /// number of GR regions by the losses of the contacts of a grain alone
        loss_regions: "1",
        /// the same with minPts = 2
        loss_regions_of_two: "1",
        /// mean |θ| in these regions; NaN if none
        loss_region_angle_mean: "rad",
        /// median |θ| in these regions; NaN if none
        loss_region_angle_median: "rad",
        /// number of GR regions by the greatest loss of one contact of a grain
        greatest_loss_regions: "1",
        /// the same with minPts = 2
        greatest_loss_regions_of_two: "1",
        /// mean |θ| in these regions; NaN if none
        greatest_loss_region_angle_mean: "rad",
        /// median |θ| in these regions; NaN if none
        greatest_loss_region_angle_median: "rad",
    }
}

impl FrameScalars {
    /// Scalars of a frame without an earlier one: all NaN.
    pub const UNDEFINED: FrameScalars =
        FrameScalars::from_columns([f64::NAN; FrameScalars::COLUMNS.len()]);

    /// The scalars that follow from D²min alone, `[N]` (m²); the others are NaN.
    pub fn of_dmin(values: &[f64]) -> Self {
        let (dmin_greatest, dmin_top_tenth) = greatest(values, &mut Vec::new());
        Self {
            dmin_greatest,
            dmin_top_tenth,
            ..Self::UNDEFINED
        }
    }

    /// Returns the number of GR regions.
    pub fn regions(&self, reading: GrReading) -> f64 {
        self.of_regions(reading.reduction)[reading.min_points as usize]
    }

    /// Returns mean and median |θ| (rad) of the contacts of grains in GR regions.
    pub(crate) fn region_angles(&self, reduction: Reduction) -> [f64; 2] {
        let [.., mean, median] = self.of_regions(reduction);
        [mean, median]
    }

    /// The scalars of the GR regions: their numbers by [`MinPoints`], and mean and median |θ|.
    fn of_regions(&self, reduction: Reduction) -> [f64; 4] {
        let [_, _, one, two, _, _, mean, median, rest @ ..] = self.columns();
        let [a, b, c, d, e, f, g, h] = rest;
        match reduction {
            Reduction::Net => [one, two, mean, median],
            Reduction::Losses => [a, b, c, d],
            Reduction::GreatestLoss => [e, f, g, h],
        }
    }
}

/// A frame with σ_p of every grain, which both intervals that it bounds need.
#[derive(Debug, Clone)]
pub struct Stressed {
    /// The frame.
    pub frame: Frame,
    /// `[N]` σ_p (Pa).
    principal: Vec<f64>,
}

impl Stressed {
    /// Computes σ_p of every grain.
    pub fn new(grains: &GrainConstants, frame: Frame) -> Self {
        let principal = largest_principals(grains, &frame);
        Self { frame, principal }
    }
}

/// Buffers reused from frame to frame, with the per-grain quantities behind the last scalars.
#[derive(Debug, Default)]
pub struct ScalarScratch {
    /// D²min of the last interval.
    pub non_affine: NonAffine,
    /// GR regions of the last interval.
    pub regions: Regions,
    /// `[N]` D²min (m²); NaN where undefined.
    pub dmin: Vec<f64>,
    /// `[N]` |Δσ_p| (Pa).
    pub stress_change: Vec<f64>,
    spearman: Spearman,
    keys: Vec<u64>,
    angles: Vec<f64>,
}

/// Returns the scalars of the interval between two frames. It reads positions and, of the contacts,
/// ids and forces.
///
/// The result depends on the two frames alone, bit by bit, not on earlier uses of `scratch`.
pub fn frame_scalars(
    grains: &GrainConstants,
    earlier: &Stressed,
    later: &Stressed,
    scratch: &mut ScalarScratch,
) -> FrameScalars {
    let radius = dmin::RADIUS * grains.mean_radius();
    let ScalarScratch {
        non_affine,
        regions,
        dmin,
        stress_change,
        spearman,
        keys,
        angles,
    } = scratch;
    let principal = earlier.principal.iter().zip(&later.principal);
    stress_change.clear();
    stress_change.extend(principal.map(|(from, to)| (to - from).abs()));
    let (earlier, later) = (&earlier.frame, &later.frame);
    dmin.resize(grains.count(), 0.0);
    let interval = Interval::between_walls([earlier, later]);
    non_affine.between(grains, &interval, radius, dmin);
    regions.find(grains, earlier, later);
    let [net, losses, greatest_loss] = Reduction::ALL.map(|reduction| {
        let [one, two] = MinPoints::ALL.map(|min_points| {
            regions.count(GrReading {
                reduction,
                min_points,
            }) as f64
        });
        regions.angles(reduction, later, angles);
        let [mean, median] = mean_and_median(angles);
        [one, two, mean, median]
    });

    let pairs = stress_change.iter().zip(dmin.iter());
    let correlation = spearman.of(pairs.map(|(stress, dmin)| [*stress, *dmin]));
    let (dmin_greatest, dmin_top_tenth) = greatest(dmin, keys);
    FrameScalars {
        dmin_greatest,
        dmin_top_tenth,
        regions: net[0],
        regions_of_two: net[1],
        stress_dmin_rho: correlation.rho,
        stress_dmin_p: correlation.p,
        region_angle_mean: net[2],
        region_angle_median: net[3],
        loss_regions: losses[0],
        loss_regions_of_two: losses[1],
        loss_region_angle_mean: losses[2],
        loss_region_angle_median: losses[3],
        greatest_loss_regions: greatest_loss[0],
        greatest_loss_regions_of_two: greatest_loss[1],
        greatest_loss_region_angle_mean: greatest_loss[2],
        greatest_loss_region_angle_median: greatest_loss[3],
    }
}

/// Greatest value and mean of the greatest tenth (a rounded number of values, at least one), NaN
/// left out. The sum runs from the greatest down, so that it does not depend on the order of the
/// grains.
fn greatest(values: &[f64], keys: &mut Vec<u64>) -> (f64, f64) {
    keys.clear();
    let defined = values.iter().filter(|value| !value.is_nan());
    keys.extend(defined.map(|value| !sort_key(*value)));
    if keys.is_empty() {
        return (f64::NAN, f64::NAN);
    }
    let count = ((TOP * keys.len() as f64).round() as usize).max(1);
    if count < keys.len() {
        keys.select_nth_unstable(count);
    }
    let top = &mut keys[..count];
    top.sort_unstable();
    let sum: f64 = top.iter().copied().map(value_of_key).sum();
    (value_of_key(top[0]), sum / count as f64)
}

/// The value, not negative, whose sort key has these bits inverted.
fn value_of_key(inverted: u64) -> f64 {
    f64::from_bits(!inverted & !(1 << 63))
}

/// Mean and median (of an even number the mean of the middle two); NaN if empty. Sorts the values.
fn mean_and_median(values: &mut [f64]) -> [f64; 2] {
    values.sort_unstable_by(f64::total_cmp);
    let count = values.len();
    if count == 0 {
        return [f64::NAN; 2];
    }
    let mean = values.iter().sum::<f64>() / count as f64;
    [mean, 0.5 * (values[(count - 1) / 2] + values[count / 2])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{frame, grains_of, scattered};

    #[test]
    fn the_greatest_tenth_is_of_the_defined_values() {
        let mut values: Vec<f64> = (1..=26).map(f64::from).collect();
        values.extend([f64::NAN; 14]);
        values.reverse();
        // 10 % of 26 is 2.6, rounded to 3.
        assert_eq!(greatest(&values, &mut Vec::new()), (26.0, 25.0));
        assert_eq!(greatest(&[0.0, f64::NAN], &mut Vec::new()), (0.0, 0.0));
        let (one, top) = greatest(&[f64::NAN; 3], &mut Vec::new());
        assert!(one.is_nan() && top.is_nan());
    }

    #[test]
    fn means_and_medians_of_odd_even_and_no_values() {
        assert_eq!(mean_and_median(&mut [3.0, 1.0, 8.0]), [4.0, 3.0]);
        assert_eq!(mean_and_median(&mut [3.0, 1.0, 8.0, 4.0]), [4.0, 3.5]);
        let [mean, median] = mean_and_median(&mut []);
        assert!(mean.is_nan() && median.is_nan());
    }

    #[test]
    fn what_a_scratch_was_used_for_before_does_not_matter() {
        let grains = grains_of(&[1.0; 300]);
        let start = scattered(1, 300, 40.0, 30.0);
        let frames = [0, 1, 2, 3, 4, 5].map(|k: u32| {
            // Small moves, for which the pair lists stay valid, and a large one.
            let size = if k == 4 { 3.0 } else { 0.05 * f64::from(k) };
            let moves = scattered(2 + u64::from(k), 300, size, size);
            let places: Vec<_> = start.iter().zip(moves).map(|(r, d)| r + d).collect();
            let mut frame = frame(40.0, &places);
            for (n, contact) in frame.contacts.iter_mut().enumerate() {
                contact.normal_force = 1.0 + (7.3 * n as f64 + f64::from(k)).sin();
                contact.tangential_force[0] = 0.3 * (2.1 * n as f64 - f64::from(k)).cos();
            }
            Stressed::new(&grains, frame)
        });
        let bits = |pair: &[Stressed], scratch: &mut ScalarScratch| {
            let scalars = frame_scalars(&grains, &pair[0], &pair[1], scratch);
            scalars.columns().map(f64::to_bits)
        };
        let mut used = ScalarScratch::default();
        for pair in frames.windows(2) {
            let fresh = bits(pair, &mut ScalarScratch::default());
            assert_eq!(bits(pair, &mut used), fresh);
        }
        let fewer = grains_of(&[1.0; 200]);
        let points = scattered(9, 200, 40.0, 30.0);
        let still = Stressed::new(&fewer, frame(40.0, &points));
        let again = frame_scalars(&fewer, &still, &still, &mut used);
        assert_eq!((again.dmin_greatest, again.regions), (0.0, 0.0));
        assert!(again.region_angle_mean.is_nan() && again.stress_dmin_rho.is_nan());
    }
}
