//! Mechanical equilibrium: Newton's method with the exact K, and overdamped dynamics.

use super::assembly::{Assembly, RestState};
use super::eigenvalues::{GlobalState, Move, newton_step};
use crate::header::Relaxing;
use gshear_dem::dimension::Dimension;
use gshear_dem::drive::{NoWalls, Overdamped};
use gshear_dem::failure::{Failure, Outside, Result};
use gshear_dem::state::{Cell, Sheared, Stretching, body};
use gshear_dem::step::forces;
use gshear_dem::system::System;
use gshear_scene::{Method, Relax, Sample};
use gshear_spectrum::Solver;
use gshear_store::collective::gathered;

/// Greatest number of factorisations; one or two suffice if no contact opens, closes or reaches a
/// limit.
const MOST_FACTORISATIONS: u64 = 12;
/// Factors are reused as long as a step leaves less than this fraction of the residual.
const SERVING: f64 = 0.1;
/// Greatest displacement of a grain in a step of Newton's method, over d̄.
pub(super) const LONGEST: f64 = 0.02;
/// Steps of overdamped dynamics between two checks of the residual.
const LOOK: u64 = 100;

/// Beginning of the message of a relaxation that takes too many steps.
pub(super) const NOT_AT_REST: &str = "not at rest after relax.max_steps";

/// Brings packings of a box to mechanical equilibrium, a part of the way at a time.
pub(super) struct Relaxation {
    relax: Relax,
    mean_diameter: f64,
    /// Keeps the ordering of K's pattern from one factorisation to the next.
    solver: Solver,
    /// The residual that was last computed.
    pub residual: f64,
}

impl Relaxation {
    pub fn new(relax: Relax, sample: &Sample) -> Self {
        Self {
            relax,
            mean_diameter: sample.mean_diameter,
            solver: Solver::default(),
            residual: f64::NAN,
        }
    }

    /// Begins to relax the system, whose forces must be those of its positions. Newton's method
    /// holds the state before it. Collective.
    pub fn begin<D: Dimension>(
        &self,
        assembly: &mut Assembly<'_, D>,
        held: &mut Vec<RestState>,
    ) -> Result<Relaxing> {
        let mut relaxing = Relaxing::default();
        if self.relax.method == Method::Newton {
            held.push(RestState::of(assembly));
            relaxing.opened = Some(Vec::new());
        } else {
            assembly.begin_overdamped(&self.relax)?;
        }
        Ok(relaxing)
    }

    /// Goes on, as far as the factors of one K serve, or some steps of overdamped dynamics. Returns
    /// whether the system is at equilibrium. Collective.
    pub fn go_on<D: Dimension>(
        &mut self,
        assembly: &mut Assembly<'_, D>,
        relaxing: &mut Relaxing,
        held: &mut Vec<RestState>,
    ) -> Result<bool> {
        if relaxing.opened.is_none() {
            self.residual = assembly.residual(self.relax.drag);
            return assembly.overdamped(&self.relax, &mut relaxing.statistics.steps);
        }
        let before = held.last().expect("the state before Newton's method");
        let before: Vec<[u32; 2]> = before.state.contacts.iter().map(|c| [c.i, c.j]).collect();
        let before = gathered(assembly.exchange, &before, |pair| *pair);
        let Some(converged) = self.newton(assembly, relaxing, &before)? else {
            return Ok(false);
        };
        let state = held.pop().expect("the state before Newton's method");
        if !converged {
            state.put_back(assembly)?;
            relaxing.opened = None;
            relaxing.statistics.fell_back = true;
            assembly.begin_overdamped(&self.relax)?;
        }
        Ok(converged)
    }

    /// Newton's method with one K. Every displacement is one step of the dynamics, so that the
    /// histories follow it. K is factorised again only if the last factors no longer reduce the
    /// residual. `before`: the contacts before the method; it notes those that open.
    /// Returns whether it converged and no contact opened and closed again on the way, because that
    /// contact would have lost its history; `None` if it goes on.
    fn newton<D: Dimension>(
        &mut self,
        assembly: &mut Assembly<'_, D>,
        relaxing: &mut Relaxing,
        before: &[[u32; 2]],
    ) -> Result<Option<bool>> {
        let opened = relaxing.opened.get_or_insert_default();
        let factorisations = &mut relaxing.statistics.factorisations;
        let tolerance = self.relax.tolerance;
        let longest = LONGEST * self.mean_diameter;
        let mut left = assembly.residual(0.0);
        self.residual = left;
        if left > tolerance {
            if *factorisations == MOST_FACTORISATIONS {
                return Ok(Some(false));
            }
            *factorisations += 1;
            let whole = GlobalState::at_rest(assembly);
            let tangent = whole.tangent(assembly);
            let factors = tangent.as_ref().and_then(|t| t.factor(&mut self.solver));
            loop {
                assembly.system.list.widen(2.5 * longest);
                assembly.rebuild()?;
                let tangent = tangent.as_ref().zip(factors.as_ref());
                let Some(moves) = newton_step(assembly, tangent) else {
                    return Ok(Some(false));
                };
                let squares = moves.iter().map(|[displacement, _]| square(displacement));
                let furthest = squares.fold(0.0, f64::max);
                let is_small = assembly.exchange.maximum(furthest).sqrt() < longest;
                if !is_small || assembly.displace(&moves, 0.0).is_err() {
                    return Ok(Some(false));
                }
                let now = assembly.residual(0.0);
                let state = GlobalState::at_rest(assembly);
                opened.extend(before.iter().filter(|pair| !state.has(**pair)));
                // NaN counts as no progress.
                let falls = now < left;
                if !falls {
                    return Ok(Some(false));
                }
                let serves = now < SERVING * left;
                left = now;
                if left <= tolerance || !serves {
                    break;
                }
            }
            opened.sort_unstable();
            opened.dedup();
            self.residual = left;
        }
        if left > tolerance {
            return Ok(None);
        }
        let after = GlobalState::at_rest(assembly);
        Ok(Some(!opened.iter().any(|pair| after.has(*pair))))
    }
}

/// What a step of Newton's method computes, with the factors of K: for measurements of its time.
/// Collective.
pub(crate) fn factor_once<D: Dimension>(assembly: &mut Assembly<'_, D>) -> Result<()> {
    let whole = GlobalState::at_rest(assembly);
    let tangent = whole.tangent(assembly);
    let mut solver = Solver::default();
    let factors = tangent.as_ref().and_then(|t| t.factor(&mut solver));
    let tangent = tangent.as_ref().zip(factors.as_ref());
    match newton_step(assembly, tangent) {
        Some(_) => Ok(()),
        None => Err(Failure::numbers("the stiffness matrix has no factors")),
    }
}

/// Whether all overlaps are within the law, and what is outside it on this rank.
pub(super) type DisplacementResult = Result<(), Option<Outside>>;

impl<D: Dimension> Assembly<'_, D> {
    /// Begins [`Self::overdamped`] dynamics.
    pub(super) fn begin_overdamped(&mut self, relax: &Relax) -> Result<()> {
        let mut drive = Overdamped { drag: relax.drag };
        (self.system).rebuild(self.exchange, self.law, &mut drive)?;
        self.initial_forces(&mut drive, false)
    }

    /// Some steps of BO's overdamped dynamics, which are added to `steps`, if a force is greater
    /// than the tolerance. Otherwise brings the grains to rest, and returns true.
    pub(super) fn overdamped(&mut self, relax: &Relax, steps: &mut u64) -> Result<bool> {
        let left = self.residual(relax.drag);
        if left.is_nan() {
            return Err(Failure::numbers("a force is no number"));
        }
        if left > relax.tolerance {
            if *steps >= relax.max_steps {
                return Err(Failure::numbers(format!(
                    "{NOT_AT_REST} = {steps} steps of overdamped dynamics: the greatest force is {left:.2e}, \
                     relax.tolerance is {:.2e}",
                    relax.tolerance
                )));
            }
            let mut drive = Overdamped { drag: relax.drag };
            let more = LOOK.min(relax.max_steps - *steps);
            for _ in 0..more {
                self.advance(&mut drive, false, false)?;
            }
            *steps += more;
            return Ok(false);
        }
        stop(&mut self.system);
        self.rebuild()?;
        self.initial_forces(&mut NoWalls, false)?;
        // Without motion no damper acts, which may have held a spring.
        let is_at_rest = self.residual(0.0) <= relax.tolerance;
        if !is_at_rest {
            self.begin_overdamped(relax)?;
        }
        Ok(is_at_rest)
    }

    /// The greatest |F| or |T|/R on a grain, without the `drag` (1/time) that the forces contain.
    pub(super) fn residual(&mut self, drag: f64) -> f64 {
        let grains = self.system.grains();
        let mut greatest = 0.0f64;
        for g in (0..grains.owned).filter(|&g| grains.body[g] == body::FREE) {
            let (force, fields) = (&grains.force[g][..], grains.fields(g));
            let mut contacts = [0.0; 3];
            let mut slowing = [0.0; 3];
            for axis in 0..D::AXES {
                slowing[axis] = drag * grains.mass[g] * fields[D::VELOCITY + axis];
                contacts[axis] = force[axis] + slowing[axis];
            }
            let torque = square(&force[D::TORQUE..D::TORQUE + D::SPINS]).sqrt() / grains.radius[g];
            for x in [square(&contacts).sqrt(), square(&slowing).sqrt(), torque] {
                if x > greatest || x.is_nan() {
                    greatest = x;
                }
            }
        }
        self.exchange.maximum(greatest)
    }

    /// Displaces the owned grains, and the images above by `shear` along x, in one step of the
    /// dynamics, which advances the histories, and sets all velocities to zero. The list must be
    /// new, with a sufficient skin.
    pub(super) fn displace(&mut self, moves: &[Move], shear: f64) -> DisplacementResult {
        let system = &mut self.system;
        let (axes, spins) = (D::AXES, D::SPINS);
        let step = system.step;
        if let Some(sheared) = &mut system.cell.sheared {
            // Velocities of the full step are 0, as those of the grains: no damper acts.
            sheared.velocity = 0.0;
            sheared.half_velocity = shear / step;
        }
        system.shear(shear);
        let cell = system.cell;
        for (g, [displacement, rotation]) in moves.iter().enumerate() {
            let (fields, image) = system.grains_mut().place_mut(g);
            for axis in 0..axes {
                fields[D::HALF_VELOCITY + axis] = displacement[axis] / step;
                fields[axis] += displacement[axis];
            }
            for axis in 0..D::UP {
                let period = cell.periods[axis];
                if !(0.0..period).contains(&fields[axis]) {
                    image[axis] += Cell::wrap(&mut fields[axis], period);
                }
            }
            for k in 0..spins {
                fields[D::HALF_SPIN + k] = rotation[3 - spins + k] / step;
            }
            cell.wrap_last_axis::<D>(fields, image);
            fields[D::VELOCITY] = 0.0;
        }
        self.follow()
    }

    /// Gives the cell these lengths (m) and moves the grains affinely with it, in one step of the
    /// dynamics, which advances the histories. All grains must be at rest, and stay so.
    pub(super) fn stretch(&mut self, lengths: [f64; 3]) -> Result<DisplacementResult> {
        let mut state = self.held();
        let before = self.system.cell.lengths::<D>();
        let factors: [f64; 3] = std::array::from_fn(|axis| lengths[axis] / before[axis]);
        for g in &mut state.grains {
            for axis in 0..D::AXES {
                // Rounding must not move a grain out of the cell.
                let moved = g.position[axis] * factors[axis];
                g.position[axis] = moved.min(lengths[axis].next_down());
            }
        }
        let cell = self.system.cell.with_lengths::<D>(lengths);
        self.system.set_cell(self.exchange, cell)?;
        self.replace(&mut NoWalls, state.grains, state.contacts)?;
        let system = &mut self.system;
        let rates = factors.map(|factor| (1.0 - 1.0 / factor) / system.step);
        if let Some(sheared) = &mut system.cell.sheared {
            // Velocities of the full step are 0.
            sheared.stretching = Some(Stretching {
                half: rates,
                full: [0.0; 3],
            });
        }
        Ok(self.follow())
    }

    /// Advances the histories by the step in which the grains have moved, sets all velocities to
    /// zero and computes the forces at rest.
    fn follow(&mut self) -> DisplacementResult {
        let (exchange, law, system) = (self.exchange, self.law, &mut self.system);
        let step = system.step;
        let outside = forces(exchange, system, law, &mut NoWalls, step, None);
        stop(system);
        if let Some(sheared) = &mut system.cell.sheared {
            *sheared = Sheared {
                velocity: 0.0,
                half_velocity: 0.0,
                stretching: None,
                ..*sheared
            };
        }
        // The forces at rest, without dampers.
        let outside = outside.or(forces(exchange, system, law, &mut NoWalls, 0.0, None));
        match exchange.maximum(f64::from(u8::from(outside.is_some()))) {
            0.0 => Ok(()),
            _ => Err(outside),
        }
    }
}

/// |v|².
pub(super) fn square(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum()
}

/// Sets all velocities to zero.
pub(super) fn stop<D: Dimension>(system: &mut System<D>) {
    for g in 0..system.owned() {
        system.grains_mut().fields_mut(g)[D::VELOCITY..D::SPIN + D::SPINS].fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use gshear_dem::dimension::Two;
    use gshear_dem::domain::Solo;
    use gshear_dem::kernel::PairForce;
    use gshear_dem::laws::Contact;
    use gshear_dem::laws::hooke::{Hooke, Springs};
    use gshear_dem::state::{GrainState, Masses};
    use gshear_dem::system::Setup;

    const SIDE: usize = 8;
    const SPACING: f64 = 0.98;
    const SPRINGS: Springs = Springs {
        normal_stiffness: 1.0,
        tangential_stiffness: 0.5,
        density: 1.0,
        damping_ratio: 0.0,
        sliding_damping: 0.0,
        ageing: None,
    };

    fn law(friction: f64) -> Hooke<Two, true, false> {
        let contact = Contact {
            friction,
            ..Contact::NONE
        };
        Hooke::new(&SPRINGS, &contact)
    }

    /// A triangular lattice of equal disks of diameter 1, all of which touch six others.
    fn lattice(law: &dyn PairForce<Two>) -> Assembly<'_, Two> {
        let rise = 0.75f64.sqrt() * SPACING;
        let lengths = [SIDE as f64 * SPACING, SIDE as f64 * rise, 1.0];
        let cell = Cell {
            periods: [1.0, f64::INFINITY],
            sheared: Some(Sheared::upright(1.0)),
        };
        let setup = Setup::new(
            cell.with_lengths::<Two>(lengths),
            0.5,
            Masses::Density(SPRINGS.density),
            0.01,
        );
        let grain = |id: usize| {
            let (row, column) = (id / SIDE, id % SIDE);
            let x = SPACING * (column as f64 + 0.25 + 0.5 * (row % 2) as f64);
            GrainState {
                id: id as u32,
                radius: 0.5,
                position: [x, rise * (row as f64 + 0.5), 0.0],
                ..GrainState::zeroed()
            }
        };
        let grains = (0..SIDE * SIDE).map(grain).collect();
        let system = System::new(&Solo, setup).expect("one rank");
        let mut lattice = Assembly::of(&Solo, law, system);
        (lattice.replace(&mut NoWalls, grains, Vec::new())).expect("a list");
        (lattice.initial_forces(&mut NoWalls, false)).expect("sound forces");
        lattice
    }

    /// Three contacts a disk of k δ each, over the area of a disk: P = √3 k δ/ℓ.
    #[test]
    fn the_pressure_of_a_lattice_follows_from_its_length() {
        let law = law(0.0);
        let mut lattice = lattice(&law);
        let lengths = lattice.system.cell.lengths::<Two>();
        let mut energies = Vec::new();
        for factor in [1.0, 0.999, 0.99, 0.995, 1.01] {
            let to = [lengths[0] * factor, lengths[1] * factor, 1.0];
            let outcome = lattice.stretch(to).expect("one rank");
            outcome.expect("within the law");
            let spacing = SPACING * factor;
            let expected = 3.0f64.sqrt() * SPRINGS.normal_stiffness * (1.0 - spacing) / spacing;
            let found = lattice.observe((SIDE * SIDE) as u32);
            assert!((found.pressure / expected - 1.0).abs() < 1e-11, "{factor}");
            for axis in 0..2 {
                let stress = found.normal_stress[axis];
                assert!((stress / expected - 1.0).abs() < 1e-11, "{factor} {axis}");
            }
            assert!(lattice.residual(0.0) < 1e-14);
            energies.push(found.elastic_energy);
        }
        let overlap = 1.0 - 0.99 * SPACING;
        let expected = 1.5 * (SIDE * SIDE) as f64 * SPRINGS.normal_stiffness * overlap * overlap;
        assert!((energies[2] / expected - 1.0).abs() < 1e-11);
    }

    /// Under pure shear the contacts at ± 60° slide by ε sin 120° ℓ, whether or not they cross an
    /// edge of the box, and the others not at all.
    #[test]
    fn histories_follow_the_lengths() {
        let law = law(1e3);
        let mut lattice = lattice(&law);
        let lengths = lattice.system.cell.lengths::<Two>();
        let strain = 1e-5;
        let to = [
            lengths[0] * (1.0 + strain),
            lengths[1] / (1.0 + strain),
            1.0,
        ];
        let outcome = lattice.stretch(to).expect("one rank");
        outcome.expect("within the law");
        let expected = SPRINGS.tangential_stiffness * strain * 0.75f64.sqrt() * SPACING;
        let mut inclined = 0;
        let contacts = lattice.held().contacts;
        assert_eq!(contacts.len(), 3 * SIDE * SIDE);
        for contact in contacts {
            let force = contact.history[0].abs();
            if contact.i as usize / SIDE == contact.j as usize / SIDE {
                assert!(force < 1e-12, "{contact:?}");
            } else {
                assert!((force / expected - 1.0).abs() < 3.0 * strain, "{contact:?}");
                inclined += 1;
            }
        }
        assert_eq!(inclined, 2 * SIDE * SIDE);
    }
}
