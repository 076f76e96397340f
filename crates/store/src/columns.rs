//! Names of the files of a run and of the columns of their time series.

/// Strain steps of a run in a periodic box.
pub const AQS_FILE: &str = "aqs.h5";
/// Newton's equations of a run in a periodic box.
pub const NEWTONIAN_FILE: &str = "newtonian.h5";
/// Eigenvalues in time, one per row.
pub const SPECTRA_FILE: &str = "spectra.csv";

/// Columns of the time series of the strain steps; NaN if not computed.
pub const AQS_COLUMNS: [&str; 18] = [
    "strain",
    "image_offset",
    "shear_stress",
    "pressure",
    "elastic_energy",
    "contacts",
    "coordination",
    "sliding_fraction",
    "residual",
    "factorisations",
    "overdamped_steps",
    "fell_back",
    "pairs",
    "imaginary_least",
    "imaginary_greatest",
    "pair_real",
    "least_real",
    "zero_modes",
];

/// Columns of the time series of Newton's equations.
pub const NEWTONIAN_COLUMNS: [&str; 7] = [
    "msd",
    "kinetic_energy",
    "elastic_energy",
    "shear_stress",
    "pressure",
    "contacts",
    "sliding_fraction",
];
