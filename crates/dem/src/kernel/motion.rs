//! The relative motion of the pairs of some blocks: how they lie to each other, how fast they
//! separate and slip, and in three dimensions how they have turned since the last step.

use std::ops::Range;

use super::{Pass, Scratch};
use crate::contact::attraction::reduced_radius;
use crate::contact::jkr::Jkr;
use crate::contact::{
    ContactLaw, Jump, PairMotion, TORQUES, Turning, is_curved, scaled, store_vector, vector,
};
use crate::dimension::{Dimension, Three, scaled_sum};
use crate::simd::{LANES, Lanes, Lanes16, Mask, Pairs, inverse_sqrt};
use crate::state::{Cell, FILLER, Stretching, Units, way_to_touch};

/// Computes the relative motion of the pairs; in three dimensions also rotates the tangential part
/// of their histories with n. Returns the number of blocks up to the last in which a pair touches
/// or touched a step ago.
#[inline(always)]
pub(super) fn relative_motion<C: ContactLaw, L: Lanes, const BUDGET: bool>(
    token: L::Token,
    pass: &mut Pass<'_, C::Space>,
    chunk: Range<usize>,
    scratch: &mut Scratch<C::Space>,
) -> usize {
    let mut active = 0;
    let step = L::splat(token, pass.input.step);
    let shifts = [pass.input.units.slip, Units::ROTATION].map(Units::shift);
    // An array's `map` may be called, without the instruction set.
    let shifts = [L::splat(token, shifts[0]), L::splat(token, shifts[1])];
    let steps = (step, shifts);
    let jkr = pass.jkr();
    let cell = (&pass.input.cell, pass.part.has_feet);
    let contacts = &mut pass.part;
    let attracts = pass.input.attraction.is_some();
    scratch.touched.clear();
    scratch.jumps.clear();
    let blocks = scratch
        .radii
        .iter_mut()
        .zip(&mut contacts.touching[chunk.clone()])
        .zip(scratch.difference.iter().zip(&scratch.of_j))
        .zip(scratch.motion.iter_mut().zip(&mut scratch.turning))
        .zip(scratch.direction.iter_mut().zip(&mut scratch.overlap))
        .zip(&mut scratch.response)
        .enumerate();
    for (k, (((((radii, touching), of_records), of_motion), places), response)) in blocks {
        let ((difference, of_j), (motion, turning)) = (of_records, of_motion);
        let (direction, overlap) = places;
        let difference = difference.as_ref();
        let block = chunk.start + k;
        let pairs = &contacts.pairs.blocks()[contacts.first + block];
        let of_block = (pairs, &contacts.geometry[block], radii);
        let ([sum, r_i], pair) =
            separation::<C::Space, L>(token, cell, of_block, (difference, of_j));
        store_vector(&pair.n, direction, C::Space::AXES);
        pair.overlap.store(&mut motion.overlap);
        let [v, half_v] = Velocity::of_pair::<C::Space>(token, &pair, difference);
        v.normal.store(&mut motion.normal_velocity);
        if C::NEEDS_LAST_OVERLAP {
            let last = pair.last_overlap::<C::Space>(token, &half_v, step, sum);
            (last - pair.overlap).store(&mut motion.normal_increment);
        } else if BUDGET {
            (half_v.normal * step).store(&mut motion.normal_increment);
        }
        if C::FRICTION {
            let history = &mut contacts.history[block * C::HISTORY..][..C::HISTORY];
            let records = (difference, &of_j[C::Space::SPINS_OF_J..], [sum, r_i]);
            let of = (&pair, &v, &half_v);
            tangential_motion::<C, L>(token, &steps, of, records, history, (motion, turning));
        }
        if C::ROLLING && C::Space::SPINS == 1 {
            rolling_motion::<C::Space, L>(token, &steps, difference, motion);
        }
        let before = *touching;
        let approach = -half_v.normal * step;
        let lengths = [pair.overlap, approach, sum, r_i];
        let (new, since_jump) = touch(
            token,
            jkr.as_ref(),
            lengths,
            touching,
            (motion, overlap),
            BUDGET || C::NEEDS_LAST_OVERLAP,
        );
        if before | *touching != 0 {
            active = k + 1;
            if C::LARGEST_OVERLAP < f64::INFINITY {
                response.beyond = too_deep::<C, L>(token, motion, [sum, r_i]);
            }
        } else {
            let inner = contacts.first + block < contacts.inner;
            contacts.asleep_until[block] =
                asleep_until(motion, pass.input.travelled.filter(|_| inner));
        }
        let opened = if attracts { before & !*touching } else { 0 };
        if new | opened != 0 {
            let jumps = attracts.then_some(&mut scratch.jumps);
            let notes = (BUDGET || C::LIMITS_JUMP) && jkr.is_none();
            let touched = notes.then_some(&mut scratch.touched);
            correct_jumps(
                (k, [new, opened]),
                [since_jump.to_lanes16(), approach.to_lanes16()],
                (motion, turning),
                [touched, jumps],
                jkr.is_some(),
            );
        }
    }
    active
}

/// How the pairs of a block lie to each other in a cell, with or without flat walls, and their
/// R_i + R_j and R_i (m): those of the list, unless the records have them; `radii` then holds them.
#[inline(always)]
fn separation<D: Dimension, L: Lanes>(
    token: L::Token,
    (cell, has_feet): (&Cell, bool),
    (pairs, of_list, radii): (&Pairs, &[Lanes16; 2], &mut [Lanes16; 2]),
    (difference, of_j): (&[Lanes16], &[Lanes16; 8]),
) -> ([L; 2], Separation<L>) {
    let radii = match D::RADIUS {
        Some([of_i, of_second]) => {
            *radii = radii_of::<L>(token, [&difference[of_i], &of_j[of_second]], pairs);
            radii
        }
        None => of_list,
    };
    let [sum, r_i] = [L::load(token, &radii[0]), L::load(token, &radii[1])];
    let mut pair = Separation::<L>::new::<D>(token, cell, difference, sum);
    if has_feet {
        // The normal of a flat wall does not turn.
        let none = L::splat(token, 0.0);
        pair.per_distance = pair.per_distance.select(is_curved([sum, r_i]), none);
    }
    ([sum, r_i], pair)
}

/// The rolling velocity and increment of disks, from Δt (s) and what rounds increments of slip and
/// rotation.
#[inline(always)]
fn rolling_motion<D: Dimension, L: Lanes>(
    token: L::Token,
    (step, [_, shift]): &(L, [L; 2]),
    difference: &[Lanes16],
    motion: &mut PairMotion,
) {
    motion.rolling_velocity = difference[D::SPIN];
    let half = L::load(token, &difference[D::HALF_SPIN]);
    (half.mul_add(*step, *shift) - *shift).store(&mut motion.rolling_increment);
}

/// R_i + R_j and R_i (m) of a block of pairs from the radii of its grains, as they are in
/// [`crate::state::Contacts::geometry`], which would have to come from memory.
#[inline(always)]
fn radii_of<L: Lanes>(token: L::Token, of_pair: [&Lanes16; 2], pairs: &Pairs) -> [Lanes16; 2] {
    let [r_i, r_j] = [L::load(token, of_pair[0]), L::load(token, of_pair[1])];
    let mut sum = r_i + r_j;
    // A block is filled up from its end.
    if pairs.i[LANES - 1] == pairs.j[LANES - 1] {
        sum = sum.select(L::mask(token, pairs.of_two()), L::splat(token, FILLER));
    }
    [sum.to_lanes16(), *of_pair[0]]
}

/// The pairs whose overlap is outside the law, from R_i + R_j and R_i (m).
#[inline(always)]
fn too_deep<C: ContactLaw, L: Lanes>(token: L::Token, motion: &PairMotion, radii: [L; 2]) -> u16 {
    let largest = L::splat(token, 2.0 * C::LARGEST_OVERLAP) * smaller(radii);
    L::load(token, &motion.overlap).greater(largest).bits()
}

/// The radius of the smaller grain (m), from R_i + R_j and R_i (m).
#[inline(always)]
fn smaller<L: Lanes>([sum, r_i]: [L; 2]) -> L {
    let r_j = sum - r_i;
    // A flat wall is larger than any grain.
    let is_smaller = r_i.greater(r_j).and(is_curved([sum, r_i]));
    r_j.select(is_smaller, r_i)
}

/// Updates the mask of touching pairs. Returns the pairs that touch for the first time, and the
/// overlap since touch or opening. Takes δ, -v_n Δt, R_i + R_j and R_i; `has_increment`: whether
/// the motion has its normal increment.
#[inline(always)]
fn touch<L: Lanes>(
    token: L::Token,
    jkr: Option<&Jkr>,
    [overlap, approach, sum, r_i]: [L; 4],
    touching: &mut u16,
    (motion, without_jkr): (&mut PairMotion, &mut Lanes16),
    has_increment: bool,
) -> (u16, L) {
    let before = *touching;
    *touching = overlap.greater(L::splat(token, 0.0)).bits();
    // A pair that touched a step ago overlaps by more than it has approached since.
    let new = approach.greater(overlap).bits() & *touching;
    let Some(jkr) = jkr else {
        return (new, overlap);
    };
    overlap.store(without_jkr);
    if before | *touching == 0 {
        return (new, overlap);
    }
    let of = (overlap, reduced_radius([sum, r_i]));
    let touched = [before, *touching];
    let (held, since_jump) = adhere(token, jkr, of, touched, motion, has_increment);
    *touching = held;
    (new & !before, since_jump)
}

/// Computes the tangential motion; in three dimensions rotates the histories, and computes the
/// rolling motion. `steps`: Δt, and what rounds increments of slip and rotation. `records`:
/// differences, spins of j, R_i + R_j and R_i.
#[inline(always)]
fn tangential_motion<C: ContactLaw, L: Lanes>(
    token: L::Token,
    (step, [slip_shift, rotation_shift]): &(L, [L; 2]),
    (pair, v, half_v): (&Separation<L>, &Velocity<L>, &Velocity<L>),
    (difference, spins_of_j, [sum, r_i]): (&[Lanes16], &[Lanes16], [L; 2]),
    history: &mut [Lanes16],
    (motion, turning): (&mut PairMotion, &mut Turning),
) {
    let spins = C::Space::SPINS;
    let (half_of_j, of_j) = spins_of_j.split_at(spins);
    let s = spin_sum::<C::Space, L>(token, &difference[C::Space::SPIN..], of_j, sum, r_i);
    let half_s = &difference[C::Space::HALF_SPIN..];
    let half_s = spin_sum::<C::Space, L>(token, half_s, half_of_j, sum, r_i);
    let rotational = C::Space::surface_velocity(&pair.n, &s);
    let tangential = C::Space::tangential_part(&pair.n, &v.vector, v.normal);
    for k in 0..spins {
        (tangential[k] + rotational[k]).store(&mut motion.tangential_velocity[k]);
    }
    let half = HalfStep::new::<C::Space>(token, *step, pair, half_v);
    let mut slip = half.tangential;
    if spins == 3 {
        let mean = mean_spin::<L>(token, &difference[C::Space::HALF_SPIN..], half_of_j);
        let turn = Turn::new(token, &pair.n, &half, (*step, &mean));
        if C::HISTORY >= 3 + if C::ROLLING { TORQUES } else { 0 } {
            turn.of_step(token, &mut history[..3]);
        }
        slip = turn.slip(&half, &half_v.vector, &half_s);
        if C::ROLLING {
            let first = C::HISTORY - TORQUES;
            turn.of_step(token, &mut history[first..first + 3]);
            let full = vector::<L>(token, &difference[C::Space::SPIN..], 3);
            let half = vector::<L>(token, &difference[C::Space::HALF_SPIN..], 3);
            turn.rolling([full, half], (*step, *rotation_shift), turning);
        }
    } else {
        let rotational = C::Space::surface_velocity(&pair.n, &half_s);
        slip[0] = slip[0].mul_add(half.longer, rotational[0]);
    }
    for k in 0..spins {
        let rounded = slip[k].mul_add(*step, *slip_shift) - *slip_shift;
        rounded.store(&mut motion.tangential_increment[k]);
    }
}

/// How far the grains will have travelled (m) when a pair of this block may touch; `travelled` is
/// how far they are now, `None` if that is not known, as of ghosts.
#[inline(always)]
fn asleep_until(motion: &PairMotion, travelled: Option<f64>) -> f64 {
    let Some(travelled) = travelled else {
        return 0.0;
    };
    let mut gap = f64::INFINITY;
    for overlap in motion.overlap.0 {
        gap = gap.min(-overlap);
    }
    travelled + way_to_touch(gap)
}

/// How sixteen pairs lie to each other.
struct Separation<L> {
    /// From j to i (m).
    r: [L; 3],
    n: [L; 3],
    /// 1/|r|, by which n turns; 0 if it does not.
    per_distance: L,
    /// δ (m).
    overlap: L,
    /// Velocity along x of the second grain's image relative to the grain, subtracted from
    /// differences of velocities, of the full and of the half step.
    image_velocity: Option<[L; 2]>,
    stretching: Option<Stretching>,
}

impl<L: Lanes> Separation<L> {
    /// From differences of the records, by the nearest images; `sum` is R_i + R_j.
    #[inline(always)]
    fn new<D: Dimension>(token: L::Token, cell: &Cell, difference: &[Lanes16], sum: L) -> Self {
        let c = |v| L::splat(token, v);
        let mut r = vector::<L>(token, &difference[D::POSITION..], D::AXES);
        let beyond = cell.nearest_images::<D, L>(token, &mut r);
        let (mut image_velocity, mut stretching) = (None, None);
        if let Some(sheared) = &cell.sheared {
            if let Some(images) = beyond {
                image_velocity = Some([
                    images * c(sheared.velocity),
                    images * c(sheared.half_velocity),
                ]);
            }
            stretching = sheared.stretching;
        }
        let (distance, per_distance) = distance::<D, L>(token, &r);
        let mut n = r;
        for axis in 0..D::AXES {
            n[axis] = r[axis] * per_distance;
        }
        Self {
            r,
            n,
            per_distance,
            overlap: sum - distance,
            image_velocity,
            stretching,
        }
    }

    /// The overlap a step ago (m): of the separation then, or, where n does not turn, along n.
    #[inline(always)]
    fn last_overlap<D: Dimension>(
        &self,
        token: L::Token,
        half_v: &Velocity<L>,
        step: L,
        sum: L,
    ) -> L {
        let mut r = self.r;
        for axis in 0..D::AXES {
            r[axis] = (-step).mul_add(half_v.vector[axis], r[axis]);
        }
        let turned = sum - distance::<D, L>(token, &r).0;
        let straight = half_v.normal.mul_add(step, self.overlap);
        let turns = self.per_distance.greater(L::splat(token, 0.0));
        turned.select(turns, straight)
    }
}

/// |r| and 1/|r|.
#[inline(always)]
fn distance<D: Dimension, L: Lanes>(token: L::Token, r: &[L; 3]) -> (L, L) {
    let square = D::dot(r, r);
    let per_distance = inverse_sqrt(token, square);
    // To 0.501 ulp, because the overlap is the small difference of two lengths.
    let estimate = square * per_distance;
    let half = L::splat(token, 0.5) * per_distance;
    let distance = half.mul_add((-estimate).mul_add(estimate, square), estimate);
    (distance, per_distance)
}

/// Relative velocity of sixteen pairs (m/s).
struct Velocity<L> {
    vector: [L; 3],
    /// Along n.
    normal: L,
}

impl<L: Lanes> Velocity<L> {
    /// Those of the full and of the half step.
    #[inline(always)]
    fn of_pair<D: Dimension>(
        token: L::Token,
        pair: &Separation<L>,
        difference: &[Lanes16],
    ) -> [Self; 2] {
        let mut v = vector::<L>(token, &difference[D::VELOCITY..], D::AXES);
        let mut half_v = vector::<L>(token, &difference[D::HALF_VELOCITY..], D::AXES);
        if let Some([full, half]) = pair.image_velocity {
            v[0] = v[0] + full;
            half_v[0] = half_v[0] + half;
        }
        if let Some(Stretching { half, full }) = pair.stretching {
            for axis in 0..D::AXES {
                v[axis] = pair.r[axis].mul_add(L::splat(token, full[axis]), v[axis]);
                half_v[axis] = pair.r[axis].mul_add(L::splat(token, half[axis]), half_v[axis]);
            }
        }
        [
            Self {
                vector: v,
                normal: D::dot(&v, &pair.n),
            },
            Self {
                vector: half_v,
                normal: D::dot(&half_v, &pair.n),
            },
        ]
    }
}

/// R_i ω_i + R_j ω_j = R_i (ω_i - ω_j) + (R_i + R_j) ω_j.
#[inline(always)]
fn spin_sum<D: Dimension, L: Lanes>(
    token: L::Token,
    of_difference: &[Lanes16],
    of_j: &[Lanes16],
    sum: L,
    r_i: L,
) -> [L; 3] {
    let of_difference = vector::<L>(token, of_difference, D::SPINS);
    let of_j = vector::<L>(token, of_j, D::SPINS);
    scaled_sum(r_i, &of_difference, &scaled(&of_j, sum))
}

/// The motion of sixteen pairs in the half step. It belongs to the tangent plane of the half step,
/// when r was r - ½Δt v, and slips must be brought into that of the full step: otherwise F_t^e
/// would be of first order if n turns.
struct HalfStep<L> {
    /// v - v_n n (m/s), with n of the full step. With that of the half step only the length of r
    /// differs, by `longer`, because v × v = 0.
    tangential: [L; 3],
    /// |r|/|r - ½Δt v|.
    longer: L,
    /// ½Δt/|r| (s/m): times `tangential` and `longer` the angle of n since the half step.
    per_distance: L,
}

impl<L: Lanes> HalfStep<L> {
    #[inline(always)]
    fn new<D: Dimension>(
        token: L::Token,
        step: L,
        pair: &Separation<L>,
        half_v: &Velocity<L>,
    ) -> Self {
        let per_distance = L::splat(token, 0.5) * step * pair.per_distance;
        Self {
            tangential: D::tangential_part(&pair.n, &half_v.vector, half_v.normal),
            longer: per_distance.mul_add(half_v.normal, L::splat(token, 1.0)),
            per_distance,
        }
    }
}

/// ½(ω_i + ω_j) = ½(ω_i - ω_j) + ω_j.
#[inline(always)]
fn mean_spin<L: Lanes>(token: L::Token, of_difference: &[Lanes16], of_j: &[Lanes16]) -> [L; 3] {
    let half = L::splat(token, 0.5);
    let difference = vector::<L>(token, of_difference, 3);
    let of_j = vector::<L>(token, of_j, 3);
    scaled_sum(half, &difference, &of_j)
}

/// How sixteen pairs of spheres have turned in a step: n, and about n the two grains, by the mean
/// of their rotations. Without the latter the force would not turn with a pair that turns as a
/// rigid body, and the stress would be no tensor (M. R. Kuhn, K. Suzuki and A. Daouadji, Granular
/// Matter 22, 2020).
struct Turn<L> {
    n: [L; 3],
    /// n of the half step, n - τ with τ = ½Δt v_t/|r|.
    half_n: [L; 3],
    /// The angle φ about it, and half of it.
    twist: L,
    half_twist: L,
}

impl<L: Lanes> Turn<L> {
    /// `mean`: ½(ω_i + ω_j) of the half step.
    #[inline(always)]
    fn new(token: L::Token, n: &[L; 3], half: &HalfStep<L>, (step, mean): (L, &[L; 3])) -> Self {
        let angle = half.per_distance * half.longer;
        let half_n = Three::tangential_part(&half.tangential, n, angle);
        let twist = step * Three::dot(mean, &half_n);
        Self {
            n: *n,
            half_n,
            twist,
            half_twist: L::splat(token, 0.5) * twist,
        }
    }

    /// Rotates a vector u of the last tangent plane into this one: with p = u·n it becomes u - p (n
    /// - τ), then u + φ n × u - ½φ² u. The lengths are that of u to third order in the angles.
    #[inline(always)]
    fn of_step(&self, token: L::Token, vectors: &mut [Lanes16]) {
        let u = vector::<L>(token, vectors, 3);
        let across = Three::surface_velocity(&self.n, &u);
        let u = Three::tangential_part(&self.half_n, &u, Three::dot(&u, &self.n));
        let shorter = (-self.half_twist).mul_add(self.twist, L::splat(token, 1.0));
        for k in 0..3 {
            let turned = self.twist.mul_add(across[k], shorter * u[k]);
            turned.store(&mut vectors[k]);
        }
    }

    /// The slip (m/s) in the tangent plane of the full step, from v and s = R_i ω_i + R_j ω_j of
    /// the half step.
    ///
    /// The spins, too, are rotated from that plane into this one: a part of the twist becomes
    /// tangential, ½Δt/|r| (n·s) n × v. About n the slip v_t + n × s turns by ½φ, so ½φ (n × v -
    /// s_t) is added.
    #[inline(always)]
    fn slip(&self, half: &HalfStep<L>, v: &[L; 3], s: &[L; 3]) -> [L; 3] {
        let along = Three::dot(&self.n, s);
        let twist = half.per_distance.mul_add(along, self.half_twist);
        let across = Three::tangential_part(&self.n, s, along);
        let slip = Three::surface_velocity(&self.n, &scaled_sum(twist, v, s));
        let straight = scaled_sum(half.longer, &half.tangential, &slip);
        scaled_sum(-self.half_twist, &across, &straight)
    }

    /// Rotates a vector of this plane that was made in the half step by ½φ.
    #[inline(always)]
    fn of_half_step(&self, u: &[L; 3]) -> [L; 3] {
        scaled_sum(self.half_twist, &Three::surface_velocity(&self.n, u), u)
    }

    /// Sets the rolling motion from ω_i - ω_j of the full and of the half step. The latter, w,
    /// turns from the plane of the half step into this one: w·n becomes w·(n - τ), and a part of
    /// the twist becomes tangential, τ (n·w).
    #[inline(always)]
    fn rolling(&self, [full, half]: [[L; 3]; 2], (step, shift): (L, L), turning: &mut Turning) {
        let along = Three::dot(&full, &self.n);
        let across = Three::tangential_part(&self.n, &full, along);
        store_vector(&across, &mut turning.velocity, 3);
        along.store(&mut turning.velocity[3]);
        let across = Three::tangential_part(&self.half_n, &half, Three::dot(&half, &self.n));
        let [x, y, z] = self.of_half_step(&across);
        let along = Three::dot(&half, &self.half_n);
        for (k, part) in [x, y, z, along].into_iter().enumerate() {
            let rounded = part.mul_add(step, shift) - shift;
            rounded.store(&mut turning.increment[k]);
        }
    }
}

/// Finds which pairs JKR adhesion holds together, and sets their overlaps to those of Hertz'
/// contacts of the same radii. `before`, `touching`: those that were held a step ago, and those
/// that overlap. Also returns the overlap since the jump: of pairs that have opened, beyond the
/// pull-off.
#[inline(always)]
fn adhere<L: Lanes>(
    token: L::Token,
    jkr: &Jkr,
    (overlap, reduced): (L, L),
    [before, touching]: [u16; 2],
    motion: &mut PairMotion,
    has_increment: bool,
) -> (u16, L) {
    let depth = jkr.depth(token, reduced);
    let beyond = depth.mul_add(L::splat(token, 1.0 / 3.0), overlap);
    let held = beyond.greater(L::splat(token, 0.0)).bits() & before;
    let acts = L::mask(token, before | touching);
    let hertzian = jkr.hertzian(token, depth, overlap);
    hertzian.select(acts, overlap).store(&mut motion.overlap);
    if has_increment {
        let increment = L::load(token, &motion.normal_increment);
        let earlier = jkr.hertzian(token, depth, overlap + increment);
        (earlier - hertzian).store(&mut motion.normal_increment);
    }
    let opened = L::mask(token, before & !held);
    (held | touching, beyond.select(opened, overlap))
}

/// Corrects the motion of pairs of block k that touch for the first time, and notes the factors of
/// damping and attraction of those and of pairs that have opened. `since_jump`: the overlap since
/// then (m); `approach`: -v_n Δt (m). With JKR adhesion (`all_jumps`) the factors are those of all
/// forces.
#[cold]
fn correct_jumps(
    (k, [new, opened]): (usize, [u16; 2]),
    [since_jump, approach]: [Lanes16; 2],
    (motion, turning): (&mut PairMotion, &mut Turning),
    [mut touched, mut jumps]: [Option<&mut Vec<Jump>>; 2],
    all_jumps: bool,
) {
    for lane in (0..LANES).filter(|lane| (new | opened) >> lane & 1 == 1) {
        let [overlap, approach] = [since_jump.0[lane], approach.0[lane]];
        let factor = if new >> lane & 1 == 1 {
            let part = overlap / approach;
            first_touch((motion, turning), lane, part, all_jumps)
        } else {
            let open = part_open(overlap, approach);
            if all_jumps {
                scale_increments((motion, turning), lane, 1.0 - open);
            }
            0.5 - open
        };
        let touched = touched.as_mut().filter(|_| new >> lane & 1 == 1);
        for to in [touched, jumps.as_mut()].into_iter().flatten() {
            to.push((k, lane, factor));
        }
    }
}

/// Corrects the motion of one lane in the step in which a pair comes to touch, for a `part` of it.
/// Returns the factor of the damping, by which velocities are scaled unless `all_jumps`.
///
/// The pair touches for a part θ = δ/(-v_n Δt) of the step only, so the increments are scaled by θ.
/// The kicks by this force cover the time from t-½Δt to t+½Δt. The pair touches during ½+θ of it,
/// so the damping, which begins with a jump, is scaled by ½+θ. Without these corrections an impact
/// would be of first order in Δt.
fn first_touch(
    (motion, turning): (&mut PairMotion, &mut Turning),
    lane: usize,
    part: f64,
    all_jumps: bool,
) -> f64 {
    scale_increments((motion, turning), lane, part);
    let factor = 0.5 + part;
    if !all_jumps {
        motion.normal_velocity.0[lane] *= factor;
        for lanes in &mut motion.tangential_velocity {
            lanes.0[lane] *= factor;
        }
        motion.rolling_velocity.0[lane] *= factor;
    }
    factor
}

/// Scales the increments of a lane to a part of the step. The torques of spheres begin at 0, so
/// their velocities remain.
fn scale_increments((motion, turning): (&mut PairMotion, &mut Turning), lane: usize, part: f64) {
    for lanes in motion
        .tangential_increment
        .iter_mut()
        .chain(&mut turning.increment)
    {
        lanes.0[lane] *= part;
    }
    motion.rolling_increment.0[lane] *= part;
}

/// The part of the first step without touch in which the pair no longer touches. The kick of the
/// step before stands for half of it, so of the attraction ½ less this part is left. `approach` is
/// -v_n Δt (m).
fn part_open(overlap: f64, approach: f64) -> f64 {
    // Otherwise rounding opened the pair, or nothing moved.
    if approach < overlap {
        overlap / approach
    } else {
        1.0
    }
}
