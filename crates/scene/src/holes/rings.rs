//! Paths of disks: a wall without a hole for a radius is a chain of disks around the period whose
//! gaps are narrower than a disk of that radius.

use super::{Wall, greatest_radius};

/// Half gaps up to which neighbours are sought, over the greatest radius.
const WIDEST: f64 = 3.0;

/// The gaps between the disks of a wall and above it, the narrowest first.
pub(super) struct Rings {
    gaps: Vec<Gap>,
    places: Vec<[f64; 3]>,
    count: usize,
}

#[derive(Debug, Clone, Copy)]
struct Gap {
    disks: [usize; 2],
    /// Periods by which the second disk is the image of the one in the cell.
    image: i64,
    /// The radius of the disk that just passes (m).
    half: f64,
    /// The middle of the gap.
    middle: [f64; 3],
}

impl Rings {
    pub(super) fn new(wall: &Wall) -> Self {
        let spheres = &wall.spheres;
        let greatest = greatest_radius(spheres);
        let length = wall.periods[0];
        let farthest = (2.0 + 2.0 * WIDEST) * greatest;
        // Along x, so that neighbours follow each other.
        let mut order: Vec<usize> = (0..spheres.len()).collect();
        order.sort_by(|a, b| spheres[*a].place[0].total_cmp(&spheres[*b].place[0]));
        let mut gaps = Vec::new();
        for (at, &i) in order.iter().enumerate() {
            // Once around the period, at most.
            for step in 1..=order.len() {
                let next = at + step;
                let (j, image) = (order[next % order.len()], (next / order.len()) as i64);
                let (a, b) = (&spheres[i], &spheres[j]);
                let along = b.place[0] + image as f64 * length - a.place[0];
                if along > farthest {
                    break;
                }
                let above = b.place[2] - a.place[2];
                let distance = along.hypot(above);
                let half = 0.5 * (distance - a.radius - b.radius);
                if half > WIDEST * greatest {
                    continue;
                }
                let part = (a.radius + half) / distance;
                gaps.push(Gap {
                    disks: [i, j],
                    image,
                    half,
                    middle: [a.place[0] + part * along, 0.0, a.place[2] + part * above],
                });
            }
        }
        gaps.sort_by(|a, b| a.half.total_cmp(&b.half).then(a.disks.cmp(&b.disks)));
        Self {
            gaps,
            places: spheres.iter().map(|sphere| sphere.place).collect(),
            count: spheres.len(),
        }
    }

    /// The widest gap of the chain whose widest gap is least, if a disk of this radius passes it.
    pub(super) fn through(&self, walls: &[bool], radius: f64) -> Option<[f64; 3]> {
        let mut chains = Chains::new(self.count);
        for gap in &self.gaps {
            let is_of_wall = gap.disks.iter().all(|disk| walls[*disk]);
            if is_of_wall && chains.join(gap) {
                return (gap.half >= radius).then_some(gap.middle);
            }
        }
        // No chain at all: over the lowest grain that is not of the wall.
        let free = (0..self.count).filter(|k| !walls[*k]);
        let lowest = free.min_by(|a, b| self.places[*a][2].total_cmp(&self.places[*b][2]));
        lowest.map(|k| self.places[k])
    }
}

/// Disks that are joined into chains.
struct Chains {
    parent: Vec<usize>,
    /// Periods from a disk to its parent.
    image: Vec<i64>,
}

impl Chains {
    fn new(count: usize) -> Self {
        Self {
            parent: (0..count).collect(),
            image: vec![0; count],
        }
    }

    /// The first disk of a chain, and how many periods the disk is from it.
    fn root(&mut self, mut disk: usize) -> (usize, i64) {
        let mut image = 0;
        while self.parent[disk] != disk {
            // Halves the way.
            let parent = self.parent[disk];
            self.image[disk] += self.image[parent];
            self.parent[disk] = self.parent[parent];
            image += self.image[disk];
            disk = self.parent[disk];
        }
        (disk, image)
    }

    /// Joins the chains of the two disks of a gap. Returns whether that closes a chain around the
    /// period.
    fn join(&mut self, gap: &Gap) -> bool {
        let [i, j] = gap.disks;
        let (root_i, image_i) = self.root(i);
        let (root_j, image_j) = self.root(j);
        if root_i == root_j {
            return image_j != image_i + gap.image;
        }
        self.parent[root_j] = root_i;
        self.image[root_j] = image_i + gap.image - image_j;
        false
    }
}
