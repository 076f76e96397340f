//! The thread pool of a rank. Every thread sums the forces of its part of the contacts, and then
//! the pool adds these sums. They are exact, so the number of threads does not change a bit.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use bytemuck::Zeroable;

use crate::dimension::Dimension;
use crate::failure::Failure;
use crate::kernel::{ContactForces, Counting, PairForce, Pass, PassOutcome, Scratch};
use crate::simd::Isa;
use crate::state::{Cell, Contacts, Grains, Image, Units};

/// Number of grains whose forces a thread clears and adds together.
const PAGE: usize = 256;

/// The threads of a rank, and the partial forces of all but the first.
///
/// The calling thread is the first and computes the first part of everything. So with two threads
/// each finds its part of the grains and contacts in the cache of its core.
#[derive(Debug)]
pub struct ThreadPool<D: Dimension> {
    /// The other threads; `None` for a single thread.
    workers: Option<Workers>,
    scratch: Box<Scratch<D>>,
    partial: Vec<PartialForces<D>>,
    /// The first page that each thread gathers, so that all have as much to add.
    gathered_from: Vec<usize>,
}

/// The threads beside the first.
#[derive(Debug)]
struct Workers {
    pool: rayon::ThreadPool,
    /// Number of regions of parallel work that have begun.
    regions: Arc<AtomicU64>,
}

/// How long an idle thread waits for the next region of a step before it sleeps. To wake a thread
/// takes longer than most waits.
const AWAKE: Duration = Duration::from_micros(500);

impl Workers {
    /// Runs `work`, which may spawn, and waits for what it spawned.
    fn region<'scope>(&self, work: impl FnOnce(&rayon::Scope<'scope>)) {
        self.regions.fetch_add(1, Ordering::Release);
        self.pool.in_place_scope(work);
        let regions = self.regions.clone();
        let here = regions.load(Ordering::Relaxed);
        self.pool.spawn_broadcast(move |_| {
            let end = Instant::now() + AWAKE;
            while regions.load(Ordering::Acquire) == here && Instant::now() < end {
                std::thread::yield_now();
            }
        });
    }
}

/// The forces on all local grains by the contacts of one thread; only some pages are used. They are
/// 0 between two passes.
#[derive(Debug)]
struct PartialForces<D: Dimension> {
    force: Vec<D::Force>,
    /// Whether each page is used.
    used: Vec<bool>,
    scratch: Box<Scratch<D>>,
}

/// The inputs that all parts of a pass share; see [`Pass`].
#[derive(Clone, Copy)]
pub struct SharedInput<'a, D: Dimension> {
    /// The instruction set.
    pub isa: Isa,
    /// The contact law.
    pub law: &'a dyn PairForce<D>,
    /// The units to which forces and torques are rounded.
    pub units: Units,
    /// The cell.
    pub cell: Cell,
    /// Δt (s), or 0.
    pub step: f64,
    /// How far the grains have travelled since the list was made (m), if known.
    pub travelled: Option<f64>,
    /// Makes the pass count the dissipation.
    pub counting: Option<Counting>,
}

impl<D: Dimension> ThreadPool<D> {
    /// Starts a pool of `threads` threads, the calling one included.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn new(threads: usize) -> Result<Self, Failure> {
        if threads <= 1 {
            return Ok(Self {
                workers: None,
                scratch: Box::default(),
                partial: Vec::new(),
                gathered_from: Vec::new(),
            });
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads - 1)
            .build()
            .map_err(|e| Failure::Other(format!("{threads} threads: {e}")))?;
        Ok(Self {
            workers: Some(Workers {
                pool,
                regions: Arc::default(),
            }),
            scratch: Box::default(),
            partial: (1..threads)
                .map(|_| PartialForces {
                    force: Vec::new(),
                    used: Vec::new(),
                    scratch: Box::default(),
                })
                .collect(),
            gathered_from: Vec::new(),
        })
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        1 + self.partial.len()
    }

    /// Divides a new list of contacts among the threads, and finds the pages that each part uses.
    /// Must be called for every new list.
    pub fn assign(&mut self, contacts: &Contacts, local: usize) {
        let threads = self.threads();
        let all = contacts.blocks();
        for (k, partial) in self.partial.iter_mut().enumerate() {
            partial.used.clear();
            partial.used.resize(local.div_ceil(PAGE), false);
            for group in [0..contacts.inner, contacts.inner..all] {
                let begin = |part: usize| group.start + group.len() * part / threads;
                for pairs in &contacts.pairs.blocks()[begin(k + 1)..begin(k + 2)] {
                    for &g in pairs.i.iter().chain(&pairs.j) {
                        partial.used[g as usize / PAGE] = true;
                    }
                }
            }
            partial.force.clear();
            partial.force.resize(local, D::Force::zeroed());
        }
        let sums_of = |page: usize| self.partial.iter().filter(|p| p.used[page]).count();
        let sums: Vec<usize> = (0..local.div_ceil(PAGE)).map(sums_of).collect();
        let all: usize = sums.iter().sum();
        let begin = |thread: usize| {
            let mut before = 0;
            let is_before = |&&more: &&usize| {
                let is_before = before < all * thread / threads;
                before += more;
                is_before
            };
            sums.iter().take_while(is_before).count()
        };
        self.gathered_from = (0..threads).map(begin).collect();
    }

    /// Computes the contact forces of a group of blocks. The first thread adds its part to `force`,
    /// each other thread to its partial forces.
    pub fn contact_forces(
        &mut self,
        input: SharedInput<'_, D>,
        record: &[D::Record],
        force: &mut [D::Force],
        contacts: &mut Contacts,
        group: Range<usize>,
        samples: Option<&mut ContactForces>,
    ) -> PassOutcome {
        let pass = |part, force, samples, scratch: &mut Scratch<D>| {
            input.law.pass(
                input.isa,
                Pass {
                    record,
                    force,
                    part,
                    units: input.units,
                    cell: input.cell,
                    step: input.step,
                    travelled: input.travelled,
                    samples,
                    counting: input.counting,
                },
                scratch,
            )
        };
        if group.is_empty() {
            return PassOutcome::default();
        }
        let mut samples = samples.map(|s| s.part(group.clone()));
        let mut part = contacts.part(group.clone());
        let Some(workers) = &self.workers else {
            return pass(part, force, samples, &mut self.scratch);
        };
        let threads = 1 + self.partial.len();
        let mut outcomes = vec![PassOutcome::default(); threads];
        workers.region(|scope| {
            let pass = &pass;
            let (first, others) = outcomes.split_at_mut(1);
            // From the last part to the first, which this thread computes.
            for (k, (partial, outcome)) in self.partial.iter_mut().zip(others).enumerate().rev() {
                let begin = group.start + group.len() * (k + 1) / threads;
                let blocks = begin - part.first;
                let (before, after) = part.split(begin);
                let (samples_before, samples_after) = samples.map(|s| s.split(blocks)).unzip();
                (part, samples) = (before, samples_before);
                scope.spawn(move |_| {
                    *outcome = pass(
                        after,
                        &mut partial.force,
                        samples_after,
                        &mut partial.scratch,
                    );
                });
            }
            first[0] = pass(part, force, samples, &mut self.scratch);
        });
        outcomes
            .into_iter()
            .fold(PassOutcome::default(), PassOutcome::merge)
    }

    /// Adds the partial forces to the forces on the grains, and clears them.
    pub fn gather(&mut self, force: &mut [D::Force]) {
        let Some(workers) = &self.workers else {
            return;
        };
        let gathered_from = &self.gathered_from;
        let mut partial: Vec<_> = self
            .partial
            .iter_mut()
            .map(|partial| (&mut partial.force[..], &partial.used[..]))
            .collect();
        let mut rest = force;
        let add = |force: &mut [D::Force], partial: Vec<(&mut [D::Force], &[bool])>| {
            for (more, used) in partial {
                let pages = force.chunks_mut(PAGE).zip(more.chunks_mut(PAGE)).zip(used);
                for ((sums, page), _) in pages.filter(|(_, used)| **used) {
                    for (sum, more) in sums.iter_mut().zip(page) {
                        for (sum, more) in sum.iter_mut().zip(&more[..]) {
                            *sum += more;
                        }
                        *more = D::Force::zeroed();
                    }
                }
            }
        };
        workers.region(|scope| {
            let add = &add;
            // From the last part to the first, which this thread adds.
            for &first in gathered_from[1..].iter().rev() {
                let (before, sums) = rest.split_at_mut((first * PAGE).min(rest.len()));
                rest = before;
                let of_others = split_off(&mut partial, first);
                scope.spawn(move |_| add(sums, of_others));
            }
            add(rest, partial);
        });
    }

    /// Divides the owned grains into parts of about the same size, one per thread, runs `work` on
    /// each, and calls `each` with every result.
    pub fn over_owned<R: Send + Default>(
        &self,
        grains: &mut Grains<D>,
        work: impl Fn(OwnedPart<'_, D>) -> R + Sync,
        mut each: impl FnMut(R),
    ) {
        let owned = grains.owned;
        let mut rest = OwnedPart {
            record: &mut grains.record[..owned],
            force: &mut grains.force[..owned],
            half_kick: &grains.half_kick,
            image: &mut grains.image,
        };
        let Some(workers) = &self.workers else {
            return each(work(rest));
        };
        let threads = self.threads();
        let mut results: Vec<R> = (0..threads).map(|_| R::default()).collect();
        workers.region(|scope| {
            let work = &work;
            let (first, others) = results.split_at_mut(1);
            // From the last part to the first, which this thread computes.
            for (k, result) in others.iter_mut().enumerate().rev() {
                let begin = owned * (k + 1) / threads;
                let (record, record_after) = rest.record.split_at_mut(begin);
                let (force, force_after) = rest.force.split_at_mut(begin);
                let (half_kick, half_kick_after) = rest.half_kick.split_at(begin);
                let (image, image_after) = rest.image.split_at_mut(begin);
                rest = OwnedPart {
                    record,
                    force,
                    half_kick,
                    image,
                };
                let part = OwnedPart {
                    record: record_after,
                    force: force_after,
                    half_kick: half_kick_after,
                    image: image_after,
                };
                scope.spawn(move |_| *result = work(part));
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

/// The partial forces of every thread, from this page on; leaves those before it.
fn split_off<'a, F>(
    partial: &mut Vec<(&'a mut [F], &'a [bool])>,
    page: usize,
) -> Vec<(&'a mut [F], &'a [bool])> {
    let split = |(force, used): (&'a mut [F], &'a [bool])| {
        let end = (page * PAGE).min(force.len());
        let (force, force_after) = force.split_at_mut(end);
        let (used, used_after) = used.split_at(page);
        ((force, used), (force_after, used_after))
    };
    let (before, after) = std::mem::take(partial).into_iter().map(split).unzip();
    *partial = before;
    after
}

/// Part of the owned grains, for the kicks and the drift; see [`Grains`].
pub struct OwnedPart<'a, D: Dimension> {
    /// Their records.
    pub record: &'a mut [D::Record],
    /// Their forces and torques.
    pub force: &'a mut [D::Force],
    /// ½Δt/m and ½Δt/I.
    pub half_kick: &'a [[f64; 2]],
    /// Their images.
    pub image: &'a mut [Image],
}
