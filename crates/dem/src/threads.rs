//! The threads inside a rank. As sums of forces are exact, each thread adds up the forces of its own contacts, and the sums are
//! added: same bits with any number of threads.

use std::ops::Range;

use bytemuck::Zeroable;
use rayon::prelude::*;

use crate::dimension::Dimension;
use crate::failure::Failure;
use crate::kernel::{ContactForces, Counting, Found, PairForce, Pass, Scratch};
use crate::simd::Level;
use crate::state::{Cell, Contacts, Grains, Units};

/// Grains whose forces a thread clears and hands over together.
const PAGE: usize = 256;

/// The threads, and the forces that all but the first of them add up.
#[derive(Debug)]
pub struct Team<D: Dimension> {
    /// `None`: this thread alone.
    pool: Option<rayon::ThreadPool>,
    scratch: Box<Scratch<D>>,
    others: Vec<Other<D>>,
}

/// Forces that one of the other threads adds up, over all local grains, used in some pages only.
#[derive(Debug)]
struct Other<D: Dimension> {
    force: Vec<D::Force>,
    /// Of every page, whether it is used.
    used: Vec<bool>,
    scratch: Box<Scratch<D>>,
}

/// What all parts of a pass have in common.
#[derive(Clone, Copy)]
pub struct Setting<'a, D: Dimension> {
    pub level: Level,
    pub law: &'a dyn PairForce<D>,
    pub units: Units,
    pub cell: Cell,
    pub step: f64,
    pub counting: Option<Counting>,
}

impl<D: Dimension> Team<D> {
    /// # Errors
    /// The system has no room for so many threads.
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

    pub fn threads(&self) -> usize {
        1 + self.others.len()
    }

    /// Finds the pages that each thread's contacts touch. To be called for every new list.
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

    /// Contact forces of a group of blocks, which the first thread adds to `force` and the others to their own.
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
            // From the last part to the first, which remains for this thread.
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

    /// Clears these forces, and all that the other threads add up.
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

    /// Adds the other threads' forces to the grains'.
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

    /// Work on the own grains, in parts of about the same size; what comes out, one by one.
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

/// Some own grains, for the kicks and the drift.
pub struct Own<'a, D: Dimension> {
    pub record: &'a mut [D::Record],
    pub force: &'a mut [D::Force],
    pub half_kick: &'a [[f64; 2]],
}
