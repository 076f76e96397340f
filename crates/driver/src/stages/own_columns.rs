//! Columns of the time series that the scene declares.

use std::sync::Arc;

use gshear_dem::boundary::End;
use gshear_dem::columns::Column;
use gshear_dem::dimension::Dimension;
use gshear_dem::domain::Exchange;
use gshear_dem::observables::{Expression, Measure, Measured, Observable, SampleView, measure};
use gshear_scene::{PlaneShear, Scene};

use super::assembly::Assembly;

/// Columns of the time series that the scene declares, in their order.
pub(super) struct OwnColumns {
    columns: Vec<OwnColumn>,
    /// Those of the grains and contacts, which are measured together.
    sampled: Vec<Arc<dyn Observable>>,
    /// Thickness of the bottom wall (m).
    thickness: f64,
}

/// How the values of a column come about.
enum OwnColumn {
    /// The next of those that were measured together.
    Sampled,
    /// By a formula.
    Formula {
        expression: Expression,
        /// Where the row has the values of its names; `None` for the time.
        places: Vec<Option<usize>>,
    },
}

impl OwnColumns {
    /// Those of a shear with these columns of the time series; `None` without any.
    pub fn of(scene: &Scene, shear: &PlaneShear, columns: &[Column]) -> Option<Self> {
        if shear.observables.is_empty() {
            return None;
        }
        let place = |name: &String| columns.iter().position(|column| column.name == name);
        let mut own = Self {
            columns: Vec::new(),
            sampled: Vec::new(),
            thickness: match shear.boundary.bottom {
                End::Grains => shear.wall_thickness(&scene.sample),
                End::Plane | End::Nothing | End::Images => 0.0,
            },
        };
        for observable in &shear.observables {
            own.columns.push(match &observable.measure {
                Measure::Sample(sampled) => {
                    own.sampled.push(sampled.clone());
                    OwnColumn::Sampled
                }
                Measure::Columns(expression) => OwnColumn::Formula {
                    places: expression.names().iter().map(place).collect(),
                    expression: expression.clone(),
                },
            });
        }
        Some(own)
    }

    /// Thickness of the bottom wall (m), above which heights count.
    pub fn bottom_thickness(&self) -> f64 {
        self.thickness
    }

    /// Appends their values to those of the program. Collective.
    pub fn append<D: Dimension>(
        &self,
        exchange: &dyn Exchange,
        assembly: &mut Assembly<'_, D>,
        view: SampleView,
        values: &mut Vec<f64>,
    ) {
        let measured = Measured {
            system: &mut assembly.system,
            forces: &assembly.samples,
            view,
        };
        let mut sampled = measure(exchange, measured, &self.sampled).into_iter();
        for column in &self.columns {
            let value = match column {
                OwnColumn::Sampled => sampled.next().unwrap_or(f64::NAN),
                OwnColumn::Formula { expression, places } => {
                    expression.evaluate(|name| match places[name] {
                        Some(place) => values[place],
                        None => view.time,
                    })
                }
            };
            values.push(value);
        }
    }
}
