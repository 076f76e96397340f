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
