//! A law before friction and rolling are chosen, so that a run can take the one it needs, with nothing in it that the scene lacks.

use super::ContactLaw;
use super::hooke::Hooke;
use super::lee_hurley::LeeHurley;
use crate::config::{Contact, Material, Springs};

/// The constants of a law's springs, of which it can be made with and without friction and rolling.
pub trait Family: Copy {
    type Law<const FRICTION: bool, const ROLLING: bool>: ContactLaw;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING>;
}

impl Family for Material {
    type Law<const FRICTION: bool, const ROLLING: bool> = LeeHurley<FRICTION, ROLLING>;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING> {
        LeeHurley::new(self, contact)
    }
}

impl Family for Springs {
    type Law<const FRICTION: bool, const ROLLING: bool> = Hooke<FRICTION, ROLLING>;

    fn law<const FRICTION: bool, const ROLLING: bool>(
        &self,
        contact: &Contact,
    ) -> Self::Law<FRICTION, ROLLING> {
        Hooke::new(self, contact)
    }
}
