//! What leaves the run: frames and time series.

use bytemuck::{Pod, Zeroable};

/// A grain in a frame: wrapped position (m), velocity (m/s), angular velocity (rad/s); zeros for what two dimensions lack.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainSample {
    /// Id.
    pub id: u64,
    /// Wrapped position (m).
    pub position: [f64; 3],
    /// Velocity (m/s).
    pub velocity: [f64; 3],
    /// Angular velocity (rad/s).
    pub angular_velocity: [f64; 3],
}

/// A touching contact in a frame; `i < j` are grain ids. Forces are per unit depth in 2D (N/m).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ContactSample {
    /// Lower id.
    pub i: u32,
    /// Higher id.
    pub j: u32,
    /// F_n ≥ 0, repulsive, elastic and damping.
    pub normal_force: f64,
    /// F_t on i, elastic and damping: in 2D the one number along t̂ = ẑ × n (n from j to i), in 3D a vector.
    pub tangential_force: [f64; 3],
    /// What the contact remembers of it: its elastic part, or the displacement of its spring (m); components as of F_t.
    pub tangential_history: [f64; 3],
    /// Elastic part of the rolling torque on i (N): the contact's history.
    pub rolling_history: f64,
    /// δ (m).
    pub overlap: f64,
    /// 1 where the elastic tangential force is at the Coulomb limit, else 0.
    pub sliding: u64,
}

/// Names of the columns of the time series, in `log.csv` and under `observables/` alike.
pub const SERIES_COLUMNS: [&str; 24] = [
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
    "slip",
    "slip_rate",
    "drive_displacement",
    "drive_velocity",
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
    /// γ, displacement of the top wall over the height at the start of the shear.
    pub strain: f64,
    /// τ = S/N; NaN while nothing touches the top wall.
    pub stress_ratio: f64,
    /// N: normal force of the free grains on the top wall (N/m in 2D).
    pub normal_force: f64,
    /// S: force of the free grains on the top wall against its motion (N/m in 2D).
    pub shear_force: f64,
    /// h: distance between the planes at which the walls were cut from the sample (m).
    pub wall_height: f64,
    /// Volume (area in 2D) of the free grains over that between the walls.
    pub solid_fraction: f64,
    /// Mean number of contacts of a free grain.
    pub coordination: f64,
    /// Of the free grains, translation and rotation (J/m in 2D).
    pub kinetic_energy: f64,
    /// Sliding contacts over all contacts.
    pub sliding_fraction: f64,
    /// Velocity of the top wall away from the bottom (m/s).
    pub wall_velocity: f64,
    /// Displacement of the top wall along x since the start of the shear (m), and its velocity (m/s).
    pub slip: f64,
    /// Velocity of the top wall along x (m/s).
    pub slip_rate: f64,
    /// The same of what drives it: the far end of the spring, or the wall itself.
    pub drive_displacement: f64,
    /// Velocity of the drive along x (m/s).
    pub drive_velocity: f64,
    /// The ledger of energy (J/m in 2D), not a number where none is kept. Elastic energy of the contacts.
    pub elastic_normal: f64,
    /// Tangential elastic energy.
    pub elastic_tangential: f64,
    /// Rolling elastic energy.
    pub elastic_rolling: f64,
    /// Work done on the sample since the shear began: by what drives the top along x, and by the load on it.
    pub work_drive: f64,
    /// Work of the load on the top.
    pub work_load: f64,
    /// Lost since then: to damping, to sliding, to rolling at its limit, and to changes of k_t under a force that stays.
    pub lost_damping: f64,
    /// Dissipated by sliding.
    pub lost_friction: f64,
    /// Dissipated by rolling at its limit.
    pub lost_rolling: f64,
    /// Dissipated by changes of k_t under a constant force.
    pub lost_stiffness: f64,
    /// What is missing of the work in the kinetic and elastic energies and the losses, over the sum of the magnitudes of both works.
    pub energy_residual: f64,
}

impl AsRef<[f64]> for SeriesRow {
    fn as_ref(&self) -> &[f64] {
        bytemuck::cast_slice(std::slice::from_ref(self))
    }
}

impl SeriesRow {
    /// The row as the columns of [`SERIES_COLUMNS`].
    pub fn columns(&self) -> [f64; SERIES_COLUMNS.len()] {
        bytemuck::cast(*self)
    }
}
