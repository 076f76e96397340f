//! Colours that colour-blind readers can tell apart: the palette of Okabe & Ito, and colour scales.
//!
//! Own scales because `DerivedColorMap` of plotters cannot be a constant and panics for NaN, and
//! its Viridis has fewer stops.

use plotters::style::RGBColor;

/// Text and axes.
pub const INK: RGBColor = RGBColor(0x22, 0x26, 0x2b);
/// Secondary lines and notes.
pub const GREY: RGBColor = RGBColor(0x8a, 0x91, 0x99);
/// Grid lines and background grains.
pub(crate) const PALE: RGBColor = RGBColor(0xe4, 0xe7, 0xea);
/// Background of figures.
pub(crate) const WHITE: RGBColor = RGBColor(0xff, 0xff, 0xff);
/// Free grains in the background.
pub(crate) const GRAIN: RGBColor = RGBColor(0xf3, 0xf4, 0xf6);
/// Wall grains in the background, and outlines.
pub const WALL: RGBColor = RGBColor(0xc3, 0xc8, 0xce);
/// Stick phases.
pub const STICK: RGBColor = RGBColor(0x00, 0x72, 0xb2);
/// Slip phases.
pub const SLIP: RGBColor = RGBColor(0xd5, 0x5e, 0x00);
/// The aging law of rate-and-state friction, as in FR's figure S1.
pub(crate) const AGING_LAW: RGBColor = RGBColor(0x00, 0x9e, 0x73);
/// The slip law of rate-and-state friction, as in FR's figure S1.
pub(crate) const SLIP_LAW: RGBColor = RGBColor(0xcc, 0x79, 0xa7);

/// Curves in one figure: blue, vermillion, green, purple, orange, sky blue, black.
pub(crate) const CURVES: [RGBColor; 7] = [
    STICK,
    SLIP,
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0x56, 0xb4, 0xe9),
    INK,
];
/// A colour scale interpolated between equidistant stops.
pub struct Scale(&'static [u32]);

/// Sequential, light to dark, for forces on white.
pub const FORCE: Scale = Scale(&[0xd3dfee, 0x9ecae1, 0x5ba3cf, 0x2878b8, 0x0d519c, 0x08306b]);
/// Viridis, for D²min.
pub(crate) const VIRIDIS: Scale = Scale(&[
    0x440154, 0x482878, 0x3e4a89, 0x31688e, 0x26828e, 0x1f9e89, 0x35b779, 0x6ece58, 0xb5de2b,
    0xfde725,
]);
/// Diverging from loss to gain: vermillion, pale, blue.
pub(crate) const CHANGE: Scale = Scale(&[
    0x9c3b00, 0xd55e00, 0xf2b48a, 0xe4e7ea, 0x8fc1e3, 0x0072b2, 0x004a75,
]);

impl Scale {
    /// Returns the colour at a value of 0 … 1; values outside take the colour of the nearer end.
    pub fn at(&self, value: f64) -> RGBColor {
        let last = self.0.len() - 1;
        let place = value.clamp(0.0, 1.0) * last as f64;
        let stop = (place as usize).min(last - 1);
        let part = place - stop as f64;
        let [red, green, blue] = [16, 8, 0].map(|shift| {
            let [a, b] =
                [self.0[stop], self.0[stop + 1]].map(|colour| f64::from((colour >> shift) & 0xff));
            (a + (b - a) * part).round() as u8
        });
        RGBColor(red, green, blue)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_passes_through_its_stops_and_stays_at_its_ends() {
        for (value, colour) in [
            (-1.0, 0x440154),
            (0.0, 0x440154),
            (1.0 / 3.0, 0x31688e),
            (1.0, 0xfde725),
            (2.0, 0xfde725),
        ] {
            let RGBColor(r, g, b) = VIRIDIS.at(value);
            let found = u32::from_be_bytes([0, r, g, b]);
            assert_eq!(found, colour, "at {value}");
        }
    }
}
