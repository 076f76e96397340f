//! What is read from the file of a run: constants of the grains, and frames.

use super::{Cell, ContactSample, GrainSample, body};
use crate::dimension::{Dimensions, Three, Two};

/// Constants of the grains during a run, by id; N grains.
#[derive(Debug, Clone, PartialEq)]
pub struct GrainConstants {
    /// `[N]` R (m).
    pub radius: Vec<f64>,
    /// `[N]` 0 free, 1 bottom wall, 2 top wall.
    pub body: Vec<u8>,
    /// `[N]` m (kg; kg/m in 2D).
    pub mass: Vec<f64>,
}

impl GrainConstants {
    /// N, walls included.
    pub fn count(&self) -> usize {
        self.radius.len()
    }

    /// r̄ (m): mean radius of all grains, walls included; NaN without grains.
    pub fn mean_radius(&self) -> f64 {
        self.radius.iter().sum::<f64>() / self.radius.len() as f64
    }
}

/// One frame of a run of disks or spheres, between walls or in a box. Rows are grain ids.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Disks or spheres.
    pub dimension: Dimensions,
    /// The periodic cell.
    pub cell: Cell,
    /// Steps since the start of the shear.
    pub step: u64,
    /// Time since the start of the shear (s).
    pub time: f64,
    /// `[N]` by id.
    pub grains: Vec<GrainSample>,
    /// Touching contacts between grains, in order of (i, j).
    pub contacts: Vec<ContactSample>,
    /// Touching contacts with flat walls, in order of (i, j); none in files of earlier versions.
    pub wall_contacts: Vec<ContactSample>,
}

impl Frame {
    /// Whether the grains are disks between walls.
    pub fn is_of_disks_between_walls(&self) -> bool {
        self.dimension == Dimensions::Two && self.cell.sheared.is_none()
    }

    /// The unit vector from the flat wall of a contact to its grain; `None` between grains.
    pub fn wall_normal(&self, contact: &ContactSample) -> Option<[f64; 3]> {
        let wall = contact.wall(self.grains.len())?;
        let mut normal = [0.0; 3];
        normal[self.dimension.axes() - 1] = if wall == body::TOP { -1.0 } else { 1.0 };
        Some(normal)
    }

    /// Whether a grain had passed a wall and was removed.
    pub fn is_removed(&self, grain: usize) -> bool {
        self.grains[grain].removed != 0
    }

    /// Position of a grain (m), wrapped; NaN if it was removed.
    pub fn position(&self, grain: usize) -> [f64; 3] {
        if self.is_removed(grain) {
            [f64::NAN; 3]
        } else {
            self.grains[grain].position
        }
    }

    /// r_to - r_from (m) of two grains, nearest image.
    pub fn separation(&self, from: u32, to: u32) -> [f64; 3] {
        let [from, to] = [from, to].map(|grain| &self.grains[grain as usize].position);
        match self.dimension {
            Dimensions::Two => self.cell.separation::<Two>(to, from),
            Dimensions::Three => self.cell.separation::<Three>(to, from),
        }
    }
}
