//! Measured quantities: rows of the time series, frames, the digest. None of them changes the
//! trajectory.

use std::ops::Range;

use xxhash_rust::xxh3::xxh3_128;

use crate::boundary::Boundary;
use crate::budget::{self, EnergyBalance, EnergyBudget};
use crate::contact::model::PairModel;
use crate::contact::{TORQUES, dissipation};
use crate::dimension::Dimension;
use crate::domain::{Accumulator, Exchange, FixedPoint, LIMBS};
use crate::drive::{LateralLengths, MovingBoundary, Top};
use crate::failure::{Failure, Result};
use crate::kernel::ContactForces;
use crate::simd::{Lanes, Work};
use crate::state::{
    BottomRow, Cell, ContactSample, FlowRow, GrainSample, Grains, ImposedRow, LateralRow,
    SeriesRow, StressRow, Touching, body,
};
use crate::system::System;

/// Numbers of the four sums of a row in its message.
const SUMS: usize = 4 * (LIMBS + 1);

/// Constants of the sample from which rows of the time series are computed.
#[derive(Debug, Clone, Copy)]
pub struct SampleConstants {
    /// Thickness of both walls together (m): the height of the sheared layer is the piston's less
    /// this.
    pub walls: f64,
    /// Volume of the free grains (m³; area, m², in 2D).
    pub free_volume: f64,
    /// The number of free grains.
    pub free_grains: u64,
    /// Fixed-point numbers for sums of energies (J; J/m in 2D).
    pub energy: FixedPoint,
    /// The same for means of heights (m) and velocities (m/s).
    pub motion: FixedPoint,
}

impl SampleConstants {
    /// Measures the grains as they are. `energy`: a typical energy (J; J/m in 2D). Collective.
    pub fn measure<D: Dimension>(
        exchange: &dyn Exchange,
        system: &mut System<D>,
        walls: f64,
        energy: f64,
    ) -> Self {
        let mut constants = Self {
            walls,
            free_volume: 0.0,
            free_grains: 0,
            energy: FixedPoint::new(energy),
            motion: FixedPoint::new(system.cell.periods[0]),
        };
        constants.count(exchange, system);
        constants
    }

    /// Measures the free grains anew. Collective.
    pub fn count<D: Dimension>(&mut self, exchange: &dyn Exchange, system: &System<D>) {
        let volume = FixedPoint::new(base::<D>(system.cell) * system.cell.periods[0]);
        let mut sum = Accumulator::default();
        let mut count = 0;
        for g in 0..system.grains.owned {
            if system.grains.body[g] == body::FREE {
                let r = system.grains.radius[g];
                volume.add(&mut sum, D::volume(r));
                count += 1;
            }
        }
        [self.free_volume] = volume.total(exchange, [sum]);
        self.free_grains = crate::domain::total(exchange, count);
    }
}

/// Fails if a free grain is beyond one of these planes, the outer ones of both walls (m): it has
/// passed a wall through a hole. The upper one is infinitely high where there is none. Collective.
///
/// # Errors
/// The step, the id and the place of the grain of the lowest id, and how many there are.
pub fn check_between<D: Dimension>(
    exchange: &dyn Exchange,
    system: &System<D>,
    planes: [f64; 2],
) -> Result<()> {
    match beyond(exchange, system, planes) {
        None => Ok(()),
        Some(said) => Err(Failure::numbers(format!(
            "{said}: the wall has a hole; give a greater sample.wall_thickness, a packing whose walls have none, or sample.outside = \"remove\""
        ))),
    }
}

/// Removes the free grains that are beyond one of these planes, as [`check_between`] has them.
/// Returns what it would say, the same on all ranks. Collective.
pub fn remove_beyond<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    planes: [f64; 2],
) -> Option<String> {
    let said = beyond(exchange, system, planes)?;
    let grains = system.grains_mut();
    for g in 0..grains.owned {
        if passed(grains, g, planes).is_some() {
            grains.remove(g);
        }
    }
    system.list.due = true;
    Some(said)
}

/// Whether the wall that a free grain has passed is the upper one; `None` if it has passed none.
fn passed<D: Dimension>(grains: &Grains<D>, g: usize, planes: [f64; 2]) -> Option<bool> {
    let [bottom, top] = planes;
    let height = grains.fields(g)[D::UP];
    if grains.body[g] == body::FREE && (height < bottom || height > top) {
        Some(height > top)
    } else {
        None
    }
}

/// The free grains beyond these planes: the step, that of the lowest id and its place, and how many
/// there are. Collective.
fn beyond<D: Dimension>(
    exchange: &dyn Exchange,
    system: &System<D>,
    planes: [f64; 2],
) -> Option<String> {
    let grains = &system.grains;
    let owned = 0..grains.owned;
    let beyond: Vec<usize> = owned
        .filter(|g| passed(grains, *g, planes).is_some())
        .collect();
    let count = crate::domain::total(exchange, beyond.len() as u64);
    if count == 0 {
        return None;
    }
    let first = beyond.into_iter().min_by_key(|g| grains.id[*g]);
    let id = first.map_or(f64::INFINITY, |g| grains.id[g].into());
    let lowest = -exchange.maximum(-id);
    let mut message = String::new();
    if let Some(g) = first
        && id == lowest
    {
        let is_above = passed(grains, g, planes) == Some(true);
        let wall = if is_above { "top" } else { "bottom" };
        let others = match count - 1 {
            0 => String::new(),
            n => format!(", and {n} more have"),
        };
        message = format!(
            "grain {} of radius {:.4e} m at {} has left the space between the walls through the {wall} wall{others}",
            system.id(g),
            grains.radius[g],
            system.place(g),
        );
    }
    let said = exchange.gather(message.as_bytes());
    let said = said.concat();
    let said = String::from_utf8_lossy(&said);
    Some(format!("step {}: {said}", system.steps))
}

/// Area of a wall (m²; length, m, in 2D).
pub fn base<D: Dimension>(cell: Cell) -> f64 {
    cell.periods[..D::UP].iter().product()
}

/// Kinetic energy of the free grains; collective.
pub fn kinetic_energy<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    energy: &FixedPoint,
) -> f64 {
    let sums = OwnedSums::of(system, energy, 0);
    energy.total(exchange, [sums.kinetic])[0]
}

/// Sums over the owned grains and the contacts of a rank, or those of one of its threads.
#[derive(Debug, Clone, Copy, Default)]
struct OwnedSums {
    /// Kinetic energy of the free grains.
    kinetic: Accumulator,
    /// Potential energy of the free grains in gravity, from the height 0 and from where their
    /// images along x are counted from.
    potential: Accumulator,
    /// Contacts, sliding contacts, and contacts of each free grain, summed.
    counts: [i64; 3],
}

impl OwnedSums {
    /// Those of the owned grains and of the contacts in the first `blocks` of the list. Each thread
    /// adds those of its share and of a part of the blocks.
    fn of<D: Dimension>(system: &mut System<D>, energy: &FixedPoint, blocks: usize) -> Self {
        system.finish_step();
        let system = &*system;
        let threads = system.bands.shares();
        let begin = |k: usize| blocks * k / threads;
        let parts = system.by_shares(|k, grains| {
            system.isa.run(SummedPart {
                system,
                energy,
                grains,
                blocks: begin(k)..begin(k + 1),
            })
        });
        parts.into_iter().fold(Self::default(), Self::merge)
    }

    fn merge(mut self, other: Self) -> Self {
        self.kinetic.merge(other.kinetic);
        self.potential.merge(other.potential);
        for (sum, more) in self.counts.iter_mut().zip(other.counts) {
            *sum += more;
        }
        self
    }
}

/// The owned grains and the blocks over which a thread sums.
#[derive(Debug)]
struct SummedPart<'a, D: Dimension> {
    system: &'a System<D>,
    energy: &'a FixedPoint,
    grains: Range<usize>,
    blocks: Range<usize>,
}

impl<D: Dimension> Work for SummedPart<'_, D> {
    type Output = OwnedSums;

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) -> OwnedSums {
        let (system, energy) = (self.system, self.energy);
        let (cell, grains, [along, down]) = (system.cell, &system.grains, system.gravity);
        let mut sums = OwnedSums::default();
        let is_free = |g: usize| grains.body[g] == body::FREE;
        for g in self.grains.filter(|g| is_free(*g)) {
            let (r, mass, radius) = (grains.fields(g), grains.mass[g], grains.radius[g]);
            let square = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
            let spin = D::INERTIA * radius * radius * square(&r[D::SPIN..D::SPIN + D::SPINS]);
            let velocity = cell.peculiar_velocity::<D>(r);
            let energy_of = 0.5 * mass * (square(&velocity[..D::AXES]) + spin);
            energy.add(&mut sums.kinetic, energy_of);
            if system.gravity != [0.0; 2] {
                energy.add(&mut sums.potential, mass * down * r[D::UP]);
            }
            if along != 0.0 {
                let x = r[0] + grains.image[g][0] as f64 * cell.periods[0];
                energy.add(&mut sums.potential, -(mass * along * x));
            }
        }
        let contacts = &system.contacts;
        for at in contacts.touching_in(self.blocks) {
            if at.i < grains.owned {
                sums.counts[0] += 1;
                sums.counts[1] += i64::from(contacts.limits[at.block][0] >> at.lane & 1);
                sums.counts[2] += i64::from(is_free(at.i)) + i64::from(is_free(at.j));
            }
        }
        sums
    }
}

/// The mean motion of the free grains, weighed by mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flow {
    /// Height above the bottom wall (m), and its rate but for the motion of that wall (m/s).
    pub height: [f64; 2],
    /// Velocity along x (m/s).
    pub velocity: f64,
}

/// The mean motion of the free grains below a free surface, whose mass is `mass` (kg; kg/m in 2D).
/// Collective.
pub fn flow<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    constants: &SampleConstants,
    mass: f64,
    boundary: &MovingBoundary,
) -> Flow {
    system.finish_step();
    let bottom = boundary.bottom(constants.walls);
    let grains = &system.grains;
    let mut sums = [Accumulator::default(); 3];
    for g in (0..grains.owned).filter(|g| grains.body[*g] == body::FREE) {
        let (r, share) = (grains.fields(g), grains.mass[g] / mass);
        let values = [r[D::UP] - bottom, r[D::VELOCITY + D::UP], r[D::VELOCITY]];
        for (sum, value) in sums.iter_mut().zip(values) {
            constants.motion.add(sum, share * value);
        }
    }
    let [height, rise, velocity] = constants.motion.total(exchange, sums);
    Flow {
        height: [height, rise],
        velocity,
    }
}

impl Flow {
    /// The columns that a row of the time series has of it besides.
    pub fn row(&self) -> FlowRow {
        FlowRow {
            mean_velocity: self.velocity,
        }
    }
}

/// Sums over the grains and contacts of all ranks.
struct Sums {
    /// On the top, or the bottom below a free surface (N; N/m in 2D).
    shear_force: f64,
    normal_force: f64,
    /// J; J/m in 2D.
    kinetic_energy: f64,
    potential_energy: f64,
    /// Contacts, sliding contacts, and contacts of each free grain, summed.
    counts: [i64; 3],
}

impl Sums {
    /// What the energy budget takes for kinetic energy, with that of a wall that moves, and for
    /// potential energy (J; J/m in 2D).
    fn energies(&self, budget: Option<&EnergyBudget>, boundary: &MovingBoundary) -> [f64; 2] {
        let [mut kinetic, mut potential] = [self.kinetic_energy, self.potential_energy];
        if boundary.kind().has_top() {
            (kinetic, potential) = (kinetic + potential, 0.0);
        }
        if budget.is_none_or(EnergyBudget::has_wall) {
            let piston = &boundary.top().piston;
            kinetic += 0.5 * piston.mass * piston.velocity * piston.velocity;
        }
        [kinetic, potential]
    }
}

/// One message for all sums. Collective.
fn sums<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    constants: &SampleConstants,
    boundary: &Boundary,
) -> Sums {
    let OwnedSums {
        kinetic,
        potential,
        counts,
    } = OwnedSums::of(system, &constants.energy, system.contacts.blocks());
    let grains = &system.grains;
    let (mut shear, mut normal) = (Accumulator::default(), Accumulator::default());
    let wall = boundary.measured_body();
    let sign = if wall == body::BOTTOM { -1.0 } else { 1.0 };
    for g in grains.of_body(wall) {
        let force = &grains.force[g as usize];
        system.fixed.add(&mut shear, -sign * force[0]);
        system.fixed.add(&mut normal, sign * force[D::UP]);
    }
    let mut message = [0i64; SUMS + 3];
    let (sums, tail) = message.split_at_mut(SUMS);
    let parts = [shear, normal, kinetic, potential];
    for (part, limbs) in parts.iter().zip(sums.chunks_mut(LIMBS + 1)) {
        part.write(limbs);
    }
    tail.copy_from_slice(&counts);
    exchange.sum(&mut message);
    let part = |k: usize| Accumulator::read(&message[k * (LIMBS + 1)..(k + 1) * (LIMBS + 1)]);
    Sums {
        shear_force: system.fixed.value(part(0)),
        normal_force: system.fixed.value(part(1)),
        kinetic_energy: constants.energy.value(part(2)),
        potential_energy: constants.energy.value(part(3)),
        counts: std::array::from_fn(|k| message[SUMS + k]),
    }
}

/// What a row of the time series is of, besides the grains and their contacts.
pub struct RowInput<'a> {
    /// The boundary.
    pub boundary: &'a MovingBoundary,
    /// The flow below a free surface.
    pub flow: Option<Flow>,
    /// H (m), by which displacements are strains.
    pub height: f64,
}

/// A row of the time series, from the forces of the last step; collective.
pub fn series<D: Dimension>(
    exchange: &dyn Exchange,
    law: &dyn PairModel,
    system: &mut System<D>,
    samples: &ContactForces,
    constants: &SampleConstants,
    input: &RowInput<'_>,
) -> SeriesRow {
    let RowInput {
        boundary, height, ..
    } = *input;
    let top = boundary.top();
    let (piston, slider) = (&top.piston, &top.slider.state);
    let mut sums = sums(exchange, system, constants, boundary.kind());
    let [contacts, sliding, ends] = sums.counts;
    if let Some(stress) = boundary.stress() {
        (sums.shear_force, sums.normal_force) = (-stress.along, stress.up);
    }
    let [wall_height, wall_velocity] = match &input.flow {
        Some(flow) => flow.height.map(|x| 2.0 * x),
        None => [
            piston.height - constants.walls - top.bottom_displacement()[1],
            piston.velocity,
        ],
    };
    let [kinetic, potential] = sums.energies(system.budget.as_ref(), boundary);
    let sample = budget::SampleState {
        contacts: &system.contacts,
        overlap: &samples.overlap,
        load: piston.load,
        height: piston.height,
        kinetic,
        potential,
        gravity: system.gravity,
    };
    let energy = match &mut system.budget {
        Some(budget) => budget.balance(exchange, system.isa, law, sample),
        None => EnergyBalance::NONE,
    };
    SeriesRow {
        strain: slider.displacement / height,
        stress_ratio: sums.shear_force / sums.normal_force,
        normal_force: sums.normal_force,
        shear_force: sums.shear_force,
        wall_height,
        solid_fraction: constants.free_volume / (base::<D>(system.cell) * wall_height),
        coordination: ends as f64 / constants.free_grains as f64,
        kinetic_energy: sums.kinetic_energy,
        sliding_fraction: sliding as f64 / contacts.max(1) as f64,
        wall_velocity,
        slip: slider.displacement,
        slip_rate: slider.velocity,
        drive_displacement: top.slider.drive_position(),
        drive_velocity: top.slider.drive_velocity(),
        elastic_normal: energy.elastic[0],
        elastic_tangential: energy.elastic[1],
        elastic_rolling: energy.elastic[2],
        work_drive: energy.work_drive,
        work_load: energy.work_load,
        dissipated_damping: energy.dissipated[dissipation::DAMPING],
        dissipated_friction: energy.dissipated[dissipation::FRICTION],
        dissipated_rolling: energy.dissipated[dissipation::ROLLING],
        dissipated_stiffness: energy.dissipated[dissipation::STIFFNESS],
        energy_residual: energy.residual,
    }
}

/// What a protocol of more than velocities imposes on the walls at the end of a step.
pub fn imposed(top: &Top) -> ImposedRow {
    let [normal, shear] = top.imposed();
    ImposedRow {
        imposed_normal_force: normal,
        imposed_shear_force: shear,
        bottom_displacement: top.bottom_displacement()[1],
    }
}

/// Where a bottom that vibrates along x is at the end of a step.
pub fn bottom_along(top: &Top) -> BottomRow {
    BottomRow {
        bottom_displacement_x: top.bottom_displacement()[0],
    }
}

/// The lengths of a cell that change across its height.
pub fn lateral(lengths: &LateralLengths) -> LateralRow {
    let state = &lengths.state;
    let length = |axis: usize| state.axes.get(axis).map_or(f64::NAN, |axis| axis.height);
    LateralRow {
        length_x: length(0),
        length_y: length(1),
        unwrapped_offset: state.unwrapped_offset,
    }
}

/// The stress of a cell without walls, from the forces of the last step. `mass`: of all grains (kg;
/// kg/m in 2D). Collective.
pub fn stress<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    samples: &ContactForces,
    mass: f64,
) -> StressRow {
    system.finish_step();
    let (cell, grains, fixed) = (&system.cell, &system.grains, &system.fixed);
    let lengths = cell.lengths::<D>();
    // Sums of forces, as the fixed-point numbers are for them.
    let per_length = 1.0 / lengths[D::UP];
    let mut sums = [Accumulator::default(); 6];
    let (contacts, velocities) = sums.split_at_mut(3);
    for at in system.contacts.touching().filter(|at| at.i < grains.owned) {
        let r = cell.separation::<D>(grains.fields(at.i), grains.fields(at.j));
        let force = samples.vector::<D>(at.block, at.lane, &r);
        for axis in 0..D::AXES {
            fixed.add(&mut contacts[axis], r[axis] * force[axis] * per_length);
        }
    }
    for g in 0..grains.owned {
        let u = cell.peculiar_velocity::<D>(grains.fields(g));
        for axis in 0..D::AXES {
            let flow = grains.mass[g] * u[axis] * u[axis] * per_length;
            fixed.add(&mut velocities[axis], flow);
        }
    }
    let sums = fixed.total(exchange, sums);
    let per_base = 1.0 / base::<D>(*cell);
    let stress = |axis: usize| {
        if axis < D::AXES {
            (sums[axis] + sums[3 + axis]) * per_base
        } else {
            f64::NAN
        }
    };
    let flows = sums[3..].iter().sum::<f64>() / D::AXES as f64;
    StressRow {
        stress_xx: stress(0),
        stress_yy: stress(1),
        stress_zz: stress(2),
        kinetic_pressure: flows * per_base,
        velocity_variance: flows * lengths[D::UP] / mass,
    }
}

/// This rank's part of a frame: its grains, and the contacts whose first grain it owns, with flat
/// walls as well.
pub fn frame<D: Dimension>(
    system: &mut System<D>,
    law: &dyn PairModel,
    samples: &ContactForces,
) -> (Vec<GrainSample>, Vec<ContactSample>) {
    system.finish_step();
    let grains = (0..system.grains.owned)
        .map(|g| GrainSample::from(&system.grains.state(g)))
        .collect();
    let is_owned = |at: &Touching| at.i < system.grains.owned;
    let sample = |at: Touching| {
        let state = system.contacts.state(law, at, &system.grains.id);
        let force = samples.tangential[at.block].map(|lanes| lanes.0[at.lane]);
        let limits = system.contacts.limits[at.block];
        let at_limit = |limit: usize| u64::from(limits[limit] >> at.lane & 1);
        let planar = D::SPINS == 1;
        let tangential = |v: [f64; 3]| if planar { [v[0], 0.0, 0.0] } else { v };
        ContactSample {
            i: state.i,
            j: state.j,
            normal_force: samples.normal[at.block].0[at.lane],
            tangential_force: tangential(force),
            tangential_history: tangential(state.history),
            rolling_history: if planar { state.history[2] } else { 0.0 },
            overlap: samples.overlap[at.block].0[at.lane],
            sliding: at_limit(0),
            rolling: at_limit(1),
            torques: state.torques,
            twisting: at_limit(2),
            idle: at_limit(3),
            age: state.age,
        }
    };
    let contacts = system.contacts.touching().filter(is_owned);
    (grains, contacts.map(sample).collect())
}

/// The digest of the state: of every grain without its image, every touching contact with its
/// history, `more` (such as the walls) and the step. It is the sum of their 128-bit hashes, so it
/// does not depend on which rank has them; collective.
pub fn digest<D: Dimension>(
    exchange: &dyn Exchange,
    system: &mut System<D>,
    law: &dyn PairModel,
    more: &[u8],
    step: u64,
) -> String {
    // The lower and the upper 64 bits are summed separately, so the sums wrap.
    let mut halves = [0i64; 2];
    let mut add = |bytes: &[u8]| {
        let hash = xxh3_128(bytes);
        halves[0] = halves[0].wrapping_add(hash as u64 as i64);
        halves[1] = halves[1].wrapping_add((hash >> 64) as u64 as i64);
    };
    for g in system.grain_states() {
        add(g.moving());
    }
    for c in system.owned_contact_states(law) {
        add(c.moving());
        let of_spheres = c.moving_spheres();
        let pair = (u64::from(c.i) << 32 | u64::from(c.j)) as i64;
        if c.age != 0.0 {
            add(bytemuck::bytes_of(&[pair, c.age.to_bits() as i64]));
        }
        if D::SPINS == 3 && of_spheres != (0, [0.0; TORQUES]) {
            let (limits, [x, y, z, twist]) = of_spheres;
            let torques = [x, y, z, twist].map(|t| t.to_bits() as i64);
            add(bytemuck::bytes_of(&[
                pair, limits, torques[0], torques[1], torques[2], torques[3],
            ]));
        }
    }
    if exchange.rank() == 0 {
        add(more);
        add(&step.to_le_bytes());
    }
    exchange.sum(&mut halves);
    format!("{:016x}{:016x}", halves[1] as u64, halves[0] as u64)
}
