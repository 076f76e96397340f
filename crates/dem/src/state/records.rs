//! Records of frames and of the time series.

use bytemuck::{Pod, Zeroable};

use super::{Image, body};

/// A grain in a frame: its row of `particles/trajectory` in `run.h5`. In two dimensions the unused
/// components are 0.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainSample {
    /// Id.
    pub id: u32,
    /// 1 if it had passed a wall and was removed, else 0.
    pub removed: u32,
    /// Wrapped position (m).
    pub position: [f64; 3],
    /// Velocity (m/s).
    pub velocity: [f64; 3],
    /// Angular velocity (rad/s).
    pub angular_velocity: [f64; 3],
    /// Image in which it is; see [`GrainState::image`](super::GrainState::image).
    pub image: Image,
}

/// A touching contact in a frame: its row of `contacts` in `run.h5`, or of `wall_contacts` of flat
/// walls; `i < j` are ids. Forces are per unit depth in 2D (N/m).
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct ContactSample {
    /// Lower id.
    pub i: u32,
    /// Higher id; of a contact with a flat wall N for the bottom and N + 1 for the top.
    pub j: u32,
    /// F_n ≥ 0, the sum of the elastic and the damping part, less an attraction.
    pub normal_force: f64,
    /// F_t on i, the sum of the elastic and the damping part: in 2D the component along t̂ = ẑ × n
    /// (n from j to i), in 3D a vector.
    pub tangential_force: [f64; 3],
    /// The history of F_t: its elastic part, or the displacement of its spring (m); components as
    /// of F_t.
    pub tangential_history: [f64; 3],
    /// The history of the rolling torque on i: its elastic part (N).
    pub rolling_history: f64,
    /// δ (m).
    pub overlap: f64,
    /// 1 if the elastic tangential force is at the Coulomb limit, else 0.
    pub sliding: u64,
    /// 1 if the elastic rolling torque is at its limit, else 0.
    pub rolling: u64,
    /// Of spheres, as in [`super::ContactState`] (N m).
    pub torques: [f64; 4],
    /// 1 if the elastic twisting torque is at its limit, else 0.
    pub twisting: u64,
    /// 1 if spring and damper leave no force, as [`super::ContactState::is_idle`], else 0.
    pub idle: u64,
    /// Age, where friction grows with it (s).
    pub age: f64,
}

impl ContactSample {
    /// The flat wall that one of N grains touches, [`body::BOTTOM`] or [`body::TOP`]; `None` if it
    /// touches a grain.
    pub fn wall(&self, grains: usize) -> Option<u32> {
        let side = self.j.checked_sub(grains as u32)?;
        Some(body::BOTTOM + side)
    }
}

crate::columns! {
    /// One row of the time series, in `log.csv` and under `observables/` of `run.h5`.
    pub struct SeriesRow {
        /// γ, displacement of the top wall over the height at the start
        strain: "1",
        /// τ = S/N; NaN while nothing touches the top wall
        stress_ratio: "1",
        /// N, normal force of the free grains on the top wall
        normal_force: "N",
        /// S, force of the free grains on the top wall against its motion
        shear_force: "N",
        /// h, distance between the planes at which the walls were cut
        wall_height: "m",
        /// volume (area in 2D) of the free grains over that of the height h
        solid_fraction: "1",
        /// mean number of contacts of a free grain
        coordination: "1",
        /// of the free grains, translation and rotation
        kinetic_energy: "J",
        /// sliding contacts over all contacts
        sliding_fraction: "1",
        /// velocity of the top wall away from the bottom wall
        wall_velocity: "m s-1",
        /// displacement of the top wall along x
        slip: "m",
        /// velocity of the top wall along x
        slip_rate: "m s-1",
        /// displacement of the far end of the spring, or of the wall itself
        drive_displacement: "m",
        /// velocity of the far end of the spring, or of the wall itself
        drive_velocity: "m s-1",
        /// stored in the contacts, normal part
        elastic_normal: "J",
        /// stored in the contacts, tangential part
        elastic_tangential: "J",
        /// stored in the contacts, rolling part
        elastic_rolling: "J",
        /// work of the drive on the sample, and of a bottom wall that vibrates along x
        work_drive: "J",
        /// work of the load on the sample, or of walls driven along their normals
        work_load: "J",
        /// dissipated by dampers that no limit cuts
        dissipated_damping: "J",
        /// dissipated by sliding
        dissipated_friction: "J",
        /// dissipated by rolling at its limit
        dissipated_rolling: "J",
        /// dissipated by changes of k_t, and by JKR pull-off; negative: gained
        dissipated_stiffness: "J",
        /// energy not accounted for, over the sum of both works' magnitudes
        energy_residual: "1",
    }
}

crate::columns! {
    /// Further columns of a row of the time series, if a protocol imposes more than velocities
    /// along x.
    pub struct ImposedRow {
        /// N imposed on the top wall; NaN while its normal velocity is imposed
        imposed_normal_force: "N",
        /// S imposed on the top wall along x; NaN while it moves with the drive
        imposed_shear_force: "N",
        /// displacement of the bottom wall towards the top wall
        bottom_displacement: "m",
    }
}

crate::columns! {
    /// Further columns of a row of the time series, if the bottom wall vibrates along x.
    pub struct BottomRow {
        /// displacement of the bottom wall along x
        bottom_displacement_x: "m",
    }
}

crate::columns! {
    /// Further columns of a row of the time series of a cell without walls: its stress, of the
    /// contacts and of the peculiar velocities u, and those.
    pub struct StressRow {
        /// (Σ F_x r_x + Σ m u_x²)/V, compression positive
        stress_xx: "Pa",
        /// the same along y
        stress_yy: "Pa",
        /// the same along z; NaN in 2D
        stress_zz: "Pa",
        /// part of the velocities in the mean of these
        kinetic_pressure: "Pa",
        /// mean of u² along an axis, weighed by mass
        velocity_variance: "m2 s-2",
    }
}

crate::columns! {
    /// Further columns of a row of the time series of a cell whose lengths across its height
    /// change.
    pub struct LateralRow {
        /// L_x, length of the cell
        length_x: "m",
        /// L_y, its width; NaN in 2D
        length_y: "m",
        /// Lees–Edwards offset with all periods that were taken from it
        unwrapped_offset: "m",
    }
}

crate::columns! {
    /// Further columns of a row of the time series below a free surface.
    pub struct FlowRow {
        /// of the free grains along x, weighed by mass
        mean_velocity: "m s-1",
    }
}

crate::columns! {
    /// Further columns of a row of the time series with `output.temperatures`: temperatures of the
    /// fluctuations ([`crate::fluctuations`]); NaN if the profiles take all degrees of freedom.
    pub struct TemperatureRow {
        /// T, temperature of velocities about their local mean
        granular_temperature: "J",
        /// temperature of spins about their local mean
        spin_temperature: "J",
    }
}
