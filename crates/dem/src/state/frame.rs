//! What is read from the file of a run: constants of the grains, and frames.

use super::{ContactSample, GrainSample, nearest_image};

/// Constants of the grains during a run, by id; N grains.
#[derive(Debug, Clone, PartialEq)]
pub struct Disks {
    /// `[N]` R (m).
    pub radius: Vec<f64>,
    /// `[N]` 0 free, 1 bottom wall, 2 top wall.
    pub body: Vec<u8>,
    /// `[N]` m (kg; kg/m in 2D).
    pub mass: Vec<f64>,
    /// L_x (m), the period along x.
    pub length: f64,
}

impl Disks {
    /// N, walls included.
    pub fn count(&self) -> usize {
        self.radius.len()
    }

    /// r̄ (m): mean radius of all grains, walls included; NaN without grains.
    pub fn mean_radius(&self) -> f64 {
        self.radius.iter().sum::<f64>() / self.radius.len() as f64
    }

    /// r_to - r_from (m), nearest image along x.
    pub fn separation(&self, from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
        [nearest_image(to[0] - from[0], self.length), to[1] - from[1]]
    }
}

/// One frame of a run of disks or spheres, complete.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameRecords {
    /// Steps since the start of the shear.
    pub step: u64,
    /// Time since the start of the shear (s).
    pub time: f64,
    /// `[N]` by id.
    pub grains: Vec<GrainSample>,
    /// Touching contacts in order of (i, j).
    pub contacts: Vec<ContactSample>,
}

/// One frame of a run of disks. Rows are grain ids.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frame {
    /// Steps since the start of the shear.
    pub step: u64,
    /// Time since the start of the shear (s).
    pub time: f64,
    /// `[N, 2]` wrapped into [0, L_x) along x (m); NaN of a removed grain.
    pub position: Vec<[f64; 2]>,
    /// `[N]` image along x; empty if it is not known.
    pub image: Vec<i64>,
    /// `[N, 2]` at the full step (m/s).
    pub velocity: Vec<[f64; 2]>,
    /// `[N]` about z (rad/s).
    pub angular_velocity: Vec<f64>,
    /// Touching contacts in order of (i, j).
    pub contacts: Vec<ContactSample>,
}
