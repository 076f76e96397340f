//! Measured time series of a slider under one protocol: one run, or the mean of several
//! realisations.

use std::ops::Range;

use super::drive_segment::DriveSegment;
use crate::moments::{self, Moments, grouped};

/// Time series of a slider under one protocol; L rows.
#[derive(Debug, Clone, PartialEq)]
pub struct SliderRecord {
    /// k̄: stiffness of the spring over the normal force (1/m).
    pub stiffness: f64,
    /// Segments of the drive, counted from the first row.
    pub drive: Vec<DriveSegment>,
    /// `[L]` Time (s), ascending.
    pub time: Vec<f64>,
    /// `[L]` Slip of the slider (m).
    pub slip: Vec<f64>,
    /// `[L]` Friction μ.
    pub friction: Vec<f64>,
    /// `[L]` Normal force N over that of k̄; 1 of a law. The mean of μ = S/N is ⟨S⟩/⟨N⟩.
    pub load: Vec<f64>,
    /// `[L]` Granular temperature: kinetic energy of a free grain beyond that of a linear velocity
    /// profile, over P d̄³ (disks: over P d̄²); NaN if it is not known.
    pub temperature: Vec<f64>,
    /// `[L]` Standard deviation of μ among the realisations; NaN for a single one.
    pub deviation: Vec<f64>,
    /// Number of realisations averaged.
    pub realisations: usize,
}

/// Protocols are equal if velocities and durations agree to this share.
const SAME_PROTOCOL: f64 = 1e-3;
/// Likewise for k̄, whose normal force varies a little from sample to sample.
const SAME_STIFFNESS: f64 = 0.05;

impl SliderRecord {
    /// The record of one run: time, slip and friction, under a constant load. Its temperature is
    /// not known.
    pub fn of_run(
        stiffness: f64,
        drive: Vec<DriveSegment>,
        [time, slip, friction]: [Vec<f64>; 3],
    ) -> Self {
        let unknown = vec![f64::NAN; time.len()];
        Self {
            stiffness,
            drive,
            time,
            slip,
            load: vec![1.0; friction.len()],
            friction,
            temperature: unknown.clone(),
            deviation: unknown,
            realisations: 1,
        }
    }

    /// Returns the mean friction of some rows, ⟨S⟩/⟨N⟩.
    pub fn mean_friction(&self, rows: Range<usize>) -> f64 {
        weighted_mean(&self.friction[rows.clone()], &self.load[rows])
    }

    /// Returns the time when a segment begins (s).
    pub fn begin(&self, segment: usize) -> f64 {
        let before: f64 = self.drive[..segment].iter().map(|s| s.duration).sum();
        self.time[0] + before
    }

    /// Returns the rows of a segment: after its start and up to its end.
    pub fn rows(&self, segment: usize) -> Range<usize> {
        let row_at = |time: f64| self.time.partition_point(|t| *t <= time);
        let end = if segment + 1 < self.drive.len() {
            row_at(self.begin(segment + 1))
        } else {
            self.time.len()
        };
        let begin = if segment == 0 {
            0
        } else {
            row_at(self.begin(segment))
        };
        begin..end
    }

    /// Returns the rows of the first and of the latter half of a segment, by time.
    pub fn halves(&self, segment: usize) -> [Range<usize>; 2] {
        let rows = self.rows(segment);
        let middle = self.begin(segment) + 0.5 * self.drive[segment].duration;
        let at = self.time.partition_point(|t| *t <= middle);
        let at = at.clamp(rows.start, rows.end);
        [rows.start..at, at..rows.end]
    }

    /// Returns the record restricted to a range of segments.
    pub fn cut(&self, segments: Range<usize>) -> SliderRecord {
        let rows = self.rows(segments.start).start..self.rows(segments.end - 1).end;
        let of = |values: &[f64]| values[rows.clone()].to_vec();
        let mut drive = self.drive[segments.clone()].to_vec();
        // The first row of the cut record lies a little after the start of its first segment.
        drive[0].duration -= self.time[rows.start] - self.begin(segments.start);
        SliderRecord {
            stiffness: self.stiffness,
            drive,
            time: of(&self.time),
            slip: of(&self.slip),
            friction: of(&self.friction),
            load: of(&self.load),
            temperature: of(&self.temperature),
            deviation: of(&self.deviation),
            realisations: self.realisations,
        }
    }

    fn same_protocol(&self, other: &SliderRecord) -> bool {
        let near = |a: f64, b: f64, share: f64| (a - b).abs() <= share * a.abs().max(b.abs());
        let segments = self.drive.len();
        // A run may be stopped at any time, so the last segment's duration is not compared.
        let same = |k: usize| {
            let (a, b) = (self.drive[k], other.drive[k]);
            near(a.velocity, b.velocity, SAME_PROTOCOL)
                && (k + 1 == segments || near(a.duration, b.duration, SAME_PROTOCOL))
        };
        segments == other.drive.len()
            && near(self.stiffness, other.stiffness, SAME_STIFFNESS)
            && (0..segments).all(same)
    }
}

/// Returns the mean of values by their weights; NaN without values.
pub(super) fn weighted_mean(values: &[f64], weights: &[f64]) -> f64 {
    let products = values
        .iter()
        .zip(weights)
        .map(|(value, weight)| value * weight);
    products.sum::<f64>() / weights.iter().sum::<f64>()
}

/// Joins the realisations of each protocol: their mean at the times of the first one, up to the end
/// of the shortest.
///
/// Protocols are in the order of their first realisation; each comes with the indices of its
/// records.
pub fn merge(records: &[SliderRecord]) -> Vec<(SliderRecord, Vec<usize>)> {
    let groups = grouped(0..records.len(), |a, b| {
        records[*a].same_protocol(&records[*b])
    });
    let joined = |group: Vec<usize>| {
        let members: Vec<&SliderRecord> = group.iter().map(|k| &records[*k]).collect();
        (mean(&members), group)
    };
    groups.into_iter().map(joined).collect()
}

/// Returns the mean of realisations of one protocol. Panics if there are none.
pub(super) fn mean(members: &[&SliderRecord]) -> SliderRecord {
    let [first, ..] = members else {
        unreachable!("a group has a member");
    };
    if members.len() == 1 {
        return (*first).clone();
    }
    let last = |r: &&SliderRecord| r.time[r.time.len() - 1] - r.time[0];
    let end = members.iter().map(last).fold(f64::INFINITY, f64::min);
    // Times count from each record's first row.
    let rows = first.time.partition_point(|t| t - first.time[0] <= end);
    let time = first.time[..rows].to_vec();
    // The values of all members, row by row.
    let rows = |values: fn(&SliderRecord) -> &[f64]| {
        time.iter().map(move |time| -> Vec<f64> {
            let since = time - first.time[0];
            let at = |r: &&SliderRecord| interpolated(&r.time, values(r), r.time[0] + since);
            members.iter().map(at).collect()
        })
    };
    let means = |values| rows(values).map(|values| moments::mean(&values)).collect();
    let friction = rows(|r| &r.friction).map(|values| Moments::of(&values));
    let friction: Vec<Moments> = friction.collect();
    let mut drive = first.drive.clone();
    if let (Some(segment), Some(time)) = (drive.last_mut(), time.last()) {
        segment.duration = time - first.begin(first.drive.len() - 1);
    }
    SliderRecord {
        stiffness: members.iter().map(|r| r.stiffness).sum::<f64>() / members.len() as f64,
        drive,
        slip: means(|r| &r.slip),
        friction: friction.iter().map(|of| of.mean).collect(),
        load: means(|r| &r.load),
        temperature: means(|r| &r.temperature),
        deviation: friction.iter().map(Moments::deviation).collect(),
        realisations: members.len(),
        time,
    }
}

/// Linear between the rows, constant beyond them.
fn interpolated(time: &[f64], values: &[f64], at: f64) -> f64 {
    let after = time.partition_point(|t| *t < at);
    if after == 0 {
        return values[0];
    }
    if after == time.len() {
        return values[after - 1];
    }
    let part = (at - time[after - 1]) / (time[after] - time[after - 1]);
    values[after - 1] + part * (values[after] - values[after - 1])
}
