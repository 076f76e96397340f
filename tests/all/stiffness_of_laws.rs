//! K of every law in `LAWS`, chosen as a run chooses it, against differences of its own forces: in
//! every dimension it has, with and without friction and rolling resistance.

use std::f64::consts::PI;
use std::sync::Arc;

use faer::{Mat, Par, c64};
use gshear_analysis::jacobian::{History, Jacobian, NetworkState, assemble, damping};
use gshear_dem::adhesions::constant::Constant;
use gshear_dem::adhesions::dmt::Dmt;
use gshear_dem::adhesions::jkr::Jkr;
use gshear_dem::contact::adhesion::AdhesionModel;
use gshear_dem::contact::{AGE, TORQUES};
use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::NoWalls;
use gshear_dem::kernel::{ContactForces, PairForce};
use gshear_dem::laws::keys::{
    AGEING, AGEING_SLIP, Key, KeyReader, SLIDING_DAMPING, TANGENTIAL_HISTORY,
};
use gshear_dem::laws::mixture::pair_force;
use gshear_dem::laws::{Contact, LAWS, Law, LawKind, LawSpace};
use gshear_dem::state::{Cell, ContactState, GrainState, Masses, Sheared, body, length};
use gshear_dem::step::forces;
use gshear_dem::system::{Setup, System};
use gshear_spectrum::{Problem, Request, Spectrum, Symbolic, nearest};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Grains along each axis.
const SIDE: usize = 5;
/// (m)
const SPACING: f64 = 0.97;
const MASSES: Masses = Masses::Density(1.3);
/// Δt (s).
const STEP: f64 = 0.5;
/// How far grains are moved for the differences (m; rad).
const H: f64 = 2e-5;
/// θ_0 (s), by the example of its key.
const AGEING_TIME: f64 = 1e-4;

/// Gives every key its example, but for these; of keys that exclude each other the first.
struct Examples {
    instead: Vec<(&'static str, Option<f64>)>,
    history: Option<&'static str>,
}

/// Without dampers on sliding contacts, which act without F_n, too, and without ages.
fn examples() -> Examples {
    Examples {
        instead: vec![(SLIDING_DAMPING.path, Some(0.0)), (AGEING.path, Some(0.0))],
        history: None,
    }
}

/// The same, with friction that grows with the age. K takes what slides as sliding on: a difference
/// to both sides does not, so slip changes no age.
fn of_ages() -> Examples {
    let mut ages = examples();
    ages.instead[1] = (AGEING.path, Some(0.1));
    ages.instead.push((AGEING_SLIP.path, None));
    ages
}

/// The same, with springs that remember their force.
fn of_forces() -> Examples {
    Examples {
        history: Some("force"),
        ..examples()
    }
}

/// The same, with a part of the dampers on sliding contacts.
fn of_shares() -> Examples {
    let mut shares = examples();
    shares.instead[0] = (SLIDING_DAMPING.path, Some(0.3));
    shares
}

impl KeyReader for Examples {
    fn number(&mut self, key: &Key) -> Option<f64> {
        let mut instead = self.instead.iter();
        match instead.find(|(path, _)| *path == key.path) {
            Some((_, value)) => *value,
            None => Some(key.example.parse().expect("an example is a number")),
        }
    }

    fn choice(&mut self, key: &Key) -> Option<&'static str> {
        self.history.filter(|_| key.path == TANGENTIAL_HISTORY.path)
    }

    fn required(&mut self, key: &Key) -> f64 {
        self.number(key).unwrap_or(f64::NAN)
    }

    fn exactly_one(&mut self, _: &[&Key], _: &str) -> usize {
        0
    }

    fn useless(&mut self, _: &Key, _: &str) {}

    fn refuse(&mut self, key: &Key, what: &str) {
        panic!(
            "the examples of the keys do not fit together: {} {what}",
            key.path
        );
    }
}

/// Grains of random radii near a lattice in a sheared box, two of them of a wall.
fn grains<D: Dimension>(random: &mut ChaCha8Rng) -> Vec<GrainState> {
    let grain = |id: usize| {
        let mut position = [0.0; 3];
        for (axis, x) in position[..D::AXES].iter_mut().enumerate() {
            let row = id / SIDE.pow(axis as u32) % SIDE;
            *x = SPACING * (row as f64 + 0.5 + 0.01 * random.random_range(-1.0..1.0));
        }
        GrainState {
            id: id as u32,
            body: if [3, 7].contains(&id) {
                body::BOTTOM
            } else {
                body::FREE
            },
            position,
            velocity: [0.0; 3],
            angular_velocity: [0.0; 3],
            radius: 0.5 + 0.03 * random.random_range(-1.0..1.0),
            force: [0.0; 3],
            torque: [0.0; 3],
            image: [0; 3],
            material: id as u64 % 2,
        }
    };
    (0..SIDE.pow(D::AXES as u32)).map(grain).collect()
}

/// A box so many times as wide as the lattice.
fn cell(times: f64) -> Cell {
    let side = times * SPACING * SIDE as f64;
    Cell {
        periods: [side; 2],
        sheared: Some(Sheared {
            offset: 0.02,
            ..Sheared::upright(side)
        }),
    }
}

/// The touching pairs; `None` if one is about to touch or to part.
fn touching<D: Dimension>(grains: &[GrainState], cell: Cell) -> Option<Vec<ContactState>> {
    let mut pairs = Vec::new();
    for (k, a) in grains.iter().enumerate() {
        for b in &grains[k + 1..] {
            let r = cell.separation::<D>(&a.position, &b.position);
            let overlap = a.radius + b.radius - length(r);
            if overlap.abs() < 1e-3 {
                return None;
            }
            if overlap > 0.0 {
                pairs.push(ContactState::new(a.id, b.id, [0.0; 3]));
            }
        }
    }
    Some(pairs)
}

/// Grains at rest whose contacts are below their limits, or well beyond them.
struct Packing<'a, D: Dimension> {
    system: System<D>,
    /// Rate at which all grains recede from the origin (1/s).
    expansion: f64,
    /// The part of their distances by which all grains have approached each other in a step.
    approach: f64,
    law: &'a dyn PairForce<D>,
}

impl<'a, D: Dimension> Packing<'a, D> {
    fn new(law: &'a dyn PairForce<D>, contact: &Contact, cell: Cell) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let (grains, contacts) = (0..1000)
            .find_map(|_| {
                let grains = grains::<D>(&mut random);
                let contacts = touching::<D>(&grains, cell)?;
                Some((grains, contacts))
            })
            .expect("one packing of many");
        let setup = Setup {
            mean_diameter: 1.0,
            ..Setup::new(cell, 0.53, MASSES, STEP).with_skin(0.1)
        };
        let mut system = System::new(&Solo, setup).expect("one rank");
        system
            .replace(&Solo, law, &mut NoWalls, grains, contacts)
            .expect("a list");
        let mut packing = Self {
            system,
            expansion: 0.0,
            approach: 0.0,
            law,
        };
        packing.load(contact, &mut random);
        packing
    }

    /// The places of what free grains have, as (grain, unknown).
    fn unknowns() -> usize {
        D::AXES + D::SPINS
    }

    /// Lets the law itself make small histories, and scales those to parts of the limits: every
    /// fifth beyond that of friction, every seventh beyond that of rolling.
    fn load(&mut self, contact: &Contact, random: &mut ChaCha8Rng) {
        const SLIP: f64 = 1e-5;
        let owned = self.system.owned();
        let before = self.system.grains().record.clone();
        for g in 0..owned {
            let fields = self.system.grains_mut().fields_mut(g);
            for k in 0..D::AXES {
                fields[D::HALF_VELOCITY + k] = SLIP / STEP * random.random_range(-1.0..1.0);
            }
            for k in 0..D::SPINS {
                fields[D::HALF_SPIN + k] = SLIP / STEP * random.random_range(-1.0..1.0);
            }
        }
        let mut samples = ContactForces::default();
        self.forces(Some(&mut samples));
        self.system.grains_mut().record.copy_from_slice(&before);
        let rows = self.law.layout().history.len();
        let at: Vec<_> = self.system.contacts.touching().collect();
        for (k, at) in at.into_iter().enumerate() {
            let radius = &self.system.grains().radius;
            let radii = [radius[at.i], radius[at.j]];
            let overlap = samples.overlap[at.block].0[at.lane];
            let adhesion = contact.adhesion.as_ref();
            let attraction = adhesion.map_or(0.0, |a| a.contact(radii, overlap).force);
            let normal = samples.normal[at.block].0[at.lane] + attraction;
            let tangential = samples.tangential[at.block];
            let tangential: Vec<f64> = (0..D::SPINS).map(|k| tangential[k].0[at.lane]).collect();
            let tangential = tangential.iter().map(|t| t * t).sum::<f64>().sqrt();
            let history = &mut self.system.contacts.history[at.block * rows..][..rows];
            let part = 0.7 + 0.2 * random.random_range(-1.0..1.0);
            if self.law.layout().has_friction && contact.friction > 0.0 {
                let beyond = if k % 5 == 0 { 14.0 } else { 1.0 };
                let scale = beyond * part * contact.friction * normal / tangential;
                for row in &mut history[..D::SPINS] {
                    row.0[at.lane] *= scale;
                }
            }
            let age = self.law.layout().history.iter().position(|k| *k == AGE);
            if let Some(row) = age {
                history[row].0[at.lane] = AGEING_TIME * random.random_range(0.1..10.0);
            }
            // Elastic torques; μ_r R_r F_n is their limit.
            let mut torque = |coefficient: f64, k: usize| {
                let beyond = if k % 7 == 3 { 14.0 } else { 0.5 };
                let sign = if random.random() { 1.0 } else { -1.0 };
                beyond * 0.25 * coefficient * normal * sign * part
            };
            if contact.rolling_friction > 0.0 && D::SPINS == 1 {
                history[rows - 1].0[at.lane] = torque(contact.rolling_friction, k);
            }
            if contact.resists_rotation() && D::SPINS == 3 {
                let [rolling @ .., twisting] = &mut history[rows - TORQUES..] else {
                    panic!("no torques");
                };
                let length = rolling.iter().map(|m| m.0[at.lane].powi(2));
                let scale = torque(contact.rolling_friction, k) / length.sum::<f64>().sqrt();
                rolling.iter_mut().for_each(|m| m.0[at.lane] *= scale);
                twisting.0[at.lane] = torque(contact.twisting_friction, k + 2);
            }
        }
    }

    fn forces(&mut self, samples: Option<&mut ContactForces>) {
        for g in 0..self.system.owned() {
            let fields = self.system.grains_mut().fields_mut(g);
            (0..D::AXES).for_each(|k| fields[D::VELOCITY + k] = self.expansion * fields[k]);
        }
        let outside = forces(
            &Solo,
            &mut self.system,
            self.law,
            &mut NoWalls,
            STEP,
            samples,
        );
        assert_eq!(outside, None);
    }

    /// What is made of the state with its contacts older by `later` (s).
    fn of_network<T>(
        &mut self,
        at_rest: bool,
        later: f64,
        make: impl FnOnce(NetworkState<'_>, &dyn PairForce<D>) -> T,
    ) -> T {
        let mut contacts = self.system.contact_states(self.law);
        for contact in contacts.iter_mut().filter(|contact| contact.age > 0.0) {
            contact.age += later;
        }
        let state = NetworkState {
            flat: None,
            grains: &self.system.grain_states(),
            contacts: &contacts,
            cell: self.system.cell,
            masses: &MASSES,
            at_rest,
        };
        make(state, self.law)
    }

    /// K and M. Forces are those at the end of a step.
    fn jacobian(&mut self, at_rest: bool) -> Jacobian {
        self.of_network(at_rest, STEP, |state, law| {
            assemble::<D>(state, law, History::Turned)
        })
    }

    /// C.
    fn damping(&mut self) -> Mat<f64> {
        self.of_network(true, 0.0, |state, law| damping::<D>(state, law).to_dense())
    }

    /// Forces and torques on all grains, by id, after the `k`-th unknown of `grain` has moved by h
    /// in one step.
    fn moved(&mut self, (grain, k): (u32, usize), h: f64) -> Vec<f64> {
        let history = self.system.contacts.history.clone();
        // Histories beyond the limits, as no step leaves them: all slide as if from now on.
        self.system.contacts.limits_are_known = false;
        let ids = &self.system.grains().id;
        let grain = ids.iter().position(|id| *id == grain).expect("a grain");
        let record = self.system.grains().record.clone();
        for g in 0..self.system.owned() {
            let rate = -self.approach / STEP;
            let fields = self.system.grains_mut().fields_mut(g);
            (0..D::AXES).for_each(|k| fields[D::HALF_VELOCITY + k] = rate * fields[k]);
        }
        let fields = self.system.grains_mut().fields_mut(grain);
        if k < D::AXES {
            fields[k] += h;
            fields[D::HALF_VELOCITY + k] += h / STEP;
        } else {
            fields[D::HALF_SPIN + k - D::AXES] = h / STEP;
        }
        self.forces(None);
        self.system.grains_mut().record.copy_from_slice(&record);
        self.system.contacts.history = history;
        self.forces_by_id()
    }
}

impl<D: Dimension> Packing<'_, D> {
    /// Forces and torques on all grains, by id, at this velocity of an unknown of a grain, the
    /// others at rest. No time passes.
    fn pushed(&mut self, (grain, k): (u32, usize), velocity: f64) -> Vec<f64> {
        let history = self.system.contacts.history.clone();
        self.system.contacts.limits_are_known = false;
        let ids = &self.system.grains().id;
        let at = ids.iter().position(|id| *id == grain).expect("a grain");
        let place = if k < D::AXES {
            D::VELOCITY + k
        } else {
            D::SPIN + k - D::AXES
        };
        self.system.grains_mut().fields_mut(at)[place] = velocity;
        let outside = forces(&Solo, &mut self.system, self.law, &mut NoWalls, 0.0, None);
        assert_eq!(outside, None);
        self.system.grains_mut().fields_mut(at)[place] = 0.0;
        self.system.contacts.history = history;
        self.forces_by_id()
    }

    /// The forces and torques of the last computation.
    fn forces_by_id(&mut self) -> Vec<f64> {
        let grains = self.system.grains();
        let mut by_id: Vec<usize> = (0..grains.owned).collect();
        by_id.sort_unstable_by_key(|&g| grains.id[g]);
        let found = by_id.into_iter().map(|g| &grains.force[g]);
        found.flat_map(|f| f[..Self::unknowns()].to_vec()).collect()
    }
}

fn name_of<D: Dimension>(law: &Law, contact: &Contact) -> String {
    let (name, axes) = (law.kind().name, D::AXES);
    format!("{name} in {axes} dimensions with {contact:?}")
}

/// Every entry of K, to 1e-8 of the greatest, of the laws of one or two materials.
fn agrees<D: LawSpace>(laws: &[(Law, Contact)]) {
    let (law, contact) = &laws[0];
    let name = format!("{}: {} pairs", name_of::<D>(law, contact), laws.len());
    let force = pair_force::<D>(laws);
    let force = force.unwrap_or_else(|| panic!("{name}: no forces"));
    let mut packing = Packing::<D>::new(force.as_ref(), contact, cell(1.0));
    let jacobian = packing.jacobian(true);
    let per_grain = Packing::<D>::unknowns();
    assert_eq!(jacobian.per_grain, per_grain);
    assert_eq!(
        jacobian.unknowns(),
        per_grain * (packing.system.owned() - 2)
    );
    assert!(jacobian.contacts > 30, "{name}");
    assert_eq!(jacobian.sliding > 5, contact.friction > 0.0, "{name}");
    let k = jacobian.k.to_dense();
    let greatest = k.norm_max();
    let mut worst = 0.0f64;
    for column in 0..jacobian.unknowns() {
        let grain = jacobian.grains[column / per_grain];
        let unknown = (grain, column % per_grain);
        let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|part| packing.moved(unknown, part * H));
        for (row, &g) in jacobian.grains.iter().enumerate() {
            for f in 0..per_grain {
                let at = g as usize * per_grain + f;
                let slope = (a[at] - 8.0 * b[at] + 8.0 * c[at] - d[at]) / (12.0 * H);
                let error = k[(per_grain * row + f, column)] + slope;
                worst = worst.max(error.abs());
            }
        }
    }
    assert!(worst < 1e-8 * greatest, "{name}: {:e}", worst / greatest);
}

/// Every entry of C, to 1e-8 of the greatest, against differences of the forces by velocities.
fn damps<D: LawSpace>(law: &Law, contact: &Contact) {
    let name = name_of::<D>(law, contact);
    let force = D::pair_force(law, contact).expect("forces");
    let mut packing = Packing::<D>::new(force.as_ref(), contact, cell(1.0));
    let jacobian = packing.jacobian(true);
    let (c, per_grain) = (packing.damping(), jacobian.per_grain);
    let greatest = c.norm_max();
    if law.kind().name == "mindlin" && !contact.resists_rotation() {
        assert_eq!(greatest, 0.0);
    }
    // So slow that no contact changes its state.
    let normal = 0.03 * law.normal_stiffness(0.5, 0.5, 0.03);
    let velocity = 1e-4 * normal / greatest.max(1e-3 * normal);
    let mut worst = 0.0f64;
    for column in 0..jacobian.unknowns() {
        let unknown = (jacobian.grains[column / per_grain], column % per_grain);
        let [a, b, e, f] =
            [-2.0, -1.0, 1.0, 2.0].map(|part| packing.pushed(unknown, part * velocity));
        for row in 0..jacobian.unknowns() {
            let at = jacobian.grains[row / per_grain] as usize * per_grain + row % per_grain;
            let slope = (a[at] - 8.0 * b[at] + 8.0 * e[at] - f[at]) / (12.0 * velocity);
            worst = worst.max((c[(row, column)] + slope).abs());
        }
    }
    assert!(worst <= 1e-8 * greatest, "{name}: {:e}", worst / greatest);
}

/// Contacts that separate so fast that their dampers leave no force: K adds as much for them as
/// differences of the forces, without an attraction nothing. Without dampers every contact has a
/// force.
fn idle<D: LawSpace>(law: &Law, contact: &Contact) {
    let name = name_of::<D>(law, contact);
    let force = D::pair_force(law, contact).expect("forces");
    let mut packing = Packing::<D>::new(force.as_ref(), contact, cell(3.0));
    let at_rest = packing.jacobian(true);
    packing.expansion = 1e6;
    let forces = packing.moved((0, 0), 0.0);
    packing.forces(None);
    let jacobian = packing.jacobian(false);
    if law.kind().name == "mindlin" {
        assert!(forces.iter().any(|f| *f != 0.0), "{name}");
        assert_eq!(jacobian.contacts, at_rest.contacts, "{name}");
        return;
    }
    let greatest = at_rest.k.to_dense().norm_max();
    let (k, per_grain) = (jacobian.k.to_dense(), jacobian.per_grain);
    for column in 0..jacobian.unknowns() {
        let unknown = (jacobian.grains[column / per_grain], column % per_grain);
        let [before, after] = [-H, H].map(|by| packing.moved(unknown, by));
        for row in 0..jacobian.unknowns() {
            let at = jacobian.grains[row / per_grain] as usize * per_grain + row % per_grain;
            let slope = (after[at] - before[at]) / (2.0 * H);
            // Dampers along t̂ are left with the rounding of the velocities.
            let error = (k[(row, column)] + slope).abs();
            assert!(error < 1e-6 * greatest, "{name}: {error:e} at {unknown:?}");
        }
    }
    if contact.adhesion.is_none() {
        let found = (jacobian.contacts, jacobian.k.to_dense().norm_max());
        assert_eq!(found, (0, 0.0), "{name}");
    }
}

/// Whether K and the forces agree with each choice of friction and rolling resistance, of spheres
/// also of twisting resistance.
fn agrees_with_all_limits<D: LawSpace>(kind: &'static LawKind, rolls: bool) {
    let law = Law::read(kind, &mut examples());
    let rolling: &[f64] = if rolls { &[0.0, 0.1] } else { &[0.0] };
    // Of a pair with this overlap about a half and a fifth of the spring's force.
    let force = 0.02 * law.normal_stiffness(0.5, 0.5, 0.03);
    let constant = Constant { force };
    let mut cases: Vec<(f64, Option<Arc<dyn AdhesionModel>>)> = vec![(0.0, None), (0.4, None)];
    if D::SPINS == 3 {
        // 4πγ is the force.
        let dmt = Dmt::new(force / (4.0 * PI), constant);
        cases.push((0.4, Some(Arc::new(dmt))));
    } else {
        cases.push((0.4, Some(Arc::new(constant))));
    }
    // Weak, since it presses the closest pairs further, and they are near the end of the law.
    if let Some(modulus) = law.contact_modulus() {
        let jkr = Jkr::new(force / 3000.0, modulus);
        cases.push((0.4, Some(Arc::new(jkr))));
    }
    for (friction, adhesion) in cases {
        for &rolling_friction in rolling {
            let contact = Contact {
                friction,
                rolling_friction,
                rolling_stiffness: Some(0.3 * law.normal_stiffness(0.5, 0.5, 0.03)),
                rolling_damping_ratio: 0.3,
                twisting_friction: if D::SPINS == 3 {
                    0.7 * rolling_friction
                } else {
                    0.0
                },
                twisting_stiffness: None,
                twisting_damping_ratio: 0.2,
                adhesion: adhesion.clone(),
                ..Contact::NONE
            };
            let of_all = (law.clone(), contact.clone());
            agrees::<D>(std::slice::from_ref(&of_all));
            let other = Contact {
                friction: 2.0 * friction,
                rolling_stiffness: Some(0.2 * law.normal_stiffness(0.5, 0.5, 0.03)),
                ..contact.clone()
            };
            let unlike = (law.clone(), other);
            agrees::<D>(&[of_all.clone(), unlike.clone(), unlike, of_all]);
            idle::<D>(&law, &contact);
            damps::<D>(&law, &contact);
        }
    }
}

#[test]
fn stiffness_is_the_derivative_of_the_forces_of_every_law() {
    for kind in LAWS {
        for dimension in kind.dimensions {
            match dimension {
                Dimensions::Two => agrees_with_all_limits::<Two>(kind, kind.rolling),
                Dimensions::Three => agrees_with_all_limits::<Three>(kind, true),
            }
        }
    }
}

/// Friction that grows with the age: K has that of each contact.
#[test]
fn stiffness_has_the_friction_of_the_age() {
    for (kind, resists) in [("hooke", false), ("hertz", false), ("hertz", true)] {
        let kind = LAWS.iter().find(|law| law.name == kind).expect("a law");
        let law = Law::read(kind, &mut of_ages());
        let rolling_friction = if resists { 0.1 } else { 0.0 };
        let contact = Contact {
            friction: 0.4,
            rolling_friction,
            rolling_stiffness: Some(0.3 * law.normal_stiffness(0.5, 0.5, 0.03)),
            ..Contact::NONE
        };
        let of_all = [(law, contact)];
        agrees::<Three>(&of_all);
        if kind.rolling {
            agrees::<Two>(&of_all);
        }
    }
}

/// Dampers of which a part acts on sliding contacts, and those beside springs that remember their
/// force.
#[test]
fn damping_is_the_derivative_of_the_forces_by_velocities() {
    let contact = Contact {
        friction: 0.4,
        ..Contact::NONE
    };
    for (name, mut values) in [
        ("lee-hurley", of_shares()),
        ("hooke", of_shares()),
        ("hooke", of_ages()),
        ("hertz", of_ages()),
        ("hertz", of_forces()),
        ("hertz-tsuji", of_forces()),
    ] {
        let kind = LAWS.iter().find(|law| law.name == name).expect("a law");
        let law = Law::read(kind, &mut values);
        if kind.dimensions.contains(&Dimensions::Two) {
            damps::<Two>(&law, &contact);
        }
        if kind.dimensions.contains(&Dimensions::Three) {
            damps::<Three>(&law, &contact);
        }
    }
}

/// Springs that remember their force: K is the derivative of the forces while all overlaps grow. By
/// differences after steps in which they have grown by a part, 0 by Richardson's extrapolation of
/// three parts.
#[test]
fn stiffness_of_remembered_forces_is_that_of_growing_overlaps() {
    for name in ["hertz", "hertz-tsuji"] {
        let kind = LAWS.iter().find(|law| law.name == name).expect("a law");
        let law = Law::read(kind, &mut of_forces());
        let contact = Contact {
            friction: 0.4,
            ..Contact::NONE
        };
        let force = Three::pair_force(&law, &contact).expect("forces");
        let mut packing = Packing::<Three>::new(force.as_ref(), &contact, cell(3.0));
        let jacobian = packing.jacobian(true);
        assert!(
            jacobian.sliding > 5 && jacobian.contacts > jacobian.sliding + 30,
            "{name}"
        );
        let (k, per_grain) = (jacobian.k.to_dense(), jacobian.per_grain);
        let greatest = k.norm_max();
        let mut worst = 0.0f64;
        for column in 0..jacobian.unknowns() {
            let unknown = (jacobian.grains[column / per_grain], column % per_grain);
            let slopes = [8.0, 16.0, 32.0].map(|part| {
                packing.approach = part * H;
                let [before, after] = [-H, H].map(|by| packing.moved(unknown, by));
                let slope = before.iter().zip(&after).map(|(a, b)| (b - a) / (2.0 * H));
                slope.collect::<Vec<_>>()
            });
            for row in 0..jacobian.unknowns() {
                let at = jacobian.grains[row / per_grain] as usize * per_grain + row % per_grain;
                let [a, b, c] = [slopes[0][at], slopes[1][at], slopes[2][at]];
                let slope = (8.0 * a - 6.0 * b + c) / 3.0;
                worst = worst.max((k[(row, column)] + slope).abs());
            }
        }
        assert!(worst < 1e-3 * greatest, "{name}: {:e}", worst / greatest);
    }
}

/// A frame of disks that overlap at random, with histories and flags at random; `None` if too few
/// touch for a problem.
fn random_frame(random: &mut ChaCha8Rng) -> Option<Problem> {
    let law = Law::read(
        LAWS.iter().find(|l| l.name == "hooke").expect("hooke"),
        &mut examples(),
    );
    let contact = Contact {
        friction: 0.4,
        rolling_friction: 0.1,
        rolling_damping_ratio: 0.0,
        ..Contact::NONE
    };
    let force = Two::pair_force(&law, &contact).expect("a law of disks");
    let count = random.random_range(3..40);
    let side = (count as f64).sqrt() * random.random_range(0.8..2.0);
    let walls = random.random_range(0..3);
    let grain = |id: usize| GrainState {
        id: id as u32,
        body: if id < walls { body::BOTTOM } else { body::FREE },
        position: [
            side * random.random::<f64>(),
            side * random.random::<f64>(),
            0.0,
        ],
        radius: random.random_range(0.4..0.7),
        ..bytemuck::Zeroable::zeroed()
    };
    let grains: Vec<GrainState> = (0..count).map(grain).collect();
    let cell = Cell::between_walls([side, f64::INFINITY]);
    let mut contacts = Vec::new();
    for i in 0..count as u32 {
        for j in i + 1..count as u32 {
            let history = [
                random.random_range(-1.0..1.0),
                0.0,
                random.random_range(-1.0..1.0),
            ];
            let limits = [Some(random.random()), Some(random.random()), None];
            let limits = ContactState::stored(limits, random.random_ratio(1, 20));
            contacts.push(ContactState {
                limits,
                ..ContactState::new(i, j, history)
            });
        }
    }
    let state = NetworkState {
        flat: None,
        grains: &grains,
        contacts: &contacts,
        cell,
        masses: &MASSES,
        at_rest: false,
    };
    let jacobian = assemble::<Two>(state, force.as_ref(), History::Turned);
    jacobian.problem().ok()
}

/// The eigenvalues nearest to shifts, some of them eigenvalues, are those of the dense matrix.
fn spectra_of_random_frames(seeds: std::ops::Range<u64>) {
    let (mut skipped, mut rough, all) = (0, 0, seeds.end - seeds.start);
    for seed in seeds {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let Some(problem) = random_frame(&mut random).filter(|of| of.size() > 0) else {
            skipped += 1;
            continue;
        };
        let n = problem.size();
        let exact = Spectrum::values(&problem);
        let norm = problem.norm();
        let shift = match random.random_range(0..4) {
            0 => c64::new(0.0, 0.0),
            1 => c64::new(norm * random.random_range(-0.2..1.0), 0.0),
            2 => exact[random.random_range(0..n)],
            _ => {
                norm * c64::new(
                    random.random_range(-0.2..1.0),
                    random.random_range(-0.2..0.2),
                )
            }
        };
        let count = random.random_range(1..=n);
        let request = Request {
            shift,
            count,
            left: true,
            par: Par::Seq,
        };
        let found = nearest(
            &problem,
            &Symbolic::new(problem.matrix().symbolic()),
            request,
        );
        let found = found.unwrap_or_else(|why| panic!("seed {seed}: {why:?}"));
        let spectrum = &found.spectrum;
        assert_eq!(spectrum.left.ncols(), spectrum.eigenvalues.len());
        let known = problem.null().ncols();
        assert!(
            spectrum.eigenvalues.len() >= count.min(n - known),
            "seed {seed}"
        );
        assert!(spectrum.eigenvalues.len() <= count + 1, "seed {seed}");
        // Near an eigenvalue the others are rough, as their residuals say, until they are refined.
        if spectrum.eigenvalues.iter().any(|e| e.residual > 1e-9) {
            rough += 1;
            continue;
        }
        // Much less than their distances; rounding moves them by their conditions.
        let conditions = spectrum.eigenvalues.iter().map(|e| e.condition);
        let near = norm * (1e-5 + 1e-10 * conditions.fold(0.0, f64::max));
        let ours: Vec<c64> = spectrum.eigenvalues.iter().map(|e| e.value).collect();
        let has = |values: &[c64], value: c64| values.iter().any(|v| (v - value).norm() <= near);
        let distance = |value: &c64| (value - found.shift).norm();
        let farthest = ours.iter().map(distance).fold(0.0, f64::max);
        for value in &ours {
            assert!(has(&exact, *value), "seed {seed}: {value} is no eigenvalue");
        }
        // Of an eigenvalue of greater multiplicity than the blocks some may be missing, and the
        // translations are not sought.
        for value in exact
            .iter()
            .filter(|v| distance(v) < farthest - near && v.norm() > near)
        {
            assert!(has(&ours, *value), "seed {seed}: {value} is missing");
        }
    }
    assert!(10 * skipped < all, "{skipped} of {all} have no contacts");
    assert!(3 * rough < all, "{rough} of {all} are rough");
}

#[test]
fn spectra_of_some_random_frames() {
    spectra_of_random_frames(0..100);
}

#[test]
#[ignore = "a thousand frames"]
fn spectra_of_a_thousand_random_frames() {
    spectra_of_random_frames(0..1000);
}

/// What a scene can ask for reaches the forces: disks with rolling resistance have a history more.
#[test]
fn rolling_resistance_reaches_the_forces() {
    let rows = |kind, rolling_friction| {
        let contact = Contact {
            friction: 0.4,
            rolling_friction,
            rolling_damping_ratio: 0.0,
            ..Contact::NONE
        };
        let law = Law::read(kind, &mut examples());
        let force = Two::pair_force(&law, &contact).expect("a law of disks");
        force.layout().history.len()
    };
    for kind in LAWS.iter().filter(|kind| kind.rolling) {
        assert_eq!(rows(kind, 0.1), rows(kind, 0.0) + 1, "{}", kind.name);
    }
}
