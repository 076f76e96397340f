//! Paths of spheres: a flood of a grid of places from below a wall to above it.

use gshear_dem::state::length;

use super::{Sphere, Wall, greatest_radius};

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
    /// Places along x of a window: all, or as many as are held at once.
    window_width: usize,
    /// Places along x from one window to the next.
    window_distance: usize,
}

/// Whether a place was not reached, is inside of a grain, or from which neighbour it was reached.
const OPEN: u8 = 7;
const BLOCKED: u8 = 8;
/// A place at which a path begins.
const START: u8 = 6;

impl Pores {
    pub(super) fn new(wall: &Wall) -> Self {
        let radii = wall.spheres.iter().map(|sphere| sphere.radius);
        let least = radii.fold(f64::INFINITY, f64::min);
        let greatest = greatest_radius(&wall.spheres);
        let wall_spheres = wall.spheres.iter().filter(|sphere| sphere.is_wall);
        let wall_top = wall_spheres
            .map(|sphere| sphere.place[2] + sphere.radius)
            .fold(0.0, f64::max);
        // Above this no grain touches the wall.
        let top = wall_top + 3.0 * greatest;
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
            window_width: width.min(places[0]),
            window_distance: if width >= places[0] {
                places[0]
            } else {
                width - overlap
            },
        }
    }

    /// Where a sphere of this radius passes the wall.
    pub(super) fn through(&self, walls: &[bool], radius: f64) -> Option<[f64; 3]> {
        (0..self.places[0])
            .step_by(self.window_distance)
            .find_map(|first| self.through_window(first, walls, radius))
    }

    /// The same in the window of the places from the first one on along x.
    fn through_window(&self, first: usize, walls: &[bool], radius: f64) -> Option<[f64; 3]> {
        let size = [self.window_width, self.places[1], self.places[2]];
        let mut window = Window {
            pores: self,
            first,
            size,
            state: vec![OPEN; size.iter().product()],
        };
        // A path between places is not missed.
        let reach = radius - 0.5 * length(self.spacing);
        for (sphere, is_wall) in self.spheres.iter().zip(walls) {
            if *is_wall {
                window.block(sphere, sphere.radius + reach);
            }
        }
        let path = window.path()?;
        let lowest = path
            .iter()
            .find(|place| self.is_occupied(place, walls, radius));
        lowest.or(path.last()).copied()
    }

    /// Whether a free grain is where a sphere of this radius would be at this place.
    fn is_occupied(&self, place: &[f64; 3], walls: &[bool], radius: f64) -> bool {
        self.spheres.iter().zip(walls).any(|(sphere, is_wall)| {
            if *is_wall {
                return false;
            }
            let mut separation: [f64; 3] = std::array::from_fn(|k| sphere.place[k] - place[k]);
            for (x, period) in separation.iter_mut().zip(self.periods) {
                *x -= period * (*x / period).round();
            }
            length(separation) < sphere.radius + radius
        })
    }
}

/// Some of the places.
struct Window<'a> {
    pores: &'a Pores,
    first: usize,
    size: [usize; 3],
    state: Vec<u8>,
}

impl Window<'_> {
    /// Whether it is all of the wall, and its ends are neighbours.
    fn is_whole(&self) -> bool {
        self.size[0] == self.pores.places[0]
    }

    fn index(&self, at: [usize; 3]) -> usize {
        let [x, y, z] = at;
        (z * self.size[1] + y) * self.size[0] + x
    }

    fn place(&self, index: usize) -> [f64; 3] {
        let [nx, ny, _] = self.size;
        let at = [index % nx + self.first, index / nx % ny, index / (nx * ny)];
        std::array::from_fn(|axis| at[axis] as f64 * self.pores.spacing[axis])
    }

    /// Blocks the places nearer than this to the centre of a sphere.
    fn block(&mut self, sphere: &Sphere, reach: f64) {
        if reach <= 0.0 {
            return;
        }
        let spacing = self.pores.spacing;
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let center = sphere.place[axis];
            let first = ((center - reach) / spacing[axis]).ceil() as i64;
            let last = ((center + reach) / spacing[axis]).floor() as i64;
            first..=last
        });
        let highest = self.size[2] as i64 - 1;
        for k in z.filter(|k| (0..=highest).contains(k)) {
            for j in y.clone() {
                for i in x.clone() {
                    let at = [i, j, k];
                    let separation: [f64; 3] = std::array::from_fn(|axis| {
                        at[axis] as f64 * spacing[axis] - sphere.place[axis]
                    });
                    if length(separation) < reach {
                        self.block_place(at);
                    }
                }
            }
        }
    }

    /// Blocks a place, or the one in the cell whose image it is along x and y.
    fn block_place(&mut self, at: [i64; 3]) {
        let [i, j, k] = at;
        let along = (i - self.first as i64).rem_euclid(self.pores.places[0] as i64) as usize;
        let across = j.rem_euclid(self.size[1] as i64) as usize;
        if along < self.size[0] {
            let index = self.index([along, across, k as usize]);
            self.state[index] = BLOCKED;
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
