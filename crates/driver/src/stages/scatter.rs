//! Grains at random places of a box, moved apart until their overlaps are within the contact law.

use gshear_dem::dimension::Dimension;
use gshear_dem::neighbour::{Bins, LocalExtent};
use gshear_dem::state::{Cell, length};

/// A grain and its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlacedGrain {
    pub radius: f64,
    pub position: [f64; 3],
}

/// Displacement of a grain in a step, over the sum of its overlaps. The scheme is stable up to
/// twice the reciprocal of the greatest eigenvalue of the network of contacts, some 0.2 for
/// random places.
const MOBILITY: f64 = 0.1;
/// The grains are settled if none moves further than this in a step, over the mean radius.
const SETTLED: f64 = 1e-4;
/// Steps after which they are given up.
const MOST_STEPS: u32 = 20_000;
/// Steps between two looks at whether the run is to stop.
const LOOK: u32 = 10;

/// Moves overlapping grains apart: overdamped motion under a repulsion of each pair that is its
/// overlap along the line of the centres, which takes any overlap, until the grains hardly move.
/// Returns the greatest overlap over what `largest_overlap` allows its two radii; `None` if
/// `asked`, called now and then, says that the run is to stop.
///
/// Every rank does the same with all grains.
///
/// # Errors
/// The number of steps, if the grains still move then.
pub(super) fn move_apart<D: Dimension>(
    grains: &mut [PlacedGrain],
    cell: Cell,
    largest_overlap: impl Fn(f64, f64) -> f64,
    asked: impl Fn() -> bool,
) -> Result<Option<f64>, u32> {
    let radii: Vec<f64> = grains.iter().map(|g| g.radius).collect();
    let cutoff = 2.0 * radii.iter().copied().fold(0.0, f64::max);
    let settled = SETTLED * radii.iter().sum::<f64>() / grains.len() as f64;
    let lengths = cell.lengths::<D>();
    let mut positions: Vec<[f64; 3]> = grains.iter().map(|g| g.position).collect();
    for step in 0..MOST_STEPS {
        if step.is_multiple_of(LOOK) && asked() {
            return Ok(None);
        }
        let bins = Bins::<D>::new(
            cell,
            LocalExtent::whole(cell.periods[0]),
            cutoff,
            &positions,
        );
        let mut greatest = 0.0f64;
        let mut pushes = vec![[0.0; 3]; grains.len()];
        for (a, push) in pushes.iter_mut().enumerate() {
            bins.each_near(&positions[a], |b| {
                let b = b as usize;
                let r = cell.separation::<D>(&positions[a], &positions[b]);
                let distance = length(r);
                let overlap = radii[a] + radii[b] - distance;
                if a == b || overlap <= 0.0 {
                    return;
                }
                greatest = greatest.max(overlap / largest_overlap(radii[a], radii[b]));
                if distance > 0.0 {
                    for axis in 0..D::AXES {
                        push[axis] += MOBILITY * overlap * r[axis] / distance;
                    }
                }
            });
        }
        if pushes.iter().all(|push| length(*push) <= settled) {
            for (grain, position) in grains.iter_mut().zip(&positions) {
                grain.position = *position;
            }
            return Ok(Some(greatest));
        }
        for (position, push) in positions.iter_mut().zip(&pushes) {
            for axis in 0..D::AXES {
                let wrapped = (position[axis] + push[axis]).rem_euclid(lengths[axis]);
                // A little below zero rounds to the period.
                position[axis] = if wrapped < lengths[axis] {
                    wrapped
                } else {
                    0.0
                };
            }
        }
    }
    Err(MOST_STEPS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gshear_dem::dimension::{Three, Two};
    use gshear_dem::state::Sheared;

    fn square(side: f64, planar: bool) -> Cell {
        Cell {
            periods: [side, if planar { f64::INFINITY } else { side }],
            sheared: Some(Sheared::upright(side)),
        }
    }

    fn at(position: [f64; 3]) -> PlacedGrain {
        PlacedGrain {
            radius: 0.5,
            position,
        }
    }

    /// Two grains across a seam move apart along the line of their centres until they hardly
    /// overlap: the push is then `MOBILITY` times the overlap.
    fn pair<D: Dimension>(planar: bool) {
        let up = D::UP;
        let mut grains = [at([1.0; 3]), at([1.0; 3])];
        (grains[0].position[up], grains[1].position[up]) = (0.1, 3.8);
        if planar {
            grains.iter_mut().for_each(|g| g.position[2] = 0.0);
        }
        let cell = square(4.0, planar);
        let greatest = move_apart::<D>(&mut grains, cell, |_, _| 0.25, || false);
        let greatest = greatest.expect("they settle").expect("to the end");
        let r = cell.separation::<D>(&grains[0].position, &grains[1].position);
        assert!(r[up] > 0.0 && r[..up].iter().all(|x| *x == 0.0), "{r:?}");
        let overlap = 1.0 - r[up];
        assert!((greatest - overlap / 0.25).abs() < 1e-12);
        let least = SETTLED * 0.5 / MOBILITY * (1.0 - 2.0 * MOBILITY);
        assert!(
            (least..=SETTLED * 0.5 / MOBILITY).contains(&overlap),
            "{overlap}"
        );
        assert!((grains[0].position[up] + grains[1].position[up] - 3.9).abs() < 1e-12);
    }

    #[test]
    fn two_grains_part_along_the_line_of_their_centres() {
        pair::<Two>(true);
        pair::<Three>(false);
    }

    /// Grains that touch nothing stay, to the last bit.
    #[test]
    fn grains_apart_stay() {
        let before = [at([0.2, 0.3, 0.4]), at([1.5, 1.7, 1.9])];
        let mut grains = before;
        let cell = square(4.0, false);
        let greatest = move_apart::<Three>(&mut grains, cell, |_, _| 0.25, || false);
        assert_eq!((greatest, grains), (Ok(Some(0.0)), before));
    }

    /// More grains than have room keep overlaps that the caller can refuse.
    #[test]
    fn what_overlaps_too_much_stays() {
        let place = |k: usize| at([0.37, 0.61, 0.83].map(|x| (x * k as f64 * k as f64) % 4.4));
        let mut grains: Vec<PlacedGrain> = (0..300).map(place).collect();
        let cell = square(4.4, false);
        let greatest = move_apart::<Three>(&mut grains, cell, |_, _| 0.25, || false);
        assert!(greatest.expect("they settle").expect("to the end") > 1.0);
    }
}
