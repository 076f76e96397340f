//! The figures of time series, which `panels.toml` declares.

use std::sync::LazyLock;

use gshear_store::run_reader::{RunFile, Series};
use serde::Deserialize;

/// # Panics
/// If `panels.toml` is wrong, which is a bug.
pub(crate) static PANELS: LazyLock<Panels> =
    LazyLock::new(|| toml::from_str(include_str!("panels.toml")).expect("panels.toml"));

/// All figures, and what decides on those of a box.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Panels {
    /// Of a shear: those whose columns the run has.
    pub shear: Vec<Panel>,
    /// Over the strain of a box.
    pub strain: Vec<Panel>,
    /// Over the time of Newton's equations.
    pub newtonian: Vec<Panel>,
    pub deformations: Vec<Deformation>,
    /// Columns that are compared between runs unless others are asked for.
    pub compared: Vec<Compared>,
}

/// How the values of a figure are drawn.
#[derive(Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Shown {
    #[default]
    AsTheyAre,
    /// In percent above the first value.
    Growth,
    /// As powers of ten.
    Logarithm,
    /// With an SI prefix before the unit.
    Prefixed,
}

impl Shown {
    /// The values of a column as they are drawn; `factor`: of the SI prefix.
    pub fn values(&self, column: &[f64], factor: f64) -> Vec<f64> {
        let first = column.first().copied().unwrap_or(f64::NAN);
        let values = column.iter().map(|x| match self {
            Self::AsTheyAre | Self::Prefixed => factor * x,
            Self::Growth => 100.0 * (x / first - 1.0),
            // -∞ of 0 breaks the line, as NaN does.
            Self::Logarithm => x.abs().log10(),
        });
        values.collect()
    }
}

/// Quantities on one pair of axes.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Panel {
    pub name: String,
    pub caption: String,
    /// `J` stands for the unit of energies, J or J/m.
    pub label: String,
    #[serde(default)]
    pub shown: Shown,
    /// Columns of the time series, and their names in the legend.
    pub lines: Vec<[String; 2]>,
}

/// A column that is compared between runs.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Compared {
    /// Of the time series, or of statistics of a run.
    pub column: String,
    /// At its axis.
    pub label: String,
}

/// A deformation of a box.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Deformation {
    /// Value of `aqs.deformation`.
    pub key: String,
    pub name: String,
    /// Column, label and factor of what the figures are drawn over.
    pub axis: (String, String, f64),
    /// The stress that works on the strain, in the caption and on the axis.
    pub stress: [String; 2],
    pub modulus: String,
}

impl Deformation {
    /// Whether the shear stress works on it.
    pub fn is_shear(&self) -> bool {
        ["simple-shear", "protocol-shear"].contains(&&*self.key)
    }

    /// Whether it is a list of parts.
    pub fn is_protocol(&self) -> bool {
        self.key.starts_with("protocol")
    }

    /// The deformation of a box.
    pub fn of(run: &RunFile) -> &'static Self {
        let scene = run.scene().parse::<toml::Table>().unwrap_or_default();
        let key = scene
            .get("aqs")
            .and_then(|table| table.get("deformation")?.as_str());
        let key = match key {
            Some("protocol") if has_sheared(run.series()) => Some("protocol-shear"),
            key => key,
        };
        let known = &PANELS.deformations;
        let deformation = known.iter().find(|known| Some(&*known.key) == key);
        deformation.unwrap_or(&known[0])
    }
}

/// Whether a protocol has sheared the box.
pub(crate) fn has_sheared(series: &Series) -> bool {
    series.column("shear_strain").iter().any(|x| *x != 0.0)
}
