//! The declared columns, table by table.

use gshear_analysis::aftermath::BoxChange;
use gshear_analysis::frame_scalars::FrameScalars;
use gshear_analysis::phase_measures::PhaseMeasures;
use gshear_analysis::stability::Stability;
use gshear_dem::columns::Column;
use gshear_dem::state::SERIES_COLUMNS;

use crate::box_columns::{AqsRow, NewtonianRow};
use crate::layout::{Form, MASS, RADIUS, elements, forces};

/// A table of numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct TableDescription {
    /// Name of the file; of a group in an HDF5 file `file: group`.
    pub file: &'static str,
    /// What a line is.
    pub lines: &'static str,
    /// The columns. Those with an axis or a component stand once, without it.
    pub columns: Vec<Column>,
}

const STEP: Column = Column::new("step", "1", "steps since the start of the shear");
const TIME: Column = Column::new("time", "s", "time since the start of the shear");
const STRAIN: Column = Column::new("strain", "1", "γ");
const FRAME: Column = Column::new("frame", "1", "number of the frame, from 0 on");
const PHASE: [Column; 3] = [
    Column::new("phase", "1", "number of the phase, from 0 on"),
    Column::new("kind", "1", "stick or slip"),
    Column::new("length", "1", "long if t_p > 3 intervals, else short"),
];
const STRAINS: [Column; 2] = [
    Column::new("start_strain", "1", "γ at the start"),
    Column::new("end_strain", "1", "γ at the end"),
];
const DURATION: Column = Column::new("t_p", "1", "intervals of the time series in the phase");
const CHANGE: Column = Column::new("delta_tau_p", "1", "Δτ_p, change of τ over the phase");

const PHASE_PLACES: [Column; 4] = [
    Column::new("start_row", "1", "row of the time series at the start"),
    Column::new("end_row", "1", "row of the time series at the end"),
    Column::new("start_step", "1", "step at the start"),
    Column::new("end_step", "1", "step at the end"),
];

const CORRELATIONS: [Column; 9] = [
    Column::new("of", "1", "quantity"),
    Column::new("with", "1", "quantity that it is correlated with"),
    Column::new("over", "1", "intervals, or phases: all, long or short"),
    Column::new("range_of", "1", "quantity that the range is of"),
    Column::new("from", "1", "end of the range that is nearer to 0"),
    Column::new("to", "1", "other end of the range"),
    Column::new("pairs", "1", "number of pairs in the range"),
    Column::new("rho", "1", "Spearman's ρ"),
    Column::new("p", "1", "its two-sided p"),
];

const SPECTRUM: [Column; 6] = [
    Column::new("lambda_re", "s-2", "real part of the eigenvalue λ"),
    Column::new("lambda_im", "s-2", "imaginary part"),
    Column::new("verdict", "1", "zero, real, pair or doubtful"),
    Column::new("residual", "1", "|Kv - λMv| over ‖A‖|v|"),
    Column::new("condition", "1", "condition number of the eigenvalue"),
    Column::new("participation", "1", "share of the grains that move"),
];

const OF_K: [Column; 2] = [
    Column::new("contacts", "1", "contacts that K counts"),
    Column::new("sliding", "1", "those at the limit of friction"),
];

const SPECTRA: [Column; 4] = [
    Column::new("time", "s", "time since the start of the stage"),
    Column::new("real", "s-2", "real part of the eigenvalue λ"),
    Column::new("imaginary", "s-2", "imaginary part"),
    Column::new("verdict", "1", "zero, real, pair or doubtful"),
];

const SEGMENT: [Column; 2] = [
    Column::new(
        "experiment",
        "1",
        "number of the protocol, in the order of the runs",
    ),
    Column::new(
        "segment",
        "1",
        "segment of the drive, counted from the first slide",
    ),
];
const MU_OF_LAWS: [Column; 2] = [
    Column::new("mu_aging", "1", "μ of the aging law fitted to all data"),
    Column::new("mu_slip", "1", "μ of the slip law fitted to all data"),
];
const VELOCITIES: [Column; 2] = [
    Column::new("velocity_before", "m s-1", "drive velocity before"),
    Column::new("velocity_after", "m s-1", "drive velocity after"),
];

const MEAN_SERIES: [Column; 4] = [
    TIME,
    Column::new("slip", "m", "displacement of the top wall"),
    Column::new("mu", "1", "μ = S/N, mean of the realisations"),
    Column::new(
        "two_sigma",
        "1",
        "two standard deviations among the realisations",
    ),
];
const TEMPERATURE: Column = Column::new(
    "granular_temperature",
    "1",
    "kinetic energy of a free grain beyond that of a linear velocity profile, over P d³ (2D: P d²)",
);
const SEGMENTS: [Column; 7] = [
    Column::new("drive_velocity", "m s-1", "velocity of the drive"),
    Column::new("duration", "s", "duration"),
    Column::new("rows", "1", "rows of the time series"),
    Column::new("slip", "m", "slip during the segment"),
    Column::new("mu_ss", "1", "steady μ, of slides"),
    Column::new("error", "1", "its standard error"),
    TEMPERATURE,
];
const RELOAD: Column = Column::new(
    "reload_stiffness",
    "m-1",
    "k/N of layer and spring together: rise of μ over the displacement of the drive after the hold",
);
const RELAXATIONS: [Column; 10] = [
    Column::new("velocity_before", "m s-1", "drive velocity before the hold"),
    Column::new("t_hold", "s", "duration of the hold"),
    Column::new("time", "s", "time since the start of the hold"),
    Column::new("holds", "1", "number of holds"),
    Column::new(
        "change",
        "1",
        "mean of μ less that at the end of the slide before",
    ),
    Column::new(
        "error",
        "1",
        "standard error from the scatter among the holds",
    ),
    Column::new(
        "change_direct_effect",
        "1",
        "change by the direct effect alone, with k/N of the spring",
    ),
    RELOAD,
    Column::new(
        "change_direct_effect_reload",
        "1",
        "the same with k/N of the reload",
    ),
    TEMPERATURE,
];
const STEPS: [Column; 8] = [
    Column::new(
        "direct",
        "1",
        "direct effect: peak of μ less its value before",
    ),
    Column::new("direct_error", "1", "standard error"),
    Column::new(
        "evolution",
        "1",
        "evolution effect: peak less the new steady μ",
    ),
    Column::new("evolution_error", "1", "standard error"),
    Column::new("net", "1", "change of the steady μ"),
    Column::new("net_error", "1", "standard error"),
    Column::new(
        "direct_aging",
        "1",
        "direct effect of the aging law fitted to all data",
    ),
    Column::new(
        "direct_slip",
        "1",
        "direct effect of the slip law fitted to all data",
    ),
];
const AFTER_STEPS: [Column; 5] = [
    Column::new("slip_from", "m", "start of the slip range after the step"),
    Column::new("slip_to", "m", "end of the range"),
    Column::new("steps", "1", "number of velocity steps"),
    Column::new("change", "1", "mean of μ less the steady μ before the step"),
    Column::new(
        "error",
        "1",
        "standard error from the scatter among the steps",
    ),
];
const HOLDS: [Column; 13] = [
    Column::new("velocity_before", "m s-1", "drive velocity before the hold"),
    Column::new("t_hold", "s", "duration of the hold"),
    Column::new(
        "relaxation",
        "1",
        "μ at the end of the hold less the steady μ before it",
    ),
    Column::new(
        "relaxation_aging",
        "1",
        "relaxation of the aging law fitted to all data",
    ),
    Column::new(
        "relaxation_slip",
        "1",
        "relaxation of the slip law fitted to all data",
    ),
    Column::new(
        "velocity_after",
        "m s-1",
        "drive velocity of the slide after it",
    ),
    Column::new("peak", "1", "greatest μ of that slide"),
    Column::new(
        "slip_at_peak",
        "m",
        "slip from the end of the hold to the peak",
    ),
    RELOAD,
    Column::new("healing", "1", "peak less the steady μ"),
    Column::new("error", "1", "standard error"),
    Column::new(
        "healing_aging",
        "1",
        "healing of the aging law fitted to all data",
    ),
    Column::new(
        "healing_slip",
        "1",
        "healing of the slip law fitted to all data",
    ),
];
const FIT: [Column; 5] = [
    Column::new("fit", "1", "which data are fitted"),
    Column::new("experiment", "1", "number of the protocol"),
    Column::new("first_segment", "1", "first segment fitted"),
    Column::new("last_segment", "1", "last segment fitted"),
    Column::new("law", "1", "aging or slip"),
];
const INTERVALS: [[Column; 3]; 5] = [
    [
        Column::new("a", "1", "a of the law"),
        Column::new("a_low", "1", "lower end of its 95 % interval"),
        Column::new("a_high", "1", "upper end"),
    ],
    [
        Column::new("b", "1", "b of the law"),
        Column::new("b_low", "1", "lower end of its 95 % interval"),
        Column::new("b_high", "1", "upper end"),
    ],
    [
        Column::new("a_minus_b", "1", "a - b"),
        Column::new("a_minus_b_low", "1", "lower end of its 95 % interval"),
        Column::new("a_minus_b_high", "1", "upper end"),
    ],
    [
        Column::new("d_c", "m", "D_c of the law"),
        Column::new("d_c_low", "m", "lower end of its 95 % interval"),
        Column::new("d_c_high", "m", "upper end"),
    ],
    [
        Column::new("mu_star", "1", "μ* at V*"),
        Column::new("mu_star_low", "1", "lower end of its 95 % interval"),
        Column::new("mu_star_high", "1", "upper end"),
    ],
];
const FIT_END: [Column; 6] = [
    Column::new("v_star", "m s-1", "V*"),
    Column::new("rms", "1", "root mean square of the residuals of μ"),
    Column::new("effective_values", "1", "number of independent values of μ"),
    Column::new("chi_squared", "1", "χ² per degree of freedom"),
    Column::new(
        "undetermined",
        "1",
        "parameters that the data do not determine",
    ),
    Column::new("why_none", "1", "why there is no fit"),
];

const PLACE: [Column; 3] = [
    Column::new("x", "m", "position along x, wrapped into the box"),
    Column::new("y", "m", "position along y"),
    Column::new("z", "m", "position along z"),
];
const CONTACT_IDS: [Column; 2] = [
    Column::new("i", "1", "lower id"),
    Column::new("j", "1", "higher id"),
];
const LIMITS: [Column; 3] = [
    Column::new("sliding", "1", "1 at Coulomb's limit"),
    Column::new(
        "rolling",
        "1",
        "1 at the limit of rolling; of spheres that resist it",
    ),
    Column::new(
        "twisting",
        "1",
        "1 at the limit of twisting; of spheres that resist it",
    ),
];
const MODES: [Column; 4] = [
    Column::new(
        "modeK_displacement_re",
        "1",
        "displacement in eigenvector K, real part",
    ),
    Column::new(
        "modeK_displacement_im",
        "1",
        "displacement in eigenvector K, imaginary part",
    ),
    Column::new(
        "modeK_rotation_re",
        "1",
        "rotation in eigenvector K, real part",
    ),
    Column::new(
        "modeK_rotation_im",
        "1",
        "rotation in eigenvector K, imaginary part",
    ),
];
const FIELDS: [Column; 4] = [
    Column::new("dmin", "m2", "D²min since the frame before"),
    Column::new("stress", "Pa", "stress of the grain; compression positive"),
    Column::new("region", "1", "1 in a GR region"),
    Column::new("contacts", "1", "number of contacts"),
];

/// The kind of the tables of figures.
pub(super) const OF_FIGURES: &str = "report/*.csv";
/// Columns that tables of figures have and no other table, or with another meaning.
const FIGURES: [Column; 24] = [
    Column::new("x", "m", "centre"),
    Column::new("y", "m", "as x"),
    Column::new("z", "m", "as x"),
    Column::new("x_i", "m", "centre of grain i"),
    Column::new("y_i", "m", "centre of grain i"),
    Column::new("x_j", "m", "centre of grain j"),
    Column::new("y_j", "m", "centre of grain j"),
    Column::new("dmin", "m2", "D²min over the interval"),
    Column::new("change", "N", "change of |f| over the drop"),
    Column::new(
        "displacement_x",
        "m",
        "displacement along x in the latter half of the run",
    ),
    Column::new(
        "velocity_x",
        "m s-1",
        "velocity along x; of layers the mean by volume",
    ),
    Column::new(
        "log10_dmin_over_square",
        "1",
        "log₁₀ of D²min/r̄² in the latter half of the run",
    ),
    Column::new(
        "height_over_mean_diameter",
        "1",
        "height over the mean diameter, from the lower end",
    ),
    Column::new("force_over_mean", "1", "force over the mean normal force"),
    Column::new(
        "log10_density_normal",
        "1",
        "log₁₀ of the probability density of F_n",
    ),
    Column::new(
        "log10_density_tangential",
        "1",
        "log₁₀ of the probability density of |F_t|",
    ),
    Column::new(
        "angle",
        "deg",
        "angle of the contact normal from the direction of shear",
    ),
    Column::new(
        "density",
        "1",
        "number of contacts over that of an isotropic fabric",
    ),
    Column::new(
        "mean_force",
        "1",
        "their mean normal force over the mean of all",
    ),
    Column::new(
        "distance_over_mean_diameter",
        "1",
        "r over the mean diameter",
    ),
    Column::new("g", "1", "pair correlation g(r)"),
    Column::new(
        "conjugate_stress",
        "Pa",
        "of a box: shear stress; of pure shear half the stress along the height less that along x, of a biaxial test the axial less the lateral stress, of a compression the pressure",
    ),
    Column::new(
        "modulus",
        "Pa",
        "of a box: change of that stress over the change of the strain, of a compression over that of ln φ",
    ),
    Column::new(
        "mobilised_friction",
        "1",
        "of a box: shear stress over pressure; of pure shear and a biaxial test difference of the stresses over their sum",
    ),
];

const OF_STAGE: [Column; 1] = [Column::new(
    "stage",
    "1",
    "I, II or III: before, during or after the drop; slip: a large slip in Stage II, the largest first",
)];
const MAP_STEP: [Column; 2] = [
    Column::new(
        "step",
        "1",
        "number of the interval around the drop, from 1 on",
    ),
    Column::new(
        "stage",
        "1",
        "I, II or III: before, during or after the drop",
    ),
];
const TENSION: [Column; 4] = [
    Column::new("x", "m", "place of the greatest D²min"),
    Column::new("y", "m", "as x"),
    Column::new(
        "tension_x",
        "1",
        "direction of tension within five mean diameters of it",
    ),
    Column::new("tension_y", "1", "as tension_x"),
];
const MAP_GRAINS: [Column; 10] = [
    Column::new("grain", "1", "row of the grain in run.h5"),
    Column::new("body", "1", "0 free, 1 bottom wall, 2 top wall"),
    Column::new("x", "m", "centre at the end of the interval"),
    Column::new("y", "m", "as x"),
    RADIUS,
    Column::new("in_gr_region", "1", "1 in a GR region"),
    Column::new("dmin", "m2", "D²min over the interval"),
    Column::new(
        "greatest_dmin",
        "1",
        "1 for the greatest hundredth of D²min",
    ),
    Column::new("u_x", "m", "non-affine displacement over the interval"),
    Column::new("u_y", "m", "as u_x"),
];
const MAP_CONTACTS: [Column; 9] = [
    Column::new("end_strain", "1", "γ at the end"),
    Column::new("i", "1", "row of the lower grain in run.h5"),
    Column::new("j", "1", "row of the higher grain"),
    Column::new("x_i", "m", "centre of grain i"),
    Column::new("y_i", "m", "centre of grain i"),
    Column::new("x_j", "m", "centre of the image of grain j that touches it"),
    Column::new("y_j", "m", "as x_j"),
    Column::new("force", "N", "|f|, size of the contact force"),
    Column::new(
        "force_change",
        "N",
        "its change over the interval; 0 if the contact was made or lost",
    ),
];

const GROWTH: [Column; 8] = [
    Column::new(
        "fitted_omega_i",
        "s-1",
        "ω_i fitted to the mean square displacement; NaN without exponential growth",
    ),
    Column::new(
        "fitted_omega_r",
        "s-1",
        "ω_r fitted to its oscillation; NaN if no rows resolve it",
    ),
    Column::new("growth_from", "s", "start of the fitted interval of time"),
    Column::new("growth_to", "s", "end of the fitted interval of time"),
    Column::new(
        "decades",
        "1",
        "decades by which the mean square displacement grows in that interval",
    ),
    Column::new(
        "overlap",
        "1",
        "overlap of |v|² of the growing pair with D²min between the first and the last frame",
    ),
    Column::new("overlap_by_chance", "1", "that of independent fields"),
    Column::new(
        "aftermath",
        "1",
        "catastrophe, saturation or growing: by the displacement at the end; empty without a pair",
    ),
];
const GROWTH_GRAINS: [Column; 3] = [
    Column::new("grain", "1", "row of the grain in run.h5"),
    Column::new(
        "eigenvector_square",
        "1",
        "|v|² of the grain in the growing pair; the sum is 1",
    ),
    Column::new("dmin", "m2", "D²min between the first and the last frame"),
];

/// Returns all tables in `axes` dimensions.
pub fn tables(axes: usize) -> Vec<TableDescription> {
    let all = [
        of_runs(),
        of_walls(),
        of_boxes(),
        of_rate_state(),
        of_exports(axes),
    ];
    all.concat()
}

fn table(file: &'static str, lines: &'static str, columns: &[&[Column]]) -> TableDescription {
    TableDescription {
        file,
        lines,
        columns: columns.concat(),
    }
}

/// What a run writes.
fn of_runs() -> Vec<TableDescription> {
    let mut series = vec![STEP, TIME];
    series.extend(SERIES_COLUMNS);
    vec![
        table("log.csv", "row of the time series", &[&series]),
        table(
            "aqs.h5: observables",
            "strain step of a periodic box",
            &[&AqsRow::COLUMNS],
        ),
        table(
            "newtonian.h5: observables",
            "row of the time series of a periodic box",
            &[&NewtonianRow::COLUMNS],
        ),
        table("spectra.csv", "eigenvalue and time", &[&SPECTRA]),
    ]
}

/// What is reduced from a run between walls.
fn of_walls() -> Vec<TableDescription> {
    let stress_ratio = [Column::new("stress_ratio", "1", "τ")];
    vec![
        table(
            "phases.csv",
            "phase of τ",
            &[
                &PHASE,
                &PHASE_PLACES,
                &STRAINS,
                &[DURATION],
                &[Column::new("t_p_strain", "1", "Δγ of the phase")],
                &[CHANGE],
            ],
        ),
        table(
            "regions.csv",
            "frame, from the one before it",
            &[
                &[FRAME, STEP, STRAIN],
                &stress_ratio,
                &FrameScalars::COLUMNS,
            ],
        ),
        table(
            "measures.csv",
            "phase of τ",
            &[
                &PHASE,
                &PHASE_PLACES[2..],
                &STRAINS,
                &[DURATION, CHANGE],
                &PhaseMeasures::COLUMNS,
            ],
        ),
        table("correlations.csv", "range", &[&CORRELATIONS]),
        table(
            "stages.csv",
            "stage of the largest drop, and large slip in it",
            &[&OF_STAGE, &PHASE_PLACES[2..], &STRAINS],
        ),
        table(
            "stages-steps.csv",
            "interval around the largest drop",
            &[&MAP_STEP, &PHASE_PLACES[2..], &STRAINS, &TENSION],
        ),
        table(
            "stages-grains.csv",
            "grain and interval around the largest drop",
            &[&MAP_STEP, &STRAINS, &MAP_GRAINS],
        ),
        table(
            "stages-contacts.csv",
            "contact and interval around the largest drop",
            &[&MAP_STEP, &MAP_CONTACTS],
        ),
    ]
}

/// What is reduced from states and from runs in a box.
fn of_boxes() -> Vec<TableDescription> {
    vec![
        table("spectrum.csv", "eigenvalue", &[&SPECTRUM]),
        table(
            "stability.csv",
            "frame",
            &[&[FRAME, STEP, STRAIN], &OF_K, &Stability::COLUMNS],
        ),
        table("growth.csv", "run", &[&GROWTH, &BoxChange::COLUMNS]),
        table("growth-grains.csv", "grain", &[&GROWTH_GRAINS]),
    ]
}

/// Slide-hold-slide and velocity-step tests.
fn of_rate_state() -> Vec<TableDescription> {
    vec![
        table(
            "rate-state.csv",
            "row of the mean series",
            &[&SEGMENT, &MEAN_SERIES, &MU_OF_LAWS],
        ),
        table(
            "segments.csv",
            "segment of the drive",
            &[&SEGMENT, &SEGMENTS],
        ),
        table(
            "steps.csv",
            "velocity step",
            &[&SEGMENT, &VELOCITIES, &STEPS],
        ),
        table(
            "after-steps.csv",
            "slip range after all steps between two velocities",
            &[&VELOCITIES, &AFTER_STEPS],
        ),
        table("holds.csv", "hold", &[&SEGMENT, &HOLDS]),
        table(
            "relaxations.csv",
            "kind of hold and time since its start",
            &[&RELAXATIONS],
        ),
        table(
            "fits.csv",
            "fit of a law",
            &[&FIT, INTERVALS.as_flattened(), &FIT_END],
        ),
    ]
}

/// What is exported, and the data of figures.
fn of_exports(axes: usize) -> Vec<TableDescription> {
    let of_frame = [FRAME, STEP, TIME, STRAIN];
    let grain = [
        Column::new("id", "1", "id of the grain"),
        Column::new("body", "1", "0 free, 1 bottom wall, 2 top wall"),
        RADIUS,
        MASS,
    ];
    // Which one it is depends on the law: `unit` of the dataset in run.h5 says it.
    let either = if axes == 2 { "N m-1 or m" } else { "N or m" };
    let named = |columns: &[(Column, usize)]| -> Vec<Column> {
        let of_law = |(column, _): &(Column, usize)| match column.name {
            "tangential_history" => Column::new(column.name, either, column.doc),
            _ => *column,
        };
        columns.iter().map(of_law).collect()
    };
    vec![
        table(
            "frames.csv",
            "grain and frame",
            &[
                &of_frame,
                &grain,
                &PLACE[..axes],
                &named(&elements(axes)[1..]),
                &FIELDS,
                &MODES,
            ],
        ),
        table(
            "frames-contacts.csv",
            "contact and frame",
            &[
                &of_frame,
                &CONTACT_IDS,
                &named(forces(Form {
                    axes,
                    torques: axes == 3,
                })),
                &LIMITS[..axes],
            ],
        ),
        table(OF_FIGURES, "point, grain or contact", &[&FIGURES]),
    ]
}
