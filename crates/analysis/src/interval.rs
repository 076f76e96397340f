//! Two frames of a run, between which grains are followed.

use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::state::{BoxEdges, Frame};

/// Two frames of a run, and how grains are followed from one to the other.
#[derive(Debug, Clone, Copy)]
pub struct Interval<'a> {
    /// The earlier and the later frame.
    pub frames: [&'a Frame; 2],
    /// Periods that were taken from the Lees–Edwards offset in between; see
    /// [`gshear_dem::state::Cell::shear`].
    pub periods: i64,
}

impl<'a> Interval<'a> {
    /// Between two frames of a run between walls, the earlier first.
    pub fn between_walls(frames: [&'a Frame; 2]) -> Self {
        Self { frames, periods: 0 }
    }

    /// The earlier frame.
    pub fn earlier(&self) -> &'a Frame {
        self.frames[0]
    }

    /// The later frame.
    pub fn later(&self) -> &'a Frame {
        self.frames[1]
    }

    /// The edges of the later cell, with the whole Lees–Edwards offset since the earlier frame (m).
    pub(crate) fn later_edges<D: Dimension>(&self) -> BoxEdges {
        let mut edges = self.later().cell.edges::<D>(0.0);
        edges[D::UP][0] += self.periods as f64 * edges[0][0];
        edges
    }

    /// Returns how far the copy of a grain moves that is inside the box in the earlier frame (m).
    pub fn displacement(&self, grain: usize) -> [f64; 3] {
        match self.later().dimension {
            Dimensions::Two => self.displacement_in::<Two>(grain),
            Dimensions::Three => self.displacement_in::<Three>(grain),
        }
    }

    /// [`Self::displacement`] in so many dimensions.
    pub(crate) fn displacement_in<D: Dimension>(&self, grain: usize) -> [f64; 3] {
        let [from, to] = self.frames.map(|frame| &frame.grains[grain]);
        let mut crossed: [i64; 3] = std::array::from_fn(|axis| to.image[axis] - from.image[axis]);
        crossed[0] -= self.periods * from.image[D::UP];
        self.later()
            .cell
            .displacement::<D>(&to.position, &from.position, crossed)
    }
}
