//! What a part of `run.h5` says of its run, and of each grain once.

use crate::contact_quantities::FrameFormat;
use crate::h5::Attribute;
use bytemuck::{Pod, Zeroable};
use gshear_dem::boundary::Boundary;
use gshear_dem::columns::Column;
use gshear_dem::dimension::Dimension;
use gshear_dem::state::{GrainState, Ids, body};
use gshear_dem::system::System;

/// The constant properties of a grain.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GrainShape {
    /// Row of the grain, 0 … N-1.
    pub id: u32,
    /// 0 free, 1 bottom wall, 2 top wall.
    pub body: u32,
    /// R (m).
    pub radius: f64,
    /// m (kg; kg/m in 2D).
    pub mass: f64,
    /// Number of the material.
    pub material: u64,
}

impl GrainShape {
    /// The constant properties of a grain in this state. `mass`: m (kg; kg/m in 2D).
    pub fn new(grain: &GrainState, mass: f64) -> Self {
        Self {
            id: grain.id,
            body: match grain.body {
                // Frames say when.
                body::REMOVED => body::FREE,
                body => body,
            },
            radius: grain.radius,
            mass,
            material: grain.material,
        }
    }

    /// Those of the grains that this rank owns.
    pub fn owned<D: Dimension>(system: &mut System<D>) -> Vec<Self> {
        let grains = system.grains();
        (0..grains.owned)
            .map(|g| Self::new(&grains.state(g), grains.mass[g]))
            .collect()
    }
}

/// Content of a part of `run.h5` from its start on.
#[derive(Debug, Clone, Copy, Default)]
pub struct RunHeader<'a> {
    /// What the contacts are.
    pub form: FrameFormat,
    /// What bounds the box along its last axis.
    pub boundary: &'static Boundary,
    /// Whether quantities are in SI units, and say so: scenes with `[box]` may use any consistent
    /// ones.
    pub units: bool,
    /// Columns of the time series.
    pub series: &'a [Column],
    /// L_x, height at the start of the shear, 0; in three dimensions L_x, L_y, height (m).
    pub edges: [f64; 3],
    /// Who made the run; rank 0's is written.
    pub author: &'a str,
    /// Unit of the tangential history in 3D.
    pub history_unit: &'static str,
    /// This rank's grains; together the ranks hold each of the ids 0 … N-1 once.
    pub grains: &'a [GrainShape],
    /// What readers call them; `None`: by their rows.
    pub ids: Option<&'a Ids>,
    /// Attributes of `parameters`; rank 0's are written.
    pub attributes: &'a [(&'a str, Attribute)],
}
