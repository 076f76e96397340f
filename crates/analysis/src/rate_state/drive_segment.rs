//! The protocol of the drive, recovered from the time series of the spring's far end.

/// A segment of the drive: the spring's far end moves at constant velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveSegment {
    /// Velocity (m/s); 0 in a hold.
    pub velocity: f64,
    /// Duration (s).
    pub duration: f64,
}

impl DriveSegment {
    /// Returns whether the segment is a hold.
    pub fn is_hold(&self) -> bool {
        self.velocity == 0.0
    }

    /// Returns the distance the drive moves (m).
    pub fn distance(&self) -> f64 {
        self.velocity * self.duration
    }
}

/// Velocities that differ by less than this share count as equal.
const SAME: f64 = 1e-9;
/// Tolerance for the time of a velocity change to lie outside its two rows, over the interval of
/// the rows.
const SLACK: f64 = 0.05;

/// Returns the segments of a drive from its velocity (m/s, piecewise constant) and displacement (m)
/// at `time` (s), all `[L]`. Velocity changes lie between rows; their times follow from the
/// displacement.
///
/// # Errors
/// If the drive moves backwards, or if its displacement does not match its velocity, for example
/// because a segment lies between two rows.
pub fn of_drive(
    time: &[f64],
    velocity: &[f64],
    displacement: &[f64],
) -> Result<Vec<DriveSegment>, String> {
    if let Some(row) = velocity.iter().position(|v| v.is_nan() || *v < 0.0) {
        return Err(format!(
            "row {row} is {:e} m/s; the drive's velocity must be positive, or 0 in a hold",
            velocity[row]
        ));
    }
    let mut segments = Vec::new();
    let Some(mut begin) = time.first().copied() else {
        return Ok(segments);
    };
    for k in 1..time.len() {
        let [earlier, later] = [velocity[k - 1], velocity[k]];
        if (later - earlier).abs() <= SAME * later.max(earlier) {
            continue;
        }
        let interval = time[k] - time[k - 1];
        let advance = displacement[k] - displacement[k - 1];
        // advance = earlier · s + later · (interval - s)
        let change = (advance - later * interval) / (earlier - later);
        if !(-SLACK * interval..=(1.0 + SLACK) * interval).contains(&change) {
            return Err(format!(
                "between row {} and row {k} the drive moves by {advance:e} m in {interval:e} s, which does not match its velocity; every segment must have rows",
                k - 1
            ));
        }
        let end = time[k - 1] + change.clamp(0.0, interval);
        segments.push(DriveSegment {
            velocity: earlier,
            duration: end - begin,
        });
        begin = end;
    }
    segments.push(DriveSegment {
        velocity: velocity[time.len() - 1],
        duration: time[time.len() - 1] - begin,
    });
    Ok(segments)
}

/// Least number of rows of a segment that is found in a measured displacement.
const LEAST_ROWS: usize = 20;
/// Greatest number of blocks of rows between which the velocity is first taken to change.
const BLOCKS: usize = 2000;
/// A segment of a velocity between those of its neighbours that is shorter than this share of both
/// is the drive's change from one to the other.
const TRANSITION: f64 = 0.05;
/// What a further segment costs, over σ² ln L with the noise σ of the displacement.
const PENALTY: f64 = 10.0;
/// Error of sums of displacements, over the whole displacement; less is no noise.
const ROUNDING: f64 = 1e-9;
/// Least change of the velocity, over the greater one, between two segments that are found.
const LEAST_CHANGE: f64 = 0.1;
/// Least departure of the displacement from a straight line, over the noise, that is a change of
/// the velocity.
const LEAST_DEPARTURE: f64 = 5.0;
/// Velocities below this share of the greatest one, or of displacements within the noise, are
/// holds.
const STILL: f64 = 1e-4;

/// Returns the segments of a drive from its measured displacement (m) at `time` (s, ascending),
/// both `[L]`: straight lines by least squares.
///
/// The rows are divided into the segments of least squares with a penalty for each (optimal
/// partitioning, Jackson et al. 2005), first in blocks of rows; then each division moves to its
/// best row between its neighbours. Divisions at which the velocity differs by less than a tenth,
/// or the displacement departs from one line by less than five times its noise, are removed, the
/// least first. A short segment of a velocity between those of its neighbours is taken as the
/// change from one to the other. A division lies where the lines meet.
///
/// # Errors
/// Too few rows, or a drive that moves backwards.
pub fn of_displacement(time: &[f64], displacement: &[f64]) -> Result<Vec<DriveSegment>, String> {
    if time.len() < LEAST_ROWS {
        return Err(format!(
            "has {} rows; a segment of the drive needs at least {LEAST_ROWS}",
            time.len()
        ));
    }
    let lines = Lines::new(time, displacement);
    let mut ends = lines.partition(displacement);
    lines.simplify(&mut ends);
    let fits: Vec<Line> = ends.windows(2).map(|e| lines.fit(e[0], e[1])).collect();
    let mut changes = Vec::new();
    for (k, pair) in fits.windows(2).enumerate() {
        let meet = (pair[1].at_start - pair[0].at_start) / (pair[0].velocity - pair[1].velocity);
        let [before, after] = [k, k + 1].map(|k| time[(ends[k] + ends[k + 1] - 1) / 2]);
        changes.push((lines.origin + meet).clamp(before, after));
    }
    let velocities = fits.iter().zip(ends.windows(2)).map(|(line, ends)| {
        let noise = (line.squares / (ends[1] - ends[0]) as f64).sqrt();
        let advance = line.velocity * (time[ends[1] - 1] - time[ends[0]]);
        [line.velocity, advance, noise]
    });
    segments_of(time, &changes, &velocities.collect::<Vec<_>>())
}

/// Returns the segments of a drive whose velocity changes at these times (s, ascending), with
/// velocities from straight lines through the measured displacement (m), `[L]`.
///
/// # Errors
/// Times outside of the rows, fewer than two rows between them, a drive that moves backwards.
pub fn with_changes(
    time: &[f64],
    displacement: &[f64],
    changes: &[f64],
) -> Result<Vec<DriveSegment>, String> {
    let lines = Lines::new(time, displacement);
    let mut ends = vec![0];
    ends.extend(
        changes
            .iter()
            .map(|change| time.partition_point(|t| t <= change)),
    );
    ends.push(time.len());
    let mut velocities = Vec::new();
    for pair in ends.windows(2) {
        if pair[1] < pair[0] + 2 {
            return Err(format!(
                "the changes of the velocity must ascend within {:.4e} to {:.4e} s, with rows between them",
                time[0],
                time[time.len() - 1]
            ));
        }
        let line = lines.fit(pair[0], pair[1]);
        let noise = (line.squares / (pair[1] - pair[0]) as f64).sqrt();
        let advance = line.velocity * (time[pair[1] - 1] - time[pair[0]]);
        velocities.push([line.velocity, advance, noise]);
    }
    segments_of(time, changes, &velocities)
}

/// The segments between these changes, from velocity, advance and noise of each.
fn segments_of(
    time: &[f64],
    changes: &[f64],
    velocities: &[[f64; 3]],
) -> Result<Vec<DriveSegment>, String> {
    let greatest = velocities.iter().fold(0.0_f64, |a, v| a.max(v[0].abs()));
    let mut segments = Vec::new();
    let mut begin = time[0];
    let ends = changes.iter().copied().chain(time.last().copied());
    for (&[velocity, advance, noise], end) in velocities.iter().zip(ends) {
        let is_still = velocity.abs() < STILL * greatest || advance.abs() < LEAST_DEPARTURE * noise;
        if velocity < 0.0 && !is_still {
            return Err(format!(
                "moves backwards from {begin:.4e} to {end:.4e} s, at {velocity:.4e} m/s"
            ));
        }
        segments.push(DriveSegment {
            velocity: if is_still { 0.0 } else { velocity },
            duration: end - begin,
        });
        begin = end;
    }
    Ok(segments)
}

/// A straight line through some rows.
struct Line {
    /// Displacement at the origin of time (m).
    at_start: f64,
    velocity: f64,
    /// Sum of the squared residuals (m²).
    squares: f64,
}

/// Straight lines through ranges of rows, by sums up to each row.
struct Lines {
    /// Origin of time (s).
    origin: f64,
    /// `[L + 1]` Sums of t, x, t², tx and x² of the rows before.
    sums: Vec<[f64; 5]>,
    time: Vec<f64>,
    /// Mean square of the rounding errors (m²).
    least_square: f64,
}

impl Lines {
    fn new(time: &[f64], displacement: &[f64]) -> Self {
        let middle = time.len() / 2;
        let (origin, from) = (time[middle], displacement[middle]);
        let mut sums = vec![[0.0; 5]];
        let mut sum = [0.0; 5];
        for (t, x) in time.iter().zip(displacement) {
            let (t, x) = (t - origin, x - from);
            for (sum, term) in sum.iter_mut().zip([t, x, t * t, t * x, x * x]) {
                *sum += term;
            }
            sums.push(sum);
        }
        Self {
            origin,
            sums,
            time: time.to_vec(),
            least_square: (ROUNDING * (displacement[time.len() - 1] - displacement[0])).powi(2),
        }
    }

    fn fit(&self, begin: usize, end: usize) -> Line {
        let n = (end - begin) as f64;
        let sum: [f64; 5] = std::array::from_fn(|k| self.sums[end][k] - self.sums[begin][k]);
        let [t, x] = [sum[0] / n, sum[1] / n];
        let [tt, tx, xx] = [sum[2] - n * t * t, sum[3] - n * t * x, sum[4] - n * x * x];
        let velocity = if tt > 0.0 { tx / tt } else { 0.0 };
        Line {
            at_start: x - velocity * t,
            velocity,
            squares: (xx - velocity * tx).max(0.0),
        }
    }

    /// The row between two ends at which two lines leave the least squares.
    fn best(&self, begin: usize, end: usize) -> Option<usize> {
        let places = begin + LEAST_ROWS..(end + 1).saturating_sub(LEAST_ROWS);
        let sums = places.map(|k| (k, self.fit(begin, k).squares + self.fit(k, end).squares));
        sums.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
    }

    /// The ends of the segments of least squares and penalties, in blocks of rows.
    fn partition(&self, displacement: &[f64]) -> Vec<usize> {
        let rows = self.time.len();
        let blocks = rows.min(BLOCKS);
        let ends: Vec<usize> = (0..=blocks).map(|block| block * rows / blocks).collect();
        let least = LEAST_ROWS.div_ceil(rows / blocks);
        let variance = self.noise(displacement).powi(2).max(self.least_square);
        let penalty = PENALTY * variance * (rows as f64).ln();
        let mut costs = vec![f64::INFINITY; blocks + 1];
        let mut before = vec![0; blocks + 1];
        costs[0] = 0.0;
        for end in least..=blocks {
            for begin in 0..=end - least {
                let squares = self.fit(ends[begin], ends[end]).squares;
                let cost = costs[begin] + squares + penalty;
                if cost < costs[end] {
                    (costs[end], before[end]) = (cost, begin);
                }
            }
        }
        let mut found = vec![rows];
        let mut end = blocks;
        while end > 0 {
            end = before[end];
            found.push(ends[end]);
        }
        found.reverse();
        found
    }

    /// Standard deviation of white noise in the displacement (m), by the median distance of rows
    /// from the line through their neighbours.
    fn noise(&self, displacement: &[f64]) -> f64 {
        /// The median of |x| of a normal distribution, over its standard deviation.
        const MEDIAN: f64 = 0.6745;
        let rows = self.time.windows(3).zip(displacement.windows(3));
        let distances = rows.map(|(t, x)| {
            let share = (t[1] - t[0]) / (t[2] - t[0]);
            let distance = x[1] - x[0] - share * (x[2] - x[0]);
            let variance = 1.0 + share * share + (1.0 - share).powi(2);
            distance.abs() / variance.sqrt()
        });
        let mut distances: Vec<f64> = distances.collect();
        let middle = distances.len() / 2;
        let (_, median, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
        *median / MEDIAN
    }

    /// Moves each division to its best row between its neighbours.
    fn improve(&self, ends: &mut [usize]) {
        for _ in 0..2 {
            for k in 1..ends.len() - 1 {
                if let Some(best) = self.best(ends[k - 1], ends[k + 1]) {
                    ends[k] = best;
                }
            }
        }
    }

    /// Improves the divisions and removes those that are no change of the velocity.
    fn simplify(&self, ends: &mut Vec<usize>) {
        self.improve(ends);
        while let Some(k) = self.needless(ends) {
            ends.remove(k);
            self.improve(ends);
        }
    }

    /// The next division to remove: the start of a change of the drive from one velocity to
    /// another, or the least change of the velocity if it is too little.
    fn needless(&self, ends: &[usize]) -> Option<usize> {
        let divisions = 1..ends.len() - 1;
        if let Some(k) = divisions.clone().find(|k| self.is_transition(ends, *k)) {
            return Some(k);
        }
        let changes = divisions.map(|k| (k, self.change(&ends[k - 1..k + 2])));
        let least = changes.min_by(|a, b| a.1.total_cmp(&b.1));
        least.filter(|(_, change)| *change < 1.0).map(|(k, _)| k)
    }

    /// Whether the segment that starts here is a change from the one before to the one after.
    fn is_transition(&self, ends: &[usize], k: usize) -> bool {
        if k + 2 >= ends.len() {
            return false;
        }
        let [before, own, after] =
            [k - 1, k, k + 1].map(|k| self.fit(ends[k], ends[k + 1]).velocity);
        let [rows_before, rows, rows_after] =
            [k - 1, k, k + 1].map(|k| (ends[k + 1] - ends[k]) as f64);
        let is_between = (own - before) * (after - own) > 0.0;
        is_between && rows < TRANSITION * rows_before.min(rows_after)
    }

    /// The change of the velocity at the middle one of three ends, over the least one that counts.
    fn change(&self, ends: &[usize]) -> f64 {
        let [begin, at, end] = [ends[0], ends[1], ends[2]];
        let [first, second] = [self.fit(begin, at), self.fit(at, end)];
        let change = (first.velocity - second.velocity).abs();
        let greater = first.velocity.abs().max(second.velocity.abs());
        let square = (first.squares + second.squares) / (end - begin) as f64;
        let noise = square.max(self.least_square).sqrt();
        let lasting =
            (self.time[at - 1] - self.time[begin]).min(self.time[end - 1] - self.time[at]);
        let departure = change * lasting / (LEAST_DEPARTURE * noise);
        departure.min(change / (LEAST_CHANGE * greater))
    }
}
