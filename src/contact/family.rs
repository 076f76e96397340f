//! A law before friction and rolling are chosen, so that a run can take the one it needs, with nothing in it that the scene lacks.

use std::marker::PhantomData;

use super::ContactLaw;
use super::hertz::Hertz;
use super::hooke::Hooke;
use super::lee_hurley::LeeHurley;
use super::mindlin::Mindlin;
use crate::config::{Contact, Material, MindlinSprings, Scene, Spheres, Springs, derived};
use crate::dimension::{Dimension, Three, Two};

/// The constants of a law's springs, of which it can be made with and without friction and rolling.
pub trait Family: Copy {
    type Space: Dimension;
    type Law<const FRICTION: bool, const ROLLING: bool>: ContactLaw<Space = Self::Space>;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING>;

    /// The same while the sample is packed.
    fn packing(&self, _: &Scene) -> Self {
        *self
    }
}

impl Family for Material {
    type Space = Two;
    type Law<const FRICTION: bool, const ROLLING: bool> = LeeHurley<FRICTION, ROLLING>;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING> {
        LeeHurley::new(self, contact)
    }
}

/// Linear springs in the plane.
impl Family for Springs {
    type Space = Two;
    type Law<const FRICTION: bool, const ROLLING: bool> = Hooke<Two, FRICTION, ROLLING>;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING> {
        Hooke::new(self, contact)
    }
}

/// Linear springs between spheres, which have no rolling resistance.
#[derive(Debug, Clone, Copy)]
pub struct SpringsInSpace(pub Springs);

impl Family for SpringsInSpace {
    type Space = Three;
    type Law<const FRICTION: bool, const ROLLING: bool> = Hooke<Three, FRICTION, false>;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING> {
        Hooke::new(&self.0, contact)
    }
}

/// BO's law in the plane or in space, without rolling resistance.
#[derive(Debug, Clone, Copy)]
pub struct MindlinIn<D> {
    springs: MindlinSprings,
    space: PhantomData<D>,
}

impl<D> MindlinIn<D> {
    pub fn new(springs: MindlinSprings) -> Self {
        Self {
            springs,
            space: PhantomData,
        }
    }
}

impl<D: Dimension> Family for MindlinIn<D> {
    type Space = D;
    type Law<const FRICTION: bool, const ROLLING: bool> = Mindlin<D, FRICTION>;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING> {
        Mindlin::new(&self.springs, contact)
    }
}

/// Spheres without rolling resistance.
impl Family for Spheres {
    type Space = Three;
    type Law<const FRICTION: bool, const ROLLING: bool> = Hertz<FRICTION>;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING> {
        Hertz::new(self, contact)
    }

    /// Damped more: a gas of spheres that lose little when they collide bears the load for long.
    fn packing(&self, scene: &Scene) -> Self {
        derived::packing_spheres(self, &scene.sample, scene.load.pressure)
    }
}
