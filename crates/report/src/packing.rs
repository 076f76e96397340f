//! Pictures of a packing from outside: spheres seen from the front, the right and above, and disks
//! of a box.

use std::collections::BTreeSet;

use gshear_analysis::moments::extent;
use gshear_dem::dimension::Dimensions;
use gshear_dem::state::{ContactSample, Frame, body};
use gshear_store::csv_table::Table;
use gshear_store::run_reader::{RunFile, RunStage};

use super::colour::{FORCE, Scale, VIRIDIS, WALL};
use super::frame_picture::{DECADES, Field, FramePicture, levels, range_of, velocities};
use super::plot::{Layout, Plot, figure};

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

/// A point as it is seen.
#[derive(Debug, Clone, Copy)]
struct SeenPoint {
    /// Place in the picture, to the right and upwards (m).
    place: [f64; 2],
    /// Distance from the viewer, but for a constant (m).
    depth: f64,
}

impl SeenPoint {
    /// A point of a packing of spheres. Disks are seen from above their plane.
    fn new(dimension: Dimensions, position: [f64; 3]) -> Self {
        let [x, y, z] = position;
        if dimension == Dimensions::Two {
            return Self {
                place: [x, y],
                depth: 0.0,
            };
        }
        let right = x * TURN.cos() + y * TURN.sin();
        let far = y * TURN.cos() - x * TURN.sin();
        let up = z * TILT.cos() + far * TILT.sin();
        Self {
            place: [right, up],
            depth: far * TILT.cos() - z * TILT.sin(),
        }
    }
}

/// The name of a quantity of the grains, with its marks, and its unit; empty without one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Label {
    pub name: &'static str,
    pub unit: &'static str,
}

impl Label {
    pub const VELOCITY: Self = Self {
        name: "velocity along x",
        unit: "m/s",
    };
    pub(crate) const DISPLACEMENT: Self = Self {
        name: "displacement along x",
        unit: "m",
    };
    /// Of [`levels`].
    pub(crate) const DMIN: Self = Self {
        name: "log_{10} D²_{min}/r̄²",
        unit: "",
    };
}

/// A packing as it is drawn.
pub struct Packing<'a> {
    run: &'a RunFile,
    frame: &'a Frame,
    /// Those drawn, the farthest first.
    order: Vec<usize>,
    /// Ranges of the picture, across and upwards (m).
    view: [[f64; 2]; 2],
}

impl<'a> Packing<'a> {
    /// The whole packing.
    pub fn new(run: &'a RunFile, frame: &'a Frame) -> Self {
        let grains = 0..frame.grains.len();
        let mut packing = Self {
            run,
            frame,
            order: grains.filter(|g| !frame.is_removed(*g)).collect(),
            view: [[0.0; 2]; 2],
        };
        let depths: Vec<f64> = (frame.grains.iter())
            .map(|grain| SeenPoint::new(frame.dimension, grain.position).depth)
            .collect();
        packing
            .order
            .sort_by(|&a, &b| depths[b].total_cmp(&depths[a]));
        let behind = packing.order.len().saturating_sub(MOST);
        packing.order.drain(..behind);
        packing.view = [0, 1].map(|axis| {
            let ends = packing.order.iter().flat_map(|&g| {
                let (at, r) = (packing.seen(g)[axis], run.grains().radius[g]);
                [at - r, at + r]
            });
            extent(ends)
        });
        packing
    }

    /// Says which grains are not drawn, or grey.
    pub fn note(&self) -> String {
        let (all, drawn) = (self.frame.grains.len(), self.order.len());
        let part = if drawn < all {
            format!("Drawn are the {drawn} in front, of {all}. ")
        } else {
            String::new()
        };
        let walls = if self.run.boundary().has_walls() {
            "of the walls, and those "
        } else {
            ""
        };
        format!("{part}Grey: grains {walls}without a value.")
    }

    /// A table of the grains and their values, `[N]`, in a column of this name.
    pub fn table(&self, name: &'static str, values: &[f64]) -> String {
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
        label: Label,
        title: &str,
        draw: impl FnOnce(&mut Plot),
    ) -> String {
        // The scene of a box may have any units.
        let label = match (label.unit, self.run.stage()) {
            ("", _) | (_, RunStage::Strain | RunStage::Newtonian) => label.name.to_string(),
            (unit, RunStage::Shear) => format!("{} ({{}}{unit})", label.name),
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
        let svg = figure(layout, x, y, |plot| {
            draw(plot);
            plot.colour_bar_of(scale, range, &label);
            plot.title(title);
        });
        match self.frame.dimension {
            Dimensions::Two => svg,
            Dimensions::Three => as_spheres(&svg),
        }
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
    pub(crate) fn range_of_levels(&self, values: &[f64]) -> [f64; 2] {
        let [low, high] = self.range_of(values);
        [low.max(high - DECADES), high]
    }

    /// Draws the grains by their values.
    pub fn grains(&self, values: &[f64], range: [f64; 2], label: Label, title: &str) -> String {
        let [low, high] = range;
        self.drawn(&VIRIDIS, range, label, title, |plot| {
            let pixels = plot.scale();
            for &g in &self.order {
                let colour = if self.is_free(g) && !values[g].is_nan() {
                    let part = (values[g] - low) / (high - low);
                    VIRIDIS.at((part * COLOURS).round() / COLOURS)
                } else {
                    WALL
                };
                let radius = self.run.grains().radius[g] * pixels;
                plot.disk(self.seen(g), radius, colour, None);
            }
        })
    }

    /// The place of a grain in the picture (m).
    fn seen(&self, g: usize) -> [f64; 2] {
        SeenPoint::new(self.frame.dimension, self.frame.grains[g].position).place
    }

    /// The normal force at the end of a scale.
    pub(crate) fn greatest_force(&self) -> f64 {
        let contacts = self.frame.contacts.iter();
        let mut sorted: Vec<f64> = contacts.map(|contact| contact.normal_force).collect();
        sorted.sort_by(f64::total_cmp);
        let at = sorted.get((0.99 * sorted.len().saturating_sub(1) as f64) as usize);
        at.copied().unwrap_or(0.0).max(f64::MIN_POSITIVE)
    }

    /// Draws the normal forces as lines between the centres.
    pub fn forces(&self, high: f64, title: &str) -> String {
        let label = Label {
            name: "normal force",
            unit: match self.frame.dimension {
                Dimensions::Two => "N/m",
                Dimensions::Three => "N",
            },
        };
        self.drawn(&FORCE, [0.0, high], label, title, |plot| {
            let pixels = plot.scale();
            for &g in self.order.iter().filter(|g| !self.is_free(**g)) {
                let radius = self.run.grains().radius[g] * pixels;
                plot.disk(self.seen(g), radius, WALL, None);
            }
            let mut is_drawn = vec![false; self.frame.grains.len()];
            self.order.iter().for_each(|&g| is_drawn[g] = true);
            let mut contacts: Vec<&ContactSample> = self.frame.contacts.iter().collect();
            contacts.sort_by(|a, b| a.normal_force.total_cmp(&b.normal_force));
            for contact in contacts {
                let [i, j] = [contact.i, contact.j].map(|g| g as usize);
                if is_drawn[i] && is_drawn[j] && !self.crosses_edge(contact) {
                    let part = contact.normal_force / high;
                    let width = 0.3 + 3.0 * part.min(1.5);
                    plot.line(&[self.seen(i), self.seen(j)], FORCE.at(part), width);
                }
            }
        })
    }

    /// Whether a contact is across an edge of the box, so that a line between the centres would run
    /// through all of it.
    fn crosses_edge(&self, contact: &ContactSample) -> bool {
        let [i, j] = [contact.i, contact.j].map(|g| g as usize);
        let [a, b] = [i, j].map(|g| self.frame.grains[g].position);
        let square = (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f64>();
        let radius = &self.run.grains().radius;
        square > (radius[i] + radius[j]).powi(2)
    }
}

impl FramePicture for Packing<'_> {
    fn view(&self) -> [[f64; 2]; 2] {
        self.view
    }

    fn set_view(&mut self, view: [[f64; 2]; 2]) {
        self.view = view;
    }

    fn range(&self, field: Field, dmin: &[f64]) -> [f64; 2] {
        match field {
            Field::Force => [0.0, self.greatest_force()],
            Field::Dmin if dmin.iter().all(|d| d.is_nan()) => [f64::NAN; 2],
            Field::Dmin => self.range_of_levels(&levels(self.run.grains(), dmin)),
            Field::Velocity => self.range_of(&velocities(self.frame)),
        }
    }

    fn draw(&self, field: Field, range: [f64; 2], dmin: &[f64], title: &str) -> String {
        match field {
            Field::Force => self.forces(range[1], title),
            Field::Dmin => {
                let levels = levels(self.run.grains(), dmin);
                self.grains(&levels, range, Label::DMIN, title)
            }
            Field::Velocity => self.grains(&velocities(self.frame), range, Label::VELOCITY, title),
        }
    }
}

/// Shades the disks of a figure as spheres under a light from the upper left.
fn as_spheres(svg: &str) -> String {
    let mut colours = BTreeSet::new();
    let lines = svg.lines().map(|line| match filled_circle(line) {
        Some((before, colour, after)) => {
            colours.insert(colour);
            format!("{before}fill=\"url(#sphere-{colour})\"{after}")
        }
        None => line.into(),
    });
    let body: Vec<String> = lines.collect();
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

/// What is before the colour of a filled circle, the colour, and what is after it; `None` of a line
/// that draws something else.
fn filled_circle(line: &str) -> Option<(&str, &str, &str)> {
    let (before, rest) = line.split_once("fill=\"#")?;
    let (colour, after) = rest.split_once('"')?;
    before
        .starts_with("<circle ")
        .then_some((before, colour, after))
}

/// A mixture of a colour (six hexadecimal digits) and a grey (0 to 255), whose share is `part`.
fn mixed(colour: &str, grey: f64, part: f64) -> String {
    let channels = [0, 2, 4].map(|at| {
        let value = u8::from_str_radix(&colour[at..at + 2], 16).map_or(0.0, f64::from);
        (value + (grey - value) * part).round() as u8
    });
    let [red, green, blue] = channels;
    format!("#{red:02x}{green:02x}{blue:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(place: [f64; 3]) -> SeenPoint {
        SeenPoint::new(Dimensions::Three, place)
    }

    /// x runs to the right, z upwards, y away from the viewer; lengths stay.
    #[test]
    fn points_are_seen_from_the_front_and_above() {
        let SeenPoint { place, depth } = seen([1.0, 2.0, 3.0]);
        let length = place[0] * place[0] + place[1] * place[1] + depth * depth;
        assert!((length - 14.0).abs() < 1e-12);
        assert!(seen([1.0, 0.0, 0.0]).place[0] > 0.0);
        assert!(seen([0.0, 0.0, 1.0]).place[1] > 0.0);
        assert!(seen([0.0, 1.0, 0.0]).depth > 0.0);
        // What is above is nearer to a viewer above.
        assert!(seen([0.0, 0.0, 1.0]).depth < 0.0);
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
