//! `stages`: the stages of the largest drop of τ, and grains and contacts at steps around it.

use std::path::PathBuf;

use super::correlate::GrainReduction;
use super::replay::{self, Rows};
use crate::printer::Printer;
use crate::results::{Results, vector_columns};
use crate::scalars::FrameSeries;
use gshear_analysis::displacement::{self, tension};
use gshear_analysis::drop_stages::Stages;
use gshear_analysis::forces;
use gshear_analysis::frame_scalars::{ScalarScratch, Stressed, frame_scalars};
use gshear_analysis::interval::Interval;
use gshear_analysis::phases;
use gshear_analysis::regions::Reduction;
use gshear_dem::failure::Result;
use gshear_dem::state::{Frame, GrainConstants};
use gshear_scene::Dimensions;
use gshear_store::csv_table::Table;
use gshear_store::run_reader::{FrameFields, RunFile};

/// Share of the grains with a defined D²min that are marked as the greatest.
const TOP: f64 = 0.01;
/// Radius, in mean diameters, of the region whose direction of tension is determined.
const REGION: f64 = 5.0;

/// Write the stages of the largest drop of τ, and grains and contacts at steps around it (Lee &
/// Hurley, section 3.2)
///
/// stages.csv: Stages I, II and III, and the large slips in Stage II. stages-steps.csv,
/// stages-grains.csv and stages-contacts.csv: up to 18 intervals around the drop, with the
/// direction of tension, D²min, the grains of the greatest reduction of force, non-affine
/// displacements, and the changes of the contact forces; they need a frame at both ends of these
/// intervals. Missing frames are replayed into the folder replay if checkpoints were kept
/// (output.keep_checkpoints). Phases are those of τ at the frames.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder that holds one
    pub run: PathBuf,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Shear strain at which the stick-slip regime begins
    #[arg(long, value_name = "STRAIN", default_value_t = 0.0, value_parser = super::strain)]
    from: f64,
    /// Reduction of force of a grain, by which the grains of GR regions are chosen
    #[arg(long, value_enum, default_value_t = GrainReduction::Net)]
    reduction: GrainReduction,
}

/// An interval around the drop.
struct MapStep {
    /// Number of the step, from 1 on.
    number: usize,
    stage: &'static str,
    /// Time steps at its start and end.
    steps: [u64; 2],
    /// γ at its start and end.
    strain: [f64; 2],
    /// Frame at its end.
    frame: Frame,
    /// [contacts of `frame`] Differential force network (N/m).
    force_change: Vec<f64>,
    /// Ids of the grains of the greatest reduction of force, ascending.
    regions: Vec<u32>,
    /// `[N]` D²min (m²); NaN where undefined.
    dmin: Vec<f64>,
    /// `[N]` Non-affine displacement (m).
    displacement: Vec<[f64; 3]>,
}

impl Arguments {
    /// `threads`: of a replay.
    ///
    /// # Errors
    /// An unfit or damaged run, a run without a slip, a replay that differs, a file that cannot be
    /// written.
    pub fn run(&self, threads: usize, printer: &mut Printer) -> Result<()> {
        let run = &RunFile::open_between_walls(&self.run)?;
        let results = Results::of(self.out.as_deref(), run.folder());
        let series = FrameSeries::of(run)?;
        let first = phases::onset(&series.strain, self.from);
        let (step, strain) = (&series.step[first..], &series.strain[first..]);
        let tau = &series.tau[first..];
        let phases = phases::find(strain, tau);
        if series.strain.len() < 2 {
            let frames = series.strain.len();
            return Err(run.wrong(format!("has {frames} frames; give a run with two or more")));
        }
        let Some(largest) = phases::largest_drop(&phases) else {
            return Err(run.wrong(format!(
                "τ never decreases from γ = {} on, so there is no drop; give a lesser --from",
                self.from
            )));
        };
        let stages = Stages::around(&phases, largest, tau);
        let rows = shown(&stages);
        let regime = RegimeRows {
            step,
            strain,
            reduction: self.reduction.into(),
        };
        let mut steps = regime.map_steps(run, &rows)?;
        if steps.is_empty() && replay::can(run) {
            let series = run.series();
            let ends = [stages.begin, stages.end].map(|row| {
                let known = series.step.binary_search(&step[row]);
                known.map_or(f64::NAN, |k| series.time[k])
            });
            let out = results.place("replay")?;
            let replayed = replay::window(run, Rows::Time(ends), None, threads, &out)?;
            steps = regime.map_steps(&replayed.run, &rows)?;
        }
        let grains = run.grains();
        let mut tables = vec![("stages.csv", of_stages(&stages, step, strain))];
        if !steps.is_empty() {
            let maps = MapTables {
                grains,
                dimension: run.dimension(),
                steps: &steps,
            };
            tables.push(("stages-steps.csv", maps.of_steps()));
            tables.push(("stages-grains.csv", maps.of_grains()));
            tables.push(("stages-contacts.csv", maps.of_contacts()));
        }
        let axes = run.dimension().axes();
        (tables.iter()).try_for_each(|(name, csv)| results.table_in(axes, name, csv, printer))
    }
}

/// Stages and rows of the intervals that are shown: 3 of Stage I, up to 6 of the largest slip in
/// Stage II (the first three are consecutive), up to 6 of the rest of Stage II, and 3 of Stage III.
fn shown(stages: &Stages) -> Vec<(&'static str, usize)> {
    let [before, drop, after] = stages.intervals();
    let first_end = stages.drops[0][1];
    let parts = [
        ("I", before, 3, 0),
        ("II", *drop.start()..=first_end, 6, 3),
        ("II", first_end + 1..=*drop.end(), 6, 0),
        ("III", after, 3, 0),
    ];
    let mut shown = Vec::new();
    for (stage, rows, most, dense) in parts {
        let rows: Vec<usize> = rows.collect();
        let chosen = spread(rows.len(), most, dense).into_iter();
        shown.extend(chosen.map(|k| (stage, rows[k])));
    }
    shown
}

/// Up to `most` indices of 0 … count-1: the first `dense`, then evenly spaced up to the last.
fn spread(count: usize, most: usize, dense: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    let rest = most - dense;
    let even = (1..=rest).map(|k| {
        let (from, share) = match dense {
            0 => (0.0, (k - 1) as f64 / (rest - 1) as f64),
            _ => (dense as f64 - 1.0, k as f64 / rest as f64),
        };
        (from + share * ((count - 1) as f64 - from)).round() as usize
    });
    (0..dense).chain(even).collect()
}

/// The rows of the stick-slip regime.
struct RegimeRows<'a> {
    /// `[L]` Time steps.
    step: &'a [u64],
    /// `[L]` γ.
    strain: &'a [f64],
    /// By which the grains of GR regions are chosen.
    reduction: Reduction,
}

impl RegimeRows<'_> {
    /// The intervals that end in these rows, from the frames of a run; none if a frame is missing.
    /// `rows`: stage and row.
    fn map_steps(&self, run: &RunFile, rows: &[(&'static str, usize)]) -> Result<Vec<MapStep>> {
        let (step, strain) = (self.step, self.strain);
        let mut steps = Vec::new();
        let mut scratch = ScalarScratch::default();
        for &(stage, row) in rows {
            let frames = [row - 1, row].map(|row| run.frame_steps().binary_search(&step[row]));
            let [Ok(earlier), Ok(later)] = frames else {
                return Ok(Vec::new());
            };
            let (earlier, later) = (stressed(run, earlier)?, stressed(run, later)?);
            frame_scalars(run.grains(), &earlier, &later, &mut scratch);
            let (rattlers, mut field) = (scratch.non_affine.rattlers(), Vec::new());
            let interval = Interval::between_walls([&earlier.frame, &later.frame]);
            displacement::non_affine(&interval, rattlers, &mut field);
            steps.push(MapStep {
                number: steps.len() + 1,
                stage,
                steps: [step[row - 1], step[row]],
                strain: [strain[row - 1], strain[row]],
                force_change: scratch.regions.changes().to_vec(),
                regions: scratch.regions.grains(self.reduction).to_vec(),
                dmin: scratch.dmin.clone(),
                displacement: field,
                frame: later.frame,
            });
        }
        Ok(steps)
    }
}

/// Reads frame t, as far as its scalars need it.
fn stressed(run: &RunFile, t: usize) -> Result<Stressed> {
    let frame = run
        .records_with(t..t + 1, FrameFields::Forces)?
        .swap_remove(0);
    Ok(Stressed::new(run.grains(), frame))
}

impl MapStep {
    /// Ids of the grains with a defined D²min, the greatest first.
    fn by_dmin(&self) -> Vec<usize> {
        let defined = (0..self.dmin.len()).filter(|n| self.dmin[*n].is_finite());
        let mut order: Vec<usize> = defined.collect();
        order.sort_by(|a, b| self.dmin[*b].total_cmp(&self.dmin[*a]));
        order
    }

    /// Ids of the grains with the greatest D²min: 1 % of those with a defined value, rounded and at
    /// least one.
    fn top(&self) -> Vec<usize> {
        let mut order = self.by_dmin();
        let count = (TOP * order.len() as f64).round() as usize;
        order.truncate(count.max(1));
        order
    }

    /// The centre of a grain (m); NaN if it was removed.
    fn centre(&self, grain: usize) -> [f64; 3] {
        self.frame.position(grain)
    }

    /// Place of the greatest D²min, and the direction of tension around it; NaN where undefined.
    fn tension(&self, grains: &GrainConstants) -> [[f64; 3]; 2] {
        let Some(&greatest) = self.by_dmin().first() else {
            return [[f64::NAN; 3]; 2];
        };
        let centre = self.centre(greatest);
        let radius = REGION * 2.0 * grains.mean_radius();
        let along = tension(
            &self.frame,
            &self.displacement,
            |n| self.dmin[n].is_nan(),
            centre,
            radius,
        );
        [centre, along.unwrap_or([f64::NAN; 3])]
    }
}

/// Returns one line per stage, then one per large slip in Stage II, the largest first.
fn of_stages(stages: &Stages, step: &[u64], strain: &[f64]) -> String {
    let named = [
        ("I", [stages.begin, stages.drop]),
        ("II", [stages.drop, stages.calm]),
        ("III", [stages.calm, stages.end]),
    ];
    let slips = stages.drops.iter().map(|rows| ("slip", *rows));
    Table::of(named.into_iter().chain(slips))
        .column("stage", |(stage, _)| *stage)
        .columns(["start_step", "end_step"], |(_, rows)| {
            rows.map(|row| step[row])
        })
        .columns(["start_strain", "end_strain"], |(_, rows)| {
            rows.map(|row| strain[row])
        })
        .csv()
}

/// The tables of the intervals around the drop; lengths in m, D²min in m², forces in N, of disks in
/// N/m.
struct MapTables<'a> {
    grains: &'a GrainConstants,
    dimension: Dimensions,
    steps: &'a [MapStep],
}

impl MapTables<'_> {
    /// The components of a vector that the grains have.
    fn components(&self, vector: [f64; 3]) -> impl Iterator<Item = f64> + use<> {
        vector.into_iter().take(self.dimension.axes())
    }

    /// Returns one line per step.
    fn of_steps(&self) -> String {
        let places = vector_columns("", "", self.dimension);
        let directions = vector_columns("tension_", "", self.dimension);
        Table::of(self.steps)
            .column("step", |step| step.number)
            .column("stage", |step| step.stage)
            .columns(["start_step", "end_step"], |step| step.steps)
            .columns(["start_strain", "end_strain"], |step| step.strain)
            .columns([places, directions].concat(), |step| {
                let vectors = step.tension(self.grains).into_iter();
                vectors.flat_map(|vector| self.components(vector))
            })
            .csv()
    }

    /// Returns one line per grain and step.
    fn of_grains(&self) -> String {
        let grains = self.grains;
        let rows = self.steps.iter().flat_map(|step| {
            let top = step.top();
            (0..grains.count()).map(move |n| (step, n, top.contains(&n)))
        });
        Table::of(rows)
            .column("step", |(step, ..)| step.number)
            .column("stage", |(step, ..)| step.stage)
            .columns(["start_strain", "end_strain"], |(step, ..)| step.strain)
            .column("grain", |(_, n, _)| *n)
            .column("body", |(_, n, _)| grains.body[*n])
            .columns(vector_columns("", "", self.dimension), |(step, n, _)| {
                self.components(step.centre(*n))
            })
            .column("radius", |(_, n, _)| grains.radius[*n])
            .column("in_gr_region", |(step, n, _)| {
                u8::from(step.regions.binary_search(&(*n as u32)).is_ok())
            })
            .column("dmin", |(step, n, _)| step.dmin[*n])
            .column("greatest_dmin", |(.., is_top)| u8::from(*is_top))
            .columns(vector_columns("u_", "", self.dimension), |(step, n, _)| {
                self.components(step.displacement[*n])
            })
            .csv()
    }

    /// Returns one line per contact and step.
    fn of_contacts(&self) -> String {
        let rows = self.steps.iter().flat_map(|step| {
            let contacts = step.frame.contacts.iter().zip(&step.force_change);
            contacts.map(move |(contact, change)| (step, contact, *change))
        });
        let [of_i, of_j] = ["_i", "_j"].map(|end| vector_columns("", end, self.dimension));
        Table::of(rows)
            .column("step", |(step, ..)| step.number)
            .column("stage", |(step, ..)| step.stage)
            .column("end_strain", |(step, ..)| step.strain[1])
            .column("i", |(_, contact, _)| contact.i)
            .column("j", |(_, contact, _)| contact.j)
            .columns([of_i, of_j].concat(), |(step, contact, _)| {
                let from = step.centre(contact.i as usize);
                let separation = step.frame.separation(contact.i, contact.j);
                let to = std::array::from_fn(|axis| from[axis] + separation[axis]);
                self.components(from).chain(self.components(to))
            })
            .column("force", |(_, contact, _)| forces::size(contact))
            .column("force_change", |(.., change)| *change)
            .csv()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_spread_from_the_first_to_the_last() {
        assert_eq!(spread(4, 6, 3), [0, 1, 2, 3]);
        assert_eq!(spread(11, 3, 0), [0, 5, 10]);
        assert_eq!(spread(12, 6, 3), [0, 1, 2, 5, 8, 11]);
        assert_eq!(spread(0, 3, 0), [0; 0]);
    }
}
