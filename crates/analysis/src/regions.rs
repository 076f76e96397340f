//! GR regions: clusters of the grains whose contact forces decrease most between two frames (LH
//! sections 3.2 and 3.3).

use super::dbscan::Dbscan;
use super::forces;
use gshear_dem::state::{Disks, Frame};

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
    /// Returns minPts as DBSCAN counts it, the point itself included.
    pub fn count(self) -> usize {
        match self {
            MinPoints::Itself => 1,
            MinPoints::OneNeighbour => 2,
        }
    }
}

/// The GR regions between two frames, with buffers reused from frame to frame.
#[derive(Debug, Default)]
pub struct Regions {
    changes: Vec<f64>,
    /// `[N]` Sum of the changes of |f| of a grain's contacts (N/m).
    reduction: Vec<f64>,
    order: Vec<u32>,
    grains: Vec<u32>,
    within: Vec<bool>,
    points: Vec<[f64; 2]>,
    dbscan: Dbscan,
    labels: [Vec<Option<u32>>; 2],
    counts: [usize; 2],
}

impl Regions {
    /// Finds the grains of the greatest reduction and their clusters at the positions of the later
    /// frame.
    ///
    /// A grain's reduction is the sum of the changes of |f| of its contacts; contacts made or lost
    /// count as 0. The regions are made of 1 % of all grains N, rounded and at least one; among
    /// equals lower ids come first. Grains whose sum is not negative never belong to a region.
    pub fn find(&mut self, grains: &Disks, earlier: &Frame, later: &Frame) {
        forces::changes(earlier, later, &mut self.changes);
        self.reduction.clear();
        self.reduction.resize(grains.count(), 0.0);
        for (contact, change) in later.contacts.iter().zip(&self.changes) {
            self.reduction[contact.i as usize] += change;
            self.reduction[contact.j as usize] += change;
        }
        self.choose();
        self.points.clear();
        let place = |n: &u32| later.position[*n as usize];
        self.points.extend(self.grains.iter().map(place));
        let epsilon = EPSILON * grains.mean_radius();
        for reading in [MinPoints::Itself, MinPoints::OneNeighbour] {
            let labels = &mut self.labels[reading as usize];
            let (length, points) = (grains.length, &self.points);
            self.counts[reading as usize] =
                self.dbscan
                    .clusters(length, epsilon, reading.count(), points, labels);
        }
    }

    fn choose(&mut self) {
        let Regions {
            reduction, order, ..
        } = self;
        let wanted = ((SHARE * reduction.len() as f64).round() as usize).max(1);
        order.clear();
        order.extend((0..reduction.len() as u32).filter(|n| reduction[*n as usize] < 0.0));
        let by_reduction = |a: &u32, b: &u32| {
            let [x, y] = [a, b].map(|n| reduction[*n as usize]);
            x.total_cmp(&y).then(a.cmp(b))
        };
        if order.len() > wanted {
            order.select_nth_unstable_by(wanted, by_reduction);
            order.truncate(wanted);
        }
        order.sort_unstable();
        self.grains.clear();
        self.grains.extend_from_slice(order);
        self.within.clear();
        self.within.resize(reduction.len(), false);
        for n in &self.grains {
            self.within[*n as usize] = true;
        }
    }

    /// Returns the ids of the grains of the greatest reduction, ascending.
    pub fn grains(&self) -> &[u32] {
        &self.grains
    }

    /// Returns the region of each of [`Self::grains`]; `None` for noise.
    pub fn labels(&self, reading: MinPoints) -> &[Option<u32>] {
        &self.labels[reading as usize]
    }

    /// Returns the number of regions.
    pub fn count(&self, reading: MinPoints) -> usize {
        self.counts[reading as usize]
    }

    /// Returns the differential force network (N/m), one value per contact of the later frame.
    pub fn changes(&self) -> &[f64] {
        &self.changes
    }

    /// Writes to `angles` |θ| (rad) of every contact of the later frame with at least one grain in
    /// a region.
    pub fn angles(&self, grains: &Disks, later: &Frame, angles: &mut Vec<f64>) {
        let within = |n: u32| self.within[n as usize];
        let contacts = later.contacts.iter();
        let of_regions = contacts.filter(|c| within(c.i) || within(c.j));
        angles.clear();
        angles.extend(of_regions.map(|contact| forces::angle(grains, later, contact)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{contact, grains_in};
    use gshear_dem::state::ContactSample;

    fn pressed(i: u32, j: u32, normal_force: f64) -> ContactSample {
        ContactSample {
            normal_force,
            ..contact(i, j)
        }
    }

    /// 300 grains in a row along x, 1 apart, each touching the next; contact k has the force
    /// `force(k)`.
    fn chain(force: impl Fn(u32) -> f64) -> Frame {
        Frame {
            position: (0..300).map(|k| [f64::from(k), 0.0]).collect(),
            contacts: (0..299).map(|k| pressed(k, k + 1, force(k))).collect(),
            ..Frame::default()
        }
    }

    #[test]
    fn the_greatest_reduction_is_that_of_the_sum_over_a_grains_contacts() {
        // With a radius of 0.4, ε = 2 and 1 % are three grains.
        let grains = grains_in(300.0, &[0.4; 300]);
        let earlier = chain(|_| 10.0);
        // Contacts 100 and 101 weaken, so grain 101 loses twice; contact 200 weakens most, but its
        // neighbour gains as much.
        let later = chain(|k| match k {
            100 | 101 => 7.0,
            200 => 5.0,
            201 => 15.0,
            _ => 10.0,
        });
        let mut regions = Regions::default();
        regions.find(&grains, &earlier, &later);
        // Grain 101: -6; 200: -5; then 100 and 102: -3 each, of which the lower id counts.
        assert_eq!(regions.grains(), [100, 101, 200]);
        assert_eq!(
            regions.labels(MinPoints::Itself),
            [Some(0), Some(0), Some(1)]
        );
        assert_eq!(
            regions.labels(MinPoints::OneNeighbour),
            [Some(0), Some(0), None]
        );
        assert_eq!(
            [MinPoints::Itself, MinPoints::OneNeighbour].map(|r| regions.count(r)),
            [2, 1]
        );
        let mut angles = Vec::new();
        regions.angles(&grains, &later, &mut angles);
        // Contacts 99 to 101 and 199 and 200, all along x.
        assert_eq!(angles, [0.0; 5]);
    }

    #[test]
    fn regions_join_across_the_seam() {
        let grains = grains_in(300.0, &[0.4; 300]);
        let earlier = chain(|_| 10.0);
        let mut later = chain(|k| if k == 0 || k == 298 { 1.0 } else { 10.0 });
        later.contacts.last_mut().expect("a contact").normal_force = 0.5;
        let mut regions = Regions::default();
        regions.find(&grains, &earlier, &later);
        assert_eq!(regions.grains(), [0, 298, 299]);
        assert_eq!(regions.count(MinPoints::Itself), 1);
    }

    #[test]
    fn contacts_made_or_lost_and_forces_that_grow_make_no_region() {
        let grains = grains_in(300.0, &[0.4; 300]);
        let earlier = chain(|_| 10.0);
        let mut later = chain(|_| 11.0);
        later.contacts.remove(50);
        later.contacts.insert(60, pressed(60, 70, 4.0));
        let mut regions = Regions::default();
        regions.find(&grains, &earlier, &later);
        assert_eq!(regions.grains(), [0; 0]);
        assert_eq!(
            [MinPoints::Itself, MinPoints::OneNeighbour].map(|r| regions.count(r)),
            [0, 0]
        );
        let mut angles = vec![1.0];
        regions.angles(&grains, &later, &mut angles);
        assert!(angles.is_empty());
    }
}
