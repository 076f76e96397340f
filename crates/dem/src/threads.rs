//! The thread pool of a rank. Every thread sums the forces of its part of the contacts, and then
//! the pool adds these sums. They are exact, so the number of threads does not change a bit.

use std::ops::Range;

use bytemuck::Zeroable;
use rayon::prelude::*;

use crate::dimension::Dimension;
use crate::failure::Failure;
use crate::kernel::{ContactForces, Counting, PairForce, Pass, PassOutcome, Scratch};
use crate::simd::Isa;
use crate::state::{Cell, Contacts, Grains, Image, Units};

/// Number of grains whose forces a thread clears and adds together.
const PAGE: usize = 256;

/// The threads of a rank, and the partial forces of all but the first.
#[derive(Debug)]
pub struct ThreadPool<D: Dimension> {
    /// `None` for a single thread.
    workers: Option<rayon::ThreadPool>,
    scratch: Box<Scratch<D>>,
    partial: Vec<PartialForces<D>>,
}

/// The forces on all local grains by the contacts of one thread; only some pages are used.
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
            });
        }
        let workers = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Failure::Other(format!("{threads} threads: {e}")))?;
        Ok(Self {
            workers: Some(workers),
            scratch: Box::default(),
            partial: (1..threads)
                .map(|_| PartialForces {
                    force: Vec::new(),
                    used: Vec::new(),
                    scratch: Box::default(),
                })
                .collect(),
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
        let mut samples = samples.map(|s| s.part(group.clone()));
        let mut part = contacts.part(group.clone());
        let Some(workers) = &self.workers else {
            return pass(part, force, samples, &mut self.scratch);
        };
        let threads = 1 + self.partial.len();
        let mut outcomes = vec![PassOutcome::default(); threads];
        workers.in_place_scope(|scope| {
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

    /// Clears `force` and the partial forces.
    pub fn clear(&mut self, force: &mut [D::Force]) {
        let zero = D::Force::zeroed();
        let Some(workers) = &self.workers else {
            return force.fill(zero);
        };
        workers.in_place_scope(|scope| {
            for partial in &mut self.partial {
                scope.spawn(move |_| {
                    let pages = partial.force.chunks_mut(PAGE).zip(&partial.used);
                    for (page, _) in pages.filter(|(_, used)| **used) {
                        page.fill(zero);
                    }
                });
            }
            force.fill(zero);
        });
    }

    /// Adds the partial forces to the forces on the grains.
    pub fn gather(&self, force: &mut [D::Force]) {
        let Some(workers) = &self.workers else {
            return;
        };
        let add = |(page, sums): (usize, &mut [D::Force])| {
            for partial in self.partial.iter().filter(|partial| partial.used[page]) {
                for (sum, more) in sums.iter_mut().zip(&partial.force[page * PAGE..]) {
                    for (sum, more) in sum.iter_mut().zip(&more[..]) {
                        *sum += more;
                    }
                }
            }
        };
        workers.install(|| force.par_chunks_mut(PAGE).enumerate().for_each(add));
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
        workers.in_place_scope(|scope| {
            let work = &work;
            for (k, result) in results.iter_mut().enumerate() {
                let size = owned * (k + 1) / threads - owned * k / threads;
                let (record, record_after) = rest.record.split_at_mut(size);
                let (force, force_after) = rest.force.split_at_mut(size);
                let (half_kick, half_kick_after) = rest.half_kick.split_at(size);
                let (image, image_after) = rest.image.split_at_mut(size);
                rest = OwnedPart {
                    record: record_after,
                    force: force_after,
                    half_kick: half_kick_after,
                    image: image_after,
                };
                let part = OwnedPart {
                    record,
                    force,
                    half_kick,
                    image,
                };
                scope.spawn(move |_| *result = work(part));
            }
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
