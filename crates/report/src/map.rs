//! Maps of a 2D sample: force network, change of forces, and D²min.

use plotters::style::RGBColor;

use super::colour::{CHANGE, FORCE, GRAIN, GREY, VIRIDIS, WALL, WHITE};
use super::plot::{Layout, Plot, figure};
use super::ticks::{self, Tick};
use gshear_analysis::forces;
use gshear_dem::state::{ContactSample, Disks, Frame};
use gshear_store::table::Table;

const WIDTH: f64 = 900.0;
const MARGIN: [f64; 4] = [72.0, 36.0, 104.0, 58.0];
/// Greatest height of the sample in a map (px).
const TALLEST: f64 = 900.0;
/// Greatest number of grains in a map; of larger samples only a part is shown, since browsers fail
/// on larger files.
pub const MOST_GRAINS: usize = 20_000;
/// Greatest number of decades of D²min on the colour bar.
const DECADES: f64 = 8.0;

/// The part of the sample that is shown (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapView {
    /// Range of x.
    pub x: [f64; 2],
    /// Range of y.
    pub y: [f64; 2],
}

impl MapView {
    /// Returns the whole sample, or the part around `centre` with about [`MOST_GRAINS`] grains if
    /// it has more.
    pub fn of(grains: &Disks, frame: &Frame, centre: [f64; 2]) -> Self {
        let reach = grains.radius.iter().copied().fold(0.0, f64::max);
        let heights = frame.position.iter().map(|r| r[1]);
        let low = heights.clone().fold(f64::INFINITY, f64::min) - reach;
        let high = heights.fold(f64::NEG_INFINITY, f64::max) + reach;
        let share = (MOST_GRAINS as f64 / grains.count() as f64).sqrt();
        if share >= 1.0 {
            return MapView {
                x: [0.0, grains.length],
                y: [low, high],
            };
        }
        let part = |centre: f64, low: f64, high: f64| {
            let half = 0.5 * share * (high - low);
            let centre = centre.clamp(low + half, high - half);
            [centre - half, centre + half]
        };
        MapView {
            x: part(centre[0], 0.0, grains.length),
            y: part(centre[1], low, high),
        }
    }

    fn layout(&self) -> Layout {
        let [left, top, right, bottom] = MARGIN;
        let ratio = (self.y[1] - self.y[0]) / (self.x[1] - self.x[0]);
        let width = (WIDTH - left - right).min(TALLEST / ratio);
        Layout {
            size: [
                (width + left + right).round(),
                (width * ratio + top + bottom).round(),
            ],
            margin: MARGIN,
        }
    }

    /// Returns the shifts by periods of the cell that bring something at x with half-width `reach`
    /// into view.
    pub(super) fn shifts(
        &self,
        x: f64,
        reach: f64,
        length: f64,
    ) -> impl Iterator<Item = f64> + use<> {
        let MapView { x: [low, high], .. } = *self;
        let seen = move |shift: &f64| x + shift + reach >= low && x + shift - reach <= high;
        [-length, 0.0, length].into_iter().filter(seen)
    }

    /// Returns whether something at height y with half-height `reach` is in view.
    pub(super) fn sees_height(&self, y: f64, reach: f64) -> bool {
        y + reach >= self.y[0] && y - reach <= self.y[1]
    }
}

/// A table of the contacts of a frame, with the centres of both grains (m) and F_n (N/m).
pub fn data_of_contacts(frame: &Frame) -> String {
    Table::of(&frame.contacts)
        .columns(["i", "j"], |contact| [contact.i, contact.j])
        .columns(["x_i", "y_i"], |contact| frame.position[contact.i as usize])
        .columns(["x_j", "y_j"], |contact| frame.position[contact.j as usize])
        .column("normal_force", |contact| contact.normal_force)
        .csv()
}

/// A table of the contacts of the later frame with the change of their force (N/m).
pub fn data_of_changes(earlier: &Frame, later: &Frame) -> String {
    let mut changes = Vec::new();
    forces::changes(earlier, later, &mut changes);
    Table::of(later.contacts.iter().zip(changes))
        .columns(["i", "j"], |(contact, _)| [contact.i, contact.j])
        .columns(["x_i", "y_i"], |(contact, _)| {
            later.position[contact.i as usize]
        })
        .columns(["x_j", "y_j"], |(contact, _)| {
            later.position[contact.j as usize]
        })
        .column("change", |(_, change)| *change)
        .csv()
}

/// A table of the grains: centre and radius (m), and D²min (m²).
pub fn data_of_grains(grains: &Disks, frame: &Frame, dmin: &[f64]) -> String {
    Table::of(0..grains.count())
        .column("id", |n| *n)
        .columns(["x", "y"], |n| frame.position[*n])
        .column("radius", |n| grains.radius[*n])
        .column("dmin", |n| dmin[*n])
        .csv()
}

/// Draws the normal forces of a frame as lines between the centres of touching grains, with width
/// and colour by F_n. `greatest`: F_n (N/m) at the end of the scale, so that two frames can share
/// one.
pub fn forces(grains: &Disks, frame: &Frame, view: MapView, greatest: f64, title: &str) -> String {
    let greatest = if greatest > 0.0 { greatest } else { 1.0 };
    map(view, |plot| {
        background(plot, grains, frame, view);
        let shares: Vec<f64> = frame
            .contacts
            .iter()
            .map(|c| c.normal_force / greatest)
            .collect();
        lines(plot, grains, frame, view, &shares, 0.0, |share| {
            FORCE.at(share)
        });
        let (factor, unit) = ticks::prefix(greatest);
        let ticks = ticks::on_bar(
            ticks::round(0.0, greatest * factor, 6),
            0.0,
            greatest * factor,
        );
        plot.clip();
        plot.colour_bar(
            &FORCE,
            &ticks,
            &format!("normal force F_{{n}}\u{a0}({unit}N/m)"),
        );
        plot.title(title);
    })
}

/// Returns the F_n (N/m) that 99.9 % of the contacts stay below. With the maximum as the end of the
/// scale, most contacts would look alike.
pub fn scale_of_forces(frames: [&Frame; 2]) -> f64 {
    let mut forces: Vec<f64> = frames
        .iter()
        .flat_map(|f| &f.contacts)
        .map(|c| c.normal_force)
        .collect();
    forces.sort_by(f64::total_cmp);
    forces
        .get((forces.len() * 999) / 1000)
        .copied()
        .unwrap_or(0.0)
}

/// Draws the differential force network between two frames at the positions of the later one.
pub fn force_changes(
    grains: &Disks,
    earlier: &Frame,
    later: &Frame,
    view: MapView,
    title: &str,
) -> String {
    let mut changes = Vec::new();
    forces::changes(earlier, later, &mut changes);
    let greatest = changes
        .iter()
        .fold(0.0, |most: f64, change| most.max(change.abs()));
    let greatest = if greatest > 0.0 { greatest } else { 1.0 };
    for change in &mut changes {
        *change /= greatest;
    }
    map(view, |plot| {
        background(plot, grains, later, view);
        lines(plot, grains, later, view, &changes, 0.0, |share| {
            CHANGE.at(0.5 + 0.5 * share)
        });
        let (factor, unit) = ticks::prefix(greatest);
        let end = greatest * factor;
        plot.clip();
        plot.colour_bar(
            &CHANGE,
            &ticks::on_bar(ticks::round(-end, end, 6), -end, end),
            &format!("change of |f| ({unit}N/m)"),
        );
        plot.title(title);
    })
}

/// Draws D²min/r̄² of the grains of a frame on a logarithmic scale; `dmin` is `[N]` (m²). Grains
/// without a defined value are white.
pub fn dmin(grains: &Disks, frame: &Frame, dmin: &[f64], view: MapView, title: &str) -> String {
    let square = grains.mean_radius().powi(2);
    let level = |value: f64| (value / square).log10();
    let mut levels: Vec<f64> = dmin
        .iter()
        .map(|value| level(*value))
        .filter(|level| level.is_finite())
        .collect();
    levels.sort_by(f64::total_cmp);
    let high = levels.last().copied().unwrap_or(0.0);
    let low = levels.get(levels.len() / 50).copied().unwrap_or(-1.0);
    let low = low.clamp(high - DECADES, high - 1.0);
    map(view, |plot| {
        let scale = plot.scale();
        for (n, value) in dmin.iter().enumerate() {
            let value = level(*value);
            let (fill, outline) = if value.is_nan() {
                (WHITE, GREY)
            } else {
                let colour = VIRIDIS.at((value - low) / (high - low));
                (colour, if grains.body[n] == 0 { colour } else { GREY })
            };
            disk(plot, grains, frame, view, n, |plot, centre, radius| {
                plot.disk(centre, radius * scale, fill, Some(outline));
            });
        }
        plot.clip();
        let ticks = ticks::on_bar(ticks::decades(low, high, 8), low, high);
        plot.colour_bar(&VIRIDIS, &ticks, "D²_{min}/r̄²");
        plot.title(title);
    })
}

/// Axes in metres with an SI prefix around what `draw` draws; `draw` must clip.
fn map(view: MapView, draw: impl FnOnce(&mut Plot)) -> String {
    let (factor, unit) = ticks::prefix(view.x[1] - view.x[0]);
    figure(view.layout(), view.x, view.y, |plot| {
        draw(plot);
        let scaled = |[low, high]: [f64; 2], wanted: usize| -> Vec<Tick> {
            let ticks = ticks::round(low * factor, high * factor, wanted);
            ticks
                .into_iter()
                .map(|(value, label)| (value / factor, label))
                .collect()
        };
        let ratio = (view.y[1] - view.y[0]) / (view.x[1] - view.x[0]);
        let (x, y) = (
            scaled(view.x, 8),
            scaled(view.y, (8.0 * ratio).clamp(2.0, 12.0) as usize),
        );
        plot.axes(&x, &y, &format!("x ({unit}m)"), &format!("y ({unit}m)"));
    })
}

fn background(plot: &mut Plot, grains: &Disks, frame: &Frame, view: MapView) {
    let scale = plot.scale();
    for n in 0..grains.count() {
        let fill = if grains.body[n] == 0 { GRAIN } else { WALL };
        disk(plot, grains, frame, view, n, |plot, centre, radius| {
            plot.disk(centre, radius * scale, fill, Some(WALL));
        });
    }
}

/// Calls `draw` for a grain and for its periodic images in view.
pub(super) fn disk(
    plot: &mut Plot,
    grains: &Disks,
    frame: &Frame,
    view: MapView,
    n: usize,
    mut draw: impl FnMut(&mut Plot, [f64; 2], f64),
) {
    let ([x, y], radius) = (frame.position[n], grains.radius[n]);
    if view.sees_height(y, radius) {
        view.shifts(x, radius, grains.length)
            .for_each(|shift| draw(plot, [x + shift, y], radius));
    }
}

/// Draws contacts as lines between centres. The share of a contact, -1 … 1, gives width and colour.
/// The strongest lie on top; contacts with a share below `faint` are left out.
pub(super) fn lines(
    plot: &mut Plot,
    grains: &Disks,
    frame: &Frame,
    view: MapView,
    shares: &[f64],
    faint: f64,
    colour: impl Fn(f64) -> RGBColor,
) {
    let widest = 1.1 * grains.mean_radius() * plot.scale();
    let mut sorted: Vec<(f64, &ContactSample)> = shares
        .iter()
        .map(|share| share.clamp(-1.0, 1.0))
        .zip(&frame.contacts)
        .filter(|(share, _)| share.abs() >= faint)
        .collect();
    sorted.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    for (share, contact) in sorted {
        let from = frame.position[contact.i as usize];
        // The nearest image keeps a contact across the periodic boundary short.
        let [x, y] = grains.separation(from, frame.position[contact.j as usize]);
        let width = (widest * share.abs()).max(0.3);
        if !view.sees_height(from[1] + 0.5 * y, 0.5 * y.abs()) {
            continue;
        }
        for shift in view.shifts(from[0] + 0.5 * x, 0.5 * x.abs(), grains.length) {
            let start = [from[0] + shift, from[1]];
            plot.line(&[start, [start[0] + x, start[1] + y]], colour(share), width);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact(i: u32, j: u32, normal_force: f64, tangential_force: f64) -> ContactSample {
        let zero: ContactSample = bytemuck::Zeroable::zeroed();
        ContactSample {
            i,
            j,
            normal_force,
            tangential_force: [tangential_force, 0.0, 0.0],
            ..zero
        }
    }

    #[test]
    fn a_contact_across_the_seam_is_drawn_at_both_ends_and_is_short() {
        let grains = Disks {
            radius: vec![1.0; 2],
            body: vec![0; 2],
            mass: vec![1.0; 2],
            length: 20.0,
        };
        let position = vec![[0.5, 5.0], [18.6, 5.0]];
        let frame = Frame {
            position,
            contacts: vec![contact(0, 1, 1.0, 0.0)],
            ..Frame::default()
        };
        let view = MapView {
            x: [0.0, 20.0],
            y: [0.0, 10.0],
        };
        let svg = forces(&grains, &frame, view, 1.0, "");
        let ends: Vec<Vec<f64>> = svg
            .lines()
            .filter(|line| line.starts_with("<polyline"))
            .map(|line| {
                line.split("points=\"")
                    .nth(1)
                    .and_then(|rest| rest.split('"').next())
                    .unwrap_or("")
            })
            .map(|points| {
                points
                    .split([',', ' '])
                    .filter_map(|number| number.parse().ok())
                    .collect()
            })
            .collect();
        let pixels = 10.0 * (WIDTH - MARGIN[0] - MARGIN[2]) / 20.0;
        let at = |x: f64| (10.0 * MARGIN[0] + x * pixels).round();
        let xs: Vec<[f64; 2]> = ends.iter().map(|e| [e[0], e[2]]).collect();
        assert_eq!(xs, [[at(0.5), at(-1.4)], [at(20.5), at(18.6)]]);
        // Only the disk at 0.5 extends across the periodic boundary.
        assert_eq!(
            svg.matches("stroke=\"none\" fill=\"#F3F4F6\"").count()
                + svg.matches("fill=\"#F3F4F6\" stroke=\"none\"").count(),
            3
        );
    }

    #[test]
    fn great_samples_are_shown_in_part() {
        let n = 4 * MOST_GRAINS;
        let grains = Disks {
            radius: vec![0.1; n],
            body: vec![0; n],
            mass: vec![1.0; n],
            length: 100.0,
        };
        let frame = Frame {
            position: (0..n)
                .map(|k| [0.0, 40.0 * k as f64 / (n - 1) as f64])
                .collect(),
            ..Frame::default()
        };
        let view = MapView::of(&grains, &frame, [99.0, 20.0]);
        assert!(
            (view.x[0] - 50.0).abs() < 1e-9 && (view.x[1] - 100.0).abs() < 1e-9,
            "{view:?}"
        );
        assert!(
            (view.y[0] - 9.95).abs() < 1e-9 && (view.y[1] - 30.05).abs() < 1e-9,
            "{view:?}"
        );
    }
}
