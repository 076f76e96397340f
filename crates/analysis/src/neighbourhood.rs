//! Neighbour search in 2D frames that are periodic along x: linked cells, and pair lists that stay
//! valid for many frames.

use gshear_dem::dimension::Two;
use gshear_dem::neighbour::{Bins, LocalExtent};
use gshear_dem::state::Cell;

/// Skin of the pair lists over the search radius: lists reach this much farther, so that they stay
/// valid for many frames.
const SKIN: f64 = 0.05;

/// Returns r_to - r_from (m), nearest image along x, of two positions wrapped into [0, L_x).
///
/// It compares where `Disks::separation` divides and rounds, because the analysis spends most of
/// its time here.
#[inline(always)]
pub fn separation(length: f64, from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    let dx = to[0] - from[0];
    let image = if dx > 0.5 * length {
        length
    } else if dx < -0.5 * length {
        -length
    } else {
        0.0
    };
    [dx - image, to[1] - from[1]]
}

/// Sorts points (m), wrapped into [0, `length`) along x, into cells of at least `reach` (m).
fn cells(length: f64, reach: f64, points: &[[f64; 2]]) -> Bins<Two> {
    let cell = Cell::between_walls([length, f64::INFINITY]);
    let places: Vec<[f64; 3]> = points.iter().map(|[x, y]| [*x, *y, 0.0]).collect();
    Bins::new(cell, LocalExtent::whole(length), reach, &places)
}

/// All pairs of grains that may lie within a radius, in order of (i, j). The order does not depend
/// on the frame the lists were made in, so sums over the pairs are reproducible.
#[derive(Debug, Default)]
pub(crate) struct NearPairs {
    length: f64,
    radius: f64,
    /// Positions that the lists were made from.
    found_at: Vec<[f64; 2]>,
    /// `[N+1]` first entry of each grain in `after`; `start_before` likewise.
    start_after: Vec<u32>,
    after: Vec<u32>,
    start_before: Vec<u32>,
    before: Vec<u32>,
}

impl NearPairs {
    /// Makes the lists hold all pairs within `radius` (m) of the positions (m, wrapped); `length`
    /// is L_x (m). Lists are rebuilt only if a grain has moved by half the skin.
    pub fn update(&mut self, length: f64, radius: f64, position: &[[f64; 2]]) {
        let skin = SKIN * radius;
        let same =
            (self.length, self.radius, self.found_at.len()) == (length, radius, position.len());
        if same && self.have_stayed(skin, position) {
            return;
        }
        (self.length, self.radius) = (length, radius);
        self.found_at.clear();
        self.found_at.extend_from_slice(position);
        self.find(radius + skin);
    }

    /// Whether no grain has moved by half the skin.
    fn have_stayed(&self, skin: f64, position: &[[f64; 2]]) -> bool {
        let places = self.found_at.iter().zip(position);
        places.fold(true, |stayed, (from, to)| {
            let d = separation(self.length, *from, *to);
            let is_near = d[0] * d[0] + d[1] * d[1] < 0.25 * skin * skin;
            // A removed grain is near none.
            stayed && (is_near || to[0].is_nan())
        })
    }

    fn find(&mut self, cutoff: f64) {
        let NearPairs {
            length,
            found_at,
            start_after,
            after,
            start_before,
            before,
            ..
        } = self;
        let cells = cells(*length, cutoff, found_at);
        for list in [&mut *after, before, start_after, start_before] {
            list.clear();
        }
        for (i, r) in found_at.iter().enumerate() {
            let firsts = [after.len(), before.len()];
            start_after.push(firsts[0] as u32);
            start_before.push(firsts[1] as u32);
            cells.each_near(&[r[0], r[1], 0.0], |j| {
                let d = separation(*length, *r, found_at[j as usize]);
                if j != i as u32 && d[0] * d[0] + d[1] * d[1] <= cutoff * cutoff {
                    if j > i as u32 {
                        &mut *after
                    } else {
                        &mut *before
                    }
                    .push(j);
                }
            });
            after[firsts[0]..].sort_unstable();
            before[firsts[1]..].sort_unstable();
        }
        start_after.push(after.len() as u32);
        start_before.push(before.len() as u32);
    }

    /// Returns the candidate partners of grain i with a higher id, ascending.
    #[inline(always)]
    pub fn after(&self, i: usize) -> &[u32] {
        &self.after[self.start_after[i] as usize..self.start_after[i + 1] as usize]
    }

    /// Calls `found` for all candidate partners of grain i, ascending.
    pub fn around(&self, i: usize, found: impl FnMut(usize)) {
        let before = &self.before[self.start_before[i] as usize..self.start_before[i + 1] as usize];
        let all = before.iter().chain(self.after(i));
        all.map(|&j| j as usize).for_each(found);
    }
}
