//! Measured time series of a slider under one protocol: one run, or the mean of several
//! realisations.

use std::ops::Range;

use super::drive_segment::DriveSegment;
use crate::moments::{Moments, grouped};

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
    /// `[L]` Granular temperature over P d̄³ (disks: over P d̄²); NaN if it is not known.
    pub temperature: Vec<f64>,
    /// `[L]` The same of the spins.
    pub spin_temperature: Vec<f64>,
    /// `[L]` Standard deviation of μ among the realisations; NaN for a single one.
    pub deviation: Vec<f64>,
    /// Number of realisations averaged.
    pub realisations: usize,
    /// Greatest number of means per segment that a fit uses; rows are averaged in groups so that
    /// its cost does not grow with their number.
    pub means: usize,
}

/// The number of means per segment of runs.
const MEANS: usize = 400;

/// Protocols are equal if velocities and durations agree to this share.
const SAME_PROTOCOL: f64 = 1e-3;
/// Likewise for k̄, whose normal force varies a little from sample to sample.
const SAME_STIFFNESS: f64 = 0.05;

impl SliderRecord {
    /// The record of one run: time, slip and friction, under a constant load. Its
    /// temperatures are not known.
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
            spin_temperature: unknown.clone(),
            deviation: unknown,
            realisations: 1,
            means: MEANS,
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

    /// Returns the displacement of the drive up to the start of a segment (m).
    pub(super) fn driven(&self, segment: usize) -> f64 {
        self.drive[..segment]
            .iter()
            .map(DriveSegment::distance)
            .sum()
    }

    /// Returns the rows of a segment: after its start and up to its end.
    pub fn rows(&self, segment: usize) -> Range<usize> {
        let end = if segment + 1 < self.drive.len() {
            self.row_after(self.begin(segment + 1))
        } else {
            self.time.len()
        };
        let begin = if segment == 0 {
            0
        } else {
            self.row_after(self.begin(segment))
        };
        begin..end
    }

    /// Returns the first row after a time.
    fn row_after(&self, time: f64) -> usize {
        self.time.partition_point(|t| *t <= time)
    }

    /// Returns the mean friction of each so many consecutive rows among these.
    pub(super) fn running_means(&self, rows: Range<usize>, length: usize) -> Vec<f64> {
        let starts = rows.start..(rows.end + 1).saturating_sub(length);
        let means = starts.map(|row| self.mean_friction(row..row + length));
        means.collect()
    }

    /// Returns the rows of the first and of the latter half of a segment, by time.
    pub fn halves(&self, segment: usize) -> [Range<usize>; 2] {
        let rows = self.rows(segment);
        let middle = self.begin(segment) + 0.5 * self.drive[segment].duration;
        let at = self.row_after(middle).clamp(rows.start, rows.end);
        [rows.start..at, at..rows.end]
    }

    /// Returns the record restricted to a range of segments.
    pub fn cut(&self, segments: Range<usize>) -> SliderRecord {
        let rows = self.rows(segments.start).start..self.rows(segments.end - 1).end;
        let mut drive = self.drive[segments.clone()].to_vec();
        // The first row of the cut record lies a little after the start of its first segment.
        drive[0].duration -= self.time[rows.start] - self.begin(segments.start);
        SliderRecord {
            stiffness: self.stiffness,
            drive,
            time: self.time[rows.clone()].to_vec(),
            slip: self.slip[rows.clone()].to_vec(),
            friction: self.friction[rows.clone()].to_vec(),
            load: self.load[rows.clone()].to_vec(),
            temperature: self.temperature[rows.clone()].to_vec(),
            spin_temperature: self.spin_temperature[rows.clone()].to_vec(),
            deviation: self.deviation[rows].to_vec(),
            realisations: self.realisations,
            means: self.means,
        }
    }

    fn same_protocol(&self, other: &SliderRecord) -> bool {
        let segments = self.drive.len();
        if segments != other.drive.len()
            || !is_near(self.stiffness, other.stiffness, SAME_STIFFNESS)
        {
            return false;
        }
        // A run may be stopped at any time, so the last segment's duration is not compared.
        let mut pairs = self.drive.iter().zip(&other.drive).enumerate();
        pairs.all(|(k, (a, b))| {
            is_near(a.velocity, b.velocity, SAME_PROTOCOL)
                && (k + 1 == segments || is_near(a.duration, b.duration, SAME_PROTOCOL))
        })
    }
}

/// Whether two values agree to this share of the greater one.
fn is_near(a: f64, b: f64, share: f64) -> bool {
    (a - b).abs() <= share * a.abs().max(b.abs())
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
    let joined = groups.into_iter().map(|group| {
        let members: Vec<&SliderRecord> = group.iter().map(|k| &records[*k]).collect();
        (mean(&members), group)
    });
    joined.collect()
}

/// Returns the mean of realisations of one protocol. Panics if there are none.
pub(super) fn mean(members: &[&SliderRecord]) -> SliderRecord {
    let [first, ..] = members else {
        unreachable!("a group has a member");
    };
    if members.len() == 1 {
        return (*first).clone();
    }
    let lengths = members.iter().map(|r| r.time[r.time.len() - 1] - r.time[0]);
    let end = lengths.fold(f64::INFINITY, f64::min);
    // Times count from each record's first row.
    let rows = first.time.partition_point(|t| t - first.time[0] <= end);
    let time = first.time[..rows].to_vec();
    let friction = moments_at(&time, members, |r| &r.friction);
    let [slip, load, temperature, spin_temperature] = [
        (|r| &r.slip) as fn(&SliderRecord) -> &[f64],
        |r| &r.load,
        |r| &r.temperature,
        |r| &r.spin_temperature,
    ]
    .map(|values| {
        let moments = moments_at(&time, members, values);
        moments.iter().map(|moments| moments.mean).collect()
    });
    let mut drive = first.drive.clone();
    if let (Some(segment), Some(time)) = (drive.last_mut(), time.last()) {
        segment.duration = time - first.begin(first.drive.len() - 1);
    }
    SliderRecord {
        stiffness: members.iter().map(|r| r.stiffness).sum::<f64>() / members.len() as f64,
        drive,
        slip,
        friction: friction.iter().map(|moments| moments.mean).collect(),
        load,
        temperature,
        spin_temperature,
        deviation: friction.iter().map(Moments::deviation).collect(),
        realisations: members.len(),
        means: first.means,
        time,
    }
}

/// Moments of a quantity over the records, at the times of the first one.
fn moments_at(
    time: &[f64],
    members: &[&SliderRecord],
    values: fn(&SliderRecord) -> &[f64],
) -> Vec<Moments> {
    let start = members[0].time[0];
    let moments = time.iter().map(|time| {
        let members = members.iter();
        let values = members.map(|r| interpolated(&r.time, values(r), r.time[0] + (time - start)));
        Moments::of(&values.collect::<Vec<f64>>())
    });
    moments.collect()
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
