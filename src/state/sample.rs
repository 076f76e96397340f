//! What leaves the run: frames and time series.

use bytemuck::{Pod, Zeroable};

/// A grain in a frame: wrapped position (m), velocity (m/s), angular velocity about z (rad/s).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainSample {
    pub id: u64,
    pub position: [f64; 2],
    pub velocity: [f64; 2],
    pub angular_velocity: f64,
}

/// A touching contact in a frame; `i < j` are grain ids. Forces are per unit depth in 2D (N/m).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ContactSample {
    pub i: u32,
    pub j: u32,
    /// F_n ≥ 0, repulsive, elastic and damping.
    pub normal_force: f64,
    /// F_t on i along t̂ = ẑ × n (n from j to i), elastic and damping.
    pub tangential_force: f64,
    /// Elastic part of F_t: the contact's history.
    pub tangential_history: f64,
    /// Elastic part of the rolling torque on i (N): the contact's history.
    pub rolling_history: f64,
    /// δ (m).
    pub overlap: f64,
    /// 1 where the elastic tangential force is at the Coulomb limit, else 0.
    pub sliding: u64,
}

/// Names of the columns of the time series, in `log.csv` and under `observables/` alike.
pub const SERIES_COLUMNS: [&str; 20] = [
    "strain",
    "stress_ratio",
    "normal_force",
    "shear_force",
    "wall_height",
    "solid_fraction",
    "coordination",
    "kinetic_energy",
    "sliding_fraction",
    "wall_velocity",
    "elastic_normal",
    "elastic_tangential",
    "elastic_rolling",
    "work_drive",
    "work_load",
    "lost_damping",
    "lost_friction",
    "lost_rolling",
    "lost_stiffness",
    "energy_residual",
];

/// One row of the time series, in the order of [`SERIES_COLUMNS`].
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SeriesRow {
    /// γ, wall displacement over the height at the start of the shear.
    pub strain: f64,
    /// τ = S/N; NaN while nothing touches the top wall.
    pub stress_ratio: f64,
    /// N: normal force of the free grains on the top wall (N/m in 2D).
    pub normal_force: f64,
    /// S: force of the free grains on the top wall against its motion (N/m in 2D).
    pub shear_force: f64,
    /// h: distance between the planes at which the walls were cut from the sample (m).
    pub wall_height: f64,
    /// Area of the free grains over that between the walls.
    pub solid_fraction: f64,
    /// Mean number of contacts of a free grain.
    pub coordination: f64,
    /// Of the free grains, translation and rotation (J/m in 2D).
    pub kinetic_energy: f64,
    /// Sliding contacts over all contacts.
    pub sliding_fraction: f64,
    /// Velocity of the top wall along y (m/s).
    pub wall_velocity: f64,
    /// The ledger of energy (J/m in 2D), not a number where none is kept. Elastic energy of the contacts.
    pub elastic_normal: f64,
    pub elastic_tangential: f64,
    pub elastic_rolling: f64,
    /// Work done on the sample since the shear began: by what drives the top along x, and by the load on it.
    pub work_drive: f64,
    pub work_load: f64,
    /// Lost since then: to damping, to sliding, to rolling at its limit, and to changes of k_t under a force that stays.
    pub lost_damping: f64,
    pub lost_friction: f64,
    pub lost_rolling: f64,
    pub lost_stiffness: f64,
    /// What is missing of the work in the kinetic and elastic energies and the losses, over the sum of the magnitudes of both works.
    pub energy_residual: f64,
}

impl SeriesRow {
    /// The row as the columns of [`SERIES_COLUMNS`].
    pub fn columns(&self) -> [f64; SERIES_COLUMNS.len()] {
        bytemuck::cast(*self)
    }
}
