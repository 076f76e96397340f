//! The threads inside a rank. Each thread sums the forces of its own contacts, and the sums are
//! added. Sums of forces are exact, so the bits are the same with any number of threads.

use std::ops::Range;

use bytemuck::Zeroable;
use rayon::prelude::*;

use crate::dimension::Dimension;
use crate::failure::Failure;
use crate::kernel::{ContactForces, Counting, Found, PairForce, Pass, Scratch};
use crate::simd::Level;
use crate::state::{Cell, Contacts, Grains, Units};

/// Number of grains whose forces a thread clears and adds together.
const PAGE: usize = 256;

/// The threads, and the forces that all but the first of them sum.
#[derive(Debug)]
pub struct Team<D: Dimension> {
    /// `None` for a single thread.
    pool: Option<rayon::ThreadPool>,
    scratch: Box<Scratch<D>>,
    others: Vec<Other<D>>,
}

/// The forces that one of the other threads sums, over all local grains; only some pages are used.
#[derive(Debug)]
struct Other<D: Dimension> {
    force: Vec<D::Force>,
    /// Whether each page is used.
    used: Vec<bool>,
    scratch: Box<Scratch<D>>,
}

/// What all parts of a pass have in common; see [`Pass`].
#[derive(Clone, Copy)]
pub struct Setting<'a, D: Dimension> {
    /// The instruction set.
    pub level: Level,
    /// The contact law.
    pub law: &'a dyn PairForce<D>,
    /// The units to which forces and torques are rounded.
    pub units: Units,
    /// The cell.
    pub cell: Cell,
    /// Δt (s), or 0.
    pub step: f64,
    /// Makes the pass count the dissipation.
    pub counting: Option<Counting>,
}

impl<D: Dimension> Team<D> {
    /// A pool of `threads` threads, with the calling one.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn new(threads: usize) -> Result<Self, Failure> {
        if threads <= 1 {
            return Ok(Self {
                pool: None,
                scratch: Box::default(),
                others: Vec::new(),
            });
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Failure::Other(format!("{threads} threads: {e}")))?;
        Ok(Self {
            pool: Some(pool),
            scratch: Box::default(),
            others: (1..threads)
                .map(|_| Other {
                    force: Vec::new(),
                    used: Vec::new(),
                    scratch: Box::default(),
                })
                .collect(),
        })
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        1 + self.others.len()
    }

    /// Finds the pages that each thread's contacts use. Must be called for every new list.
    pub fn assign(&mut self, contacts: &Contacts, local: usize) {
        let threads = self.threads();
        let all = contacts.blocks();
        for (k, other) in self.others.iter_mut().enumerate() {
            other.used.clear();
            other.used.resize(local.div_ceil(PAGE), false);
            for group in [0..contacts.inner, contacts.inner..all] {
                let begin = |part: usize| group.start + group.len() * part / threads;
                for pairs in &contacts.pairs.blocks()[begin(k + 1)..begin(k + 2)] {
                    for &g in pairs.i.iter().chain(&pairs.j) {
                        other.used[g as usize / PAGE] = true;
                    }
                }
            }
            other.force.clear();
            other.force.resize(local, D::Force::zeroed());
        }
    }

    /// Computes the contact forces of a group of blocks. The first thread adds them to `force`, the
    /// others to their own sums.
    pub fn contact_forces(
        &mut self,
        setting: Setting<'_, D>,
        record: &[D::Record],
        force: &mut [D::Force],
        contacts: &mut Contacts,
        group: Range<usize>,
        samples: Option<&mut ContactForces>,
    ) -> Found {
        let pass = |part, force, samples, scratch: &mut Scratch<D>| {
            setting.law.pass(
                setting.level,
                Pass {
                    record,
                    force,
                    part,
                    units: setting.units,
                    cell: setting.cell,
                    step: setting.step,
                    samples,
                    counting: setting.counting,
                },
                scratch,
            )
        };
        let mut samples = samples.map(|s| s.part(group.clone()));
        let mut part = contacts.part(group.clone());
        let Some(pool) = &self.pool else {
            return pass(part, force, samples, &mut self.scratch);
        };
        let threads = 1 + self.others.len();
        let mut found = vec![Found::default(); threads];
        pool.in_place_scope(|scope| {
            let pass = &pass;
            let (here, elsewhere) = found.split_at_mut(1);
            // From the last part to the first, which this thread computes.
            for (k, (other, found)) in self.others.iter_mut().zip(elsewhere).enumerate().rev() {
                let begin = group.start + group.len() * (k + 1) / threads;
                let own = begin - part.first;
                let (before, after) = part.split(begin);
                let (samples_before, samples_after) = samples.map(|s| s.split(own)).unzip();
                (part, samples) = (before, samples_before);
                scope.spawn(move |_| {
                    *found = pass(after, &mut other.force, samples_after, &mut other.scratch);
                });
            }
            here[0] = pass(part, force, samples, &mut self.scratch);
        });
        found.into_iter().fold(Found::default(), Found::and)
    }

    /// Clears these forces and the sums of the other threads.
    pub fn clear(&mut self, force: &mut [D::Force]) {
        let zero = D::Force::zeroed();
        let Some(pool) = &self.pool else {
            return force.fill(zero);
        };
        pool.in_place_scope(|scope| {
            for other in &mut self.others {
                scope.spawn(move |_| {
                    let pages = other.force.chunks_mut(PAGE).zip(&other.used);
                    for (page, _) in pages.filter(|(_, used)| **used) {
                        page.fill(zero);
                    }
                });
            }
            force.fill(zero);
        });
    }

    /// Adds the sums of the other threads to the forces on the grains.
    pub fn gather(&self, force: &mut [D::Force]) {
        let Some(pool) = &self.pool else {
            return;
        };
        let add = |(page, sums): (usize, &mut [D::Force])| {
            for other in self.others.iter().filter(|other| other.used[page]) {
                for (sum, more) in sums.iter_mut().zip(&other.force[page * PAGE..]) {
                    for (sum, more) in sum.iter_mut().zip(&more[..]) {
                        *sum += more;
                    }
                }
            }
        };
        pool.install(|| force.par_chunks_mut(PAGE).enumerate().for_each(add));
    }

    /// Runs `work` on the owned grains, in parts of about the same size, and calls `each` with
    /// every result.
    pub fn over_own<R: Send + Default>(
        &self,
        grains: &mut Grains<D>,
        work: impl Fn(Own<'_, D>) -> R + Sync,
        mut each: impl FnMut(R),
    ) {
        let own = grains.owned;
        let mut rest = Own {
            record: &mut grains.record[..own],
            force: &mut grains.force[..own],
            half_kick: &grains.half_kick,
        };
        let Some(pool) = &self.pool else {
            return each(work(rest));
        };
        let threads = self.threads();
        let mut found: Vec<R> = (0..threads).map(|_| R::default()).collect();
        pool.in_place_scope(|scope| {
            let work = &work;
            for (k, found) in found.iter_mut().enumerate() {
                let size = own * (k + 1) / threads - own * k / threads;
                let (record, record_after) = rest.record.split_at_mut(size);
                let (force, force_after) = rest.force.split_at_mut(size);
                let (half_kick, half_kick_after) = rest.half_kick.split_at(size);
                rest = Own {
                    record: record_after,
                    force: force_after,
                    half_kick: half_kick_after,
                };
                let part = Own {
                    record,
                    force,
                    half_kick,
                };
                scope.spawn(move |_| *found = work(part));
            }
        });
        found.into_iter().for_each(each);
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        self.others
            .iter()
            .map(|o| o.force.capacity() * size_of::<D::Force>())
            .sum()
    }
}

/// Some owned grains, for the kicks and the drift; see [`Grains`].
pub struct Own<'a, D: Dimension> {
    /// Their records.
    pub record: &'a mut [D::Record],
    /// Their forces and torques.
    pub force: &'a mut [D::Force],
    /// ½Δt/m and ½Δt/I.
    pub half_kick: &'a [[f64; 2]],
}
