//! Measures observables of the sample on all ranks and threads.

use std::ops::Range;
use std::sync::Arc;

use super::{Contact, Grain, Needs, Observable, SampleView, Total};
use crate::dimension::Dimension;
use crate::domain::{Accumulator, Exchange};
use crate::kernel::ContactForces;
use crate::state::{Grains, body};
use crate::system::System;

/// The sample, and the forces of its last step.
pub struct Measured<'a, D: Dimension> {
    /// This rank's grains and contacts.
    pub system: &'a mut System<D>,
    /// The forces of the contacts.
    pub forces: &'a ContactForces,
    /// The sample as a whole.
    pub view: SampleView,
}

/// The values of observables at the end of a step, the same bits on any ranks and threads.
/// Collective.
pub fn measure<D: Dimension>(
    exchange: &dyn Exchange,
    measured: Measured<'_, D>,
    observables: &[Arc<dyn Observable>],
) -> Vec<f64> {
    let Measured {
        system,
        forces,
        view,
    } = measured;
    if observables.is_empty() {
        return Vec::new();
    }
    system.finish_step();
    let needs = observables
        .iter()
        .fold(Needs::GRAINS, |needs, one| needs.or(one.needs()));
    let of_grains = needs
        .contacts_of_grains
        .then(|| ContactsOfGrain::of(system, forces));
    let pass = Pass {
        system,
        forces,
        view,
        observables,
        of_grains,
        contacts: needs.contacts,
    };
    let mut totals = pass.totals();
    Total::over_ranks(exchange, &mut totals, needs.extremes);
    let mut totals = &totals[..];
    let values = observables.iter().map(|observable| {
        let (own, rest) = totals.split_at(observable.totals());
        totals = rest;
        observable.value(&view, own)
    });
    values.collect()
}

/// What the contacts of a grain come to.
#[derive(Debug, Clone, Copy, Default)]
struct ContactsOfGrain {
    count: u32,
    /// With the walls.
    walls: [u32; 2],
    normal_force: Accumulator,
}

impl ContactsOfGrain {
    /// Those of the owned grains, all of whose contacts this rank has.
    fn of<D: Dimension>(system: &System<D>, forces: &ContactForces) -> Vec<Self> {
        let grains = &system.grains;
        let mut all = vec![Self::default(); grains.owned];
        for at in system.contacts.touching() {
            let force = forces.normal[at.block].0[at.lane];
            for (one, other) in [(at.i, at.j), (at.j, at.i)] {
                let Some(contacts) = all.get_mut(one) else {
                    continue;
                };
                contacts.count += 1;
                system.fixed.add(&mut contacts.normal_force, force);
                match grains.body[other] {
                    body::BOTTOM => contacts.walls[0] += 1,
                    body::TOP => contacts.walls[1] += 1,
                    _ => {}
                }
            }
        }
        all
    }
}

/// A pass over the grains and contacts of a rank.
struct Pass<'a, D: Dimension> {
    system: &'a System<D>,
    forces: &'a ContactForces,
    view: SampleView,
    observables: &'a [Arc<dyn Observable>],
    /// Of the owned grains, if they are needed.
    of_grains: Option<Vec<ContactsOfGrain>>,
    /// Whether contacts are needed.
    contacts: bool,
}

impl<D: Dimension> Pass<'_, D> {
    /// The totals of all observables, one after the other. Each thread adds its share of the grains
    /// and a part of the contacts.
    fn totals(&self) -> Vec<Total> {
        let system = self.system;
        let threads = system.bands.shares();
        let blocks = if self.contacts {
            system.contacts.blocks()
        } else {
            0
        };
        let begin = |k: usize| blocks * k / threads;
        let parts = system.by_shares(|k, grains| self.part(grains, begin(k)..begin(k + 1)));
        let mut parts = parts.into_iter();
        let mut totals = parts.next().unwrap_or_else(|| self.no_totals());
        for part in parts {
            for (total, more) in totals.iter_mut().zip(part) {
                total.merge(more);
            }
        }
        totals
    }

    fn no_totals(&self) -> Vec<Total> {
        let count = self.observables.iter().map(|one| one.totals()).sum();
        vec![Total::default(); count]
    }

    /// The totals over these owned grains, and over the contacts of these blocks whose first grain
    /// is owned.
    fn part(&self, grains: Range<usize>, blocks: Range<usize>) -> Vec<Total> {
        let mut totals = self.no_totals();
        let all = &self.system.grains;
        for g in grains.filter(|g| all.body[*g] != body::REMOVED) {
            let grain = self.grain(g);
            self.each(&mut totals, |observable, own| {
                observable.grain(&self.view, &grain, own);
            });
        }
        let touching = self.system.contacts.touching_in(blocks);
        for at in touching.filter(|at| at.i < all.owned) {
            let (i, j) = (all.fields(at.i), all.fields(at.j));
            let separation = self.system.cell.separation::<D>(i, j);
            let force = self.forces.vector::<D>(at.block, at.lane, &separation);
            let contact = Contact {
                ids: [at.i, at.j].map(|g| all.id[g]),
                bodies: [at.i, at.j].map(|g| all.body[g]),
                radii: [at.i, at.j].map(|g| all.radius[g]),
                position: all.position(at.i),
                separation,
                force,
                normal_force: self.forces.normal[at.block].0[at.lane],
                overlap: self.forces.overlap[at.block].0[at.lane],
            };
            self.each(&mut totals, |observable, own| {
                observable.contact(&self.view, &contact, own);
            });
        }
        totals
    }

    /// Calls `add` for every observable with its totals.
    fn each(&self, totals: &mut [Total], add: impl Fn(&dyn Observable, &mut [Total])) {
        let mut rest = totals;
        for observable in self.observables {
            let (own, others) = rest.split_at_mut(observable.totals());
            add(observable.as_ref(), own);
            rest = others;
        }
    }

    /// An owned grain.
    fn grain(&self, g: usize) -> Grain {
        let system = self.system;
        let grains: &Grains<D> = &system.grains;
        let state = grains.state(g);
        let (radius, mass) = (grains.radius[g], grains.mass[g]);
        let contacts = match &self.of_grains {
            Some(of_grains) => of_grains[g],
            None => ContactsOfGrain::default(),
        };
        Grain {
            id: state.id,
            body: state.body,
            material: state.material,
            radius,
            mass,
            inertia: D::INERTIA * mass * radius * radius,
            position: state.position,
            velocity: state.velocity,
            peculiar_velocity: system.cell.peculiar_velocity::<D>(grains.fields(g)),
            angular_velocity: state.angular_velocity,
            contacts: contacts.count,
            normal_force: system.fixed.value(contacts.normal_force),
            wall_contacts: contacts.walls,
        }
    }
}
