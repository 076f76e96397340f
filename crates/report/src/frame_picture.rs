//! What pictures of frames have in common: what they show, and on which scales.

use std::str::FromStr;

use gshear_dem::failure::Result;
use gshear_dem::state::{Frame, GrainConstants};

/// Greatest number of decades of D²min on the colour bar.
pub(crate) const DECADES: f64 = 8.0;

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Normal forces of the contacts.
    Force,
    /// D²min of the grains since the frame before.
    Dmin,
    /// Velocity of the grains along x.
    Velocity,
}

impl FromStr for Field {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "force" => Ok(Self::Force),
            "dmin" => Ok(Self::Dmin),
            "velocity" => Ok(Self::Velocity),
            _ => Err("write force, dmin or velocity".into()),
        }
    }
}

/// A frame as it is drawn: a map of disks between walls, or a packing as it is seen from outside.
pub(crate) trait FramePicture {
    /// Ranges of what is seen, across and upwards (m).
    fn view(&self) -> [[f64; 2]; 2];

    /// Chooses what is seen.
    fn set_view(&mut self, view: [[f64; 2]; 2]);

    /// Ends of the scale of a field. `dmin`: `[N]` (m²).
    fn range(&self, field: Field, dmin: &[f64]) -> [f64; 2];

    /// Draws a field as SVG. `range`: ends of the scale; `dmin`: `[N]` (m²).
    fn draw(&self, field: Field, range: [f64; 2], dmin: &[f64], title: &str) -> String;
}

/// `[N]` log₁₀ D²min/r̄².
pub fn levels(grains: &GrainConstants, dmin: &[f64]) -> Vec<f64> {
    let square = grains.mean_radius().powi(2);
    dmin.iter().map(|d| (d / square).log10()).collect()
}

/// `[N]` Velocity along x (m/s).
pub fn velocities(frame: &Frame) -> Vec<f64> {
    frame.grains.iter().map(|grain| grain.velocity[0]).collect()
}

/// Range of values that a scale covers.
pub fn range_of(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut sorted: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    // The outermost percent would leave all others in one colour.
    let [low, high] = [0.01, 0.99].map(|part: f64| {
        let rank = (part * (sorted.len().max(1) - 1) as f64) as usize;
        sorted.get(rank).copied().unwrap_or(0.0)
    });
    // Equal values still need a scale.
    [low, high.max(low + 1e-12 * low.abs().max(1.0))]
}
