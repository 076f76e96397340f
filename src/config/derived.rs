//! Numbers that follow from the configuration: pressure, stiffness number, damping ratio, time step. Of libm only roots
//! and [`portable_ln`](crate::contact::portable_ln), since all of them reach the trajectory.

use std::f64::consts::PI;

use super::scene::{Law, Sample};
use crate::contact::{hooke, portable_ln};

/// Last δ/(R1+R2) of the laws for two equal disks: of LH at a/R = 0.3, beyond which its tangential stiffness (A9) is outside its
/// range; of the springs as `hooke` has it.
pub const OVERLAP_LIMIT: f64 = hooke::LARGEST_OVERLAP;

/// κ for which the mean overlap is the law's last, [`OVERLAP_LIMIT`].
pub const STIFFNESS_NUMBER_MIN: f64 = 1.0 / OVERLAP_LIMIT;

/// κ beyond which the mean overlap is so small a part of the coordinates that f64 does not resolve it well.
pub const STIFFNESS_NUMBER_MAX: f64 = 1e10;

/// Solid fraction by which the height of a packing is estimated: random close packing of disks.
pub const PACKED_FRACTION: f64 = 0.84;

/// Height of the two walls and of the least sample between them, over d̄: one each, and five.
pub const LEAST_HEIGHT: f64 = 7.0;

/// α of the linear damping (A4, A12) whose restitution is e: e = exp(-πα/√(1-α²)), 0 < e ≤ 1.
pub fn damping_ratio(restitution: f64) -> f64 {
    let l = -portable_ln(restitution);
    l / (PI * PI + l * l).sqrt()
}

/// P (Pa) at which the mean overlap is d̄/κ: by κ = k_n(δ̄)/P and F = k_n δ̄ = P d̄, for two grains of the mean radius.
pub fn pressure(law: &Law, sample: &Sample, stiffness_number: f64) -> f64 {
    let diameter = sample.mean_diameter;
    let radius = 0.5 * diameter;
    let overlap = diameter / stiffness_number;
    law.normal_stiffness(radius, radius, overlap) / stiffness_number
}

/// κ at which [`pressure`] is the given P (Pa): bisection of a function that falls as κ grows, down to neighbouring floats.
/// `None` if κ would lie outside [`STIFFNESS_NUMBER_MIN`] … [`STIFFNESS_NUMBER_MAX`].
pub fn stiffness_number(law: &Law, sample: &Sample, given: f64) -> Option<f64> {
    let (mut low, mut high) = (STIFFNESS_NUMBER_MIN, STIFFNESS_NUMBER_MAX);
    if pressure(law, sample, low) < given || pressure(law, sample, high) > given {
        return None;
    }
    loop {
        // The geometric mean halves the exponent's range first.
        let middle = (low * high).sqrt();
        if middle <= low || middle >= high {
            return Some(low);
        }
        if pressure(law, sample, middle) >= given {
            low = middle;
        } else {
            high = middle;
        }
    }
}

/// √(m_min/k_n,max) (s): the lightest grain, m = ρπR² per unit depth, and the stiffness of a contact of two of them at ten times
/// the mean overlap (m), but no more than the law's last overlap.
pub fn contact_time(law: &Law, sample: &Sample, mean_overlap: f64) -> f64 {
    let radius = sample.radius_min;
    let overlap = (10.0 * mean_overlap).min(OVERLAP_LIMIT * 2.0 * radius);
    let stiffness = law.normal_stiffness(radius, radius, overlap);
    let mass = law.density() * PI * radius * radius;
    (mass / stiffness).sqrt()
}

/// Default Δt (s): a tenth of [`contact_time`].
pub fn default_step(contact_time: f64) -> f64 {
    0.1 * contact_time
}

/// Largest stable Δt (s) of the Verlet scheme, 2/ω_max with ω_max² = 12 k_n,max/m_min: Gershgorin's bound for a grain with six
/// neighbours, each of which adds k/m on the diagonal and as much beside it.
/// Normal springs only: six sliding-free tangential springs with rotation could raise ω_max² to 26 k_n/m with LH (k_t ≤ 0.73 k_n) and
/// 31 k_n/m with linear springs of k_t = k_n, but six sticking contacts of the lightest grain hardly occur together, and the default
/// has margin for them.
pub fn step_limit(contact_time: f64) -> f64 {
    2.0 * contact_time / 12f64.sqrt()
}

/// H (m) of the packed sample, walls included: N π⟨R²⟩/(0.84 L_x).
pub fn packed_height(sample: &Sample) -> f64 {
    f64::from(sample.grains) * PI * sample.mean_square_radius / (PACKED_FRACTION * sample.length)
}

/// The fewest grains whose packing is [`LEAST_HEIGHT`] mean diameters high.
pub fn least_grains(sample: &Sample) -> f64 {
    let area = PACKED_FRACTION * sample.length * LEAST_HEIGHT * sample.mean_diameter;
    (area / (PI * sample.mean_square_radius)).ceil()
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Material, Springs};
    use super::*;
    use crate::contact::lee_hurley::normal_stiffness;

    const MATERIAL: Material = Material {
        young_modulus: 1e9,
        poisson_ratio: 0.2,
        density: 2500.0,
    };
    const LAW: Law = Law::LeeHurley(MATERIAL);
    const SAMPLE: Sample = Sample::uniform(1000, 0.5e-6, 1e-6, 48e-6);

    fn close(a: f64, b: f64, relative: f64) {
        assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
    }

    #[test]
    fn effective_modulus_of_the_paper() {
        close(MATERIAL.effective_modulus(), 0.5208e9, 1e-4);
    }

    #[test]
    fn stiffness_at_a_typical_overlap() {
        close(normal_stiffness(1.0, 1.0, 1.0, 2e-4), 0.26, 0.02);
    }

    #[test]
    fn restitution_and_damping_ratio() {
        close(damping_ratio(0.73), 0.1, 5e-3);
        assert_eq!(damping_ratio(1.0), 0.0);
        for alpha in [0.01, 0.1, 0.5, 0.9] {
            let e = (-PI * alpha / f64::sqrt(1.0 - alpha * alpha)).exp();
            close(damping_ratio(e), alpha, 1e-14);
        }
    }

    #[test]
    fn pressure_of_the_paper() {
        // P = k_n/κ with k_n = 0.26 E* at that overlap.
        close(pressure(&LAW, &SAMPLE, 1e4), 13.5e3, 5e-3);
    }

    /// Against a Hertz line contact solved by itself: with x = a²/(16R²), F = 4πE*·2R·x and δ/(8R) = x (ln(1/x) - 1).
    #[test]
    fn pressure_against_the_implicit_law() {
        for kappa in [50.0, 1e3, 1e4, 1e6] {
            let (mut low, mut high) = (0.0_f64, 0.05_f64);
            for _ in 0..200 {
                let x = 0.5 * (low + high);
                if x * ((1.0 / x).ln() - 1.0) < 0.25 / kappa {
                    low = x;
                } else {
                    high = x;
                }
            }
            // P d̄ = F.
            let expected = 4.0 * PI * MATERIAL.effective_modulus() * low;
            close(pressure(&LAW, &SAMPLE, kappa), expected, 1e-12);
        }
    }

    /// Linear springs: P = k_n/κ, and a contact time that does not depend on the load.
    #[test]
    fn numbers_of_linear_springs() {
        let law = Law::Hooke(Springs {
            normal_stiffness: 1e8,
            tangential_stiffness: 5e7,
            density: 2500.0,
        });
        assert_eq!(pressure(&law, &SAMPLE, 1e4), 1e4);
        close(stiffness_number(&law, &SAMPLE, 1e4).unwrap(), 1e4, 1e-14);
        for overlap in [1e-12, 1e-8] {
            let expected = (2500.0 * PI * 0.25e-12 / 1e8).sqrt();
            close(contact_time(&law, &SAMPLE, overlap), expected, 1e-15);
        }
    }

    #[test]
    fn stiffness_number_inverts_pressure() {
        for kappa in [20.0, 123.456, 1e4, 3e8] {
            let p = pressure(&LAW, &SAMPLE, kappa);
            close(stiffness_number(&LAW, &SAMPLE, p).unwrap(), kappa, 1e-14);
        }
        assert_eq!(stiffness_number(&LAW, &SAMPLE, 1e9), None);
        assert_eq!(stiffness_number(&LAW, &SAMPLE, 1e-9), None);
    }

    #[test]
    fn time_step_of_the_paper() {
        let t = contact_time(&LAW, &SAMPLE, SAMPLE.mean_diameter / 1e4);
        // √(m/k_n) is about 6 ns for a mean grain at the mean overlap; the smallest grain and a stiffer contact give less.
        assert!((2e-9..6e-9).contains(&t), "{t}");
        close(step_limit(t) / default_step(t), 20.0 / 12f64.sqrt(), 1e-15);
    }

    /// The bound holds for a lattice at its stiffest: ω² of a triangular lattice reaches 6 k/m, at most 12 k/m.
    #[test]
    fn step_limit_is_below_that_of_a_triangular_lattice() {
        let directions: Vec<[f64; 2]> = (0..6)
            .map(|k| (k as f64 * PI / 3.0).sin_cos())
            .map(|(s, c)| [c, s])
            .collect();
        let mut greatest = 0.0_f64;
        for i in 0..60 {
            for j in 0..60 {
                let q = [i as f64 * PI / 15.0, j as f64 * PI / 15.0];
                let mut d = [0.0; 3];
                for e in &directions {
                    let w = 1.0 - (q[0] * e[0] + q[1] * e[1]).cos();
                    d[0] += w * e[0] * e[0];
                    d[1] += w * e[0] * e[1];
                    d[2] += w * e[1] * e[1];
                }
                let half = 0.5 * (d[0] + d[2]);
                let root = (0.25 * (d[0] - d[2]) * (d[0] - d[2]) + d[1] * d[1]).sqrt();
                greatest = greatest.max(half + root);
            }
        }
        assert!(greatest > 5.5 && greatest <= 12.0, "{greatest}");
    }

    #[test]
    fn height_of_the_default_sample() {
        close(packed_height(&SAMPLE), 45.45e-6, 1e-3);
        let enough = least_grains(&SAMPLE);
        let at = |grains: f64| {
            packed_height(&Sample {
                grains: grains as u32,
                ..SAMPLE
            })
        };
        assert!(at(enough) >= LEAST_HEIGHT * SAMPLE.mean_diameter);
        assert!(at(enough - 1.0) < LEAST_HEIGHT * SAMPLE.mean_diameter);
    }
}
