//! The sum over the ranks at the end of a step: the forces on the walls, and what all must know.

use crate::dimension::Dimension;
use crate::domain::{Accumulator, Exchange, LIMBS};
use crate::drive::{Drive, Felt, SummedForces, WallForces, WallSums};
use crate::failure::Result;
use crate::system::System;

/// Number of flags in the message that the ranks sum.
pub(crate) const FLAGS: usize = 4;
const FORCES_AT: usize = 1 + FLAGS;
const FORCE: usize = LIMBS + 1;
/// Number of forces, at most; a sum through shared memory has few terms.
const FORCES: usize = 4;
const MESSAGE: usize = FORCES_AT + FORCES * FORCE;
/// Size of the message that the ranks sum in every step (bytes), if it has the forces on the top.
pub const MESSAGE_BYTES: usize = (FORCES_AT + 2 * FORCE) * size_of::<i64>();

/// A sum over the ranks in one message, under way: whether something failed, flags that are set if
/// they are set on some rank, and the forces on the walls.
pub(crate) struct SumOverRanks {
    message: [i64; MESSAGE],
    /// Its length: the forces that the drive does not ask for are last, and left out.
    length: usize,
    summed: SummedForces,
    failure: Option<String>,
}

impl SumOverRanks {
    /// Begins it. The forces on the walls are `load` and what the drive adds.
    pub fn begin<D: Dimension>(
        exchange: &dyn Exchange,
        system: &System<D>,
        drive: &dyn Drive<D>,
        mut load: WallSums,
        failure: Option<String>,
        flags: [bool; FLAGS],
    ) -> Self {
        let felt = Felt {
            grains: &system.grains,
            stress: system.stress,
            fixed: &system.fixed,
        };
        drive.load(&felt, &mut load);
        let mut message = [0i64; MESSAGE];
        message[0] = i64::from(failure.is_some());
        for (to, flag) in message[1..FORCES_AT].iter_mut().zip(flags) {
            *to = i64::from(flag);
        }
        let summed = drive.summed_forces();
        let others = if summed == SummedForces::OnTopAndSides {
            load.lateral
        } else {
            [load.bottom, load.bottom_along]
        };
        let sums = [load.up, load.along].into_iter().chain(others);
        for (sum, limbs) in sums.zip(message[FORCES_AT..].chunks_mut(FORCE)) {
            sum.write(limbs);
        }
        let forces = match summed {
            SummedForces::OnTop => 2,
            SummedForces::OnTopAndBottom => 3,
            SummedForces::OnTopAndBottomBothWays | SummedForces::OnTopAndSides => FORCES,
        };
        let length = FORCES_AT + forces * FORCE;
        exchange.begin_sum(&message[..length]);
        Self {
            message,
            length,
            summed,
            failure,
        }
    }

    /// Waits for it. Collective.
    ///
    /// # Errors
    /// The failure of the lowest rank that has one, or a force that is not finite.
    pub fn end<D: Dimension>(
        self,
        exchange: &dyn Exchange,
        system: &System<D>,
    ) -> Result<(WallForces, [bool; FLAGS])> {
        let Self {
            mut message,
            length,
            summed,
            failure,
        } = self;
        exchange.end_sum(&mut message[..length]);
        let force = |k: usize| {
            let limbs = &message[FORCES_AT + k * FORCE..][..FORCE];
            system.fixed.value(Accumulator::read(limbs))
        };
        let forces: [f64; FORCES] = std::array::from_fn(force);
        let [up, along, others @ ..] = forces;
        if message[0] > 0 || forces.iter().any(|force| force.is_nan()) {
            return Err(system.fail(exchange, failure));
        }
        let flags = std::array::from_fn(|k| message[1 + k] > 0);
        let mut forces = WallForces {
            up,
            along,
            ..WallForces::default()
        };
        if summed == SummedForces::OnTopAndSides {
            forces.lateral = others;
        } else {
            [forces.bottom, forces.bottom_along] = others;
        }
        Ok((forces, flags))
    }
}
