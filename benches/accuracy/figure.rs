//! Errors over run time, a panel a case.

use gshear_report::colour::{GREY, INK, SLIP, STICK};
use gshear_report::plot::{Layout, figure};
use gshear_report::ticks::decades;

use crate::cost::{Curve, DEFAULT};
use crate::scheme::Dampers;

const PANEL: [f64; 2] = [560.0, 400.0];
/// Two in a row.
const CASES: [&str; 6] = [
    "impact",
    "oscillation",
    "positions",
    "energy without rolling",
    "elastic positions",
    "elastic energy",
];

/// `docs/figures/accuracy.svg`.
pub fn write(curves: &[Curve]) {
    let panels = CASES.iter().enumerate().map(|(k, case)| {
        let of: Vec<_> = curves.iter().filter(|c| c.case == *case).collect();
        let [x, y] = [k % 2, k / 2].map(|k| k as f64);
        panel(&of).replacen(
            "<svg ",
            &format!("<svg x=\"{}\" y=\"{}\" ", x * PANEL[0], y * PANEL[1]),
            1,
        )
    });
    let inner: String = panels.collect();
    let (width, height) = (2.0 * PANEL[0], 0.5 * CASES.len() as f64 * PANEL[1]);
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n{inner}</svg>\n"
    );
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/figures");
    std::fs::create_dir_all(folder).expect("docs/figures");
    std::fs::write(format!("{folder}/accuracy.svg"), svg).expect("docs/figures/accuracy.svg");
}

fn panel(curves: &[&Curve]) -> String {
    let points = |c: &Curve| -> Vec<[f64; 2]> {
        c.points
            .iter()
            .map(|p| [(1e9 * c.time(p)).log10(), p.error.log10()])
            .collect()
    };
    let all: Vec<_> = curves.iter().flat_map(|c| points(c)).collect();
    let range = |k: usize| {
        let least = all.iter().map(|p| p[k]).fold(f64::MAX, f64::min);
        let most = all.iter().map(|p| p[k]).fold(f64::MIN, f64::max);
        [least - 0.3, most + 0.3]
    };
    let (x, y) = (range(0), range(1));
    let layout = Layout {
        size: PANEL,
        margin: [78.0, 62.0, 16.0, 58.0],
    };
    figure(layout, x, y, |plot| {
        let (across, up) = (decades(x[0], x[1], 8), decades(y[0], y[1], 8));
        plot.grid(&across, &up);
        // The default Δt, by the run time of the program.
        let default = curves[0].points.iter().find(|p| p.step == DEFAULT);
        if let Some(p) = default {
            plot.vertical_line((1e9 * curves[0].time(p)).log10(), GREY);
        }
        for c in curves {
            let colour = match c.dampers {
                Dampers::FullStep => STICK,
                Dampers::HalfStep => SLIP,
            };
            plot.line(&points(c), colour, 1.8);
            for p in points(c) {
                plot.disk(p, 3.2, colour, Some(INK));
            }
        }
        plot.axes(
            &across,
            &up,
            "run time per grain and τ (ns); dashed: the default Δt = τ/10",
            "error",
        );
        let names = curves
            .iter()
            .map(|c| format!("{}, order {:.1}", c.dampers.name(), c.order()));
        let names: Vec<_> = names.collect();
        let colours = [STICK, SLIP];
        let entries: Vec<_> = colours
            .into_iter()
            .zip(names.iter().map(String::as_str))
            .collect();
        plot.legend(&entries);
        plot.heading(curves[0].what);
    })
}
