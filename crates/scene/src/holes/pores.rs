//! Paths of spheres: a flood of a grid of places from below a wall to above it.

use gshear_dem::state::length;

use super::{Sphere, Wall};

/// Places on the smallest radius.
const FINE: f64 = 8.0;
/// Places that are held at once, about.
const MOST_PLACES: f64 = 4e7;
/// How far windows of a long wall overlap, over the greatest radius; a path does not turn aside by
/// more.
const OVERLAP: f64 = 8.0;

/// The grid around a wall.
pub(super) struct Pores {
    spheres: Vec<Sphere>,
    /// Lengths along x and y (m).
    periods: [f64; 2],
    /// Distance of places (m), along each axis.
    spacing: [f64; 3],
    /// Places along each axis; the lowest are at the outer plane of the wall.
    places: [usize; 3],
    /// Places along x of a window, and how far windows are apart. All at once: the same as all.
    window: [usize; 2],
}

/// Whether a place was not reached, is inside of a grain, or from which neighbour it was reached.
const OPEN: u8 = 7;
const BLOCKED: u8 = 8;
/// A place at which a path begins.
const START: u8 = 6;

impl Pores {
    pub(super) fn new(wall: &Wall) -> Self {
        let of_walls = || wall.spheres.iter().filter(|of| of.is_wall);
        let least = wall
            .spheres
            .iter()
            .map(|of| of.radius)
            .fold(f64::INFINITY, f64::min);
        let greatest = wall.spheres.iter().map(|of| of.radius).fold(0.0, f64::max);
        // Above this no grain touches the wall.
        let top = of_walls()
            .map(|of| of.place[2] + of.radius)
            .fold(0.0, f64::max)
            + 3.0 * greatest;
        let lengths = [wall.periods[0], wall.periods[1], top];
        let places = lengths.map(|length| (length * FINE / least).ceil().max(4.0) as usize);
        let spacing = [0, 1, 2].map(|axis| lengths[axis] / places[axis] as f64);
        let slice = (places[1] * places[2]) as f64;
        let overlap = (OVERLAP * greatest / spacing[0]).ceil() as usize;
        let width = ((MOST_PLACES / slice) as usize).max(3 * overlap);
        Self {
            spheres: wall.spheres.clone(),
            periods: wall.periods,
            spacing,
            places,
            window: if width >= places[0] {
                [places[0]; 2]
            } else {
                [width, width - overlap]
            },
        }
    }

    /// Where a sphere of this radius passes the wall.
    pub(super) fn through(&self, walls: &[bool], radius: f64) -> Option<[f64; 3]> {
        let [width, apart] = self.window;
        let mut first = 0;
        while first < self.places[0] {
            if let Some(place) = self.through_window([first, width], walls, radius) {
                return Some(place);
            }
            first += apart;
        }
        None
    }

    /// The same in the places from the first one on along x, so many.
    fn through_window(
        &self,
        [first, width]: [usize; 2],
        walls: &[bool],
        radius: f64,
    ) -> Option<[f64; 3]> {
        let mut window = Window {
            of: self,
            first,
            size: [width, self.places[1], self.places[2]],
            state: vec![OPEN; width * self.places[1] * self.places[2]],
        };
        // A path between places is not missed.
        let reach = radius - 0.5 * length(self.spacing);
        for (sphere, _) in self.spheres.iter().zip(walls).filter(|(_, wall)| **wall) {
            window.block(sphere, sphere.radius + reach);
        }
        let path = window.path()?;
        // The lowest place at which a grain is on the way now.
        let on_the_way = |place: &[f64; 3]| {
            let free = self.spheres.iter().zip(walls).filter(|(_, wall)| !**wall);
            free.into_iter().any(|(of, _)| {
                let mut apart: [f64; 3] = std::array::from_fn(|k| of.place[k] - place[k]);
                for (x, period) in apart.iter_mut().zip(self.periods) {
                    *x -= period * (*x / period).round();
                }
                length(apart) < of.radius + radius
            })
        };
        path.iter()
            .find(|place| on_the_way(place))
            .or(path.last())
            .copied()
    }
}

/// Some of the places.
struct Window<'a> {
    of: &'a Pores,
    first: usize,
    size: [usize; 3],
    state: Vec<u8>,
}

impl Window<'_> {
    /// Whether it is all of the wall, and its ends are neighbours.
    fn is_whole(&self) -> bool {
        self.size[0] == self.of.places[0]
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    fn place(&self, index: usize) -> [f64; 3] {
        let [nx, ny, _] = self.size;
        let at = [index % nx + self.first, index / nx % ny, index / (nx * ny)];
        std::array::from_fn(|axis| at[axis] as f64 * self.of.spacing[axis])
    }

    /// Blocks the places nearer than this to the centre of a sphere.
    fn block(&mut self, sphere: &Sphere, reach: f64) {
        if reach <= 0.0 {
            return;
        }
        let spacing = self.of.spacing;
        let range = |axis: usize| {
            let center = sphere.place[axis];
            let first = ((center - reach) / spacing[axis]).ceil() as i64;
            let last = ((center + reach) / spacing[axis]).floor() as i64;
            (first, last)
        };
        let (x, y, z) = (range(0), range(1), range(2));
        for k in z.0.max(0)..=z.1.min(self.size[2] as i64 - 1) {
            for j in y.0..=y.1 {
                for i in x.0..=x.1 {
                    let at = [i, j, k];
                    let apart: [f64; 3] = std::array::from_fn(|axis| {
                        at[axis] as f64 * spacing[axis] - sphere.place[axis]
                    });
                    if length(apart) >= reach {
                        continue;
                    }
                    let along =
                        (i - self.first as i64).rem_euclid(self.of.places[0] as i64) as usize;
                    let across = j.rem_euclid(self.size[1] as i64) as usize;
                    if along < self.size[0] {
                        let index = self.index([along, across, k as usize]);
                        self.state[index] = BLOCKED;
                    }
                }
            }
        }
    }

    /// A way from the lowest places to the highest ones, the lowest first.
    fn path(&mut self) -> Option<Vec<[f64; 3]>> {
        let layer = self.size[0] * self.size[1];
        let highest = self.state.len() - layer;
        let mut reached: Vec<usize> = Vec::new();
        for index in 0..layer {
            if self.state[index] == OPEN {
                self.state[index] = START;
                reached.push(index);
            }
        }
        let mut done = 0;
        while let Some(&index) = reached.get(done) {
            done += 1;
            if index >= highest {
                return Some(self.back(index));
            }
            for to in 0..6u8 {
                if let Some(next) = self.neighbour(index, to)
                    && self.state[next] == OPEN
                {
                    // From the other side.
                    self.state[next] = to ^ 1;
                    reached.push(next);
                }
            }
        }
        None
    }

    /// The way by which a place was reached, from its start.
    fn back(&self, end: usize) -> Vec<[f64; 3]> {
        let mut index = end;
        let mut path = vec![self.place(index)];
        while self.state[index] != START {
            let before = self.neighbour(index, self.state[index]);
            index = before.expect("it was reached from there");
            path.push(self.place(index));
        }
        path.reverse();
        path
    }

    /// The place beside another one: 0 and 1 along x, 2 and 3 along y, 4 and 5 upwards.
    fn neighbour(&self, index: usize, to: u8) -> Option<usize> {
        let [nx, ny, nz] = self.size;
        let mut at = [index % nx, index / nx % ny, index / (nx * ny)];
        let axis = usize::from(to / 2);
        let size = [nx, ny, nz][axis];
        let is_periodic = axis == 1 || axis == 0 && self.is_whole();
        let next = if to % 2 == 1 {
            at[axis] + 1
        } else {
            at[axis].wrapping_sub(1)
        };
        at[axis] = match next {
            next if next < size => next,
            _ if !is_periodic => return None,
            _ if to % 2 == 1 => 0,
            _ => size - 1,
        };
        Some(self.index(at))
    }
}
