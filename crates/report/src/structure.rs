//! Figures of the structure of the sample, from frames of the latter half: between walls profiles
//! across the height, distribution of forces, fabric, pair correlation. Disks and spheres.

use std::f64::consts::PI;

use gshear_analysis::moments::extent;
use gshear_dem::failure::Result;
use gshear_dem::state::{Frame, body, length};
use gshear_store::csv_table::Table;
use gshear_store::run_reader::{RunFile, RunStage};

use super::ReportFigure;
use super::curves::{self, Abscissa};
use super::plot::Layout;

const LAYOUT: Layout = Layout::new([900.0, 360.0], 84.0);
/// Most frames that are read, and grains in all of them.
const MOST_FRAMES: usize = 24;
const MOST_GRAINS: usize = 400_000;
/// Layers across the height.
const LAYERS: usize = 40;
/// Width of the bins of a force over its mean, and their number.
const FORCE_BIN: f64 = 0.25;
const FORCE_BINS: usize = 32;
/// Bins of the angle of a contact, over 180°.
const ANGLES: usize = 36;
/// Bins of g(r) per mean diameter, and its greatest distance in mean diameters.
const BINS_PER_DIAMETER: usize = 20;
const FARTHEST: f64 = 4.0;
/// Most grains in a frame around which pairs are counted.
const MOST_CENTRES: usize = 1000;

/// A contact between free grains.
struct FreeContact {
    /// F_n and |F_t| (N, in 2D N/m).
    forces: [f64; 2],
    /// Number of the bin of its angle.
    angle: usize,
}

/// Sums over frames.
struct Sums<'a> {
    run: &'a RunFile,
    axes: usize,
    /// Whether it is between walls, not in a periodic box.
    walls: bool,
    frames: usize,
    /// Lower and upper end of the layers along the last axis (m).
    ends: [f64; 2],
    /// Share of each layer that grains fill, and times their velocity along x (m/s), summed over
    /// the frames.
    layers: Vec<[f64; 2]>,
    /// Contacts between free grains.
    contacts: Vec<FreeContact>,
    pairs: Vec<f64>,
    /// Σ n_x n_x, n_x n_z, n_z n_z of the contacts (y for z in 2D).
    fabric: [f64; 3],
    mean_diameter: f64,
    farthest: f64,
}

/// Draws the structure; nothing without frames. Adds the fabric to the facts of the page.
///
/// # Errors
/// A damaged file.
pub fn figures(
    run: &RunFile,
    facts: &mut Vec<(&'static str, String)>,
) -> Result<Vec<ReportFigure>> {
    let frames = chosen(run);
    let Some(&first) = frames.first() else {
        return Ok(Vec::new());
    };
    let axes = run.dimension().axes();
    let radius = &run.grains().radius;
    let start = run.frame(first)?;
    let grains = start.grains.iter().zip(radius);
    let present = grains.filter(|(grain, _)| grain.removed == 0);
    let ends = extent(present.flat_map(|(grain, r)| {
        let z = grain.position[axes - 1];
        [z - r, z + r]
    }));
    let mean_diameter = 2.0 * run.grains().mean_radius();
    let (walls, shears) = (run.boundary().has_walls(), run.stage() == RunStage::Shear);
    let heights = frames.iter().map(|&t| run.box_edges(t)[axes - 1][axes - 1]);
    let mean_height = heights.sum::<f64>() / frames.len() as f64;
    let ends = if walls { ends } else { [0.0, mean_height] };
    let across = if walls { 0.25 } else { 0.45 } * (ends[1] - ends[0]);
    let [x, y] = run.periods();
    let farthest = (FARTHEST * mean_diameter).min(across).min(0.5 * x.min(y));
    let bins = (farthest / mean_diameter * BINS_PER_DIAMETER as f64) as usize;
    let mut sums = Sums {
        run,
        axes,
        walls,
        frames: frames.len(),
        ends,
        layers: vec![[0.0; 2]; LAYERS],
        contacts: Vec::new(),
        pairs: vec![0.0; bins],
        fabric: [0.0; 3],
        mean_diameter,
        farthest,
    };
    for &t in &frames {
        let frame = run.frame(t)?;
        if shears {
            sums.profile(t, &frame);
        }
        sums.contacts(&frame);
        sums.pairs_of(t, &frame);
    }
    let frames = match frames.len() {
        1 => "One of the frames of the latter half".into(),
        many => format!("Mean of {many} frames of the latter half"),
    };
    let trace = sums.fabric[0] + sums.fabric[2];
    let [xx, xz, zz] = sums.fabric.map(|sum| sum / trace);
    if xx.is_finite() {
        let difference = ((xx - zz).powi(2) + 4.0 * xz * xz).sqrt();
        let angle = (0.5 * (2.0 * xz).atan2(xx - zz)).to_degrees();
        let name = "Fabric in the plane of x and the height: difference of the principal values of ⟨n⊗n⟩, direction of the greater";
        facts.push((name, format!("{difference:.4}, {angle:.1}° from x")));
    }
    let mut figures = Vec::new();
    if shears {
        figures.extend(sums.profiles(&frames));
    }
    figures.extend([
        sums.distribution(&frames),
        sums.fabric(&frames),
        sums.correlation(&frames),
    ]);
    Ok(figures.into_iter().flatten().collect())
}

/// Evenly spread frames of the latter half.
fn chosen(run: &RunFile) -> Vec<usize> {
    let frames = run.frames();
    let all = frames - frames / 2;
    let most = (MOST_GRAINS / run.grains().count().max(1)).clamp(1, MOST_FRAMES);
    let many = all.min(most);
    (1..=many)
        .map(|k| frames / 2 + k * all / many - 1)
        .collect()
}

impl Sums<'_> {
    fn base(&self) -> f64 {
        let [x, y] = self.run.periods();
        if self.axes == 2 { x } else { x * y }
    }

    fn layer_height(&self) -> f64 {
        (self.ends[1] - self.ends[0]) / LAYERS as f64
    }

    /// Adds a frame to the layers, those of a cell without walls by the height that it has. What of
    /// a grain is beyond an edge of this is that of its image, whose velocity differs.
    fn profile(&mut self, t: usize, frame: &Frame) {
        let (bottom, axes, base) = (self.ends[0], self.axes, self.base());
        let height = if self.walls {
            self.layer_height()
        } else {
            self.run.box_edges(t)[axes - 1][axes - 1] / LAYERS as f64
        };
        let grains = frame.grains.iter().zip(&self.run.grains().radius);
        for (grain, &r) in grains.filter(|(grain, _)| grain.removed == 0) {
            let z = grain.position[axes - 1] - bottom;
            let [first, last] =
                [z - r, z + r].map(|z| ((z / height).floor().max(0.0) as usize).min(LAYERS - 1));
            for k in first..=last {
                let [low, high] = [k as f64 * height - z, (k + 1) as f64 * height - z];
                let volume = below(high, r, axes) - below(low, r, axes);
                let share = volume / (base * height);
                self.layers[k][0] += share;
                self.layers[k][1] += share * grain.velocity[0];
            }
        }
    }

    fn is_free(&self, id: u32) -> bool {
        u32::from(self.run.grains().body[id as usize]) == body::FREE
    }

    /// Adds the contacts between free grains.
    fn contacts(&mut self, frame: &Frame) {
        for contact in &frame.contacts {
            if !(self.is_free(contact.i) && self.is_free(contact.j)) {
                continue;
            }
            let tangential = contact.tangential_force.iter().map(|f| f * f).sum::<f64>();
            let r = frame.separation(contact.j, contact.i);
            let distance = length(r);
            let [x, z] = [r[0] / distance, r[self.axes - 1] / distance];
            let turned = z.atan2(x).rem_euclid(PI) / PI * ANGLES as f64;
            self.contacts.push(FreeContact {
                forces: [contact.normal_force, tangential.sqrt()],
                angle: (turned as usize).min(ANGLES - 1),
            });
            for (sum, part) in self.fabric.iter_mut().zip([x * x, x * z, z * z]) {
                *sum += part;
            }
        }
    }

    fn pairs_of(&mut self, t: usize, frame: &Frame) {
        let axes = self.axes;
        let ids = 0..frame.grains.len() as u32;
        let free: Vec<u32> = ids
            .filter(|id| self.is_free(*id) && !frame.is_removed(*id as usize))
            .collect();
        let heights = free
            .iter()
            .map(|id| frame.grains[*id as usize].position[axes - 1]);
        let [low, high] = extent(heights.clone());
        let inner = (low + self.farthest, high - self.farthest);
        let centres: Vec<u32> = (free.iter().copied().zip(heights))
            .filter(|(_, z)| !self.walls || *z > inner.0 && *z < inner.1)
            .map(|(id, _)| id)
            .collect();
        let every = centres.len().div_ceil(MOST_CENTRES).max(1);
        let volume = if self.walls {
            self.base() * (high - low)
        } else {
            let edges = self.run.box_edges(t);
            (0..axes).map(|axis| edges[axis][axis]).product()
        };
        let density = free.len() as f64 / volume;
        let width = self.mean_diameter / BINS_PER_DIAMETER as f64;
        let centres: Vec<u32> = centres.into_iter().step_by(every).collect();
        let scale = 1.0 / (centres.len() as f64 * density * self.frames as f64);
        for a in &centres {
            for b in &free {
                let distance = length(frame.separation(*b, *a));
                let bin = (distance / width) as usize;
                if bin < self.pairs.len() && distance > 0.0 {
                    let [inside, outside] = [bin, bin + 1].map(|k| match axes {
                        2 => PI * (k as f64 * width).powi(2),
                        _ => 4.0 / 3.0 * PI * (k as f64 * width).powi(3),
                    });
                    self.pairs[bin] += scale / (outside - inside);
                }
            }
        }
    }

    /// Velocity and solid fraction over the height.
    fn profiles(&self, frames: &str) -> [Option<ReportFigure>; 2] {
        let outermost = if self.walls {
            "belong to the walls"
        } else {
            "lack what crosses an edge of the cell"
        };
        let across = "across the height, in layers";
        let moving = format!("{frames}: velocity along the direction of shear {across}.");
        let filled = format!("{frames}: solid fraction {across}; the outermost {outermost}.");
        let heights = (0..LAYERS)
            .map(|k| (k as f64 + 0.5) * self.layer_height() / self.mean_diameter)
            .collect();
        let heights = Places {
            column: "height_over_mean_diameter",
            label: "height over d̄",
            values: heights,
        };
        let layers = self.layers.iter();
        let velocities: Vec<f64> = layers.clone().map(|[share, moved]| moved / share).collect();
        let fractions: Vec<f64> = layers
            .map(|[share, _]| share / self.frames as f64)
            .collect();
        let (velocity, fraction) = ("velocity (m/s)", "solid fraction");
        let velocities = [("velocity_x", "velocity", &velocities[..])];
        let fractions = [("solid_fraction", fraction, &fractions[..])];
        [
            heights.drawn("velocity-profile", moving, velocity, &velocities),
            heights.drawn("fraction-profile", filled, fraction, &fractions),
        ]
    }

    /// Mean normal force of the contacts of all frames together: a frame in which it is near zero,
    /// as under attraction, does not outweigh the others.
    fn mean_force(&self) -> f64 {
        let normal = self.contacts.iter().map(|contact| contact.forces[0]);
        normal.sum::<f64>() / self.contacts.len() as f64
    }

    fn distribution(&self, frames: &str) -> Option<ReportFigure> {
        let (all, mean) = (self.contacts.len() as f64, self.mean_force());
        let [normal, tangential] = [0, 1].map(|part| -> Vec<f64> {
            let mut counts = [0_u32; FORCE_BINS];
            for contact in &self.contacts {
                let bin = (contact.forces[part] / mean / FORCE_BIN).floor();
                // A contact that attraction holds has no place among them.
                if (0.0..FORCE_BINS as f64).contains(&bin) {
                    counts[bin as usize] += 1;
                }
            }
            let density = counts.iter().map(|n| f64::from(*n) / (all * FORCE_BIN));
            density.map(f64::log10).collect()
        });
        let forces = Places {
            column: "force_over_mean",
            label: "F/⟨F_{n}⟩",
            values: (0..FORCE_BINS)
                .map(|k| (k as f64 + 0.5) * FORCE_BIN)
                .collect(),
        };
        let caption = format!(
            "{frames}: probability density of the forces between free grains, over the mean normal force."
        );
        forces.drawn(
            "force-distribution",
            caption,
            "log_{10} probability density",
            &[
                ("log10_density_normal", "F_{n}", &normal),
                ("log10_density_tangential", "|F_{t}|", &tangential),
            ],
        )
    }

    fn fabric(&self, frames: &str) -> Option<ReportFigure> {
        let (all, mean) = (self.contacts.len() as f64, self.mean_force());
        // Number of contacts and sum of F_n over its mean, by the angle.
        let mut angles = vec![[0.0; 2]; ANGLES];
        for contact in &self.contacts {
            let [count, sum] = &mut angles[contact.angle];
            *count += 1.0;
            *sum += contact.forces[0] / mean;
        }
        let density: Vec<f64> = (angles.iter())
            .map(|[count, _]| count / all * ANGLES as f64)
            .collect();
        let force: Vec<f64> = angles.iter().map(|[n, sum]| sum / n).collect();
        let angles = Places {
            column: "angle",
            label: "angle of the contact (°)",
            values: (0..ANGLES)
                .map(|k| (k as f64 + 0.5) * 180.0 / ANGLES as f64)
                .collect(),
        };
        let caption = format!(
            "{frames}: contacts between free grains by the angle of their normal in the plane of x (0°, the direction of shear) and the height (90°)."
        );
        let number = "number of contacts over that of an isotropic fabric";
        let mean = "their mean F_{n} over the mean of all";
        angles.drawn(
            "fabric",
            caption,
            "relative to the mean",
            &[("density", number, &density), ("mean_force", mean, &force)],
        )
    }

    fn correlation(&self, frames: &str) -> Option<ReportFigure> {
        // No grain is far enough from the walls.
        if self.pairs.iter().all(|g| *g == 0.0) {
            return None;
        }
        let distances = Places {
            column: "distance_over_mean_diameter",
            label: "r/d̄",
            values: (0..self.pairs.len())
                .map(|k| (k as f64 + 0.5) / BINS_PER_DIAMETER as f64)
                .collect(),
        };
        let caption = format!(
            "{frames}: pair correlation g(r) of the free grains; between walls around those far from them."
        );
        distances.drawn(
            "pair-correlation",
            caption,
            "g(r)",
            &[("g", "g(r)", &self.pairs)],
        )
    }
}

/// Volume (area in 2D) of a grain of radius r below the height z over its centre.
fn below(z: f64, r: f64, axes: usize) -> f64 {
    let z = z.clamp(-r, r);
    match axes {
        2 => z * (r * r - z * z).max(0.0).sqrt() + r * r * ((z / r).asin() + 0.5 * PI),
        _ => PI / 3.0 * (z + r).powi(2) * (2.0 * r - z),
    }
}

/// Places that curves have in common.
struct Places {
    /// Name of the column of the data.
    column: &'static str,
    /// At the axis.
    label: &'static str,
    values: Vec<f64>,
}

impl Places {
    /// Draws curves over the places, each with its column, its name and its values; `None` if no
    /// curve has two points.
    fn drawn(
        &self,
        name: &'static str,
        caption: String,
        y_label: &str,
        lines: &[(&'static str, &str, &[f64])],
    ) -> Option<ReportFigure> {
        let places = &self.values;
        let curves: Vec<_> = (lines.iter())
            .map(|(_, name, values)| (*name, *values))
            .collect();
        let x = Abscissa {
            label: self.label,
            values: places,
        };
        let svg = curves::lines(LAYOUT, x, y_label, &curves)?;
        let data = Table::of(0..places.len())
            .column(self.column, |k| places[*k])
            .columns(lines.iter().map(|line| line.0), |&k| {
                lines.iter().map(move |line| line.2[k])
            })
            .csv();
        Some(ReportFigure::new(name, caption, svg, data))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grain_is_the_sum_of_its_slices() {
        for (axes, whole) in [(2, PI * 4.0), (3, PI * 32.0 / 3.0)] {
            assert!((below(2.0, 2.0, axes) - whole).abs() < 1e-14 * whole);
            assert!((below(0.0, 2.0, axes) - 0.5 * whole).abs() < 1e-14 * whole);
            assert_eq!(below(-3.0, 2.0, axes), 0.0);
        }
    }
}
