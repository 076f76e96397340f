//! The cell: periodic along x.

/// The nearest image of a separation along x in a cell of `length` (m).
pub fn nearest_image(dx: f64, length: f64) -> f64 {
    dx - length * (dx / length).round()
}
