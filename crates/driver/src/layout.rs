//! How many ranks and threads use some cores best, by the model of docs/validation/speed.md, "Many
//! ranks". The network between nodes is left out, since it costs all layouts about the same.

use std::str::FromStr;

use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::failure::Failure;
use gshear_mpi_exchange::Parallel;
use gshear_scene::{Dimensions, Scene};

use crate::estimate::{dense_height, index};
use crate::say;

/// Times (s) and counts of the model for disks and for spheres; areas are in d̄², or lengths in d̄
/// of disks. `scripts/scaling_model.py` has their sources.
struct Constants {
    /// Of a grain, and of its pairs.
    grain: f64,
    of_pairs: f64,
    /// Pairs of a grain.
    pairs: f64,
    /// Pairs across an area, and ghosts at each side of it.
    across: f64,
    ghosts: f64,
    /// For a thread to pack and copy a ghost, and more of a pair across two threads.
    copied: f64,
    between_threads: f64,
    /// What one of several threads does alone, for a grain.
    alone: f64,
}

const CONSTANTS: [Constants; 2] = [
    Constants {
        grain: 14e-9,
        of_pairs: 0.85,
        pairs: 2.12,
        across: 1.40,
        ghosts: 0.90,
        copied: 8.5e-9,
        between_threads: 31e-9,
        alone: 0.28e-9,
    },
    Constants {
        grain: 30.9e-9,
        of_pairs: 0.84,
        pairs: 3.06,
        across: 1.65,
        ghosts: 0.77,
        copied: 17e-9,
        between_threads: 19e-9,
        alone: 0.41e-9,
    },
];
/// Of a sum over ranks, and of the three regions of parallel work (s).
const SUM: f64 = 0.5e-6;
const REGIONS: f64 = 1.35e-6;
/// Ranks whose terms of a sum one rank adds.
const BRANCHES: f64 = 8.0;
/// Least number of ghosts that threads copy together: crates/dem/src/domain/slabs.rs.
const COPIED_BY_THREADS: f64 = 512.0;
/// The work of the rank that has most over the mean, and of the thread that has most.
const IMBALANCE: [f64; 2] = [1.04, 1.13];
/// Width of a cell of the list, and the least of a slab, over d̄.
const COLUMN: f64 = 1.4;
const NARROWEST: f64 = 4.0;

/// Ranks, and threads of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Layout {
    /// Ranks.
    pub ranks: usize,
    /// Threads of each.
    pub threads: usize,
}

/// What the model needs of a sample: lengths in d̄, the width 1 of disks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SampleSize {
    grains: f64,
    length: f64,
    width: f64,
    height: f64,
    axes: usize,
}

impl SampleSize {
    /// Of the sample of a scene.
    pub fn of(scene: &Scene) -> Self {
        let sample = &scene.sample;
        let diameter = sample.mean_diameter;
        let height = match scene.stages.first_strain() {
            Some(quasi_static) => quasi_static.lengths(sample)[2],
            None => dense_height(scene),
        };
        let (axes, width) = match scene.dimension {
            Dimensions::Two => (Two::AXES, 1.0),
            Dimensions::Three => (Three::AXES, sample.width / diameter),
        };
        debug_assert_eq!(axes - 2, index(scene));
        Self {
            grains: f64::from(sample.grains),
            length: sample.length / diameter,
            width,
            height: height / diameter,
            axes,
        }
    }

    /// Time of a step (s) of one thread.
    fn alone(&self) -> f64 {
        self.grains * CONSTANTS[self.axes - 2].grain
    }

    /// Time of a step (s); `None` if the slabs are too narrow.
    pub fn step(&self, layout: Layout) -> Option<f64> {
        let c = &CONSTANTS[self.axes - 2];
        let [ranks, threads] = [layout.ranks, layout.threads].map(|count| count as f64);
        let (slab, section) = (self.length / ranks, self.width * self.height);
        if layout.ranks > 1 && slab < NARROWEST {
            return None;
        }
        let own = self.grains / ranks;
        let mut time = own * c.grain / threads;
        for (count, imbalance) in [ranks, threads].into_iter().zip(IMBALANCE) {
            if count > 1.0 {
                time *= imbalance;
            }
        }
        if layout.ranks > 1 {
            let pair = c.of_pairs * c.grain / c.pairs;
            // Both ranks evaluate the pairs across a cut.
            let area = 2.0 * section;
            time += 0.5 * c.across * area * pair / threads;
            let ghosts = c.ghosts * section;
            let packing = if ghosts >= COPIED_BY_THREADS {
                threads
            } else {
                1.0
            };
            time += 2.0 * ghosts * c.copied / packing;
            let levels = if ranks <= BRANCHES {
                1.0
            } else {
                1.0 + ranks.log(BRANCHES).ceil()
            };
            time += SUM * levels;
        }
        if layout.threads > 1 {
            // Shares are runs of columns of cells, or pieces of a column.
            let share = slab / threads;
            let border = if share >= COLUMN {
                section
            } else {
                let ends = if self.axes == 2 { 1.0 } else { self.height };
                section * share / COLUMN * (1.0 - COLUMN / slab).max(0.0) + COLUMN * ends
            };
            time += c.across * border * c.between_threads + own * c.alone;
            time += REGIONS * threads.log2();
        }
        Some(time)
    }

    /// The ways to use all cores of some nodes, with equally many ranks on each node, and their
    /// times of a step (s), the fastest first. Those whose slabs are too narrow are left out.
    fn layouts(&self, cores: Cores) -> Vec<(Layout, f64)> {
        let Cores { nodes, per_node } = cores;
        let divisors = (1..=per_node).filter(|threads| per_node.is_multiple_of(*threads));
        let layouts = divisors.map(|threads| Layout {
            ranks: nodes * per_node / threads,
            threads,
        });
        let mut layouts: Vec<_> = layouts
            .filter_map(|layout| Some((layout, self.step(layout)?)))
            .collect();
        layouts.sort_by(|a, b| a.1.total_cmp(&b.1));
        layouts
    }
}

/// Cores of equal nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cores {
    nodes: usize,
    per_node: usize,
}

impl FromStr for Cores {
    type Err = String;

    /// Reads `128`, of one node, or `4x32`, of 32 on each of four nodes.
    fn from_str(text: &str) -> Result<Self, String> {
        let (nodes, per_node) = text.split_once('x').unwrap_or(("1", text));
        let number = |text: &str| {
            let number: u16 = text.parse().ok()?;
            (number > 0).then_some(usize::from(number))
        };
        match (number(nodes), number(per_node)) {
            (Some(nodes), Some(per_node)) => Ok(Self { nodes, per_node }),
            _ => Err(format!(
                "{text:?} are no cores; write 128, or 4x32 for 32 on each of four nodes"
            )),
        }
    }
}

/// Prints the ways to use these cores for a scene as CSV on standard output, the fastest first, by
/// the model: ranks, threads of each, time of a step (s), and the share of it that all cores would
/// need if they shared the work of one without loss. Collective.
///
/// # Errors
/// Standard output that cannot be written; more nodes than slabs.
pub fn print_layouts(exchange: &dyn Parallel, scene: &Scene, cores: Cores) -> Result<(), Failure> {
    let size = SampleSize::of(scene);
    let layouts = size.layouts(cores);
    if layouts.is_empty() {
        return Err(Failure::input(format!(
            "{} nodes are too many: slabs of a rank on each would be narrower than {NARROWEST} mean diameters; give fewer nodes",
            cores.nodes
        )));
    }
    let ideal = size.alone() / (cores.nodes * cores.per_node) as f64;
    let mut text = String::from("ranks,threads,step_s,efficiency");
    for (Layout { ranks, threads }, step) in layouts {
        text += &format!("\n{ranks},{threads},{step:.3e},{:.3}", ideal / step);
    }
    say::print(exchange, &text)
}

/// By how much another use of the same cores must be faster to be worth a word.
const WORTH_A_WORD: f64 = 1.25;

/// What to say if other numbers of ranks and threads use the same cores much better.
pub(crate) fn advice(size: &SampleSize, given: Layout) -> Option<String> {
    let cores = given.ranks * given.threads;
    let time = size.step(given)?;
    let of_one_node = Cores {
        nodes: 1,
        per_node: cores,
    };
    let (best, least) = *size.layouts(of_one_node).first()?;
    let ratio = time / least;
    (ratio >= WORTH_A_WORD).then(|| {
        format!(
            "by a model, {} ranks of {} threads are {ratio:.1} times as fast on {cores} cores as {} of {}: mpirun -n {} and --threads {}",
            best.ranks, best.threads, given.ranks, given.threads, best.ranks, best.threads
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Disks in a sample ten times as long as high.
    const DISKS: SampleSize = SampleSize {
        grains: 1e6,
        length: 3094.0,
        width: 1.0,
        height: 309.4,
        axes: 2,
    };
    /// The same number of spheres.
    const SPHERES: SampleSize = SampleSize {
        length: 443.6,
        width: 44.36,
        height: 44.36,
        axes: 3,
        ..DISKS
    };

    fn layout(ranks: usize, threads: usize) -> Layout {
        Layout { ranks, threads }
    }

    #[test]
    fn a_rank_on_each_core_is_best_while_slabs_are_wide() {
        let on_one_node = |cores: &str| cores.parse().expect("cores");
        let best = |size: &SampleSize, cores| size.layouts(on_one_node(cores))[0];
        assert_eq!(best(&DISKS, "16").0, layout(16, 1));
        assert_eq!(advice(&DISKS, layout(16, 1)), None);
        // Slabs of 3.5 diameters; threads share what ranks cannot.
        assert_eq!(SPHERES.step(layout(128, 1)), None);
        let (best, time) = best(&SPHERES, "128");
        assert_eq!(best.ranks * best.threads, 128);
        assert!(best.threads > 1, "{best:?}");
        assert!(SPHERES.step(layout(1, 128)).expect("a step") > time);
    }

    /// All cores have a thread, and no rank is on two nodes.
    #[test]
    fn ranks_are_within_nodes() {
        let layouts = DISKS.layouts("4x12".parse().expect("cores"));
        let mut threads: Vec<usize> = layouts.iter().map(|(layout, _)| layout.threads).collect();
        threads.sort_unstable();
        assert_eq!(threads, [1, 2, 3, 4, 6, 12]);
        for (Layout { ranks, threads }, _) in &layouts {
            assert_eq!((ranks * threads, ranks % 4), (48, 0));
        }
        assert!(layouts.is_sorted_by(|a, b| a.1 <= b.1));
        for wrong in ["", "0", "4x", "4x0", "x4", "4x4x4", "-1", "1e3", "70000"] {
            assert!(wrong.parse::<Cores>().is_err(), "{wrong}");
        }
    }

    /// Without ranks and threads a step is the time of its grains.
    #[test]
    fn a_step_of_one_thread_has_its_grains_alone() {
        for (size, time) in [(DISKS, 1e6 * 14e-9), (SPHERES, 1e6 * 30.9e-9)] {
            assert_eq!(size.step(layout(1, 1)), Some(time));
            assert_eq!(size.alone(), time);
        }
    }

    #[test]
    fn threads_that_ranks_could_be_are_noticed() {
        let said = advice(&DISKS, layout(1, 512)).expect("a slow layout");
        assert!(
            said.contains(" on 512 cores as 1 of 512: mpirun -n "),
            "{said}"
        );
    }
}
