//! Neighbour search in 2D frames that are periodic along x: linked cells, and pair lists that stay
//! valid for many frames.

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

/// Cells at least as wide as the search radius, reused from frame to frame without allocation.
#[derive(Debug, Default)]
pub struct Cells {
    columns: usize,
    rows: usize,
    width: f64,
    height: f64,
    bottom: f64,
    /// First entry of each cell in `members`; one more at the end.
    start: Vec<u32>,
    members: Vec<u32>,
    cell: Vec<u32>,
}

impl Cells {
    /// Sorts the grains into cells.
    ///
    /// `length`: L_x (m); `radius`: search radius (m); `position`: `[N]` (m), wrapped into [0,
    /// L_x); `included`: whether a grain id is to be found. The grains of a cell keep the order of
    /// their ids.
    pub fn fill(
        &mut self,
        length: f64,
        radius: f64,
        position: &[[f64; 2]],
        included: impl Fn(usize) -> bool,
    ) {
        let mut low = f64::INFINITY;
        let mut high = f64::NEG_INFINITY;
        for (_, r) in position.iter().enumerate().filter(|(n, _)| included(*n)) {
            low = low.min(r[1]);
            high = high.max(r[1]);
        }
        // More cells than grains cost memory and find nothing faster.
        let most = position.len().max(1);
        self.columns = ((length / radius).floor() as usize).clamp(1, most);
        self.rows = (((high - low) / radius).floor().max(0.0) as usize)
            .clamp(1, most.div_ceil(self.columns));
        self.width = length / self.columns as f64;
        self.height = (high - low) / self.rows as f64;
        self.bottom = low;

        self.start.clear();
        self.start.resize(self.columns * self.rows + 1, 0);
        self.cell.clear();
        self.cell.resize(position.len(), u32::MAX);
        for (n, r) in position.iter().enumerate().filter(|(n, _)| included(*n)) {
            let (column, row) = self.at(*r);
            let cell = row * self.columns + column;
            self.cell[n] = cell as u32;
            self.start[cell + 1] += 1;
        }
        for cell in 1..self.start.len() {
            self.start[cell] += self.start[cell - 1];
        }
        self.members.clear();
        self.members
            .resize(*self.start.last().unwrap_or(&0) as usize, 0);
        for (n, &cell) in self
            .cell
            .iter()
            .enumerate()
            .filter(|(_, cell)| **cell != u32::MAX)
        {
            let next = &mut self.start[cell as usize];
            self.members[*next as usize] = n as u32;
            *next += 1;
        }
        // Filling has advanced every start to the end of its cell.
        self.start.rotate_right(1);
        self.start[0] = 0;
    }

    /// Calls `found` once for every included grain that may lie within the radius of `r`, including
    /// a grain at `r` itself.
    pub fn near(&self, r: [f64; 2], mut found: impl FnMut(usize)) {
        let (column, row) = self.at(r);
        for row in row.saturating_sub(1)..=(row + 1).min(self.rows - 1) {
            // With fewer than three columns the left and the right neighbour are the same column.
            for step in 0..self.columns.min(3) {
                let column =
                    (column + self.columns + step - usize::from(self.columns > 2)) % self.columns;
                let cell = row * self.columns + column;
                let members =
                    &self.members[self.start[cell] as usize..self.start[cell + 1] as usize];
                for &n in members {
                    found(n as usize);
                }
            }
        }
    }

    fn at(&self, r: [f64; 2]) -> (usize, usize) {
        let column = (r[0] / self.width) as usize;
        let row = ((r[1] - self.bottom) / self.height).max(0.0) as usize;
        (column.min(self.columns - 1), row.min(self.rows - 1))
    }
}

/// All pairs of grains that may lie within a radius, in order of (i, j). The order does not depend
/// on the frame the lists were made in, so sums over the pairs are reproducible.
#[derive(Debug, Default)]
pub struct NearPairs {
    length: f64,
    radius: f64,
    /// Positions that the lists were made from.
    found_at: Vec<[f64; 2]>,
    cells: Cells,
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
        let stayed = || {
            let places = self.found_at.iter().zip(position);
            places.fold(true, |stayed, (from, to)| {
                let d = separation(length, *from, *to);
                stayed && (d[0] * d[0] + d[1] * d[1] < 0.25 * skin * skin)
            })
        };
        let same =
            (self.length, self.radius, self.found_at.len()) == (length, radius, position.len());
        if same && stayed() {
            return;
        }
        (self.length, self.radius) = (length, radius);
        self.found_at.clear();
        self.found_at.extend_from_slice(position);
        self.find(radius + skin);
    }

    fn find(&mut self, cutoff: f64) {
        let NearPairs {
            length,
            found_at,
            cells,
            start_after,
            after,
            start_before,
            before,
            ..
        } = self;
        cells.fill(*length, cutoff, found_at, |_| true);
        for list in [&mut *after, before, start_after, start_before] {
            list.clear();
        }
        for (i, r) in found_at.iter().enumerate() {
            let firsts = [after.len(), before.len()];
            start_after.push(firsts[0] as u32);
            start_before.push(firsts[1] as u32);
            cells.near(*r, |j| {
                let d = separation(*length, *r, found_at[j]);
                if j != i && d[0] * d[0] + d[1] * d[1] <= cutoff * cutoff {
                    if j > i { &mut *after } else { &mut *before }.push(j as u32);
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
