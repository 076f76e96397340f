//! The report of a run in a periodic box: what its deformation and Newton's equations have
//! measured.

use serde_json::{Value, json};

use gshear_analysis::moments::extent;
use gshear_analysis::time_mean::TimeMean;
use gshear_dem::failure::Result;
use gshear_store::csv_table;
use gshear_store::file_names::SPECTRA_FILE;
use gshear_store::run_reader::{RunFile, RunStage, Series};

use super::ReportFigure;
use super::box_protocol;
use super::eigenvalue_figures::{self, SpectrumRow};
use super::history::{Axis, MeasuredCurve, drawn};
use super::page::Facts;
use super::panels::{Deformation, PANELS};

/// Name of the column of the mobilised friction.
pub(crate) const MOBILISED_FRICTION: &str = "mobilised_friction";

/// What the strain steps of a run measure.
pub struct Measured {
    deformation: &'static Deformation,
    /// `[L]` The stress that works on the strain.
    stress: Vec<f64>,
    /// `[L]` Sine of the mobilised friction angle; of simple shear the shear stress over the
    /// pressure.
    friction: Vec<f64>,
    /// `[L]` Numerator and denominator of `friction`: two stresses.
    friction_of: [Vec<f64>; 2],
    /// `[L]` The modulus from the row before to this one.
    modulus: Vec<f64>,
}

impl Measured {
    pub fn of(run: &RunFile) -> Self {
        let (series, deformation) = (run.series(), Deformation::of(run));
        let (x, y) = (series.column("stress_xx"), series.column("stress_yy"));
        let (lateral, axial) = match (run.dimension().axes(), &*deformation.key) {
            (2, _) => (x.to_vec(), y),
            (_, "biaxial" | "protocol") => (
                combined(x, y, |x, y| 0.5 * (x + y)),
                series.column("stress_zz"),
            ),
            _ => (x.to_vec(), series.column("stress_zz")),
        };
        let difference = combined(axial, &lateral, |a, l| a - l);
        let sum = combined(axial, &lateral, |a, l| a + l);
        let pressure = series.column("pressure");
        let (stress, friction_of) = match &*deformation.key {
            "pure-shear" => (
                combined(axial, &lateral, |a, l| 0.5 * (a - l)),
                [difference, sum],
            ),
            "biaxial" | "protocol" => (difference.clone(), [difference, sum]),
            "compression" => {
                let none = vec![f64::NAN; pressure.len()];
                (pressure.to_vec(), [none.clone(), none])
            }
            _ => {
                let shear = series.column("shear_stress");
                (shear.to_vec(), [shear.to_vec(), pressure.to_vec()])
            }
        };
        let solid = series.column("solid_fraction").iter();
        let strain: Vec<f64> = match &*deformation.key {
            "compression" => solid.map(|phi| phi.ln()).collect(),
            "protocol" | "protocol-shear" => box_protocol::strain(run).to_vec(),
            _ => series.column("strain").to_vec(),
        };
        let slopes = (0..strain.len()).map(|k| match k {
            0 => f64::NAN,
            k => (stress[k] - stress[k - 1]) / (strain[k] - strain[k - 1]),
        });
        Self {
            deformation,
            modulus: slopes.collect(),
            stress,
            friction: combined(&friction_of[0], &friction_of[1], |s, p| s / p),
            friction_of,
        }
    }

    /// Returns the mean of the mobilised friction over the rows from `first` on, the ratio of the
    /// mean stresses. `weights`: of these rows.
    pub fn mean_friction(&self, first: usize, weights: &[f64]) -> TimeMean {
        let [numerator, denominator] = self.friction_of.each_ref().map(|stress| &stress[first..]);
        TimeMean::of_ratio(numerator, denominator, weights)
    }

    /// `[L]` By the names of their columns.
    pub fn columns(self) -> [(&'static str, Vec<f64>); 3] {
        [
            ("conjugate_stress", self.stress),
            (MOBILISED_FRICTION, self.friction),
            ("modulus", self.modulus),
        ]
    }

    fn figures(&self, axis: &Axis, series: &Series) -> Vec<ReportFigure> {
        let deformation = self.deformation;
        let mut friction = "Sine of the mobilised friction angle: difference of the stresses along the height and across it, over their sum.";
        if deformation.is_shear() {
            friction = "Shear stress over pressure.";
        }
        let curves = [
            MeasuredCurve {
                name: "stress-strain",
                caption: format!("{}: {}.", deformation.name, deformation.stress[0]),
                label: &deformation.stress[1],
                column: "conjugate_stress",
                values: &self.stress,
            },
            MeasuredCurve {
                name: "modulus",
                caption: format!("{}, from one strain step to the next.", deformation.modulus),
                label: &deformation.modulus,
                column: "modulus",
                values: &self.modulus,
            },
            MeasuredCurve {
                name: "friction",
                caption: friction.into(),
                label: "mobilised friction",
                column: MOBILISED_FRICTION,
                values: &self.friction,
            },
        ];
        let figures = curves
            .into_iter()
            .filter_map(|curve| curve.drawn(axis, series));
        figures.collect()
    }
}

/// A function of two columns, row by row.
fn combined(a: &[f64], b: &[f64], function: fn(f64, f64) -> f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| function(*a, *b)).collect()
}

/// First and last finite value, if the last is another.
fn ends(values: &[f64]) -> String {
    let mut finite = values.iter().copied().filter(|x| x.is_finite());
    match (finite.next(), finite.next_back()) {
        (Some(first), Some(last)) if first != last => {
            format!("{} … {}", digits(first), digits(last))
        }
        (Some(first), _) => digits(first),
        (None, _) => "none".into(),
    }
}

fn digits(x: f64) -> String {
    match x.abs() {
        0.0 | 1e-3..1e6 => format!("{x:.6}"),
        _ => format!("{x:.6e}"),
    }
}

fn percent(strain: f64) -> String {
    format!("{:.6} %", 100.0 * strain)
}

/// Adds the facts of the strain steps or of Newton's equations; returns their name and figures.
///
/// # Errors
/// A damaged table of eigenvalues.
pub fn measured(run: &RunFile, facts: &mut Facts) -> Result<(&'static str, Vec<ReportFigure>)> {
    match run.stage() {
        RunStage::Newtonian => Ok(("Newton's equations", in_time(run, facts)?)),
        _ => Ok(over_strain(run, facts)),
    }
}

fn in_time(run: &RunFile, facts: &mut Facts) -> Result<Vec<ReportFigure>> {
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
    let axis = Axis::of(run);
    let panels = PANELS.newtonian.iter();
    let panels = panels.filter_map(|panel| drawn(run, &axis, panel));
    Ok(panels.chain(eigenvalues(run)?).collect())
}

/// The eigenvalues over time, if the run has computed some.
fn eigenvalues(run: &RunFile) -> Result<Option<ReportFigure>> {
    let path = run.folder().join(SPECTRA_FILE);
    if !path.exists() {
        return Ok(None);
    }
    let rows: Vec<SpectrumRow> = csv_table::read(&path)?;
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
    let [least, most] = extent(strain.iter().copied().chain([0.0]));
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
    facts.push((&measured.deformation.modulus, ends(&measured.modulus)));
    let friction = &measured.friction;
    let known = (0..strain.len()).filter(|k| friction[*k].is_finite());
    if let Some(k) = known.max_by(|a, b| friction[*a].total_cmp(&friction[*b])) {
        let angle = if measured.deformation.is_shear() {
            friction[k].atan()
        } else {
            friction[k].asin()
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
        let name = "Strain steps for which Newton's method did not converge";
        let all = strain.len().saturating_sub(1);
        (name, format!("{steps} of {all}"))
    }));
    let axis = Axis::of(run);
    let mut figures = measured.figures(&axis, series);
    let panels = PANELS.strain.iter();
    let panels = panels.filter(|panel| panel.lines[0][0] != measured.deformation.axis.0);
    figures.extend(panels.filter_map(|panel| drawn(run, &axis, panel)));
    if measured.deformation.is_protocol() {
        let label = &measured.deformation.stress[1];
        figures.extend(box_protocol::figures(run, &axis, label, &measured.stress));
    }
    (&measured.deformation.name, figures)
}

/// Returns the content of `summary.json`: of each file the last row and the parameters.
pub fn json(files: &[&RunFile]) -> Value {
    let stages = files.iter();
    let stages = stages.map(|run| (run.stage().name().to_string(), stage_json(run)));
    stages.collect::<serde_json::Map<_, _>>().into()
}

fn stage_json(run: &RunFile) -> Value {
    let series = run.series();
    let last = series.declared.iter().zip(&series.columns);
    let last = last.map(|(column, values)| (column.name.to_string(), json!(values.last())));
    json!({
        "run": run.path().display().to_string(),
        "digest": run.digest(),
        "grains": run.grains().count(),
        "frames": run.frames(),
        "series_rows": series.rows(),
        "last_row": last.collect::<serde_json::Map<_, _>>(),
        "parameters": run.parameters(),
    })
}
