//! The half list of candidate pairs and the histories of contacts, in blocks of sixteen pairs.

use std::borrow::Cow;
use std::ops::Range;

use crate::contact::History;
use crate::contact::model::{Elastic, PairModel};
use crate::simd::{Isa, LANES, Lanes16, PairBlock, PairList, Pairs, clear_for};
use crate::workers::{self, Workers, tail, tail_mut};

use super::{Bands, ContactState};

/// Candidate pairs of local grains, each once, with the lower id as i.
///
/// Their blocks are in groups. First come, for each thread, the pairs between two grains of its
/// [share](Bands), band by band. Then come, for each band, the others: inner pairs, of which this
/// rank owns both grains, of two shares; pairs of an owned i and a ghost; and pairs of a ghost and
/// an owned j. A group is in the order of the cells. Within every run of 1,024 pairs, those of the
/// same two materials follow each other, in blocks of their own. Of these, contacts come first,
/// those that slide before the others, followed by the other pairs in classes of their gaps, so
/// that blocks in which nothing touches follow each other, and in most blocks nothing slides.
///
/// The last block of a group is filled up with pairs of a grain and itself, which never touch. The
/// order and the extent of the list do not change the numbers: sums of forces are exact, and pairs
/// that do not touch add nothing.
#[derive(Debug, Default)]
pub struct Contacts {
    /// The pairs within the share of each thread.
    pub shares: Vec<Share>,
    /// Of each band the pairs that are within no share.
    pub others: Vec<OtherBlocks>,
    /// The pairs. Those of a share count its grains from its first one, so that no more than its
    /// own records and forces are needed; others are local indices. See [`Contacts::grains`].
    pub pairs: PairList,
    /// R_i + R_j and R_i (m) of every block.
    pub geometry: Vec<[Lanes16; 2]>,
    /// [`PairModel::kind`] of the pairs of every block.
    pub kinds: Vec<u16>,
    /// [`Contacts::parameter_lanes`] elements per block.
    pub parameters: Vec<Lanes16>,
    /// [`Contacts::history_lanes`] elements per block.
    pub history: Vec<Lanes16>,
    /// [`Layout::parameters`](crate::contact::model::Layout::parameters) of the law.
    pub parameter_lanes: usize,
    /// Numbers of a history of the law.
    pub history_lanes: usize,
    /// Lanes that touched when the forces were last computed.
    pub touching: Vec<u16>,
    /// Lanes that were then at the limit of friction, at that of rolling, at that of twisting, and
    /// without any force of spring and damper; see [`ContactState::is_idle`].
    pub limits: Vec<[u16; 4]>,
    /// Whether the first three are of a step in which the histories advanced.
    pub limits_are_known: bool,
    /// Whether some of the pairs are of a grain and a flat wall.
    pub has_feet: bool,
    /// For each block, the distance (m) that the grains may have travelled since the list was made
    /// before one of its pairs can touch: until then the block is asleep, and costs nothing.
    pub asleep_until: Vec<f64>,
}

/// The pairs between two grains of one thread.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Share {
    /// Those of each band.
    pub bands: Vec<ShareBand>,
}

impl Share {
    /// The blocks of all bands.
    pub fn blocks(&self) -> Range<usize> {
        match (self.bands.first(), self.bands.last()) {
            (Some(first), Some(last)) => first.blocks.start..last.blocks.end,
            _ => 0..0,
        }
    }

    /// The band of a block.
    fn band_of(&self, block: usize) -> &ShareBand {
        &self.bands[self.bands.partition_point(|band| band.blocks.end <= block)]
    }
}

/// The pairs of a band within a share.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShareBand {
    /// Their blocks.
    pub blocks: Range<usize>,
    /// The owned grains of the share among which they are.
    pub grains: Range<usize>,
}

/// The blocks of the pairs of a band that are within no share, one group after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OtherBlocks {
    /// Their start.
    pub start: usize,
    /// The end of the inner pairs.
    pub inner: usize,
    /// The end of the pairs of which this rank owns i.
    pub owned: usize,
    /// Their end.
    pub end: usize,
}

impl OtherBlocks {
    /// All of them.
    pub fn blocks(&self) -> Range<usize> {
        self.start..self.end
    }
}

/// What a list needs to know of the local grains.
#[derive(Debug, Clone, Copy)]
pub struct LocalGrains<'a> {
    /// Their ids.
    pub id: &'a [u32],
    /// Their radii (m).
    pub radius: &'a [f64],
    /// Their materials.
    pub material: &'a [u64],
    /// This rank owns the first of them.
    pub owned: usize,
    /// Whether the last of them are feet.
    pub has_feet: bool,
    /// Their shares and bands.
    pub bands: &'a Bands,
    /// Until the next list no ghost is further from its place than this (m).
    pub ghosts_move: f64,
}

/// Groups of a band besides the shares: pairs between two shares, pairs of which this rank owns
/// only i, and pairs of which it owns only j.
const OTHER_GROUPS: usize = 3;

impl LocalGrains<'_> {
    /// Number of groups of pairs within shares.
    fn groups_within_shares(&self) -> usize {
        self.bands.shares() * self.bands.count()
    }

    /// Number of groups.
    fn groups(&self) -> usize {
        self.groups_within_shares() + OTHER_GROUPS * self.bands.count()
    }

    /// The grains among which the pairs of a group are; `None`: all.
    fn grains_of_group(&self, group: usize) -> Option<Range<usize>> {
        let (share, band) = (group / self.bands.count(), group % self.bands.count());
        let is_within = group < self.groups_within_shares();
        is_within.then(|| self.bands.grains_of_pairs(share, band))
    }

    /// Whether this rank owns both grains of the pairs of a group.
    fn is_inner(&self, group: usize) -> bool {
        let within = self.groups_within_shares();
        group < within || (group - within).is_multiple_of(OTHER_GROUPS)
    }

    /// The group of a pair.
    fn group(&self, pair: &CandidatePair) -> usize {
        let [i, j] = pair.grains.map(|g| g as usize);
        let band = self.bands.of(i).max(self.bands.of(j));
        let other = match (i < self.owned, j < self.owned) {
            (true, true) => {
                let [of_i, of_j] = [i, j].map(|g| self.bands.share_of(g));
                if of_i == of_j {
                    return of_i * self.bands.count() + band;
                }
                0
            }
            (true, false) => 1,
            (false, _) => 2,
        };
        self.groups_within_shares() + OTHER_GROUPS * band + other
    }
}

/// Two local grains closer than the cutoff, the one of lower id first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CandidatePair {
    /// Local indices.
    pub grains: [u32; 2],
    /// |r| - R_i - R_j (m).
    pub gap: f64,
}

impl Contacts {
    /// Replaces the list by `candidates` with the histories of `remembered`. Other pairs start
    /// without a history.
    pub fn replace(
        &mut self,
        isa: Isa,
        workers: Option<&Workers>,
        law: &dyn PairModel,
        candidates: &[CandidatePair],
        remembered: &Remembered,
        grains: LocalGrains<'_>,
    ) {
        let groups = grouped(workers, candidates, grains);
        let layout = law.layout();
        self.has_feet = grains.has_feet;
        self.parameter_lanes = layout.parameters;
        self.history_lanes = layout.history.len();
        self.limits_are_known = remembered.limits_are_known();
        let of_group = |(group, pairs)| {
            let runs = <[CandidatePair]>::chunks(pairs, SORTED_TOGETHER);
            runs.map(move |pairs| Run { group, pairs })
        };
        let runs: Vec<Run<'_>> = (groups.iter().map(|pairs| &**pairs).enumerate())
            .flat_map(of_group)
            .collect();
        // A part for every thread.
        let (threads, history_lanes) = (workers::count(workers), self.history_lanes);
        let mut parts: Vec<(Self, Vec<usize>)> = Vec::new();
        parts.resize_with(threads, Default::default);
        std::mem::swap(self, &mut parts[0].0);
        let blocks = runs.iter().map(|run| run.pairs.len().div_ceil(LANES));
        parts[0].0.clear_for(blocks.sum());
        let begin = |part: usize| runs.len() * part / threads;
        workers::each(workers, &mut parts, |k, (part, blocks)| {
            part.history_lanes = history_lanes;
            *blocks = part.push_runs(&runs[begin(k)..begin(k + 1)], law, remembered, grains);
        });
        let mut ends = vec![0; grains.groups()];
        let of_parts = parts.iter().flat_map(|(_, blocks)| blocks);
        for (run, blocks) in runs.iter().zip(of_parts) {
            ends[run.group] += blocks;
        }
        for k in 1..ends.len() {
            ends[k] += ends[k - 1];
        }
        let mut parts = parts.into_iter().map(|(part, _)| part);
        *self = parts.next().unwrap_or_default();
        parts.for_each(|part| self.append(part));
        self.set_groups(&ends, grains);
        let blocks = self.geometry.len();
        clear_for(&mut self.parameters, blocks * self.parameter_lanes);
        self.parameters
            .resize(blocks * self.parameter_lanes, Lanes16::ZERO);
        law.set_parameters(isa, &self.geometry, &self.kinds, &mut self.parameters);
    }

    /// Finds the blocks of the shares and bands; `ends`: of the groups.
    fn set_groups(&mut self, ends: &[usize], grains: LocalGrains<'_>) {
        let bands = grains.bands;
        let (within, others) = ends.split_at(grains.groups_within_shares());
        let mut start = 0;
        self.shares.clear();
        for (share, ends) in within.chunks(bands.count()).enumerate() {
            let mut of_bands = Vec::with_capacity(bands.count());
            for (band, &end) in ends.iter().enumerate() {
                of_bands.push(ShareBand {
                    blocks: start..end,
                    grains: bands.grains_of_pairs(share, band),
                });
                start = end;
            }
            self.shares.push(Share { bands: of_bands });
        }
        self.others.clear();
        for ends in others.as_chunks::<OTHER_GROUPS>().0 {
            let &[inner, owned, end] = ends;
            self.others.push(OtherBlocks {
                start,
                inner,
                owned,
                end,
            });
            start = end;
        }
    }

    /// Removes all blocks, and makes room for so many.
    fn clear_for(&mut self, blocks: usize) {
        self.pairs.clear_for(blocks);
        clear_for(&mut self.geometry, blocks);
        clear_for(&mut self.kinds, blocks);
        clear_for(&mut self.history, blocks * self.history_lanes);
        clear_for(&mut self.touching, blocks);
        clear_for(&mut self.limits, blocks);
        clear_for(&mut self.asleep_until, blocks);
    }

    /// Appends the blocks of another list.
    fn append(&mut self, mut other: Self) {
        self.pairs.append(&mut other.pairs);
        self.geometry.append(&mut other.geometry);
        self.kinds.append(&mut other.kinds);
        self.history.append(&mut other.history);
        self.touching.append(&mut other.touching);
        self.limits.append(&mut other.limits);
        self.asleep_until.append(&mut other.asleep_until);
    }

    /// Appends the blocks of some runs. Returns how many each has.
    fn push_runs(
        &mut self,
        runs: &[Run<'_>],
        law: &dyn PairModel,
        remembered: &Remembered,
        grains: LocalGrains<'_>,
    ) -> Vec<usize> {
        let LocalGrains {
            id,
            radius,
            material,
            ghosts_move,
            ..
        } = grains;
        // Those of the first material alone are of kind 0.
        let several = material.iter().any(|k| *k != 0);
        let kind = |pair: &Listed| {
            let of_both = || law.kind(pair.grains.map(|g| material[g as usize]));
            if several { of_both() } else { 0 }
        };
        let mut ordered = Ordered::default();
        let mut push_run = |run: &Run<'_>| {
            let before = self.geometry.len();
            let of_group = grains.grains_of_group(run.group);
            let first_grain = of_group.map_or(0, |grains| grains.start as u32);
            let inner = grains.is_inner(run.group);
            let pairs = ordered.contacts_first(run.pairs, remembered, id);
            if several {
                pairs.sort_by_key(kind);
            }
            let of_kinds = pairs.chunk_by(|a, b| kind(a) == kind(b));
            for block in of_kinds.flat_map(|of_kind| of_kind.chunks(LANES)) {
                self.kinds.push(kind(&block[0]));
                self.push(remembered, block, first_grain, radius);
                let least = way_to_touch(block.iter().map(|p| p.gap).fold(f64::MAX, f64::min));
                let of_ghosts = 2.0 * least - ghosts_move;
                self.asleep_until
                    .push(if inner { least } else { of_ghosts });
            }
            self.geometry.len() - before
        };
        runs.iter().map(&mut push_run).collect()
    }

    /// Appends a block of pairs. Grains are numbered from `first_grain` on.
    fn push(
        &mut self,
        remembered: &Remembered,
        block: &[Listed],
        first_grain: u32,
        radius: &[f64],
    ) {
        let mut pairs = Pairs::default();
        let mut geometry = [Lanes16([FILLER; LANES]), Lanes16([-0.5 * FILLER; LANES])];
        let (mut touching, mut limits) = (0, [0; 4]);
        let first = self.history.len();
        self.history
            .resize(first + self.history_lanes, Lanes16::ZERO);
        for (lane, listed) in block.iter().enumerate() {
            let [i, j] = listed.grains;
            pairs.i[lane] = i - first_grain;
            pairs.j[lane] = j - first_grain;
            geometry[0].0[lane] = radius[i as usize] + radius[j as usize];
            geometry[1].0[lane] = radius[i as usize];
            if let Some(contact) = listed.contact {
                touching |= 1 << lane;
                set_limits(&mut limits, lane, remembered.limits(contact));
                remembered.put(contact, &mut self.history[first..], lane);
            }
        }
        self.pairs.push(pairs);
        self.geometry.push(geometry);
        self.touching.push(touching);
        self.limits.push(limits);
    }

    /// The end of the blocks of the shares.
    fn end_of_shares(&self) -> usize {
        let first = self.others.first();
        first.map_or(self.blocks(), |others| others.start)
    }

    /// Borrows the blocks of each share.
    pub(crate) fn within_shares(&mut self) -> Vec<(&Share, BlockRange<'_>)> {
        let (shares, _, mut blocks) = self.split();
        if let Some(last) = shares.last() {
            blocks.split_off(last.blocks().end);
        }
        let mut parts = Vec::with_capacity(shares.len());
        for share in shares.iter().rev() {
            parts.push((share, blocks.split_off(share.blocks().start)));
        }
        parts.reverse();
        parts
    }

    /// Borrows the blocks of these bands, the last one first, that are within no share.
    pub(crate) fn others_of(&mut self, bands: impl Iterator<Item = usize>) -> Vec<BlockRange<'_>> {
        let (_, others, mut blocks) = self.split();
        let mut parts = Vec::new();
        for band in bands {
            let others = &others[band];
            blocks.split_off(others.end);
            parts.push(BlockRange {
                inner: others.inner,
                owned_blocks: others.owned,
                ..blocks.split_off(others.start)
            });
        }
        parts
    }

    /// Borrows all blocks, for the kernel, where there is a single share.
    pub fn of_one_share(&mut self) -> BlockRange<'_> {
        self.split().2
    }

    /// Borrows the places of the groups, and all blocks.
    fn split(&mut self) -> (&[Share], &[OtherBlocks], BlockRange<'_>) {
        let end_of_shares = self.end_of_shares();
        let blocks = BlockRange {
            first: 0,
            owned_blocks: end_of_shares,
            parameter_lanes: self.parameter_lanes,
            history_lanes: self.history_lanes,
            pairs: &self.pairs,
            geometry: &self.geometry,
            kinds: &self.kinds,
            parameters: &self.parameters,
            history: &mut self.history,
            touching: &mut self.touching,
            limits: &mut self.limits,
            asleep_until: &mut self.asleep_until,
            inner: end_of_shares,
            has_feet: self.has_feet,
        };
        (&self.shares, &self.others, blocks)
    }

    /// The blocks of pairs of which this rank owns i.
    pub fn owned_blocks(&self) -> impl Iterator<Item = usize> + '_ {
        let others = self.others.iter();
        let of_bands = others.flat_map(|others| others.start..others.owned);
        (0..self.end_of_shares()).chain(of_bands)
    }

    /// The local indices of the grains of a block.
    pub fn grains(&self, block: usize) -> Pairs {
        let mut first = 0;
        if block < self.end_of_shares() {
            let shares = &self.shares;
            let share = &shares[shares.partition_point(|share| share.blocks().end <= block)];
            first = share.band_of(block).grains.start as u32;
        }
        let mut pairs = self.pairs.blocks()[block];
        for g in pairs.i.iter_mut().chain(&mut pairs.j) {
            *g += first;
        }
        pairs
    }

    /// Wakes all blocks.
    pub fn wake(&mut self) {
        self.asleep_until.fill(0.0);
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.geometry.len()
    }

    /// The touching contacts with local indices, block by block.
    pub fn touching(&self) -> impl Iterator<Item = Touching> + '_ {
        self.touching_in(0..self.blocks())
    }

    /// The touching contacts of some blocks with local indices, block by block.
    pub fn touching_in(&self, blocks: Range<usize>) -> impl Iterator<Item = Touching> + '_ {
        let mut blocks = blocks.into_iter();
        let (mut block, mut rest, mut grains) = (0, 0u16, Pairs::default());
        std::iter::from_fn(move || {
            while rest == 0 {
                block = blocks.next()?;
                rest = self.touching[block];
                if rest != 0 {
                    grains = self.grains(block);
                }
            }
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            Some(Touching {
                block,
                lane,
                i: grains.i[lane] as usize,
                j: grains.j[lane] as usize,
            })
        })
    }

    /// The history of a touching contact, with the ids of its grains.
    pub fn state(&self, law: &dyn PairModel, at: Touching, id: &[u32]) -> ContactState {
        let mut history = History::default();
        let lanes = &self.history[at.block * self.history_lanes..][..self.history_lanes];
        for (place, lanes) in law.layout().history.iter().zip(lanes) {
            history[*place] = lanes.0[at.lane];
        }
        let [slides, rolls, twists, idle] = limits_of(self.limits[at.block], at.lane);
        let limits = [slides, rolls, twists].map(|is_at| self.limits_are_known.then_some(is_at));
        ContactState {
            limits: ContactState::stored(limits, idle),
            ..ContactState::new(id[at.i], id[at.j], [0.0; 3])
        }
        .with_histories(history)
    }

    /// The touching contacts, for the next list of the same grains. Their histories are gone from
    /// here then.
    pub fn remember(&mut self, id: &[u32]) -> Remembered {
        let mut bounds = vec![[0; 2]; id.len()];
        for at in self.touching() {
            bounds[at.i][1] += 1;
        }
        let mut end = 0;
        for [first, count] in &mut bounds {
            (*first, end) = (end, end + *count);
            *count = *first;
        }
        let mut partner = vec![0; end as usize];
        let mut places = vec![0; end as usize];
        for at in self.touching() {
            let next = &mut bounds[at.i][1];
            partner[*next as usize] = id[at.j];
            places[*next as usize] = at.block * LANES + at.lane;
            *next += 1;
        }
        let mut limits = std::mem::take(&mut self.limits);
        if !self.limits_are_known {
            limits.iter_mut().for_each(|bounds| bounds[..3].fill(0));
        }
        Remembered {
            bounds,
            partner,
            places,
            history: std::mem::take(&mut self.history),
            history_lanes: self.history_lanes,
            limits,
            limits_are_known: self.limits_are_known,
        }
    }

    /// What the elastic energies of the contacts depend on; `overlap`: δ (m).
    pub fn elastic<'a>(&'a self, overlap: &'a [Lanes16]) -> Elastic<'a> {
        Elastic {
            geometry: &self.geometry,
            kinds: &self.kinds,
            parameters: &self.parameters,
            history: &self.history,
            overlap,
        }
    }

    /// The springs of all contacts, to put them back after a computation of forces that is no step.
    pub fn springs(&self) -> Springs {
        Springs {
            history: self.history.clone(),
            limits: self.limits.clone(),
            limits_are_known: self.limits_are_known,
        }
    }

    /// Puts the springs back into the same list, but for k_t of the last step that disks keep,
    /// which that computation has found.
    pub fn put_springs(&mut self, springs: Springs, law: &dyn PairModel, is_planar: bool) {
        let places = law.layout().history;
        for (k, kept) in springs.history.into_iter().enumerate() {
            let is_stiffness = is_planar && places[k % self.history_lanes] == LAST_STIFFNESS;
            if !is_stiffness {
                self.history[k] = kept;
            }
        }
        (self.limits, self.limits_are_known) = (springs.limits, springs.limits_are_known);
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        self.pairs.memory()
            + self.geometry.capacity() * size_of::<[Lanes16; 2]>()
            + (self.parameters.capacity() + self.history.capacity()) * size_of::<Lanes16>()
            + (self.touching.capacity() + self.kinds.capacity()) * size_of::<u16>()
            + self.limits.capacity() * size_of::<[u16; 4]>()
            + self.asleep_until.capacity() * size_of::<f64>()
    }
}

/// The place of the last k_t in a history of disks.
const LAST_STIFFNESS: usize = 1;

/// What the contacts of a list remember.
#[derive(Debug, Clone)]
pub struct Springs {
    history: Vec<Lanes16>,
    limits: Vec<[u16; 4]>,
    limits_are_known: bool,
}

/// Whether a lane is at the limits of [`Contacts::limits`].
fn limits_of(limits: [u16; 4], lane: usize) -> [bool; 4] {
    limits.map(|lanes| lanes >> lane & 1 == 1)
}

fn set_limits(limits: &mut [u16; 4], lane: usize, is_at: [bool; 4]) {
    for (lanes, is_at) in limits.iter_mut().zip(is_at) {
        *lanes |= u16::from(is_at) << lane;
    }
}

/// Contacts before a new list.
#[derive(Debug, Default)]
pub struct Remembered {
    /// For each local grain as i, the first of its contacts, and the end of them.
    bounds: Vec<[u32; 2]>,
    /// The id of the other grain.
    partner: Vec<u32>,
    /// The place of each contact in the following: sixteen to a block.
    places: Vec<usize>,
    /// As in [`Contacts`]; unknown limits are not set.
    history: Vec<Lanes16>,
    history_lanes: usize,
    limits: Vec<[u16; 4]>,
    limits_are_known: bool,
}

impl Remembered {
    /// Contacts that are sorted by i, of local grains with these ids.
    pub fn sorted(states: &[ContactState], law: &dyn PairModel, id: &[u32]) -> Self {
        let contacts_of = |id: &u32| {
            let first = states.partition_point(|c| c.i < *id);
            let count = states[first..].iter().take_while(|c| c.i == *id).count();
            [first, first + count].map(|k| k as u32)
        };
        let layout = law.layout();
        let (blocks, history_lanes) = (states.len().div_ceil(LANES), layout.history.len());
        let mut history = vec![Lanes16::ZERO; blocks * history_lanes];
        let mut limits = vec![[0; 4]; blocks];
        let mut limits_are_known = true;
        for (place, state) in states.iter().enumerate() {
            let (block, lane) = (place / LANES, place % LANES);
            let of_block = history[block * history_lanes..].iter_mut();
            let numbers = state.all_histories();
            for (lanes, place) in of_block.zip(layout.history) {
                lanes.0[lane] = numbers[*place];
            }
            let known = state.limits();
            limits_are_known &= known.iter().all(Option::is_some);
            let [slides, rolls, twists] = known.map(Option::unwrap_or_default);
            let is_at = [slides, rolls, twists, state.is_idle()];
            set_limits(&mut limits[block], lane, is_at);
        }
        Self {
            bounds: id.iter().map(contacts_of).collect(),
            partner: states.iter().map(|c| c.j).collect(),
            places: (0..states.len()).collect(),
            history,
            history_lanes,
            limits,
            limits_are_known,
        }
    }

    /// The contact of the local grain i and the grain of this id.
    fn find(&self, i: u32, id: u32) -> Option<u32> {
        let [first, end] = *self.bounds.get(i as usize)?;
        (first..end).find(|&k| self.partner[k as usize] == id)
    }

    /// See [`Contacts::limits_are_known`].
    fn limits_are_known(&self) -> bool {
        self.limits_are_known || self.places.is_empty()
    }

    /// Whether a contact is at the limits of [`Contacts::limits`], as far as that is known.
    fn limits(&self, contact: u32) -> [bool; 4] {
        let place = self.places[contact as usize];
        limits_of(self.limits[place / LANES], place % LANES)
    }

    /// Puts the history of a contact into a lane.
    fn put(&self, contact: u32, to: &mut [Lanes16], lane: usize) {
        let place = self.places[contact as usize];
        let from = &self.history[place / LANES * self.history_lanes..][..self.history_lanes];
        for (to, from) in to.iter_mut().zip(from) {
            to.0[lane] = from.0[place % LANES];
        }
    }
}

/// A pair of the list, and the contact that is remembered of it.
#[derive(Debug, Clone, Copy, Default)]
struct Listed {
    grains: [u32; 2],
    /// |r| - R_i - R_j (m).
    gap: f64,
    contact: Option<u32>,
}

/// Pairs of a group among which contacts come first.
#[derive(Clone, Copy)]
struct Run<'a> {
    group: usize,
    pairs: &'a [CandidatePair],
}

/// Number of pairs of a run: enough that few blocks hold both kinds, and few
/// enough that their data stay in the cache.
const SORTED_TOGETHER: usize = 64 * LANES;

/// The pairs of each group; each thread groups a part of the list, in which most pairs are of one
/// share.
fn grouped<'a>(
    workers: Option<&Workers>,
    candidates: &'a [CandidatePair],
    grains: LocalGrains<'_>,
) -> Vec<Cow<'a, [CandidatePair]>> {
    if grains.groups_within_shares() == 1 && grains.id.len() == grains.owned {
        let mut groups = vec![Cow::default(); grains.groups()];
        groups[0] = candidates.into();
        return groups;
    }
    let threads = workers::count(workers);
    let begin = |part: usize| candidates.len() * part / threads;
    let mut parts: Vec<Vec<Vec<CandidatePair>>> = vec![Vec::new(); threads];
    workers::each(workers, &mut parts, |k, groups| {
        groups.resize(grains.groups(), Vec::new());
        for pair in &candidates[begin(k)..begin(k + 1)] {
            groups[grains.group(pair)].push(*pair);
        }
    });
    let joined = parts.into_iter().reduce(|mut groups, of_part| {
        for (group, mut more) in groups.iter_mut().zip(of_part) {
            if more.len() > group.len() {
                std::mem::swap(group, &mut more);
            }
            group.append(&mut more);
        }
        groups
    });
    let joined = joined.unwrap_or_default().into_iter();
    joined.map(Cow::Owned).collect()
}

/// Classes of the pairs of a run: contacts that slide, other contacts, and others by their gaps.
/// Those of a class fill less than a block.
const CLASSES: usize = 128;

/// The pairs of a run in the order of the list.
#[derive(Debug, Default)]
struct Ordered {
    pairs: Vec<Listed>,
    found: Vec<(Listed, usize)>,
}

impl Ordered {
    /// Sorts a run by classes.
    fn contacts_first(
        &mut self,
        run: &[CandidatePair],
        remembered: &Remembered,
        id: &[u32],
    ) -> &mut [Listed] {
        let gaps = run.iter().map(|pair| pair.gap);
        let widest = gaps.fold(f64::MIN_POSITIVE, f64::max);
        let per_gap = (CLASSES - 2) as f64 / widest;
        self.found.clear();
        self.found.extend(run.iter().map(|pair| {
            let [i, j] = pair.grains;
            let contact = remembered.find(i, id[j as usize]);
            let class = match contact {
                Some(contact) => usize::from(!remembered.limits(contact)[0]),
                None => (2 + (pair.gap * per_gap) as usize).min(CLASSES - 1),
            };
            let listed = Listed {
                grains: pair.grains,
                gap: contact.map_or(pair.gap, |_| f64::MIN),
                contact,
            };
            (listed, class)
        }));
        let mut next = [0; CLASSES];
        for (_, class) in &self.found {
            next[*class] += 1;
        }
        let mut end = 0;
        for first in &mut next {
            (*first, end) = (end, end + *first);
        }
        self.pairs.resize(run.len(), Listed::default());
        for (listed, class) in &self.found {
            self.pairs[next[*class]] = *listed;
            next[*class] += 1;
        }
        &mut self.pairs
    }
}

/// How far (m) two grains with this gap (m) must travel to touch. Slightly less than half of it,
/// because gaps and ways are rounded.
#[inline(always)]
pub(crate) fn way_to_touch(gap: f64) -> f64 {
    0.499 * gap
}

/// Some blocks of the list, as the kernel uses them.
pub struct BlockRange<'a> {
    /// The first of them in the list.
    pub first: usize,
    /// [`OtherBlocks::owned`]; the end of the blocks of a share.
    pub owned_blocks: usize,
    /// [`Contacts::parameter_lanes`].
    pub parameter_lanes: usize,
    /// [`Contacts::history_lanes`].
    pub history_lanes: usize,
    /// [`Contacts::pairs`], of the whole list.
    pub pairs: &'a PairList,
    /// [`Contacts::geometry`] of these blocks.
    pub geometry: &'a [[Lanes16; 2]],
    /// [`Contacts::kinds`] of these blocks.
    pub kinds: &'a [u16],
    /// [`Contacts::parameters`] of these blocks.
    pub parameters: &'a [Lanes16],
    /// [`Contacts::history`] of these blocks.
    pub history: &'a mut [Lanes16],
    /// [`Contacts::touching`] of these blocks.
    pub touching: &'a mut [u16],
    /// [`Contacts::limits`] of these blocks.
    pub limits: &'a mut [[u16; 4]],
    /// [`Contacts::asleep_until`] of these blocks.
    pub asleep_until: &'a mut [f64],
    /// [`OtherBlocks::inner`]; the end of the blocks of a share.
    pub inner: usize,
    /// [`Contacts::has_feet`].
    pub has_feet: bool,
}

impl<'a> BlockRange<'a> {
    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.geometry.len()
    }

    /// The pairs of a block of the part.
    #[inline(always)]
    pub fn pairs(&self, block: usize) -> PairBlock<'a> {
        self.pairs.block(self.first + block)
    }

    /// The next blocks that are awake, at most `most` of them, from block `from` of the part on,
    /// when the grains have travelled this far (m); `None`: every block is awake.
    pub(crate) fn awake(&self, from: usize, most: usize, travelled: Option<f64>) -> Range<usize> {
        let blocks = self.blocks();
        let Some(travelled) = travelled else {
            return from..blocks.min(from + most);
        };
        // NaN counts as far.
        let asleep = |until: &f64| travelled < *until;
        let rest = &self.asleep_until[from..];
        let first = from + rest.iter().take_while(|until| asleep(until)).count();
        let rest = self.asleep_until[first..].iter().take(most);
        first..first + rest.take_while(|until| !asleep(until)).count()
    }

    /// Some of the blocks, numbered as in the list, for a while.
    pub(crate) fn within(&mut self, blocks: Range<usize>) -> BlockRange<'_> {
        let here = blocks.start - self.first..blocks.end - self.first;
        let lanes = |per_block: usize| here.start * per_block..here.end * per_block;
        BlockRange {
            first: blocks.start,
            geometry: &self.geometry[here.clone()],
            kinds: &self.kinds[here.clone()],
            parameters: &self.parameters[lanes(self.parameter_lanes)],
            history: &mut self.history[lanes(self.history_lanes)],
            touching: &mut self.touching[here.clone()],
            limits: &mut self.limits[here.clone()],
            asleep_until: &mut self.asleep_until[here],
            ..*self
        }
    }

    /// Splits off the blocks from block `from` of the list on.
    pub(crate) fn split_off(&mut self, from: usize) -> BlockRange<'a> {
        let at = from - self.first;
        BlockRange {
            first: from,
            geometry: tail(&mut self.geometry, at),
            kinds: tail(&mut self.kinds, at),
            parameters: tail(&mut self.parameters, at * self.parameter_lanes),
            history: tail_mut(&mut self.history, at * self.history_lanes),
            touching: tail_mut(&mut self.touching, at),
            limits: tail_mut(&mut self.limits, at),
            asleep_until: tail_mut(&mut self.asleep_until, at),
            ..*self
        }
    }
}

/// R_i + R_j of lanes that fill up a block: negative, so that they never touch.
pub(crate) const FILLER: f64 = -1.0;

/// The place of a touching contact in the list, and its grains.
#[derive(Debug, Clone, Copy)]
pub struct Touching {
    /// Block of the list.
    pub block: usize,
    /// Lane of the block.
    pub lane: usize,
    /// Local index of the first grain.
    pub i: usize,
    /// Local index of the second grain.
    pub j: usize,
}
