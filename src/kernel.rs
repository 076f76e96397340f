//! The loop over the contacts, for any law, eight pairs at a time.
//!
//! What contract 1 rests on: every pair is evaluated in one orientation from the wrapped coordinates of its two grains,
//! and the forces of a block are added to the grains one contact after the other, in list order.

use crate::contact::{ContactLaw, Motion, Response};
use crate::simd::{LANES, Lanes, Level, Mask, Row, Work};
use crate::state::{Contacts, Force, field};

/// What only frames and time series want of the contacts; rows per block as in [`Contacts`].
#[derive(Debug, Default)]
pub struct ContactForces {
    pub normal: Vec<Row>,
    pub tangential: Vec<Row>,
    pub overlap: Vec<Row>,
    /// Lanes at the Coulomb limit.
    pub sliding: Vec<u8>,
}

/// Forces of one pass over the contacts.
pub struct Pass<'a> {
    pub record: &'a [Row],
    /// Added to.
    pub force: &'a mut [Force],
    pub contacts: &'a mut Contacts,
    /// L_x (m).
    pub length: f64,
    /// Δt (s); 0 evaluates the forces without advancing the histories.
    pub step: f64,
    /// Filled where given.
    pub samples: Option<&'a mut ContactForces>,
}

/// Adds the contact forces to the grains. Returns a pair (block, lane) whose overlap is outside the law, if there is one.
pub fn contact_forces<C: ContactLaw>(
    level: Level,
    law: &C,
    mut pass: Pass<'_>,
) -> Option<(usize, usize)> {
    match pass.samples.take() {
        Some(samples) => {
            let blocks = pass.contacts.i.len();
            for rows in [
                &mut samples.normal,
                &mut samples.tangential,
                &mut samples.overlap,
            ] {
                rows.clear();
                rows.resize(blocks, Row::ZERO);
            }
            samples.sliding.clear();
            samples.sliding.resize(blocks, 0);
            level.run(Blocks::<C, true> {
                law,
                pass: &mut pass,
                samples,
            })
        }
        None => level.run(Blocks::<C, false> {
            law,
            pass: &mut pass,
            samples: &mut ContactForces::default(),
        }),
    }
}

/// One pass over all blocks.
struct Blocks<'a, 'b, C, const SAMPLE: bool> {
    law: &'a C,
    pass: &'a mut Pass<'b>,
    samples: &'a mut ContactForces,
}

impl<C: ContactLaw, const SAMPLE: bool> Work for Blocks<'_, '_, C, SAMPLE> {
    type Output = Option<(usize, usize)>;

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) -> Self::Output {
        blocks::<L, C, SAMPLE>(token, self.law, self.pass, self.samples)
    }
}

#[inline(always)]
fn blocks<L: Lanes, C: ContactLaw, const SAMPLE: bool>(
    token: L::Token,
    law: &C,
    pass: &mut Pass<'_>,
    samples: &mut ContactForces,
) -> Option<(usize, usize)> {
    let c = |v| L::splat(token, v);
    let (length, per_length) = (c(pass.length), c(1.0 / pass.length));
    let step = c(pass.step);
    let contacts = &mut *pass.contacts;
    let record = pass.record;
    let force = &mut *pass.force;
    let mut outside = None;

    for block in 0..contacts.i.len() {
        let (i, j) = (&contacts.i[block], &contacts.j[block]);
        let d = L::differences(token, record, i, j);
        let dx = (-(d[field::X] * per_length).round()).mul_add(length, d[field::X]);
        let dy = d[field::Y];
        let distance = dx.mul_add(dx, dy * dy).sqrt();
        let [sum, r_i] = &contacts.geometry[block];
        let (sum, r_i) = (L::load(token, sum), L::load(token, r_i));
        let overlap = sum - distance;
        let touching = overlap.greater(c(0.0));
        let history = &mut contacts.history[block * C::HISTORY..(block + 1) * C::HISTORY];
        let bits = touching.bits();
        if bits == 0 {
            if contacts.touching[block] != 0 {
                history.fill(Row::ZERO);
                contacts.touching[block] = 0;
            }
            continue;
        }
        contacts.touching[block] = bits;

        let per_distance = c(1.0) / distance;
        let (n_x, n_y) = (dx * per_distance, dy * per_distance);
        let mut motion = Motion {
            overlap,
            normal_velocity: d[field::U].mul_add(n_x, d[field::V] * n_y),
            tangential_velocity: c(0.0),
            tangential_increment: c(0.0),
            rolling_velocity: c(0.0),
            rolling_increment: c(0.0),
        };
        if C::FRICTION {
            // v_t = (v_i - v_j)·t̂ - (R_i ω_i + R_j ω_j), and R_i ω_i + R_j ω_j = R_i (ω_i - ω_j) + (R_i + R_j) ω_j
            let across = |u: L, v: L| v.mul_add(n_x, -(u * n_y));
            let turning = |w: L, w_j: L| r_i.mul_add(w, sum * w_j);
            let w_j = L::gather(token, record, j, field::W);
            let half_w_j = L::gather(token, record, j, field::HALF_W);
            motion.tangential_velocity =
                across(d[field::U], d[field::V]) - turning(d[field::W], w_j);
            // The half-step velocity belongs to t̂ of the half step, when r was r - ½Δt v. As v × v = 0, only the length
            // of r differs: (v·t̂)(t+½Δt) = (v·t̂) |r|/|r - ½Δt v|. Left out, F_t^e would be of first order where n turns.
            let (half_u, half_v) = (d[field::HALF_U], d[field::HALF_V]);
            let half_normal = half_u.mul_add(n_x, half_v * n_y);
            let longer = (c(0.5) * step * per_distance).mul_add(half_normal, c(1.0));
            motion.tangential_increment =
                across(half_u, half_v).mul_add(longer, -turning(d[field::HALF_W], half_w_j)) * step;
        }
        if C::ROLLING {
            motion.rolling_velocity = d[field::W];
            motion.rolling_increment = d[field::HALF_W] * step;
        }

        let parameters = &contacts.parameters[block * C::PARAMETERS..(block + 1) * C::PARAMETERS];
        let Response {
            normal,
            tangential,
            rolling,
            sliding,
            beyond,
        } = law.evaluate(token, parameters, history, motion, touching);
        if beyond.bits() != 0 && outside.is_none() {
            outside = Some((block, beyond.bits().trailing_zeros() as usize));
        }
        if SAMPLE {
            normal.store(&mut samples.normal[block]);
            tangential.store(&mut samples.tangential[block]);
            overlap.store(&mut samples.overlap[block]);
            samples.sliding[block] = sliding.bits();
        }

        let mut f = [Row::ZERO; 4];
        if C::FRICTION {
            (normal * n_x - tangential * n_y).store(&mut f[0]);
            (normal * n_y + tangential * n_x).store(&mut f[1]);
            // Torque on i: -R_i F_t + M, on j: -R_j F_t - M.
            (rolling - r_i * tangential).store(&mut f[2]);
            (-(sum - r_i) * tangential - rolling).store(&mut f[3]);
        } else {
            (normal * n_x).store(&mut f[0]);
            (normal * n_y).store(&mut f[1]);
            if C::ROLLING {
                rolling.store(&mut f[2]);
                (-rolling).store(&mut f[3]);
            }
        }
        let mut rest = bits;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % LANES;
            rest &= rest - 1;
            let (fx, fy) = (f[0].0[lane], f[1].0[lane]);
            let on_i = &mut force[i[lane] as usize];
            on_i[0] += fx;
            on_i[1] += fy;
            on_i[2] += f[2].0[lane];
            let on_j = &mut force[j[lane] as usize];
            on_j[0] -= fx;
            on_j[1] -= fy;
            on_j[2] += f[3].0[lane];
        }
    }
    outside
}
