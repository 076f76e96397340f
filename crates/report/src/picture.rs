//! Pictures of a packing: spheres seen from the front, the right and above, and disks of a box.

use std::collections::BTreeSet;

use gshear_analysis::dmin::{DefinedCounts, RADIUS};
use gshear_analysis::event;
use gshear_analysis::moments::extent;
use gshear_analysis::rattlers::RattlerRule;
use gshear_dem::dimension::{Three, Two};
use gshear_dem::failure::Result;
use gshear_dem::state::{FrameRecords, body};
use gshear_scene::Dimensions;
use gshear_store::csv_table::Table;
use gshear_store::run_reader::{RunFile, RunStage};

use super::ReportFigure;
use super::colour::{FORCE, Scale, VIRIDIS, WALL};
use super::map::DECADES;
use super::plot::{Layout, Plot, figure};
use super::text::marked;

/// Width of the drawing (px), and the greatest height.
const WIDTH: f64 = 620.0;
const TALLEST: f64 = 700.0;
/// Left, top, right, bottom of it (px).
const MARGIN: [f64; 4] = [10.0, 30.0, 130.0, 10.0];
/// Colours of a picture, so that few gradients are needed.
const COLOURS: f64 = 40.0;
/// Most spheres of a picture; of more the front ones are drawn.
const MOST: usize = 20_000;
/// Turn about the vertical, and tilt (rad).
const TURN: f64 = -0.6;
const TILT: f64 = 0.35;

/// Returns the place of a point in the picture, and how far it is from the viewer (m).
fn seen([x, y, z]: [f64; 3]) -> ([f64; 2], f64) {
    let right = x * TURN.cos() + y * TURN.sin();
    let far = y * TURN.cos() - x * TURN.sin();
    let up = z * TILT.cos() + far * TILT.sin();
    ([right, up], far * TILT.cos() - z * TILT.sin())
}

/// [`seen`], but disks are seen from above their plane.
fn place_of(planar: bool, place: [f64; 3]) -> ([f64; 2], f64) {
    if planar {
        ([place[0], place[1]], 0.0)
    } else {
        seen(place)
    }
}

/// Draws the last frame: grains by their velocity, by their displacement and D²min in the latter
/// half of the run, and the contact forces. Nothing for disks between walls, which have maps.
///
/// # Errors
/// If the run is damaged.
pub fn figures(run: &RunFile) -> Result<Vec<ReportFigure>> {
    let (frames, stage) = (run.frames(), run.stage());
    let planar = run.dimension() == Dimensions::Two;
    if planar && run.has_walls() && !run.has_free_surface() || frames == 0 {
        return Ok(Vec::new());
    }
    let last = run.records(frames - 1..frames)?.swap_remove(0);
    let packing = Packing::new(run, &last);
    let mut pictures = Vec::new();
    // Strain steps end at rest.
    if stage != RunStage::Strain {
        let velocity: Vec<f64> = last.grains.iter().map(|g| g.velocity[0]).collect();
        pictures.push(packing.figure(
            ("grains-velocity", "velocity_x"),
            ("velocity along x", "m/s"),
            "",
            (&velocity, packing.range_of(&velocity)),
        ));
    }
    if frames > 2 {
        let numbers = [frames / 2, frames - 1];
        let earlier = run.records(numbers[0]..numbers[0] + 1)?.swap_remove(0);
        let interval = run.interval(numbers, [&earlier, &last]);
        let moved = |n: usize| match run.dimension() {
            Dimensions::Two => interval.displacement::<Two>(n)[0],
            Dimensions::Three => interval.displacement::<Three>(n)[0],
        };
        let moved: Vec<f64> = (0..last.grains.len()).map(moved).collect();
        let when = " in the latter half of the run";
        pictures.push(packing.figure(
            ("grains-displacement", "displacement_x"),
            ("displacement along x", "m"),
            when,
            (&moved, packing.range_of(&moved)),
        ));
        let (grains, mean) = (run.grains(), run.grains().mean_radius());
        let axes = run.dimension().axes();
        let rule = RattlerRule::LeeHurley;
        let (dmin, rattler) = event::without_rattlers(axes, grains, &interval, RADIUS * mean, rule);
        let removed = |n: usize| run.is_removed(&last.grains[n].image);
        let defined = DefinedCounts::of(grains, &dmin, &rattler, removed);
        let over_square: Vec<f64> = dmin.iter().map(|d| (d / (mean * mean)).log10()).collect();
        pictures.push(packing.figure(
            ("grains-dmin", "log10_dmin_over_square"),
            ("log_{10} D²_{min}/r̄²", ""),
            &format!("{when}, {defined}"),
            (&over_square, packing.range_of_levels(&over_square)),
        ));
    }
    if !last.contacts.is_empty() {
        let data = Table::of(&last.contacts)
            .columns(["i", "j"], |c| [c.i, c.j])
            .column("contact_force", |c| c.normal_force)
            .csv();
        let name = if planar { "forces" } else { "forces-3d" };
        let caption = format!(
            "Normal forces of the last frame: lines between the centres, wider and darker for greater forces. {}",
            packing.note()
        );
        let svg = packing.forces(packing.greatest_force());
        pictures.push(ReportFigure::new(name, caption, svg, data));
    }
    Ok(pictures)
}

/// A packing as it is drawn.
pub struct Packing<'a> {
    run: &'a RunFile,
    /// Disks, which are seen as they lie.
    planar: bool,
    frame: &'a FrameRecords,
    /// Those drawn, the farthest first.
    order: Vec<usize>,
    /// Ranges of the picture, across and upwards (m).
    pub view: [[f64; 2]; 2],
    /// Above the picture.
    pub title: String,
}

impl<'a> Packing<'a> {
    /// The whole packing, with its step as the title.
    pub fn new(run: &'a RunFile, frame: &'a FrameRecords) -> Self {
        let planar = run.dimension() == Dimensions::Two;
        let mut order: Vec<usize> = (0..frame.grains.len())
            .filter(|&g| !run.is_removed(&frame.grains[g].image))
            .collect();
        let far = |g: usize| place_of(planar, frame.grains[g].position).1;
        order.sort_by(|&a, &b| far(b).total_cmp(&far(a)));
        order.drain(..order.len().saturating_sub(MOST));
        let view = [0, 1].map(|axis| {
            let at = |g: usize| place_of(planar, frame.grains[g].position).0[axis];
            let ends = order.iter().map(|&g| (at(g), run.grains().radius[g]));
            extent(ends.flat_map(|(at, r)| [at - r, at + r]))
        });
        Self {
            run,
            planar,
            order,
            view,
            title: format!("step {}", frame.step),
            frame,
        }
    }

    fn note(&self) -> String {
        let (all, drawn) = (self.frame.grains.len(), self.order.len());
        let part = format!("Drawn are the {drawn} in front, of {all}. ");
        let part = if drawn < all { &part } else { "" };
        let walls = if self.run.has_walls() {
            "of the walls, and those "
        } else {
            ""
        };
        format!("{part}Grey: grains {walls}without a value.")
    }

    fn table(&self, name: &'static str, values: &[f64]) -> String {
        Table::of(0..self.frame.grains.len())
            .column("id", |g| *g)
            .column("radius", |g| self.run.grains().radius[*g])
            .columns(["x", "y", "z"], |g| self.frame.grains[*g].position)
            .column(name, |g| values[*g])
            .csv()
    }

    /// Draws on axes as wide as the packing, with a colour bar of a range.
    fn drawn(
        &self,
        scale: &Scale,
        range: [f64; 2],
        (label, unit): (&str, &str),
        draw: impl FnOnce(&mut Plot),
    ) -> String {
        // The scene of a box may have any units.
        let label = match (unit, self.run.stage()) {
            ("", _) | (_, RunStage::Strain | RunStage::Newtonian) => label.to_string(),
            (unit, RunStage::Shear) => format!("{label} ({{}}{unit})"),
        };
        let [x, y] = self.view;
        let [width, height] = [x[1] - x[0], y[1] - y[0]];
        let pixels = (WIDTH / width).min(TALLEST / height);
        let [left, top, right, bottom] = MARGIN;
        let (width, height) = (width * pixels, height * pixels);
        let layout = Layout {
            size: [left + width + right, top + height + bottom],
            margin: MARGIN,
        };
        figure(layout, x, y, |plot| {
            draw(plot);
            plot.colour_bar_of(scale, range, &label);
            plot.title(&self.title);
        })
    }

    /// The grains by the values of a quantity, the data with them in `column`; `when` ends the name
    /// of the quantity in the caption.
    fn figure(
        &self,
        (name, column): (&'static str, &'static str),
        (label, unit): (&str, &str),
        when: &str,
        (values, range): (&[f64], [f64; 2]),
    ) -> ReportFigure {
        let (of, note) = (marked(label), self.note());
        let caption = format!("Grains of the last frame by their {of}{when}. {note}");
        let svg = self.grains(values, range, (label, unit));
        ReportFigure::new(name, caption, svg, self.table(column, values))
    }

    fn is_free(&self, g: usize) -> bool {
        self.run.grains().body[g] == body::FREE as u8
    }

    /// Range of the values of the free grains that a scale covers.
    pub fn range_of(&self, values: &[f64]) -> [f64; 2] {
        let known = self.order.iter().filter(|g| self.is_free(**g));
        range_of(known.map(|g| values[*g]))
    }

    /// The same of logarithms of D²min, which is zero but for rounding where neighbours move alike.
    pub fn range_of_levels(&self, values: &[f64]) -> [f64; 2] {
        let [low, high] = self.range_of(values);
        [low.max(high - DECADES), high]
    }

    /// Draws the grains by their values. `label`: of them, and their unit.
    pub fn grains(&self, values: &[f64], range: [f64; 2], label: (&str, &str)) -> String {
        let [low, high] = range;
        let svg = self.drawn(&VIRIDIS, range, label, |plot| {
            let pixels = plot.scale();
            for &g in &self.order {
                let colour = if self.is_free(g) && !values[g].is_nan() {
                    let part = (values[g] - low) / (high - low);
                    VIRIDIS.at((part * COLOURS).round() / COLOURS)
                } else {
                    WALL
                };
                let place = self.seen(g);
                plot.disk(place, self.run.grains().radius[g] * pixels, colour, None);
            }
        });
        self.shaded(svg)
    }

    fn seen(&self, g: usize) -> [f64; 2] {
        place_of(self.planar, self.frame.grains[g].position).0
    }

    fn shaded(&self, svg: String) -> String {
        if self.planar { svg } else { as_spheres(&svg) }
    }

    /// The normal force at the end of a scale.
    pub fn greatest_force(&self) -> f64 {
        let contacts = self.frame.contacts.iter();
        let mut sorted: Vec<f64> = contacts.map(|contact| contact.normal_force).collect();
        sorted.sort_by(f64::total_cmp);
        let at = sorted.get((0.99 * sorted.len().saturating_sub(1) as f64) as usize);
        at.copied().unwrap_or(0.0).max(f64::MIN_POSITIVE)
    }

    /// Draws the normal forces as lines between the centres.
    pub fn forces(&self, high: f64) -> String {
        let force = |k: usize| self.frame.contacts[k].normal_force;
        let (grains, radius) = (&self.frame.grains, &self.run.grains().radius);
        let unit = if self.planar { "N/m" } else { "N" };
        let svg = self.drawn(&FORCE, [0.0, high], ("normal force", unit), |plot| {
            let pixels = plot.scale();
            for &g in self.order.iter().filter(|g| !self.is_free(**g)) {
                plot.disk(self.seen(g), radius[g] * pixels, WALL, None);
            }
            let mut is_drawn = vec![false; grains.len()];
            self.order.iter().for_each(|&g| is_drawn[g] = true);
            let mut order: Vec<usize> = (0..self.frame.contacts.len()).collect();
            order.sort_by(|&a, &b| force(a).total_cmp(&force(b)));
            for k in order {
                let contact = &self.frame.contacts[k];
                let (i, j) = (contact.i as usize, contact.j as usize);
                let (a, b) = (grains[i].position, grains[j].position);
                let apart = (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>();
                // One across the edge of the box would run through all of it.
                let is_near = apart <= (radius[i] + radius[j]).powi(2);
                if is_near && is_drawn[i] && is_drawn[j] {
                    let part = force(k) / high;
                    let width = 0.3 + 3.0 * part.min(1.5);
                    plot.line(&[self.seen(i), self.seen(j)], FORCE.at(part), width);
                }
            }
        });
        self.shaded(svg)
    }
}

/// Range of values that a scale covers.
pub fn range_of(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut sorted: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    // The outermost percent would leave all others in one colour.
    let at = |part: f64| sorted.get((part * (sorted.len().max(1) - 1) as f64) as usize);
    let [low, high] = [0.01, 0.99].map(|part| at(part).copied().unwrap_or(0.0));
    // Equal values still need a scale.
    [low, high.max(low + 1e-12 * low.abs().max(1.0))]
}

/// Shades the disks of a figure as spheres under a light from the upper left.
fn as_spheres(svg: &str) -> String {
    let mut colours = BTreeSet::new();
    let shaded = |line: &str, colours: &mut BTreeSet<String>| -> Option<String> {
        let line = line.strip_prefix("<circle ")?;
        let (before, rest) = line.split_once("fill=\"#")?;
        let (colour, after) = rest.split_once('"')?;
        colours.insert(colour.to_string());
        let fill = format!("fill=\"url(#sphere-{colour})\"");
        Some(format!("<circle {before}{fill}{after}"))
    };
    let lines = svg.lines();
    let body = lines.map(|line| shaded(line, &mut colours).unwrap_or_else(|| line.into()));
    let body: Vec<String> = body.collect();
    let mixed = |colour: &str, with: f64, part: f64| {
        let channel = |k: usize| {
            let value = u8::from_str_radix(&colour[2 * k..2 * k + 2], 16).map_or(0.0, f64::from);
            (value + (with - value) * part).round() as u8
        };
        format!("#{:02x}{:02x}{:02x}", channel(0), channel(1), channel(2))
    };
    let gradients: String = (colours.iter())
        .map(|colour| {
            format!(
                "<radialGradient id=\"sphere-{colour}\" cx=\"0.35\" cy=\"0.3\" r=\"0.75\">\
                 <stop offset=\"0\" stop-color=\"{}\"/><stop offset=\"0.5\" stop-color=\"#{colour}\"/>\
                 <stop offset=\"1\" stop-color=\"{}\"/></radialGradient>\n",
                mixed(colour, 255.0, 0.55),
                mixed(colour, 0.0, 0.55)
            )
        })
        .collect();
    let svg = body.join("\n") + "\n";
    match svg.split_once('>') {
        Some((head, body)) => format!("{head}>\n<defs>\n{gradients}</defs>{body}"),
        None => svg,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x runs to the right, z upwards, y away from the viewer; lengths stay.
    #[test]
    fn points_are_seen_from_the_front_and_above() {
        let ([right, up], far) = seen([1.0, 2.0, 3.0]);
        let length = right * right + up * up + far * far;
        assert!((length - 14.0).abs() < 1e-12);
        assert!(seen([1.0, 0.0, 0.0]).0[0] > 0.0);
        assert!(seen([0.0, 0.0, 1.0]).0[1] > 0.0);
        assert!(seen([0.0, 1.0, 0.0]).1 > 0.0);
        // What is above is nearer to a viewer above.
        assert!(seen([0.0, 0.0, 1.0]).1 < 0.0);
    }

    #[test]
    fn disks_become_spheres_of_their_colour() {
        let svg = "<svg>\n<circle cx=\"1\" cy=\"2\" r=\"3\" fill=\"#808080\" stroke=\"none\"/>\n<line/>\n</svg>\n";
        let shaded = as_spheres(svg);
        let circle = "<circle cx=\"1\" cy=\"2\" r=\"3\" fill=\"url(#sphere-808080)\" stroke";
        assert!(shaded.contains(circle));
        let gradient = "<radialGradient id=\"sphere-808080\"";
        assert_eq!(shaded.matches(gradient).count(), 1);
        assert!(shaded.contains("<line/>"));
    }
}
