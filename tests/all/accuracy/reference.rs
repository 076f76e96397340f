//! The law and the equations of motion once more, sharing nothing with the program: k_n by
//! iteration of the implicit A2, k_t from A8 and A9 as printed, and the ordinary differential
//! equations of a few disks by extrapolation (Gragg, Bulirsch and Stoer, order 14), piece by piece
//! between the switches of regime, which are located by bisection.

use std::f64::consts::PI;

/// Material and coefficients of LH appendix A.
#[derive(Debug, Clone, Copy)]
pub struct Law {
    /// E (Pa).
    pub young_modulus: f64,
    /// ν.
    pub poisson_ratio: f64,
    /// ρ (kg/m³).
    pub density: f64,
    /// μ_s.
    pub friction: f64,
    /// μ_r.
    pub rolling_friction: f64,
    /// α.
    pub damping_ratio: f64,
    /// η_r.
    pub rolling_damping_ratio: f64,
}

impl Law {
    /// πE* (Pa), A3.
    pub fn modulus(&self) -> f64 {
        let compliance = (1.0 - self.poisson_ratio.powi(2)) / self.young_modulus;
        PI / (compliance + compliance)
    }

    pub fn mass(&self, r: f64) -> f64 {
        self.density * PI * r * r
    }

    /// k_n (A2) and k_t (A8, A9) in Pa at the overlap δ (m); 0 where there is none.
    pub fn stiffnesses(&self, r1: f64, r2: f64, overlap: f64) -> [f64; 2] {
        if overlap <= 0.0 {
            return [0.0, 0.0];
        }
        let modulus = self.modulus();
        let r_star = 1.0 / (1.0 / r1 + 1.0 / r2);
        let half_width = |k_n: f64| (4.0 * k_n * overlap * r_star / modulus).sqrt();
        let mut k_n = 0.1 * modulus;
        // Each round takes the error down by a factor 1/(ln(16 R1R2/a²) - 1) < 0.25.
        for _ in 0..60 {
            let a = half_width(k_n);
            let next = modulus / ((4.0 * r1 / a).ln() + (4.0 * r2 / a).ln() - 1.0);
            let change = (next - k_n).abs();
            k_n = next;
            if change < 3e-16 * k_n {
                break;
            }
        }
        let a = half_width(k_n);
        let nu = self.poisson_ratio;
        let w = |r: f64| {
            let q = a / r;
            0.22 + 2.89 * q + 0.18 * nu - 10.31 * q * q + 1.75 * q * nu + 0.36 * nu * nu
        };
        let side = |r: f64| w(r) * ((4.0 * r / a).ln() + nu / (2.0 * (1.0 - nu)));
        let compliance = (2.0 * r1 / a).ln() + (2.0 * r2 / a).ln() + 1.0 + side(r1) + side(r2);
        [k_n, modulus / compliance]
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Disk {
    pub radius: f64,
    /// Moved by forces; else its velocity stays.
    pub free: bool,
}

/// In which branch of the law a pair is. Signs: of the force or torque at its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Regime {
    Apart,
    /// F_n > 0.
    Pressed {
        sliding: Option<f64>,
        rolling_limit: Option<f64>,
    },
    /// Still overlapping, while damping would pull: F_n = 0.
    Released,
}

pub const STICKING: Regime = Regime::Pressed {
    sliding: None,
    rolling_limit: None,
};

#[derive(Debug, Clone, Copy)]
pub struct Pair {
    pub i: usize,
    pub j: usize,
    pub regime: Regime,
}

/// Disks and pairs. The state is one vector: x, y, u, v, ω of every disk, then F_t^e and M^k of
/// every pair.
#[derive(Debug, Clone)]
pub struct World {
    pub law: Law,
    pub disks: Vec<Disk>,
    pub pairs: Vec<Pair>,
    /// Longest step of the extrapolation (s).
    pub longest: f64,
    /// Switches of regime so far, with their times (s).
    pub switches: Vec<(f64, usize, Regime)>,
}

/// What a pair does at a state.
#[derive(Debug, Clone, Copy)]
pub struct Touch {
    pub n: [f64; 2],
    pub overlap: f64,
    pub v_n: f64,
    pub v_t: f64,
    pub k_t: f64,
    /// Without the clamp at 0.
    pub normal: f64,
    pub tangential: f64,
    pub rolling: f64,
}

impl World {
    pub fn place_of_pair(&self, p: usize) -> usize {
        5 * self.disks.len() + 2 * p
    }

    pub fn touch(&self, s: &[f64], p: usize) -> Touch {
        let pair = self.pairs[p];
        let (i, j) = (
            &s[5 * pair.i..5 * pair.i + 5],
            &s[5 * pair.j..5 * pair.j + 5],
        );
        let (r_i, r_j) = (self.disks[pair.i].radius, self.disks[pair.j].radius);
        let law = &self.law;
        let (dx, dy) = (i[0] - j[0], i[1] - j[1]);
        let distance = dx.hypot(dy);
        let (n, t) = (
            [dx / distance, dy / distance],
            [-dy / distance, dx / distance],
        );
        let overlap = r_i + r_j - distance;
        let (du, dv) = (i[2] - j[2], i[3] - j[3]);
        let v_n = du * n[0] + dv * n[1];
        let v_t = du * t[0] + dv * t[1] - (r_i * i[4] + r_j * j[4]);
        let spin = i[4] - j[4];
        let [k_n, k_t] = law.stiffnesses(r_i, r_j, overlap);
        let (m_i, m_j) = (law.mass(r_i), law.mass(r_j));
        let m = 1.0 / (1.0 / m_i + 1.0 / m_j);
        let alpha = law.damping_ratio;
        let normal = k_n * overlap - 2.0 * alpha * (k_n * m).sqrt() * v_n;
        // A15, A16, A20 to A22; the moment about the contact is I + mR² = (3/2) mR².
        let r_r = r_i * r_j / (r_i + r_j);
        let k_r = law.modulus() * r_r * r_r / 4.0;
        let about = |m: f64, r: f64| 0.5 * m * r * r + m * r * r;
        let i_r = 1.0 / (1.0 / about(m_i, r_i) + 1.0 / about(m_j, r_j));
        let c_r = law.rolling_damping_ratio * 2.0 * (i_r * k_r).sqrt();
        let at = self.place_of_pair(p);
        let (tangential, rolling) = match pair.regime {
            Regime::Pressed {
                sliding,
                rolling_limit,
            } => (
                match sliding {
                    None => s[at] - 2.0 * alpha * (k_t * m).sqrt() * v_t,
                    Some(sign) => sign * law.friction * normal,
                },
                match rolling_limit {
                    None => s[at + 1] - c_r * spin,
                    Some(sign) => sign * law.rolling_friction * r_r * normal,
                },
            ),
            _ => (0.0, 0.0),
        };
        Touch {
            n,
            overlap,
            v_n,
            v_t,
            k_t,
            normal,
            tangential,
            rolling,
        }
    }

    fn rolling_stiffness(&self, p: usize) -> (f64, f64) {
        let (r_i, r_j) = (
            self.disks[self.pairs[p].i].radius,
            self.disks[self.pairs[p].j].radius,
        );
        let r_r = r_i * r_j / (r_i + r_j);
        (r_r, self.law.modulus() * r_r * r_r / 4.0)
    }

    fn derivative(&self, s: &[f64]) -> Vec<f64> {
        let mut d = vec![0.0; s.len()];
        for k in 0..self.disks.len() {
            d[5 * k] = s[5 * k + 2];
            d[5 * k + 1] = s[5 * k + 3];
        }
        for (p, pair) in self.pairs.iter().enumerate() {
            let Regime::Pressed {
                sliding,
                rolling_limit,
            } = pair.regime
            else {
                continue;
            };
            let c = self.touch(s, p);
            let (r_i, r_j) = (self.disks[pair.i].radius, self.disks[pair.j].radius);
            let (fx, fy) = (
                c.normal * c.n[0] - c.tangential * c.n[1],
                c.normal * c.n[1] + c.tangential * c.n[0],
            );
            for (k, sign, r, torque) in [
                (pair.i, 1.0, r_i, c.rolling - r_i * c.tangential),
                (pair.j, -1.0, r_j, -c.rolling - r_j * c.tangential),
            ] {
                if self.disks[k].free {
                    let m = self.law.mass(r);
                    d[5 * k + 2] += sign * fx / m;
                    d[5 * k + 3] += sign * fy / m;
                    d[5 * k + 4] += torque / (0.5 * m * r * r);
                }
            }
            let at = self.place_of_pair(p);
            if sliding.is_none() {
                d[at] = -c.k_t * c.v_t;
            }
            if rolling_limit.is_none() {
                let spin = s[5 * pair.i + 4] - s[5 * pair.j + 4];
                d[at + 1] = -self.rolling_stiffness(p).1 * spin;
            }
        }
        d
    }

    /// What one step of the extrapolated midpoint rule adds. Extrapolation magnifies rounding some
    /// 60 times, so it works on these differences, not on the coordinates.
    fn increment(&self, s: &[f64], h: f64) -> Vec<f64> {
        const ROWS: usize = 7;
        let slope = self.derivative(s);
        // Row k of the tableau; each column takes one more even power of the step away.
        let mut before: Vec<Vec<f64>> = Vec::new();
        for k in 0..ROWS {
            let n = 2 * (k + 1);
            let small = h / n as f64;
            let mut last = vec![0.0; s.len()];
            let mut now = sum(&last, &slope, small);
            for _ in 1..n {
                let next = sum(&last, &self.derivative(&sum(s, &now, 1.0)), 2.0 * small);
                last = std::mem::replace(&mut now, next);
            }
            let mut row = vec![now];
            for c in 0..k {
                let ratio = ((k + 1) as f64 / (k - c) as f64).powi(2);
                let difference = sum(&row[c], &before[c], -1.0);
                row.push(sum(&row[c], &difference, 1.0 / (ratio - 1.0)));
            }
            before = row;
        }
        before.swap_remove(ROWS - 1)
    }

    fn step(&self, s: &[f64], h: f64) -> Vec<f64> {
        sum(s, &self.increment(s, h), 1.0)
    }

    /// The law has a logarithm at δ = 0: steps stay short against the time to it.
    fn length_of_step(&self, s: &[f64]) -> f64 {
        let (mut h, mut least) = (self.longest, 0.0f64);
        for (p, pair) in self.pairs.iter().enumerate() {
            if matches!(pair.regime, Regime::Pressed { .. }) {
                let c = self.touch(s, p);
                h = h.min(0.3 * (c.overlap / c.v_n).abs());
                // Some hundred times the rounding of a coordinate.
                let size = self.disks[pair.i].radius + self.disks[pair.j].radius;
                least = least.max(1e-13 * size / c.v_n.abs());
            }
        }
        h.max(least).min(self.longest)
    }

    /// d(F_n)/dt.
    fn normal_rate(&self, s: &[f64], p: usize) -> f64 {
        let d = self.derivative(s);
        let h = 1e-4 * self.length_of_step(s);
        let at = |h: f64| -> f64 {
            let moved: Vec<f64> = s.iter().zip(&d).map(|(a, b)| a + h * b).collect();
            self.touch(&moved, p).normal
        };
        (at(h) - at(-h)) / (2.0 * h)
    }

    /// The regime that pair p ought to be in at this state.
    fn regime(&self, s: &[f64], p: usize) -> Regime {
        let pair = self.pairs[p];
        let c = self.touch(s, p);
        if c.overlap <= 0.0 {
            return Regime::Apart;
        }
        let Regime::Pressed {
            sliding,
            rolling_limit,
        } = pair.regime
        else {
            return if c.normal > 0.0 {
                STICKING
            } else {
                pair.regime
            };
        };
        if c.normal <= 0.0 {
            return Regime::Released;
        }
        let at = self.place_of_pair(p);
        let (r_r, k_r) = self.rolling_stiffness(p);
        let spin = s[5 * pair.i + 4] - s[5 * pair.j + 4];
        // At the limit as long as the spring would go beyond it.
        let branch = |now: Option<f64>, elastic: f64, coefficient: f64, rate: f64| match now {
            None if elastic.abs() > coefficient * c.normal => Some(elastic.signum()),
            Some(sign) if sign * rate < coefficient * self.normal_rate(s, p) => None,
            same => same,
        };
        Regime::Pressed {
            sliding: branch(sliding, s[at], self.law.friction, -c.k_t * c.v_t),
            rolling_limit: branch(
                rolling_limit,
                s[at + 1],
                self.law.rolling_friction * r_r,
                -k_r * spin,
            ),
        }
    }

    /// What is at its limit is set to it.
    fn settle(&self, s: &mut [f64]) {
        for p in 0..self.pairs.len() {
            let at = self.place_of_pair(p);
            match self.pairs[p].regime {
                Regime::Pressed {
                    sliding,
                    rolling_limit,
                } => {
                    let c = self.touch(s, p);
                    if sliding.is_some() {
                        s[at] = c.tangential;
                    }
                    if rolling_limit.is_some() {
                        s[at + 1] = c.rolling;
                    }
                }
                _ => s[at..at + 2].fill(0.0),
            }
        }
    }

    fn consistent(&self, s: &[f64]) -> bool {
        (0..self.pairs.len()).all(|p| self.regime(s, p) == self.pairs[p].regime)
    }

    /// From time `from` to time `to` (s).
    pub fn integrate(&mut self, s: &mut Vec<f64>, from: f64, to: f64) {
        let mut time = from;
        while time < to {
            let rest = to - time;
            let h = self.length_of_step(s);
            // No last step of almost nothing.
            let last = h * 1.000001 >= rest;
            let h = if last { rest } else { h };
            let mut next = self.step(s, h);
            if self.consistent(&next) {
                self.settle(&mut next);
                *s = next;
                time = if last { to } else { time + h };
                continue;
            }
            let (mut low, mut high) = (0.0, h);
            while high - low > 1e-15 * self.longest && 0.5 * (low + high) != low {
                let middle = 0.5 * (low + high);
                next = self.step(s, middle);
                if self.consistent(&next) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            next = self.step(s, high);
            let change: Vec<Regime> = (0..self.pairs.len())
                .map(|p| self.regime(&next, p))
                .collect();
            time += high;
            for (p, regime) in change.into_iter().enumerate() {
                if regime != self.pairs[p].regime {
                    self.pairs[p].regime = regime;
                    self.switches.push((time, p, regime));
                }
            }
            assert!(self.switches.len() < 50, "chatters: {:?}", self.switches);
            self.settle(&mut next);
            *s = next;
        }
    }

    /// Kinetic energy (J/m).
    pub fn kinetic_energy(&self, s: &[f64]) -> f64 {
        self.disks
            .iter()
            .zip(s.chunks(5))
            .map(|(disk, d)| {
                let m = self.law.mass(disk.radius);
                0.5 * m * (d[2] * d[2] + d[3] * d[3])
                    + 0.25 * m * disk.radius * disk.radius * d[4] * d[4]
            })
            .sum()
    }
}

/// a + factor b.
fn sum(a: &[f64], b: &[f64], factor: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + factor * b).collect()
}
