//! The protocol that the spring's far end went through, from the time series.

/// The spring's far end moves at `velocity` (m/s; 0 in a hold) for `duration` (s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    pub velocity: f64,
    pub duration: f64,
}

impl Segment {
    pub fn is_hold(&self) -> bool {
        self.velocity == 0.0
    }

    /// Distance of the drive (m).
    pub fn distance(&self) -> f64 {
        self.velocity * self.duration
    }
}

/// Velocities that differ by less than this share are one.
const SAME: f64 = 1e-9;
/// By how much of an interval of rows a change of velocity may seem to lie outside the two rows that it lies between.
const SLACK: f64 = 0.05;

/// The segments of a drive, from its velocity (m/s), piecewise constant, and displacement (m) at `time` (s), all [L]. Times of
/// change lie between rows: they follow from the displacement.
///
/// Errors: a drive that goes back; one whose displacement does not follow from its velocity, as where a segment lies between two rows.
pub fn of_drive(
    time: &[f64],
    velocity: &[f64],
    displacement: &[f64],
) -> Result<Vec<Segment>, String> {
    if let Some(row) = velocity.iter().position(|v| v.is_nan() || *v < 0.0) {
        return Err(format!(
            "row {row} is {:e} m/s; a drive moves forward or holds",
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
                "between row {} and row {k} it does not move as its velocity says: {advance:e} m in {interval:e} s",
                k - 1
            ));
        }
        let end = time[k - 1] + change.clamp(0.0, interval);
        segments.push(Segment {
            velocity: earlier,
            duration: end - begin,
        });
        begin = end;
    }
    segments.push(Segment {
        velocity: velocity[time.len() - 1],
        duration: time[time.len() - 1] - begin,
    });
    Ok(segments)
}
