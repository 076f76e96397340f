//! The threads inside a rank. As sums of forces are exact, each thread adds up the forces of its own contacts, and the sums are
//! added: same bits with any number of threads.

use std::ops::Range;

use crate::contact::ContactLaw;
use crate::failure::Failure;
use crate::kernel::{ContactForces, Found, Pass, contact_forces};
use crate::simd::{Level, Quad, Record};
use crate::state::{Contacts, Force, ForceUnit, Grains};

/// Grains whose forces a thread clears and hands over together.
const PAGE: usize = 256;

/// The threads, and the forces that all but the first of them add up.
#[derive(Debug, Default)]
pub struct Team {
    /// `None`: this thread alone.
    pool: Option<rayon::ThreadPool>,
    others: Vec<Other>,
}

/// Forces that one of the other threads adds up, over all local grains, used in some pages only.
#[derive(Debug, Default)]
struct Other {
    force: Vec<Force>,
    pages: Vec<u32>,
}

/// What all parts of a pass have in common.
#[derive(Clone, Copy)]
pub struct Setting<'a, C> {
    pub level: Level,
    pub law: &'a C,
    pub unit: ForceUnit,
    pub length: f64,
    pub step: f64,
    pub energy_unit: Option<f64>,
}

impl Team {
    /// # Errors
    /// The system has no room for so many threads.
    pub fn new(threads: usize) -> Result<Self, Failure> {
        if threads <= 1 {
            return Ok(Self::default());
        }
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| Failure::Other(format!("{threads} threads: {e}")))?;
        Ok(Self {
            pool: Some(pool),
            others: (1..threads).map(|_| Other::default()).collect(),
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
            let mut touched = vec![false; local.div_ceil(PAGE)];
            for group in [0..contacts.inner, contacts.inner..all] {
                let begin = |part: usize| group.start + group.len() * part / threads;
                for pairs in &contacts.pairs.blocks()[begin(k + 1)..begin(k + 2)] {
                    for &g in pairs.i.iter().chain(&pairs.j) {
                        touched[g as usize / PAGE] = true;
                    }
                }
            }
            other.pages.clear();
            other
                .pages
                .extend((0..touched.len() as u32).filter(|&page| touched[page as usize]));
            other.force.clear();
            other.force.resize(local, Quad::ZERO);
        }
    }

    /// Contact forces of a group of blocks, which the first thread adds to `force` and the others to their own.
    pub fn contact_forces<C: ContactLaw>(
        &mut self,
        setting: Setting<'_, C>,
        record: &[Record],
        force: &mut [Force],
        contacts: &mut Contacts,
        group: Range<usize>,
        samples: Option<&mut ContactForces>,
    ) -> Found {
        let pass = |part, force, samples| {
            contact_forces(
                setting.level,
                setting.law,
                Pass {
                    record,
                    force,
                    part,
                    unit: setting.unit,
                    length: setting.length,
                    step: setting.step,
                    samples,
                    energy_unit: setting.energy_unit,
                },
            )
        };
        let mut samples = samples.map(|s| s.part(group.clone()));
        let mut part = contacts.part::<C>(group.clone());
        let Some(pool) = &self.pool else {
            return pass(part, force, samples);
        };
        let threads = self.threads();
        let mut found = vec![Found::default(); threads];
        pool.in_place_scope(|scope| {
            let pass = &pass;
            let (here, elsewhere) = found.split_at_mut(1);
            // From the last part to the first, which remains for this thread.
            for (k, (other, found)) in self.others.iter_mut().zip(elsewhere).enumerate().rev() {
                let begin = group.start + group.len() * (k + 1) / threads;
                let own = begin - part.first;
                let (before, after) = part.split::<C>(begin);
                let (samples_before, samples_after) = samples.map(|s| s.split(own)).unzip();
                (part, samples) = (before, samples_before);
                let force = &mut other.force;
                scope.spawn(move |_| *found = pass(after, force, samples_after));
            }
            here[0] = pass(part, force, samples);
        });
        found.into_iter().fold(Found::default(), Found::and)
    }

    /// Clears the forces on the grains, for all threads.
    pub fn clear(&mut self, force: &mut [Force]) {
        let Some(pool) = &self.pool else {
            return force.fill(Quad::ZERO);
        };
        pool.in_place_scope(|scope| {
            for other in &mut self.others {
                scope.spawn(|_| {
                    for &page in &other.pages {
                        let range = Self::page(page, other.force.len());
                        other.force[range].fill(Quad::ZERO);
                    }
                });
            }
            force.fill(Quad::ZERO);
        });
    }

    /// Adds the other threads' forces to the grains'.
    pub fn gather(&mut self, force: &mut [Force]) {
        for other in &self.others {
            for &page in &other.pages {
                let range = Self::page(page, force.len());
                for (sum, more) in force[range.clone()].iter_mut().zip(&other.force[range]) {
                    for k in 0..3 {
                        sum[k] += more[k];
                    }
                }
            }
        }
    }

    fn page(page: u32, length: usize) -> Range<usize> {
        let begin = page as usize * PAGE;
        begin..length.min(begin + PAGE)
    }

    /// Work on the own grains, in parts of about the same size; the greatest of what comes out, NaN where one is.
    pub fn greatest(&self, grains: &mut Grains, work: impl Fn(Own<'_>) -> f64 + Sync) -> f64 {
        let own = grains.owned;
        let mut rest = Own {
            record: &mut grains.record[..own],
            force: &grains.force[..own],
            half_kick: &grains.half_kick,
        };
        let Some(pool) = &self.pool else {
            return work(rest);
        };
        let threads = self.threads();
        let mut found = vec![0.0; threads];
        pool.in_place_scope(|scope| {
            let work = &work;
            for (k, found) in found.iter_mut().enumerate() {
                let size = own * (k + 1) / threads - own * k / threads;
                let (record, record_after) = rest.record.split_at_mut(size);
                let (force, force_after) = rest.force.split_at(size);
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
        found
            .into_iter()
            .fold(0.0, |a: f64, b| if b > a || b.is_nan() { b } else { a })
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        self.others
            .iter()
            .map(|o| o.force.capacity() * size_of::<Force>())
            .sum()
    }
}

/// Some own grains, for the kicks and the drift.
pub struct Own<'a> {
    pub record: &'a mut [Record],
    pub force: &'a [Force],
    pub half_kick: &'a [[f64; 2]],
}
