//! The state of a rank between two steps, and the upkeep of its lists.

use std::ops::Range;

use crate::budget::EnergyBudget;
use crate::clock::Clock;
use crate::contact::model::PairModel;
use crate::dimension::Dimension;
use crate::domain::{Exchange, FixedPoint, Slabs};
use crate::drive::{Drive, FlowSum, WallGrains, WallVelocities};
use crate::failure::{Failure, Outside, Result};
use crate::kernel::{PairForce, PassOutcome, STRESSES};
use crate::list::{Diameters, reach};
pub use crate::list::{List, ListSettings, THICKEST_SKIN};
use crate::neighbour::{self, LocalExtent};
use crate::processor::ThreadClock;
use crate::simd::{Isa, Lanes, Work};
use crate::state::{
    BandSize, Bands, Cell, ContactState, Contacts, FlatWalls, GrainState, Grains, Ids, LocalGrains,
    Masses, Remembered, Units, body, length,
};
use crate::threads::{OwnedPart, ThreadPool};
use crate::under_way::StepUnderWay;
use crate::workers;

/// By how much bands are thicker than the cutoff, over the greatest diameter.
const SLACK: f64 = 0.25;

/// The grains and contacts of this rank, and the bookkeeping for them.
#[derive(Debug)]
pub struct System<D: Dimension> {
    /// The instruction set.
    pub isa: Isa,
    /// The cell.
    pub cell: Cell,
    /// The masses of the grains.
    pub masses: Masses,
    /// Δt (s).
    pub step: f64,
    /// g (m/s²) along x, and against the last axis.
    pub gravity: [f64; 2],
    /// Steps done in this stage.
    pub steps: u64,
    /// Fixed-point numbers for sums of forces on walls.
    pub fixed: FixedPoint,
    pub(crate) grains: Grains<D>,
    /// The bands of the owned grains.
    pub(crate) bands: Bands,
    /// How steps go through them.
    pub(crate) sweep: SweepSettings,
    /// What messages call the grains.
    pub ids: Ids,
    /// Flat walls, where the drive has planes.
    pub flat: Option<FlatWalls>,
    /// The candidate pairs and their histories.
    pub contacts: Contacts,
    /// The slabs of the ranks.
    pub slabs: Slabs<D>,
    /// How long the list of pairs remains complete.
    pub list: List,
    /// The second kick of the last step is deferred: velocities are those of the half step. The
    /// next step gives it with its own first kick; the accessors of the grains give it before they
    /// return.
    pub(crate) second_kick_deferred: bool,
    /// The velocities of the grains of walls at the end of the last step, which are given with it.
    pub(crate) wall_velocities: Option<WallVelocities>,
    /// Room for the steps of a sweep.
    pub(crate) under_way: Vec<StepUnderWay>,
    /// The time spent in each phase.
    pub clock: Clock,
    /// The threads of this rank.
    pub pool: ThreadPool<D>,
    /// The energy budget, if it is kept.
    pub budget: Option<EnergyBudget>,
    /// [`PassOutcome::stress`](crate::kernel::PassOutcome::stress) of the last step with its
    /// kinetic part, if it was counted.
    pub(crate) stress: Option<[i128; STRESSES]>,
    /// Counts processor time, if it is given.
    thread_clock: Option<ThreadClock>,
    /// Number of blocks of pairs that all steps have evaluated.
    blocks: u64,
}

/// How steps go through the bands. They change the speed of a run and not its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SweepSettings {
    /// Grains of a band; `None`: few, and all of a packing that fits into the cache.
    pub band: Option<usize>,
    /// Steps that follow each other through the bands, at most.
    pub steps: u64,
}

impl Default for SweepSettings {
    /// With four steps a packing that fills three caches is a tenth slower, with sixteen as fast
    /// (docs/lab/speed.md).
    fn default() -> Self {
        Self {
            band: None,
            steps: 8,
        }
    }
}

/// Parameters of a [`System`]. SI units.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The instruction set.
    pub isa: Isa,
    /// Settings of the list of pairs.
    pub list: ListSettings,
    /// The cell.
    pub cell: Cell,
    /// The greatest radius of the grains (m).
    pub largest_radius: f64,
    /// d̄ (m).
    pub mean_diameter: f64,
    /// The masses of the grains.
    pub masses: Masses,
    /// Δt (s).
    pub step: f64,
    /// g (m/s²) along x, and against the last axis.
    pub gravity: [f64; 2],
    /// A typical force on a wall (N; N/m in 2D).
    pub typical_force: f64,
    /// Threads of this rank.
    pub threads: usize,
    /// Bands, and steps that follow each other through them.
    pub sweep: SweepSettings,
    /// Counts processor time, if it is given.
    pub thread_clock: Option<ThreadClock>,
}

impl Setup {
    fn diameters(&self) -> Diameters {
        Diameters {
            greatest: 2.0 * self.largest_radius,
            mean: self.mean_diameter,
        }
    }

    /// Grains of about this radius (m) without gravity, on one thread. `step`: Δt (s).
    pub fn new(cell: Cell, radius: f64, masses: Masses, step: f64) -> Self {
        Self {
            isa: Isa::detect(),
            list: ListSettings::default(),
            cell,
            largest_radius: radius,
            mean_diameter: 2.0 * radius,
            masses,
            step,
            gravity: [0.0; 2],
            typical_force: 1.0,
            threads: 1,
            sweep: SweepSettings::default(),
            thread_clock: None,
        }
    }

    /// With a skin of this many d̄ that does not adapt.
    #[must_use]
    pub fn with_skin(mut self, skin: f64) -> Self {
        self.list.skin = Some(skin);
        self
    }
}

impl<D: Dimension> System<D> {
    /// A system without grains.
    ///
    /// # Errors
    /// If the slabs would be too narrow, or the threads cannot be started.
    pub fn new(exchange: &dyn Exchange, setup: Setup) -> Result<Self> {
        let mut pool = ThreadPool::new(setup.threads)?;
        Ok(Self {
            list: List::new(exchange, setup.list, setup.cell, setup.diameters())?,
            isa: setup.isa,
            cell: setup.cell,
            masses: setup.masses,
            step: setup.step,
            gravity: setup.gravity,
            steps: 0,
            fixed: FixedPoint::new(setup.typical_force),
            grains: Grains::default(),
            bands: Bands::one(0),
            sweep: setup.sweep,
            contacts: Contacts::default(),
            slabs: Slabs::new(exchange, setup.cell.periods[0]),
            second_kick_deferred: false,
            wall_velocities: None,
            under_way: Vec::new(),
            clock: pool.clock(setup.thread_clock),
            pool,
            thread_clock: setup.thread_clock,
            blocks: 0,
            budget: None,
            stress: None,
            ids: Ids::default(),
            flat: None,
        })
    }

    /// Begins the clock anew.
    pub fn restart_clock(&mut self) {
        self.clock = self.pool.clock(self.thread_clock);
        self.list.worked = 0.0;
    }

    /// The grains of this rank at the full step.
    pub fn grains(&mut self) -> &Grains<D> {
        self.finish_step();
        &self.grains
    }

    /// [`System::grains`] and the contacts.
    pub fn grains_and_contacts(&mut self) -> (&Grains<D>, &Contacts) {
        self.finish_step();
        (&self.grains, &self.contacts)
    }

    /// [`System::grains`], to change them.
    pub fn grains_mut(&mut self) -> &mut Grains<D> {
        self.finish_step();
        &mut self.grains
    }

    /// The number of grains that this rank owns.
    pub fn owned(&self) -> usize {
        self.grains.owned
    }

    /// The number of owned grains and ghosts.
    pub fn local(&self) -> usize {
        self.grains.local()
    }

    /// What each thread makes of its share of the owned grains, in the order of the shares; `work`
    /// takes the number of a share as well.
    pub(crate) fn by_shares<T: Send>(
        &self,
        work: impl Fn(usize, Range<usize>) -> T + Sync,
    ) -> Vec<T> {
        let mut results: Vec<Option<T>> = Vec::new();
        results.resize_with(self.bands.shares(), || None);
        workers::each(self.pool.workers(), &mut results, |k, result| {
            *result = Some(work(k, self.bands.share(k)));
        });
        results.into_iter().flatten().collect()
    }

    /// Gives the deferred second kick, if it is due, by the same operations as the next step would,
    /// so with the same bits.
    pub(crate) fn finish_step(&mut self) {
        if !std::mem::take(&mut self.second_kick_deferred) {
            return;
        }
        let Self {
            bands,
            grains,
            pool,
            isa,
            ..
        } = self;
        // First, because the second kick starts from the velocities of the half step.
        if let Some(velocities) = self.wall_velocities.take() {
            let top: Vec<u32> = grains.of_body(body::TOP).collect();
            let mut bottom: Vec<u32> = Vec::new();
            if velocities.bottom.is_some() {
                bottom.extend(grains.of_body(body::BOTTOM));
            }
            let walls = WallGrains {
                top: &top,
                bottom: &bottom,
            };
            velocities.give::<D>(
                walls,
                &[D::VELOCITY, D::HALF_VELOCITY],
                0,
                &mut grains.record,
            );
        }
        pool.over_owned(bands, grains, |part| isa.run(SecondKick(part)));
    }

    /// Adds what the passes of a step found to the energy budget, and keeps the stress if it is
    /// counted.
    pub(crate) fn count(&mut self, outcome: &PassOutcome, is_stressed: bool) {
        self.stress = is_stressed.then_some(outcome.stress);
        self.blocks += outcome.blocks;
        if let Some(budget) = &mut self.budget {
            budget.step(outcome.dissipated, outcome.uncounted);
        }
    }

    /// Number of blocks of pairs that all steps have evaluated.
    pub fn evaluated_blocks(&self) -> u64 {
        self.blocks
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.bands.count()
    }

    /// Number of steps that may follow each other through the bands now, at most.
    pub fn most_at_once(&self) -> u64 {
        if self.bands.count() == 1 {
            return 1;
        }
        self.sweep.steps
    }

    /// Adds the flow of momentum to the stress, if that is counted.
    pub(crate) fn add_flow(&mut self, flow: FlowSum) {
        if let Some(stress) = &mut self.stress {
            flow.add_to(stress);
        }
    }

    /// Adds this length (m) to the Lees–Edwards offset; images above may then be one further.
    pub fn shear(&mut self, by: f64) {
        let periods = self.cell.shear(by);
        if periods != 0 {
            for image in &mut self.grains.image {
                image[0] += periods * image[D::UP];
            }
        }
    }

    /// Replaces the cell; [`System::replace`] must follow.
    ///
    /// # Errors
    /// Too many ranks for a cell of these lengths.
    pub fn set_cell(&mut self, exchange: &dyn Exchange, cell: Cell) -> Result<()> {
        self.list.fit(exchange, cell)?;
        self.slabs.stretch(cell.periods[0]);
        self.cell = cell;
        Ok(())
    }

    /// The states of the owned grains, sorted by id.
    pub fn grain_states(&mut self) -> Vec<GrainState> {
        self.finish_step();
        let owned = 0..self.grains.owned;
        let mut states: Vec<GrainState> = owned.map(|g| self.grains.state(g)).collect();
        states.sort_unstable_by_key(|g| g.id);
        states
    }

    /// The touching contacts of this rank, including those that another rank has as well.
    pub fn contact_states(&self, law: &dyn PairModel) -> Vec<ContactState> {
        self.states_of(law, self.grains.local())
    }

    /// The touching contacts whose first grain this rank owns: each contact on one rank.
    pub fn owned_contact_states(&self, law: &dyn PairModel) -> Vec<ContactState> {
        self.states_of(law, self.grains.owned)
    }

    /// The touching contacts whose first grain is one of the first `count`.
    fn states_of(&self, law: &dyn PairModel, count: usize) -> Vec<ContactState> {
        let chosen = self.contacts.touching().filter(|at| at.i < count);
        let state = |at| self.contacts.state(law, at, &self.grains.id);
        chosen.map(state).collect()
    }

    /// Migrates grains, sorts them, and makes a new list of pairs.
    ///
    /// # Errors
    /// Too many ranks: a slab must be wider than the cutoff.
    pub fn rebuild(
        &mut self,
        exchange: &dyn Exchange,
        law: &dyn PairForce<D>,
        drive: &mut dyn Drive<D>,
    ) -> Result<()> {
        if self.cell.sheared.is_some() {
            // Its lengths may have changed.
            self.set_cell(exchange, self.cell)?;
        }
        let lasted = self.steps - self.list.built;
        self.list.adapt(lasted);
        if exchange.size() > 1 || self.list.is_scattered() {
            let (grains, contacts) = (self.grain_states(), self.contact_states(law));
            return self.replace(exchange, law, drive, grains, contacts);
        }
        self.finish_step();
        let remembered = self.contacts.remember(&self.grains.id);
        self.make_list(exchange, law, drive, |_| remembered);
        Ok(())
    }

    /// Replaces the whole state by these grains and contacts, which may belong to any rank. Every
    /// contact must be on the ranks that have its grains.
    ///
    /// # Errors
    /// Too many ranks: a slab must be wider than the cutoff.
    pub fn replace(
        &mut self,
        exchange: &dyn Exchange,
        law: &dyn PairForce<D>,
        drive: &mut dyn Drive<D>,
        grains: Vec<GrainState>,
        contacts: Vec<ContactState>,
    ) -> Result<()> {
        let largest = 0.5 * self.list.diameter;
        // Rounding must not hide a contact that is about to end.
        let gap = 1.001 * law.largest_gap(largest);
        if gap != self.list.gap {
            self.list.gap = gap;
            self.list.fit(exchange, self.cell)?;
        }
        let cutoff = self.list.cutoff();
        let worked = self.clock.worked() - self.list.worked;
        let (mut owned, contacts) = self
            .slabs
            .redistribute(exchange, self.cell, grains, contacts, cutoff, worked)?;
        self.list.worked = self.clock.worked();
        self.second_kick_deferred = false;
        self.wall_velocities = None;
        let extent = self.extent(exchange);
        neighbour::sort_by_cells::<D>(&mut owned, self.cell, extent, cutoff);
        self.bands = self.sort_into_bands(exchange, &mut owned, cutoff);
        self.grains.replace(&owned, &self.masses, self.step);
        self.grains.units = Units::new(law.largest_normal_force(largest), largest);
        self.slabs
            .attach_ghosts(exchange, self.cell, &mut self.grains, &self.bands, cutoff);
        self.make_list(exchange, law, drive, |id| {
            Remembered::sorted(&contacts, law, id)
        });
        self.list.reach_when_sorted = self.list.reach;
        Ok(())
    }

    /// Sorts the grains into shares, and into several bands if that pays. `cutoff`: of the next
    /// list (m).
    fn sort_into_bands(
        &self,
        exchange: &dyn Exchange,
        owned: &mut Vec<GrainState>,
        cutoff: f64,
    ) -> Bands {
        let mut bounds = Vec::new();
        // Each foot is with the wall, not with its grain.
        if self.flat.is_none() {
            let size = match self.sweep.band {
                Some(wanted) => BandSize::given(wanted),
                None => BandSize::by_cache::<D>(exchange.size(), self.pool.threads()),
            };
            // Grains may come nearer to the next band but one before they are sorted again.
            let thickness = cutoff + SLACK * self.list.diameter;
            let top = -exchange.maximum(-Bands::lowest_of_top::<D>(owned, &self.cell));
            let here = Bands::bounds::<D>(owned, &self.cell, thickness, size, top);
            // Those of the first rank, because all have to be the same.
            let here = exchange.broadcast(bytemuck::cast_slice(&here).to_vec());
            bounds = bytemuck::allocation::pod_collect_to_vec(&here);
        }
        Bands::sort::<D>(owned, &self.cell, bounds, self.pool.threads())
    }

    /// The part of the cell that holds the local grains.
    fn extent(&self, exchange: &dyn Exchange) -> LocalExtent {
        let cutoff = self.cell.cutoff_along_x(self.list.cutoff());
        self.slabs.local_extent(exchange, cutoff)
    }

    /// Makes a new list of the pairs of the local grains, with the histories of the contacts that
    /// `remembered` gives for their ids.
    fn make_list(
        &mut self,
        exchange: &dyn Exchange,
        law: &dyn PairForce<D>,
        drive: &mut dyn Drive<D>,
        remembered: impl FnOnce(&[u32]) -> Remembered,
    ) {
        let cutoff = neighbour::Cutoff {
            greatest: self.list.cutoff(),
            skin: self.list.listed_gap(),
        };
        let extent = self.extent(exchange);
        self.grains.lift_feet();
        let mut candidates = neighbour::pairs(
            self.isa,
            self.pool.workers(),
            &self.grains,
            self.cell,
            extent,
            cutoff,
        );
        self.list.reach = reach(&candidates, &self.grains.body);
        self.slabs
            .drop_unpaired_ghosts(exchange, &mut self.grains, &mut candidates);
        self.list.planes = drive.planes().unwrap_or_default();
        if let (Some(flat), Some(planes)) = (self.flat, drive.planes()) {
            candidates.extend(self.grains.stand_on(flat, planes, cutoff.skin));
        }
        self.list.scattered = false;
        if self.bands.count() > 1 {
            let (grains, pairs) = (&self.grains, candidates.iter());
            let ghosts = (grains.owned..grains.local()).map(|g| grains.position(g));
            self.bands.set_ghosts::<D>(&self.cell, ghosts);
            let is_scattered = u8::from(!self.bands.hold(pairs.map(|pair| pair.grains)));
            self.list.scattered = exchange.maximum(is_scattered.into()) > 0.0;
            if self.list.scattered {
                self.bands.join();
            }
        }
        self.slabs.divide(&self.bands);
        let grains = &self.grains;
        self.contacts.replace(
            self.isa,
            self.pool.workers(),
            law,
            &candidates,
            &remembered(&grains.id),
            LocalGrains {
                id: &grains.id,
                radius: &grains.radius,
                material: &grains.material,
                owned: grains.owned,
                has_feet: !grains.feet.is_empty(),
                bands: &self.bands,
                ghosts_move: 0.5 * self.list.skin,
            },
        );
        self.pool.assign(&self.contacts, self.grains.local());
        drive.renumber(self.isa, &mut self.grains, self.list.skin);

        self.list
            .begin(self.steps, self.bands.count(), &self.grains, &self.cell);
    }

    /// The position of a grain, for messages.
    pub(crate) fn place(&self, g: usize) -> String {
        let x = self.grains.fields(g)[..D::AXES].iter();
        let x: Vec<String> = x.map(|x| format!("{x:.6e}")).collect();
        format!("({}) m", x.join(", "))
    }

    /// The id of a grain, for messages.
    pub(crate) fn id(&self, g: usize) -> u32 {
        self.ids.of(self.grains.id[g])
    }

    /// The second grain of a pair, for messages.
    fn partner(&self, g: usize) -> String {
        match self.grains.body[g] {
            _ if !self.grains.is_foot(g) => format!("{} at {}", self.id(g), self.place(g)),
            body::TOP => "the top wall".into(),
            _ => "the bottom wall".into(),
        }
    }

    /// The failure that some ranks found, with the same message on all ranks; collective.
    pub fn explain(&self, exchange: &dyn Exchange, outside: Option<Outside>) -> Failure {
        self.fail(exchange, outside.map(|outside| self.describe(outside)))
    }

    /// [`System::explain`] of what this rank found.
    pub(crate) fn fail(&self, exchange: &dyn Exchange, message: Option<String>) -> Failure {
        let said = exchange.gather(message.unwrap_or_default().as_bytes());
        let first = said.iter().find(|m| !m.is_empty());
        Failure::numbers(first.map_or_else(
            || "a global sum is out of range".into(),
            |m| format!("step {}: {}", self.steps, String::from_utf8_lossy(m)),
        ))
    }

    /// What failed, in words.
    pub(crate) fn describe(&self, outside: Outside) -> String {
        let place = |g: usize| self.place(g);
        let velocity = |fields: &[f64]| -> [f64; 3] {
            std::array::from_fn(|axis| {
                if axis < D::AXES {
                    fields[D::VELOCITY + axis]
                } else {
                    0.0
                }
            })
        };
        match outside {
            why @ (Outside::Pair(block, lane) | Outside::Force(block, lane)) => {
                let pairs = self.contacts.grains(block);
                let (i, j) = (pairs.i[lane] as usize, pairs.j[lane] as usize);
                let (a, b) = (self.grains.fields(i), self.grains.fields(j));
                let distance = length(self.cell.separation::<D>(a, b));
                let sum = self.contacts.geometry[block][0].0[lane];
                let (id, at, partner) = (self.id(i), place(i), self.partner(j));
                let plural = if self.grains.is_foot(j) { "" } else { "s" };
                let grains = format!("grain{plural} {id} at {at} and {partner}");
                if let Outside::Pair(..) = why {
                    format!(
                        "{grains} overlap by {:.3e} m, {:.1} % of the sum of their radii: outside the contact law",
                        sum - distance,
                        100.0 * (1.0 - distance / sum),
                    )
                } else {
                    let (of_a, of_b) = (velocity(a), velocity(b));
                    let speed = length(std::array::from_fn(|axis| of_a[axis] - of_b[axis]));
                    format!(
                        "{grains} collide too fast, at {speed:.3e} m/s: with the damper their force is greater than any elastic force of the contact law",
                    )
                }
            }
            Outside::Plane(g) => format!(
                "grain {} of radius {:.4e} m at {} overlaps a wall too much: outside the contact law",
                self.id(g),
                self.grains.radius[g],
                place(g),
            ),
            Outside::Number => {
                let bad = (0..self.grains.owned)
                    .find(|&g| !self.grains.fields(g).iter().all(|x| x.is_finite()));
                if let Some(g) = bad {
                    format!(
                        "the position or velocity of grain {} at {} is no number",
                        self.id(g),
                        place(g)
                    )
                } else {
                    let g = self.list.furthest(&self.grains, &self.cell);
                    // A wall that is too fast for the list need not be too fast for the law.
                    let [whose, remedy] = match self.grains.body[g] {
                        body::FREE => ["", "give a smaller time.step"],
                        _ => [
                            " of a wall",
                            "give the wall a lower velocity, or a smaller time.step, or a greater bookkeeping.skin",
                        ],
                    };
                    format!(
                        "grain {}{whose} at {} moved further than half the skin of the neighbour list ({:.3e} m) before the list could be rebuilt, at {:.3e} m/s; {remedy}",
                        self.id(g),
                        place(g),
                        0.5 * self.list.skin,
                        length(velocity(self.grains.fields(g))),
                    )
                }
            }
        }
    }

    /// Heap in use on this rank (bytes).
    pub fn memory(&self) -> usize {
        self.grains.memory() + self.contacts.memory() + self.pool.memory() + self.list.memory()
    }
}

/// Replaces the predicted v(t+Δt) by that of the second kick.
struct SecondKick<'a, D: Dimension>(OwnedPart<'a, D>);

impl<D: Dimension> Work for SecondKick<'_, D> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, _: L::Token) {
        let part = self.0;
        let grains = part.record.iter_mut().zip(part.force).zip(part.half_kick);
        for ((record, force), kick) in grains {
            let r = D::fields_mut(record);
            let [linear, angular] = *kick;
            for axis in 0..D::AXES {
                r[D::VELOCITY + axis] = r[D::HALF_VELOCITY + axis] + linear * force[axis];
            }
            for k in 0..D::SPINS {
                r[D::SPIN + k] = r[D::HALF_SPIN + k] + angular * force[D::TORQUE + k];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::StepPhase;
    use crate::dimension::Two;
    use crate::domain::Solo;

    /// The time since the last migration is what ranks share the work by.
    #[test]
    fn no_time_is_negative_after_the_clock_began_anew() {
        let cell = Cell::between_walls([10.0, f64::INFINITY]);
        let setup = Setup::new(cell, 0.5, Masses::Equal(1.0), 1.0);
        let mut system = System::<Two>::new(&Solo, setup).expect("a system");
        system.clock.end(StepPhase::Contacts);
        let worked = system.clock.worked();
        assert!(worked > 0.0);
        system.list.worked = worked;
        system.restart_clock();
        let now = system.clock.worked();
        assert!(now >= system.list.worked);
    }
}
