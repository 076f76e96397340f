//! Shares and bands of a rank's grains. Every thread has a share: the grains of a range along x.
//! Bands are layers along the last axis, each of which touches only the next ones. A step goes from
//! band to band, so that the forces of a band are computed while its grains are still in the cache
//! from their motion, and several steps can follow each other through the bands.

use std::ops::Range;
use std::sync::OnceLock;

use crate::dimension::Dimension;

use super::{Cell, GrainState, body};

/// The owned grains of each share and band: one share after the other, and in it one band after the
/// other. Every pair of the list is within a band, or between one and the next.
#[derive(Debug, Clone)]
pub struct Bands {
    /// The end of each band of each share.
    ends: Vec<usize>,
    /// Number of bands.
    count: usize,
    /// The lowest heights of the bands but the first (m), the same on all ranks.
    bounds: Vec<f64>,
    /// The number of the band of each owned grain and ghost, if there are several bands.
    numbers: Vec<u32>,
}

impl Bands {
    /// A single share with a single band of so many grains.
    pub fn one(grains: usize) -> Self {
        Self {
            ends: vec![grains],
            count: 1,
            bounds: Vec::new(),
            numbers: Vec::new(),
        }
    }

    /// Makes all bands of each share one.
    pub(crate) fn join(&mut self) {
        let ends = (0..self.shares()).map(|share| self.share(share).end);
        *self = Self {
            ends: ends.collect(),
            ..Self::one(0)
        };
    }

    /// Number of bands.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Number of shares.
    pub fn shares(&self) -> usize {
        self.ends.len() / self.count
    }

    /// Number of owned grains.
    fn owned(&self) -> usize {
        self.ends[self.ends.len() - 1]
    }

    /// The grains of a share.
    pub fn share(&self, share: usize) -> Range<usize> {
        self.grains_of(share, 0..self.count)
    }

    /// The grains of a band of a share.
    pub fn grains(&self, share: usize, band: usize) -> Range<usize> {
        self.grains_of(share, band..band + 1)
    }

    /// The grains of some bands of a share.
    pub(crate) fn grains_of(&self, share: usize, bands: Range<usize>) -> Range<usize> {
        let [start, end] = [bands.start, bands.end].map(|band| {
            let before = (share * self.count + band).checked_sub(1);
            before.map_or(0, |before| self.ends[before])
        });
        start..end
    }

    /// The grains of a band of a share and of the band before, which is all that its pairs have: a
    /// pair of two bands is a pair of the later one.
    pub fn grains_of_pairs(&self, share: usize, band: usize) -> Range<usize> {
        self.grains_of(share, band.saturating_sub(1)..band + 1)
    }

    /// The share of an owned grain.
    pub(crate) fn share_of(&self, grain: usize) -> usize {
        let ends = self.ends.chunks_exact(self.count);
        ends.take_while(|of_share| of_share[self.count - 1] <= grain)
            .count()
    }

    /// The band of a local grain.
    pub(crate) fn of(&self, grain: usize) -> usize {
        // With feet there is one band.
        self.numbers.get(grain).map_or(0, |&band| band as usize)
    }

    /// Finds the bands of the ghosts, which have these positions (m), and which their owners have
    /// sorted by the same bounds.
    pub(crate) fn set_ghosts<D: Dimension>(
        &mut self,
        cell: &Cell,
        ghosts: impl Iterator<Item = [f64; 3]>,
    ) {
        self.numbers.truncate(self.owned());
        for place in ghosts {
            let band = self.of_height(height::<D>(cell, &place));
            self.numbers.push(band as u32);
        }
    }

    fn of_height(&self, height: f64) -> usize {
        self.bounds.partition_point(|bound| *bound <= height)
    }

    /// Whether every pair of local grains is within a band, or between one and the next.
    pub(crate) fn hold(&self, mut pairs: impl Iterator<Item = [u32; 2]>) -> bool {
        pairs.all(|pair| {
            let [i, j] = pair.map(|g| self.of(g as usize));
            i.abs_diff(j) <= 1
        })
    }

    /// Sorts grains that are in the order of their cells into bands with these bounds (m), each of
    /// which is cut along x into `shares` of as many grains. Of a band of a share those of a wall
    /// come together, because every step reads them alone; else grains keep their order.
    pub(crate) fn sort<D: Dimension>(
        grains: &mut Vec<GrainState>,
        cell: &Cell,
        bounds: Vec<f64>,
        shares: usize,
    ) -> Self {
        let count = bounds.len() + 1;
        let mut bands = Self {
            ends: vec![0; shares * count],
            count,
            bounds,
            numbers: Vec::new(),
        };
        let band_of = |grain: &GrainState| bands.of_height(height::<D>(cell, &grain.position));
        let band_of_grain: Vec<usize> = grains.iter().map(band_of).collect();
        let mut sizes = vec![0; count];
        for band in &band_of_grain {
            sizes[*band] += 1;
        }
        let mut before = vec![0; count];
        let mut order: Vec<(usize, u32, u32)> = Vec::with_capacity(grains.len());
        for (grain, band) in band_of_grain.into_iter().enumerate() {
            let share = before[band] * shares / sizes[band];
            before[band] += 1;
            let place = share * count + band;
            bands.ends[place] += 1;
            order.push((place, grains[grain].body, grain as u32));
        }
        let mut end = 0;
        for (place, size) in bands.ends.iter_mut().enumerate() {
            end += *size;
            *size = end;
            if count > 1 {
                bands.numbers.resize(end, (place % count) as u32);
            }
        }
        order.sort_unstable();
        let sorted = order.iter().map(|&(_, _, grain)| grains[grain as usize]);
        *grains = sorted.collect();
        bands
    }

    /// Bounds (m) of bands of this size for these grains, each at least this thick (m). None of
    /// them is above `top` (m), so that all grains there are in the last band. There are none if
    /// the bands would be too large.
    pub(crate) fn bounds<D: Dimension>(
        grains: &[GrainState],
        cell: &Cell,
        thickness: f64,
        size: BandSize,
        top: f64,
    ) -> Vec<f64> {
        if grains.len() <= size.least {
            return Vec::new();
        }
        let heights = grains.iter().map(|g| height::<D>(cell, &g.position));
        let mut heights: Vec<f64> = heights.collect();
        heights.sort_unstable_by(f64::total_cmp);
        let mut bounds = Vec::new();
        let mut low = heights.first().copied().unwrap_or_default();
        let (mut below, mut largest) = (0, 0);
        while let Some(after) = heights.get(below + size.wanted) {
            let bound = after.max(low + thickness);
            let next = heights.partition_point(|height| *height < bound);
            if bound > top || next == heights.len() {
                break;
            }
            largest = largest.max(next - below);
            bounds.push(bound);
            (low, below) = (bound, next);
        }
        if largest.max(heights.len() - below) > size.most {
            bounds.clear();
        }
        bounds
    }

    /// The lowest height of a grain of the top wall (m); infinite if there is none.
    pub(crate) fn lowest_of_top<D: Dimension>(grains: &[GrainState], cell: &Cell) -> f64 {
        let of_top = grains.iter().filter(|grain| grain.body == body::TOP);
        let heights = of_top.map(|grain| height::<D>(cell, &grain.position));
        heights.fold(f64::INFINITY, f64::min)
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

    /// For a last-level cache that so many `ranks` share. Bands gain nothing if all grains fit into
    /// it, or if several bands do not fit. Each thread has some of a band: what one does alone for
    /// each band is to be little beside its work.
    pub fn by_cache<D: Dimension>(ranks: usize, threads: usize) -> Self {
        let (cache, cores) = cache_and_its_cores();
        let grains = cache / ranks.clamp(1, cores) / bytes_of_a_grain::<D>();
        Self {
            least: grains,
            wanted: 1000 * threads,
            most: grains / 10,
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

/// Bytes of the last-level cache of this processor, and how many of its virtual cores have it.
fn cache_and_its_cores() -> (usize, usize) {
    static CACHE: OnceLock<(usize, usize)> = OnceLock::new();
    let read = |name: &str| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index3/{name}");
        std::fs::read_to_string(path).ok()
    };
    let bytes = || -> Option<usize> {
        let kibibytes = read("size")?.trim().strip_suffix('K')?.parse::<usize>();
        Some(kibibytes.ok()? << 10)
    };
    // A mask in hexadecimal digits, in groups of eight.
    let cores = || -> Option<usize> {
        let mask = read("shared_cpu_map")?;
        let digits = mask.chars().filter_map(|digit| digit.to_digit(16));
        Some(digits.map(|digit| digit.count_ones() as usize).sum())
    };
    *CACHE.get_or_init(|| {
        let cores = cores().unwrap_or(1).max(1);
        (bytes().unwrap_or(USUAL_CACHE), cores)
    })
}

/// The height of a place (m); in a cell that is periodic along its last axis the distance from the
/// nearer of both edges, so that bands at both edges are one.
fn height<D: Dimension>(cell: &Cell, place: &[f64; 3]) -> f64 {
    let height = place[D::UP];
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

    fn sorted(
        cell: Cell,
        thickness: f64,
        wanted: usize,
        shares: usize,
    ) -> (Vec<GrainState>, Bands) {
        let mut grains = column(20);
        let top = Bands::lowest_of_top::<Two>(&grains, &cell);
        let size = BandSize::given(wanted);
        let bounds = Bands::bounds::<Two>(&grains, &cell, thickness, size, top);
        let bands = Bands::sort::<Two>(&mut grains, &cell, bounds, shares);
        assert_eq!((bands.owned(), bands.shares()), (20, shares));
        (grains, bands)
    }

    /// Fails unless pairs up to this distance (m) are within a band or between one and the next.
    fn check(grains: &[GrainState], bands: &Bands, cell: &Cell, reach: f64) {
        let mut pairs = Vec::new();
        for i in 0..grains.len() {
            for j in 0..i {
                let apart = cell.separation::<Two>(&grains[i].position, &grains[j].position);
                if apart[1].abs() < reach {
                    pairs.push([i as u32, j as u32]);
                }
            }
        }
        assert!(bands.hold(pairs.into_iter()));
    }

    #[test]
    fn bands_are_thick_enough_and_the_last_has_the_top() {
        let cell = Cell::between_walls([1.0, f64::INFINITY]);
        for (thickness, wanted, count) in [(2.5, 1, 7), (1.0, 4, 5), (1.0, 20, 1), (9.0, 2, 2)] {
            let (grains, bands) = sorted(cell, thickness, wanted, 1);
            assert_eq!(bands.count(), count, "{thickness} {wanted}");
            check(&grains, &bands, &cell, thickness);
            let last = bands.grains(0, count - 1);
            let top = (0..20).filter(|&g| grains[g].body == body::TOP);
            assert!(top.into_iter().all(|g| last.contains(&g)));
            let of = (0..20).map(|g| bands.of(g));
            assert!(of.is_sorted());
        }
        let (_, bands) = sorted(cell, 1.0, 5, 1);
        assert!(!bands.hold([[0, 19]].into_iter()));
    }

    /// Every share has as many grains of each band, in it the walls come last, and each grain knows
    /// its share and its band.
    #[test]
    fn every_share_has_its_part_of_every_band() {
        let cell = Cell::between_walls([1.0, f64::INFINITY]);
        for shares in [1, 2, 3] {
            let (grains, mut bands) = sorted(cell, 1.0, 6, shares);
            assert_eq!(bands.count(), 3);
            check(&grains, &bands, &cell, 1.0);
            let mut end = 0;
            for share in 0..shares {
                assert_eq!(bands.share(share).start, end);
                for band in 0..bands.count() {
                    let here = bands.grains(share, band);
                    assert_eq!(here.start, end);
                    end = here.end;
                    let of_band: usize = (0..shares).map(|k| bands.grains(k, band).len()).sum();
                    assert!(here.len().abs_diff(of_band / shares) <= 1, "{here:?}");
                    assert!(grains[here.clone()].is_sorted_by_key(|grain| grain.body));
                    for g in here {
                        assert_eq!((bands.share_of(g), bands.of(g)), (share, band));
                    }
                }
                assert_eq!(bands.share(share).end, end);
            }
            let of_shares: Vec<_> = (0..shares).map(|share| bands.share(share)).collect();
            bands.join();
            assert_eq!((bands.count(), bands.shares()), (1, shares));
            for (share, grains) in of_shares.into_iter().enumerate() {
                assert_eq!(bands.share(share), grains);
            }
        }
    }

    #[test]
    fn bands_of_a_periodic_cell_close_at_its_edges() {
        let mut cell = Cell::between_walls([40.0, f64::INFINITY]);
        cell.sheared = Some(Sheared::upright(20.0));
        // There is no top.
        let mut grains = column(20);
        grains.iter_mut().for_each(|grain| grain.body = body::FREE);
        let size = BandSize::given(4);
        let bounds = Bands::bounds::<Two>(&grains, &cell, 2.0, size, f64::INFINITY);
        let bands = Bands::sort::<Two>(&mut grains, &cell, bounds, 1);
        assert!(bands.count() > 1);
        check(&grains, &bands, &cell, 2.0);
    }
}
