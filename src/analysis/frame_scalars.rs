//! What is kept of a frame for the statistics of LH section 3.3: a few numbers, from it and the frame before it.

use super::dmin::{self, NonAffine};
use super::regions::{MinPoints, Regions};
use super::spearman::{Spearman, sort_key};
use super::stress::PrincipalStress;
use crate::state::{Disks, Frame};

/// Share of the greatest D²min that g_t10%D²min averages.
const TOP: f64 = 0.1;

/// Names of the scalars, under `observables/gshear/` and as columns of tables.
pub const SCALAR_COLUMNS: [&str; 8] = [
    "dmin_greatest",
    "dmin_top_tenth",
    "regions",
    "regions_of_two",
    "stress_dmin_rho",
    "stress_dmin_p",
    "region_angle_mean",
    "region_angle_median",
];

/// The scalars of the interval between a frame and the one before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameScalars {
    /// gD²min (m²): the greatest D²min; NaN where it is nowhere defined.
    pub dmin_greatest: f64,
    /// g_t10%D²min (m²): mean of the greatest 10 % of the defined D²min (their number rounded, at least one).
    pub dmin_top_tenth: f64,
    /// Number of GR regions, minPts = 1 counting the point itself.
    pub regions: f64,
    /// The same with minPts = 2: grains alone are noise.
    pub regions_of_two: f64,
    /// Spearman's ρ of |Δσ_p| with D²min over the grains that have one, and its p.
    pub stress_dmin_rho: f64,
    pub stress_dmin_p: f64,
    /// |θ| (rad) of the contacts in GR regions; NaN where there are none.
    pub region_angle_mean: f64,
    pub region_angle_median: f64,
}

impl FrameScalars {
    /// Of a frame without one before it.
    pub const UNDEFINED: FrameScalars =
        FrameScalars::from_columns([f64::NAN; SCALAR_COLUMNS.len()]);

    /// The scalars in the order of [`SCALAR_COLUMNS`].
    pub const fn columns(&self) -> [f64; SCALAR_COLUMNS.len()] {
        [
            self.dmin_greatest,
            self.dmin_top_tenth,
            self.regions,
            self.regions_of_two,
            self.stress_dmin_rho,
            self.stress_dmin_p,
            self.region_angle_mean,
            self.region_angle_median,
        ]
    }

    /// The scalars from the order of [`SCALAR_COLUMNS`].
    pub const fn from_columns(columns: [f64; SCALAR_COLUMNS.len()]) -> Self {
        FrameScalars {
            dmin_greatest: columns[0],
            dmin_top_tenth: columns[1],
            regions: columns[2],
            regions_of_two: columns[3],
            stress_dmin_rho: columns[4],
            stress_dmin_p: columns[5],
            region_angle_mean: columns[6],
            region_angle_median: columns[7],
        }
    }

    /// Number of GR regions in one of its two readings.
    pub fn regions(&self, reading: MinPoints) -> f64 {
        match reading {
            MinPoints::Itself => self.regions,
            MinPoints::OneNeighbour => self.regions_of_two,
        }
    }
}

/// Buffers, reused from frame to frame, and what the scalars were made of.
#[derive(Debug, Default)]
pub struct Scratch {
    pub non_affine: NonAffine,
    pub regions: Regions,
    /// [N] (m²), NaN where undefined.
    pub dmin: Vec<f64>,
    /// [N] |Δσ_p| (Pa).
    pub stress_change: Vec<f64>,
    stress: PrincipalStress,
    spearman: Spearman,
    keys: Vec<u64>,
    angles: Vec<f64>,
}

/// The scalars between two frames. Of the frames it reads positions and, of the contacts, ids and forces.
///
/// A function of the two frames alone: the same bits whoever asks, after whatever else `scratch` was used for.
pub fn frame_scalars(
    grains: &Disks,
    earlier: &Frame,
    later: &Frame,
    scratch: &mut Scratch,
) -> FrameScalars {
    let radius = dmin::RADIUS * grains.mean_radius();
    let Scratch {
        non_affine,
        regions,
        dmin,
        stress_change,
        stress,
        spearman,
        keys,
        angles,
    } = scratch;
    dmin.resize(grains.count(), 0.0);
    non_affine.between(grains, radius, earlier, later, dmin);
    stress.changes(grains, earlier, later, stress_change);
    regions.find(grains, earlier, later);
    regions.angles(grains, later, angles);

    let pairs = stress_change.iter().zip(dmin.iter());
    let correlation = spearman.of(pairs.map(|(stress, dmin)| [*stress, *dmin]));
    let (dmin_greatest, dmin_top_tenth) = greatest(dmin, keys);
    let (region_angle_mean, region_angle_median) = mean_and_median(angles);
    FrameScalars {
        dmin_greatest,
        dmin_top_tenth,
        regions: regions.count(MinPoints::Itself) as f64,
        regions_of_two: regions.count(MinPoints::OneNeighbour) as f64,
        stress_dmin_rho: correlation.rho,
        stress_dmin_p: correlation.p,
        region_angle_mean,
        region_angle_median,
    }
}

/// The greatest value and the mean of the greatest tenth, of those that are not NaN. Summed from the greatest downwards.
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
    let value = |key: &u64| f64::from_bits(!key & !(1 << 63));
    let sum: f64 = top.iter().map(value).sum();
    (value(&top[0]), sum / count as f64)
}

/// Mean and median (of an even number the mean of the middle two); NaN of nothing. Sorts.
fn mean_and_median(values: &mut [f64]) -> (f64, f64) {
    values.sort_unstable_by(f64::total_cmp);
    let count = values.len();
    if count == 0 {
        return (f64::NAN, f64::NAN);
    }
    let mean = values.iter().sum::<f64>() / count as f64;
    (mean, 0.5 * (values[(count - 1) / 2] + values[count / 2]))
}
