//! The ledger of energy: what was done on the contacts and what they lost, step by step. Whole multiples of one unit, so that the
//! sums do not depend on ranks or threads.

use serde::{Deserialize, Serialize};

use crate::contact::loss;
use crate::contact::model::PairModel;
use crate::domain::{Accumulator, Exchange, FixedPoint, LIMBS};
use crate::simd::{LANES, Level, Row};
use crate::state::{Contacts, Units};

/// Kinds of elastic energy: normal, tangential, rolling.
const ELASTIC: usize = 3;

/// This rank's part, since the shear began.
#[derive(Debug, Clone)]
pub struct Ledger {
    unit: f64,
    /// Twice the sums over the steps of what was lost, of the power of dampers at the first end of the shear half.
    twice_lost: [i128; loss::KINDS],
    /// The power of dampers at the end of the last step, times Δt; 0 of other losses.
    last_power: [i128; loss::KINDS],
    /// Something was too great to be counted.
    uncounted: bool,
    /// Of all ranks: the work done along x on the sample, and the force that did it last.
    work: f64,
    force: f64,
    /// As the shear began; `None` until then.
    pub begin: Option<Begin>,
}

/// The sample as the shear began.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Begin {
    /// Kinetic and elastic energy (J/m).
    pub energy: f64,
    /// Height of the piston (m).
    pub height: f64,
}

/// What a checkpoint keeps of all ranks' ledgers, numbers in decimal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    twice_lost: [String; loss::KINDS],
    uncounted: bool,
    work: f64,
    force: f64,
    begin: Option<Begin>,
}

/// The ledger of all ranks at a time (J/m).
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// Elastic energies of the contacts: normal, tangential, rolling.
    pub elastic: [f64; ELASTIC],
    /// Work of the drive along x.
    pub work_drive: f64,
    /// Work of the load on the top.
    pub work_load: f64,
    /// Energy dissipated, by [`loss`].
    pub lost: [f64; loss::KINDS],
    /// Work that is not found in the energies, over the sum of both works' magnitudes.
    pub residual: f64,
}

impl Entry {
    /// Where no ledger is kept.
    pub const NONE: Self = Self {
        elastic: [f64::NAN; ELASTIC],
        work_drive: f64::NAN,
        work_load: f64::NAN,
        lost: [f64::NAN; loss::KINDS],
        residual: f64::NAN,
    };
}

impl Ledger {
    /// `largest_radius` in m.
    pub fn new(units: Units, largest_radius: f64) -> Self {
        // Far below what a contact loses in a step even where it creeps: what is below half a unit is never counted. 2^-76 F_max R.
        let radius = f64::from_bits(largest_radius.to_bits() & 0x7ff << 52);
        Self {
            unit: units.force * radius * 2f64.powi(-26),
            twice_lost: [0; loss::KINDS],
            last_power: [0; loss::KINDS],
            uncounted: false,
            work: 0.0,
            force: 0.0,
            begin: None,
        }
    }

    /// Of energies (J/m).
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// A step: what this rank's contacts lost. `uncounted`: some of it was too great to be counted.
    pub fn step(&mut self, lost: [i128; loss::KINDS], uncounted: bool) {
        for (sum, more) in self.twice_lost.iter_mut().zip(lost) {
            *sum += 2 * more;
        }
        self.last_power[loss::DAMPING] = lost[loss::DAMPING];
        self.uncounted |= uncounted;
    }

    /// The same step: the force on the sample along x, of all ranks, and how far it moved the top (m).
    pub fn push(&mut self, force: f64, slid: f64) {
        self.work += 0.5 * (self.force + force) * slid;
        self.force = force;
    }

    /// The ledger goes on from a checkpoint: `rank` 0 with all that is summed over the ranks.
    pub fn resume(&mut self, kept: &Kept, rank: usize) {
        let number = |text: &String| text.parse::<i128>().unwrap_or(0);
        if rank == 0 {
            self.twice_lost = std::array::from_fn(|k| number(&kept.twice_lost[k]));
            self.uncounted = kept.uncounted;
        }
        (self.work, self.force, self.begin) = (kept.work, kept.force, kept.begin);
    }

    /// For a checkpoint; collective.
    pub fn keep(&self, exchange: &dyn Exchange) -> Kept {
        let (lost, uncounted) = self.sums(exchange, [0; loss::KINDS]);
        Kept {
            twice_lost: lost.map(|n| n.to_string()),
            uncounted,
            work: self.work,
            force: self.force,
            begin: self.begin,
        }
    }

    /// Twice what was lost on all ranks, less something, and whether anything was too great to be counted; collective.
    fn sums(
        &self,
        exchange: &dyn Exchange,
        less: [i128; loss::KINDS],
    ) -> ([i128; loss::KINDS], bool) {
        const PART: usize = LIMBS + 1;
        let mut message = [0i64; loss::KINDS * PART + 1];
        for (k, (twice, less)) in self.twice_lost.iter().zip(less).enumerate() {
            Accumulator::from(twice - less).write(&mut message[k * PART..(k + 1) * PART]);
        }
        message[loss::KINDS * PART] = self.uncounted.into();
        exchange.sum(&mut message);
        let lost = |k: usize| Accumulator::read(&message[k * PART..(k + 1) * PART]).into();
        (std::array::from_fn(lost), message[loss::KINDS * PART] > 0)
    }

    /// The ledger of all ranks now; collective.
    pub fn entry(
        &mut self,
        exchange: &dyn Exchange,
        level: Level,
        law: &dyn PairModel,
        of: Sample<'_>,
    ) -> Entry {
        // Elastic energies are greater than the losses of a step.
        let elastic_unit = FixedPoint::new(self.unit * 2f64.powi(36));
        let mut elastic = [Accumulator::default(); ELASTIC];
        add_elastic(level, law, &of, elastic_unit, &mut elastic);
        let elastic = elastic_unit.total(exchange, elastic);
        let energy = of.kinetic + elastic.iter().sum::<f64>();
        let begin = *self.begin.get_or_insert_with(|| {
            self.twice_lost = self.last_power;
            self.work = 0.0;
            Begin {
                energy,
                height: of.height,
            }
        });
        // Of a power trapezoids: at the last end half.
        let (lost, uncounted) = self.sums(exchange, self.last_power);
        let lost = lost.map(|n| match uncounted {
            true => f64::NAN,
            false => 0.5 * n as f64 * self.unit,
        });
        let work_load = -of.load * (of.height - begin.height);
        let missing = self.work + work_load - (energy - begin.energy) - lost.iter().sum::<f64>();
        let done = self.work.abs() + work_load.abs();
        Entry {
            elastic,
            work_drive: self.work,
            work_load,
            lost,
            residual: if done > 0.0 { missing / done } else { 0.0 },
        }
    }
}

/// What the ledger looks at.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// The contacts of this rank.
    pub contacts: &'a Contacts,
    /// δ (m) of every block.
    pub overlap: &'a [Row],
    /// N.
    pub load: f64,
    /// Of the piston (m).
    pub height: f64,
    /// Energy of all that moves freely upwards or in all directions.
    pub kinetic: f64,
}

/// Adds the elastic energies of the contacts whose first grain this rank owns.
fn add_elastic(
    level: Level,
    law: &dyn PairModel,
    of: &Sample<'_>,
    unit: FixedPoint,
    sums: &mut [Accumulator; ELASTIC],
) {
    let contacts = of.contacts;
    let owned = contacts.mine;
    let mut energies = vec![[Row::ZERO; ELASTIC]; owned];
    law.energies(
        level,
        &contacts.parameters,
        &contacts.history,
        of.overlap,
        &mut energies,
    );
    for (energies, touching) in energies.iter().zip(&contacts.touching) {
        for (sum, row) in sums.iter_mut().zip(energies) {
            for lane in (0..LANES).filter(|lane| touching >> lane & 1 == 1) {
                unit.add(sum, row.0[lane]);
            }
        }
    }
}
