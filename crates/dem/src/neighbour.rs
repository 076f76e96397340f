//! Candidate pairs: grains sorted into cells, then pairs within the cutoff.

use std::marker::PhantomData;
use std::ops::Range;

use crate::dimension::Dimension;
use crate::simd::{Isa, LANES, Lanes, Lanes16, Mask, Work};
use crate::state::{CandidatePair, Cell, GrainState, Grains, body};
use crate::workers::{self, Workers};

/// The interval along x, by `Cell::slab_coordinate`, that holds the owned grains and ghosts of a
/// rank.
#[derive(Debug, Clone, Copy)]
pub struct LocalExtent {
    /// Its start (m); may be negative.
    pub from: f64,
    /// Its width (m), at most the period.
    pub width: f64,
}

impl LocalExtent {
    /// A whole period (m).
    pub fn whole(period: f64) -> Self {
        Self {
            from: 0.0,
            width: period,
        }
    }
}

/// The cutoff of the list.
#[derive(Debug, Clone, Copy)]
pub struct Cutoff {
    /// At least the greatest R_i + R_j + `skin` (m).
    pub greatest: f64,
    /// Pairs closer than R_i + R_j + `skin` (m) are listed.
    pub skin: f64,
}

/// Cells along one axis.
#[derive(Debug, Clone, Copy)]
struct CellAxis {
    low: f64,
    /// Cells per length (1/m).
    per_length: f64,
    /// Number of cells, and of cells in a period, if there is one.
    count: usize,
    period: Option<usize>,
    /// Index of the first cell in the period.
    first: i64,
}

impl CellAxis {
    /// Cells of at least `cutoff` (m) in a period, for the interval of this `width` (m) that begins
    /// at `from`.
    fn periodic(period: f64, from: f64, width: f64, cutoff: f64) -> Self {
        let all = ((period / cutoff) as usize).max(1);
        let cell = period / all as f64;
        Self {
            low: 0.0,
            per_length: all as f64 / period,
            count: ((width / cell) as usize + 4).min(all),
            period: Some(all),
            first: (from / cell).floor() as i64 - 1,
        }
    }

    /// Cells of at least `cutoff` (m) from `low` to `high`, at most `most`: a few grains may be far
    /// above the others.
    fn open(low: f64, high: f64, cutoff: f64, most: usize) -> Self {
        let count = (((high - low) / cutoff) as usize).clamp(1, most.max(1));
        Self {
            low,
            per_length: count as f64 / (high - low),
            count,
            period: None,
            first: 0,
        }
    }

    #[inline]
    fn cell(&self, x: f64) -> usize {
        let at = ((x - self.low) * self.per_length) as i64 - self.first;
        let at = match self.period.map(|all| all as i64) {
            Some(all) if !(0..all).contains(&at) => at.rem_euclid(all),
            _ => at,
        };
        (at as usize).min(self.count - 1)
    }

    /// The cell and its neighbours, each once.
    fn with_neighbours(&self, cell: usize) -> impl Iterator<Item = usize> + Clone {
        let ring = self.period == Some(self.count);
        let count = self.count;
        let before = match cell {
            0 if ring && count > 2 => Some(count - 1),
            0 => None,
            k => Some(k - 1),
        };
        let after = match cell + 1 {
            k if k < count => Some(k),
            _ if ring && count > 2 => Some(0),
            _ => None,
        };
        [before, Some(cell), after].into_iter().flatten()
    }
}

/// Positions sorted into cells.
#[derive(Debug)]
pub struct Bins<D: Dimension> {
    cell: Cell,
    axes: [CellAxis; 3],
    /// First of the members of each cell, and one more at the end.
    start: Vec<u32>,
    member: Vec<u32>,
    dimension: PhantomData<D>,
}

impl<D: Dimension> Bins<D> {
    /// Cells of at least `cutoff` (m) for these positions (m), which lie in the extent.
    pub fn new(cell: Cell, extent: LocalExtent, cutoff: f64, position: &[[f64; 3]]) -> Self {
        // The index runs slowest along x, which may be limited to the extent of a rank; fastest
        // along the last axis.
        let mut axes = [CellAxis::open(0.0, 0.0, 1.0, 1); 3];
        for (axis, cells) in axes[..D::UP].iter_mut().enumerate() {
            let period = cell.periods[axis];
            let along = cell.cutoff_along_x(cutoff);
            *cells = match axis {
                0 => CellAxis::periodic(period, extent.from, extent.width, along),
                _ => CellAxis::periodic(period, 0.0, period, cutoff),
            };
        }
        let heights = || position.iter().map(|x| x[D::UP]);
        let low = heights().fold(f64::INFINITY, f64::min);
        let high = heights().fold(f64::NEG_INFINITY, f64::max);
        axes[D::UP] = match &cell.sheared {
            None => CellAxis::open(low, high, cutoff, position.len()),
            Some(sheared) => CellAxis::periodic(sheared.height, 0.0, sheared.height, cutoff),
        };
        let mut bins = Self {
            cell,
            axes,
            start: Vec::new(),
            member: Vec::new(),
            dimension: PhantomData,
        };

        // Counting sort.
        let all = axes[..D::AXES].iter().map(|a| a.count).product::<usize>();
        bins.start = vec![0u32; all + 1];
        let cells: Vec<u32> = position
            .iter()
            .map(|x| bins.index(bins.at(x)) as u32)
            .collect();
        for &k in &cells {
            bins.start[k as usize + 1] += 1;
        }
        for k in 1..bins.start.len() {
            bins.start[k] += bins.start[k - 1];
        }
        bins.member = vec![0u32; position.len()];
        let mut next = bins.start.clone();
        for (g, &k) in cells.iter().enumerate() {
            bins.member[next[k as usize] as usize] = g as u32;
            next[k as usize] += 1;
        }
        bins
    }

    fn at(&self, x: &[f64; 3]) -> [usize; 3] {
        let mut at = [self.axes[0].cell(self.cell.slab_coordinate::<D>(x)), 0, 0];
        for axis in 1..D::AXES {
            at[axis] = self.axes[axis].cell(x[axis]);
        }
        at
    }

    fn index(&self, at: [usize; 3]) -> usize {
        let cells = at.iter().zip(&self.axes).take(D::AXES);
        cells.fold(0, |index, (at, axis)| index * axis.count + at)
    }

    /// Calls `visit` once with every position that may lie within the cutoff of x (m), including x
    /// itself.
    #[inline]
    pub fn each_near(&self, x: &[f64; 3], mut visit: impl FnMut(u32)) {
        self.each_column(self.at(x), |column| {
            self.member[column].iter().for_each(|&b| visit(b));
        });
    }

    /// Calls `visit` once with each range of members that may lie within the cutoff of those of a
    /// cell.
    #[inline]
    fn each_column(&self, here: [usize; 3], mut visit: impl FnMut(Range<usize>)) {
        // Members of consecutive cells along the last axis are contiguous. If that axis is periodic
        // and the cells wrap around, all of them are taken.
        let column = self.axes[D::UP].with_neighbours(here[D::UP]);
        let (bottom, top) = column.fold((usize::MAX, 0), |(a, b), k| (a.min(k), b.max(k)));
        let mut visit_column = |mut place: [usize; 3]| {
            place[D::UP] = bottom;
            let from = self.start[self.index(place)] as usize;
            place[D::UP] = top;
            visit(from..self.start[self.index(place) + 1] as usize);
        };
        for x in self.axes[0].with_neighbours(here[0]) {
            if D::UP == 1 {
                visit_column([x, 0, 0]);
            } else {
                self.axes[1]
                    .with_neighbours(here[1])
                    .for_each(|y| visit_column([x, y, 0]));
            }
        }
    }

    /// The members of a cell; if it has any, `columns` then holds all that may be near them.
    fn near_cell(&self, cell: usize, columns: &mut Vec<Range<usize>>) -> Range<usize> {
        let members = self.start[cell] as usize..self.start[cell + 1] as usize;
        if members.is_empty() {
            return members;
        }
        let [_, y, z] = self.axes.map(|axis| axis.count);
        let here = match D::AXES {
            2 => [cell / y, cell % y, 0],
            _ => [cell / (y * z), cell / z % y, cell % z],
        };
        columns.clear();
        self.each_column(here, |column| columns.push(column));
        members
    }
}

/// Sorts grains by their cells, so that what lies near is near in memory; in a cell they keep their
/// order.
pub(crate) fn sort_by_cells<D: Dimension>(
    grains: &mut Vec<GrainState>,
    cell: Cell,
    extent: LocalExtent,
    cutoff: f64,
) {
    let position: Vec<[f64; 3]> = grains.iter().map(|g| g.position).collect();
    let bins = Bins::<D>::new(cell, extent, cutoff, &position);
    *grains = bins.member.iter().map(|&g| grains[g as usize]).collect();
}

/// What the search for pairs reads of the grains, in the order of the cells: what lies near is near
/// in memory. Followed by as many of radius NaN as there are lanes: nothing is nearer than that,
/// nor than a grain that was removed.
struct Placed {
    /// Positions (m) and radii (m).
    numbers: [Vec<f64>; 4],
    id: Vec<u32>,
    /// [`GHOST`], [`WALL`]: two grains that have one of them in common are no pair.
    class: Vec<u8>,
}

impl Placed {
    fn new<D: Dimension>(grains: &Grains<D>, member: &[u32]) -> Self {
        let members = || member.iter().map(|&g| g as usize);
        let mut numbers = [const { Vec::new() }; 4];
        for (axis, values) in numbers[..D::AXES].iter_mut().enumerate() {
            values.extend(members().map(|g| grains.fields(g)[axis]));
        }
        numbers[3].extend(members().map(|g| match grains.body[g] {
            body::REMOVED => f64::NAN,
            _ => grains.radius[g],
        }));
        for values in &mut numbers {
            values.resize(values.len() + LANES, f64::NAN);
        }
        let class = |g: usize| {
            let is = |class: u8, is: bool| if is { class } else { 0 };
            is(GHOST, g >= grains.owned) + is(WALL, grains.body[g] != body::FREE)
        };
        Self {
            numbers,
            id: members().map(|g| grains.id[g]).collect(),
            class: members().map(class).collect(),
        }
    }

    /// Sixteen positions or radii from member k on.
    #[inline(always)]
    fn lanes<L: Lanes>(&self, token: L::Token, quantity: usize, k: usize) -> L {
        let mut lanes = Lanes16::ZERO;
        lanes
            .0
            .copy_from_slice(&self.numbers[quantity][k..k + LANES]);
        L::load(token, &lanes)
    }
}

const GHOST: u8 = 1;
const WALL: u8 = 2;

/// All pairs of local grains closer than R_i + R_j + skin, each with the lower id first, in the
/// order of the cells. Leaves out pairs of two ghosts, which other ranks have, and of two wall
/// grains, which do not move relative to each other.
pub fn pairs<D: Dimension>(
    isa: Isa,
    workers: Option<&Workers>,
    grains: &Grains<D>,
    cell: Cell,
    extent: LocalExtent,
    cutoff: Cutoff,
) -> Vec<CandidatePair> {
    let local = grains.local();
    let position: Vec<[f64; 3]> = (0..local).map(|g| grains.position(g)).collect();
    let bins = Bins::<D>::new(cell, extent, cutoff.greatest, &position);
    let placed = Placed::new(grains, &bins.member);
    // The cells of each thread, which hold as many grains.
    let threads = workers::count(workers);
    let begin = |part: usize| {
        let before = (local * part / threads) as u32;
        bins.start.partition_point(|start| *start < before)
    };
    let mut parts = vec![Vec::new(); threads];
    workers::each(workers, &mut parts, |k, pairs| {
        *pairs = isa.run(Search {
            bins: &bins,
            cells: begin(k)..begin(k + 1),
            placed: &placed,
            skin: cutoff.skin,
        });
    });
    let joined = parts.into_iter().reduce(|mut pairs, more| {
        pairs.extend(more);
        pairs
    });
    joined.unwrap_or_default()
}

/// The search for pairs, each of which is found from the first of its two in [`Bins::member`].
struct Search<'a, D: Dimension> {
    bins: &'a Bins<D>,
    cells: Range<usize>,
    /// By [`Bins::member`].
    placed: &'a Placed,
    skin: f64,
}

impl<D: Dimension> Search<'_, D> {
    /// Of sixteen members from `other` on, those that are near member k, and all their gaps (m).
    #[inline(always)]
    fn near<L: Lanes>(&self, token: L::Token, k: usize, other: usize) -> (u16, L) {
        let c = |v| L::splat(token, v);
        let Placed { numbers, .. } = self.placed;
        let mut apart = [c(0.0); 3];
        for axis in 0..D::AXES {
            apart[axis] = self.placed.lanes::<L>(token, axis, other) - c(numbers[axis][k]);
        }
        self.bins.cell.nearest_images::<D, L>(token, &mut apart);
        let square = D::dot(&apart, &apart);
        let touch = self.placed.lanes::<L>(token, 3, other) + c(numbers[3][k]);
        let reach = touch + c(self.skin);
        let is_near = (reach * reach).greater(square);
        (is_near.bits(), square.sqrt() - touch)
    }
}

impl<D: Dimension> Work for Search<'_, D> {
    type Output = Vec<CandidatePair>;

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) -> Vec<CandidatePair> {
        let Placed { id, class, .. } = self.placed;
        let member = &self.bins.member;
        let [from, to] = [self.cells.start, self.cells.end].map(|k| self.bins.start[k] as usize);
        let mut pairs = Vec::with_capacity(4 * (to - from));
        let mut columns = Vec::with_capacity(9);
        for cell in self.cells.clone() {
            for k in self.bins.near_cell(cell, &mut columns) {
                for column in &columns {
                    // Each pair once.
                    let after = column.start.max(k + 1)..column.end;
                    for block in after.clone().step_by(LANES) {
                        let (mut near, gap) = self.near::<L>(token, k, block);
                        if after.end - block < LANES {
                            near &= (1 << (after.end - block)) - 1;
                        }
                        if near == 0 {
                            continue;
                        }
                        let gap = gap.to_lanes16();
                        while near != 0 {
                            let lane = near.trailing_zeros() as usize;
                            near &= near - 1;
                            let other = block + lane;
                            if class[k] & class[other] != 0 {
                                continue;
                            }
                            let ordered = id[k] < id[other];
                            let (i, j) = if ordered { (k, other) } else { (other, k) };
                            pairs.push(CandidatePair {
                                grains: [member[i], member[j]],
                                gap: gap.0[lane],
                            });
                        }
                    }
                }
            }
        }
        pairs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dimension::{Three, Two};
    use crate::state::{Masses, Sheared};
    use crate::threads::ThreadPool;
    use bytemuck::Zeroable;

    const CUTOFF: Cutoff = Cutoff {
        greatest: 1.1,
        skin: 0.1,
    };

    /// Compares with a search over all pairs, in narrow and wide cells, with ghosts; `offset` over
    /// L_x of a sheared cell. In an open one the last grain is far above the others.
    fn compare<D: Dimension>(offset: Option<f64>) {
        for (length, width, count, owned) in [
            (2.5, 3.0, 12, 12),
            (5.0, 2.5, 60, 60),
            (20.0, 9.0, 300, 300),
            (20.0, 4.0, 300, 180),
        ] {
            let mut seed = 7u64;
            let mut random = || {
                seed = seed
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                (seed >> 11) as f64 / (1u64 << 53) as f64
            };
            let high = if D::AXES == 2 { 15.0 } else { 4.0 };
            let mut cell = Cell::between_walls([length, width]);
            cell.sheared = offset.map(|part| Sheared {
                offset: part * length,
                ..Sheared::upright(high)
            });
            let states: Vec<GrainState> = (0..count)
                .map(|id| {
                    let mut position = [length, width, high].map(|l| l * random());
                    if offset.is_none() && id + 1 == count {
                        position[2] = 1e12;
                    }
                    if D::AXES == 2 {
                        position = [position[0], position[2], 0.0];
                    }
                    GrainState {
                        id,
                        body: u32::from(random() < 0.1),
                        position,
                        radius: 0.25 + 0.25 * random(),
                        ..GrainState::zeroed()
                    }
                })
                .collect();
            let mut grains = Grains::<D>::default();
            grains.replace(&states[..owned], &Masses::Equal(1.0), 1.0);
            for ghost in &states[owned..] {
                grains.push(ghost);
            }
            let extent = LocalExtent::whole(length);
            let found = pairs(Isa::detect(), None, &grains, cell, extent, CUTOFF);
            let pool = ThreadPool::<D>::new(3).unwrap();
            for isa in [Isa::detect(), Isa::Portable] {
                let threaded = pairs(isa, pool.workers(), &grains, cell, extent, CUTOFF);
                assert_eq!(threaded, found);
            }
            let mut expected = Vec::new();
            for a in 0..states.len() {
                for b in a + 1..states.len() {
                    let (p, q) = (&states[a], &states[b]);
                    // The tests of the cell compare `separation` with a search over images.
                    let apart = cell.separation::<D>(&p.position, &q.position);
                    let square: f64 = apart.iter().map(|x| x * x).sum();
                    let both_ghosts = a >= owned && b >= owned;
                    let both_wall = p.body != 0 && q.body != 0;
                    let listed = f64::sqrt(square) < p.radius + q.radius + 0.1;
                    if listed && !both_ghosts && !both_wall {
                        expected.push([a as u32, b as u32]);
                    }
                }
            }
            assert!(!expected.is_empty());
            let mut found: Vec<_> = found.iter().map(|pair| pair.grains).collect();
            found.sort_unstable();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn sorted_by_cells_neighbours_are_near_in_memory() {
        // A lattice of 50 × 20 grains, numbered at random.
        let mut states: Vec<GrainState> = (0..1000)
            .map(|k| GrainState {
                id: k * 387 % 1000,
                position: [f64::from(k / 20) + 0.5, f64::from(k % 20), 0.0],
                radius: 0.5,
                ..GrainState::zeroed()
            })
            .collect();
        states.sort_unstable_by_key(|g| g.id);
        let cell = Cell::between_walls([50.0, 1.0]);
        let extent = LocalExtent::whole(50.0);
        let furthest = |states: &[GrainState]| {
            let mut grains = Grains::<Two>::default();
            grains.replace(states, &Masses::Equal(1.0), 1.0);
            let pairs = pairs(Isa::detect(), None, &grains, cell, extent, CUTOFF);
            assert_eq!(pairs.len(), 1000 + 19 * 50);
            let across = |p: &CandidatePair| p.grains[0].abs_diff(p.grains[1]);
            let mut apart: Vec<u32> = pairs.iter().map(across).collect();
            apart.sort_unstable();
            // But for those across the edge of the period.
            apart[pairs.len() - 21]
        };
        assert!(furthest(&states) > 500);
        sort_by_cells::<Two>(&mut states, cell, extent, CUTOFF.greatest);
        assert!(furthest(&states) < 60);
    }

    #[test]
    fn finds_what_a_search_over_all_pairs_finds() {
        for offset in [None, Some(0.0), Some(0.23), Some(-0.5)] {
            compare::<Two>(offset);
            compare::<Three>(offset);
        }
    }
}
