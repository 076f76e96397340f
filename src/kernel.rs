//! The loop over the contacts, for any law, sixteen pairs at a time.
//!
//! What contract 1 rests on: every pair is evaluated in one orientation from the wrapped coordinates of its two grains,
//! and forces are rounded to a common unit ([`ForceUnit`]), whose multiples add up exactly in any order.

use std::ops::Range;

use crate::contact::{CARRY, ContactLaw, Motion, Response, loss};
use crate::simd::{LANES, Lanes, Level, Mask, Record, Row, Work, inverse_sqrt};
use crate::state::{Force, ForceUnit, Part, field};

/// What only frames and time series want of the contacts; rows per block as in [`Contacts`].
#[derive(Debug, Default)]
pub struct ContactForces {
    pub normal: Vec<Row>,
    pub tangential: Vec<Row>,
    pub overlap: Vec<Row>,
    /// Lanes at the Coulomb limit.
    pub sliding: Vec<u16>,
}

impl ContactForces {
    /// Room for so many blocks.
    pub fn prepare(&mut self, blocks: usize) {
        for rows in [&mut self.normal, &mut self.tangential, &mut self.overlap] {
            rows.clear();
            rows.resize(blocks, Row::ZERO);
        }
        self.sliding.clear();
        self.sliding.resize(blocks, 0);
    }

    /// Of some blocks.
    pub fn part(&mut self, blocks: Range<usize>) -> Samples<'_> {
        Samples {
            normal: &mut self.normal[blocks.clone()],
            tangential: &mut self.tangential[blocks.clone()],
            overlap: &mut self.overlap[blocks.clone()],
            sliding: &mut self.sliding[blocks],
        }
    }
}

/// [`ContactForces`] of some blocks.
pub struct Samples<'a> {
    normal: &'a mut [Row],
    tangential: &'a mut [Row],
    overlap: &'a mut [Row],
    sliding: &'a mut [u16],
}

impl<'a> Samples<'a> {
    /// The first blocks, and the rest.
    pub fn split(self, blocks: usize) -> (Samples<'a>, Samples<'a>) {
        let (normal, normal_after) = self.normal.split_at_mut(blocks);
        let (tangential, tangential_after) = self.tangential.split_at_mut(blocks);
        let (overlap, overlap_after) = self.overlap.split_at_mut(blocks);
        let (sliding, sliding_after) = self.sliding.split_at_mut(blocks);
        (
            Samples {
                normal,
                tangential,
                overlap,
                sliding,
            },
            Samples {
                normal: normal_after,
                tangential: tangential_after,
                overlap: overlap_after,
                sliding: sliding_after,
            },
        )
    }
}

/// Forces of one pass over some contacts.
pub struct Pass<'a> {
    pub record: &'a [Record],
    /// Added to.
    pub force: &'a mut [Force],
    pub part: Part<'a>,
    pub unit: ForceUnit,
    /// L_x (m).
    pub length: f64,
    /// Δt (s); 0 evaluates the forces without advancing the histories.
    pub step: f64,
    /// Filled where given.
    pub samples: Option<Samples<'a>>,
    /// Where given, a ledger of energy is kept in whole multiples of this (J/m).
    pub energy_unit: Option<f64>,
}

/// What a pass finds.
#[derive(Debug, Clone, Copy, Default)]
pub struct Found {
    /// A pair (block, lane) whose overlap is outside the law.
    pub outside: Option<(usize, usize)>,
    /// A pair whose force is too great to be rounded to the unit.
    pub too_strong: Option<(usize, usize)>,
    /// Energies that the contacts lost of which this rank owns i, in `Pass::energy_unit`s.
    pub lost: [i128; loss::KINDS],
}

impl Found {
    pub fn and(mut self, other: Self) -> Self {
        self.outside = self.outside.or(other.outside);
        self.too_strong = self.too_strong.or(other.too_strong);
        for (sum, more) in self.lost.iter_mut().zip(other.lost) {
            *sum += more;
        }
        self
    }
}

/// Adds the contact forces to the grains.
pub fn contact_forces<C: ContactLaw>(level: Level, law: &C, pass: Pass<'_>) -> Found {
    let first = pass.part.first;
    let mut found = match pass.energy_unit {
        Some(_) => level.run(Blocks::<C, true> { law, pass }),
        None => level.run(Blocks::<C, false> { law, pass }),
    };
    for (block, _) in [&mut found.outside, &mut found.too_strong]
        .into_iter()
        .flatten()
    {
        *block += first;
    }
    found
}

/// One pass; blocks are counted from the first of the part.
struct Blocks<'a, C, const LEDGER: bool> {
    law: &'a C,
    pass: Pass<'a>,
}

/// Blocks that go through the phases of a pass together: enough for the processor to overlap them, few enough for its
/// first-level cache.
const CHUNK: usize = 8;

/// What one phase leaves to the next, per block.
struct Scratch {
    /// Differences of the records, and of the second grain the last two fields.
    difference: [[Row; 8]; CHUNK],
    last_of_j: [[Row; 2]; CHUNK],
    motion: [Motion; CHUNK],
    /// n.
    direction: [[Row; 2]; CHUNK],
    carry: [[Row; CARRY]; CHUNK],
    response: [Response; CHUNK],
    /// Block, lane and factor of the damping of pairs that have just come to touch, where a ledger is kept.
    touched: Vec<(usize, usize, f64)>,
}

impl Scratch {
    const ZERO: Self = Self {
        difference: [[Row::ZERO; 8]; CHUNK],
        last_of_j: [[Row::ZERO; 2]; CHUNK],
        motion: [Motion::ZERO; CHUNK],
        direction: [[Row::ZERO; 2]; CHUNK],
        carry: [[Row::ZERO; CARRY]; CHUNK],
        response: [Response::NONE; CHUNK],
        touched: Vec::new(),
    };
}

impl<C: ContactLaw, const LEDGER: bool> Work for Blocks<'_, C, LEDGER> {
    type Output = Found;

    /// Phases of short chains of operations each, so that the processor has several blocks under way.
    #[inline(always)]
    fn run<L: Lanes>(mut self, token: L::Token) -> Self::Output {
        let mut scratch = Scratch::ZERO;
        let mut found = Found::default();
        let blocks = self.pass.part.blocks();
        for first in (0..blocks).step_by(CHUNK) {
            let chunk = first..blocks.min(first + CHUNK);
            self.differ::<L>(token, chunk.clone(), &mut scratch);
            self.move_pairs::<L>(token, chunk.clone(), &mut scratch);
            found.outside =
                found
                    .outside
                    .or(self.evaluate::<L>(token, chunk.clone(), &mut scratch));
            if LEDGER {
                self.account::<L>(token, chunk.clone(), &mut scratch, &mut found);
            }
            found.too_strong = found.too_strong.or(self.add::<L>(token, chunk, &scratch));
        }
        found
    }
}

impl<C: ContactLaw, const LEDGER: bool> Blocks<'_, C, LEDGER> {
    /// How the grains of the pairs differ.
    #[inline(always)]
    fn differ<L: Lanes>(&mut self, token: L::Token, chunk: Range<usize>, scratch: &mut Scratch) {
        let (record, part) = (self.pass.record, &self.pass.part);
        for ((block, difference), last_of_j) in chunk
            .zip(&mut scratch.difference)
            .zip(&mut scratch.last_of_j)
        {
            let d = L::differences(token, record, part.pairs, part.first + block);
            for (d, row) in d.into_iter().zip(difference) {
                d.store(row);
            }
            if C::FRICTION {
                let [half_w, w] = L::last_fields(token, record, part.pairs, part.first + block);
                half_w.store(&mut last_of_j[0]);
                w.store(&mut last_of_j[1]);
            }
        }
    }

    /// How the pairs move.
    #[inline(always)]
    fn move_pairs<L: Lanes>(
        &mut self,
        token: L::Token,
        chunk: Range<usize>,
        scratch: &mut Scratch,
    ) {
        let c = |v| L::splat(token, v);
        let load = |row: &Row| L::load(token, row);
        let (length, per_length) = (c(self.pass.length), c(1.0 / self.pass.length));
        let step = c(self.pass.step);
        let contacts = &mut self.pass.part;
        if LEDGER {
            scratch.touched.clear();
        }
        let blocks = contacts.geometry[chunk.clone()]
            .iter()
            .zip(&mut contacts.touching[chunk])
            .zip(scratch.difference.iter().zip(&scratch.last_of_j))
            .zip(scratch.motion.iter_mut().zip(&mut scratch.direction))
            .enumerate();
        for (k, ((([sum, r_i], touching), (difference, last_of_j)), (motion, direction))) in blocks
        {
            let d = |k: usize| load(&difference[k]);
            let (dx, dy) = (d(field::X), d(field::Y));
            let dx = (-(dx * per_length).round()).mul_add(length, dx);
            let square = dx.mul_add(dx, dy * dy);
            let per_distance = inverse_sqrt(token, square);
            // Within 0.501 ulp, as the overlap is the small difference of two lengths.
            let near = square * per_distance;
            let distance = (c(0.5) * per_distance).mul_add((-near).mul_add(near, square), near);
            let (n_x, n_y) = (dx * per_distance, dy * per_distance);
            let sum = load(sum);
            let overlap = sum - distance;
            overlap.store(&mut motion.overlap);
            n_x.store(&mut direction[0]);
            n_y.store(&mut direction[1]);
            let (u, v) = (d(field::U), d(field::V));
            u.mul_add(n_x, v * n_y).store(&mut motion.normal_velocity);
            let (half_u, half_v) = (d(field::HALF_U), d(field::HALF_V));
            let half_normal = half_u.mul_add(n_x, half_v * n_y);
            if C::FRICTION {
                // v_t = (v_i - v_j)·t̂ - (R_i ω_i + R_j ω_j), and R_i ω_i + R_j ω_j = R_i (ω_i - ω_j) + (R_i + R_j) ω_j
                let r_i = load(r_i);
                let across = |u: L, v: L| v.mul_add(n_x, -(u * n_y));
                let turning = |w: L, w_j: L| r_i.mul_add(w, sum * w_j);
                let (half_w_j, w_j) = (load(&last_of_j[0]), load(&last_of_j[1]));
                (across(u, v) - turning(d(field::W), w_j)).store(&mut motion.tangential_velocity);
                // The half-step velocity belongs to t̂ of the half step, when r was r - ½Δt v. As v × v = 0, only the length
                // of r differs: (v·t̂)(t+½Δt) = (v·t̂) |r|/|r - ½Δt v|. Left out, F_t^e would be of first order where n turns.
                let longer = (c(0.5) * step * per_distance).mul_add(half_normal, c(1.0));
                (across(half_u, half_v).mul_add(longer, -turning(d(field::HALF_W), half_w_j))
                    * step)
                    .store(&mut motion.tangential_increment);
            }
            if C::ROLLING {
                motion.rolling_velocity = difference[field::W];
                (d(field::HALF_W) * step).store(&mut motion.rolling_increment);
            }
            *touching = overlap.greater(c(0.0)).bits();
            // A pair that touched a step ago overlaps by more than it has come nearer since.
            let nearer = -half_normal * step;
            let new = nearer.greater(overlap).bits() & *touching;
            if new != 0 {
                let nearer = nearer.to_row();
                for lane in (0..LANES).filter(|lane| new >> lane & 1 == 1) {
                    let factor = first_touch(motion, lane, nearer.0[lane]);
                    if LEDGER {
                        scratch.touched.push((k, lane, factor));
                    }
                }
            }
        }
    }

    /// The law. Returns a pair whose overlap is outside it, if there is one.
    #[inline(always)]
    fn evaluate<L: Lanes>(
        &mut self,
        token: L::Token,
        chunk: Range<usize>,
        scratch: &mut Scratch,
    ) -> Option<(usize, usize)> {
        let contacts = &mut self.pass.part;
        let rows = |per_block: usize| chunk.start * per_block..chunk.end * per_block;
        self.law.evaluate::<L, LEDGER>(
            token,
            &mut crate::contact::Blocks {
                parameters: &contacts.parameters[rows(C::PARAMETERS)],
                history: &mut contacts.history[rows(C::HISTORY)],
                motion: &scratch.motion[..chunk.len()],
                carry: &mut scratch.carry[..chunk.len()],
                response: &mut scratch.response[..chunk.len()],
                step: self.pass.step,
            },
        );
        let mut outside = None;
        let touching = &contacts.touching[chunk.clone()];
        for ((block, touching), response) in chunk.zip(touching).zip(&scratch.response) {
            let beyond = response.beyond & touching;
            if beyond != 0 && outside.is_none() {
                outside = Some((block, beyond.trailing_zeros() as usize));
            }
        }
        outside
    }

    /// What the contacts lost.
    #[inline(always)]
    fn account<L: Lanes>(
        &mut self,
        token: L::Token,
        chunk: Range<usize>,
        scratch: &mut Scratch,
        found: &mut Found,
    ) {
        for &(k, lane, factor) in &scratch.touched {
            // Both the damping force and the velocity were scaled, and only the force is to be.
            scratch.response[k].lost[loss::DAMPING].0[lane] /= factor;
        }
        let load = |row: &Row| L::load(token, row);
        let c = |v| L::splat(token, v);
        let part = &self.pass.part;
        let per_unit = c(1.0 / self.pass.energy_unit.unwrap_or(f64::INFINITY));
        let mine = chunk.end.min(part.mine.saturating_sub(part.first));
        let blocks = chunk.start..mine.max(chunk.start);
        for kind in 0..loss::KINDS {
            let mut sums = L::no_counts(token);
            for response in &scratch.response[..blocks.len()] {
                sums = (load(&response.lost[kind]) * per_unit).count(sums);
            }
            found.lost[kind] += L::total(sums);
        }
    }

    /// What it all comes to for the grains: pairs that do not touch add zeros. Returns a pair whose force is too great to be
    /// rounded to the unit, if there is one.
    #[inline(always)]
    fn add<L: Lanes>(
        &mut self,
        token: L::Token,
        chunk: Range<usize>,
        scratch: &Scratch,
    ) -> Option<(usize, usize)> {
        let load = |row: &Row| L::load(token, row);
        let c = |v| L::splat(token, v);
        let zero = c(0.0);
        let unit = self.pass.unit;
        // Adding 3·2^51 units leaves no bit below the unit; subtracting them is exact.
        let [force_shift, torque_shift] =
            [unit.force, unit.torque].map(|u| c(u * (3u64 << 51) as f64));
        let largest = c(unit.largest());
        let mut outside = None;
        let force = &mut *self.pass.force;
        let contacts = &self.pass.part;
        for (k, block) in chunk.enumerate() {
            let (motion, response) = (&scratch.motion[k], &scratch.response[k]);
            let touching = load(&motion.overlap).greater(zero);
            let [n_x, n_y] = &scratch.direction[k];
            let (n_x, n_y) = (
                load(n_x).select(touching, zero),
                load(n_y).select(touching, zero),
            );
            let normal = load(&response.normal).select(touching, zero);
            if let Some(samples) = &mut self.pass.samples {
                samples.normal[block] = response.normal;
                samples.overlap[block] = motion.overlap;
                samples.tangential[block] = response.tangential;
                samples.sliding[block] = response.sliding & contacts.touching[block];
            }
            let mut terms = [normal * n_x, normal * n_y, zero, zero];
            if C::FRICTION {
                let tangential = load(&response.tangential).select(touching, zero);
                let [sum, r_i] = &contacts.geometry[block];
                let (sum, r_i) = (load(sum), load(r_i));
                terms = [
                    normal.mul_add(n_x, -(tangential * n_y)),
                    normal.mul_add(n_y, tangential * n_x),
                    -r_i * tangential,
                    (r_i - sum) * tangential,
                ];
            }
            if C::ROLLING {
                let rolling = load(&response.rolling).select(touching, zero);
                terms[2] = terms[2] + rolling;
                terms[3] = terms[3] - rolling;
            }
            let greater = terms[0].abs().max(terms[1].abs()).greater(largest).bits();
            if greater != 0 && outside.is_none() {
                outside = Some((block, greater.trailing_zeros() as usize));
            }
            let rounded = [
                (terms[0] + force_shift) - force_shift,
                (terms[1] + force_shift) - force_shift,
                (terms[2] + torque_shift) - torque_shift,
                (terms[3] + torque_shift) - torque_shift,
            ];
            L::add_to_pairs(rounded, force, contacts.pairs, contacts.first + block);
        }
        outside
    }
}

/// The step in which a pair comes to touch: it touches for a part θ = δ/(-v_n Δt) of the step only, so that is the part of the
/// increments that counts; and as the kicks of this force stand for the time from t-½Δt to t+½Δt, of which the pair touches
/// ½+θ, the damping that sets in with a jump is scaled by it. Left out, an impact would be of first order in Δt.
///
/// Changes one lane of the motion; returns the factor of the damping. `nearer` is -v_n Δt (m).
#[cold]
fn first_touch(motion: &mut Motion, lane: usize, nearer: f64) -> f64 {
    let part = motion.overlap.0[lane] / nearer;
    motion.tangential_increment.0[lane] *= part;
    motion.rolling_increment.0[lane] *= part;
    let factor = 0.5 + part;
    motion.normal_velocity.0[lane] *= factor;
    motion.tangential_velocity.0[lane] *= factor;
    motion.rolling_velocity.0[lane] *= factor;
    factor
}
