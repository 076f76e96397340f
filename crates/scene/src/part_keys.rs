//! The keys of a part of `shear.protocol`.

use std::ops::Bound;

use gshear_dem::laws::keys::{ANY, Bounds, POSITIVE};

use crate::part_values::STRAIN;
use crate::table::table;

/// A phase in degrees.
const ANGLE: Bounds = Bounds {
    from: Bound::Included(-360.0),
    to: Bound::Included(360.0),
};
/// Number of checks of a part.
const CHECKS: Bounds = Bounds {
    from: Bound::Included(1.0),
    to: Bound::Included(1e9),
};

table! {
    /// The keys of a part of the protocol.
    PART: PartKeys Branch {
        /// velocity of the drive; 0 is a hold, less reverses it
        velocity: Number(ANY) { unit: "m/s" },
        /// time in which the velocity changes from that of the part before, at first from 0, to
        /// `velocity`, along a straight line; without it, it jumps
        ramp: Number(POSITIVE) { unit: "s", condition: "at most the duration" },
        /// how far the drive moves, with `velocity`
        distance: Number(POSITIVE) { unit: "m" },
        /// duration
        time: Number(POSITIVE) { unit: "s" },
        /// duration in cycles, with `frequency`
        cycles: Number(POSITIVE) {},
        /// cyclic strain: amplitude of γ, with `frequency`
        strain_amplitude: Number(POSITIVE) {},
        /// of the strain or of the shear stress
        frequency: Number(POSITIVE) { unit: "Hz" },
        /// the top wall is free along x under this stress, which pulls it forward
        shear_stress: Number(ANY) { unit: "Pa" },
        /// the stress at the end of a linear ramp
        shear_stress_end: Number(ANY) { unit: "Pa" },
        /// of a sinusoid added to the stress, with `frequency`
        shear_stress_amplitude: Number(POSITIVE) { unit: "Pa" },
        /// pressure on the top wall, from the start of the part
        pressure: Number(POSITIVE) { unit: "Pa" },
        /// the pressure at the end of a linear ramp
        pressure_end: Number(POSITIVE) { unit: "Pa" },
        /// of a sinusoid added to the pressure, with `pressure_frequency`
        pressure_amplitude: Number(POSITIVE) { unit: "Pa" },
        /// of the pressure
        pressure_frequency: Number(POSITIVE) { unit: "Hz" },
        /// instead of a pressure: velocity of the top wall away from the bottom wall; 0 is a
        /// constant volume
        wall_velocity: Number(ANY) { unit: "m/s" },
        /// without walls: mean of the normal stresses, under which all lengths of the cell change
        /// by the same factor
        mean_pressure: Number(POSITIVE) { unit: "Pa" },
        /// the mean at the end of a linear ramp
        mean_pressure_end: Number(POSITIVE) { unit: "Pa" },
        /// without walls: normal stress along x, under which the length of the cell changes;
        /// without it and `strain_xx` the length stays
        stress_xx: Number(POSITIVE) { unit: "Pa" },
        /// the stress at the end of a linear ramp
        stress_xx_end: Number(POSITIVE) { unit: "Pa" },
        /// without walls: natural strain of the length over the part, at a constant rate,
        /// compression positive
        strain_xx: Number(STRAIN) {},
        /// in 3D the same along y
        stress_yy: Number(POSITIVE) { unit: "Pa" },
        /// the stress at the end of a linear ramp
        stress_yy_end: Number(POSITIVE) { unit: "Pa" },
        /// in 3D natural strain of the width over the part
        strain_yy: Number(STRAIN) {},
        /// vibration of the bottom wall along its normal, with `bottom_frequency`
        bottom_amplitude: Number(POSITIVE) { unit: "m" },
        /// of the bottom wall
        bottom_frequency: Number(POSITIVE) { unit: "Hz" },
        /// vibration of the bottom wall along x, with `bottom_frequency_x`
        bottom_amplitude_x: Number(POSITIVE) { unit: "m" },
        /// of the bottom wall along x
        bottom_frequency_x: Number(POSITIVE) { unit: "Hz" },
        /// φ in degrees (default 0): that vibration is x = A (sin(2πft + φ) - sin φ)
        bottom_phase_x: Number(ANGLE) {},
        /// ends the part before its time: τ = S/N is less than this
        until_stress_ratio_below: Number(ANY) {},
        /// ends the part: τ is more than this
        until_stress_ratio_above: Number(ANY) {},
        /// ends the part: τ is by more than this less than its greatest value in the part
        until_drop: Number(POSITIVE) {},
        /// ends the part: the velocity of the top wall along x is less than this
        until_slip_rate_below: Number(ANY) { unit: "m/s" },
        /// ends the part: that velocity is more than this
        until_slip_rate_above: Number(ANY) { unit: "m/s" },
        /// ends the part: the top wall has moved further than this along x, in either direction
        until_slip: Number(POSITIVE) { unit: "m" },
        /// number of checks of these conditions, evenly over the whole duration (default 1000); the
        /// part ends a step after the check
        until_checks: Number(CHECKS) { condition: "a whole number" },
    }
}
