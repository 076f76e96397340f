//! Density-based clusters of points (DBSCAN: Ester, Kriegel, Sander & Xu, KDD 1996), periodic along
//! x.
//!
//! An implementation of its own because the cell is periodic.

use super::neighbourhood::{cells, separation};

/// Buffers of the search, reused from frame to frame.
#[derive(Debug, Default)]
pub struct Dbscan {
    core: Vec<bool>,
    stack: Vec<u32>,
}

impl Dbscan {
    /// Finds the cluster of every point and returns the number of clusters.
    ///
    /// - `length`: L_x (m); `epsilon`: ε (m); `points`: (m), wrapped into [0, L_x) along x.
    /// - `min_points`: minPts; a point with this many points within ε, itself included, is a core
    ///   point. With 1 there is no noise.
    /// - `labels`: result, as long as `points`; `None` for noise. Clusters are numbered by their
    ///   first core points. A point that is no core point belongs to the first cluster with a core
    ///   point within ε of it.
    pub fn clusters(
        &mut self,
        length: f64,
        epsilon: f64,
        min_points: usize,
        points: &[[f64; 2]],
        labels: &mut Vec<Option<u32>>,
    ) -> usize {
        let Dbscan { core, stack } = self;
        labels.clear();
        labels.resize(points.len(), None);
        if points.is_empty() {
            return 0;
        }
        let cells = cells(length, epsilon, points);
        let near = |i: usize, found: &mut dyn FnMut(usize)| {
            let [x, y] = points[i];
            cells.each_near(&[x, y, 0.0], |j| {
                let d = separation(length, points[i], points[j as usize]);
                if d[0] * d[0] + d[1] * d[1] <= epsilon * epsilon {
                    found(j as usize);
                }
            });
        };
        core.clear();
        core.extend((0..points.len()).map(|i| {
            let mut count = 0;
            near(i, &mut |_| count += 1);
            count >= min_points
        }));
        let mut clusters = 0;
        for first in 0..points.len() {
            if !core[first] || labels[first].is_some() {
                continue;
            }
            let label = Some(clusters);
            labels[first] = label;
            stack.push(first as u32);
            while let Some(i) = stack.pop() {
                near(i as usize, &mut |j| {
                    if labels[j].is_none() {
                        labels[j] = label;
                        if core[j] {
                            stack.push(j as u32);
                        }
                    }
                });
            }
            clusters += 1;
        }
        clusters as usize
    }
}
