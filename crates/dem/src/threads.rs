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
use crate::processor::ThreadClock;
use crate::state::{Bands, BlockRange, Contacts, Grains, Image, Share};
use crate::workers::{self, Workers, tail, tail_mut};

/// Number of grains whose forces a thread clears and adds together.
const PAGE: usize = 64;

/// The threads of a rank, and the partial forces of all but the first.
///
/// The calling thread is the first and computes the first part of everything. So with two threads
/// each finds its share of the grains and contacts in the cache of its core.
#[derive(Debug)]
pub struct ThreadPool<D: Dimension> {
    /// The other threads; `None` for a single thread.
    workers: Option<Workers>,
    scratch: Box<Scratch<D>>,
    partial: Vec<PartialForces<D>>,
}

/// The forces on all local grains by those contacts of one thread that are not within its share;
/// only some pages are used. They are 0 between two steps.
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
            scratch: Box::default(),
            partial: (1..threads).map(|_| PartialForces::default()).collect(),
        })
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        1 + self.partial.len()
    }

    /// A clock that begins now, and counts the time in which one thread works alone; with
    /// `thread_clock` also the processor time.
    pub(crate) fn clock(&mut self, thread_clock: Option<ThreadClock>) -> Clock {
        if let (Some(workers), Some(clock)) = (&mut self.workers, thread_clock) {
            workers.count_times(clock);
        }
        let workers = self.workers.as_ref();
        let clock = Clock::with_regions(workers.map(|workers| Arc::clone(workers.nanoseconds())));
        let times = workers.and_then(Workers::times).map(Arc::clone);
        clock.counting_processor_time(thread_clock, times)
    }

    /// The threads beside the first.
    pub(crate) fn workers(&self) -> Option<&Workers> {
        self.workers.as_ref()
    }

    /// Finds the pages of forces that each thread uses for its part of the pairs of a new list that
    /// are within no share. Must be called for every new list.
    pub(crate) fn assign(&mut self, contacts: &Contacts, local: usize) {
        let threads = self.threads();
        for (k, partial) in self.partial.iter_mut().enumerate() {
            partial.used.clear();
            partial.used.resize(local.div_ceil(PAGE), false);
            for others in &contacts.others {
                let part = part_of(&others.blocks(), k + 1, threads);
                for pairs in &contacts.pairs.blocks()[part] {
                    for &g in pairs.i.iter().chain(&pairs.j) {
                        partial.used[g as usize / PAGE] = true;
                    }
                }
            }
            partial.force.clear();
            partial.force.resize(local, D::Force::zeroed());
        }
    }

    /// Runs `work` on the share of each thread. Returns what it finds, from the first thread on.
    pub(crate) fn over_shares<R: Send>(
        &mut self,
        SharesInput {
            bands,
            grains,
            walls,
            contacts,
            samples,
        }: SharesInput<'_, D>,
        work: impl Fn(&mut ShareWork<'_, D>) -> R + Sync,
    ) -> Vec<R> {
        let mut samples = samples.map(ContactForces::all);
        let mut parts = OwnedPart::split(grains, walls, bands);
        let mut blocks = contacts.within_shares();
        let first = std::iter::once(&mut self.scratch);
        let others = self.partial.iter_mut().map(|partial| &mut partial.scratch);
        let scratches: Vec<_> = first.chain(others).collect();
        let mut jobs = Vec::new();
        for (share, scratch) in scratches.into_iter().enumerate().rev() {
            let (Some(grains), Some((of_share, blocks))) = (parts.pop(), blocks.pop()) else {
                break;
            };
            let samples = samples.as_mut();
            let job = ShareWork {
                share,
                bands,
                samples: samples.map(|samples| samples.split_off(blocks.first)),
                of_share,
                grains,
                blocks,
                scratch,
            };
            jobs.push((job, None));
        }
        jobs.reverse();
        workers::each(self.workers.as_ref(), &mut jobs, |_, (job, found)| {
            *found = Some(work(job));
        });
        jobs.into_iter().filter_map(|(_, found)| found).collect()
    }

    /// Runs `work` on the owned grains of each thread.
    pub(crate) fn over_owned(
        &self,
        bands: &Bands,
        grains: &mut Grains<D>,
        work: impl Fn(OwnedPart<'_, D>) + Sync,
    ) {
        let mut parts = OwnedPart::split(grains, WallGrains::default(), bands);
        workers::each(self.workers.as_ref(), &mut parts, |_, part| {
            work(part.reborrow());
        });
    }

    /// Computes the forces of the pairs of some bands, the last one first, that are within no
    /// share. The first thread adds its part to the forces on the grains, each other thread to its
    /// partial forces. Returns what the passes of each band found; nothing if there are no pairs.
    pub(crate) fn add_other_forces(
        &mut self,
        forces: &[BandForces<'_, D>],
        grains: &mut Grains<D>,
        contacts: &mut Contacts,
        samples: Option<&mut ContactForces>,
    ) -> Vec<PassOutcome> {
        let mut bands = forces.iter().map(|forces| forces.band);
        if (bands.clone()).all(|band| contacts.others[band].blocks().is_empty()) {
            return Vec::new();
        }
        let blocks = contacts.others_of(&mut bands);
        let mut outcomes = vec![PassOutcome::default(); forces.len()];
        let threads = self.threads();
        let mut samples = samples.map(ContactForces::all);
        let first = std::iter::once((&mut grains.force[..], &mut self.scratch));
        let others = self.partial.iter_mut();
        let others = others.map(|partial| (&mut partial.force[..], &mut partial.scratch));
        let mut jobs = Vec::new();
        for (force, scratch) in first.chain(others) {
            jobs.push(OtherWork {
                force,
                scratch,
                bands: Vec::new(),
                outcomes: Vec::new(),
            });
        }
        for mut blocks in blocks {
            let all = blocks.first..blocks.first + blocks.blocks();
            if let Some(samples) = &mut samples {
                samples.split_off(all.end);
            }
            for (k, job) in jobs.iter_mut().enumerate().rev() {
                let begin = part_of(&all, k, threads).start;
                let samples = samples.as_mut();
                let samples = samples.map(|samples| samples.split_off(begin));
                job.bands.push((blocks.split_off(begin), samples));
            }
        }
        let record = &grains.record[..];
        workers::each(self.workers.as_ref(), &mut jobs, |_, job| {
            job.add(forces, record, threads > 1);
        });
        for job in jobs {
            for (outcome, of_part) in outcomes.iter_mut().zip(job.outcomes) {
                *outcome = outcome.merge(of_part);
            }
        }
        outcomes
    }

    /// Adds the partial forces to the forces on the grains, and clears them.
    pub fn gather(&mut self, bands: &Bands, force: &mut [D::Force]) {
        let all = 0..bands.count();
        self.complete(bands, &[all], force, |_, _| WallSums::default());
    }

    /// Adds the partial forces to the forces on the grains of these bands, and clears them; then
    /// calls `work` with the local index of the first grain of a share, and the forces on its
    /// grains in these bands. Each thread does so for its share, whose forces stay in the cache of
    /// its core; the last thread with the last band also for ghosts and feet. Returns the sums of
    /// what it finds, for each range of bands.
    pub(crate) fn complete(
        &mut self,
        bands: &Bands,
        completed: &[Range<usize>],
        force: &mut [D::Force],
        work: impl Fn(usize, &[D::Force]) -> WallSums + Sync,
    ) -> Vec<WallSums> {
        let local = force.len();
        let mut all = Vec::with_capacity(completed.len());
        if self.workers.is_none() {
            // Without partial forces, all are complete.
            for completed in completed {
                let grains = completed_grains(bands, completed, 0, local);
                all.push(work(grains.start, &force[grains]));
            }
            return all;
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
        for share in (0..bands.shares()).rev() {
            let first = bands.share(share).start;
            let partial = partial.iter_mut().map(|sums| sums.split_off(first));
            let part = GatheredPart {
                first,
                partial: partial.collect(),
                force: tail_mut(&mut rest, first),
            };
            parts.push((part, vec![WallSums::default(); completed.len()]));
        }
        // The calling thread has the first share.
        parts.reverse();
        workers::each(self.workers.as_ref(), &mut parts, |share, (part, sums)| {
            for (completed, sums) in completed.iter().zip(sums) {
                if completed.is_empty() {
                    continue;
                }
                let grains = completed_grains(bands, completed, share, local);
                part.add(grains.clone());
                let force = &part.force[grains.start - part.first..grains.end - part.first];
                *sums = work(grains.start, force);
            }
        });
        all.resize(completed.len(), WallSums::default());
        for (_, sums) in parts {
            for (all, sums) in all.iter_mut().zip(sums) {
                all.merge(sums);
            }
        }
        all
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
    /// What the passes of a step share.
    pub input: PassInput,
}

/// What the shares are parts of.
pub(crate) struct SharesInput<'a, D: Dimension> {
    /// The shares, and their bands.
    pub bands: &'a Bands,
    /// The grains.
    pub grains: &'a mut Grains<D>,
    /// Those that belong to walls.
    pub walls: WallGrains<'a>,
    /// The contacts.
    pub contacts: &'a mut Contacts,
    /// Receives the contact forces.
    pub samples: Option<&'a mut ContactForces>,
}

/// The share of a thread: its grains, and the pairs within it.
pub(crate) struct ShareWork<'a, D: Dimension> {
    share: usize,
    bands: &'a Bands,
    of_share: &'a Share,
    grains: OwnedPart<'a, D>,
    blocks: BlockRange<'a>,
    samples: Option<Samples<'a>>,
    scratch: &'a mut Scratch<D>,
}

impl<D: Dimension> ShareWork<'_, D> {
    /// The grains of a band.
    pub fn grains_of(&mut self, band: usize) -> OwnedPart<'_, D> {
        self.grains.within(self.bands.grains(self.share, band))
    }

    /// Adds the forces of the pairs of a band.
    pub fn add_forces(&mut self, forces: &BandForces<'_, D>) -> PassOutcome {
        let pairs = &self.of_share.bands[forces.band];
        let first = self.blocks.first;
        let samples = self
            .samples
            .as_mut()
            .map(|samples| samples.within(pairs.blocks.start - first..pairs.blocks.end - first));
        let grains = self.grains.within(pairs.grains.clone());
        let blocks = self.blocks.within(pairs.blocks.clone());
        let pass = Pass::new(forces.input, grains.record, grains.force, blocks);
        forces.law.pass(pass.sampled(samples), self.scratch)
    }
}

/// A thread's part of the pairs of some bands that are within no share, and the forces to which it
/// adds theirs.
struct OtherWork<'a, D: Dimension> {
    force: &'a mut [D::Force],
    scratch: &'a mut Scratch<D>,
    bands: Vec<(BlockRange<'a>, Option<Samples<'a>>)>,
    outcomes: Vec<PassOutcome>,
}

impl<D: Dimension> OtherWork<'_, D> {
    /// Adds the forces of the pairs of these bands. `were_elsewhere`: other cores have moved many
    /// of the grains.
    fn add(&mut self, forces: &[BandForces<'_, D>], record: &[D::Record], were_elsewhere: bool) {
        for (forces, (blocks, samples)) in forces.iter().zip(self.bands.drain(..)) {
            let input = PassInput {
                is_cold: forces.input.is_cold || were_elsewhere,
                ..forces.input
            };
            let pass = Pass::new(input, record, self.force, blocks).sampled(samples);
            self.outcomes.push(forces.law.pass(pass, self.scratch));
        }
    }
}

/// The grains of some bands that a thread completes: those of its share, and the last thread with
/// the last band also ghosts and feet, up to `local`.
fn completed_grains(
    bands: &Bands,
    completed: &Range<usize>,
    share: usize,
    local: usize,
) -> Range<usize> {
    let mut grains = bands.grains_of(share, completed.clone());
    if share + 1 == bands.shares() && completed.end == bands.count() {
        grains.end = local;
    }
    grains
}

/// A part of some blocks, of so many parts.
fn part_of(blocks: &Range<usize>, part: usize, parts: usize) -> Range<usize> {
    let begin = |part: usize| blocks.start + blocks.len() * part / parts;
    begin(part)..begin(part + 1)
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
    /// Adds the partial forces on these grains, and clears them.
    fn add(&mut self, grains: Range<usize>) {
        for partial in &mut self.partial {
            for page in grains.start / PAGE..grains.end.div_ceil(PAGE) {
                if !partial.used[page] {
                    continue;
                }
                let here = (page * PAGE).max(grains.start)..((page + 1) * PAGE).min(grains.end);
                let place = here.start - self.first..here.end - self.first;
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
    /// The share of each thread.
    fn split(grains: &'a mut Grains<D>, walls: WallGrains<'a>, bands: &Bands) -> Vec<Self> {
        let owned = 0..grains.owned;
        let mut all = Self {
            record: &mut grains.record[owned.clone()],
            force: &mut grains.force[owned.clone()],
            half_kick: &grains.half_kick[owned.clone()],
            image: &mut grains.image[owned.clone()],
            mass: &grains.mass[owned.clone()],
            body: &grains.body[owned.clone()],
            first: 0,
            walls: walls.within(owned),
        };
        let mut parts = Vec::new();
        for share in (0..bands.shares()).rev() {
            let at = bands.share(share).start;
            parts.push(Self {
                record: tail_mut(&mut all.record, at),
                force: tail_mut(&mut all.force, at),
                half_kick: tail(&mut all.half_kick, at),
                image: tail_mut(&mut all.image, at),
                mass: tail(&mut all.mass, at),
                body: tail(&mut all.body, at),
                first: at,
                walls: all.walls.split_off(at),
            });
        }
        parts.reverse();
        parts
    }

    /// Some of them, by their local indices, for a while.
    pub fn within(&mut self, grains: Range<usize>) -> OwnedPart<'_, D> {
        let here = grains.start - self.first..grains.end - self.first;
        OwnedPart {
            record: &mut self.record[here.clone()],
            force: &mut self.force[here.clone()],
            half_kick: &self.half_kick[here.clone()],
            image: &mut self.image[here.clone()],
            mass: &self.mass[here.clone()],
            body: &self.body[here],
            first: grains.start,
            walls: self.walls.within(grains),
        }
    }

    /// All of them for a while.
    pub fn reborrow(&mut self) -> OwnedPart<'_, D> {
        self.within(self.first..self.first + self.record.len())
    }
}
