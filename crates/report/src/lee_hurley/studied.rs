//! A run with the statistics that the study needs.

use gshear_analysis::correlate::{Choices, Regime};
use gshear_analysis::frame_scalars::{FrameScalars, ScalarScratch, Stressed, frame_scalars};
use gshear_analysis::regions::Reduction;
use gshear_analysis::stages::Stages;
use gshear_analysis::{displacement, phases};
use gshear_dem::failure::Failure;
use gshear_dem::state::{Disks, Frame};
use gshear_scene::identity;
use gshear_store::run_reader::{FrameFields, RunFile};

/// The paper's sample that a run is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// About 1,000 disks (sections 3 and 4).
    Small,
    /// About 5,000 disks (section 5).
    Large,
}

impl Size {
    /// √(1,000 · 5,000), the geometric mean of the paper's two sizes.
    const BETWEEN: usize = 2236;

    /// Returns the size whose number of grains is nearer, on a logarithmic scale.
    pub fn of(grains: &Disks) -> Self {
        if grains.count() > Self::BETWEEN {
            Size::Large
        } else {
            Size::Small
        }
    }

    /// Returns the name in labels and file names.
    pub fn name(self) -> &'static str {
        match self {
            Size::Small => "small",
            Size::Large => "large",
        }
    }

    /// Returns γ at which the paper's stick-slip regime (section 3.2) or steady state (section 5)
    /// begins.
    pub fn onset(self) -> f64 {
        match self {
            Size::Small => 0.022,
            Size::Large => 0.054,
        }
    }
}

/// Stage of the largest drop (LH section 3.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DropStage {
    /// Stage I, before the drop.
    Before,
    /// Stage II up to the end of the largest slip.
    Drop,
    /// The rest of Stage II, with large slips that follow closely.
    FurtherDrop,
    /// Stage III, after the drop.
    After,
}

impl DropStage {
    /// Returns the Roman numeral of the stage.
    pub fn name(self) -> &'static str {
        match self {
            DropStage::Before => "I",
            DropStage::Drop | DropStage::FurtherDrop => "II",
            DropStage::After => "III",
        }
    }
}

/// Share of the grains with a defined D²min that are marked as the greatest.
const TOP: f64 = 0.01;

/// An interval around the drop that the maps show, with its results.
pub struct MapStep {
    /// Number of the step in the maps, from 1 on.
    pub number: usize,
    /// Stage of the drop.
    pub stage: DropStage,
    /// Row of the regime at the end of the interval.
    pub row: usize,
    /// γ at the start and the end of the interval.
    pub strain: [f64; 2],
    /// Frame at the end of the interval.
    pub frame: Frame,
    /// [contacts of `frame`] Differential force network (N/m).
    pub force_change: Vec<f64>,
    /// Ids of the grains of the greatest reduction of force, ascending.
    pub regions: Vec<u32>,
    /// `[N]` D²min (m²); NaN where undefined.
    pub dmin: Vec<f64>,
    /// `[N]` Non-affine displacement (m).
    pub displacement: Vec<[f64; 2]>,
}

impl MapStep {
    /// Returns the ids of the grains with the greatest D²min: 1 % of those with a defined value,
    /// rounded and at least one.
    pub fn top(&self) -> Vec<u32> {
        let dmin = &self.dmin;
        let mut defined: Vec<u32> = (0..dmin.len() as u32)
            .filter(|n| dmin[*n as usize].is_finite())
            .collect();
        let count = ((TOP * defined.len() as f64).round() as usize)
            .max(1)
            .min(defined.len());
        defined.sort_by(|a, b| dmin[*b as usize].total_cmp(&dmin[*a as usize]));
        defined.truncate(count);
        defined
    }
}

/// The largest drop of the regime.
pub struct Event {
    /// Its stages.
    pub stages: Stages,
    /// Intervals that the maps show; empty if the run has no frames there.
    pub steps: Vec<MapStep>,
}

/// A run with its statistics.
pub struct Studied {
    /// Label in figures and tables.
    pub label: String,
    /// Path of the run.
    pub path: String,
    /// The paper's sample that it is compared with.
    pub size: Size,
    /// μ_s of the scene; `None` if it has none.
    pub friction: Option<f64>,
    /// The grains.
    pub grains: Disks,
    /// The scene without seed and outputs: equal for runs that differ in their seeds only.
    pub family: String,
    /// Seed of the scene.
    pub seed: Option<i64>,
    /// Inertial number I of the run.
    pub inertial_number: Option<f64>,
    /// Stiffness number κ of the run.
    pub stiffness_number: Option<f64>,
    /// γ of the whole time series.
    pub strain: Vec<f64>,
    /// τ of the whole time series.
    pub tau: Vec<f64>,
    /// γ at which the regime begins.
    pub onset: f64,
    /// The stick-slip regime.
    pub regime: Regime,
    /// Time step of each row of the regime.
    pub step: Vec<u64>,
    /// The largest drop; `None` without a slip.
    pub event: Option<Event>,
    /// Choices of its statistics.
    pub choices: Choices,
}

/// Options of the study.
#[derive(Debug, Clone, Copy)]
pub struct StudyOptions {
    /// γ at which the regime begins. By default the paper's, or the first frame's if that is later
    /// or all frames end before the paper's.
    pub onset: Option<f64>,
    /// Choices of its statistics.
    pub choices: Choices,
}

impl Studied {
    /// Returns the label with subscripts marked for figures.
    pub fn typeset_label(&self) -> String {
        self.label.replace("μ_s", "μ_{s}")
    }

    /// Computes the statistics of a run. `step`, `strain`, `tau`, `scalars`: `[L]`, one row per
    /// frame or interval.
    ///
    /// # Errors
    /// If the run is damaged.
    pub fn of(
        run: &RunFile,
        label: String,
        choice: StudyOptions,
        [strain, tau]: [&[f64]; 2],
        step: &[u64],
        scalars: &[FrameScalars],
    ) -> Result<Self, Failure> {
        let size = Size::of(run.grains());
        let first = strain.first().copied().unwrap_or(0.0);
        let reached = strain.last().copied().unwrap_or(0.0);
        let wanted = choice.onset.unwrap_or(size.onset());
        let onset = if reached > wanted {
            wanted.max(first)
        } else {
            first
        };
        let regime = Regime::from(onset, strain, tau, scalars, choice.choices);
        let step = step[strain.len() - regime.strain.len()..].to_vec();
        let stages = stages(&regime);
        let event = stages.map(|stages| -> Result<Event, Failure> {
            let steps = steps(
                run,
                &regime,
                &stages,
                &step,
                choice.choices.regions.reduction,
            )?;
            Ok(Event { stages, steps })
        });
        let event = event.transpose()?;
        Ok(Studied {
            label,
            path: run.path().display().to_string(),
            size,
            friction: friction(run),
            family: family(run.scene(), run.grains().count()),
            seed: scene(run).and_then(|scene| scene.get("seed")?.as_integer()),
            grains: run.grains().clone(),
            // A protocol has another one in every part.
            inertial_number: run
                .number("inertial_number")
                .filter(|_| !run.has_protocol()),
            stiffness_number: run.number("stiffness_number"),
            strain: run.series().column("strain").to_vec(),
            tau: run.series().column("stress_ratio").to_vec(),
            onset,
            event,
            regime,
            step,
            choices: choice.choices,
        })
    }

    /// Returns the range of γ that the maps need, if the run has no frames there.
    pub fn missing(&self) -> Option<[f64; 2]> {
        let event = self.event.as_ref().filter(|e| e.steps.is_empty())?;
        let strain = |row: usize| self.regime.strain[row];
        Some([strain(event.stages.begin), strain(event.stages.end)])
    }

    /// Takes the frames for the maps from another run of the same grains.
    ///
    /// # Errors
    /// If that run is damaged.
    pub fn take_frames(&mut self, frames: &RunFile) -> Result<(), Failure> {
        if let Some(event) = &mut self.event {
            let reduction = self.choices.regions.reduction;
            event.steps = steps(frames, &self.regime, &event.stages, &self.step, reduction)?;
        }
        Ok(())
    }
}

/// Returns μ_s of the scene; `None` if it has none.
pub fn friction(run: &RunFile) -> Option<f64> {
    scene(run)?.get("contact")?.get("friction")?.as_float()
}

fn scene(run: &RunFile) -> Option<toml::Table> {
    run.scene().parse().ok()
}

/// What runs have in common that differ in their seeds only.
fn family(scene: &str, grains: usize) -> String {
    let others = ["seed", "title", "output", "analysis", "bookkeeping"];
    let mut family = format!("{grains} disks\n");
    for (path, value) in identity::values(scene) {
        let table = path.split('.').next().unwrap_or_default();
        if !others.contains(&table) {
            family += &format!("{path} = {value}\n");
        }
    }
    family
}

/// The stages around the largest drop; `None` without a slip.
fn stages(regime: &Regime) -> Option<Stages> {
    let phases: Vec<phases::Phase> = regime.phases.iter().map(|m| m.phase).collect();
    let largest = phases::largest_drop(&phases)?;
    Some(Stages::around(&phases, largest, &regime.tau))
}

/// The intervals that the maps show, from the run's frames; empty if a frame is missing. `step`:
/// time step of each row of the regime.
fn steps(
    run: &RunFile,
    regime: &Regime,
    stages: &Stages,
    step: &[u64],
    reduction: Reduction,
) -> Result<Vec<MapStep>, Failure> {
    let mut steps = Vec::new();
    let mut scratch = ScalarScratch::default();
    for (stage, row) in shown(stages) {
        let frames = [row - 1, row].map(|row| run.frame_steps().binary_search(&step[row]));
        let [Ok(earlier), Ok(later)] = frames else {
            // If a frame is missing, there are no maps at all.
            steps.clear();
            break;
        };
        let grains = run.grains();
        let read = |t: usize| {
            run.block_of(t..t + 1, FrameFields::Forces)
                .map(|mut frames| Stressed::new(grains, frames.swap_remove(0)))
        };
        let (earlier, later) = (read(earlier)?, read(later)?);
        frame_scalars(grains, &earlier, &later, &mut scratch);
        let (earlier, frame) = (earlier.frame, later.frame);
        let mut displacement = Vec::new();
        let rattlers = scratch.non_affine.rattlers();
        displacement::non_affine(grains, &earlier, &frame, rattlers, &mut displacement);
        steps.push(MapStep {
            number: steps.len() + 1,
            stage,
            row,
            strain: [regime.strain[row - 1], regime.strain[row]],
            force_change: scratch.regions.changes().to_vec(),
            regions: scratch.regions.grains(reduction).to_vec(),
            dmin: scratch.dmin.clone(),
            displacement,
            frame,
        });
    }
    Ok(steps)
}

/// Stages and rows of the intervals that the maps show: 3 of Stage I, up to 6 of each part of Stage
/// II (of the first part the first three are consecutive), 3 of Stage III.
fn shown(stages: &Stages) -> Vec<(DropStage, usize)> {
    let [before, drop, after] = stages.intervals();
    let first_end = stages.drops[0][1];
    let parts = [
        (DropStage::Before, before, 3, 0),
        (DropStage::Drop, *drop.start()..=first_end, 6, 3),
        (DropStage::FurtherDrop, first_end + 1..=*drop.end(), 6, 0),
        (DropStage::After, after, 3, 0),
    ];
    let of_part =
        |(stage, rows, most, dense): (DropStage, std::ops::RangeInclusive<usize>, usize, usize)| {
            let rows: Vec<usize> = rows.collect();
            spread(rows.len(), most, dense)
                .into_iter()
                .map(move |k| (stage, rows[k]))
        };
    parts.into_iter().flat_map(of_part).collect()
}

/// Up to `most` indices of 0 … count-1: the first `dense`, then evenly spaced up to the last.
fn spread(count: usize, most: usize, dense: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    let rest = most - dense;
    let even = (1..=rest).map(|k| {
        let from = dense as f64 - 1.0;
        let share = if dense == 0 {
            (k - 1) as f64 / (rest - 1) as f64
        } else {
            k as f64 / rest as f64
        };
        let from = if dense == 0 { 0.0 } else { from };
        (from + share * ((count - 1) as f64 - from)).round() as usize
    });
    (0..dense).chain(even).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run made before a key existed has its constant default.
    #[test]
    fn a_family_differs_in_what_its_scenes_say() {
        let of = |seed: u32, contact: &str| {
            let scene = format!("seed = {seed}\ntitle = \"run {seed}\"\n[contact]\n{contact}\n");
            family(&scene, 12)
        };
        let old = of(1, "friction = 0.7");
        assert_eq!(of(2, "sliding_damping = 0.0\nfriction = 0.7"), old);
        assert_ne!(of(2, "sliding_damping = 1.0\nfriction = 0.7"), old);
        assert_ne!(of(2, "friction = 0.5"), old);
        assert_ne!(family("[contact]\nfriction = 0.7\n", 13), old);
    }

    #[test]
    fn steps_are_spread_from_the_first_to_the_last() {
        assert_eq!(spread(4, 6, 3), [0, 1, 2, 3]);
        assert_eq!(spread(11, 3, 0), [0, 5, 10]);
        assert_eq!(spread(12, 6, 3), [0, 1, 2, 5, 8, 11]);
        assert_eq!(spread(0, 3, 0), [0; 0]);
    }
}
