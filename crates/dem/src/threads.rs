//! The thread pool of a rank. Every thread has a share of the owned grains, and alone adds the
//! forces of the pairs within it. Of the other pairs, across shares and with ghosts, every thread
//! sums the forces of a part, and then the pool adds these sums. All sums are exact, so the number
//! of threads does not change a bit.

use std::ops::Range;

use bytemuck::Zeroable;

use crate::dimension::Dimension;
use crate::drive::{WallGrains, WallSums};
use crate::failure::Result;
use crate::kernel::{ContactForces, PairForce, Pass, PassInput, PassOutcome, Scratch};
use crate::state::{BandBlocks, CandidatePair, Contacts, Grains, Image};
use crate::workers::{self, Workers, tail, tail_mut};

/// Number of grains whose forces a thread clears and adds together.
const PAGE: usize = 256;

/// Cost of a pair in a step over that of a grain.
const PAIR_COST: usize = 6;

/// The threads of a rank, and the partial forces of all but the first.
///
/// The calling thread is the first and computes the first part of everything. So with two threads
/// each finds its share of the grains and contacts in the cache of its core.
#[derive(Debug)]
pub struct ThreadPool<D: Dimension> {
    /// The other threads; `None` for a single thread.
    workers: Option<Workers>,
    /// The owned grains of each thread, one range after the other.
    shares: Vec<Range<usize>>,
    scratch: Box<Scratch<D>>,
    partial: Vec<PartialForces<D>>,
}

/// The forces on all local grains by those contacts of one thread that are not within its share;
/// only some pages are used. They are 0 between two passes.
#[derive(Debug, Default)]
struct PartialForces<D: Dimension> {
    force: Vec<D::Force>,
    /// Whether each page is used.
    used: Vec<bool>,
    scratch: Box<Scratch<D>>,
}

impl<D: Dimension> ThreadPool<D> {
    /// Starts a pool of `threads` threads, the calling one included.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn new(threads: usize) -> Result<Self> {
        Ok(Self {
            workers: Workers::start(threads)?,
            shares: vec![0..0; threads.max(1)],
            scratch: Box::default(),
            partial: (1..threads).map(|_| PartialForces::default()).collect(),
        })
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        1 + self.partial.len()
    }

    /// The threads beside the first.
    pub(crate) fn workers(&self) -> Option<&Workers> {
        self.workers.as_ref()
    }

    /// Divides the owned grains among the threads, so that all have as much to do. Must be called
    /// for every new list.
    pub fn divide(&mut self, candidates: &[CandidatePair], owned: usize) {
        let threads = self.threads();
        if threads == 1 {
            self.shares[0] = 0..owned;
            return;
        }
        let mut cost = vec![1; owned];
        for pair in candidates {
            if let Some(cost) = cost.get_mut(pair.grains[0] as usize) {
                *cost += PAIR_COST;
            }
        }
        let all: usize = cost.iter().sum();
        let mut end = 0;
        let mut before = 0;
        for (k, share) in self.shares.iter_mut().enumerate() {
            let start = end;
            while end < owned && (k + 1 == threads || before < all * (k + 1) / threads) {
                before += cost[end];
                end += 1;
            }
            *share = start..end;
        }
    }

    /// The owned grains of each thread, one range after the other.
    pub fn shares(&self) -> &[Range<usize>] {
        &self.shares
    }

    /// Divides the pairs of a new list that are within no share, and finds the pages that each part
    /// uses. Must be called for every new list.
    pub(crate) fn assign(&mut self, contacts: &Contacts, local: usize) {
        let threads = self.threads();
        // With several threads there is one band.
        let others = contacts.bands.first().map_or(0..0, BandBlocks::others);
        for (k, partial) in self.partial.iter_mut().enumerate() {
            partial.used.clear();
            partial.used.resize(local.div_ceil(PAGE), false);
            let begin = |part: usize| others.start + others.len() * part / threads;
            for pairs in &contacts.pairs.blocks()[begin(k + 1)..begin(k + 2)] {
                for &g in pairs.i.iter().chain(&pairs.j) {
                    partial.used[g as usize / PAGE] = true;
                }
            }
            partial.force.clear();
            partial.force.resize(local, D::Force::zeroed());
        }
    }

    /// Adds the forces of the pairs of a band that are within the shares.
    pub(crate) fn forces_within_shares(
        &mut self,
        forces: &BandForces<'_, D>,
        record: &[D::Record],
        force: &mut [D::Force],
        contacts: &mut Contacts,
        samples: Option<&mut ContactForces>,
    ) -> PassOutcome {
        let BandForces { law, band, input } = *forces;
        let shares = std::mem::take(&mut contacts.bands[band].shares);
        let blocks = shares[0].blocks.start..shares[shares.len() - 1].blocks.end;
        let first_block = blocks.start;
        let mut samples = samples.map(|s| s.part(blocks.clone()));
        let mut part = contacts.part(blocks);
        let mut rest = force;
        let others = self.partial.iter_mut().map(|partial| &mut partial.scratch);
        let scratches: Vec<_> = std::iter::once(&mut self.scratch).chain(others).collect();
        let mut passes = Vec::with_capacity(scratches.len());
        for (share, scratch) in shares.iter().zip(scratches).rev() {
            let begin = share.blocks.start;
            let force = tail_mut(&mut rest, share.grains.start);
            let (record, force) = (
                &record[share.grains.clone()],
                &mut force[..share.grains.len()],
            );
            let pass = Pass::new(input, record, force, part.split_off(begin));
            let samples = samples.as_mut().map(|s| s.split_off(begin - first_block));
            passes.push((pass.sampled(samples), &mut **scratch));
        }
        let outcome = compute(self.workers.as_ref(), law, passes);
        contacts.bands[band].shares = shares;
        outcome
    }

    /// Computes the forces of the pairs of a band that are within no share. The first thread adds
    /// its part to `force`, each other thread to its partial forces.
    pub(crate) fn other_forces(
        &mut self,
        forces: &BandForces<'_, D>,
        record: &[D::Record],
        force: &mut [D::Force],
        contacts: &mut Contacts,
        samples: Option<&mut ContactForces>,
    ) -> PassOutcome {
        let BandForces { law, band, input } = *forces;
        let group = contacts.bands[band].others();
        if group.is_empty() {
            return PassOutcome::default();
        }
        let threads = self.threads();
        let mut samples = samples.map(|s| s.part(group.clone()));
        let mut part = contacts.part(group.clone());
        let others = self.partial.iter_mut();
        let others = others.map(|partial| (&mut partial.force[..], &mut partial.scratch));
        let first = std::iter::once((force, &mut self.scratch));
        let sums: Vec<_> = first.chain(others).collect();
        let mut passes = Vec::with_capacity(threads);
        for (k, (force, scratch)) in sums.into_iter().enumerate().rev() {
            let begin = group.len() * k / threads;
            let pass = Pass::new(input, record, force, part.split_off(group.start + begin));
            let samples = samples.as_mut().map(|s| s.split_off(begin));
            passes.push((pass.sampled(samples), &mut **scratch));
        }
        compute(self.workers.as_ref(), law, passes)
    }

    /// Adds the partial forces to the forces on the grains, and clears them. Each thread adds those
    /// on its share, whose forces stay in the cache of its core; the last one those on ghosts, too.
    pub fn gather(&mut self, force: &mut [D::Force]) {
        if self.workers.is_none() {
            return;
        }
        let mut partial: Vec<PartialSums<'_, D>> = Vec::new();
        for of_thread in &mut self.partial {
            partial.push(PartialSums {
                force: &mut of_thread.force,
                used: &of_thread.used,
            });
        }
        let mut rest = force;
        let mut parts = Vec::new();
        for share in self.shares.iter().rev() {
            let first = share.start;
            let partial = partial.iter_mut().map(|sums| sums.split_off(first));
            parts.push(GatheredPart {
                first,
                partial: partial.collect(),
                force: tail_mut(&mut rest, first),
            });
        }
        // The calling thread has the first share.
        parts.reverse();
        workers::each(self.workers.as_ref(), &mut parts, |_, part| part.add());
    }

    /// Adds what `work` finds of the grains of walls in each share; feet are with the last.
    pub(crate) fn over_walls(
        &self,
        mut walls: WallGrains<'_>,
        sums: &mut WallSums,
        work: impl Fn(WallGrains<'_>, &mut WallSums) + Sync,
    ) {
        if self.workers.is_none() || walls.is_empty() {
            return work(walls, sums);
        }
        let mut parts = Vec::new();
        for share in self.shares.iter().rev() {
            parts.push((walls.split_off(share.start), WallSums::default()));
        }
        parts.reverse();
        workers::each(self.workers.as_ref(), &mut parts, |_, (walls, sums)| {
            work(*walls, sums);
        });
        for (_, of_share) in parts {
            sums.merge(of_share);
        }
    }

    /// Runs `work` on the part of each thread of these owned grains, which with several threads are
    /// all, and calls `each` with every result. Each part has its own grains of `walls`.
    pub(crate) fn over_owned<R: Send + Default>(
        &self,
        grains: &mut Grains<D>,
        owned: Range<usize>,
        walls: WallGrains<'_>,
        work: impl Fn(OwnedPart<'_, D>) -> R + Sync,
        mut each: impl FnMut(R),
    ) {
        let mut rest = OwnedPart {
            record: &mut grains.record[owned.clone()],
            force: &mut grains.force[owned.clone()],
            half_kick: &grains.half_kick[owned.clone()],
            image: &mut grains.image[owned.clone()],
            mass: &grains.mass[owned.clone()],
            first: owned.start,
            walls,
        };
        let Some(workers) = &self.workers else {
            return each(work(rest));
        };
        let mut results: Vec<R> = self.shares.iter().map(|_| R::default()).collect();
        workers.region(|region| {
            let work = &work;
            let (first, others) = results.split_at_mut(1);
            // From the last share to the first, which this thread computes.
            for (share, result) in self.shares[1..].iter().zip(others).rev() {
                let part = OwnedPart {
                    record: tail_mut(&mut rest.record, share.start),
                    force: tail_mut(&mut rest.force, share.start),
                    half_kick: tail(&mut rest.half_kick, share.start),
                    image: tail_mut(&mut rest.image, share.start),
                    mass: tail(&mut rest.mass, share.start),
                    first: share.start,
                    walls: rest.walls.split_off(share.start),
                };
                region.spawn(move || *result = work(part));
            }
            first[0] = work(rest);
        });
        results.into_iter().for_each(each);
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        self.partial
            .iter()
            .map(|partial| partial.force.capacity() * size_of::<D::Force>())
            .sum()
    }
}

/// The forces of the pairs of a band.
#[derive(Clone, Copy)]
pub(crate) struct BandForces<'a, D: Dimension> {
    /// The law.
    pub law: &'a dyn PairForce<D>,
    /// The band.
    pub band: usize,
    /// What all passes of a step share.
    pub input: PassInput,
}

/// Computes all parts of a pass, from the last to the first, which the calling thread computes.
fn compute<D: Dimension>(
    workers: Option<&Workers>,
    law: &dyn PairForce<D>,
    mut parts: Vec<(Pass<'_, D>, &mut Scratch<D>)>,
) -> PassOutcome {
    let (first, scratch_of_first) = parts.pop().expect("every thread has a part");
    let Some(workers) = workers else {
        return law.pass(first, scratch_of_first);
    };
    let mut outcomes = vec![PassOutcome::default(); parts.len()];
    let mut outcome = PassOutcome::default();
    workers.region(|region| {
        for ((part, scratch), outcome) in parts.into_iter().zip(&mut outcomes) {
            region.spawn(move || *outcome = law.pass(part, scratch));
        }
        outcome = law.pass(first, scratch_of_first);
    });
    outcomes.into_iter().rev().fold(outcome, PassOutcome::merge)
}

/// The partial forces of a thread on the grains of some shares.
struct PartialSums<'a, D: Dimension> {
    force: &'a mut [D::Force],
    /// Of all pages of the rank.
    used: &'a [bool],
}

impl<'a, D: Dimension> PartialSums<'a, D> {
    /// Splits off those from a grain on.
    fn split_off(&mut self, first: usize) -> PartialSums<'a, D> {
        PartialSums {
            force: tail_mut(&mut self.force, first),
            used: self.used,
        }
    }
}

/// The forces on the grains of a share, and what is added to them.
struct GatheredPart<'a, D: Dimension> {
    /// The local index of the first grain.
    first: usize,
    force: &'a mut [D::Force],
    partial: Vec<PartialSums<'a, D>>,
}

impl<D: Dimension> GatheredPart<'_, D> {
    /// Adds the partial forces, and clears them.
    fn add(&mut self) {
        let (first, end) = (self.first, self.first + self.force.len());
        for partial in &mut self.partial {
            for page in first / PAGE..end.div_ceil(PAGE) {
                if !partial.used[page] {
                    continue;
                }
                let grains = (page * PAGE).max(first)..((page + 1) * PAGE).min(end);
                let place = grains.start - first..grains.end - first;
                let sums = &mut self.force[place.clone()];
                for (sum, more) in sums.iter_mut().zip(&mut partial.force[place]) {
                    for (sum, more) in sum.iter_mut().zip(&more[..]) {
                        *sum += more;
                    }
                    *more = D::Force::zeroed();
                }
            }
        }
    }
}

/// The share of a thread, for the kicks and the drift; see [`Grains`].
pub(crate) struct OwnedPart<'a, D: Dimension> {
    /// Their records.
    pub record: &'a mut [D::Record],
    /// Their forces and torques.
    pub force: &'a mut [D::Force],
    /// ½Δt/m and ½Δt/I.
    pub half_kick: &'a [[f64; 2]],
    /// Their images.
    pub image: &'a mut [Image],
    /// Their masses (kg).
    pub mass: &'a [f64],
    /// The local index of the first of them.
    pub first: usize,
    /// Those that belong to walls.
    pub walls: WallGrains<'a>,
}
