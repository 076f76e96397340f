//! The motion of the drive along x: a sequence of velocities, each for a whole number of steps.

/// A sequence of velocities of the drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    /// Δt (s).
    step: f64,
    /// At least one.
    segments: Vec<Segment>,
}

/// Steps at one velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Steps before it.
    pub first: u64,
    /// Steps in it.
    pub steps: u64,
    /// Velocity of the drive (m/s); 0 is a hold.
    pub velocity: f64,
    /// Position of the drive at its start (m).
    pub position: f64,
}

impl Protocol {
    /// A protocol of velocities (m/s) with their numbers of steps, at least one; Δt is `step` (s).
    pub fn new(step: f64, parts: impl IntoIterator<Item = (f64, u64)>) -> Self {
        let (mut first, mut position) = (0, 0.0);
        let segment = |(velocity, steps)| {
            let segment = Segment {
                first,
                steps,
                velocity,
                position,
            };
            first += steps;
            position += velocity * (steps as f64 * step);
            segment
        };
        Self {
            step,
            segments: parts.into_iter().map(segment).collect(),
        }
    }

    /// The segments, one after the other.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Steps of all segments.
    pub fn steps(&self) -> u64 {
        self.segments.iter().map(|s| s.steps).sum()
    }

    /// The number of the segment that holds the step after `step` steps.
    pub fn segment_of(&self, step: u64) -> usize {
        self.segments.partition_point(|s| s.first <= step).max(1) - 1
    }

    fn segment(&self, step: u64) -> &Segment {
        &self.segments[self.segment_of(step)]
    }

    /// Velocity of the drive (m/s) in the step after `step` steps.
    pub fn velocity(&self, step: u64) -> f64 {
        self.segment(step).velocity
    }

    /// Position of the drive (m) after `step` steps.
    pub fn position(&self, step: u64) -> f64 {
        let segment = self.segment(step);
        segment.position + segment.velocity * ((step - segment.first) as f64 * self.step)
    }
}
