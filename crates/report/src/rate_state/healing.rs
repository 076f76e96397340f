//! Figure of healing against hold time.

use super::curve::{LAYOUT, colour_of, law_legend};
use super::{View, all_holds, short};
use crate::colour::{GREY, INK};
use crate::curves::padded;
use crate::plot::figure;
use crate::ticks::{self, Tick};
use gshear_analysis::rate_state::{Evolution, Healing, Hold, peak_growth};

/// Draws Δμ against ln t_hold: measured with ±2 standard errors, the fitted line, and the laws.
pub(super) fn healing(views: &[View]) -> Option<String> {
    let mut fits: Vec<(&View, &Healing)> = Vec::new();
    for view in views {
        fits.extend(view.experiment.healing.iter().map(|fit| (view, fit)));
    }
    if fits.is_empty() {
        return None;
    }
    let mut points: Vec<[f64; 3]> = Vec::new();
    for (view, healing) in &fits {
        let holds = healing.holds.iter().map(|k| &view.experiment.holds[*k]);
        points.extend(holds.filter_map(point));
    }
    let x = padded(points.iter().map(|p| p[0]), 0.08);
    let mut models: Vec<(Evolution, Vec<[f64; 2]>)> = Vec::new();
    for (view, healing) in &fits {
        for (law, model) in view.models {
            let holds = healing.holds.iter();
            let points = holds.filter_map(|k| point(model.holds.get(*k)?));
            let mut points: Vec<[f64; 2]> = points.map(|p| [p[0], p[1]]).collect();
            points.sort_by(|a, b| a[0].total_cmp(&b[0]));
            models.push((*law, points));
        }
    }
    let heights = points.iter().flat_map(ends);
    let modelled = models.iter().flat_map(|(_, m)| m.iter().map(|p| p[1]));
    let y = padded(heights.chain(modelled), 0.08);
    let x_ticks = hold_ticks(x, &points);
    Some(figure(LAYOUT, x, y, |plot| {
        let y_ticks = ticks::round(y[0], y[1], 6);
        plot.grid(&x_ticks, &y_ticks);
        for (law, points) in &models {
            plot.line(points, colour_of(*law), 1.6);
        }
        let ln_10 = std::f64::consts::LN_10;
        for (_, healing) in &fits {
            let line = x.map(|x| [x, healing.intercept + healing.slope * x * ln_10]);
            plot.line(&line, GREY, 1.2);
        }
        for point in &points {
            plot.line(&ends(point).map(|end| [point[0], end]), INK, 1.2);
            plot.disk([point[0], point[1]], 4.0, INK, None);
        }
        plot.clip();
        plot.axes(&x_ticks, &y_ticks, "hold time (s)", "healing Δμ");
        let slope = format!("slope {:.4} per factor of e", fits[0].1.slope).replace('-', "−");
        let mut legend = vec![
            (INK, "peak − μ_{ss}, ±2 standard errors"),
            (GREY, slope.as_str()),
        ];
        let laws = law_legend(models.iter().map(|(law, _)| *law), views[0].given);
        legend.extend(laws.iter().map(|(colour, name)| (*colour, &**name)));
        plot.legend(&legend);
    }))
}

/// lg t_hold, Δμ and its standard error.
fn point(hold: &Hold) -> Option<[f64; 3]> {
    let reslide = hold.reslide?;
    Some([hold.duration.log10(), reslide.healing, reslide.error])
}

/// Δμ less and more two standard errors.
fn ends(point: &[f64; 3]) -> [f64; 2] {
    let [_, value, error] = point;
    [value - 2.0 * error, value + 2.0 * error]
}

/// Ticks at the decades of the hold times, or, if there are not two, at the hold times.
fn hold_ticks(x: [f64; 2], points: &[[f64; 3]]) -> Vec<Tick> {
    let decades = ticks::decades(x[0], x[1], 9);
    if decades.len() > 1 {
        return decades;
    }
    let mut ticks: Vec<Tick> = (points.iter())
        .map(|point| (point[0], short(10f64.powf(point[0]))))
        .collect();
    ticks.sort_by(|a, b| a.0.total_cmp(&b.0));
    ticks.dedup_by(|a, b| a.1 == b.1);
    ticks
}

/// Returns the C for which peaks after holds of equal duration are proportional to C + ln(V_r/V_i).
/// `None` if no two velocity ratios share a duration, or if C or one of the sums is not positive.
pub(super) fn peak_offset(views: &[View]) -> Option<f64> {
    let holds: Vec<&Hold> = all_holds(views).into_iter().map(|(_, hold)| hold).collect();
    let growth = peak_growth(holds.iter().copied());
    let grows = growth.iter().filter(|growth| growth.slope > 0.0);
    let (sum, weight) = grows.fold((0.0, 0.0), |(sum, weight), growth| {
        let offset = growth.intercept / growth.slope;
        (sum + offset * growth.spread, weight + growth.spread)
    });
    let offset = sum / weight;
    // Without healing it may not be positive, and the peaks cannot be divided by it.
    let mut ratios = holds
        .iter()
        .filter_map(|hold| Some(hold.reslide?.velocity / hold.before));
    let are_positive = offset > 0.0 && ratios.all(|ratio| offset + ratio.ln() > 0.0);
    are_positive.then_some(offset)
}
