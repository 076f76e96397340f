//! The stiffness matrix K = -∂F̃/∂q of a state, F̃ being the elastic forces and torques on the
//! grains and q their positions and rotations (docs/explanation/spectrum.md).
//!
//! K is the exact derivative of this code's own force routine, in which histories rotate with the
//! contacts; [`paper_form`] gives J as BO's appendix B prints it. Modes solve K v = λ M v with M =
//! diag(m, I); λ > 0 is stable. C = -∂F/∂q̇ is the damping matrix of the same grains
//! ([`damping`]).

mod contact;
mod paper;
mod pattern;

use faer::Mat;
use faer::sparse::SparseColMat;

use contact::{LinearContact, TurningNormal};
use gshear_dem::contact::model::WALL;
use gshear_dem::contact::stiffness::{SpringState, Stiffness};
use gshear_dem::dimension::Dimension;
use gshear_dem::state::{Cell, ContactState, FlatWalls, GrainState, Masses, body, length};
use gshear_spectrum::{Problem, Unfit};
use pattern::Pattern;

pub use paper::paper_form;

/// The state at which K is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct NetworkState<'a> {
    /// All grains, in the order of their ids 0 … N-1.
    pub grains: &'a [GrainState],
    /// Contacts, each once. Those without overlap, and those whose damper leaves no force, add
    /// nothing.
    pub contacts: &'a [ContactState],
    /// The cell, periodic or with walls.
    pub cell: Cell,
    /// Flat walls, and their heights (m), if there are some.
    pub flat: Option<(FlatWalls, [f64; 2])>,
    /// Masses of the grains.
    pub masses: &'a Masses,
    /// Whether it is in equilibrium, so that the elastic forces alone decide which contacts are at
    /// their limits; else it is as the contacts say.
    pub at_rest: bool,
}

/// Whether the tangential history rotates with n.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum History {
    /// It rotates, as in the force routine.
    Turned,
    /// It does not, as in BO's A10, where t stays fixed while n rotates.
    Unturned,
}

/// The forces whose derivatives are taken: elastic ones by places, or those of dampers by
/// velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Forces {
    Elastic,
    Damping,
}

/// K and M over the unknowns of the free grains. Each grain has its position and then its rotation:
/// x, y, θ in two dimensions, x, y, z, θ_x, θ_y, θ_z in three.
pub struct Jacobian {
    /// K (N/m, N, N m; per unit depth in 2D). Grains without contacts have blocks of zeros.
    pub k: SparseColMat<usize, f64>,
    /// Diagonal of M: m (kg) and I (kg m²), per unit depth in 2D.
    pub mass: Vec<f64>,
    /// Ids of the free grains, in the order of their unknowns.
    pub grains: Vec<u32>,
    /// Number of unknowns per grain.
    pub per_grain: usize,
    /// Number of position unknowns per grain.
    pub axes: usize,
    /// Number of contacts that add to K.
    pub contacts: usize,
    /// Number of those contacts at the limit of friction.
    pub sliding: usize,
    /// Whether wall grains are held, so that translations are no zero modes.
    held: bool,
}

impl Jacobian {
    /// Returns the number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.mass.len()
    }

    /// Creates the eigenvalue problem K v = λ M v with the translations as null vectors.
    /// [`gshear_spectrum::Solver`] takes it as well.
    ///
    /// # Errors
    /// [`Unfit`] if K is not finite.
    pub fn problem(&self) -> Result<Problem, Unfit> {
        Problem::new(&self.k, &self.mass, self.translations().as_ref())
    }

    /// Returns a vector over the unknowns from a vector and an axial vector per free grain, given
    /// by id: force and torque, or displacement and rotation.
    pub fn unknowns_of(&self, vectors: impl Fn(u32) -> [[f64; 3]; 2]) -> Vec<f64> {
        let spins = self.per_grain - self.axes;
        let mut unknowns = Vec::with_capacity(self.unknowns());
        for &g in &self.grains {
            let [linear, angular] = vectors(g);
            unknowns.extend(&linear[..self.axes]);
            unknowns.extend(&angular[3 - spins..]);
        }
        unknowns
    }

    /// Returns every free grain with its two vectors: the inverse of [`Jacobian::unknowns_of`].
    /// Components that two dimensions lack are zero.
    pub fn by_grain<'a>(&'a self, x: &'a [f64]) -> impl Iterator<Item = (u32, [[f64; 3]; 2])> + 'a {
        let spins = self.per_grain - self.axes;
        let grains = self.grains.iter().zip(x.chunks_exact(self.per_grain));
        grains.map(move |(&g, x)| {
            let mut both = [[0.0; 3]; 2];
            both[0][..self.axes].copy_from_slice(&x[..self.axes]);
            both[1][3 - spins..].copy_from_slice(&x[self.axes..]);
            (g, both)
        })
    }

    /// Returns the translations of all grains, `[unknowns][axes]`: null vectors of K and of its
    /// transpose. There are no columns if walls hold the grains.
    pub fn translations(&self) -> Mat<f64> {
        let columns = if self.held { 0 } else { self.axes };
        Mat::from_fn(self.unknowns(), columns, |row, axis| {
            f64::from(u8::from(row % self.per_grain == axis))
        })
    }
}

impl NetworkState<'_> {
    /// The grain of this id; of a flat wall what grain i touches there: a point of it, without a
    /// radius.
    fn partner<D: Dimension>(&self, i: &GrainState, id: u32) -> Option<GrainState> {
        if let Some(grain) = self.grains.get(id as usize) {
            return Some(*grain);
        }
        let (walls, planes) = self.flat?;
        let mut position = i.position;
        position[D::UP] = *planes.get(id.checked_sub(walls.first_id)? as usize)?;
        Some(GrainState {
            position,
            radius: 0.0,
            material: walls.material,
            ..*i
        })
    }

    /// The contact of two grains, or `None` without overlap or force.
    fn touch<D: Dimension>(
        &self,
        contact: &ContactState,
        pair: [&GrainState; 2],
        law: &dyn Stiffness,
        forces: Forces,
    ) -> Option<LinearContact> {
        let [a, b] = pair;
        let r = self.cell.separation::<D>(&a.position, &b.position);
        let distance = length(r);
        let n = r.map(|x| x / distance);
        // A plane has no curvature, and its normal does not turn.
        let (radius, turns_at) = if b.radius > 0.0 {
            (b.radius, distance)
        } else {
            (WALL * a.radius, f64::INFINITY)
        };
        let springs = SpringState {
            materials: [a.material, b.material],
            radii: [a.radius, radius],
            overlap: a.radius + b.radius - distance,
            history: contact.history,
            torques: contact.torques,
            age: contact.age,
            limits: if self.at_rest {
                [None; 3]
            } else {
                contact.limits()
            },
        };
        if springs.overlap <= -law.gap(springs.materials, springs.radii) {
            return None;
        }
        let idle = contact.is_idle() && !self.at_rest;
        let normal = TurningNormal {
            n: n.into(),
            distance: turns_at,
        };
        LinearContact::new::<D>(law, forces, normal, springs, idle)
    }
}

/// A matrix over the unknowns of the free grains, and what it is of.
struct Assembled {
    matrix: SparseColMat<usize, f64>,
    /// Ids of the free grains.
    free: Vec<u32>,
    contacts: usize,
    sliding: usize,
}

/// Adds the contacts in the order given, so the result is deterministic.
fn assembled<D: Dimension>(
    state: NetworkState<'_>,
    law: &dyn Stiffness,
    forces: Forces,
    history: History,
) -> Assembled {
    let NetworkState {
        grains, contacts, ..
    } = state;
    let in_order = grains.iter().enumerate().all(|(k, g)| g.id as usize == k);
    assert!(
        in_order,
        "grains must be given in the order of their ids 0 … N-1"
    );
    let mut place = vec![None; grains.len()];
    let mut free = Vec::new();
    for g in grains.iter().filter(|g| g.body == body::FREE) {
        place[g.id as usize] = Some(free.len());
        free.push(g.id);
    }
    let touching = contacts.iter().filter_map(|c| {
        let i = &grains[c.i as usize];
        let pair = [i, &state.partner::<D>(i, c.j)?];
        let contact = state.touch::<D>(c, pair, law, forces)?;
        let places = [c.i, c.j].map(|g| place.get(g as usize).copied().flatten());
        Some((contact, places))
    });
    let touching: Vec<(LinearContact, [Option<usize>; 2])> = touching.collect();
    let places = touching.iter().map(|(_, places)| places);
    let pairs = places.filter_map(|[i, j]| Some([(*i)?, (*j)?]));
    let pattern = Pattern::new(free.len(), D::AXES + D::SPINS, pairs);
    let mut values = vec![0.0; pattern.entries()];
    for (contact, places) in &touching {
        let block = contact.stiffness::<D>(history);
        for (a, row) in places.iter().enumerate() {
            for (b, column) in places.iter().enumerate() {
                if let (Some(row), Some(column)) = (*row, *column) {
                    let block = block.pair(a, b);
                    pattern.add(&mut values, row, column, |r, c| block.entry(r, c));
                }
            }
        }
    }
    Assembled {
        matrix: pattern.matrix(values),
        free,
        contacts: touching.len(),
        sliding: touching.iter().filter(|(c, _)| c.slides()).count(),
    }
}

/// Assembles K and M of a state.
///
/// # Panics
/// If `state.grains` is not in the order of the ids 0 … N-1.
pub fn assemble<D: Dimension>(
    state: NetworkState<'_>,
    law: &dyn Stiffness,
    history: History,
) -> Jacobian {
    let found = assembled::<D>(state, law, Forces::Elastic, history);
    let mass = found.free.iter().flat_map(|&g| {
        let GrainState {
            radius, material, ..
        } = state.grains[g as usize];
        let m = state.masses.of(material, D::volume(radius));
        let inertia = D::INERTIA * m * radius * radius;
        let masses = std::iter::repeat_n(m, D::AXES);
        masses.chain(std::iter::repeat_n(inertia, D::SPINS))
    });
    Jacobian {
        mass: mass.collect(),
        k: found.matrix,
        held: found.free.len() < state.grains.len() || state.flat.is_some(),
        grains: found.free,
        per_grain: D::AXES + D::SPINS,
        axes: D::AXES,
        contacts: found.contacts,
        sliding: found.sliding,
    }
}

/// Assembles C of a state (kg/s, kg m/s, kg m²/s; per unit depth in 2D), over the unknowns of
/// [`assemble`]: minus the derivatives of the forces by the velocities, at small velocities. That
/// the dampers depend on the places, which adds to K in the measure of the velocities, is left out.
///
/// # Panics
/// If `state.grains` is not in the order of the ids 0 … N-1.
pub fn damping<D: Dimension>(
    state: NetworkState<'_>,
    law: &dyn Stiffness,
) -> SparseColMat<usize, f64> {
    assembled::<D>(state, law, Forces::Damping, History::Unturned).matrix
}
