//! Labels, legends and points of the figures of several runs.

use plotters::style::RGBColor;

use crate::colour::{CURVES, VIRIDIS};
use crate::plot::Plot;

/// Most names in a legend.
const MOST_NAMES: usize = 12;

/// Draws means `[x, mean, error]`, with a line through them if they are `joined`.
pub(crate) fn draw_means(plot: &mut Plot, means: Vec<[f64; 3]>, joined: bool, colour: RGBColor) {
    let line: Vec<[f64; 2]> = means.iter().map(|[x, y, _]| [*x, *y]).collect();
    if joined {
        plot.line(&line, colour, 1.2);
    }
    let cap = 4.0 / plot.scale();
    for [x, y, error] in means {
        if error > 0.0 {
            let [low, high] = [y - error, y + error];
            plot.line(&[[x, low], [x, high]], colour, 1.2);
            for end in [low, high] {
                plot.line(&[[x - cap, end], [x + cap, end]], colour, 1.2);
            }
        }
        plot.disk([x, y], 3.5, colour, None);
    }
}

/// A unit with its powers as such, of the column `m2 s-2`: m²/s².
pub fn readable(unit: &str) -> String {
    let unit = unit.replace(" s-1", "/s").replace(" m-1", "/m");
    unit.replace(" s-2", "/s²")
        .replace("s-2", "1/s²")
        .replace("m2", "m²")
}

/// The name of a key with its unit, if it has one whatever the law is.
pub(crate) fn key_label(key: &str) -> String {
    match gshear_scene::key(key).map(|key| key.unit) {
        None | Some("") => key.into(),
        Some(unit) => format!("{key} ({unit})"),
    }
}

/// Colours of curves; of more than there are, along a scale.
pub fn colours(count: usize) -> Vec<RGBColor> {
    if count <= CURVES.len() {
        return CURVES[..count].to_vec();
    }
    let shares = (0..count).map(|k| 0.92 * k as f64 / (count - 1) as f64);
    shares.map(|share| VIRIDIS.at(share)).collect()
}

/// The entries of a legend; of many names every second, third, …, none of a single one.
pub fn legend<'n>(names: &'n [String], colours: &[RGBColor]) -> Vec<(RGBColor, &'n str)> {
    let step = names.len().div_ceil(MOST_NAMES).max(1);
    let entries = names.iter().map(String::as_str);
    let entries = colours.iter().copied().zip(entries);
    let named = entries.filter(|(_, name)| !name.is_empty() && names.len() > 1);
    named.step_by(step).collect()
}

/// A mean with its standard error, to two digits of the error.
pub(crate) fn with_error(mean: f64, error: f64) -> String {
    if !mean.is_finite() {
        return "undefined".into();
    }
    if !(error.is_finite() && error > 0.0) {
        return match mean.abs() {
            0.0 | 1e-3..1e6 => format!("{mean:.4}"),
            _ => format!("{mean:.3e}"),
        };
    }
    if !(1e-3..1e6).contains(&mean.abs().max(error)) {
        return format!("{mean:.3e} ± {error:.1e}");
    }
    let digits = (1.0 - error.log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{mean:.digits$} ± {error:.digits$}")
}
