//! Density-based clusters of points (DBSCAN: Ester, Kriegel, Sander & Xu, KDD 1996) in a periodic
//! cell.
//!
//! An implementation of its own because the cell is periodic.

use gshear_dem::dimension::Dimension;
use gshear_dem::neighbour::{Bins, LocalExtent};
use gshear_dem::state::{Cell, length};

/// Buffers of the search, reused from frame to frame.
#[derive(Debug, Default)]
pub struct Dbscan {
    core: Vec<bool>,
    stack: Vec<u32>,
}

impl Dbscan {
    /// Finds the cluster of every point and returns the number of clusters.
    ///
    /// - `epsilon`: ε (m); `points`: (m), wrapped into `cell`.
    /// - `min_points`: minPts; a point with this many points within ε, itself included, is a core
    ///   point. With 1 there is no noise.
    /// - `labels`: result, as long as `points`; `None` for noise. Clusters are numbered by their
    ///   first core points. A point that is no core point belongs to the first cluster with a core
    ///   point within ε of it.
    pub fn clusters<D: Dimension>(
        &mut self,
        cell: Cell,
        epsilon: f64,
        min_points: usize,
        points: &[[f64; 3]],
        labels: &mut Vec<Option<u32>>,
    ) -> usize {
        let Dbscan { core, stack } = self;
        labels.clear();
        labels.resize(points.len(), None);
        if points.is_empty() {
            return 0;
        }
        let bins = Bins::<D>::new(cell, LocalExtent::whole(cell.periods[0]), epsilon, points);
        let near = |i: usize, found: &mut dyn FnMut(usize)| {
            bins.each_near(&points[i], |j| {
                let d = cell.separation::<D>(&points[j as usize], &points[i]);
                if length(d) <= epsilon {
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
