//! Which grains may come to touch: cells, then pairs.

use crate::state::{Grains, body, nearest_image};

/// The stretch of the periodic cell in which a rank has grains, its own and ghosts.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    /// L_x (m).
    pub length: f64,
    /// Start of the stretch (m); may be negative.
    pub from: f64,
    /// Its width (m), at most `length`.
    pub width: f64,
}

/// All pairs of local grains closer than R_i + R_j + `skin` (m), sorted by (lower id, higher id), each with the lower id first.
/// Left out: pairs of two ghosts (their ranks have them), and of two wall grains (they do not move against each other).
/// `reach` ≥ the greatest R_i + R_j + `skin`.
pub fn pairs(grains: &Grains, window: Window, reach: f64, skin: f64) -> Vec<[u32; 2]> {
    let local = grains.local();
    let x = |g: usize| grains.record[g].0[0];
    let y = |g: usize| grains.record[g].0[1];

    // Cells: columns along x over the whole period, of which this rank keeps a window; rows along y.
    let all_columns = ((window.length / reach) as usize).max(1);
    let column_width = window.length / all_columns as f64;
    let first = (window.from / column_width).floor() as i64 - 1;
    let columns = ((window.width / column_width) as usize + 4).min(all_columns);
    let periodic = columns == all_columns;
    let (low, high) = (0..local).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), g| {
        (a.min(y(g)), b.max(y(g)))
    });
    let rows = (((high - low) / reach) as usize).max(1);
    let row_height = (high - low) / rows as f64;
    let cell = |g: usize| {
        let absolute = ((x(g) / column_width) as i64).min(all_columns as i64 - 1);
        let column = (absolute - first).rem_euclid(all_columns as i64) as usize;
        let row = ((y(g) - low) / row_height) as usize;
        column.min(columns - 1) * rows + row.min(rows - 1)
    };

    // Grains by cell, in counting order.
    let mut start = vec![0u32; columns * rows + 1];
    let cells: Vec<u32> = (0..local).map(|g| cell(g) as u32).collect();
    for &k in &cells {
        start[k as usize + 1] += 1;
    }
    for k in 1..start.len() {
        start[k] += start[k - 1];
    }
    let mut member = vec![0u32; local];
    let mut next = start.clone();
    for (g, &k) in cells.iter().enumerate() {
        member[next[k as usize] as usize] = g as u32;
        next[k as usize] += 1;
    }

    let mut by_id: Vec<u32> = (0..local as u32).collect();
    by_id.sort_unstable_by_key(|&g| grains.id[g as usize]);

    let mut pairs = Vec::with_capacity(3 * local);
    let mut near = Vec::with_capacity(3);
    for &a in &by_id {
        let g = a as usize;
        let (id, x_g, y_g) = (grains.id[g], x(g), y(g));
        let (column, row) = (cells[g] as usize / rows, cells[g] as usize % rows);
        near.clear();
        near.push(column);
        for neighbour in [column.checked_sub(1), Some(column + 1)] {
            let wrapped = match neighbour {
                Some(k) if k < columns => k,
                _ if !periodic => continue,
                None => columns - 1,
                Some(_) => 0,
            };
            if !near.contains(&wrapped) {
                near.push(wrapped);
            }
        }
        let begin = pairs.len();
        for &k in &near {
            let from = start[k * rows + row.saturating_sub(1)] as usize;
            let to = start[k * rows + (row + 2).min(rows)] as usize;
            for &b in &member[from..to] {
                let h = b as usize;
                if grains.id[h] <= id
                    || (g >= grains.owned && h >= grains.owned)
                    || (grains.body[g] != body::FREE && grains.body[h] != body::FREE)
                {
                    continue;
                }
                let dx = nearest_image(x(h) - x_g, window.length);
                let dy = y(h) - y_g;
                let range = grains.radius[g] + grains.radius[h] + skin;
                if dx * dx + dy * dy < range * range {
                    pairs.push([a, b]);
                }
            }
        }
        pairs[begin..].sort_unstable_by_key(|p| grains.id[p[1] as usize]);
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::GrainState;
    use bytemuck::Zeroable;

    /// Against all pairs, in narrow and wide cells, with ghosts.
    #[test]
    fn finds_what_a_search_over_all_pairs_finds() {
        for (length, count, owned) in [
            (2.5, 12, 12),
            (5.0, 60, 60),
            (20.0, 300, 300),
            (20.0, 300, 180),
        ] {
            let mut seed = 7u64;
            let mut random = || {
                seed = seed
                    .wrapping_mul(6364136223846793005)
                    .wrapping_add(1442695040888963407);
                (seed >> 11) as f64 / (1u64 << 53) as f64
            };
            let states: Vec<GrainState> = (0..count)
                .map(|id| GrainState {
                    id,
                    body: u32::from(random() < 0.1),
                    position: [length * random(), 15.0 * random()],
                    radius: 0.25 + 0.25 * random(),
                    ..GrainState::zeroed()
                })
                .collect();
            let mut grains = Grains::default();
            grains.replace(&states[..owned], 1.0, 1.0);
            for ghost in &states[owned..] {
                grains.push(ghost);
            }
            let window = Window {
                length,
                from: 0.0,
                width: length,
            };
            let found = pairs(&grains, window, 1.1, 0.1);
            let mut expected = Vec::new();
            for a in 0..states.len() {
                for b in a + 1..states.len() {
                    let (p, q) = (&states[a], &states[b]);
                    let dx = p.position[0] - q.position[0];
                    let dx = dx.abs().min(length - dx.abs());
                    let dy = p.position[1] - q.position[1];
                    let both_ghosts = a >= owned && b >= owned;
                    let both_wall = p.body != 0 && q.body != 0;
                    if dx.hypot(dy) < p.radius + q.radius + 0.1 && !both_ghosts && !both_wall {
                        expected.push([a as u32, b as u32]);
                    }
                }
            }
            assert!(!expected.is_empty());
            assert_eq!(found, expected);
        }
    }
}
