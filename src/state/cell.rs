//! The cell: periodic along all axes but the last, along which the walls bound it.

use crate::dimension::Dimension;

/// The nearest image of a separation along a periodic axis of `length` (m).
pub fn nearest_image(dx: f64, length: f64) -> f64 {
    dx - length * (dx / length).round()
}

/// The periods of the cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// L_x, and in three dimensions L_y (m).
    pub periods: [f64; 2],
}

impl Cell {
    /// The nearest image of a - b (m), as many components as there are dimensions.
    pub fn separation<D: Dimension>(&self, a: &[f64], b: &[f64]) -> [f64; 3] {
        let mut r = [0.0; 3];
        for (axis, r) in r[..D::AXES].iter_mut().enumerate() {
            *r = a[axis] - b[axis];
            if axis != D::UP {
                *r = nearest_image(*r, self.periods[axis]);
            }
        }
        r
    }

    /// x in [0, period), in the very step in which it left.
    #[cold]
    pub fn wrapped(x: f64, period: f64) -> f64 {
        let inside = if x < 0.0 { x + period } else { x - period };
        // x may be so little below zero that the sum rounds to the period.
        if inside >= period { 0.0 } else { inside }
    }
}

/// Length of a vector (m).
pub fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}
