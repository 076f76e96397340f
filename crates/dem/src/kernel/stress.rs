//! The stress of the contacts on planes across the last axis.

use super::ContactForces;
use super::motion::Separation;
use crate::dimension::Dimension;
use crate::domain::{Accumulator, FixedPoint};
use crate::simd::{Lanes, Lanes16, Work};
use crate::state::{Cell, Contacts};

/// Adds Σ F r_z/h along the last axis and along x to two sums, over the contacts whose first grain
/// this rank owns, with the height h of the cell.
pub(crate) struct PlaneStress<'a, D: Dimension> {
    /// The records of all local grains.
    pub record: &'a [D::Record],
    /// Their contacts.
    pub contacts: &'a Contacts,
    /// The forces of these.
    pub samples: &'a ContactForces,
    /// The cell.
    pub cell: &'a Cell,
    /// How forces are summed.
    pub fixed: &'a FixedPoint,
    /// Along the last axis, along x.
    pub to: [&'a mut Accumulator; 2],
}

impl<D: Dimension> Work for PlaneStress<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let Self {
            record,
            contacts,
            samples,
            cell,
            fixed,
            to: [up, along],
        } = self;
        let height = cell.sheared.map_or(f64::INFINITY, |of| of.height);
        let per_height = L::splat(token, 1.0 / height);
        let (mut difference, mut of_j) = (D::NO_FIELDS, [Lanes16::ZERO; 8]);
        let mut share = 0;
        for block in 0..contacts.owned_blocks {
            let mut touching = contacts.touching[block];
            // Those of a share count its grains from its first one.
            while (contacts.shares.get(share)).is_some_and(|of| block >= of.blocks.end) {
                share += 1;
            }
            let first = contacts.shares.get(share).map_or(0, |of| of.grains.start);
            if touching == 0 {
                continue;
            }
            let records = &record[first..];
            D::load::<L, false>(
                token,
                records,
                &contacts.pairs,
                block,
                &mut difference,
                &mut of_j,
            );
            let sum = L::load(token, &contacts.geometry[block][0]);
            let pair = Separation::<L>::new::<D>(token, cell, difference.as_ref(), sum);
            let normal = L::load(token, &samples.normal[block]);
            let mut tangential = [normal; 3];
            for k in 0..D::SPINS {
                tangential[k] = L::load(token, &samples.tangential[block][k]);
            }
            let force = D::force(&pair.n, normal, &tangential);
            let way = pair.r[D::UP] * per_height;
            let of_block = [
                (way * force[D::UP]).to_lanes16(),
                (way * force[0]).to_lanes16(),
            ];
            while touching != 0 {
                let lane = touching.trailing_zeros() as usize;
                touching &= touching - 1;
                fixed.add(up, of_block[0].0[lane]);
                fixed.add(along, of_block[1].0[lane]);
            }
        }
    }
}
