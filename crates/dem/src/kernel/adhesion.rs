//! Adhesion in a pass over the contacts: which pairs it holds, and its forces.

use std::ops::Range;

use super::motion::{JumpLists, Jumping, too_deep};
use super::{Pass, Samples, Scratch, StressCount};
use crate::contact::adhesion::{AdhesionModel, AdhesiveBlocks, HeldBlock, Question, UnheldBlocks};
use crate::contact::{CHUNK, ContactLaw, Jump, PairMotion, PairRadii, dissipation};
use crate::dimension::{Dimension, PairForces};
use crate::simd::{Isa, Lanes, Lanes16, Mask, Portable, PortableToken};
use crate::state::Units;

/// What adhesions need and say of the blocks of a chunk.
#[derive(Debug, Default)]
pub(super) struct AdhesiveScratch {
    /// δ (m); set if the adhesion decides which pairs are in contact, and how.
    pub overlap: [Lanes16; CHUNK],
    /// -v_n Δt (m); set likewise.
    pub approach: [Lanes16; CHUNK],
    /// δ a step ago (m).
    last_overlap: [Lanes16; CHUNK],
    /// What the adhesion says of them.
    held: [HeldBlock; CHUNK],
    /// The overlaps that the law is given (m).
    elastic: [Lanes16; CHUNK],
    /// F_c.
    force: [Lanes16; CHUNK],
}

impl AdhesiveScratch {
    /// Gives the motion of block k the overlaps that the law is to have, where pairs are or were in
    /// contact.
    #[inline(always)]
    fn set_overlap<L: Lanes>(
        &self,
        token: L::Token,
        k: usize,
        pairs: &HeldPairs<L>,
        motion: &mut PairMotion,
    ) {
        let elastic = L::load(token, &self.held[k].elastic_overlap);
        let acts = L::mask(token, pairs.before | pairs.now);
        let overlap = elastic.select(acts, pairs.overlap);
        overlap.store(&mut motion.overlap);
    }

    /// Gives the motion of block k its normal increment, that of the overlap of the law.
    #[inline(always)]
    fn set_increment<L: Lanes>(&self, token: L::Token, k: usize, motion: &mut PairMotion) {
        let held = &self.held[k];
        let elastic = L::load(token, &held.elastic_overlap);
        let last = L::load(token, &held.last_elastic_overlap);
        (last - elastic).store(&mut motion.normal_increment);
    }
}

/// Asks the adhesion which pairs are in contact, and gives the motion the overlaps that the law is
/// to have. Corrects the motion of pairs that touch, and of those whose contact ends.
#[inline(always)]
pub(super) fn hold<C: ContactLaw, L: Lanes, const BUDGET: bool>(
    token: L::Token,
    adhesion: &dyn AdhesionModel,
    pass: &mut Pass<'_, C::Space>,
    chunk: Range<usize>,
    scratch: &mut Scratch<C::Space>,
) {
    let changes_area = adhesion.changes_area();
    let needs_last = changes_area && (BUDGET || C::NEEDS_LAST_OVERLAP);
    let contacts = &mut pass.part;
    let adhesive = &mut scratch.adhesive;
    for k in 0..chunk.len() {
        adhesive.overlap[k] = scratch.motion[k].overlap;
        if needs_last {
            let increment = L::load(token, &scratch.motion[k].normal_increment);
            let last = L::load(token, &adhesive.overlap[k]) + increment;
            last.store(&mut adhesive.last_overlap[k]);
        }
    }
    let geometry = match C::Space::RADIUS {
        Some(_) => &scratch.radii[..chunk.len()],
        None => &contacts.geometry[chunk.clone()],
    };
    let blocks = UnheldBlocks {
        geometry,
        touching: &contacts.touching[chunk.clone()],
        overlap: &adhesive.overlap,
        last_overlap: if needs_last {
            Some(&adhesive.last_overlap)
        } else {
            None
        },
    };
    let held = &mut adhesive.held[..chunk.len()];
    adhesion.hold(pass.input.isa, &blocks, held);
    for (k, block) in chunk.enumerate() {
        let pairs = HeldPairs::<L>::new(token, adhesive, k, contacts.touching[block]);
        if pairs.before | pairs.overlaps == 0 {
            continue;
        }
        contacts.touching[block] = pairs.now;
        let (motion, turning) = (&mut scratch.motion[k], &mut scratch.turning[k]);
        if changes_area {
            adhesive.set_overlap(token, k, &pairs, motion);
        }
        if needs_last {
            adhesive.set_increment::<L>(token, k, motion);
        }
        if C::LARGEST_OVERLAP < f64::INFINITY {
            let radii = PairRadii::load(token, &geometry[k]);
            scratch.response[k].beyond = too_deep::<C, L>(token, motion, &radii);
        }
        if let Some(jumping) = pairs.jumping(token, &adhesive.approach[k], changes_area) {
            let notes_touches = (BUDGET || C::LIMITS_JUMP) && !changes_area;
            let lists = JumpLists {
                touched: notes_touches.then_some(&mut scratch.touched),
                adhesion: Some(&mut scratch.jumps),
            };
            jumping.correct(k, motion, turning, lists);
        }
    }
}

/// Sixteen pairs that an adhesion may hold.
struct HeldPairs<L> {
    /// Those that were in contact a step ago.
    before: u16,
    /// Those that are.
    now: u16,
    /// Those that overlap.
    overlaps: u16,
    /// δ (m).
    overlap: L,
    /// How far (m) they are from the end of their contact.
    margin: L,
}

impl<L: Lanes> HeldPairs<L> {
    #[inline(always)]
    fn new(token: L::Token, adhesive: &AdhesiveScratch, k: usize, before: u16) -> Self {
        let overlap = L::load(token, &adhesive.overlap[k]);
        let margin = L::load(token, &adhesive.held[k].margin);
        let zero = L::splat(token, 0.0);
        let overlaps = overlap.greater(zero).bits();
        Self {
            before,
            now: (margin.greater(zero).bits() & before) | overlaps,
            overlaps,
            overlap,
            margin,
        }
    }

    /// The pairs whose forces jump in this step, if there are some. `approach`: -v_n Δt (m).
    #[inline(always)]
    fn jumping(&self, token: L::Token, approach: &Lanes16, changes_area: bool) -> Option<Jumping> {
        // A pair that touched a step ago overlaps by more than it has approached since.
        let touched = L::load(token, approach).greater(self.overlap).bits() & self.overlaps;
        let formed = touched & !self.before;
        let opened = self.before & !self.now;
        let touched = if changes_area { formed } else { touched };
        if touched | opened == 0 {
            return None;
        }
        let ended = L::mask(token, opened);
        Some(Jumping {
            touched,
            formed,
            opened,
            since: self.margin.select(ended, self.overlap).to_lanes16(),
            approach: *approach,
            all_forces: changes_area,
        })
    }
}

/// Ends the contacts that have separated, and counts the energy that is lost with them. Where the
/// adhesion changes the area, scales all forces of pairs whose contact begins or ends in this step
/// by their factors, and ends the histories of the latter, which the law has taken as touching, as
/// they were a step ago.
#[cold]
pub(super) fn settle_jumps<C: ContactLaw, const BUDGET: bool>(
    law: &C,
    adhesion: &dyn AdhesionModel,
    pass: &mut Pass<'_, C::Space>,
    first: usize,
    scratch: &mut Scratch<C::Space>,
) {
    let changes_area = adhesion.changes_area();
    let contacts = &mut pass.part;
    for jump in &scratch.jumps {
        let Jump {
            block: k,
            lane,
            factor,
        } = *jump;
        let (block, response) = (first + k, &mut scratch.response[k]);
        if changes_area {
            let forces = response.tangential.iter_mut();
            let forces = forces.chain(&mut scratch.turning[k].torque);
            for lanes in forces.chain([&mut response.normal]) {
                lanes.0[lane] *= factor;
            }
            for kind in [
                dissipation::DAMPING,
                dissipation::CUT_FRICTION,
                dissipation::CUT_ROLLING,
            ] {
                response.dissipated[kind].0[lane] *= factor;
            }
        }
        if contacts.touching[block] >> lane & 1 == 1 {
            continue;
        }
        let history = &mut contacts.history[block * C::HISTORY..][..C::HISTORY];
        if BUDGET {
            let elastic = &scratch.motion[k].overlap;
            let mut energies = [Lanes16::ZERO; 3];
            if changes_area {
                let parameters = &contacts.parameters[block * C::PARAMETERS..][..C::PARAMETERS];
                let overlap = Portable::load(PortableToken, elastic);
                energies = law
                    .elastic_energies(PortableToken, parameters, overlap, history)
                    .map(Portable::to_lanes16);
                for kind in [
                    dissipation::SET_BACK_TANGENTIAL,
                    dissipation::SET_BACK_ROLLING,
                ] {
                    response.dissipated[kind].0[lane] = 0.0;
                }
            }
            let overlap = Portable::load(PortableToken, &scratch.adhesive.overlap[k]);
            let margin = Portable::load(PortableToken, &scratch.adhesive.held[k].margin);
            let at_end = AdhesiveBlocks {
                geometry: std::slice::from_ref(&contacts.geometry[block]),
                overlap: &[(overlap - margin).to_lanes16()],
                elastic_overlap: std::slice::from_ref(elastic),
            };
            let [normal, tangential, rolling] = &mut energies;
            let normal = std::slice::from_mut(normal);
            adhesion.answer(Isa::Portable, Question::Potential, &at_end, normal);
            for (kind, energy) in [
                (dissipation::STIFFNESS, &normal[0]),
                (dissipation::FRICTION, tangential),
                (dissipation::ROLLING, rolling),
            ] {
                response.dissipated[kind].0[lane] += energy.0[lane];
            }
        }
        if changes_area {
            for lanes in history {
                lanes.0[lane] = 0.0;
            }
        }
    }
}

/// Forgets the energies that were lost with contacts: laws without friction leave them.
#[inline(always)]
pub(super) fn forget_lost<D: Dimension>(scratch: &mut Scratch<D>) {
    for jump in &scratch.jumps {
        scratch.response[jump.block].dissipated[dissipation::STIFFNESS].0[jump.lane] = 0.0;
    }
}

/// Adds the adhesion to the grains of pairs in contact, and of those whose contact has just ended.
#[inline(always)]
pub(super) fn add_forces<D: Dimension, L: Lanes>(
    token: L::Token,
    pass: &mut Pass<'_, D>,
    chunk: Range<usize>,
    scratch: &mut Scratch<D>,
    stress: &mut Option<StressCount<L>>,
) {
    let Some(adhesion) = pass.adhesion else {
        return;
    };
    let zero = L::splat(token, 0.0);
    let shift = L::splat(token, Units::shift(pass.input.units.force));
    let changes_area = adhesion.changes_area();
    let contacts = &pass.part;
    let adhesive = &mut scratch.adhesive;
    for k in 0..chunk.len() {
        adhesive.elastic[k] = scratch.motion[k].overlap;
    }
    let asked = AdhesiveBlocks {
        geometry: match D::RADIUS {
            Some(_) => &scratch.radii[..chunk.len()],
            None => &contacts.geometry[chunk.clone()],
        },
        overlap: if changes_area {
            &adhesive.overlap
        } else {
            &adhesive.elastic
        },
        elastic_overlap: &adhesive.elastic,
    };
    let force = &mut adhesive.force[..chunk.len()];
    adhesion.answer(pass.input.isa, Question::Force, &asked, force);
    let mut jumps = scratch.jumps.iter().peekable();
    for (k, block) in chunk.enumerate() {
        let touches = L::mask(token, contacts.touching[block]);
        let mut factors = Lanes16::ZERO;
        L::splat(token, 1.0)
            .select(touches, zero)
            .store(&mut factors);
        while let Some(jump) = jumps.next_if(|jump| jump.block == k) {
            factors.0[jump.lane] = jump.factor;
        }
        let factor = L::load(token, &factors);
        let acts = factor.abs().greater(zero);
        let force = L::load(token, &scratch.adhesive.force[k]);
        let pull = (factor * force).select(acts, zero);
        let (mut n, mut force) = ([zero; 3], [zero; 3]);
        for axis in 0..D::AXES {
            n[axis] = L::load(token, &scratch.direction[k][axis]).select(acts, zero);
            force[axis] = (shift - pull * n[axis]) - shift;
        }
        if let Some(stress) = stress {
            let radii = PairRadii::<L>::load(token, &contacts.geometry[block]);
            let distance = radii.sum - L::load(token, scratch.overlap(k, changes_area));
            stress.add::<D>(block, &n, distance, &force);
        }
        if let Some(Samples { normal, .. }) = &mut pass.samples {
            let sample = L::load(token, &normal[block]) - pull;
            sample.store(&mut normal[block]);
        }
        let forces = PairForces {
            force,
            torque_i: [zero; 3],
            torque_j: [zero; 3],
        };
        D::add_forces(&forces, pass.force, contacts.pairs(block));
    }
}
