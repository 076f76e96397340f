//! Events: clusters, in space and time, of grains that rearrange.
//!
//! A grain is active in an interval between two frames if its D²min (Falk & Langer, Phys. Rev. E
//! 57, 7192, 1998) is above a threshold. Active grains of an interval that are near each other
//! belong to one event, and so do those of intervals that follow each other. Elastoplastic models
//! (Nicolas, Ferrero, Martens & Barrat, Rev. Mod. Phys. 90, 045006, 2018) are made of such events,
//! and of their [`propagator`].

mod linked;
mod pairs;
pub mod propagator;
mod surroundings;

use std::collections::BTreeSet;

use gshear_dem::dimension::{Dimension, Dimensions, Three, Two};
use gshear_dem::neighbour::{Bins, LocalExtent};
use gshear_dem::state::{Cell, GrainConstants, length};

use self::linked::Linked;
pub use self::pairs::{PairCount, PairRange, pair_counts};
pub use self::surroundings::Surroundings;
use super::dmin::LocalStrain;
use super::interval::Interval;
use super::moments;

/// A grain that is active in an interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActiveGrain {
    /// Its id.
    pub grain: u32,
    /// D²min (m²).
    pub dmin: f64,
    /// The strain around it.
    pub strain: LocalStrain,
    /// Place in the earlier frame (m), wrapped.
    pub from: [f64; 3],
    /// Place in the later frame (m), wrapped.
    pub to: [f64; 3],
    /// How far it moves in the interval (m).
    pub displacement: [f64; 3],
}

/// The active grains of an interval between two frames.
#[derive(Debug, Clone, PartialEq)]
pub struct ActiveInterval {
    /// Its number in the row of all intervals.
    pub number: usize,
    /// The cell of the earlier frame.
    pub cell: Cell,
    /// In order of their ids.
    pub grains: Vec<ActiveGrain>,
}

impl ActiveInterval {
    /// The active grains of an interval. `number`: of the interval; `dmin`: id and D²min (m²) of
    /// each, in order of the ids; `strains`: around each.
    pub fn new(
        number: usize,
        interval: &Interval<'_>,
        dmin: &[(u32, f64)],
        strains: &[LocalStrain],
    ) -> Self {
        let grains = dmin.iter().zip(strains).map(|((grain, dmin), strain)| {
            let n = *grain as usize;
            ActiveGrain {
                grain: *grain,
                dmin: *dmin,
                strain: *strain,
                from: interval.earlier().position(n),
                to: interval.later().position(n),
                displacement: interval.displacement(n),
            }
        });
        Self {
            number,
            cell: interval.earlier().cell,
            grains: grains.collect(),
        }
    }
}

/// When active grains belong to one event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Links {
    /// Farthest distance of the centres of two grains of one event (m). Grains that touch are near
    /// each other, too.
    pub reach: f64,
    /// Greatest number of intervals without activity within an event.
    pub gap: usize,
}

/// An event.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Its first and its last interval.
    pub intervals: [usize; 2],
    /// Place (m), wrapped: the mean of the places of its active grains, weighted by their D²min.
    pub place: [f64; 3],
    /// Number of different grains.
    pub grains: usize,
    /// The active grains: their interval's place in the list of active intervals, and their own
    /// place in it.
    pub members: Vec<[usize; 2]>,
    /// Distance of the outermost centres along each axis (m).
    pub extent: [f64; 3],
    /// Radius of gyration of the centres (m).
    pub gyration: f64,
    /// The greatest D²min (m²).
    pub dmin_greatest: f64,
    /// Sum of D²min (m²).
    pub dmin_sum: f64,
    /// Sum of the invariants of the local strain.
    pub strain_sum: f64,
    /// Sum of the local shear strain along the imposed one.
    pub shear_strain_sum: f64,
}

/// Finds the events of a run, in order of their first active grain.
///
/// - `active`: the intervals with active grains, ascending.
/// - `dimension`: of the grains.
///
/// Two active grains of one interval are linked if they are near each other in its earlier frame:
/// within the reach, or in contact. A grain that is active in one interval and one that is active
/// in a later one are linked if they are near each other in the frame in which the first one ends
/// and the second one begins; with a gap, that of the second one's beginning counts. An event is
/// what is linked. Separations are followed from link to link, so an event that passes an edge of
/// the cell is not torn.
pub fn find(
    grains: &GrainConstants,
    active: &[ActiveInterval],
    links: Links,
    dimension: Dimensions,
) -> Vec<Event> {
    match dimension {
        Dimensions::Two => find_in::<Two>(grains, active, links),
        Dimensions::Three => find_in::<Three>(grains, active, links),
    }
}

fn find_in<D: Dimension>(
    grains: &GrainConstants,
    active: &[ActiveInterval],
    links: Links,
) -> Vec<Event> {
    let mut first = vec![0];
    for interval in active {
        first.push(first[first.len() - 1] + interval.grains.len());
    }
    let mut linked = Linked::new(first[active.len()]);
    let near = Near { grains, links };
    for (k, interval) in active.iter().enumerate() {
        near.within::<D>(interval, |i, j, separation| {
            linked.join(first[k] + i, first[k] + j, separation);
        });
        let following = active[k + 1..].iter().enumerate();
        for (ahead, later) in
            following.take_while(|(_, later)| later.number <= interval.number + 1 + links.gap)
        {
            near.between::<D>(interval, later, |i, j, separation| {
                linked.join(first[k] + i, first[k + 1 + ahead] + j, separation);
            });
        }
    }
    let clusters = linked.clusters().into_iter();
    let events = clusters.map(|cluster| {
        let members = cluster.iter().map(|(record, offset)| {
            let k = first.partition_point(|start| *start <= *record) - 1;
            Member {
                at: [k, record - first[k]],
                offset: *offset,
            }
        });
        event::<D>(active, &members.collect::<Vec<_>>())
    });
    events.collect()
}

/// An active grain of an event.
struct Member {
    /// As in [`Event::members`].
    at: [usize; 2],
    /// Its place relative to one point of the event (m).
    offset: [f64; 3],
}

fn event<D: Dimension>(active: &[ActiveInterval], members: &[Member]) -> Event {
    let grains: Vec<&ActiveGrain> = (members.iter())
        .map(|member| &active[member.at[0]].grains[member.at[1]])
        .collect();
    let numbers = members.iter().map(|member| active[member.at[0]].number);
    let dmin_sum: f64 = grains.iter().map(|grain| grain.dmin).sum();
    let count = members.len() as f64;
    let (mut weighted, mut extent, mut gyration) = ([0.0; 3], [0.0; 3], 0.0);
    for axis in 0..D::AXES {
        let offsets: Vec<f64> = members.iter().map(|member| member.offset[axis]).collect();
        let mean = offsets.iter().sum::<f64>() / count;
        let products = grains.iter().zip(&offsets).map(|(g, x)| g.dmin * x);
        // All D²min may be 0.
        weighted[axis] = if dmin_sum > 0.0 {
            products.sum::<f64>() / dmin_sum
        } else {
            mean
        };
        let [low, high] = moments::extent(offsets.iter().copied());
        extent[axis] = high - low;
        gyration += offsets.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count;
    }
    let anchor = &members[0];
    let mut place = grains[0].from;
    (0..D::AXES).for_each(|axis| place[axis] += weighted[axis] - anchor.offset[axis]);
    let cell = &active[anchor.at[0]].cell;
    let ids: BTreeSet<u32> = grains.iter().map(|grain| grain.grain).collect();
    Event {
        intervals: [
            numbers.clone().min().unwrap_or_default(),
            numbers.max().unwrap_or_default(),
        ],
        place: wrapped::<D>(cell, place),
        grains: ids.len(),
        members: members.iter().map(|member| member.at).collect(),
        extent,
        gyration: gyration.sqrt(),
        dmin_greatest: (grains.iter().map(|grain| grain.dmin)).fold(f64::NEG_INFINITY, f64::max),
        dmin_sum,
        strain_sum: grains.iter().map(|grain| grain.strain.invariant).sum(),
        shear_strain_sum: grains.iter().map(|grain| grain.strain.along).sum(),
    }
}

/// A place (m), wrapped into the cell.
fn wrapped<D: Dimension>(cell: &Cell, mut place: [f64; 3]) -> [f64; 3] {
    if let Some(sheared) = &cell.sheared {
        let images = (place[D::UP] / sheared.height).floor();
        place[D::UP] -= images * sheared.height;
        place[0] -= images * sheared.offset;
    }
    for (x, period) in place[..D::UP].iter_mut().zip(cell.periods) {
        *x = x.rem_euclid(period);
    }
    place
}

/// Finds active grains that are near each other.
struct Near<'a> {
    grains: &'a GrainConstants,
    links: Links,
}

impl Near<'_> {
    /// Calls `found` with the places of two grains of an interval in its list that are near each
    /// other, and their separation (m).
    fn within<D: Dimension>(
        &self,
        interval: &ActiveInterval,
        mut found: impl FnMut(usize, usize, [f64; 3]),
    ) {
        let places: Vec<[f64; 3]> = interval.grains.iter().map(|grain| grain.from).collect();
        let ids: Vec<u32> = interval.grains.iter().map(|grain| grain.grain).collect();
        self.each::<D>(interval.cell, &places, &ids, |i, j, separation| {
            if i < j {
                found(i, j, separation);
            }
        });
    }

    /// Calls `found` with the places of a grain of an interval and one of a later interval in their
    /// lists that are near each other, and their separation (m), from the earlier frame of the
    /// first interval to that of the second.
    fn between<D: Dimension>(
        &self,
        interval: &ActiveInterval,
        later: &ActiveInterval,
        mut found: impl FnMut(usize, usize, [f64; 3]),
    ) {
        let ends = interval.grains.iter().map(|grain| (grain.to, grain.grain));
        let starts = later.grains.iter().map(|grain| (grain.from, grain.grain));
        let (places, ids): (Vec<[f64; 3]>, Vec<u32>) = ends.chain(starts).unzip();
        let count = interval.grains.len();
        self.each::<D>(later.cell, &places, &ids, |i, j, mut separation| {
            if i < count && j >= count {
                let moved = interval.grains[i].displacement;
                (0..D::AXES).for_each(|axis| separation[axis] += moved[axis]);
                found(i, j - count, separation);
            }
        });
    }

    /// Calls `found` with each two places that are near each other, in both orders, and their
    /// separation (m). Places of removed grains are near none.
    fn each<D: Dimension>(
        &self,
        cell: Cell,
        places: &[[f64; 3]],
        ids: &[u32],
        mut found: impl FnMut(usize, usize, [f64; 3]),
    ) {
        if places.is_empty() {
            return;
        }
        let radii: Vec<f64> = ids
            .iter()
            .map(|id| self.grains.radius[*id as usize])
            .collect();
        let largest = radii.iter().copied().fold(0.0, f64::max);
        let cutoff = self.links.reach.max(2.0 * largest);
        let bins = Bins::<D>::new(cell, LocalExtent::whole(cell.periods[0]), cutoff, places);
        for (i, from) in places.iter().enumerate() {
            bins.each_near(from, |j| {
                let j = j as usize;
                let separation = cell.separation::<D>(&places[j], from);
                let touching = radii[i] + radii[j];
                if i != j && length(separation) <= self.links.reach.max(touching) {
                    found(i, j, separation);
                }
            });
        }
    }
}

#[cfg(test)]
mod tests;
