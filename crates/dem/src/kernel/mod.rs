//! The loop over the contacts, for any law, sixteen pairs at a time.
//!
//! [Contract 1](crate#contracts) rests on two properties: every pair is evaluated in one
//! orientation from the wrapped coordinates of its two grains, and forces are rounded to common
//! [`Units`], whose multiples add up exactly in any order.

#![expect(
    clippy::needless_range_loop,
    reason = "iterators would have to be inlined with all their closures, or they lose the instruction set"
)]

mod adhesion;
mod motion;

use std::ops::Range;

use self::motion::relative_motion;
use crate::contact::adhesion::AdhesionModel;
use crate::contact::model::PairModel;
use crate::contact::stiffness::Stiffness;
use crate::contact::{
    CARRY, CHUNK, ContactLaw, Jump, PairMotion, PairRadii, Response, Turning, dissipation, vector,
};
use crate::dimension::{Dimension, PairForces, Vector};
use crate::failure::Outside;
use crate::simd::{
    Isa, LANES, Lanes, Lanes16, Mask, Portable, PortableToken, Work, prefetch, prefetch_all,
};
use crate::state::{BlockRange, Cell, Units, length};
use crate::workers::tail_mut;

/// Contact forces for frames and time series, by block as in [`crate::state::Contacts`].
#[derive(Debug, Default)]
pub struct ContactForces {
    /// F_n.
    pub normal: Vec<Lanes16>,
    /// F_t; only [`Dimension::SPINS`] components are set.
    pub tangential: Vec<[Lanes16; 3]>,
    /// δ (m).
    pub overlap: Vec<Lanes16>,
}

impl ContactForces {
    /// Makes room for this number of blocks.
    pub fn prepare(&mut self, blocks: usize) {
        for lanes in [&mut self.normal, &mut self.overlap] {
            lanes.clear();
            lanes.resize(blocks, Lanes16::ZERO);
        }
        self.tangential.clear();
        self.tangential.resize(blocks, [Lanes16::ZERO; 3]);
    }

    /// The force of a pair on its grain i, whose separation from j is r (m).
    pub fn vector<D: Dimension>(&self, block: usize, lane: usize, r: &[f64; 3]) -> [f64; 3] {
        let tangential = self.tangential[block].map(|lanes| lanes.0[lane]);
        let per_length = 1.0 / length(*r);
        let normal = self.normal[block].0[lane] * per_length;
        match D::AXES {
            // Along t̂ = ẑ × n.
            2 => {
                let along = tangential[0] * per_length;
                [
                    normal * r[0] - along * r[1],
                    normal * r[1] + along * r[0],
                    0.0,
                ]
            }
            _ => std::array::from_fn(|axis| normal * r[axis] + tangential[axis]),
        }
    }

    /// Borrows the room for all blocks.
    pub fn all(&mut self) -> Samples<'_> {
        Samples {
            normal: &mut self.normal,
            tangential: &mut self.tangential,
            overlap: &mut self.overlap,
        }
    }
}

/// Room for the [`ContactForces`] of some blocks.
pub struct Samples<'a> {
    normal: &'a mut [Lanes16],
    tangential: &'a mut [[Lanes16; 3]],
    overlap: &'a mut [Lanes16],
}

impl<'a> Samples<'a> {
    /// The room for some of the blocks, numbered from the first of them, for a while.
    pub(crate) fn within(&mut self, blocks: Range<usize>) -> Samples<'_> {
        Samples {
            normal: &mut self.normal[blocks.clone()],
            tangential: &mut self.tangential[blocks.clone()],
            overlap: &mut self.overlap[blocks],
        }
    }

    /// Splits off the blocks from `at` on.
    pub(crate) fn split_off(&mut self, at: usize) -> Samples<'a> {
        Samples {
            normal: tail_mut(&mut self.normal, at),
            tangential: tail_mut(&mut self.tangential, at),
            overlap: tail_mut(&mut self.overlap, at),
        }
    }
}

/// Input and output of one pass over some contacts.
pub struct Pass<'a, D: Dimension> {
    /// What all parts of a pass share.
    pub input: PassInput,
    /// The records of all local grains.
    pub record: &'a [D::Record],
    /// The forces on all local grains, to which the pass adds.
    pub force: &'a mut [D::Force],
    /// The contacts.
    pub part: BlockRange<'a>,
    /// Receives the contact forces.
    pub samples: Option<Samples<'a>>,
    /// The adhesion beside the law, if there is one.
    adhesion: Option<&'a dyn AdhesionModel>,
}

impl<'a, D: Dimension> Pass<'a, D> {
    /// A pass over these contacts without samples.
    pub fn new(
        input: PassInput,
        record: &'a [D::Record],
        force: &'a mut [D::Force],
        part: BlockRange<'a>,
    ) -> Self {
        Self {
            input,
            record,
            force,
            part,
            samples: None,
            adhesion: None,
        }
    }

    /// The same with samples, if they are wanted.
    #[must_use]
    pub fn sampled(self, samples: Option<Samples<'a>>) -> Self {
        Self { samples, ..self }
    }

    /// The same beside an adhesion.
    #[must_use]
    pub fn beside(self, adhesion: &'a dyn AdhesionModel) -> Self {
        Self {
            adhesion: Some(adhesion),
            ..self
        }
    }

    /// The adhesion, if it decides which pairs are in contact, and how.
    #[inline(always)]
    fn holding(&self) -> Option<&'a dyn AdhesionModel> {
        let adhesion = self.adhesion?;
        if adhesion.acts_across_gaps() || adhesion.changes_area() {
            Some(adhesion)
        } else {
            None
        }
    }

    /// Whether an adhesion changes the area of contact.
    #[inline(always)]
    fn changes_area(&self) -> bool {
        self.adhesion.is_some_and(AdhesionModel::changes_area)
    }
}

/// What all parts of a pass share.
#[derive(Debug, Clone, Copy)]
pub struct PassInput {
    /// The instruction set.
    pub isa: Isa,
    /// The units to which forces and torques are rounded.
    pub units: Units,
    /// The cell.
    pub cell: Cell,
    /// Δt (s); 0 evaluates the forces without advancing the histories.
    pub step: f64,
    /// How far the grains have travelled since the list was made (m): blocks that cannot touch yet
    /// are left out. `None`: unknown, and all blocks are looked at.
    pub travelled: Option<f64>,
    /// Whether its data is probably in no cache, so that it prefetches the next chunks.
    pub is_cold: bool,
    /// Makes the pass count the dissipation for the energy budget, and the stress.
    pub counting: Option<Counting>,
}

/// How the dissipation of the contacts is counted for the energy budget, and their stress.
#[derive(Debug, Clone, Copy)]
pub struct Counting {
    /// Energies are counted in whole multiples of this (J/m); `None` without an energy budget.
    pub unit: Option<f64>,
    /// Δt (s), by which powers are multiplied, also if [`PassInput::step`] is 0.
    pub step: f64,
    /// The height of the cell (m) if the stress is counted.
    pub height: Option<f64>,
    /// The lengths of the cell across the height (m) if the normal stresses along these axes are
    /// counted as well.
    pub lateral: Option<[f64; 2]>,
}

/// Number of stresses that a pass counts.
pub const STRESSES: usize = 4;

/// The result of a pass.
#[derive(Debug, Clone, Copy, Default)]
pub struct PassOutcome {
    /// A pair (block, lane) whose overlap is outside the law.
    pub outside: Option<(usize, usize)>,
    /// A pair (block, lane) whose force is too great to be rounded to the unit.
    pub too_strong: Option<(usize, usize)>,
    /// Dissipation of the contacts whose grain i this rank owns, in [`Counting::unit`]s.
    pub dissipated: [i128; dissipation::COUNTS],
    /// Whether an energy was too great to be counted.
    pub uncounted: bool,
    /// Σ F r_z/h along the last axis and along x of these contacts, in units of the forces, if it
    /// is counted, with the height h of the cell; then Σ F_a r_a/L_a along the axes across it.
    pub stress: [i128; STRESSES],
    /// Number of blocks that were awake.
    pub blocks: u64,
}

impl PassOutcome {
    /// What was outside the law, the overlap first.
    pub(crate) fn failures(&self) -> impl Iterator<Item = Outside> {
        let [overlap, force] = [self.outside, self.too_strong];
        let overlap = overlap.map(|(block, lane)| Outside::Pair(block, lane));
        let force = force.map(|(block, lane)| Outside::Force(block, lane));
        overlap.into_iter().chain(force)
    }

    /// Combines two outcomes; of two pairs it keeps the first.
    pub fn merge(mut self, other: Self) -> Self {
        self.outside = self.outside.or(other.outside);
        self.too_strong = self.too_strong.or(other.too_strong);
        self.uncounted |= other.uncounted;
        for (sum, more) in self.dissipated.iter_mut().zip(other.dissipated) {
            *sum += more;
        }
        for (sum, more) in self.stress.iter_mut().zip(other.stress) {
            *sum += more;
        }
        self.blocks += other.blocks;
        self
    }
}

/// A contact law of grains in `D` dimensions, with the loop over the contacts compiled for it: one
/// virtual call per pass. Implemented for every [`ContactLaw`]; [`crate::laws`] makes them.
pub trait PairForce<D: Dimension>: PairModel {
    /// Adds the contact forces to the grains and advances the histories.
    fn pass(&self, pass: Pass<'_, D>, scratch: &mut Scratch<D>) -> PassOutcome;
}

impl<C: ContactLaw + Stiffness> PairForce<C::Space> for C {
    fn pass(&self, pass: Pass<'_, C::Space>, scratch: &mut Scratch<C::Space>) -> PassOutcome {
        let first = pass.part.first;
        let isa = pass.input.isa;
        let has_budget = pass
            .input
            .counting
            .is_some_and(|counting| counting.unit.is_some());
        // The portable arrays always account for the dissipation: one instance a law suffices.
        let law = self;
        let work = PassWork::<C, false> { law, pass, scratch };
        let mut outcome = if has_budget {
            isa.run(work.with_budget())
        } else {
            match isa.run_with_vectors(work) {
                Ok(outcome) => outcome,
                Err(work) => isa.run(work.with_budget()),
            }
        };
        for (block, _) in [&mut outcome.outside, &mut outcome.too_strong]
            .into_iter()
            .flatten()
        {
            *block += first;
        }
        outcome
    }
}

/// One pass; blocks are numbered from the first of the part.
struct PassWork<'a, C: ContactLaw, const BUDGET: bool> {
    law: &'a C,
    pass: Pass<'a, C::Space>,
    scratch: &'a mut Scratch<C::Space>,
}

impl<'a, C: ContactLaw> PassWork<'a, C, false> {
    /// The same with an energy budget.
    fn with_budget(self) -> PassWork<'a, C, true> {
        let Self { law, pass, scratch } = self;
        PassWork { law, pass, scratch }
    }
}

/// How many chunks ahead a pass prefetches: one takes less time than to read the next from memory.
const AHEAD: usize = 2;

/// Intermediate results between the phases of a pass, per block. Kept from pass to pass only to
/// reuse its memory.
#[derive(Debug, Default)]
pub struct Scratch<D: Dimension> {
    /// Differences of the records, and of the second grain what [`Dimension::load`] gives.
    difference: [D::Fields; CHUNK],
    of_j: [[Lanes16; 8]; CHUNK],
    motion: [PairMotion; CHUNK],
    adhesive: adhesion::AdhesiveScratch,
    /// n.
    direction: [[Lanes16; 3]; CHUNK],
    /// R_i + R_j and R_i (m), if the records have radii.
    radii: [[Lanes16; 2]; CHUNK],
    carry: [[Lanes16; CARRY]; CHUNK],
    response: [Response; CHUNK],
    turning: [Turning; CHUNK],
    /// Pairs whose contact begins or has ended, with the factors of their adhesion; set with an
    /// adhesion only.
    jumps: Vec<Jump>,
    /// Pairs that touch for the first time, with the factors of their dampers; set with an energy
    /// budget, and if limits of the law begin with a jump.
    touched: Vec<Jump>,
}

impl<D: Dimension> Scratch<D> {
    /// δ (m) of block k of the chunk; the motion has the overlap that the law is given, which an
    /// adhesion that changes the area makes another.
    #[inline(always)]
    fn overlap(&self, k: usize, changes_area: bool) -> &Lanes16 {
        if changes_area {
            &self.adhesive.overlap[k]
        } else {
            &self.motion[k].overlap
        }
    }
}

impl<C: ContactLaw, const BUDGET: bool> Work for PassWork<'_, C, BUDGET> {
    type Output = PassOutcome;

    /// Runs in phases with short chains of operations, so that the processor works on several
    /// blocks at a time.
    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) -> Self::Output {
        let Self {
            law,
            mut pass,
            scratch,
        } = self;
        let pass = &mut pass;
        let mut outcome = PassOutcome::default();
        let holding = pass.holding();
        let PassInput {
            travelled, is_cold, ..
        } = pass.input;
        // Unknown to the compiler, which else unrolls the loops of all phases: spheres with rolling
        // and the energy budget are a tenth slower then.
        let blocks = std::hint::black_box(CHUNK);
        let mut next = pass.part.awake(0, blocks, travelled);
        let mut prefetched = next.clone();
        if is_cold {
            for _ in 1..AHEAD {
                prefetched = pass.part.awake(prefetched.end, blocks, travelled);
            }
        }
        while !next.is_empty() {
            let chunk = next;
            next = pass.part.awake(chunk.end, blocks, travelled);
            if is_cold {
                prefetched = pass.part.awake(prefetched.end, blocks, travelled);
                prefetch_blocks(pass, prefetched.clone());
            }
            outcome.blocks += chunk.len() as u64;
            load_differences::<C, L>(token, pass, chunk.clone(), scratch);
            let active = relative_motion::<C, L, BUDGET>(token, pass, chunk.clone(), scratch);
            // In later blocks nothing touches or touched a step ago: their histories are zero
            // already.
            let chunk = chunk.start..chunk.start + active;
            if chunk.is_empty() {
                continue;
            }
            if let Some(adhesion) = holding {
                adhesion::hold::<C, L, BUDGET>(token, adhesion, pass, chunk.clone(), scratch);
            }
            let outside = evaluate::<C, L, BUDGET>(token, law, pass, chunk.clone(), scratch);
            outcome.outside = outcome.outside.or(outside);
            if let Some(adhesion) = holding
                && !scratch.jumps.is_empty()
            {
                adhesion::settle_jumps::<C, BUDGET>(law, adhesion, pass, chunk.start, scratch);
            }
            if C::LIMITS_JUMP && !scratch.touched.is_empty() {
                restore_histories::<C, BUDGET>(law, pass, chunk.start, scratch);
            }
            if BUDGET {
                count_dissipation::<C, L>(token, pass, chunk.clone(), scratch, &mut outcome);
                if holding.is_some() {
                    adhesion::forget_lost(scratch);
                }
            }
            let mut stress = StressCount::<L>::new(token, pass);
            let too_strong = add_forces::<C, L>(token, pass, chunk.clone(), scratch, &mut stress);
            outcome.too_strong = outcome.too_strong.or(too_strong);
            adhesion::add_forces::<C::Space, L>(token, pass, chunk, scratch, &mut stress);
            if let Some(stress) = stress {
                stress.end(&mut outcome);
            }
        }
        outcome
    }
}

/// The lanes of some blocks, each of which has so many.
#[inline(always)]
fn lanes_of(blocks: &Range<usize>, per_block: usize) -> Range<usize> {
    blocks.start * per_block..blocks.end * per_block
}

/// Prefetches what the pass reads of these blocks.
#[inline(always)]
fn prefetch_blocks<D: Dimension>(pass: &Pass<'_, D>, blocks: Range<usize>) {
    let part = &pass.part;
    prefetch_all(&part.history[lanes_of(&blocks, part.history_lanes)]);
    prefetch_all(&part.parameters[lanes_of(&blocks, part.parameter_lanes)]);
    if D::RADIUS.is_none() {
        prefetch_all(&part.geometry[blocks.clone()]);
    }
    prefetch_all(&part.kinds[blocks.clone()]);
    prefetch_all(&part.touching[blocks.clone()]);
    prefetch_all(&part.limits[blocks.clone()]);
    // Of the next ones, whose grains are prefetched then.
    let pairs = &part.pairs.blocks()[part.first + blocks.end..];
    prefetch_all(&pairs[..pairs.len().min(CHUNK)]);
    for block in blocks {
        prefetch(pass.record, part.pairs(block));
        prefetch(pass.force, part.pairs(block));
    }
}

/// Loads the records of the pairs, and transposes their differences into lanes.
#[inline(always)]
fn load_differences<C: ContactLaw, L: Lanes>(
    token: L::Token,
    pass: &mut Pass<'_, C::Space>,
    chunk: Range<usize>,
    scratch: &mut Scratch<C::Space>,
) {
    let (record, part) = (pass.record, &pass.part);
    let scratch = scratch.difference.iter_mut().zip(&mut scratch.of_j);
    for (block, (difference, of_j)) in chunk.zip(scratch) {
        let pairs = part.pairs(block);
        if C::FRICTION {
            C::Space::load::<L, true>(token, record, pairs, difference, of_j);
        } else {
            C::Space::load::<L, false>(token, record, pairs, difference, of_j);
        }
    }
}

/// Evaluates the law. Returns a pair whose overlap is outside the law, if there is one.
#[inline(always)]
fn evaluate<C: ContactLaw, L: Lanes, const BUDGET: bool>(
    token: L::Token,
    law: &C,
    pass: &mut Pass<'_, C::Space>,
    chunk: Range<usize>,
    scratch: &mut Scratch<C::Space>,
) -> Option<(usize, usize)> {
    let changes_area = pass.changes_area();
    let contacts = &mut pass.part;
    let needs_last_step = C::Space::SPINS == 3 || C::AGES || (BUDGET && C::CUTS_DAMPERS);
    if (C::FRICTION || C::ROLLING) && needs_last_step {
        let limits = &contacts.limits[chunk.clone()];
        for (response, limits) in scratch.response.iter_mut().zip(limits) {
            [response.sliding, response.rolls, response.twists, _] = *limits;
        }
    }
    law.evaluate::<L, BUDGET>(
        token,
        &mut crate::contact::Blocks {
            parameters: &contacts.parameters[lanes_of(&chunk, C::PARAMETERS)],
            history: &mut contacts.history[lanes_of(&chunk, C::HISTORY)],
            motion: &scratch.motion[..chunk.len()],
            turning: &mut scratch.turning[..chunk.len()],
            per_step: if needs_last_step && pass.input.step > 0.0 {
                1.0 / pass.input.step
            } else {
                0.0
            },
            carry: &mut scratch.carry[..chunk.len()],
            response: &mut scratch.response[..chunk.len()],
            jumps: if changes_area { &scratch.jumps } else { &[] },
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

/// The springs of pairs that touch for the first time and slide at once: the kernel has scaled the
/// velocities by the part of the kick in which the pair touches, and with them the limit and the
/// damper, from which the spring was set back. The force needs this, the history does not.
#[cold]
fn restore_histories<C: ContactLaw, const BUDGET: bool>(
    law: &C,
    pass: &mut Pass<'_, C::Space>,
    first: usize,
    scratch: &mut Scratch<C::Space>,
) {
    let contacts = &mut pass.part;
    let spins = C::Space::SPINS;
    for jump in &scratch.touched {
        let Jump {
            block: k,
            lane,
            factor,
        } = *jump;
        let (block, response) = (first + k, &mut scratch.response[k]);
        let slides = response.sliding >> lane & 1 == 1;
        // Torques of spheres are not scaled.
        let rolls = C::ROLLING && spins == 1 && response.rolls >> lane & 1 == 1;
        if !slides && !rolls {
            continue;
        }
        let parameters = &contacts.parameters[block * C::PARAMETERS..][..C::PARAMETERS];
        let history = &mut contacts.history[block * C::HISTORY..][..C::HISTORY];
        let overlap = Portable::load(PortableToken, &scratch.motion[k].overlap);
        let before =
            BUDGET.then(|| law.elastic_energies(PortableToken, parameters, overlap, history));
        // The spring acts from the touch on, not from nothing: all of its force on all of its way.
        let motion = &scratch.motion[k];
        let (mut worked, mut turned) = (0.0, 0.0);
        if slides {
            for (lanes, way) in history
                .iter_mut()
                .zip(&motion.tangential_increment[..spins])
            {
                worked -= (1.0 / factor - 0.5) * lanes.0[lane] * way.0[lane];
                lanes.0[lane] /= factor;
            }
        }
        if rolls {
            let torque = &mut history[C::HISTORY - 1].0[lane];
            turned -= (1.0 / factor - 0.5) * *torque * motion.rolling_increment.0[lane];
            *torque /= factor;
        }
        let Some([_, tangential_before, rolling_before]) = before else {
            continue;
        };
        let [_, tangential, rolling] =
            law.elastic_energies(PortableToken, parameters, overlap, history);
        for (kind, set_back, work, [before, after]) in [
            (
                dissipation::FRICTION,
                dissipation::SET_BACK_TANGENTIAL,
                worked,
                [tangential_before, tangential],
            ),
            (
                dissipation::ROLLING,
                dissipation::SET_BACK_ROLLING,
                turned,
                [rolling_before, rolling],
            ),
        ] {
            let gained = (after - before).to_lanes16().0[lane];
            response.dissipated[kind].0[lane] += work - gained;
            let set_back = &mut response.dissipated[set_back].0[lane];
            if *set_back > 0.0 {
                *set_back += gained;
            }
        }
    }
}

/// Energies below this many units are counted sixteen at a time.
const MOST_UNITS: f64 = (1u64 << 50) as f64;
/// Greater ones in multiples of this, and what is left.
const MANY_UNITS: f64 = (1u64 << 25) as f64;

/// Adds up the dissipation of the contacts.
#[inline(always)]
fn count_dissipation<C: ContactLaw, L: Lanes>(
    token: L::Token,
    pass: &mut Pass<'_, C::Space>,
    chunk: Range<usize>,
    scratch: &mut Scratch<C::Space>,
    outcome: &mut PassOutcome,
) {
    for jump in &scratch.touched {
        // Both the damping force and the velocity were scaled; the power needs only the force
        // scaled.
        for kind in [dissipation::DAMPING, dissipation::CUT_FRICTION] {
            scratch.response[jump.block].dissipated[kind].0[jump.lane] /= jump.factor;
        }
    }
    let part = &pass.part;
    let counting = pass.input.counting.and_then(|c| Some((c.unit?, c.step)));
    let (unit, step) = counting.unwrap_or((1.0, 0.0));
    let owned = chunk.end.min(part.owned_blocks.saturating_sub(part.first));
    let blocks = chunk.start..owned.max(chunk.start);
    let kinds = if C::CUTS_DAMPERS {
        dissipation::COUNTS
    } else {
        dissipation::KINDS
    };
    for kind in 0..kinds {
        let mut sums = L::no_counts(token);
        let per_unit = match kind {
            dissipation::DAMPING | dissipation::CUT_FRICTION | dissipation::CUT_ROLLING => {
                L::splat(token, step / unit)
            }
            _ => L::splat(token, 1.0 / unit),
        };
        for response in &scratch.response[..blocks.len()] {
            let mut units = L::load(token, &response.dissipated[kind]) * per_unit;
            if L::splat(token, MOST_UNITS).greater(units.abs()).bits() != u16::MAX {
                let few = L::splat(token, MANY_UNITS * MOST_UNITS).greater(units.abs());
                if few.bits() != u16::MAX {
                    count_most(&units.to_lanes16(), few.bits(), outcome, kind);
                }
                units = units.select(few, L::splat(token, 0.0));
                let multiple = (units * L::splat(token, 1.0 / MANY_UNITS)).round();
                let many = L::total(multiple.count(L::no_counts(token)));
                outcome.dissipated[kind] += many * MANY_UNITS as i128;
                units = multiple.mul_add(L::splat(token, -MANY_UNITS), units);
            }
            sums = units.count(sums);
        }
        outcome.dissipated[kind] += L::total(sums);
    }
}

/// Counts the energies (in units) of the lanes that are not in `few`.
#[cold]
fn count_most(units: &Lanes16, few: u16, outcome: &mut PassOutcome, kind: usize) {
    for lane in (0..LANES).filter(|lane| few >> lane & 1 == 0) {
        let units = units.0[lane].round_ties_even();
        if units.abs() < 2f64.powi(100) {
            outcome.dissipated[kind] += units as i128;
        } else {
            outcome.uncounted = true;
        }
    }
}

/// The stress of the forces of some blocks, where it is counted.
struct StressCount<L: Lanes> {
    /// Blocks from this one on are not counted.
    owned: usize,
    per_unit: L,
    up: L::Counts,
    along: L::Counts,
    lateral: Option<LateralCounts<L>>,
}

/// The normal stresses along the axes across the height.
struct LateralCounts<L: Lanes> {
    per_unit: [L; 2],
    counts: [L::Counts; 2],
}

impl<L: Lanes> StressCount<L> {
    #[inline(always)]
    fn new<D: Dimension>(token: L::Token, pass: &Pass<'_, D>) -> Option<Self> {
        let counting = pass.input.counting?;
        let unit = pass.input.units.force;
        let mut lateral = None;
        if let Some([x, y]) = counting.lateral {
            lateral = Some(LateralCounts {
                per_unit: [
                    L::splat(token, 1.0 / (x * unit)),
                    L::splat(token, 1.0 / (y * unit)),
                ],
                counts: [L::no_counts(token), L::no_counts(token)],
            });
        }
        Some(Self {
            owned: pass.part.owned_blocks.saturating_sub(pass.part.first),
            per_unit: L::splat(token, 1.0 / (counting.height? * unit)),
            up: L::no_counts(token),
            along: L::no_counts(token),
            lateral,
        })
    }

    /// Adds the rounded forces of a block, zeros where none act, of grains this `distance` (m)
    /// apart in the direction `n`. Forces have up to 2^51 units, and the grains are less than the
    /// lengths of the cell apart.
    #[inline(always)]
    fn add<D: Dimension>(&mut self, block: usize, n: &[L; 3], distance: L, force: &[L; 3]) {
        if block >= self.owned {
            return;
        }
        let part = n[D::UP] * distance * self.per_unit;
        self.up = (part * force[D::UP]).count(self.up);
        self.along = (part * force[0]).count(self.along);
        if let Some(LateralCounts { per_unit, counts }) = &mut self.lateral {
            for axis in 0..D::UP {
                let part = n[axis] * distance * per_unit[axis];
                counts[axis] = (part * force[axis]).count(counts[axis]);
            }
        }
    }

    #[inline(always)]
    fn end(self, outcome: &mut PassOutcome) {
        outcome.stress[0] += L::total(self.up);
        outcome.stress[1] += L::total(self.along);
        if let Some(LateralCounts { counts: [x, y], .. }) = self.lateral {
            outcome.stress[2] += L::total(x);
            outcome.stress[3] += L::total(y);
        }
    }
}

/// Adds forces and torques to the grains; pairs that do not touch add zeros. Returns a pair whose
/// force is too great to be rounded to the unit, if there is one.
#[inline(always)]
fn add_forces<C: ContactLaw, L: Lanes>(
    token: L::Token,
    pass: &mut Pass<'_, C::Space>,
    chunk: Range<usize>,
    scratch: &Scratch<C::Space>,
    stress: &mut Option<StressCount<L>>,
) -> Option<(usize, usize)> {
    let zero = L::splat(token, 0.0);
    let (axes, spins) = (C::Space::AXES, C::Space::SPINS);
    let units = pass.input.units;
    let force_shift = L::splat(token, Units::shift(units.force));
    let torque_shift = L::splat(token, Units::shift(units.torque));
    let largest = L::splat(token, units.largest_force());
    let mut outside = None;
    let changes_area = pass.changes_area();
    let sums = &mut *pass.force;
    let contacts = &mut pass.part;
    for (k, block) in chunk.enumerate() {
        let overlap = scratch.overlap(k, changes_area);
        let (motion, response) = (&scratch.motion[k], &scratch.response[k]);
        let turning = &scratch.turning[k];
        let touching = L::load(token, &motion.overlap).greater(zero);
        let mut n = vector::<L>(token, &scratch.direction[k], 1);
        for axis in 0..axes {
            n[axis] = L::load(token, &scratch.direction[k][axis]).select(touching, zero);
        }
        let normal = L::load(token, &response.normal).select(touching, zero);
        if let Some(samples) = &mut pass.samples {
            // Of contacts across a gap the law says nothing.
            normal.store(&mut samples.normal[block]);
            samples.overlap[block] = *overlap;
            for k in 0..spins {
                let tangential = L::load(token, &response.tangential[k]).select(touching, zero);
                tangential.store(&mut samples.tangential[block][k]);
            }
        }
        let touched = contacts.touching[block];
        let idle = !normal.greater(zero).bits() & touched;
        let at_limit = if C::FRICTION || C::ROLLING {
            [response.sliding, response.rolls, response.twists]
        } else {
            [0; 3]
        };
        let pressed = touched & touching.bits();
        let [slides, rolls, twists] = at_limit.map(|lanes| lanes & pressed);
        contacts.limits[block] = [slides, rolls, twists, idle];
        let radii = match C::Space::RADIUS {
            Some(_) => &scratch.radii[k],
            None => &contacts.geometry[block],
        };
        let radii = PairRadii::load(token, radii);
        let forces = LawForces {
            response,
            turning,
            touching,
            normal,
        };
        let mut forces = forces.on_grains::<C>(token, &n, &radii);
        let mut greatest = forces.force[0].abs();
        for axis in 1..axes {
            greatest = greatest.max(forces.force[axis].abs());
        }
        let greater = greatest.greater(largest).bits();
        if greater != 0 && outside.is_none() {
            outside = Some((block, greater.trailing_zeros() as usize));
        }
        for axis in 0..axes {
            forces.force[axis] = (forces.force[axis] + force_shift) - force_shift;
        }
        if let Some(stress) = stress {
            let distance = radii.sum - L::load(token, overlap);
            stress.add::<C::Space>(block, &n, distance, &forces.force);
        }
        for k in 0..spins {
            forces.torque_i[k] = (forces.torque_i[k] + torque_shift) - torque_shift;
            forces.torque_j[k] = (forces.torque_j[k] + torque_shift) - torque_shift;
        }
        C::Space::add_forces(&forces, sums, contacts.pairs(block));
    }
    outside
}

/// What the law says of the forces of sixteen pairs.
struct LawForces<'a, L: Lanes> {
    response: &'a Response,
    turning: &'a Turning,
    touching: L::Mask,
    /// F_n of pairs that touch, 0 of others.
    normal: L,
}

impl<L: Lanes> LawForces<'_, L> {
    /// The force and the torques on the grains of each pair.
    #[inline(always)]
    fn on_grains<C: ContactLaw>(
        &self,
        token: L::Token,
        n: &Vector<L>,
        radii: &PairRadii<L>,
    ) -> PairForces<L> {
        let zero = L::splat(token, 0.0);
        let (axes, spins) = (C::Space::AXES, C::Space::SPINS);
        let mut force = *n;
        let (mut torque_i, mut torque_j) = ([zero; 3], [zero; 3]);
        if C::FRICTION {
            let mut tangential = [zero; 3];
            for k in 0..spins {
                let component = L::load(token, &self.response.tangential[k]);
                tangential[k] = component.select(self.touching, zero);
            }
            force = C::Space::force(n, self.normal, &tangential);
            let moment = C::Space::moment(n, &tangential);
            for k in 0..spins {
                torque_i[k] = -radii.first * moment[k];
                torque_j[k] = (radii.first - radii.sum) * moment[k];
            }
        } else {
            for axis in 0..axes {
                force[axis] = self.normal * n[axis];
            }
        }
        if C::ROLLING {
            for k in 0..spins {
                let rolling = if spins == 3 {
                    let twisting = L::load(token, &self.turning.torque[3]);
                    twisting.mul_add(n[k], L::load(token, &self.turning.torque[k]))
                } else {
                    L::load(token, &self.response.rolling)
                };
                let rolling = rolling.select(self.touching, zero);
                torque_i[k] = torque_i[k] + rolling;
                torque_j[k] = torque_j[k] - rolling;
            }
        }
        PairForces {
            force,
            torque_i,
            torque_j,
        }
    }
}
