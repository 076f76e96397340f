//! The energy budget: work done on the sample and energy dissipated by the contacts, step by step.
//! Energies are counted in whole multiples of one unit, so the sums do not depend on ranks or
//! threads.

use serde::{Deserialize, Serialize};

use crate::contact::dissipation;
use crate::contact::model::PairModel;
use crate::domain::{Accumulator, Exchange, FixedPoint, LIMBS};
use crate::drive::{Piston, WallForces, WallSteps};
use crate::simd::{Isa, LANES, Lanes16};
use crate::state::{Contacts, Units};

/// Kinds of elastic energy: normal, tangential, rolling.
const ELASTIC: usize = 3;

/// This rank's part of the energy budget, since the shear began.
#[derive(Debug, Clone)]
pub struct EnergyBudget {
    unit: f64,
    /// Twice the dissipated energies, summed over the steps by the trapezoidal rule: the power of
    /// dampers at the start of the shear counts half.
    twice_dissipated: [i128; dissipation::KINDS],
    /// The power of dampers at the end of the last step, times Δt, by where it counts.
    last_power: [i128; dissipation::KINDS],
    /// [`dissipation::SET_BACK_TANGENTIAL`] and that of rolling at the end of the last step.
    set_back: [i128; 2],
    /// Whether an energy was too great to be counted.
    uncounted: bool,
    /// The work done along x on the sample, and the forces along x on the sample in the last step,
    /// of the top and of a bottom that vibrates along x, over all ranks.
    work: f64,
    force: f64,
    bottom_force: f64,
    /// The work of the walls along their normals, if it is not that of a constant load.
    normal: Option<NormalWork>,
    /// The sample at the start of the shear; `None` until then.
    pub begin: Option<Begin>,
}

/// The work of the walls along their normals, summed over the steps by the trapezoidal rule, over
/// all ranks. It needs no load, so that jumps of the load and of a wall's velocity leave nothing
/// out; the kinetic energy of the top does not belong to the sample then.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct NormalWork {
    /// Work done on the sample (J; J/m in 2D).
    pub work: f64,
    /// Forces on top and bottom in the last step, upwards (N; N/m in 2D).
    pub force: [f64; 2],
    /// Forces on the sides of a cell without walls, outwards (N; N/m in 2D).
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub lateral: [f64; 2],
}

impl NormalWork {
    /// That of a constant load until now, for a run whose load begins to vary.
    pub(crate) fn of_constant_load(piston: &Piston, begin: &Begin) -> Self {
        let kinetic = 0.5 * piston.mass * piston.velocity * piston.velocity;
        Self {
            work: -piston.load * (piston.height - begin.height) - kinetic,
            force: [piston.load + piston.mass * piston.acceleration, 0.0],
            lateral: [0.0; 2],
        }
    }

    fn push(&mut self, forces: &WallForces, rose: [f64; 2], grew: [f64; 2]) {
        let walls = [forces.up, forces.bottom].into_iter().zip(rose);
        let sides = forces.lateral.into_iter().zip(grew);
        let last = self.force.iter_mut().chain(&mut self.lateral);
        for (last, (force, moved)) in last.zip(walls.chain(sides)) {
            self.work -= 0.5 * (*last + force) * moved;
            *last = force;
        }
    }
}

/// The sample at the start of the shear.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Begin {
    /// Kinetic, potential and elastic energy (J/m).
    pub energy: f64,
    /// Height of the piston (m).
    pub height: f64,
    /// Potential energy of a sample that its weight loads (J; J/m in 2D).
    #[serde(default, skip_serializing_if = "crate::drive::is_zero")]
    pub potential: f64,
    /// Gravity (m/s²). With another one, in a branch, the budget begins again.
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub gravity: [f64; 2],
    /// Energy of springs that were set back against their force, tangential and of rolling (J; J/m
    /// in 2D).
    #[serde(default, skip_serializing_if = "is_nothing")]
    pub set_back: [f64; 2],
}

fn is_nothing(numbers: &[f64; 2]) -> bool {
    *numbers == [0.0; 2]
}

/// The energy budget of all ranks in a checkpoint, numbers in decimal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedBudget {
    #[serde(alias = "twice_lost")]
    twice_dissipated: [String; dissipation::KINDS],
    uncounted: bool,
    work: f64,
    force: f64,
    #[serde(default, skip_serializing_if = "crate::drive::is_zero")]
    bottom_force: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    normal: Option<NormalWork>,
    begin: Option<Begin>,
}

impl SavedBudget {
    /// Whether the work of the walls along their normals is summed step by step.
    pub fn has_normal_work(&self) -> bool {
        self.normal.is_some()
    }

    /// Adds the work of the walls along their normals, if the run had a constant load until now.
    pub fn with_varying_load(mut self, piston: &Piston) -> Self {
        if let (None, Some(begin)) = (self.normal, &self.begin) {
            self.normal = Some(NormalWork::of_constant_load(piston, begin));
        }
        self
    }
}

/// The energies of all ranks at one step (J; J/m in 2D).
#[derive(Debug, Clone, Copy)]
pub struct EnergyBalance {
    /// Elastic energies of the contacts: normal, tangential, rolling.
    pub elastic: [f64; ELASTIC],
    /// Work of the drive along x, and of a bottom that vibrates along it.
    pub work_drive: f64,
    /// Work of the load on the top, or of the motion of the walls along their normals; below a free
    /// surface with that of gravity.
    pub work_load: f64,
    /// Energy dissipated, by [`dissipation`].
    pub dissipated: [f64; dissipation::KINDS],
    /// Work not accounted for by the energies, over the sum of both works' magnitudes.
    pub residual: f64,
}

impl EnergyBalance {
    /// The values without an energy budget: NaN.
    pub const NONE: Self = Self {
        elastic: [f64::NAN; ELASTIC],
        work_drive: f64::NAN,
        work_load: f64::NAN,
        dissipated: [f64::NAN; dissipation::KINDS],
        residual: f64::NAN,
    };
}

impl EnergyBudget {
    /// `largest_radius` in m.
    pub fn new(units: Units, largest_radius: f64) -> Self {
        // 2^-76 F_max R, far below what even a creeping contact dissipates in a step: energies
        // below half a unit are not counted.
        let radius = f64::from_bits(largest_radius.to_bits() & 0x7ff << 52);
        Self {
            unit: units.force * radius * 2f64.powi(-26),
            twice_dissipated: [0; dissipation::KINDS],
            last_power: [0; dissipation::KINDS],
            set_back: [0; 2],
            uncounted: false,
            work: 0.0,
            force: 0.0,
            bottom_force: 0.0,
            normal: None,
            begin: None,
        }
    }

    /// The unit of the counted energies (J; J/m in 2D).
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// Adds the energies that this rank's contacts dissipated in a step. `uncounted`: whether one
    /// of them was too great to be counted.
    pub fn step(&mut self, counts: [i128; dissipation::COUNTS], uncounted: bool) {
        let mut energies = [0; dissipation::KINDS];
        energies.copy_from_slice(&counts[..dissipation::KINDS]);
        self.last_power[dissipation::DAMPING] = energies[dissipation::DAMPING];
        for (kind, cut) in [
            (dissipation::FRICTION, dissipation::CUT_FRICTION),
            (dissipation::ROLLING, dissipation::CUT_ROLLING),
        ] {
            self.last_power[kind] = counts[cut];
            energies[kind] += counts[cut];
        }
        for (sum, more) in self.twice_dissipated.iter_mut().zip(energies) {
            *sum += 2 * more;
        }
        let set_back = [
            dissipation::SET_BACK_TANGENTIAL,
            dissipation::SET_BACK_ROLLING,
        ];
        self.set_back = set_back.map(|kind| counts[kind]);
        self.uncounted |= uncounted;
    }

    /// Adds the work of the walls in a step: the forces of the grains on them, summed over the
    /// ranks, and how far they moved.
    pub fn push(&mut self, forces: &WallForces, moved: WallSteps) {
        let along = -forces.along;
        self.work += 0.5 * (self.force + along) * moved.along;
        self.force = along;
        if let Some(moved) = moved.bottom_along {
            let along = -forces.bottom_along;
            self.work += 0.5 * (self.bottom_force + along) * moved;
            self.bottom_force = along;
        }
        if let Some(rose) = moved.normal {
            let normal = self.normal.get_or_insert_default();
            normal.push(forces, rose, moved.lateral);
        }
    }

    /// Whether the kinetic energy of the top belongs to the sample.
    pub(crate) fn has_wall(&self) -> bool {
        self.normal.is_none()
    }

    /// Continues from a checkpoint. Rank 0 takes the sums over the ranks.
    pub fn resume(&mut self, saved: &SavedBudget, rank: usize) {
        let number = |text: &String| text.parse::<i128>().unwrap_or(0);
        if rank == 0 {
            self.twice_dissipated = std::array::from_fn(|k| number(&saved.twice_dissipated[k]));
            self.uncounted = saved.uncounted;
        }
        (self.work, self.force, self.begin) = (saved.work, saved.force, saved.begin);
        self.bottom_force = saved.bottom_force;
        self.normal = saved.normal;
    }

    /// The energy budget of all ranks, for a checkpoint; collective.
    pub fn save(&self, exchange: &dyn Exchange) -> SavedBudget {
        let (dissipated, uncounted) = self.sums(exchange, [0; dissipation::KINDS]);
        SavedBudget {
            twice_dissipated: dissipated.map(|n| n.to_string()),
            uncounted,
            work: self.work,
            force: self.force,
            bottom_force: self.bottom_force,
            normal: self.normal,
            begin: self.begin,
        }
    }

    /// Twice the energies dissipated on all ranks minus `less`, and whether any energy was too
    /// great to be counted. Collective.
    fn sums(
        &self,
        exchange: &dyn Exchange,
        less: [i128; dissipation::KINDS],
    ) -> ([i128; dissipation::KINDS], bool) {
        const PART: usize = LIMBS + 1;
        let mut message = [0i64; dissipation::KINDS * PART + 1];
        for (k, (twice, less)) in self.twice_dissipated.iter().zip(less).enumerate() {
            Accumulator::from(twice - less).write(&mut message[k * PART..(k + 1) * PART]);
        }
        message[dissipation::KINDS * PART] = self.uncounted.into();
        exchange.sum(&mut message);
        let dissipated = |k: usize| Accumulator::read(&message[k * PART..(k + 1) * PART]).into();
        (
            std::array::from_fn(dissipated),
            message[dissipation::KINDS * PART] > 0,
        )
    }

    /// The energies of all ranks now. Collective.
    pub fn balance(
        &mut self,
        exchange: &dyn Exchange,
        isa: Isa,
        law: &dyn PairModel,
        sample: SampleState<'_>,
    ) -> EnergyBalance {
        // Elastic energies are greater than the energy dissipated in a step.
        let elastic_unit = FixedPoint::new(self.unit * 2f64.powi(36));
        let mut elastic = [Accumulator::default(); ELASTIC];
        add_elastic(isa, law, &sample, elastic_unit, &mut elastic);
        let mut set_back = [Accumulator::default(); 2];
        for (of_kind, count) in set_back.iter_mut().zip(self.set_back) {
            elastic_unit.add_whole(of_kind, count, self.unit);
        }
        let [normal, tangential, rolling] = elastic;
        let [of_tangential, of_rolling] = set_back;
        let parts = [
            normal,
            tangential.less(of_tangential),
            rolling.less(of_rolling),
            of_tangential,
            of_rolling,
        ];
        let [normal, tangential, rolling, set_back @ ..] = elastic_unit.total(exchange, parts);
        let elastic = [normal, tangential, rolling];
        let energy = sample.kinetic + elastic.iter().sum::<f64>();
        let begin = self.begin.filter(|begin| begin.gravity == sample.gravity);
        let begin = begin.unwrap_or_else(|| {
            self.twice_dissipated = self.last_power;
            self.work = 0.0;
            if let Some(normal) = &mut self.normal {
                normal.work = 0.0;
            }
            Begin {
                energy,
                height: sample.height,
                potential: sample.potential,
                gravity: sample.gravity,
                set_back,
            }
        });
        self.begin = Some(begin);
        // Trapezoidal rule: the power at the end of the last step counts half.
        let (dissipated, uncounted) = self.sums(exchange, self.last_power);
        let mut dissipated = dissipated.map(|n| {
            if uncounted {
                f64::NAN
            } else {
                0.5 * n as f64 * self.unit
            }
        });
        // The steps took it for elastic energy.
        dissipated[dissipation::FRICTION] += set_back[0] - begin.set_back[0];
        dissipated[dissipation::ROLLING] += set_back[1] - begin.set_back[1];
        let work_load = match self.normal {
            None => -sample.load * (sample.height - begin.height),
            Some(normal) => normal.work + (begin.potential - sample.potential),
        };
        let missing =
            self.work + work_load - (energy - begin.energy) - dissipated.iter().sum::<f64>();
        let done = self.work.abs() + work_load.abs();
        EnergyBalance {
            elastic,
            work_drive: self.work,
            work_load,
            dissipated,
            residual: if done > 0.0 { missing / done } else { 0.0 },
        }
    }
}

/// The state of the sample from which [`EnergyBudget::balance`] computes the energies.
#[derive(Debug, Clone, Copy)]
pub struct SampleState<'a> {
    /// The contacts of this rank.
    pub contacts: &'a Contacts,
    /// δ (m) of every block.
    pub overlap: &'a [Lanes16],
    /// The load N (N; N/m in 2D).
    pub load: f64,
    /// Height of the piston (m).
    pub height: f64,
    /// Kinetic energy of the free grains with their potential energy in gravity, unless that is
    /// their load, and, if it belongs to the sample, of the piston (J; J/m in 2D).
    pub kinetic: f64,
    /// Their potential energy where their weight is their load: below a free surface.
    pub potential: f64,
    /// Gravity (m/s²).
    pub gravity: [f64; 2],
}

/// Adds the elastic energies of the contacts whose first grain this rank owns.
fn add_elastic(
    isa: Isa,
    law: &dyn PairModel,
    sample: &SampleState<'_>,
    unit: FixedPoint,
    sums: &mut [Accumulator; ELASTIC],
) {
    let contacts = sample.contacts;
    let mut energies = vec![[Lanes16::ZERO; ELASTIC]; contacts.blocks()];
    law.energies(isa, &contacts.elastic(sample.overlap), &mut energies);
    for block in contacts.owned_blocks() {
        let touching = contacts.touching[block];
        for (sum, lanes) in sums.iter_mut().zip(&energies[block]) {
            for lane in (0..LANES).filter(|lane| touching >> lane & 1 == 1) {
                unit.add(sum, lanes.0[lane]);
            }
        }
    }
}
