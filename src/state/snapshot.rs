//! The whole state of a run in pieces that travel: between ranks, into a checkpoint, into the digest.

use bytemuck::{Pod, Zeroable};

/// All of one grain. `body`: 0 free, 1 bottom wall, 2 top wall. SI units.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainState {
    pub id: u32,
    pub body: u32,
    pub position: [f64; 2],
    pub velocity: [f64; 2],
    pub angular_velocity: f64,
    pub radius: f64,
    /// F_x, F_y (N/m) of the last step.
    pub force: [f64; 2],
    /// Torque about z (N) of the last step.
    pub torque: f64,
}

/// All of one touching contact, `i < j`. History: elastic tangential force (N/m), last k_t (Pa), elastic rolling torque (N).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ContactState {
    pub i: u32,
    pub j: u32,
    pub history: [f64; 3],
}

/// This rank's part of a checkpoint. `header` is JSON, the same on every rank: stage, step, walls, what was written so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    pub header: String,
    pub grains: Vec<GrainState>,
    pub contacts: Vec<ContactState>,
}
