//! Bands: layers of a rank's grains along the last axis, each of which touches only the next ones.
//! A step goes from band to band, so that the forces of a band are computed while its grains are
//! still in the cache from their motion, and several steps can follow each other through the bands.

use std::ops::Range;
use std::sync::OnceLock;

use crate::dimension::Dimension;
use crate::state::{CandidatePair, Cell, GrainState, body};

/// The owned grains of each band, one range after the other. Every pair of the list is within a
/// band, or between one and the next.
#[derive(Debug, Clone, Default)]
pub struct Bands {
    ends: Vec<usize>,
}

impl Bands {
    /// A single band of so many grains.
    pub fn one(grains: usize) -> Self {
        Self { ends: vec![grains] }
    }

    /// Number of bands.
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// The grains of a band.
    pub fn grains(&self, band: usize) -> Range<usize> {
        let start = band.checked_sub(1).map_or(0, |before| self.ends[before]);
        start..self.ends[band]
    }

    /// The grains of a band and of the one before it, which is all that its pairs have: a pair of
    /// two bands is a pair of the later one.
    pub fn grains_of_pairs(&self, band: usize) -> Range<usize> {
        self.grains(band.saturating_sub(1)).start..self.ends[band]
    }

    /// The band of an owned grain.
    pub(crate) fn of(&self, grain: usize) -> usize {
        self.ends.partition_point(|&end| end <= grain)
    }

    /// Whether every pair of owned grains is within a band, or between one and the next.
    pub(crate) fn hold(&self, pairs: &[CandidatePair]) -> bool {
        let Some(&owned) = self.ends.last() else {
            return true;
        };
        let is_held = |pair: &CandidatePair| {
            let [i, j] = pair.grains.map(|g| g as usize);
            i >= owned || j >= owned || self.of(i).abs_diff(self.of(j)) <= 1
        };
        self.count() == 1 || pairs.iter().all(is_held)
    }

    /// Sorts grains by bands of this size, each at least this thick (m); in a band they keep their
    /// order. All grains of the top wall are in the last band. A single band, if others would be too
    /// large.
    pub(crate) fn sort<D: Dimension>(
        grains: &mut [GrainState],
        cell: &Cell,
        thickness: f64,
        size: BandSize,
    ) -> Self {
        let mut heights: Vec<f64> = grains.iter().map(|g| height::<D>(cell, g)).collect();
        heights.sort_unstable_by(f64::total_cmp);
        let of_top = grains.iter().filter(|grain| grain.body == body::TOP);
        let top = of_top.map(|g| height::<D>(cell, g));
        let top = top.fold(f64::INFINITY, f64::min);
        let mut bounds = Vec::new();
        let mut low = heights.first().copied().unwrap_or_default();
        let mut below = 0;
        while let Some(after) = heights.get(below + size.wanted) {
            let bound = after.max(low + thickness);
            below = heights.partition_point(|height| *height < bound);
            if bound > top || below == heights.len() {
                break;
            }
            bounds.push(bound);
            low = bound;
        }
        let band_of = |grain: &GrainState| {
            let height = height::<D>(cell, grain);
            bounds.partition_point(|bound| *bound <= height)
        };
        let mut ends = vec![0; bounds.len() + 1];
        for grain in &*grains {
            ends[band_of(grain)] += 1;
        }
        let mut end = 0;
        for count in &mut ends {
            end += *count;
            *count = end;
        }
        let bands = Self { ends };
        let largest = (0..bands.count()).map(|band| bands.grains(band).len());
        if bands.count() == 1 || largest.max() > Some(size.most) {
            return Self::one(grains.len());
        }
        grains.sort_by_key(band_of);
        bands
    }
}

/// How many grains a band has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BandSize {
    /// A sample of so many grains has one band.
    pub least: usize,
    /// About so many, if the band is thick enough then.
    pub wanted: usize,
    /// At most so many.
    pub most: usize,
}

impl BandSize {
    /// As the scene says.
    pub fn given(wanted: usize) -> Self {
        Self {
            least: wanted,
            wanted,
            most: usize::MAX,
        }
    }

    /// For the last-level cache: where all grains fit into half of it bands would gain nothing, nor
    /// where three of them do not fit into it, which two steps that follow each other need.
    pub fn by_cache<D: Dimension>() -> Self {
        let grains = cache_size() / bytes_of_a_grain::<D>();
        Self {
            least: grains / 2,
            wanted: 1000,
            most: grains / 3,
        }
    }
}

/// About how many bytes a step reads of a grain and its pairs.
fn bytes_of_a_grain<D: Dimension>() -> usize {
    match D::AXES {
        2 => 500,
        _ => 750,
    }
}

/// Bytes of the last-level cache, if they are not known.
const USUAL_CACHE: usize = 32 << 20;

/// Bytes of the last-level cache of this processor.
fn cache_size() -> usize {
    static SIZE: OnceLock<usize> = OnceLock::new();
    *SIZE.get_or_init(|| {
        let told = std::fs::read_to_string("/sys/devices/system/cpu/cpu0/cache/index3/size");
        let kibibytes = told.ok().and_then(|size| {
            let number = size.trim().strip_suffix('K')?;
            number.parse::<usize>().ok()
        });
        kibibytes.map_or(USUAL_CACHE, |kibibytes| kibibytes << 10)
    })
}

/// The height of a grain (m); in a cell that is periodic along its last axis the distance from the
/// nearer of both edges, so that bands at both edges are one.
fn height<D: Dimension>(cell: &Cell, grain: &GrainState) -> f64 {
    let height = grain.position[D::UP];
    match &cell.sheared {
        None => height,
        Some(sheared) => height.min(sheared.height - height),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dimension::Two;
    use crate::state::Sheared;
    use bytemuck::Zeroable;

    /// A column of grains 1 m apart, the last three of which are the top.
    fn column(count: u32) -> Vec<GrainState> {
        let grain = |id: u32| GrainState {
            id,
            body: if id + 3 >= count {
                body::TOP
            } else {
                body::FREE
            },
            position: [0.0, f64::from(id) + 0.5, 0.0],
            ..GrainState::zeroed()
        };
        (0..count).map(grain).rev().collect()
    }

    fn sorted(cell: Cell, thickness: f64, wanted: usize) -> (Vec<GrainState>, Bands) {
        let mut grains = column(20);
        let size = BandSize::given(wanted);
        let bands = Bands::sort::<Two>(&mut grains, &cell, thickness, size);
        assert_eq!(bands.ends.last(), Some(&20));
        (grains, bands)
    }

    /// Fails unless pairs up to this distance (m) are within a band or between one and the next.
    fn check(grains: &[GrainState], bands: &Bands, cell: &Cell, reach: f64) {
        let mut pairs = Vec::new();
        for i in 0..grains.len() {
            for j in 0..i {
                let apart = cell.separation::<Two>(&grains[i].position, &grains[j].position);
                if apart[1].abs() < reach {
                    pairs.push(CandidatePair {
                        grains: [i as u32, j as u32],
                        gap: 0.0,
                    });
                }
            }
        }
        assert!(bands.hold(&pairs));
    }

    #[test]
    fn bands_are_thick_enough_and_the_last_has_the_top() {
        let cell = Cell::between_walls([1.0, f64::INFINITY]);
        for (thickness, wanted, count) in [(2.5, 1, 7), (1.0, 4, 5), (1.0, 20, 1), (9.0, 2, 2)] {
            let (grains, bands) = sorted(cell, thickness, wanted);
            assert_eq!(bands.count(), count, "{thickness} {wanted}");
            check(&grains, &bands, &cell, thickness);
            let last = bands.grains(count - 1);
            let top = (0..20).filter(|&g| grains[g].body == body::TOP);
            assert!(top.into_iter().all(|g| last.contains(&g)));
            let of = (0..20).map(|g| bands.of(g));
            assert!(of.is_sorted());
        }
        let (_, bands) = sorted(cell, 1.0, 5);
        let far = CandidatePair {
            grains: [0, 19],
            gap: 0.0,
        };
        assert!(!bands.hold(&[far]));
    }

    #[test]
    fn bands_of_a_periodic_cell_close_at_its_edges() {
        let mut cell = Cell::between_walls([40.0, f64::INFINITY]);
        cell.sheared = Some(Sheared::upright(20.0));
        let (grains, bands) = sorted(cell, 2.0, 4);
        assert!(bands.count() > 1);
        check(&grains, &bands, &cell, 2.0);
    }
}
