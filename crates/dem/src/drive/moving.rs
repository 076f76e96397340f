//! The boundary of a sample that is sheared.

use super::{Drive, GrainWalls, Images, LateralLengths, Top, WallForces};
use crate::boundary::Boundary;
use crate::dimension::Dimension;

/// A boundary, and how it moves.
#[derive(Debug)]
pub struct MovingBoundary {
    kind: &'static Boundary,
    /// The lower edge of the sample at the start (m), from which heights count.
    floor: f64,
    ends: Ends,
}

/// What moves.
#[derive(Debug)]
enum Ends {
    /// Walls. Nothing is a wall without grains, which rests.
    Walls(Box<GrainWalls>),
    /// The images of the sample.
    Images(Box<Images>),
}

impl MovingBoundary {
    /// A boundary whose top moves like this; `floor` (m): the lower edge of the sample at the
    /// start.
    pub fn new(kind: &'static Boundary, motion: Top, floor: f64) -> Self {
        let ends = if kind.is_periodic() {
            Ends::Images(Box::new(Images::new(motion)))
        } else {
            let mut walls = GrainWalls::new(motion);
            walls.flat = kind.planes([floor; 2]);
            Ends::Walls(Box::new(walls))
        };
        Self { kind, floor, ends }
    }

    /// Lets the lengths of a cell without walls change across its height.
    pub fn change_lengths(&mut self, lengths: LateralLengths) {
        if let Ends::Images(images) = &mut self.ends {
            images.lateral = Some(lengths);
        }
    }

    /// The lengths of a cell without walls across its height, if they change.
    pub fn lateral(&self) -> Option<&LateralLengths> {
        match &self.ends {
            Ends::Walls(_) => None,
            Ends::Images(images) => images.lateral.as_ref(),
        }
    }

    /// What it is.
    pub fn kind(&self) -> &'static Boundary {
        self.kind
    }

    /// The motion of the top, and what is imposed on the walls.
    pub fn top(&self) -> &Top {
        match &self.ends {
            Ends::Walls(walls) => &walls.motion,
            Ends::Images(images) => &images.motion,
        }
    }

    /// Ends a segment of the protocol after so many of its steps, which must not be over.
    pub fn end_segment(&mut self, segment: usize, steps: u64) {
        let motion = match &mut self.ends {
            Ends::Walls(walls) => &mut walls.motion,
            Ends::Images(images) => &mut images.motion,
        };
        motion.slider.protocol.end(segment, steps);
    }

    /// As the time step calls it.
    pub fn drive<D: Dimension>(&mut self) -> &mut dyn Drive<D> {
        match &mut self.ends {
            Ends::Walls(walls) => &mut **walls,
            Ends::Images(images) => &mut **images,
        }
    }

    /// The height (m) of the lower edge of the sample, or of the upper plane of a bottom wall of
    /// this thickness (m).
    pub fn bottom(&self, thickness: f64) -> f64 {
        self.floor + thickness + self.top().bottom_displacement()[1]
    }

    /// The heights (m) of the outer planes of the walls, which no free grain is to pass; infinite
    /// where nothing is, `None` without walls.
    pub fn heights(&self) -> Option<[f64; 2]> {
        if !self.kind.has_walls() {
            return None;
        }
        let top = self.floor + self.top().piston.height;
        Some(self.kind.ends([self.bottom(0.0), top]))
    }

    /// The stress of a cell without walls, times its base at the start, which stands for the forces
    /// on a wall; that of the last step at which it was measured.
    pub fn stress(&self) -> Option<WallForces> {
        match &self.ends {
            Ends::Walls(_) => None,
            Ends::Images(images) => Some(images.felt),
        }
    }
}
