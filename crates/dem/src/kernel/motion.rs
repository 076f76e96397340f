//! The relative motion of the pairs of some blocks: how they lie to each other, how fast they
//! separate and slip, and in three dimensions how they have turned since the last step.

use std::ops::Range;

use super::{Pass, PassInput, Scratch};
use crate::contact::{
    ContactLaw, Jump, PairMotion, PairRadii, TORQUES, Turning, scaled, store_vector, vector,
};
use crate::dimension::{Dimension, Three, Vector, scaled_sum};
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
    let steps = Steps::<L>::new(token, &pass.input);
    let (adheres, is_held) = (pass.adhesion.is_some(), pass.holding().is_some());
    let contacts = &mut pass.part;
    scratch.touched.clear();
    scratch.jumps.clear();
    let blocks = scratch
        .radii
        .iter_mut()
        .zip(&mut contacts.touching[chunk.clone()])
        .zip(scratch.difference.iter().zip(&scratch.of_j))
        .zip(scratch.motion.iter_mut().zip(&mut scratch.turning))
        .zip(&mut scratch.direction)
        .zip(&mut scratch.response)
        .enumerate();
    for (k, (((((radii, touching), records), motions), direction), response)) in blocks {
        let (motion, turning) = motions;
        let records = PairRecords {
            difference: records.0.as_ref(),
            second: records.1,
        };
        let block = chunk.start + k;
        let geometry = match C::Space::RADIUS {
            Some(places) => {
                let pairs = &contacts.pairs.blocks()[contacts.first + block];
                *radii = records.radii::<L>(token, places, pairs);
                radii
            }
            None => &contacts.geometry[block],
        };
        let radii = PairRadii::<L>::load(token, geometry);
        let cell = &pass.input.cell;
        let mut pair = Separation::new::<C::Space>(token, cell, &records, radii);
        if contacts.has_feet {
            pair.keep_normals_of_walls(token);
        }
        store_vector(&pair.n, direction, C::Space::AXES);
        pair.overlap.store(&mut motion.overlap);
        let relative = Relative::new::<C::Space>(token, pair, records);
        let (pair, half_v) = (&relative.pair, &relative.half_velocity);
        relative.velocity.normal.store(&mut motion.normal_velocity);
        if C::NEEDS_LAST_OVERLAP {
            let last = pair.last_overlap::<C::Space>(token, half_v, steps.step);
            (last - pair.overlap).store(&mut motion.normal_increment);
        } else if BUDGET {
            (half_v.normal * steps.step).store(&mut motion.normal_increment);
        }
        if C::FRICTION {
            let history = &mut contacts.history[block * C::HISTORY..][..C::HISTORY];
            relative.tangential_motion::<C>(token, &steps, history, motion, turning);
        }
        if C::ROLLING && C::Space::SPINS == 1 {
            relative
                .records
                .rolling_motion::<C::Space, L>(token, &steps, motion);
        }
        let approach = -half_v.normal * steps.step;
        let before = *touching;
        let now = pair.overlap.greater(L::splat(token, 0.0)).bits();
        if before | now == 0 {
            // How far ghosts have come is not known.
            let is_inner = contacts.first + block < contacts.inner;
            contacts.asleep_until[block] = match pass.input.travelled {
                Some(travelled) if is_inner => asleep_until(motion, travelled),
                _ => 0.0,
            };
        } else {
            active = k + 1;
        }
        if is_held {
            scratch.adhesive.approach[k] = approach.to_lanes16();
            continue;
        }
        *touching = now;
        if C::LARGEST_OVERLAP < f64::INFINITY && before | now != 0 {
            response.beyond = too_deep::<C, L>(token, motion, &relative.pair.radii);
        }
        // A pair that touched a step ago overlaps by more than it has approached since.
        let touched = approach.greater(pair.overlap).bits() & now;
        let opened = if adheres { before & !now } else { 0 };
        if touched | opened != 0 {
            let jumping = Jumping {
                touched,
                formed: touched,
                opened,
                since: pair.overlap.to_lanes16(),
                approach: approach.to_lanes16(),
                all_forces: false,
            };
            let notes_touches = BUDGET || C::LIMITS_JUMP;
            let lists = JumpLists {
                touched: notes_touches.then_some(&mut scratch.touched),
                adhesion: adheres.then_some(&mut scratch.jumps),
            };
            jumping.correct(k, motion, turning, lists);
        }
    }
    active
}

/// Δt, and what rounds the increments of a step.
struct Steps<L> {
    /// Δt (s).
    step: L,
    slip_shift: L,
    rotation_shift: L,
}

impl<L: Lanes> Steps<L> {
    #[inline(always)]
    fn new(token: L::Token, input: &PassInput) -> Self {
        Self {
            step: L::splat(token, input.step),
            slip_shift: L::splat(token, Units::shift(input.units.slip)),
            rotation_shift: L::splat(token, Units::shift(Units::ROTATION)),
        }
    }

    /// The increment (m) of a velocity (m/s).
    #[inline(always)]
    fn slip(&self, velocity: L) -> L {
        velocity.mul_add(self.step, self.slip_shift) - self.slip_shift
    }

    /// The increment (rad) of an angular velocity (rad/s).
    #[inline(always)]
    fn rotation(&self, spin: L) -> L {
        spin.mul_add(self.step, self.rotation_shift) - self.rotation_shift
    }
}

/// What has been loaded of the records of sixteen pairs.
struct PairRecords<'a> {
    /// Differences of the records of i and j.
    difference: &'a [Lanes16],
    /// Of the record of j what [`Dimension::load`] gives.
    second: &'a [Lanes16; 8],
}

impl PairRecords<'_> {
    /// R_i + R_j and R_i (m) of records that have radii at these places of the difference and of
    /// the second grain, as they are in [`crate::state::Contacts::geometry`], which would have to
    /// come from memory.
    #[inline(always)]
    fn radii<L: Lanes>(&self, token: L::Token, places: [usize; 2], pairs: &Pairs) -> [Lanes16; 2] {
        let first = &self.difference[places[0]];
        let r_i = L::load(token, first);
        let r_j = L::load(token, &self.second[places[1]]);
        let mut sum = r_i + r_j;
        // A block is filled up from its end.
        if pairs.i[LANES - 1] == pairs.j[LANES - 1] {
            sum = sum.select(L::mask(token, pairs.of_two()), L::splat(token, FILLER));
        }
        [sum.to_lanes16(), *first]
    }

    /// The angular velocities of the full step.
    #[inline(always)]
    fn spins<D: Dimension>(&self) -> SpinRecords<'_> {
        SpinRecords {
            difference: &self.difference[D::SPIN..],
            second: &self.second[D::SPINS_OF_J + D::SPINS..],
        }
    }

    /// Those of the half step.
    #[inline(always)]
    fn half_spins<D: Dimension>(&self) -> SpinRecords<'_> {
        SpinRecords {
            difference: &self.difference[D::HALF_SPIN..],
            second: &self.second[D::SPINS_OF_J..],
        }
    }

    /// The rolling velocity and increment of disks.
    #[inline(always)]
    fn rolling_motion<D: Dimension, L: Lanes>(
        &self,
        token: L::Token,
        steps: &Steps<L>,
        motion: &mut PairMotion,
    ) {
        motion.rolling_velocity = self.difference[D::SPIN];
        let half = L::load(token, &self.difference[D::HALF_SPIN]);
        steps.rotation(half).store(&mut motion.rolling_increment);
    }
}

/// Angular velocities of sixteen pairs (rad/s).
struct SpinRecords<'a> {
    /// ω_i - ω_j.
    difference: &'a [Lanes16],
    /// ω_j.
    second: &'a [Lanes16],
}

impl SpinRecords<'_> {
    /// R_i ω_i + R_j ω_j = R_i (ω_i - ω_j) + (R_i + R_j) ω_j.
    #[inline(always)]
    fn surface_sum<D: Dimension, L: Lanes>(
        &self,
        token: L::Token,
        radii: &PairRadii<L>,
    ) -> Vector<L> {
        let difference = vector::<L>(token, self.difference, D::SPINS);
        let second = vector::<L>(token, self.second, D::SPINS);
        scaled_sum(radii.first, &difference, &scaled(&second, radii.sum))
    }

    /// ½(ω_i + ω_j) = ½(ω_i - ω_j) + ω_j of spheres.
    #[inline(always)]
    fn mean<L: Lanes>(&self, token: L::Token) -> Vector<L> {
        let half = L::splat(token, 0.5);
        let difference = vector::<L>(token, self.difference, 3);
        let second = vector::<L>(token, self.second, 3);
        scaled_sum(half, &difference, &second)
    }
}

/// How the grains of sixteen pairs lie and move relative to each other.
struct Relative<'a, L> {
    pair: Separation<L>,
    velocity: Velocity<L>,
    half_velocity: Velocity<L>,
    records: PairRecords<'a>,
}

impl<'a, L: Lanes> Relative<'a, L> {
    #[inline(always)]
    fn new<D: Dimension>(token: L::Token, pair: Separation<L>, records: PairRecords<'a>) -> Self {
        let difference = records.difference;
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
        Self {
            velocity: Velocity {
                vector: v,
                normal: D::dot(&v, &pair.n),
            },
            half_velocity: Velocity {
                vector: half_v,
                normal: D::dot(&half_v, &pair.n),
            },
            pair,
            records,
        }
    }

    /// Computes the tangential motion; in three dimensions rotates the histories, and computes the
    /// rolling motion.
    #[inline(always)]
    fn tangential_motion<C: ContactLaw>(
        &self,
        token: L::Token,
        steps: &Steps<L>,
        history: &mut [Lanes16],
        motion: &mut PairMotion,
        turning: &mut Turning,
    ) {
        let (pair, v, half_v) = (&self.pair, &self.velocity, &self.half_velocity);
        let spins = self.records.spins::<C::Space>();
        let half_spins = self.records.half_spins::<C::Space>();
        let s = spins.surface_sum::<C::Space, L>(token, &pair.radii);
        let half_s = half_spins.surface_sum::<C::Space, L>(token, &pair.radii);
        let rotational = C::Space::surface_velocity(&pair.n, &s);
        let tangential = C::Space::tangential_part(&pair.n, &v.vector, v.normal);
        for k in 0..C::Space::SPINS {
            (tangential[k] + rotational[k]).store(&mut motion.tangential_velocity[k]);
        }
        let half = HalfStep::new::<C::Space>(token, steps.step, pair, half_v);
        let mut slip = half.tangential;
        if C::Space::SPINS == 3 {
            let turn = Turn::new(token, pair, &half, steps.step, &half_spins.mean::<L>(token));
            if C::HISTORY >= 3 + if C::ROLLING { TORQUES } else { 0 } {
                turn.of_step(token, &mut history[..3]);
            }
            slip = turn.slip(&half, &half_v.vector, &half_s);
            if C::ROLLING {
                let first = C::HISTORY - TORQUES;
                turn.of_step(token, &mut history[first..first + 3]);
                let full = vector::<L>(token, spins.difference, 3);
                let half = vector::<L>(token, half_spins.difference, 3);
                turn.rolling(&full, &half, steps, turning);
            }
        } else {
            let rotational = C::Space::surface_velocity(&pair.n, &half_s);
            slip[0] = slip[0].mul_add(half.longer, rotational[0]);
        }
        for k in 0..C::Space::SPINS {
            steps
                .slip(slip[k])
                .store(&mut motion.tangential_increment[k]);
        }
    }
}

/// The pairs whose overlap is outside the law.
#[inline(always)]
pub(super) fn too_deep<C: ContactLaw, L: Lanes>(
    token: L::Token,
    motion: &PairMotion,
    radii: &PairRadii<L>,
) -> u16 {
    let largest = L::splat(token, 2.0 * C::LARGEST_OVERLAP) * radii.smaller();
    L::load(token, &motion.overlap).greater(largest).bits()
}

/// How far the grains will have travelled (m) when a pair of this block may touch; `travelled` is
/// how far they are now.
#[inline(always)]
fn asleep_until(motion: &PairMotion, travelled: f64) -> f64 {
    let mut gap = f64::INFINITY;
    for overlap in motion.overlap.0 {
        gap = gap.min(-overlap);
    }
    travelled + way_to_touch(gap)
}

/// How sixteen pairs lie to each other.
struct Separation<L> {
    /// From j to i (m).
    r: Vector<L>,
    n: Vector<L>,
    /// 1/|r|, by which n turns; 0 if it does not.
    per_distance: L,
    /// δ (m).
    overlap: L,
    radii: PairRadii<L>,
    /// Velocity along x of the second grain's image relative to the grain, subtracted from
    /// differences of velocities, of the full and of the half step.
    image_velocity: Option<[L; 2]>,
    stretching: Option<Stretching>,
}

impl<L: Lanes> Separation<L> {
    /// From differences of the records, by the nearest images.
    #[inline(always)]
    fn new<D: Dimension>(
        token: L::Token,
        cell: &Cell,
        records: &PairRecords<'_>,
        radii: PairRadii<L>,
    ) -> Self {
        let mut r = vector::<L>(token, &records.difference[D::POSITION..], D::AXES);
        let beyond = cell.nearest_images::<D, L>(token, &mut r);
        let (mut image_velocity, mut stretching) = (None, None);
        if let Some(sheared) = &cell.sheared {
            if let Some(images) = beyond {
                image_velocity = Some([
                    images * L::splat(token, sheared.velocity),
                    images * L::splat(token, sheared.half_velocity),
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
            overlap: radii.sum - distance,
            radii,
            image_velocity,
            stretching,
        }
    }

    /// The normals of flat walls do not turn.
    #[inline(always)]
    fn keep_normals_of_walls(&mut self, token: L::Token) {
        let none = L::splat(token, 0.0);
        self.per_distance = self.per_distance.select(self.radii.is_curved(), none);
    }

    /// The overlap a step ago (m): of the separation then, or, where n does not turn, along n.
    #[inline(always)]
    fn last_overlap<D: Dimension>(&self, token: L::Token, half_v: &Velocity<L>, step: L) -> L {
        let mut r = self.r;
        for axis in 0..D::AXES {
            r[axis] = (-step).mul_add(half_v.vector[axis], r[axis]);
        }
        let turned = self.radii.sum - distance::<D, L>(token, &r).0;
        let straight = half_v.normal.mul_add(step, self.overlap);
        let turns = self.per_distance.greater(L::splat(token, 0.0));
        turned.select(turns, straight)
    }
}

/// |r| and 1/|r|.
#[inline(always)]
fn distance<D: Dimension, L: Lanes>(token: L::Token, r: &Vector<L>) -> (L, L) {
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
    vector: Vector<L>,
    /// Along n.
    normal: L,
}

/// The motion of sixteen pairs in the half step. It belongs to the tangent plane of the half step,
/// when r was r - ½Δt v, and slips must be brought into that of the full step: otherwise F_t^e
/// would be of first order if n turns.
struct HalfStep<L> {
    /// v - v_n n (m/s), with n of the full step. With that of the half step only the length of r
    /// differs, by `longer`, because v × v = 0.
    tangential: Vector<L>,
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

/// How sixteen pairs of spheres have turned in a step: n, and about n the two grains, by the mean
/// of their rotations. Without the latter the force would not turn with a pair that turns as a
/// rigid body, and the stress would be no tensor (M. R. Kuhn, K. Suzuki and A. Daouadji, Granular
/// Matter 22, 2020).
struct Turn<L> {
    n: Vector<L>,
    /// n of the half step, n - τ with τ = ½Δt v_t/|r|.
    half_n: Vector<L>,
    /// The angle φ about it, and half of it.
    twist: L,
    half_twist: L,
}

impl<L: Lanes> Turn<L> {
    /// `mean`: ½(ω_i + ω_j) of the half step (rad/s); `step`: Δt (s).
    #[inline(always)]
    fn new(
        token: L::Token,
        pair: &Separation<L>,
        half: &HalfStep<L>,
        step: L,
        mean: &Vector<L>,
    ) -> Self {
        let angle = half.per_distance * half.longer;
        let half_n = Three::tangential_part(&half.tangential, &pair.n, angle);
        let twist = step * Three::dot(mean, &half_n);
        Self {
            n: pair.n,
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
    fn slip(&self, half: &HalfStep<L>, v: &Vector<L>, s: &Vector<L>) -> Vector<L> {
        let along = Three::dot(&self.n, s);
        let twist = half.per_distance.mul_add(along, self.half_twist);
        let across = Three::tangential_part(&self.n, s, along);
        let slip = Three::surface_velocity(&self.n, &scaled_sum(twist, v, s));
        let straight = scaled_sum(half.longer, &half.tangential, &slip);
        scaled_sum(-self.half_twist, &across, &straight)
    }

    /// Rotates a vector of this plane that was made in the half step by ½φ.
    #[inline(always)]
    fn of_half_step(&self, u: &Vector<L>) -> Vector<L> {
        scaled_sum(self.half_twist, &Three::surface_velocity(&self.n, u), u)
    }

    /// Sets the rolling motion from ω_i - ω_j of the full and of the half step. The latter, w,
    /// turns from the plane of the half step into this one: w·n becomes w·(n - τ), and a part of
    /// the twist becomes tangential, τ (n·w).
    #[inline(always)]
    fn rolling(&self, full: &Vector<L>, half: &Vector<L>, steps: &Steps<L>, turning: &mut Turning) {
        let along = Three::dot(full, &self.n);
        let across = Three::tangential_part(&self.n, full, along);
        store_vector(&across, &mut turning.velocity, 3);
        along.store(&mut turning.velocity[3]);
        let across = Three::tangential_part(&self.half_n, half, Three::dot(half, &self.n));
        let [x, y, z] = self.of_half_step(&across);
        let along = Three::dot(half, &self.half_n);
        for (k, part) in [x, y, z, along].into_iter().enumerate() {
            steps.rotation(part).store(&mut turning.increment[k]);
        }
    }
}

/// Pairs of a block whose forces jump in this step.
pub(super) struct Jumping {
    /// Those that touch for the first time.
    pub touched: u16,
    /// Those of them whose adhesion begins.
    pub formed: u16,
    /// Those whose contact has ended.
    pub opened: u16,
    /// The overlap since then (m).
    pub since: Lanes16,
    /// -v_n Δt (m).
    pub approach: Lanes16,
    /// Whether all of their forces jump, or dampers and the adhesion.
    pub all_forces: bool,
}

/// Where the pairs whose forces jump are noted, if they are wanted.
pub(super) struct JumpLists<'a> {
    /// Those that touch, with the factors of their dampers.
    pub touched: Option<&'a mut Vec<Jump>>,
    /// Those whose adhesion begins or ends, with its factors.
    pub adhesion: Option<&'a mut Vec<Jump>>,
}

impl Jumping {
    /// Corrects the motion of these pairs, which are of block k, and notes the factors of dampers
    /// of those that touch, and of the adhesion where it begins or ends; those of all forces if
    /// they all jump.
    #[cold]
    pub fn correct(
        &self,
        k: usize,
        motion: &mut PairMotion,
        turning: &mut Turning,
        lists: JumpLists<'_>,
    ) {
        let JumpLists {
            mut touched,
            mut adhesion,
        } = lists;
        for lane in 0..LANES {
            let [touches, forms, opens] =
                [self.touched, self.formed, self.opened].map(|lanes| lanes >> lane & 1 == 1);
            let factor = if touches {
                self.first_touch(lane, motion, turning)
            } else if opens {
                self.opening(lane, motion, turning)
            } else {
                continue;
            };
            let jump = Jump {
                block: k,
                lane,
                factor,
            };
            if let Some(touched) = &mut touched
                && touches
            {
                touched.push(jump);
            }
            if let Some(adhesion) = &mut adhesion
                && (forms || opens)
            {
                adhesion.push(jump);
            }
        }
    }

    /// Corrects the motion of one lane in the step in which a pair comes to touch. Returns the
    /// factor of the damping, by which velocities are scaled unless all forces jump.
    ///
    /// The pair touches for a part θ = δ/(-v_n Δt) of the step only, so the increments are scaled
    /// by θ. The kicks by this force cover the time from t-½Δt to t+½Δt. The pair touches during
    /// ½+θ of it, so the damping, which begins with a jump, is scaled by ½+θ. Without these
    /// corrections an impact would be of first order in Δt.
    fn first_touch(&self, lane: usize, motion: &mut PairMotion, turning: &mut Turning) -> f64 {
        let part = self.since.0[lane] / self.approach.0[lane];
        scale_increments(motion, turning, lane, part);
        let factor = 0.5 + part;
        if !self.all_forces {
            motion.normal_velocity.0[lane] *= factor;
            for lanes in &mut motion.tangential_velocity {
                lanes.0[lane] *= factor;
            }
            motion.rolling_velocity.0[lane] *= factor;
        }
        factor
    }

    /// Corrects the motion of one lane in the first step without contact. Returns the factor of the
    /// adhesion: the kick of the step before stands for half of this step, so ½ less the part in
    /// which the pair no longer touches is left.
    fn opening(&self, lane: usize, motion: &mut PairMotion, turning: &mut Turning) -> f64 {
        let (overlap, approach) = (self.since.0[lane], self.approach.0[lane]);
        // Otherwise rounding opened the pair, or nothing moved.
        let open = if approach < overlap {
            overlap / approach
        } else {
            1.0
        };
        if self.all_forces {
            scale_increments(motion, turning, lane, 1.0 - open);
        }
        0.5 - open
    }
}

/// Scales the increments of a lane to a part of the step. The torques of spheres begin at 0, so
/// their velocities remain.
fn scale_increments(motion: &mut PairMotion, turning: &mut Turning, lane: usize, part: f64) {
    for lanes in motion
        .tangential_increment
        .iter_mut()
        .chain(&mut turning.increment)
    {
        lanes.0[lane] *= part;
    }
    motion.rolling_increment.0[lane] *= part;
}
