//! The sample: disks inserted without overlap, and walls cut from it.

use std::ops::Range;

use bytemuck::Zeroable;
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::config::Sample;
use crate::state::{GrainState, body};

/// Room for the largest grain, over its diameter.
const ROOM: f64 = 1.05;

/// Columns of grains up to the given radius (m) that have room in a cell of this length (m).
pub fn columns(length: f64, radius_max: f64) -> u32 {
    ((length / (2.0 * radius_max * ROOM)) as u32).max(1)
}

/// Columns of loosely stacked grains, jittered as far as each grain's cell allows; ids run up column after column.
#[derive(Debug, Clone, Copy)]
pub struct Lattice {
    columns: u32,
    grains: u32,
    width: f64,
}

impl Lattice {
    pub fn new(sample: &Sample) -> Self {
        let columns = columns(sample.length, sample.radius_max);
        Self {
            columns,
            grains: sample.grains,
            width: sample.length / columns as f64,
        }
    }

    /// The ids of a column: the first ones hold one more where the grains do not fill the last row.
    fn ids(&self, column: u32) -> Range<u32> {
        let (rows, longer) = (self.grains / self.columns, self.grains % self.columns);
        let first = |c: u32| c * rows + c.min(longer);
        first(column)..first(column + 1)
    }

    /// The grains at rest of this rank's share of the columns. Every grain has its own random stream, so any rank may make it.
    pub fn insert(&self, sample: &Sample, seed: u64, rank: usize, ranks: usize) -> Vec<GrainState> {
        let part = |r: usize| (self.columns as u64 * r as u64 / ranks as u64) as u32;
        let columns = part(rank)..part(rank + 1);
        columns.flat_map(|c| self.column(sample, seed, c)).collect()
    }

    fn column(&self, sample: &Sample, seed: u64, column: u32) -> Vec<GrainState> {
        let mut bottom = 0.0;
        let grain = |id| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            random.set_stream(id as u64);
            let mut uniform = || random.random::<f64>();
            let radius = sample.radius_min + uniform() * (sample.radius_max - sample.radius_min);
            let free = self.width - 2.0 * radius;
            let x = self.width * column as f64 + radius + free * uniform();
            let gap = 2.0 * radius * (ROOM - 1.0);
            let y = bottom + radius + gap * uniform();
            bottom += 2.0 * radius + gap;
            GrainState {
                id,
                position: [if x < sample.length { x } else { 0.0 }, y],
                radius,
                ..GrainState::zeroed()
            }
        };
        self.ids(column).map(grain).collect()
    }
}

/// Makes walls of the grains whose centre is within `thickness` (m) of the planes y = `planes` (m), the lower one first.
pub fn freeze_walls(grains: &mut [GrainState], planes: [f64; 2], thickness: f64) {
    for g in grains.iter_mut() {
        g.body = if g.position[1] < planes[0] + thickness {
            body::BOTTOM
        } else if g.position[1] > planes[1] - thickness {
            body::TOP
        } else {
            body::FREE
        };
    }
    stop_walls(grains);
}

/// Takes the velocities of wall grains away.
pub fn stop_walls(grains: &mut [GrainState]) {
    for g in grains.iter_mut().filter(|g| g.body != body::FREE) {
        g.velocity = [0.0; 2];
        g.angular_velocity = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLE: Sample = Sample::uniform(1003, 0.5e-6, 1e-6, 48e-6);

    #[test]
    fn grains_do_not_overlap_and_their_sizes_are_uniform() {
        let lattice = Lattice::new(&SAMPLE);
        let grains = lattice.insert(&SAMPLE, 3, 0, 1);
        assert_eq!(grains.len(), SAMPLE.grains as usize);
        for (k, a) in grains.iter().enumerate() {
            assert_eq!(a.id, k as u32);
            assert!(a.position[1] >= a.radius && (0.0..SAMPLE.length).contains(&a.position[0]));
            for b in &grains[k + 1..] {
                let dx = (a.position[0] - b.position[0]).abs();
                let dx = dx.min(SAMPLE.length - dx);
                assert!(
                    dx.hypot(a.position[1] - b.position[1])
                        >= (a.radius + b.radius) * (1.0 - 1e-12)
                );
            }
        }
        let mean = grains.iter().map(|g| g.radius).sum::<f64>() / grains.len() as f64;
        // Standard error of the mean of 1,003 uniform numbers is 0.0046 µm.
        assert!((mean / 0.75e-6 - 1.0).abs() < 4.0 * 0.0061);
    }

    #[test]
    fn any_share_is_the_same_as_the_whole() {
        let lattice = Lattice::new(&SAMPLE);
        let whole = lattice.insert(&SAMPLE, 3, 0, 1);
        let shares: Vec<_> = (0..5)
            .flat_map(|r| lattice.insert(&SAMPLE, 3, r, 5))
            .collect();
        assert_eq!(whole, shares);
        assert_ne!(lattice.insert(&SAMPLE, 4, 0, 1), whole);
    }
}
