//! The grains of this rank: owned grains, in the order of their cells, on one thread first the free
//! ones, then ghosts.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::Zeroable;

use crate::dimension::Dimension;

use super::{CandidatePair, GrainState, Image, body};

/// Units of the contact forces, powers of two.
///
/// Forces and torques are rounded to their units before they are added to the grains. Sums of whole
/// multiples are exact, so they do not depend on the order ([contract 1](crate#contracts)), and the
/// forces on the two grains of a contact cancel exactly.
///
/// Slips and rotations are rounded before they stretch a spring. Less than half a unit in a step
/// stretches none, so the springs of a grain at rest do not change. Without this they would drift,
/// by velocities too small to change a rounded position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// Of forces (N; per unit depth in 2D): 2^-50 to 2^-49 of the greatest force of the law. About
    /// the error k X 2^-53 from the rounding of positions up to X, as the greatest force is k R/10,
    /// or k R of linear springs.
    pub force: f64,
    /// Of torques (N m; per unit depth in 2D).
    pub torque: f64,
    /// Of slips (m): 2^-53 to 2^-52 of the greatest radius.
    pub slip: f64,
}

impl Units {
    /// Of rotations (rad).
    pub(crate) const ROTATION: f64 = 1.0 / (1u64 << 53) as f64;

    /// The units for the greatest force (N; N/m in 2D) and radius (m) of a contact, both positive.
    pub fn new(largest_force: f64, largest_radius: f64) -> Self {
        let force = power_of_two_above(largest_force) * 2f64.powi(-50);
        let radius = power_of_two_above(largest_radius);
        Self {
            force,
            torque: 2.0 * force * radius,
            slip: Self::ROTATION * radius,
        }
    }

    /// The number that rounds others to this unit, if added and then subtracted; for numbers of up
    /// to 2^51 units.
    #[inline(always)]
    pub fn shift(unit: f64) -> f64 {
        unit * (3u64 << 51) as f64
    }

    /// The greatest force that is rounded correctly.
    pub fn largest_force(&self) -> f64 {
        self.force * 2f64.powi(51)
    }
}

impl Default for Units {
    fn default() -> Self {
        Self::new(1.0, 1.0)
    }
}

/// The least power of two that is greater than x.
fn power_of_two_above(x: f64) -> f64 {
    let exponent = (x.to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((exponent + 1) << 52)
}

/// How the masses of the grains follow from their sizes.
#[derive(Debug, Clone, PartialEq)]
pub enum Masses {
    /// ρ (kg/m³) of all.
    Density(f64),
    /// ρ (kg/m³) of each material.
    Densities(Arc<[f64]>),
    /// m (kg; kg/m in 2D), the same for all, whatever their size.
    Equal(f64),
}

impl Masses {
    /// m (kg; kg/m in 2D) of a grain of this material and volume (m³; m² in 2D).
    pub fn of(&self, material: u64, volume: f64) -> f64 {
        match self {
            Masses::Density(density) => density * volume,
            Masses::Densities(of) => of[material as usize] * volume,
            Masses::Equal(mass) => *mass,
        }
    }
}

/// Flat walls: rigid planes across the last axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FlatWalls {
    /// N, the number of grains: the bottom has this id, the top the next one.
    pub first_id: u32,
    /// Their material.
    pub material: u64,
}

/// The point of a flat wall right below or above a grain. To the kernel it is the second grain of a
/// pair, with radius 0, whose normal does not turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Foot {
    /// The grain.
    pub grain: u32,
    /// Whether it is of the top.
    pub is_top: bool,
}

/// Structure of arrays over owned grains, ghosts and feet. Arrays that only owned grains need are
/// shorter.
#[derive(Debug, Default)]
pub struct Grains<D: Dimension> {
    /// Number of owned grains.
    pub owned: usize,
    /// Ids.
    pub id: Vec<u32>,
    /// Bodies; see [`body`].
    pub body: Vec<u32>,
    /// Radii (m).
    pub radius: Vec<f64>,
    /// Materials.
    pub material: Vec<u64>,
    /// Positions and velocities.
    pub record: Vec<D::Record>,
    /// Forces and torques.
    pub force: Vec<D::Force>,
    /// The units of the contact forces.
    pub units: Units,
    /// m (kg; kg/m in 2D), owned grains.
    pub mass: Vec<f64>,
    /// ½Δt/m and ½Δt/I, owned grains; 0 for those of walls.
    pub half_kick: Vec<[f64; 2]>,
    /// Images, owned grains; see [`GrainState::image`].
    pub image: Vec<Image>,
    /// The last of the grains are these.
    pub feet: Vec<Foot>,
}

/// The first axis of the spins: z in two dimensions, x in three.
const fn first_spin<D: Dimension>() -> usize {
    3 - D::SPINS
}

impl<D: Dimension> Grains<D> {
    /// Number of owned grains, ghosts and feet.
    pub fn local(&self) -> usize {
        self.id.len()
    }

    /// The first of the feet.
    fn first_foot(&self) -> usize {
        self.local() - self.feet.len()
    }

    /// Gives every owned grain that is closer than its radius and `reach` (m) to one of these
    /// planes (m) a foot in it. Returns the pairs of both.
    pub(crate) fn stand_on(
        &mut self,
        walls: FlatWalls,
        planes: [f64; 2],
        reach: f64,
    ) -> Vec<CandidatePair> {
        let mut pairs = Vec::new();
        for grain in 0..self.owned {
            if self.body[grain] != body::FREE {
                continue;
            }
            for (side, plane) in planes.into_iter().enumerate() {
                let distance = (self.fields(grain)[D::UP] - plane).abs();
                let gap = distance - self.radius[grain];
                if gap >= reach {
                    continue;
                }
                pairs.push(CandidatePair {
                    grains: [grain as u32, self.local() as u32],
                    gap,
                });
                let is_top = side == 1;
                self.feet.push(Foot {
                    grain: grain as u32,
                    is_top,
                });
                self.push(&GrainState {
                    id: walls.first_id + side as u32,
                    body: if is_top { body::TOP } else { body::BOTTOM },
                    material: walls.material,
                    ..GrainState::zeroed()
                });
            }
        }
        self.put_feet(planes);
        pairs
    }

    /// Puts the feet into these planes (m), at their grains.
    pub(crate) fn put_feet(&mut self, planes: [f64; 2]) {
        let first = self.first_foot();
        for k in 0..self.feet.len() {
            let Foot { grain, is_top } = self.feet[k];
            let mut at = self.position(grain as usize);
            at[D::UP] = planes[usize::from(is_top)];
            self.fields_mut(first + k)[..D::AXES].copy_from_slice(&at[..D::AXES]);
        }
    }

    /// Removes the feet.
    pub(crate) fn lift_feet(&mut self) {
        self.truncate(self.first_foot());
        self.feet.clear();
    }

    /// Keeps the first `count` grains.
    fn truncate(&mut self, count: usize) {
        self.id.truncate(count);
        self.body.truncate(count);
        self.radius.truncate(count);
        self.material.truncate(count);
        self.record.truncate(count);
        self.force.truncate(count);
    }

    /// Whether this is a foot, and not a grain.
    pub(crate) fn is_foot(&self, g: usize) -> bool {
        g >= self.first_foot()
    }

    /// Replaces all grains by these owned ones, without ghosts. `step`: Δt (s).
    pub fn replace(&mut self, owned: &[GrainState], masses: &Masses, step: f64) {
        self.owned = owned.len();
        self.truncate(0);
        self.mass.clear();
        self.image.clear();
        self.feet.clear();
        for g in owned {
            self.push(g);
            self.image.push(g.image);
            self.mass.push(masses.of(g.material, D::volume(g.radius)));
        }
        self.set_step(step);
    }

    /// Appends an owned grain or a ghost.
    pub fn push(&mut self, g: &GrainState) {
        self.id.push(g.id);
        self.body.push(g.body);
        self.radius.push(g.radius);
        self.material.push(g.material);
        let axes = 0..D::AXES;
        let spins = first_spin::<D>()..3;
        let mut record = D::Record::zeroed();
        let mut put = |at: usize, values: &[f64]| {
            D::fields_mut(&mut record)[at..at + values.len()].copy_from_slice(values);
        };
        put(D::POSITION, &g.position[axes.clone()]);
        put(D::VELOCITY, &g.velocity[axes.clone()]);
        put(D::HALF_VELOCITY, &g.velocity[axes.clone()]);
        put(D::HALF_SPIN, &g.angular_velocity[spins.clone()]);
        put(D::SPIN, &g.angular_velocity[spins.clone()]);
        if let Some([at, _]) = D::RADIUS {
            put(at, &[g.radius]);
        }
        self.record.push(record);
        let mut force = D::Force::zeroed();
        let sums = &mut force[..];
        sums[..D::TORQUE].copy_from_slice(&g.force[axes]);
        sums[D::TORQUE..D::TORQUE + D::SPINS].copy_from_slice(&g.torque[spins]);
        self.force.push(force);
    }

    /// Keeps the owned grains, which must all be `kept`, and the ghosts that are. Returns the new
    /// local indices by the old ones.
    pub fn retain(&mut self, kept: &[bool]) -> Vec<u32> {
        fn retain<T>(values: &mut Vec<T>, kept: &[bool]) {
            let mut kept = kept.iter();
            values.retain(|_| kept.next() == Some(&true));
        }
        debug_assert!(kept[..self.owned].iter().all(|kept| *kept));
        retain(&mut self.id, kept);
        retain(&mut self.body, kept);
        retain(&mut self.radius, kept);
        retain(&mut self.material, kept);
        retain(&mut self.record, kept);
        retain(&mut self.force, kept);
        let mut next = 0;
        let number = |&kept: &bool| {
            let here = next;
            next += u32::from(kept);
            here
        };
        kept.iter().map(number).collect()
    }

    /// Sets Δt (s).
    pub(crate) fn set_step(&mut self, step: f64) {
        self.half_kick.clear();
        for g in 0..self.owned {
            let (m, r) = (self.mass[g], self.radius[g]);
            self.half_kick.push(if self.body[g] == body::FREE {
                [0.5 * step / m, 0.5 * step / (D::INERTIA * m * r * r)]
            } else {
                [0.0; 2]
            });
        }
    }

    /// Removes an owned grain that has passed a wall, the upper or the lower one, which its image
    /// along the last axis then says. The next list has none of its contacts.
    pub fn remove(&mut self, g: usize) {
        self.body[g] = body::REMOVED;
        self.fields_mut(g)[D::VELOCITY..D::SPIN + D::SPINS].fill(0.0);
        self.force[g] = D::Force::zeroed();
        self.half_kick[g] = [0.0; 2];
    }

    /// The record of a grain.
    pub fn fields(&self, g: usize) -> &[f64] {
        D::fields(&self.record[g])
    }

    /// The record of a grain, to change it.
    pub fn fields_mut(&mut self, g: usize) -> &mut [f64] {
        D::fields_mut(&mut self.record[g])
    }

    /// The wrapped position of a grain (m).
    pub fn position(&self, g: usize) -> [f64; 3] {
        let mut x = [0.0; 3];
        x[..D::AXES].copy_from_slice(&self.fields(g)[..D::AXES]);
        x
    }

    /// The record of an owned grain and its image, to move it.
    pub fn place_mut(&mut self, g: usize) -> (&mut [f64], &mut Image) {
        (D::fields_mut(&mut self.record[g]), &mut self.image[g])
    }

    /// The complete state of a grain.
    pub fn state(&self, g: usize) -> GrainState {
        let (r, f) = (self.fields(g), &self.force[g][..]);
        let vector = |from: &[f64], at: usize, axes: &Range<usize>| {
            let mut v = [0.0; 3];
            v[axes.clone()].copy_from_slice(&from[at..at + axes.len()]);
            v
        };
        let (axes, spins) = (0..D::AXES, first_spin::<D>()..3);
        GrainState {
            id: self.id[g],
            body: self.body[g],
            position: vector(r, D::POSITION, &axes),
            velocity: vector(r, D::VELOCITY, &axes),
            angular_velocity: vector(r, D::SPIN, &spins),
            radius: self.radius[g],
            force: vector(f, 0, &axes),
            torque: vector(f, D::TORQUE, &spins),
            // Ghosts have none.
            image: self.image.get(g).copied().unwrap_or_default(),
            material: self.material[g],
        }
    }

    /// The owned grains and feet of a body.
    pub fn of_body(&self, body: u32) -> impl Iterator<Item = u32> + '_ {
        let owned = (0..self.owned).chain(self.first_foot()..self.local());
        owned
            .filter(move |&g| self.body[g] == body)
            .map(|g| g as u32)
    }

    /// Heap in use (bytes).
    pub fn memory(&self) -> usize {
        (self.id.capacity() + self.body.capacity()) * size_of::<u32>()
            + (self.radius.capacity() + self.mass.capacity()) * size_of::<f64>()
            + self.material.capacity() * size_of::<u64>()
            + self.record.capacity() * size_of::<D::Record>()
            + self.force.capacity() * size_of::<D::Force>()
            + self.half_kick.capacity() * size_of::<[f64; 2]>()
            + self.image.capacity() * size_of::<Image>()
    }
}
