//! The thread pool of a rank. Every thread has a share of the owned grains, and alone adds the
//! forces of the pairs within it. Of the other pairs, across shares and with ghosts, every thread
//! sums the forces of a part, and then the pool adds these sums. All sums are exact, so the number
//! of threads does not change a bit.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Zeroable;

use crate::clock::Clock;
use crate::dimension::Dimension;
use crate::drive::{WallGrains, WallSums};
use crate::failure::Result;
use crate::kernel::{ContactForces, PairForce, Pass, PassInput, PassOutcome, Samples, Scratch};
use crate::state::{BandBlocks, BlockRange, CandidatePair, Contacts, Grains, Image, Share};
use crate::workers::{self, Workers, tail, tail_mut};

/// Number of grains whose forces a thread clears and adds together.
const PAGE: usize = 64;

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

    /// A clock that begins now, and counts the time in which one thread works alone.
    pub(crate) fn clock(&self) -> Clock {
        let workers = self.workers.as_ref();
        Clock::with_regions(workers.map(|workers| Arc::clone(workers.nanoseconds())))
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
        let scratches = scratches(&mut self.scratch, &mut self.partial);
        let mut rest = force;
        let mut passes = Vec::with_capacity(shares.len());
        let pairs = pairs_within(&shares, contacts, samples, scratches);
        for (share, pairs) in shares.iter().zip(pairs).rev() {
            let force = tail_mut(&mut rest, share.grains.start);
            let (record, force) = (
                &record[share.grains.clone()],
                &mut force[..share.grains.len()],
            );
            passes.push(pairs.pass(input, record, force));
        }
        let outcome = compute(self.workers.as_ref(), law, passes);
        contacts.bands[band].shares = shares;
        outcome
    }

    /// Moves each share by `work`, and adds the forces of the pairs within it, for which no grain
    /// of another share is needed: in one region. `work` says how far the grains of its part have
    /// travelled since the list was made (m), and `each` is called with what else it found.
    pub(crate) fn move_and_add_forces<R: Send>(
        &mut self,
        forces: &BandForces<'_, D>,
        MovedGrains {
            grains,
            walls,
            contacts,
            samples,
        }: MovedGrains<'_, D>,
        work: impl Fn(OwnedPart<'_, D>) -> (R, f64) + Sync,
        mut each: impl FnMut(R),
    ) -> PassOutcome {
        let BandForces { law, band, input } = *forces;
        let shares = std::mem::take(&mut contacts.bands[band].shares);
        let scratches = scratches(&mut self.scratch, &mut self.partial);
        let pairs = pairs_within(&shares, contacts, samples, scratches);
        let owned = 0..grains.owned;
        let parts = OwnedPart::of(grains, owned, walls).split(&self.shares);
        let jobs = parts.into_iter().zip(pairs);
        let mut jobs: Vec<_> = jobs.map(|job| (Some(job), None)).collect();
        workers::each(self.workers.as_ref(), &mut jobs, |_, (job, found)| {
            if let Some((mut part, pairs)) = job.take() {
                let (result, travelled) = work(part.reborrow());
                let input = PassInput {
                    travelled: Some(travelled),
                    ..input
                };
                let (pass, scratch) = pairs.pass(input, part.record, part.force);
                *found = Some((result, law.pass(pass, scratch)));
            }
        });
        let mut outcome = PassOutcome::default();
        for (result, of_share) in jobs.into_iter().filter_map(|(_, found)| found) {
            outcome = outcome.merge(of_share);
            each(result);
        }
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
        let input = PassInput {
            // Another core has moved many of the grains.
            is_cold: input.is_cold || threads > 1,
            ..input
        };
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

    /// Adds the partial forces to the forces on the grains, and clears them.
    pub fn gather(&mut self, force: &mut [D::Force]) {
        let nowhere = &mut WallSums::default();
        self.complete(force, WallGrains::default(), nowhere, |_, _, _, _| ());
    }

    /// Adds the partial forces to the forces on the grains, and clears them; then adds what `work`
    /// finds of the grains of walls. Each thread does so for its share, whose forces stay in the
    /// cache of its core; the last one also for ghosts and feet. `work` gets the local index of the
    /// first grain of a share, and the forces on its grains.
    pub(crate) fn complete(
        &mut self,
        force: &mut [D::Force],
        mut walls: WallGrains<'_>,
        sums: &mut WallSums,
        work: impl Fn(usize, &[D::Force], WallGrains<'_>, &mut WallSums) + Sync,
    ) {
        if self.workers.is_none() {
            return work(0, force, walls, sums);
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
            let part = GatheredPart {
                first,
                partial: partial.collect(),
                force: tail_mut(&mut rest, first),
            };
            parts.push((part, walls.split_off(first), WallSums::default()));
        }
        // The calling thread has the first share.
        parts.reverse();
        workers::each(
            self.workers.as_ref(),
            &mut parts,
            |_, (part, walls, sums)| {
                part.add();
                work(part.first, part.force, *walls, sums);
            },
        );
        for (_, _, of_share) in parts {
            sums.merge(of_share);
        }
    }

    /// Runs `work` on the part of each thread of these owned grains, which with several threads are
    /// all, and calls `each` with every result. Each part has its own grains of `walls`.
    pub(crate) fn over_owned<R: Send>(
        &self,
        grains: &mut Grains<D>,
        owned: Range<usize>,
        walls: WallGrains<'_>,
        work: impl Fn(OwnedPart<'_, D>) -> R + Sync,
        mut each: impl FnMut(R),
    ) {
        let all = OwnedPart::of(grains, owned, walls);
        if self.workers.is_none() {
            return each(work(all));
        }
        let parts = all.split(&self.shares).into_iter();
        let mut parts: Vec<_> = parts.map(|part| (Some(part), None)).collect();
        workers::each(self.workers.as_ref(), &mut parts, |_, (part, result)| {
            *result = part.take().map(&work);
        });
        let results = parts.into_iter().filter_map(|(_, result)| result);
        results.for_each(each);
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

/// What moves, and what its forces are computed with.
pub(crate) struct MovedGrains<'a, D: Dimension> {
    /// The grains; the owned ones move.
    pub grains: &'a mut Grains<D>,
    /// Those that belong to walls.
    pub walls: WallGrains<'a>,
    /// The contacts.
    pub contacts: &'a mut Contacts,
    /// Receives the contact forces.
    pub samples: Option<&'a mut ContactForces>,
}

/// The pairs within a share, and what their pass needs besides the grains.
struct SharePairs<'a, D: Dimension> {
    part: BlockRange<'a>,
    samples: Option<Samples<'a>>,
    scratch: &'a mut Scratch<D>,
}

impl<'a, D: Dimension> SharePairs<'a, D> {
    /// Their pass with the records of the share and the forces on it, and its scratch.
    fn pass<'b>(
        self,
        input: PassInput,
        record: &'b [D::Record],
        force: &'b mut [D::Force],
    ) -> (Pass<'b, D>, &'b mut Scratch<D>)
    where
        'a: 'b,
    {
        let pass = Pass::new(input, record, force, self.part);
        (pass.sampled(self.samples), self.scratch)
    }
}

/// The scratch of each thread.
fn scratches<'a, D: Dimension>(
    of_first: &'a mut Scratch<D>,
    of_others: &'a mut [PartialForces<D>],
) -> Vec<&'a mut Scratch<D>> {
    let others = of_others.iter_mut().map(|partial| &mut *partial.scratch);
    std::iter::once(of_first).chain(others).collect()
}

/// The pairs within each of these shares, from the first one on.
fn pairs_within<'a, D: Dimension>(
    shares: &[Share],
    contacts: &'a mut Contacts,
    samples: Option<&'a mut ContactForces>,
    scratches: Vec<&'a mut Scratch<D>>,
) -> Vec<SharePairs<'a, D>> {
    let blocks = shares[0].blocks.start..shares[shares.len() - 1].blocks.end;
    let first_block = blocks.start;
    let mut samples = samples.map(|samples| samples.part(blocks.clone()));
    let mut part = contacts.part(blocks);
    let mut pairs = Vec::with_capacity(shares.len());
    for (share, scratch) in shares.iter().zip(scratches).rev() {
        let begin = share.blocks.start;
        let samples = samples.as_mut();
        pairs.push(SharePairs {
            part: part.split_off(begin),
            samples: samples.map(|samples| samples.split_off(begin - first_block)),
            scratch,
        });
    }
    pairs.reverse();
    pairs
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
    /// Their bodies; see [`body`](crate::state::body).
    pub body: &'a [u32],
    /// The local index of the first of them.
    pub first: usize,
    /// Those that belong to walls.
    pub walls: WallGrains<'a>,
}

impl<'a, D: Dimension> OwnedPart<'a, D> {
    /// Some owned grains, and those of them that belong to walls.
    fn of(grains: &'a mut Grains<D>, owned: Range<usize>, walls: WallGrains<'a>) -> Self {
        Self {
            record: &mut grains.record[owned.clone()],
            force: &mut grains.force[owned.clone()],
            half_kick: &grains.half_kick[owned.clone()],
            image: &mut grains.image[owned.clone()],
            mass: &grains.mass[owned.clone()],
            body: &grains.body[owned.clone()],
            first: owned.start,
            walls,
        }
    }

    /// The part of each thread.
    fn split(mut self, shares: &[Range<usize>]) -> Vec<Self> {
        let mut parts = Vec::with_capacity(shares.len());
        for share in shares.iter().rev() {
            let at = share.start - self.first;
            parts.push(Self {
                record: tail_mut(&mut self.record, at),
                force: tail_mut(&mut self.force, at),
                half_kick: tail(&mut self.half_kick, at),
                image: tail_mut(&mut self.image, at),
                mass: tail(&mut self.mass, at),
                body: tail(&mut self.body, at),
                first: share.start,
                walls: self.walls.split_off(share.start),
            });
        }
        parts.reverse();
        parts
    }

    /// The same part for a while.
    pub fn reborrow(&mut self) -> OwnedPart<'_, D> {
        OwnedPart {
            record: self.record,
            force: self.force,
            half_kick: self.half_kick,
            image: self.image,
            mass: self.mass,
            body: self.body,
            first: self.first,
            walls: self.walls,
        }
    }
}
