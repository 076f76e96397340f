//! The ledger of energy: what was done on the contacts and what they lost, step by step. Whole multiples of one unit, so that the
//! sums do not depend on ranks or threads.

use serde::{Deserialize, Serialize};

use crate::contact::{ContactLaw, loss};
use crate::domain::{Accumulator, Exchange, FixedPoint, LIMBS};
use crate::simd::{LANES, Lanes, Level, Row, Work};
use crate::state::{Contacts, ForceUnit};

/// Kinds of elastic energy: normal, tangential, rolling.
const ELASTIC: usize = 3;

/// This rank's part, since the shear began.
#[derive(Debug, Clone)]
pub struct Ledger {
    unit: f64,
    force_unit: f64,
    /// Twice the sums over the steps, of the first one half, of what was lost and of the force against the imposed motion.
    twice_lost: [i128; loss::KINDS],
    last_lost: [i128; loss::KINDS],
    twice_pull: i128,
    last_pull: i64,
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
    twice_pull: String,
    begin: Option<Begin>,
}

/// The ledger of all ranks at a time (J/m).
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    pub elastic: [f64; ELASTIC],
    pub work_drive: f64,
    pub work_load: f64,
    pub lost: [f64; loss::KINDS],
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
    pub fn new(unit: ForceUnit, largest_radius: f64) -> Self {
        // Of forces F in units of 2^-50 F_max, a contact's losses F v Δt in a step are counted up to 2^-9 F_max R.
        let radius = f64::from_bits(largest_radius.to_bits() & 0x7ff << 52);
        Self {
            unit: unit.force * radius * 2f64.powi(-10),
            force_unit: unit.force,
            twice_lost: [0; loss::KINDS],
            last_lost: [0; loss::KINDS],
            twice_pull: 0,
            last_pull: 0,
            begin: None,
        }
    }

    /// Of energies (J/m).
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// A step: what its contacts lost, and the force against the imposed motion.
    pub fn step(&mut self, lost: [i128; loss::KINDS], pull: i64) {
        for (sum, more) in self.twice_lost.iter_mut().zip(lost) {
            *sum += 2 * more;
        }
        self.last_lost = lost;
        self.twice_pull += 2 * i128::from(pull);
        self.last_pull = pull;
    }

    /// The ledger goes on from a checkpoint: `rank` 0 with all of it.
    pub fn resume(&mut self, kept: &Kept, rank: usize) {
        let number = |text: &String| text.parse::<i128>().unwrap_or(0);
        if rank == 0 {
            self.twice_lost = std::array::from_fn(|k| number(&kept.twice_lost[k]));
            self.twice_pull = number(&kept.twice_pull);
        }
        self.begin = kept.begin;
    }

    /// For a checkpoint; collective.
    pub fn keep(&self, exchange: &impl Exchange) -> Kept {
        let [lost @ .., pull] = sums(exchange, self.sums([0; loss::KINDS + 1]));
        Kept {
            twice_lost: lost.map(|n| n.to_string()),
            twice_pull: pull.to_string(),
            begin: self.begin,
        }
    }

    /// Twice what was lost, and the force against the motion, less something of each.
    fn sums(&self, less: [i128; loss::KINDS + 1]) -> [i128; loss::KINDS + 1] {
        let [lost @ .., pull] = less;
        let mut all = [self.twice_pull - pull; loss::KINDS + 1];
        for ((sum, twice), less) in all.iter_mut().zip(self.twice_lost).zip(lost) {
            *sum = twice - less;
        }
        all
    }

    /// The ledger of all ranks now; collective. `speed`: imposed on the top (m/s), `step` Δt (s), `load` N (N/m), `height` of the
    /// piston (m), `kinetic` energy of all that moves freely (J/m).
    #[expect(clippy::too_many_arguments, reason = "the state of the sample, once")]
    pub fn entry<C: ContactLaw>(
        &mut self,
        exchange: &impl Exchange,
        level: Level,
        law: &C,
        contacts: &Contacts,
        overlap: &[Row],
        speed: f64,
        step: f64,
        load: f64,
        height: f64,
        kinetic: f64,
    ) -> Entry {
        // Elastic energies are greater than the losses of a step.
        let elastic_unit = FixedPoint::new(self.unit * 2f64.powi(20));
        let mut elastic = [Accumulator::default(); ELASTIC];
        level.run(Elastic {
            law,
            contacts,
            overlap,
            unit: elastic_unit,
            sums: &mut elastic,
        });
        let elastic = elastic_unit.total(exchange, elastic);
        let energy = kinetic + elastic.iter().sum::<f64>();
        let begin = *self.begin.get_or_insert_with(|| {
            self.twice_lost = self.last_lost;
            self.twice_pull = self.last_pull.into();
            Begin { energy, height }
        });
        // Trapezoids: of the last step half.
        let mut last = [i128::from(self.last_pull); loss::KINDS + 1];
        last[..loss::KINDS].copy_from_slice(&self.last_lost);
        let [lost @ .., pull] = sums(exchange, self.sums(last)).map(|n| 0.5 * n as f64);
        let lost = lost.map(|n| n * self.unit);
        let work_drive = pull * self.force_unit * speed * step;
        let work_load = -load * (height - begin.height);
        let missing = work_drive + work_load - (energy - begin.energy) - lost.iter().sum::<f64>();
        let done = work_drive.abs() + work_load.abs();
        Entry {
            elastic,
            work_drive,
            work_load,
            lost,
            residual: if done > 0.0 { missing / done } else { 0.0 },
        }
    }
}

/// Sums over the ranks.
fn sums<const K: usize>(exchange: &impl Exchange, numbers: [i128; K]) -> [i128; K] {
    let mut message = vec![0i64; K * (LIMBS + 1)];
    for (&number, limbs) in numbers.iter().zip(message.chunks_mut(LIMBS + 1)) {
        Accumulator::from(number).write(limbs);
    }
    exchange.sum(&mut message);
    std::array::from_fn(|k| Accumulator::read(&message[k * (LIMBS + 1)..]).into())
}

/// Elastic energies of the contacts of which this rank owns i.
struct Elastic<'a, C> {
    law: &'a C,
    contacts: &'a Contacts,
    /// δ (m) of every block.
    overlap: &'a [Row],
    unit: FixedPoint,
    sums: &'a mut [Accumulator; ELASTIC],
}

impl<C: ContactLaw> Work for Elastic<'_, C> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, token: L::Token) {
        let contacts = self.contacts;
        for block in 0..contacts.mine {
            let parameters = &contacts.parameters[block * C::PARAMETERS..][..C::PARAMETERS];
            let history = &contacts.history[block * C::HISTORY..][..C::HISTORY];
            let overlap = L::load(token, &self.overlap[block]);
            let energies = self
                .law
                .elastic_energies(token, parameters, overlap, history);
            for (sum, energy) in self.sums.iter_mut().zip(energies) {
                let row: Row = energy.to_row();
                for lane in (0..LANES).filter(|lane| contacts.touching[block] >> lane & 1 == 1) {
                    self.unit.add(sum, row.0[lane]);
                }
            }
        }
    }
}
