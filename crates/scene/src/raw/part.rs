//! The keys of a part of `shear.protocol`.

use gshear_dem::laws::keys::{ANY, Bounds, NOT_NEGATIVE, POSITIVE};

/// What is declared of a key of a part.
pub struct PartKey {
    pub name: &'static str,
    pub doc: &'static str,
    pub unit: &'static str,
    pub range: Bounds,
}

const fn key(name: &'static str, unit: &'static str, range: Bounds, doc: &'static str) -> PartKey {
    PartKey {
        name,
        doc,
        unit,
        range,
    }
}

/// Every key of a part.
pub const PART_KEYS: [PartKey; 16] = [
    key(
        "velocity",
        "m/s",
        NOT_NEGATIVE,
        "velocity of the drive; 0 is a hold",
    ),
    key(
        "distance",
        "m",
        POSITIVE,
        "how far the drive moves, with `velocity`",
    ),
    key("time", "s", POSITIVE, "duration"),
    key(
        "cycles",
        "",
        POSITIVE,
        "duration in cycles, with `frequency`",
    ),
    key(
        "strain_amplitude",
        "",
        POSITIVE,
        "cyclic strain: amplitude of γ, with `frequency`",
    ),
    key(
        "frequency",
        "Hz",
        POSITIVE,
        "of the strain or of the shear stress",
    ),
    key(
        "shear_stress",
        "Pa",
        ANY,
        "the top wall is free along x under this stress, which pulls it forward",
    ),
    key(
        "shear_stress_end",
        "Pa",
        ANY,
        "the stress at the end of a linear ramp",
    ),
    key(
        "shear_stress_amplitude",
        "Pa",
        POSITIVE,
        "of a sinusoid added to the stress, with `frequency`",
    ),
    key(
        "pressure",
        "Pa",
        POSITIVE,
        "pressure on the top wall, from the start of the part",
    ),
    key(
        "pressure_end",
        "Pa",
        POSITIVE,
        "the pressure at the end of a linear ramp",
    ),
    key(
        "pressure_amplitude",
        "Pa",
        POSITIVE,
        "of a sinusoid added to the pressure, with `pressure_frequency`",
    ),
    key("pressure_frequency", "Hz", POSITIVE, "of the pressure"),
    key(
        "wall_velocity",
        "m/s",
        ANY,
        "instead of a pressure: velocity of the top wall away from the bottom wall; 0 is a constant \
         volume",
    ),
    key(
        "bottom_amplitude",
        "m",
        POSITIVE,
        "vibration of the bottom wall along its normal, with `bottom_frequency`",
    ),
    key("bottom_frequency", "Hz", POSITIVE, "of the bottom wall"),
];
