//! Slabs along x: owners of grains, ghosts, migration and halo exchange.

use std::marker::PhantomData;
use std::ops::Range;
use std::slice;

use bytemuck::{allocation::pod_collect_to_vec, cast_slice, cast_slice_mut};

use super::{Exchange, HaloMessage};
use crate::dimension::Dimension;
use crate::failure::{Failure, Result};
use crate::neighbour::LocalExtent;
use crate::state::{Bands, CandidatePair, Cell, ContactState, GrainState, Grains};
use crate::workers::{self, Workers};

/// Bins per rank of the histogram that balances the cuts, and the number of ranks beyond which no
/// bins are added.
const BINS_PER_RANK: usize = 256;
const MOST_RANKS_WITH_BINS: usize = 256;

/// Cost of a contact in a step over that of a grain: about 20 ns to 3 ns.
const CONTACT_COST: i64 = 6;

/// The slabs of all ranks, and this rank's part of the halo exchange.
#[derive(Debug)]
pub struct Slabs<D: Dimension> {
    /// L_x (m).
    length: f64,
    /// Slab r is [`cuts[r]`, `cuts[r + 1]`) (m).
    pub cuts: Vec<f64>,
    /// The part of the work that each rank is to have; see [`Slabs::balance`].
    shares: Vec<f64>,
    links: Vec<Neighbour>,
    dimension: PhantomData<D>,
}

/// The halo exchange with one neighbouring rank.
#[derive(Debug)]
struct Neighbour {
    rank: usize,
    /// Owned grains that are its ghosts, band by band.
    send: Vec<u32>,
    /// Those of the present message.
    chosen: Vec<u32>,
    /// Local indices of the ghosts that it owns.
    ghosts: Range<usize>,
    /// Of each band the grains in `send`, and the ghosts, counted from the first of these.
    bands: Vec<[Range<usize>; 2]>,
}

/// The greatest number of slabs wider than `cutoff` (m) in a cell of this `length` (m).
pub(crate) fn most_ranks(length: f64, cutoff: f64) -> usize {
    let slabs = (length / cutoff) as usize;
    if slabs as f64 * cutoff < length {
        slabs
    } else {
        slabs - 1
    }
}

impl<D: Dimension> Slabs<D> {
    /// Slabs of equal width of a cell of this `length` (m) along x.
    pub fn new(exchange: &dyn Exchange, length: f64) -> Self {
        let size = exchange.size();
        Self {
            length,
            cuts: (0..=size)
                .map(|r| length * r as f64 / size as f64)
                .collect(),
            shares: vec![1.0 / size as f64; size],
            links: Vec::new(),
            dimension: PhantomData,
        }
    }

    /// Stretches the slabs with the cell to this `length` (m).
    pub fn stretch(&mut self, length: f64) {
        if length != self.length {
            let factor = length / self.length;
            self.cuts.iter_mut().for_each(|cut| *cut *= factor);
            self.cuts[self.shares.len()] = length;
            self.length = length;
        }
    }

    /// The rank whose slab holds x ∈ [0, L_x).
    fn owner(&self, x: f64) -> usize {
        let slabs = self.cuts.len() - 1;
        self.cuts[1..slabs].partition_point(|&cut| cut <= x)
    }

    /// Moves the cuts to balance the work, then every grain with its contacts to the rank that owns
    /// it. `cutoff` in m; `worked`: how long (s) this rank has computed since the last call, 0 if
    /// that is unknown. Returns the owned grains by id, and all their contacts, including those
    /// with ghosts, by (i, j).
    ///
    /// # Errors
    /// Too many ranks: a slab must be wider than the cutoff.
    pub fn redistribute(
        &mut self,
        exchange: &dyn Exchange,
        cell: Cell,
        grains: Vec<GrainState>,
        mut contacts: Vec<ContactState>,
        cutoff: f64,
        worked: f64,
    ) -> Result<(Vec<GrainState>, Vec<ContactState>)> {
        let (size, me) = (exchange.size(), exchange.rank());
        let mut owned = grains;
        if size > 1 {
            owned.sort_unstable_by_key(|g| g.id);
            let along_x = cell.cutoff_along_x(cutoff);
            self.balance(exchange, cell, &owned, &contacts, along_x, worked)?;
            let mut leaving: Vec<(u32, usize)> = Vec::new();
            let mut grains_to = vec![Vec::new(); size];
            let mut contacts_to = vec![Vec::new(); size];
            owned.retain(|g| {
                let owner = self.owner(cell.slab_coordinate::<D>(&g.position));
                if owner != me {
                    leaving.push((g.id, owner));
                    grains_to[owner].push(*g);
                }
                owner == me
            });
            leaving.sort_unstable();
            let destination = |id| {
                let found = leaving.binary_search_by_key(&id, |l| l.0);
                found.ok().map(|k| leaving[k].1)
            };
            for contact in &contacts {
                let (a, b) = (destination(contact.i), destination(contact.j));
                if let Some(to) = a {
                    contacts_to[to].push(*contact);
                }
                if let Some(to) = b
                    && b != a
                {
                    contacts_to[to].push(*contact);
                }
            }
            for bytes in exchange.all_to_all(as_bytes(&grains_to)) {
                owned.extend(pod_collect_to_vec::<u8, GrainState>(&bytes));
            }
            for bytes in exchange.all_to_all(as_bytes(&contacts_to)) {
                contacts.extend(pod_collect_to_vec::<u8, ContactState>(&bytes));
            }
        }
        // Stable: most are in order already.
        owned.sort_by_key(|g| g.id);
        contacts.sort_by_key(|c| (c.i, c.j));
        contacts.dedup_by_key(|c| (c.i, c.j));
        Ok((owned, contacts))
    }

    /// Balances the cuts; `grains` are sorted by id. The costs of grains and contacts say where the
    /// work is, and the times that the ranks took for theirs, how much of it each is to have: a
    /// rank may have a slower core, or contacts that cost more.
    fn balance(
        &mut self,
        exchange: &dyn Exchange,
        cell: Cell,
        grains: &[GrainState],
        contacts: &[ContactState],
        cutoff: f64,
        worked: f64,
    ) -> Result<()> {
        let size = exchange.size();
        let most = most_ranks(self.length, cutoff);
        if size > most {
            return Err(Failure::input(format!(
                "{size} ranks are too many: a slab must be wider than the cutoff of {cutoff:.4e} m, and the cell is \
                 {:.4e} m long; run it on 1 to {} ranks",
                self.length,
                most.max(1),
            )));
        }
        // The work of a contact counts where its first grain is, which one rank owns.
        let mut cost = vec![1i64; grains.len()];
        for contact in contacts {
            if let Ok(first) = grains.binary_search_by_key(&contact.i, |g| g.id) {
                cost[first] += CONTACT_COST;
            }
        }
        let bins = BINS_PER_RANK * size.min(MOST_RANKS_WITH_BINS);
        let mut sums = vec![0i64; bins + 2 * size];
        let (histogram, of_ranks) = sums.split_at_mut(bins);
        of_ranks[exchange.rank()] = cost.iter().sum();
        of_ranks[size + exchange.rank()] = (1e9 * worked) as i64;
        for (g, cost) in grains.iter().zip(cost) {
            let bin = (cell.slab_coordinate::<D>(&g.position) / self.length * bins as f64) as usize;
            histogram[bin.min(bins - 1)] += cost;
        }
        exchange.sum(&mut sums);
        let (histogram, of_ranks) = sums.split_at(bins);
        share_anew(&mut self.shares, of_ranks);
        let total: i64 = histogram.iter().sum();
        let (mut below, mut bin) = (0, 0);
        let mut share = 0.0;
        for r in 1..size {
            share += self.shares[r - 1];
            let target = ((total as f64 * share) as i64).min(total);
            while below + histogram[bin] < target {
                below += histogram[bin];
                bin += 1;
            }
            let part = (target - below) as f64 / histogram[bin].max(1) as f64;
            self.cuts[r] = self.length * (bin as f64 + part) / bins as f64;
        }
        // Slightly more than the cutoff, so that rounding cannot make a slab too narrow.
        let narrowest = cutoff + (self.length / size as f64 - cutoff) * 1e-3;
        for r in 1..size {
            self.cuts[r] = self.cuts[r].max(self.cuts[r - 1] + narrowest);
        }
        for r in (1..size).rev() {
            self.cuts[r] = self.cuts[r].min(self.cuts[r + 1] - narrowest);
        }
        Ok(())
    }

    /// Finds the owned grains within `cutoff` (m) of a neighbour's slab, and adds those of the
    /// neighbours as ghosts. `bands`: of the owned grains.
    pub(crate) fn attach_ghosts(
        &mut self,
        exchange: &dyn Exchange,
        cell: Cell,
        grains: &mut Grains<D>,
        bands: &Bands,
        cutoff: f64,
    ) {
        let cutoff = cell.cutoff_along_x(cutoff);
        let (size, me) = (exchange.size(), exchange.rank());
        self.links.clear();
        if size == 1 {
            return;
        }
        let (left, right) = ((me + size - 1) % size, (me + 1) % size);
        let (from, to) = (self.cuts[me], self.cuts[me + 1]);
        let is_border = |g: &u32, side: usize| {
            let x = cell.slab_coordinate::<D>(grains.fields(*g as usize));
            (side == left && x - from < cutoff) || (side == right && to - x < cutoff)
        };
        let mut states = vec![Vec::new(); size];
        let mut ranks = vec![left, right];
        ranks.dedup();
        for rank in ranks {
            let mut send: Vec<u32> = (0..grains.owned as u32)
                .filter(|g| is_border(g, rank))
                .collect();
            send.sort_by_key(|&g| bands.of(g as usize));
            states[rank] = send.iter().map(|&g| grains.state(g as usize)).collect();
            self.links.push(Neighbour {
                rank,
                chosen: Vec::with_capacity(send.len()),
                send,
                ghosts: 0..0,
                bands: Vec::new(),
            });
        }
        let received = exchange.all_to_all(as_bytes(&states));
        for link in &mut self.links {
            let begin = grains.local();
            for ghost in pod_collect_to_vec::<u8, GrainState>(&received[link.rank]) {
                grains.push(&ghost);
            }
            link.ghosts = begin..grains.local();
        }
    }

    /// Drops the ghosts that are in none of these pairs, on the ranks that own them, too, so that
    /// the halo exchange sends no more than the forces need. Renumbers the grains of the pairs.
    pub(crate) fn drop_unpaired_ghosts(
        &mut self,
        exchange: &dyn Exchange,
        grains: &mut Grains<D>,
        pairs: &mut [CandidatePair],
    ) {
        if self.links.is_empty() {
            return;
        }
        let mut needed = vec![false; grains.local()];
        needed[..grains.owned].fill(true);
        for g in pairs.iter().flat_map(|pair| pair.grains) {
            needed[g as usize] = true;
        }
        // A message and not a rule: two ranks might round differently.
        let mut answers = vec![Vec::new(); exchange.size()];
        for link in &self.links {
            let of_ghosts = needed[link.ghosts.clone()].iter();
            answers[link.rank] = of_ghosts.map(|&kept| u8::from(kept)).collect();
        }
        let received = exchange.all_to_all(answers);
        let number = grains.retain(&needed);
        for g in pairs.iter_mut().flat_map(|pair| &mut pair.grains) {
            *g = number[*g as usize];
        }
        let mut begin = grains.owned;
        for link in &mut self.links {
            let mut kept = received[link.rank].iter();
            link.send.retain(|_| kept.next() == Some(&1));
            let ghosts = needed[link.ghosts.clone()].iter().filter(|kept| **kept);
            let end = begin + ghosts.count();
            link.ghosts = begin..end;
            begin = end;
        }
    }

    /// Finds which grains and ghosts are of each band. Must be called for every new list.
    pub(crate) fn divide(&mut self, bands: &Bands) {
        for link in &mut self.links {
            let ghosts: Vec<u32> = link.ghosts.clone().map(|g| g as u32).collect();
            let of_band = |grains: &[u32], band: usize| {
                let until = |band: usize| grains.partition_point(|&g| bands.of(g as usize) < band);
                until(band)..until(band + 1)
            };
            let both = |band| [of_band(&link.send, band), of_band(&ghosts, band)];
            link.bands = (0..bands.count()).map(both).collect();
        }
    }

    /// Begins to send the records of the border grains of some bands, and to receive those of their
    /// ghosts. [`Slabs::end_exchange`] of the same bands must follow.
    pub(crate) fn begin_exchange(
        &mut self,
        exchange: &dyn Exchange,
        bands: impl Iterator<Item = usize> + Clone,
        record: &[D::Record],
        workers: Option<&Workers>,
    ) {
        let width = width::<D>();
        for link in &mut self.links {
            link.chosen.clear();
            let mut ghosts = 0;
            for band in bands.clone() {
                let [sent, received] = &link.bands[band];
                link.chosen.extend_from_slice(&link.send[sent.clone()]);
                ghosts += received.len();
            }
            exchange.begin_halo(HaloMessage {
                rank: link.rank,
                length: link.chosen.len() * width,
                write: &|numbers| pack::<D>(record, &link.chosen, numbers, workers),
                expected: ghosts * width,
            });
        }
    }

    /// Waits for the records of the ghosts of some bands.
    pub(crate) fn end_exchange(
        &mut self,
        exchange: &dyn Exchange,
        bands: impl Iterator<Item = usize> + Clone,
        record: &mut [D::Record],
        workers: Option<&Workers>,
    ) {
        for link in &self.links {
            let ghosts = &mut record[link.ghosts.clone()];
            exchange.end_halo(link.rank, &mut |numbers| {
                let mut rest = numbers;
                for band in bands.clone() {
                    let [_, received] = &link.bands[band];
                    let ghosts = &mut ghosts[received.clone()];
                    let (of_band, after) = rest.split_at(ghosts.len() * width::<D>());
                    unpack::<D>(of_band, ghosts, workers);
                    rest = after;
                }
            });
        }
    }

    /// The part of the cell that holds this rank's grains and ghosts.
    pub(crate) fn local_extent(&self, exchange: &dyn Exchange, cutoff: f64) -> LocalExtent {
        let me = exchange.rank();
        let (from, to) = (self.cuts[me], self.cuts[me + 1]);
        let wide = to - from + 2.0 * cutoff;
        if exchange.size() == 1 || wide >= self.length {
            LocalExtent::whole(self.length)
        } else {
            LocalExtent {
                from: from - cutoff,
                width: wide,
            }
        }
    }

    /// Number of ghosts.
    pub fn ghosts(&self) -> usize {
        self.links.iter().map(|link| link.ghosts.len()).sum()
    }

    /// Bytes that this rank sends per step.
    pub fn bytes_per_step(&self) -> usize {
        let records: usize = self.links.iter().map(|l| l.send.len()).sum();
        records * size_of::<D::Record>()
    }
}

/// Moves the shares of the ranks towards what they can do in the same time, from their costs and
/// then their times (ns) since the last call. Slowly, because times are noisy, and within bounds.
fn share_anew(shares: &mut [f64], costs_and_times: &[i64]) {
    let size = shares.len();
    let (costs, times) = costs_and_times.split_at(size);
    if costs.iter().chain(times).any(|x| *x <= 0) {
        return;
    }
    let both = costs.iter().zip(times);
    let speeds: Vec<f64> = both.map(|(c, t)| *c as f64 / *t as f64).collect();
    let all: f64 = speeds.iter().sum();
    let even = 1.0 / size as f64;
    for (share, speed) in shares.iter_mut().zip(&speeds) {
        *share += 0.3 * (speed / all - *share);
        *share = share.clamp(0.5 * even, 2.0 * even);
    }
    let sum: f64 = shares.iter().sum();
    shares.iter_mut().for_each(|share| *share /= sum);
}

fn as_bytes<T: bytemuck::NoUninit>(messages: &[Vec<T>]) -> Vec<Vec<u8>> {
    messages
        .iter()
        .map(|m| cast_slice::<T, u8>(m).to_vec())
        .collect()
}

/// Numbers in a record.
const fn width<D: Dimension>() -> usize {
    size_of::<D::Record>() / size_of::<f64>()
}

/// Least number of records that several threads copy: to copy fewer takes no longer than to meet.
const COPIED_BY_THREADS: usize = 512;

/// How many of some records a thread copies, and the threads.
fn divided(records: usize, workers: Option<&Workers>) -> (usize, Option<&Workers>) {
    if records < COPIED_BY_THREADS {
        return (records.max(1), None);
    }
    (records.div_ceil(workers::count(workers)), workers)
}

/// Writes the numbers of the chosen records, one record after the other.
fn pack<D: Dimension>(
    record: &[D::Record],
    chosen: &[u32],
    numbers: &mut [f64],
    workers: Option<&Workers>,
) {
    let (part, workers) = divided(chosen.len(), workers);
    let numbers = numbers.chunks_mut(part * width::<D>());
    let mut parts: Vec<_> = numbers.zip(chosen.chunks(part)).collect();
    workers::each(workers, &mut parts, |_, (numbers, chosen)| {
        let places = numbers.chunks_exact_mut(width::<D>());
        for (place, &g) in places.zip(*chosen) {
            place.copy_from_slice(cast_slice(slice::from_ref(&record[g as usize])));
        }
    });
}

/// Reads the numbers of records.
fn unpack<D: Dimension>(numbers: &[f64], record: &mut [D::Record], workers: Option<&Workers>) {
    let (part, workers) = divided(record.len(), workers);
    let numbers = numbers.chunks(part * width::<D>());
    let mut parts: Vec<_> = record.chunks_mut(part).zip(numbers).collect();
    workers::each(workers, &mut parts, |_, (record, numbers)| {
        cast_slice_mut(record).copy_from_slice(numbers);
    });
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::dimension::{Three, Two};

    /// Records of whole numbers, each other than the others, by so many threads.
    fn records_arrive_as_they_were<D: Dimension>(threads: usize, sent: u32) {
        let workers = Workers::start(threads).expect("threads");
        let mut record = vec![D::Record::zeroed(); 2 * sent as usize];
        let numbers: &mut [f64] = cast_slice_mut(&mut record);
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = k as f64;
        }
        let chosen: Vec<u32> = (0..sent).map(|k| 2 * k + 1).collect();
        let mut numbers = vec![0.0; sent as usize * width::<D>()];
        pack::<D>(&record, &chosen, &mut numbers, workers.as_ref());
        let mut ghosts = vec![D::Record::zeroed(); sent as usize];
        unpack::<D>(&numbers, &mut ghosts, workers.as_ref());
        for (ghost, &g) in ghosts.iter().zip(&chosen) {
            let [ghost, wanted] = [ghost, &record[g as usize]].map(bytemuck::bytes_of);
            assert_eq!(ghost, wanted, "{threads} threads, record {g} of {sent}");
        }
    }

    #[test]
    fn threads_copy_what_one_copies() {
        let many = COPIED_BY_THREADS as u32;
        for (threads, sent) in [(1, many), (3, many - 1), (3, many), (3, many + 200), (2, 0)] {
            records_arrive_as_they_were::<Two>(threads, sent);
            records_arrive_as_they_were::<Three>(threads, sent);
        }
    }

    #[test]
    fn a_slower_rank_gets_less_work() {
        let mut shares = vec![0.5; 2];
        // The second rank does half as much in a second.
        for _ in 0..40 {
            let costs = shares.iter().map(|share| (1e6 * share) as i64);
            let times = [1e9 * shares[0], 2e9 * shares[1]].map(|t| t as i64);
            let costs_and_times: Vec<i64> = costs.chain(times).collect();
            share_anew(&mut shares, &costs_and_times);
        }
        assert!((shares[0] - 2.0 / 3.0).abs() < 1e-3, "{shares:?}");
        assert_eq!(shares.iter().sum::<f64>(), 1.0);
        let known = shares.clone();
        share_anew(&mut shares, &[5, 5, 0, 7]);
        assert_eq!(shares, known, "a time is not known");
        for _ in 0..40 {
            share_anew(&mut shares, &[1_000_000, 1, 1, 1_000_000]);
        }
        assert!((3.0..=4.0).contains(&(shares[0] / shares[1])), "{shares:?}");
    }
}
