//! Maps of disks between walls: force network, change of forces, and D²min.

use plotters::style::RGBColor;

use super::colour::{CHANGE, FORCE, GRAIN, GREY, VIRIDIS, WALL, WHITE};
use super::frame_picture::{DECADES, Field, FramePicture, levels, range_of, velocities};
use super::plot::{Layout, Plot, figure};
use super::ticks::{self, Tick};
use gshear_analysis::forces;
use gshear_analysis::moments::extent;
use gshear_dem::state::{ContactSample, Frame, GrainConstants};
use gshear_store::csv_table::Table;

const WIDTH: f64 = 900.0;
const MARGIN: [f64; 4] = [72.0, 36.0, 104.0, 58.0];
/// Greatest height of the sample in a map (px).
const TALLEST: f64 = 900.0;
/// Greatest number of grains in a map; of larger samples only a part is shown, since browsers fail
/// on larger files.
pub const MOST_GRAINS: usize = 20_000;

/// Returns the ranges of x and y (m) of the whole sample, or of the part around `centre` with about
/// [`MOST_GRAINS`] grains if it has more.
pub(crate) fn view_of(grains: &GrainConstants, frame: &Frame, centre: [f64; 2]) -> [[f64; 2]; 2] {
    let reach = grains.radius.iter().copied().fold(0.0, f64::max);
    let heights = present(frame).map(|n| frame.grains[n].position[1]);
    let [low, high] = extent(heights);
    let [low, high] = [low - reach, high + reach];
    let length = frame.cell.periods[0];
    let share = (MOST_GRAINS as f64 / grains.count() as f64).sqrt();
    if share >= 1.0 {
        return [[0.0, length], [low, high]];
    }
    let [x, y] = centre;
    [
        part_of(share, x, [0.0, length]),
        part_of(share, y, [low, high]),
    ]
}

/// The share of a range around a centre.
fn part_of(share: f64, centre: f64, whole: [f64; 2]) -> [f64; 2] {
    let [low, high] = whole;
    let half = 0.5 * share * (high - low);
    let centre = centre.clamp(low + half, high - half);
    [centre - half, centre + half]
}

/// The grains that are not removed.
fn present(frame: &Frame) -> impl Iterator<Item = usize> {
    (0..frame.grains.len()).filter(|n| !frame.is_removed(*n))
}

/// The centre of a grain (m).
fn centre(frame: &Frame, grain: u32) -> [f64; 2] {
    let [x, y, _] = frame.grains[grain as usize].position;
    [x, y]
}

/// A table of the contacts of a frame, with the centres of both grains (m) and F_n (N/m).
pub(crate) fn data_of_contacts(frame: &Frame) -> String {
    let forces: Vec<f64> = frame.contacts.iter().map(|c| c.normal_force).collect();
    data_of("contact_force", frame, &forces)
}

/// A table of the contacts of the later frame with the change of their force (N/m).
pub(crate) fn data_of_changes(earlier: &Frame, later: &Frame) -> String {
    let mut changes = Vec::new();
    forces::changes(earlier, later, &mut changes);
    data_of("change", later, &changes)
}

/// A table of the contacts of a frame with a value of each, `[contacts]`.
fn data_of(name: &str, frame: &Frame, values: &[f64]) -> String {
    Table::of(frame.contacts.iter().zip(values))
        .columns(["i", "j"], |(contact, _)| [contact.i, contact.j])
        .columns(["x_i", "y_i"], |(contact, _)| centre(frame, contact.i))
        .columns(["x_j", "y_j"], |(contact, _)| centre(frame, contact.j))
        .column(name, |(_, value)| **value)
        .csv()
}

/// A table of the grains that are not removed: centre and radius (m), and D²min (m²).
pub(crate) fn data_of_grains(grains: &GrainConstants, frame: &Frame, dmin: &[f64]) -> String {
    Table::of(present(frame))
        .column("id", |n| *n)
        .columns(["x", "y"], |n| centre(frame, *n as u32))
        .column("radius", |n| grains.radius[*n])
        .column("dmin", |n| dmin[*n])
        .csv()
}

/// Returns the F_n (N/m) that 99.9 % of the contacts stay below. With the maximum as the end of the
/// scale, most contacts would look alike.
pub(crate) fn scale_of_forces(frames: &[&Frame]) -> f64 {
    let contacts = frames.iter().flat_map(|frame| &frame.contacts);
    let mut forces: Vec<f64> = contacts.map(|c| c.normal_force).collect();
    forces.sort_by(f64::total_cmp);
    let at = forces.get((forces.len() * 999) / 1000);
    at.copied().unwrap_or(0.0)
}

/// A frame and the part of it that is shown.
#[derive(Clone, Copy)]
pub struct Map<'a> {
    grains: &'a GrainConstants,
    frame: &'a Frame,
    /// Ranges of x and y (m).
    view: [[f64; 2]; 2],
}

impl<'a> Map<'a> {
    /// The part `view` of a frame of these grains.
    pub fn new(grains: &'a GrainConstants, frame: &'a Frame, view: [[f64; 2]; 2]) -> Self {
        Self {
            grains,
            frame,
            view,
        }
    }

    /// The shifts by periods of the cell that bring something at x with half-width `reach` into
    /// view.
    fn shifts(&self, x: f64, reach: f64) -> impl Iterator<Item = f64> + use<> {
        let ([low, high], length) = (self.view[0], self.frame.cell.periods[0]);
        let shifts = [-length, 0.0, length].into_iter();
        shifts.filter(move |shift| x + shift + reach >= low && x + shift - reach <= high)
    }

    /// Whether something at height y with half-height `reach` is in view.
    fn sees_height(&self, y: f64, reach: f64) -> bool {
        let [low, high] = self.view[1];
        y + reach >= low && y - reach <= high
    }

    /// Draws the normal forces as lines between the centres of touching grains, with width and
    /// colour by F_n. `greatest`: F_n (N/m) at the end of the scale, so that two frames can share
    /// one.
    pub fn forces(&self, greatest: f64, title: &str) -> String {
        let greatest = if greatest > 0.0 { greatest } else { 1.0 };
        let contacts = self.frame.contacts.iter();
        let shares: Vec<f64> = contacts.map(|c| c.normal_force / greatest).collect();
        self.drawn(title, |plot| {
            self.network(plot, &shares, |share| FORCE.at(share));
            plot.clip();
            let label = "normal force F_{n}\u{a0}({}N/m)";
            plot.colour_bar_of(&FORCE, [0.0, greatest], label);
        })
    }

    /// Draws the differential force network from an earlier frame to this one.
    pub(crate) fn force_changes(&self, earlier: &Frame, title: &str) -> String {
        let mut changes = Vec::new();
        forces::changes(earlier, self.frame, &mut changes);
        let greatest = changes.iter().fold(0.0_f64, |most, c| most.max(c.abs()));
        let greatest = if greatest > 0.0 { greatest } else { 1.0 };
        for change in &mut changes {
            *change /= greatest;
        }
        self.drawn(title, |plot| {
            self.network(plot, &changes, |share| CHANGE.at(0.5 + 0.5 * share));
            plot.clip();
            plot.colour_bar_of(&CHANGE, [-greatest, greatest], "change of |f| ({}N/m)");
        })
    }

    /// Range of log₁₀ D²min/r̄² that a scale covers; `dmin` is `[N]` (m²).
    pub(crate) fn range_of_dmin(&self, dmin: &[f64]) -> [f64; 2] {
        let mut levels = levels(self.grains, dmin);
        levels.retain(|level| level.is_finite());
        levels.sort_by(f64::total_cmp);
        let high = levels.last().copied().unwrap_or(0.0);
        let low = levels.get(levels.len() / 50).copied().unwrap_or(-1.0);
        [low.clamp(high - DECADES, high - 1.0), high]
    }

    /// Draws D²min/r̄² of the grains on a logarithmic scale; `dmin` is `[N]` (m²). Grains without a
    /// defined value are white.
    pub fn dmin(&self, dmin: &[f64], range: [f64; 2], title: &str) -> String {
        self.drawn(title, |plot| {
            self.coloured(plot, &levels(self.grains, dmin), range);
            let [low, high] = range;
            let ticks = ticks::on_bar(ticks::decades(low, high, 8), low, high);
            plot.colour_bar(&VIRIDIS, &ticks, "D²_{min}/r̄²");
        })
    }

    /// Draws the velocity of the grains along x (m/s).
    fn velocity(&self, range: [f64; 2], title: &str) -> String {
        self.drawn(title, |plot| {
            self.coloured(plot, &velocities(self.frame), range);
            plot.colour_bar_of(&VIRIDIS, range, "velocity along x ({}m/s)");
        })
    }

    /// Draws the grains by their values; those without one are white, those of the walls outlined.
    fn coloured(&self, plot: &mut Plot, values: &[f64], range: [f64; 2]) {
        let [low, high] = range;
        for (n, value) in values.iter().enumerate() {
            let fill = if value.is_nan() {
                WHITE
            } else {
                VIRIDIS.at((value - low) / (high - low))
            };
            let is_plain = !value.is_nan() && self.grains.body[n] == 0;
            self.disk(plot, n, fill, if is_plain { fill } else { GREY });
        }
        plot.clip();
    }

    /// Axes in metres with an SI prefix around what `draw` draws and clips.
    fn drawn(&self, title: &str, draw: impl FnOnce(&mut Plot)) -> String {
        let [x, y] = self.view;
        let (factor, unit) = ticks::prefix(x[1] - x[0]);
        let [left, top, right, bottom] = MARGIN;
        let ratio = (y[1] - y[0]) / (x[1] - x[0]);
        let width = (WIDTH - left - right).min(TALLEST / ratio);
        let size = [width + left + right, width * ratio + top + bottom];
        let layout = Layout {
            size: size.map(f64::round),
            margin: MARGIN,
        };
        figure(layout, x, y, |plot| {
            draw(plot);
            plot.title(title);
            let wanted = (8.0 * ratio).clamp(2.0, 12.0) as usize;
            let (x_ticks, y_ticks) = (scaled_ticks(x, factor, 8), scaled_ticks(y, factor, wanted));
            let labels = ["x", "y"].map(|axis| format!("{axis} ({unit}m)"));
            plot.axes(&x_ticks, &y_ticks, &labels[0], &labels[1]);
        })
    }

    /// Draws a grain and its periodic images in view.
    fn disk(&self, plot: &mut Plot, n: usize, fill: RGBColor, outline: RGBColor) {
        let ([x, y], radius) = (centre(self.frame, n as u32), self.grains.radius[n]);
        if !self.frame.is_removed(n) && self.sees_height(y, radius) {
            let pixels = radius * plot.scale();
            for shift in self.shifts(x, radius) {
                plot.disk([x + shift, y], pixels, fill, Some(outline));
            }
        }
    }

    /// Draws pale grains, and contacts as lines between their centres. The share of a contact,
    /// -1 … 1, gives width and colour. The strongest lie on top.
    fn network(&self, plot: &mut Plot, shares: &[f64], colour: impl Fn(f64) -> RGBColor) {
        let (grains, frame) = (self.grains, self.frame);
        for (n, body) in grains.body.iter().enumerate() {
            self.disk(plot, n, if *body == 0 { GRAIN } else { WALL }, WALL);
        }
        let widest = 1.1 * grains.mean_radius() * plot.scale();
        let shares = shares.iter().map(|share| share.clamp(-1.0, 1.0));
        let mut sorted: Vec<(f64, &ContactSample)> = shares.zip(&frame.contacts).collect();
        sorted.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
        for (share, contact) in sorted {
            let from = centre(frame, contact.i);
            // The nearest image keeps a contact across the periodic boundary short.
            let [x, y, _] = frame.separation(contact.i, contact.j);
            let width = (widest * share.abs()).max(0.3);
            if !self.sees_height(from[1] + 0.5 * y, 0.5 * y.abs()) {
                continue;
            }
            for shift in self.shifts(from[0] + 0.5 * x, 0.5 * x.abs()) {
                let start = [from[0] + shift, from[1]];
                plot.line(&[start, [start[0] + x, start[1] + y]], colour(share), width);
            }
        }
    }
}

impl FramePicture for Map<'_> {
    fn view(&self) -> [[f64; 2]; 2] {
        self.view
    }

    fn set_view(&mut self, view: [[f64; 2]; 2]) {
        self.view = view;
    }

    fn range(&self, field: Field, dmin: &[f64]) -> [f64; 2] {
        match field {
            Field::Force => [0.0, scale_of_forces(&[self.frame])],
            Field::Dmin if dmin.iter().all(|d| d.is_nan()) => [f64::NAN; 2],
            Field::Dmin => self.range_of_dmin(dmin),
            Field::Velocity => range_of(velocities(self.frame).into_iter()),
        }
    }

    fn draw(&self, field: Field, range: [f64; 2], dmin: &[f64], title: &str) -> String {
        match field {
            Field::Force => self.forces(range[1], title),
            Field::Dmin => self.dmin(dmin, range, title),
            Field::Velocity => self.velocity(range, title),
        }
    }
}

/// Ticks of a range at which the places times `factor` are round numbers.
fn scaled_ticks(range: [f64; 2], factor: f64, wanted: usize) -> Vec<Tick> {
    let [low, high] = range;
    let ticks = ticks::round(low * factor, high * factor, wanted).into_iter();
    ticks.map(|(at, label)| (at / factor, label)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use gshear_dem::dimension::Dimensions;
    use gshear_dem::state::{Cell, GrainSample};

    fn disks(count: usize, radius: f64) -> GrainConstants {
        GrainConstants {
            radius: vec![radius; count],
            body: vec![0; count],
            mass: vec![1.0; count],
        }
    }

    fn frame(length: f64, places: &[[f64; 2]], contacts: Vec<ContactSample>) -> Frame {
        let grain = |[x, y]: &[f64; 2]| GrainSample {
            position: [*x, *y, 0.0],
            ..GrainSample::zeroed()
        };
        Frame {
            dimension: Dimensions::Two,
            cell: Cell::between_walls([length, f64::INFINITY]),
            step: 0,
            time: 0.0,
            grains: places.iter().map(grain).collect(),
            contacts,
            wall_contacts: Vec::new(),
        }
    }

    #[test]
    fn removed_grains_are_not_shown() {
        let grains = disks(3, 1.0);
        let mut frame = frame(20.0, &[[4.0, 5.0], [5.0, 99.0], [8.0, 6.0]], Vec::new());
        frame.grains[1].removed = 1;
        let view = view_of(&grains, &frame, [10.0, 5.0]);
        assert_eq!(view[1], [4.0, 7.0]);
        let map = Map::new(&grains, &frame, view);
        let dmin = [0.5, f64::NAN, 0.1];
        for svg in [
            map.forces(1.0, ""),
            map.dmin(&dmin, map.range_of_dmin(&dmin), ""),
        ] {
            let disks = svg.lines().filter(|line| line.starts_with("<circle"));
            // Each is filled and outlined.
            assert_eq!(disks.count(), 4, "{svg}");
        }
        let data = data_of_grains(&grains, &frame, &dmin);
        let ids = data.lines().filter_map(|line| line.split(',').next());
        assert_eq!(ids.collect::<Vec<_>>(), ["id", "0", "2"]);
    }

    #[test]
    fn a_contact_across_the_seam_is_drawn_at_both_ends_and_is_short() {
        let grains = disks(2, 1.0);
        let contact = ContactSample {
            j: 1,
            normal_force: 1.0,
            ..ContactSample::zeroed()
        };
        let frame = frame(20.0, &[[0.5, 5.0], [18.6, 5.0]], vec![contact]);
        let svg = Map::new(&grains, &frame, [[0.0, 20.0], [0.0, 10.0]]).forces(1.0, "");
        let lines = svg.lines().filter(|line| line.starts_with("<polyline"));
        let points = lines.filter_map(|line| line.split("points=\"").nth(1));
        let ends = points.map(|points| -> Vec<f64> {
            let numbers = points.split([',', ' ', '"']).step_by(2).take(2);
            numbers.map(|x| x.parse().expect("a number")).collect()
        });
        let pixels = 10.0 * (WIDTH - MARGIN[0] - MARGIN[2]) / 20.0;
        let at = |x: f64| (10.0 * MARGIN[0] + x * pixels).round();
        let expected = [[at(0.5), at(-1.4)], [at(20.5), at(18.6)]];
        assert_eq!(ends.collect::<Vec<_>>(), expected);
        // Only the disk at 0.5 extends across the periodic boundary.
        let fills = svg.lines().filter(|line| line.contains("fill=\"#F3F4F6\""));
        assert_eq!(fills.count(), 3);
    }

    #[test]
    fn great_samples_are_shown_in_part() {
        let n = 4 * MOST_GRAINS;
        let height = |k: usize| [0.0, 40.0 * k as f64 / (n - 1) as f64];
        let grains = disks(n, 0.1);
        let places: Vec<[f64; 2]> = (0..n).map(height).collect();
        let frame = frame(100.0, &places, Vec::new());
        let view = view_of(&grains, &frame, [99.0, 20.0]);
        let ends = view.as_flattened();
        let mut pairs = ends.iter().zip([50.0, 100.0, 9.95, 30.05]);
        assert!(
            pairs.all(|(end, expected)| (end - expected).abs() < 1e-9),
            "{view:?}"
        );
    }
}
