//! How long a list of pairs remains complete, and its skin.

use crate::dimension::Dimension;
use crate::domain::{Exchange, most_ranks};
use crate::failure::{Failure, Result};
use crate::motion::GrainMotion;
use crate::state::{CandidatePair, Cell, Grains};

/// Bounds of an adaptive skin over d̄.
const THINNEST_SKIN: f64 = 0.002;
/// The greatest adaptive skin over d̄.
pub const THICKEST_SKIN: f64 = 0.4;
const FIRST_SKIN: f64 = 0.02;
/// Steps between rebuilds at which the skin aims: a rebuild costs about as much as ten steps.
const LIFE: f64 = 600.0;
/// Of the grains of a sample (m).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Diameters {
    /// The greatest.
    pub greatest: f64,
    /// d̄.
    pub mean: f64,
}

/// How long the list of pairs remains complete.
#[derive(Debug, Default)]
pub struct List {
    /// Greatest diameter (m), and greatest gap of grains in contact (m).
    pub(crate) diameter: f64,
    pub(crate) gap: f64,
    /// Present skin (m): pairs are listed up to R_i + R_j + gap + skin.
    pub(crate) skin: f64,
    /// Least and greatest skin (m) in a wide cell; equal if the skin is given.
    wished: [f64; 2],
    /// Least and greatest skin in the present cell (m).
    range: [f64; 2],
    /// Greatest number of steps between rebuilds; 0 for no limit.
    every: u64,
    /// Step of the last rebuild.
    pub(crate) built: u64,
    /// Number of rebuilds.
    pub rebuilds: u64,
    /// Whether the list must be rebuilt before the next step.
    pub due: bool,
    /// Upper bound of the displacements since the last rebuild (m).
    bound: f64,
    /// The bound when it first exceeded half the skin in a step of this sweep but the last (m).
    exceeded: Option<f64>,
    /// Upper bound of the lengths of the paths since then (m), for the pairs of each band.
    pub(crate) travelled: Vec<f64>,
    /// How far the grains moved in the last step, at most (m).
    way: f64,
    /// [`Clock::worked`] when the grains last migrated (s).
    pub(crate) worked: f64,
    /// Mean distance in memory of the two grains of a pair, in grains: of this list, and of that
    /// for which the grains were last sorted.
    pub(crate) reach: f64,
    pub(crate) reach_when_sorted: f64,
    /// Whether grains have left their bands since then.
    pub(crate) scattered: bool,
    /// Number of steps from the next one on for which the lists of all ranks last.
    pub(crate) lasting: u64,
    /// By how much rounding may move a grain in a step (m).
    rounding: f64,
    /// How far the images have moved since then along x (m), and the lengths of the cell then (m);
    /// infinite between walls.
    images_moved: f64,
    lengths: [f64; 3],
    /// Positions of the owned grains at the last rebuild.
    origin: Vec<[f64; 3]>,
    /// Heights of planes then (m).
    pub(crate) planes: [f64; 2],
    /// Whether a coordinate is NaN or a grain moved further than half a skin before a rebuild.
    pub unsound: bool,
}

impl List {
    /// Fails unless each of `exchange.size()` slabs, and the cell along the other axes, is wider
    /// than the cutoff.
    pub(crate) fn new(
        exchange: &dyn Exchange,
        settings: ListSettings,
        cell: Cell,
        diameters: Diameters,
    ) -> Result<Self> {
        let Diameters { greatest, mean } = diameters;
        let wished = match settings.skin {
            Some(skin) => [skin; 2],
            None => [THINNEST_SKIN, THICKEST_SKIN],
        };
        let wished = wished.map(|skin| skin * mean);
        let range = Self::range(exchange.size(), cell, greatest, wished)?;
        Ok(Self {
            diameter: greatest,
            skin: (FIRST_SKIN * mean).clamp(range[0], range[1]),
            wished,
            range,
            every: settings.rebuild_every,
            lengths: [f64::INFINITY; 3],
            ..Self::default()
        })
    }

    /// Begins with a list that was made at the beginning of this step, for these grains.
    pub(crate) fn begin<D: Dimension>(
        &mut self,
        step: u64,
        bands: usize,
        grains: &Grains<D>,
        cell: &Cell,
    ) {
        self.due = false;
        // How fast its grains are is not known yet.
        self.lasting = 1;
        self.bound = 0.0;
        self.exceeded = None;
        self.travelled.clear();
        self.travelled.resize(bands, 0.0);
        self.images_moved = 0.0;
        self.lengths = changing_lengths::<D>(cell);
        self.built = step;
        self.rebuilds += 1;
        self.origin.clear();
        self.origin
            .extend((0..grains.owned).map(|g| grains.position(g)));
        // A maximum for each axis: one of all would wait for every coordinate in turn.
        let greatest = self.origin.iter().fold([0.0_f64; 3], |a, x| {
            std::array::from_fn(|axis| a[axis].max(x[axis].abs()))
        });
        let greatest = greatest.into_iter().fold(0.0, f64::max);
        self.rounding = 2.0 * f64::EPSILON * greatest;
    }

    /// Heap in use (bytes).
    pub(crate) fn memory(&self) -> usize {
        self.origin.capacity() * size_of::<[f64; 3]>()
    }

    /// The least and greatest skin (m) on so many ranks, of those wished for in a wide cell.
    fn range(ranks: usize, cell: Cell, diameter: f64, wished: [f64; 2]) -> Result<[f64; 2]> {
        let [length, width] = cell.periods;
        let higher = cell.sheared.map_or(f64::INFINITY, |s| 0.5 * s.height);
        // The factor by which the tilt of the images lengthens the cutoff along x.
        let longer = cell.greatest_cutoff_along_x(1.0);
        let across = width.min(higher);
        let widest = 0.98 * (length / (longer * ranks as f64)).min(across) - diameter;
        let range = [wished[0], wished[1].min(widest)];
        let cutoff = diameter + range[0];
        if range[1] < range[0] {
            let most = most_ranks(0.98 * length, longer * cutoff);
            return Err(Failure::input(if most == 0 || 0.98 * across < cutoff {
                format!(
                    "the cell is too small, so that grains would touch their own images: its length, its width and half \
                     the height between its images must be greater than the cutoff (the greatest diameter and the \
                     skin, {cutoff:.4e} m), and the least of them is {:.4e} m",
                    length.min(across)
                )
            } else {
                format!(
                    "{ranks} ranks are too many for this cell: a slab must be wider than the cutoff (the greatest \
                     diameter and the skin, {cutoff:.4e} m), and the cell is sample.length = {length:.4e} m long; run it on 1 to {most} ranks",
                )
            }));
        }
        Ok(range)
    }

    /// How far (m) grains of up to `fastest` (m/s) come in a `step` (s), with what a moving cell
    /// adds.
    pub(crate) fn way(&self, fastest: f64, step: f64, cell: &Cell) -> f64 {
        // Half of it for a pair across the top, and all of it for a grain that was wrapped there.
        // Pairs near the cutoff are stretched by as much as the cell.
        let more =
            1.5 * images_step(step, cell).abs() + 0.5 * self.cutoff() * cell.stretched_by(step);
        step * fastest + more
    }

    /// The grains of the pairs of a band moved by up to `way` (m) in a step.
    pub(crate) fn travel(&mut self, band: usize, way: f64) {
        self.travelled[band] = self.travelled_after(band, way);
    }

    /// How far they have travelled if they move by up to `way` (m) in a step.
    pub(crate) fn travelled_after(&self, band: usize, way: f64) -> f64 {
        self.travelled[band] + (way + self.rounding)
    }

    /// All grains moved by up to `way` (m) in a step. Returns whether the list must be rebuilt.
    /// `looks`: whether it may look at them, because they are all at this step.
    pub(crate) fn moved<D: Dimension>(
        &mut self,
        way: f64,
        motion: &GrainMotion,
        grains: &Grains<D>,
        planes: Option<[f64; 2]>,
        looks: bool,
    ) -> bool {
        let cell = &motion.cell;
        let half_stretch = cell.sheared.map_or(1.0, |sheared| sheared.half_stretch);
        self.images_moved *= half_stretch * half_stretch;
        self.images_moved += images_step(motion.step, cell);
        let half = 0.5 * self.skin;
        self.bound += way;
        self.way = way;
        // The next step may be up to twice as fast.
        let margin = 2.0 * way;
        let is_near = |bound: f64, part: f64| bound + margin > part * half;
        let is_unsure = is_near(self.bound, 0.9);
        if !(is_unsure && looks) {
            self.unsound |= way.is_nan();
            if self.bound > half {
                self.exceeded.get_or_insert(self.bound);
            }
            return is_unsure;
        }
        // Where the bound exceeded half the skin, a grain may have been further away than it is
        // now, by the paths since then.
        let since = self.exceeded.take().map_or(0.0, |bound| self.bound - bound);
        // One at infinity moves by a NaN, which `max` leaves out.
        let planes = planes.into_iter().flatten().zip(self.planes);
        let of_planes = planes.fold(0.0, |most: f64, (now, then)| most.max((now - then).abs()));
        let of_grains = self.displacement(grains, cell).max(of_planes);
        let exact = of_grains + 0.5 * self.cutoff() * self.strain::<D>(cell);
        self.bound = exact;
        self.unsound = way.is_nan() || exact.is_nan() || exact + since > half;
        // Slightly early, which avoids looking at every grain in every step.
        is_near(self.bound, 0.8)
    }

    /// Whether the list lasts for so many steps from this one on even if the grains become twice as
    /// fast.
    pub(crate) fn lasts(&self, step: u64, steps: u64) -> bool {
        let room = 0.9 * 0.5 * self.skin - self.bound;
        let is_forced = self.every > 0 && step + steps > self.built + self.every;
        !is_forced && room > 2.0 * self.way * (steps + 1) as f64
    }

    /// The strain of the cell since the last rebuild, at most: by this part a pair may have
    /// approached besides the displacements.
    fn strain<D: Dimension>(&self, cell: &Cell) -> f64 {
        cell.sheared.map_or(0.0, |sheared| {
            let sheared_by = self.images_moved / sheared.height;
            let lengths = changing_lengths::<D>(cell).into_iter().zip(self.lengths);
            let strains = lengths.map(|(now, then)| (now / then - 1.0).abs());
            sheared_by.abs() + strains.sum::<f64>()
        })
    }

    /// The greatest displacement of an owned grain besides that of the cell (m).
    fn displacement<D: Dimension>(&self, grains: &Grains<D>, cell: &Cell) -> f64 {
        self.squares(grains, cell)
            .fold(0.0, |a: f64, b| if b > a { b } else { a })
            .sqrt()
    }

    /// The owned grain that moved furthest; there must be one.
    pub(crate) fn furthest<D: Dimension>(&self, grains: &Grains<D>, cell: &Cell) -> usize {
        let squares = self.squares(grains, cell).enumerate();
        squares
            .fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a })
            .0
    }

    /// Squared displacements of the owned grains besides that of the cell (m²).
    fn squares<D: Dimension>(&self, grains: &Grains<D>, cell: &Cell) -> impl Iterator<Item = f64> {
        let lengths = changing_lengths::<D>(cell);
        let moves = lengths != self.lengths || self.images_moved != 0.0;
        let then = self.lengths;
        let grows: [f64; 3] = std::array::from_fn(|axis| lengths[axis] / then[axis]);
        let shears = self.images_moved / lengths[D::UP];
        self.origin.iter().zip(&grains.record).map(move |(o, r)| {
            let mut carried = *o;
            if moves {
                for axis in 0..D::AXES {
                    carried[axis] *= grows[axis];
                }
                carried[0] += shears * carried[D::UP];
            }
            let moved = cell.separation::<D>(D::fields(r), &carried);
            moved.iter().map(|x| x * x).sum()
        })
    }

    /// Makes the skin of the next list at least this (m).
    pub fn widen(&mut self, skin: f64) {
        self.skin = self.skin.max(skin);
    }

    /// Makes the next list last for some steps of this length (m), as far as the slabs allow.
    pub fn expect(&mut self, way: f64) {
        self.skin = self.skin.max((4.0 * way).min(self.range[1]));
    }

    /// Makes every skin at least this (m), as far as the slabs allow. A skin that the scene gives
    /// stays.
    pub fn at_least(&mut self, skin: f64) {
        let raised = |[least, most]: [f64; 2]| [least.max(skin.min(most)), most];
        (self.wished, self.range) = (raised(self.wished), raised(self.range));
        self.skin = self.skin.clamp(self.range[0], self.range[1]);
    }

    /// Whether `bookkeeping.rebuild_every` requires a rebuild after this number of steps: the list
    /// was made at the beginning of step `built`.
    pub fn forced(&self, steps: u64) -> bool {
        self.every > 0 && steps + 1 - self.built >= self.every
    }

    /// Fits the skin to a cell and to the gap.
    pub(crate) fn fit(&mut self, exchange: &dyn Exchange, cell: Cell) -> Result<()> {
        let greatest = self.diameter + self.gap;
        let range = Self::range(exchange.size(), cell, greatest, self.wished)?;
        if range != self.range {
            self.range = range;
            self.skin = self.skin.min(range[1]);
        }
        Ok(())
    }

    pub(crate) fn cutoff(&self) -> f64 {
        self.diameter + self.listed_gap()
    }

    /// The greatest gap of a listed pair (m).
    pub fn listed_gap(&self) -> f64 {
        self.gap + self.skin
    }

    fn adapts(&self) -> bool {
        self.rebuilds > 0 && self.every == 0
    }

    /// Whether neighbours have drifted apart in memory since the grains were sorted.
    pub(crate) fn is_scattered(&self) -> bool {
        self.scattered || self.reach > 1.5 * self.reach_when_sorted
    }

    /// Adapts the skin to lists that last so many steps: with a thicker one pairs that do not
    /// touch cost more time, with a thinner one rebuilds.
    pub(crate) fn adapt(&mut self, lasted: u64) {
        if self.adapts() {
            self.skin *= (LIFE / lasted as f64).clamp(0.5, 2.0);
            self.skin = self.skin.clamp(self.range[0], self.range[1]);
        }
    }
}

/// How far the images above move along x in a `step` (s, m).
fn images_step(step: f64, cell: &Cell) -> f64 {
    cell.sheared.map_or(0.0, |s| s.step_of_images(step))
}

/// The lengths of a cell that may change (m): infinite between walls.
fn changing_lengths<D: Dimension>(cell: &Cell) -> [f64; 3] {
    match cell.sheared {
        Some(_) => cell.lengths::<D>(),
        None => [f64::INFINITY; 3],
    }
}

/// Mean distance in memory of the two grains of a pair of one body, in grains.
pub(crate) fn reach(pairs: &[CandidatePair], body: &[u32]) -> f64 {
    let (mut all, mut pairs_of_one) = (0, 0_u32);
    for &CandidatePair { grains: [i, j], .. } in pairs {
        if body[i as usize] == body[j as usize] {
            all += u64::from(i.abs_diff(j));
            pairs_of_one += 1;
        }
    }
    all as f64 / f64::from(pairs_of_one.max(1))
}

/// Settings of the list of pairs. They change the speed of a run and not its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ListSettings {
    /// Skin over d̄; `None` adapts it to the frequency of rebuilds.
    pub skin: Option<f64>,
    /// Greatest number of steps between rebuilds; 0 for no limit.
    pub rebuild_every: u64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dimension::Two;
    use crate::simd::Isa;
    use crate::state::{GrainState, Masses, Units};
    use bytemuck::Zeroable;

    /// In a sweep only the last step looks at the grains: one that left and came back is noticed.
    #[test]
    fn a_list_is_unsound_if_a_grain_may_have_left_within_a_sweep() {
        let grain = GrainState {
            radius: 0.5,
            position: [5.0, 5.0, 0.0],
            ..GrainState::zeroed()
        };
        let mut grains = Grains::<Two>::default();
        grains.replace(&[grain], &Masses::Equal(1.0), 1.0);
        let motion = GrainMotion {
            isa: Isa::Portable,
            units: Units::new(1.0, 1.0),
            gravity: [0.0; 2],
            step: 1.0,
            cell: Cell::between_walls([10.0, f64::INFINITY]),
            streaming: None,
            is_stressed: false,
            walls: None,
        };
        // Half the skin is 0.5, and the grain is where it was.
        for (ways, unsound) in [
            (&[0.3, 0.1, 0.6][..], false),
            (&[0.3, 0.3, 0.1, 0.3], false),
            (&[0.3, 0.3, 0.1, 0.5], true),
        ] {
            let mut list = List {
                skin: 1.0,
                lengths: [f64::INFINITY; 3],
                origin: vec![[5.0, 5.0, 0.0]],
                ..List::default()
            };
            for (k, way) in ways.iter().enumerate() {
                list.moved(*way, &motion, &grains, None, k + 1 == ways.len());
            }
            assert_eq!(list.unsound, unsound, "{ways:?}");
        }
    }
}
