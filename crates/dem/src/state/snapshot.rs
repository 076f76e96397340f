//! The whole state of a run in pieces that travel: between ranks, into a checkpoint, into the digest.

use bytemuck::{Pod, Zeroable};

/// All of one grain, in two dimensions with zeros for what it lacks. `body`: 0 free, 1 bottom wall, 2 top wall. SI units.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainState {
    pub id: u32,
    pub body: u32,
    pub position: [f64; 3],
    pub velocity: [f64; 3],
    pub angular_velocity: [f64; 3],
    pub radius: f64,
    /// Force of the last step (N; N/m in 2D).
    pub force: [f64; 3],
    /// Torque of the last step (N m; N in 2D).
    pub torque: [f64; 3],
}

/// All of one touching contact, `i < j`. History in 2D: what the law remembers along t̂ (elastic force, N/m, or displacement, m),
/// last k_t (Pa), elastic rolling torque (N); in 3D: the tangential vector that it remembers (force, N, or displacement, m).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ContactState {
    pub i: u32,
    pub j: u32,
    pub history: [f64; 3],
}

/// Where a grain was in a frame (m): what the scalars of a frame need of it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainPlace {
    pub id: u32,
    pub body: u32,
    pub position: [f64; 2],
}

/// What bore on a contact in a frame, `i < j` (N/m): what the scalars of a frame need of it.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ContactForce {
    pub i: u32,
    pub j: u32,
    pub normal_force: f64,
    pub tangential_force: f64,
}

/// This rank's part of a frame whose scalars are wanted; over the ranks every grain and every contact comes once.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FramePart {
    pub grains: Vec<GrainPlace>,
    pub contacts: Vec<ContactForce>,
}

/// How far a grain has come since a stage began.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Travel {
    pub id: u32,
    pub body: u32,
    /// Where it was then (m), wrapped.
    pub start: [f64; 3],
    /// How far it has turned (rad), the sum over the steps.
    pub angle: [f64; 3],
}

/// This rank's part of a checkpoint. `header` is JSON, the same on every rank: stage, step, walls, what was written so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    pub header: String,
    pub grains: Vec<GrainState>,
    pub contacts: Vec<ContactState>,
    /// The last frame of which the run computed scalars, on every rank or on none: the next ones are between it and the next.
    pub analysed: Option<FramePart>,
    /// Of a stage that measures how far grains move, on every rank or on none.
    pub travels: Option<Vec<Travel>>,
}
