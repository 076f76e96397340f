//! The canonical half list and what the contacts remember, in blocks of sixteen pairs.

use std::ops::Range;

use crate::contact::model::PairModel;
use crate::simd::{LANES, Level, PairList, Pairs, Row};

use super::ContactState;

/// Pairs of local grains that touch or may come to, each once, i the lower id: first the blocks of inner pairs, of which this
/// rank owns both grains, then those of which it owns i, then those of which it owns j. Within a group contacts come before pairs
/// that are apart, these by their gaps, window by window of pairs in order of (id of i, id of j): so the kernel finds blocks in which
/// nothing touches behind one another.
///
/// The last block of a group is filled up with a grain and itself, which do not touch. Neither the order nor the extent of the list
/// reaches the numbers: sums of forces are exact, and pairs that do not touch add nothing.
#[derive(Debug, Default)]
pub struct Contacts {
    /// Blocks of inner pairs, and of all pairs of which this rank owns i.
    pub inner: usize,
    pub mine: usize,
    pub pairs: PairList,
    /// R_i + R_j and R_i (m) of every block.
    pub geometry: Vec<[Row; 2]>,
    /// [`Contacts::parameter_rows`] rows per block.
    pub parameters: Vec<Row>,
    /// [`Contacts::history_rows`] rows per block.
    pub history: Vec<Row>,
    /// Rows per block that the law takes for its parameters and for its histories.
    pub parameter_rows: usize,
    pub history_rows: usize,
    /// Lanes that touched when the forces were last computed.
    pub touching: Vec<u16>,
}

/// Two local grains that touch or may come to, the one of lower id first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CandidatePair {
    pub grains: [u32; 2],
    /// |r| - R_i - R_j (m).
    pub gap: f64,
}

impl Contacts {
    /// Replaces the list by the pairs of `near`, sorted by their ids, and gives them back what they remember. `remembered` is sorted by
    /// (i, j); pairs that are not in it start anew. Of the local grains' `id` and `radius` those before `owned` are this rank's.
    pub fn replace(
        &mut self,
        level: Level,
        law: &dyn PairModel,
        near: &[CandidatePair],
        remembered: &[ContactState],
        (id, radius): (&[u32], &[f64]),
        owned: usize,
    ) {
        let own = |g: u32| (g as usize) < owned;
        let group = |of_i: bool, of_j: bool| {
            let kind =
                |near: &&CandidatePair| own(near.grains[0]) == of_i && own(near.grains[1]) == of_j;
            in_order(near.iter().filter(kind), remembered, id)
        };
        let groups = [group(true, true), group(true, false), group(false, true)];
        self.parameter_rows = law.parameter_rows();
        self.history_rows = law.history_rows();
        self.pairs.clear();
        self.geometry.clear();
        self.history.clear();
        self.touching.clear();
        for block in groups.iter().flat_map(|group| group.chunks(LANES)) {
            let mut of_block = Pairs {
                i: [0; LANES],
                j: [0; LANES],
            };
            let mut geometry = [Row([FILLER; LANES]), Row([-0.5 * FILLER; LANES])];
            let mut touching = 0;
            let first = self.history.len();
            self.history.resize(first + self.history_rows, Row::ZERO);
            for (lane, listed) in block.iter().enumerate() {
                let [i, j] = listed.grains;
                of_block.i[lane] = i;
                of_block.j[lane] = j;
                geometry[0].0[lane] = radius[i as usize] + radius[j as usize];
                geometry[1].0[lane] = radius[i as usize];
                if let Some(history) = listed.history {
                    touching |= 1 << lane;
                    let history = law.from_state(history);
                    for (row, from) in self.history[first..].iter_mut().zip(history) {
                        row.0[lane] = from;
                    }
                }
            }
            self.pairs.push(of_block);
            self.geometry.push(geometry);
            self.touching.push(touching);
        }
        let blocks = self.geometry.len();
        self.inner = groups[0].len().div_ceil(LANES);
        self.mine = self.inner + groups[1].len().div_ceil(LANES);
        self.parameters.clear();
        self.parameters
            .resize(blocks * self.parameter_rows, Row::ZERO);
        law.set_parameters(level, &self.geometry, &mut self.parameters);
    }

    /// Some blocks, for the kernel.
    pub fn part(&mut self, blocks: Range<usize>) -> Part<'_> {
        let of = |per_block: usize| blocks.start * per_block..blocks.end * per_block;
        Part {
            first: blocks.start,
            mine: self.mine,
            parameter_rows: self.parameter_rows,
            history_rows: self.history_rows,
            pairs: &self.pairs,
            geometry: &self.geometry[of(1)],
            parameters: &self.parameters[of(self.parameter_rows)],
            history: &mut self.history[of(self.history_rows)],
            touching: &mut self.touching[of(1)],
        }
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.geometry.len()
    }

    /// The touching contacts with local indices, block by block.
    pub fn touching(&self) -> impl Iterator<Item = Touching> + '_ {
        self.touching
            .iter()
            .enumerate()
            .flat_map(move |(block, &mask)| {
                (0..LANES)
                    .filter(move |lane| mask >> lane & 1 == 1)
                    .map(move |lane| Touching {
                        block,
                        lane,
                        i: self.pairs.blocks()[block].i[lane] as usize,
                        j: self.pairs.blocks()[block].j[lane] as usize,
                    })
            })
    }

    /// What a touching contact remembers.
    pub fn state(&self, law: &dyn PairModel, at: Touching, id: &[u32]) -> ContactState {
        let mut history = [0.0; 3];
        let rows = &self.history[at.block * self.history_rows..][..self.history_rows];
        for (to, row) in history.iter_mut().zip(rows) {
            *to = row.0[at.lane];
        }
        ContactState {
            i: id[at.i],
            j: id[at.j],
            history: law.to_state(history),
        }
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        use std::mem::size_of;
        self.pairs.memory()
            + self.geometry.capacity() * size_of::<[Row; 2]>()
            + (self.parameters.capacity() + self.history.capacity()) * size_of::<Row>()
            + self.touching.capacity()
    }
}

/// A pair of the list, and what it remembers where it is a contact.
struct Listed {
    grains: [u32; 2],
    history: Option<[f64; 3]>,
}

/// Pairs among which contacts come first: so many that few blocks hold both, so few that what they need stays in the cache.
const WINDOW: usize = 64 * LANES;

/// A group in the order of the list.
fn in_order<'a>(
    group: impl Iterator<Item = &'a CandidatePair>,
    remembered: &[ContactState],
    id: &[u32],
) -> Vec<Listed> {
    let mut rest = remembered.iter().peekable();
    let mut all: Vec<(f64, Listed)> = group
        .map(|near| {
            let [i, j] = near.grains.map(|g| id[g as usize]);
            while rest.next_if(|c| (c.i, c.j) < (i, j)).is_some() {}
            let contact = rest.next_if(|c| (c.i, c.j) == (i, j));
            let listed = Listed {
                grains: near.grains,
                history: contact.map(|c| c.history),
            };
            (contact.map_or(near.gap, |_| f64::NEG_INFINITY), listed)
        })
        .collect();
    for window in all.chunks_mut(WINDOW) {
        // Stable: contacts stay in order.
        window.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    all.into_iter().map(|(_, listed)| listed).collect()
}

/// Some blocks, as the kernel works on them.
pub struct Part<'a> {
    /// The first of them in the list.
    pub first: usize,
    /// [`Contacts::mine`].
    pub mine: usize,
    /// [`Contacts::parameter_rows`] and [`Contacts::history_rows`].
    pub parameter_rows: usize,
    pub history_rows: usize,
    pub pairs: &'a PairList,
    pub geometry: &'a [[Row; 2]],
    pub parameters: &'a [Row],
    pub history: &'a mut [Row],
    pub touching: &'a mut [u16],
}

impl<'a> Part<'a> {
    pub fn blocks(&self) -> usize {
        self.geometry.len()
    }

    /// Those before the block `until` of the list, and those from it on.
    pub fn split(self, until: usize) -> (Part<'a>, Part<'a>) {
        let here = until - self.first;
        let (geometry, geometry_after) = self.geometry.split_at(here);
        let (parameters, parameters_after) = self.parameters.split_at(here * self.parameter_rows);
        let (history, history_after) = self.history.split_at_mut(here * self.history_rows);
        let (touching, touching_after) = self.touching.split_at_mut(here);
        (
            Part {
                first: self.first,
                mine: self.mine,
                parameter_rows: self.parameter_rows,
                history_rows: self.history_rows,
                pairs: self.pairs,
                geometry,
                parameters,
                history,
                touching,
            },
            Part {
                first: until,
                mine: self.mine,
                parameter_rows: self.parameter_rows,
                history_rows: self.history_rows,
                pairs: self.pairs,
                geometry: geometry_after,
                parameters: parameters_after,
                history: history_after,
                touching: touching_after,
            },
        )
    }
}

/// In place of R_i + R_j where a lane only fills up a block: nothing is so near.
const FILLER: f64 = -1.0;

/// Place of a touching contact in the list, and its grains.
#[derive(Debug, Clone, Copy)]
pub struct Touching {
    pub block: usize,
    pub lane: usize,
    pub i: usize,
    pub j: usize,
}
