//! GR regions: clusters of the grains whose contact forces decrease most between two frames (LH
//! sections 3.2 and 3.3).

use super::dbscan::Dbscan;
use super::forces;
use gshear_dem::dimension::{Dimensions, Three, Two};
use gshear_dem::state::{Frame, GrainConstants};

/// Share of all grains, those of the greatest reduction, that form the regions.
pub const SHARE: f64 = 0.01;
/// ε of the DBSCAN clusters over r̄.
pub const EPSILON: f64 = 5.0;

/// Number of points within ε that makes a core point. "A minimum requirement of 1 neighbor" in LH
/// section 3.2 can mean either.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MinPoints {
    /// minPts = 1, the point itself included: every grain of the greatest reduction belongs to a
    /// region.
    #[default]
    Itself,
    /// minPts = 2, the point and one neighbour: a single grain is noise and no region.
    OneNeighbour,
}

impl MinPoints {
    /// Both of them.
    pub const ALL: [MinPoints; 2] = [MinPoints::Itself, MinPoints::OneNeighbour];

    /// Returns minPts as DBSCAN counts it, the point itself included.
    pub fn count(self) -> usize {
        match self {
            MinPoints::Itself => 1,
            MinPoints::OneNeighbour => 2,
        }
    }
}

/// What the reduction of force of a grain is. LH section 3.2 say "particles experiencing the
/// greatest 1% reduction in inter-particle force magnitude", which can mean each of these.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reduction {
    /// The sum of the changes of |f| of its contacts: gains make up for losses.
    #[default]
    Net,
    /// The sum of the changes of those of its contacts that lose force.
    Losses,
    /// The change of the contact that loses most.
    GreatestLoss,
}

impl Reduction {
    /// All of them.
    pub const ALL: [Reduction; 3] = [Reduction::Net, Reduction::Losses, Reduction::GreatestLoss];

    /// Returns what a grain has lost, from what it had lost before and the change of one more of
    /// its contacts.
    fn with(self, before: f64, change: f64) -> f64 {
        match self {
            Reduction::Net => before + change,
            Reduction::Losses => before + change.min(0.0),
            Reduction::GreatestLoss => before.min(change),
        }
    }
}

/// How GR regions are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GrReading {
    /// The reduction that selects the grains.
    pub reduction: Reduction,
    /// minPts of the clusters.
    pub min_points: MinPoints,
}

/// The GR regions between two frames, with buffers reused from frame to frame.
#[derive(Debug, Default)]
pub struct Regions {
    changes: Vec<f64>,
    /// `[N]` Reduction of force of a grain (N/m), negative.
    reduction: Vec<f64>,
    points: Vec<[f64; 3]>,
    dbscan: Dbscan,
    /// By [`Reduction`].
    clusters: [Clusters; 3],
}

/// The grains of the greatest reduction, and their clusters by [`MinPoints`].
#[derive(Debug, Default)]
struct Clusters {
    grains: Vec<u32>,
    /// `[N]` Whether a grain is one of `grains`.
    within: Vec<bool>,
    labels: [Vec<Option<u32>>; 2],
    counts: [usize; 2],
}

impl Regions {
    /// Finds the grains of the greatest reduction and their clusters at the positions of the later
    /// frame, for every [`Reduction`].
    ///
    /// Contacts made or lost count as 0. The regions are made of 1 % of all grains N, rounded and
    /// at least one; among equals lower ids come first. Grains whose reduction is not negative
    /// never belong to a region.
    pub fn find(&mut self, grains: &GrainConstants, earlier: &Frame, later: &Frame) {
        forces::changes(earlier, later, &mut self.changes);
        for reduction in Reduction::ALL {
            self.reduction.clear();
            self.reduction.resize(grains.count(), 0.0);
            for (contact, change) in later.contacts.iter().zip(&self.changes) {
                for grain in [contact.i, contact.j] {
                    let lost = &mut self.reduction[grain as usize];
                    *lost = reduction.with(*lost, *change);
                }
            }
            self.cluster(grains, later, reduction);
        }
    }

    /// Writes the ids of the grains of the greatest reduction to `order`, ascending.
    fn choose(reduction: &[f64], order: &mut Vec<u32>) {
        let wanted = ((SHARE * reduction.len() as f64).round() as usize).max(1);
        order.clear();
        order.extend((0..reduction.len() as u32).filter(|n| reduction[*n as usize] < 0.0));
        if order.len() > wanted {
            order.select_nth_unstable_by(wanted, |a, b| {
                let [x, y] = [a, b].map(|n| reduction[*n as usize]);
                x.total_cmp(&y).then(a.cmp(b))
            });
            order.truncate(wanted);
        }
        order.sort_unstable();
    }

    fn cluster(&mut self, grains: &GrainConstants, later: &Frame, reduction: Reduction) {
        let clusters = &mut self.clusters[reduction as usize];
        Self::choose(&self.reduction, &mut clusters.grains);
        clusters.within.clear();
        clusters.within.resize(grains.count(), false);
        self.points.clear();
        for n in &clusters.grains {
            clusters.within[*n as usize] = true;
            self.points.push(later.position(*n as usize));
        }
        let epsilon = EPSILON * grains.mean_radius();
        for reading in MinPoints::ALL {
            let (cell, points) = (later.cell, &self.points);
            let (least, labels) = (reading.count(), &mut clusters.labels[reading as usize]);
            let dbscan = &mut self.dbscan;
            let count = match later.dimension {
                Dimensions::Two => dbscan.clusters::<Two>(cell, epsilon, least, points, labels),
                Dimensions::Three => dbscan.clusters::<Three>(cell, epsilon, least, points, labels),
            };
            clusters.counts[reading as usize] = count;
        }
    }

    /// Returns the ids of the grains of the greatest reduction, ascending.
    pub fn grains(&self, reduction: Reduction) -> &[u32] {
        &self.clusters[reduction as usize].grains
    }

    /// Returns the region of each of [`Self::grains`]; `None` for noise.
    pub fn labels(&self, reading: GrReading) -> &[Option<u32>] {
        &self.clusters[reading.reduction as usize].labels[reading.min_points as usize]
    }

    /// Returns the number of regions.
    pub fn count(&self, reading: GrReading) -> usize {
        self.clusters[reading.reduction as usize].counts[reading.min_points as usize]
    }

    /// Returns the differential force network (N/m), one value per contact of the later frame.
    pub fn changes(&self) -> &[f64] {
        &self.changes
    }

    /// Writes to `angles` |θ| (rad) of every contact of the later frame with at least one grain in
    /// a region.
    pub fn angles(&self, reduction: Reduction, later: &Frame, angles: &mut Vec<f64>) {
        let within = &self.clusters[reduction as usize].within;
        angles.clear();
        for contact in &later.contacts {
            if within[contact.i as usize] || within[contact.j as usize] {
                angles.push(forces::angle(later, contact));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{grains_of, pushed, touching};

    /// 300 grains in a row along x, 1 apart, each touching the next; contact k has the force
    /// `force(k)`.
    fn chain(force: impl Fn(u32) -> f64) -> Frame {
        let contact = |k: u32| pushed(k, k + 1, force(k), 0.0);
        let places: Vec<[f64; 2]> = (0..300).map(|k| [f64::from(k), 0.0]).collect();
        touching(300.0, &places, (0..299).map(contact).collect())
    }

    /// The regions of a chain whose contacts all had the force 10, and the number of angles in
    /// those by the net reduction, all along x. With a radius of 0.4, ε = 2 and 1 % are three
    /// grains.
    fn found(later: &Frame) -> (Regions, usize) {
        let grains = grains_of(&[0.4; 300]);
        let mut regions = Regions::default();
        regions.find(&grains, &chain(|_| 10.0), later);
        let mut angles = vec![1.0];
        regions.angles(NET, later, &mut angles);
        assert!(angles.iter().all(|angle| *angle == 0.0));
        (regions, angles.len())
    }

    const NET: Reduction = Reduction::Net;

    fn reading(reduction: Reduction, min_points: MinPoints) -> GrReading {
        GrReading {
            reduction,
            min_points,
        }
    }

    /// Numbers of regions with minPts = 1 and 2.
    fn counts(regions: &Regions, reduction: Reduction) -> [usize; 2] {
        MinPoints::ALL.map(|min_points| regions.count(reading(reduction, min_points)))
    }

    #[test]
    fn the_greatest_reduction_is_that_of_the_sum_over_a_grains_contacts() {
        // Contacts 100 and 101 weaken, so grain 101 loses twice; contact 200 weakens most, but its
        // neighbour gains as much.
        let (regions, angles) = found(&chain(|k| match k {
            100 | 101 => 7.0,
            200 => 5.0,
            201 => 15.0,
            _ => 10.0,
        }));
        // Grain 101: -6; 200: -5; then 100 and 102: -3 each, of which the lower id counts.
        assert_eq!(regions.grains(NET), [100, 101, 200]);
        let labels = MinPoints::ALL.map(|points| regions.labels(reading(NET, points)));
        assert_eq!(labels[0], [Some(0), Some(0), Some(1)]);
        assert_eq!(labels[1], [Some(0), Some(0), None]);
        assert_eq!(counts(&regions, NET), [2, 1]);
        // Contacts 99 to 101 and 199 and 200.
        assert_eq!(angles, 5);
    }

    #[test]
    fn losses_and_the_greatest_loss_are_not_made_up_for_by_gains() {
        // Grain 51 loses 4 + 4, grain 101 loses 7 and gains 9, its neighbours lose as little as
        // they gain; all others gain.
        let (regions, _) = found(&chain(|k| match k {
            50 | 51 => 6.0,
            100 => 3.0,
            101 => 19.0,
            _ => 10.5,
        }));
        // Net: -8 of grain 51, -6.5 of grain 100, then 50 and 52 with -3.5, of which the lower
        // id counts. Losses: -8 of 51, -7 of 100 and 101. Greatest loss: -7 of 100 and 101, then
        // 50, 51 and 52 with -4.
        let [net, losses, greatest] = Reduction::ALL.map(|reduction| regions.grains(reduction));
        assert_eq!(net, [50, 51, 100]);
        assert_eq!(losses, [51, 100, 101]);
        assert_eq!(greatest, [50, 100, 101]);
        let found = Reduction::ALL.map(|reduction| counts(&regions, reduction));
        assert_eq!(found, [[2, 1]; 3]);
        let labels = |reduction| regions.labels(reading(reduction, MinPoints::OneNeighbour));
        assert_eq!(labels(Reduction::Losses), [None, Some(0), Some(0)]);
    }

    #[test]
    fn regions_join_across_the_seam() {
        let (regions, _) = found(&chain(|k| match k {
            0 => 1.0,
            298 => 0.5,
            _ => 10.0,
        }));
        assert_eq!(regions.grains(NET), [0, 298, 299]);
        assert_eq!(counts(&regions, NET)[0], 1);
    }

    #[test]
    fn contacts_made_or_lost_and_forces_that_grow_make_no_region() {
        let mut later = chain(|_| 11.0);
        later.contacts.remove(50);
        later.contacts.insert(60, pushed(60, 70, 4.0, 0.0));
        let (regions, angles) = found(&later);
        assert_eq!(regions.grains(NET), [0; 0]);
        for reduction in Reduction::ALL {
            assert_eq!(counts(&regions, reduction), [0, 0]);
        }
        assert_eq!(angles, 0);
    }
}
