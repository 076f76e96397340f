//! The report of a run in a periodic box: what its deformation and Newton's equations have
//! measured.

use serde_json::{Value, json};

use gshear_dem::failure::Failure;
use gshear_store::csv_table;
use gshear_store::file_names::SPECTRA_FILE;
use gshear_store::run_reader::{RunFile, RunStage, Series};

use super::ReportFigure;
use super::curves::lines;
use super::eigenvalue_figures::{self, SpectrumRow};
use super::history::{Axis, LAYOUT, Panel, SLIDING_FRACTION, Shown, drawn};
use super::page::Facts;
use super::summary::parameters;

/// A deformation of the box.
struct Deformation {
    /// Value of `box.deformation`.
    key: &'static str,
    name: &'static str,
    /// Column, label and factor of what the figures are drawn over.
    axis: (&'static str, &'static str, f64),
    /// The stress that works on the strain, in the caption and on the axis.
    stress: [&'static str; 2],
    modulus: &'static str,
}

const STRAIN: (&str, &str, f64) = ("strain", "shear strain γ (%)", 100.0);
/// The first is that of files without the key.
const DEFORMATIONS: [Deformation; 4] = [
    Deformation {
        key: "simple-shear",
        name: "Simple shear",
        axis: STRAIN,
        stress: ["shear stress σ", "shear stress σ"],
        modulus: "Shear modulus G = dσ/dγ",
    },
    Deformation {
        key: "pure-shear",
        name: "Pure shear at constant volume",
        axis: STRAIN,
        stress: [
            "half the stress along the height less that along x, σ",
            "stress σ",
        ],
        modulus: "Shear modulus G = dσ/dγ",
    },
    Deformation {
        key: "biaxial",
        name: "Biaxial test",
        axis: ("strain", "axial strain ε (%)", 100.0),
        stress: ["axial less lateral stress, q", "deviator q"],
        modulus: "Tangent modulus E = dq/dε",
    },
    Deformation {
        key: "compression",
        name: "Isotropic compression",
        axis: ("solid_fraction", "solid fraction φ", 1.0),
        stress: ["pressure P", "pressure P"],
        modulus: "Bulk modulus K = dP/d(ln φ)",
    },
];

/// What is drawn over the strain, or the solid fraction of a compression.
const OF_STRAIN: [Panel; 8] = [
    Panel {
        name: "stresses",
        caption: "Normal stresses along the axes of the box, compression positive, and their mean, the pressure.",
        label: "stress",
        shown: Shown::AsTheyAre,
        lines: &[
            ("stress_xx", "σ_{xx}"),
            ("stress_yy", "σ_{yy}"),
            ("stress_zz", "σ_{zz}"),
            ("pressure", "P"),
        ],
    },
    Panel {
        name: "solid-fraction",
        caption: "Solid fraction of the box.",
        label: "solid fraction",
        shown: Shown::AsTheyAre,
        lines: &[("solid_fraction", "solid fraction")],
    },
    Panel {
        name: "coordination",
        caption: "Coordination z: mean number of contacts of a grain.",
        label: "coordination z",
        shown: Shown::AsTheyAre,
        lines: &[("coordination", "coordination")],
    },
    SLIDING_FRACTION,
    Panel {
        name: "energies",
        caption: "Elastic energy of the contacts.",
        label: "elastic energy",
        shown: Shown::AsTheyAre,
        lines: &[("elastic_energy", "elastic energy")],
    },
    Panel {
        name: "imaginary-parts",
        caption: "Least and greatest imaginary part of the eigenvalues of K v = λ M v; one that is not 0 belongs to a complex pair.",
        label: "Im λ",
        shown: Shown::AsTheyAre,
        lines: &[
            ("imaginary_least", "least"),
            ("imaginary_greatest", "greatest"),
        ],
    },
    Panel {
        name: "real-parts",
        caption: "Least real part of the eigenvalues that are not 0, negative in an unstable packing, and that of the complex pair with the greatest imaginary part.",
        label: "Re λ",
        shown: Shown::AsTheyAre,
        lines: &[("least_real", "least"), ("pair_real", "complex pair")],
    },
    Panel {
        name: "pairs",
        caption: "Number of complex pairs.",
        label: "complex pairs",
        shown: Shown::AsTheyAre,
        lines: &[("pairs", "complex pairs")],
    },
];

/// What is drawn over the time of Newton's equations.
const OF_TIME: [Panel; 4] = [
    Panel {
        name: "newtonian-displacement",
        caption: "Newton's equations: mean square displacement.",
        label: "log_{10} mean square displacement",
        shown: Shown::Logarithm,
        lines: &[("msd", "mean square displacement")],
    },
    Panel {
        name: "newtonian-energies",
        caption: "Newton's equations: kinetic energy of all grains, and elastic energy of the contacts.",
        label: "log_{10} energy",
        shown: Shown::Logarithm,
        lines: &[("kinetic_energy", "kinetic"), ("elastic_energy", "elastic")],
    },
    Panel {
        name: "newtonian-stresses",
        caption: "Newton's equations: change of the shear stress and of the pressure since the start.",
        label: "change (%)",
        shown: Shown::Growth,
        lines: &[("shear_stress", "shear stress"), ("pressure", "pressure")],
    },
    Panel {
        name: "newtonian-contacts",
        caption: "Newton's equations: number of contacts.",
        label: "contacts",
        shown: Shown::AsTheyAre,
        lines: &[("contacts", "contacts")],
    },
];

/// What the strain steps of a run measure.
struct Measured {
    of: &'static Deformation,
    /// `[L]` The stress that works on the strain.
    stress: Vec<f64>,
    /// `[L]` Sine of the mobilised friction angle; of simple shear the shear stress over the
    /// pressure.
    friction: Vec<f64>,
    /// `[L]` The modulus from the row before to this one.
    modulus: Vec<f64>,
}

impl Measured {
    fn of(run: &RunFile) -> Self {
        let scene = run.scene().parse::<toml::Table>().unwrap_or_default();
        let key = scene
            .get("box")
            .and_then(|of| of.get("deformation")?.as_str());
        let of = DEFORMATIONS.iter().find(|of| Some(of.key) == key);
        let of = of.unwrap_or(&DEFORMATIONS[0]);
        let column = |name: &str| run.series().column(name);
        let combined = |a: &[f64], b: &[f64], f: fn(f64, f64) -> f64| -> Vec<f64> {
            a.iter().zip(b).map(|(a, b)| f(*a, *b)).collect()
        };
        let (x, y) = (column("stress_xx"), column("stress_yy"));
        let (lateral, axial) = match (run.dimension().axes(), of.key) {
            (2, _) => (x.to_vec(), y),
            (_, "biaxial") => (combined(x, y, |x, y| 0.5 * (x + y)), column("stress_zz")),
            _ => (x.to_vec(), column("stress_zz")),
        };
        let sine = || combined(axial, &lateral, |a, l| (a - l) / (a + l));
        let pressure = column("pressure");
        let (stress, friction) = match of.key {
            "pure-shear" => (combined(axial, &lateral, |a, l| 0.5 * (a - l)), sine()),
            "biaxial" => (combined(axial, &lateral, |a, l| a - l), sine()),
            "compression" => (pressure.to_vec(), vec![f64::NAN; pressure.len()]),
            _ => {
                let shear = column("shear_stress");
                (shear.to_vec(), combined(shear, pressure, |s, p| s / p))
            }
        };
        let strain: Vec<f64> = match of.key {
            "compression" => column("solid_fraction")
                .iter()
                .map(|phi| phi.ln())
                .collect(),
            _ => column("strain").to_vec(),
        };
        let slope = |k: usize| match k {
            0 => f64::NAN,
            k => (stress[k] - stress[k - 1]) / (strain[k] - strain[k - 1]),
        };
        Self {
            of,
            modulus: (0..strain.len()).map(slope).collect(),
            stress,
            friction,
        }
    }

    fn figures(&self, axis: &Axis, series: &Series) -> Vec<ReportFigure> {
        let of = self.of;
        let friction = match of.key {
            "simple-shear" => "Shear stress over pressure.",
            _ => {
                "Sine of the mobilised friction angle: difference of the stresses along the height and across it, over their sum."
            }
        };
        let drawn = |name, caption: String, label, column, values: &[f64]| {
            let svg = lines(LAYOUT, (axis.label, &axis.values), label, &[("", values)])?;
            let data = axis.table_of(series, &[(column, values)]);
            Some(ReportFigure::new(name, caption, svg, data))
        };
        let stress = format!("{}: {}.", of.name, of.stress[0]);
        let modulus = format!("{}, from one strain step to the next.", of.modulus);
        let column = "mobilised_friction";
        let label = "mobilised friction";
        [
            drawn(
                "stress-strain",
                stress,
                of.stress[1],
                "conjugate_stress",
                &self.stress,
            ),
            drawn("modulus", modulus, of.modulus, "modulus", &self.modulus),
            drawn("friction", friction.into(), label, column, &self.friction),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// First and last finite value, if the last is another.
fn ends(values: &[f64]) -> String {
    let text = |x: &f64| match x.abs() {
        0.0 | 1e-3..1e6 => format!("{x:.6}"),
        _ => format!("{x:.6e}"),
    };
    let mut finite = values.iter().filter(|x| x.is_finite());
    match (finite.next(), finite.next_back()) {
        (Some(first), Some(last)) if first != last => format!("{} … {}", text(first), text(last)),
        (Some(first), _) => text(first),
        (None, _) => "none".into(),
    }
}

/// Adds the facts of the strain steps or of Newton's equations; returns their name and figures.
///
/// # Errors
/// A damaged table of eigenvalues.
pub fn measured(
    run: &RunFile,
    facts: &mut Facts,
) -> Result<(&'static str, Vec<ReportFigure>), Failure> {
    match run.stage() {
        RunStage::Newtonian => Ok(("Newton's equations", in_time(run, facts)?)),
        _ => Ok(over_strain(run, facts)),
    }
}

fn in_time(run: &RunFile, facts: &mut Facts) -> Result<Vec<ReportFigure>, Failure> {
    let series = run.series();
    for (name, column) in [
        ("Mean square displacement, first and last", "msd"),
        ("Kinetic energy", "kinetic_energy"),
        ("Shear stress in Newton's equations", "shear_stress"),
    ] {
        facts.push((name, ends(series.column(column))));
    }
    for (name, parameter) in [
        ("Growing pair at their start: Im λ", "lambda_i"),
        ("its growth rate ω<sub>i</sub>", "omega_i"),
        ("its frequency ω<sub>r</sub>", "omega_r"),
    ] {
        let known = run.number(parameter).filter(|x| x.is_finite());
        facts.extend(known.map(|value| (name, format!("{value:.6e}"))));
    }
    let axis = Axis::over_time(series, "time");
    let panels = OF_TIME.iter().filter_map(|panel| drawn(run, &axis, panel));
    Ok(panels.chain(eigenvalues(run)?).collect())
}

/// The eigenvalues over time, if the run has computed some.
fn eigenvalues(run: &RunFile) -> Result<Option<ReportFigure>, Failure> {
    let path = run.folder().join(SPECTRA_FILE);
    let rows: Vec<SpectrumRow> = if path.exists() {
        csv_table::read(&path)?
    } else {
        Vec::new()
    };
    if rows.is_empty() {
        return Ok(None);
    }
    let [svg, data] = eigenvalue_figures::over_time(&rows);
    let caption = "Imaginary parts of all eigenvalues under Newton's equations.";
    let name = "newtonian-eigenvalues";
    Ok(Some(ReportFigure::new(name, caption, svg, data)))
}

fn over_strain(run: &RunFile, facts: &mut Facts) -> (&'static str, Vec<ReportFigure>) {
    let (series, measured) = (run.series(), Measured::of(run));
    let strain = series.column("strain");
    let percent = |strain: f64| format!("{:.6} %", 100.0 * strain);
    let [least, most] = [f64::min, f64::max].map(|of| strain.iter().copied().fold(0.0, of));
    let range = format!("{} … {}", percent(least), percent(most));
    facts.push(("Strain, least and greatest", range));
    for (name, column) in [
        ("Solid fraction, first and last", "solid_fraction"),
        ("Pressure", "pressure"),
        ("Shear stress", "shear_stress"),
        ("Coordination z", "coordination"),
    ] {
        facts.push((name, ends(series.column(column))));
    }
    facts.push((measured.of.modulus, ends(&measured.modulus)));
    let friction = &measured.friction;
    let known = (0..strain.len()).filter(|k| friction[*k].is_finite());
    if let Some(k) = known.max_by(|a, b| friction[*a].total_cmp(&friction[*b])) {
        let angle = match measured.of.key {
            "simple-shear" => friction[k].atan(),
            _ => friction[k].asin(),
        };
        let (angle, at) = (angle.to_degrees(), percent(strain[k]));
        let text = format!("{:.4} ({angle:.1}°) at a strain of {at}", friction[k]);
        facts.push(("Greatest mobilised friction", text));
    }
    let birth = run.number("birth_before").zip(run.number("birth_after"));
    facts.extend(birth.map(|(before, after)| {
        let text = format!("between strains of {before:.12} and {after:.12}");
        ("Birth of the first complex pair", text)
    }));
    facts.extend(run.number("fell_back").map(|steps| {
        let text = format!("{steps} of {}", strain.len().saturating_sub(1));
        (
            "Strain steps for which Newton's method did not converge",
            text,
        )
    }));
    let (name, label, factor) = measured.of.axis;
    let axis = Axis::over(series, name, label, factor);
    let mut figures = measured.figures(&axis, series);
    let panels = OF_STRAIN.iter().filter(|panel| panel.lines[0].0 != name);
    figures.extend(panels.filter_map(|panel| drawn(run, &axis, panel)));
    (measured.of.name, figures)
}

/// Returns the content of `summary.json`: of each file the last row and the parameters.
pub fn json(files: &[&RunFile]) -> Value {
    let of = |run: &&RunFile| {
        let series = run.series();
        let last = series.declared.iter().zip(&series.columns);
        let last = last.map(|(column, of)| (column.name.to_string(), json!(of.last())));
        json!({
            "run": run.path().display().to_string(),
            "digest": run.digest(),
            "grains": run.grains().count(),
            "frames": run.frames(),
            "series_rows": series.rows(),
            "last_row": last.collect::<serde_json::Map<_, _>>(),
            "parameters": parameters(run),
        })
    };
    let stages = files
        .iter()
        .map(|run| (run.stage().name().to_string(), of(run)));
    stages.collect::<serde_json::Map<_, _>>().into()
}
