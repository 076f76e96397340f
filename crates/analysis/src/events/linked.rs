//! Clusters of linked points, with the separations along the links.

/// Points in clusters (union–find), each with its place relative to the first one of its cluster.
pub(super) struct Linked {
    parent: Vec<usize>,
    /// Place relative to the parent (m).
    offset: Vec<[f64; 3]>,
}

impl Linked {
    /// Points that are not linked.
    pub fn new(count: usize) -> Self {
        Self {
            parent: (0..count).collect(),
            offset: vec![[0.0; 3]; count],
        }
    }

    /// The first point of the cluster of a point, and the place of the point relative to it.
    fn root(&mut self, point: usize) -> (usize, [f64; 3]) {
        let mut path = Vec::new();
        let mut root = point;
        while self.parent[root] != root {
            path.push(root);
            root = self.parent[root];
        }
        // From the root on.
        let mut place = [0.0; 3];
        for k in path.into_iter().rev() {
            place = sum(place, self.offset[k]);
            (self.parent[k], self.offset[k]) = (root, place);
        }
        (root, place)
    }

    /// Links two points with the separation from a to b.
    pub fn join(&mut self, a: usize, b: usize, separation: [f64; 3]) {
        let ((root_a, at_a), (root_b, at_b)) = (self.root(a), self.root(b));
        if root_a == root_b {
            return;
        }
        // Place of the root of b relative to that of a.
        let between = std::array::from_fn(|axis| at_a[axis] + separation[axis] - at_b[axis]);
        if root_a < root_b {
            (self.parent[root_b], self.offset[root_b]) = (root_a, between);
        } else {
            (self.parent[root_a], self.offset[root_a]) = (root_b, between.map(|x| -x));
        }
    }

    /// The clusters, in order of their first points: the points in order, and their places relative
    /// to the first.
    pub fn clusters(mut self) -> Vec<Vec<(usize, [f64; 3])>> {
        let mut number = vec![usize::MAX; self.parent.len()];
        let mut clusters: Vec<Vec<(usize, [f64; 3])>> = Vec::new();
        for point in 0..self.parent.len() {
            let (root, place) = self.root(point);
            if root == point {
                number[root] = clusters.len();
                clusters.push(Vec::new());
            }
            clusters[number[root]].push((point, place));
        }
        clusters
    }
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] + b[axis])
}
