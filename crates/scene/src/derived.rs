//! Numbers that follow from the configuration: pressure, stiffness number, damping ratio, time
//! step. Of libm only roots and [`portable_ln`], since all of
//! them reach the trajectory.

use super::grains::Sample;
use gshear_dem::contact::{portable_exp, portable_ln};
use gshear_dem::dimension::Dimensions;
use gshear_dem::laws::{Contact, Law};

/// The greatest mean overlap over d̄ under a load, and the last overlap over the diameter for which
/// Δt is planned: the last δ/(R1+R2) of LH for two equal disks, at a/R = 0.3, beyond which its
/// tangential stiffness (A9) is outside its range.
pub(crate) const OVERLAP_LIMIT: f64 = 0.094;

/// κ for which the mean overlap is the greatest, [`OVERLAP_LIMIT`].
pub(crate) const STIFFNESS_NUMBER_MIN: f64 = 1.0 / OVERLAP_LIMIT;

/// κ beyond which the mean overlap is so small a part of the coordinates that f64 does not resolve
/// it well.
pub(crate) const STIFFNESS_NUMBER_MAX: f64 = 1e10;

/// Solid fraction by which the height of a packing is estimated: random close packing of disks, and
/// of spheres.
fn packed_fraction(sample: &Sample) -> f64 {
    sample.by_dimension(0.84, 0.64)
}

/// Greatest R_max/R_min with which walls are one mean diameter thick.
const NARROW_SIZES: f64 = 2.0;

/// The default thickness of each wall over d̄. With wide sizes it is so great that a hole through
/// which the smallest grain fits is closed by the grain that rests over it. The highest of these is
/// one of R_max on two disks of R_max with just room for R_min between them: its centre is h =
/// R_max √(4 - (1+q)²), q = R_min/R_max, above theirs, at R_max. Pores between spheres bend: those
/// take half of h more (docs/explanation/scheme.md has what was measured).
pub(crate) fn wall_layers(sample: &Sample) -> f64 {
    let (least, greatest) = (sample.radius_min, sample.radius_max);
    if greatest <= NARROW_SIZES * least {
        return 1.0;
    }
    let beside = 1.0 + least / greatest;
    let over = sample.by_dimension(1.0, 1.5) * (4.0 - beside * beside).sqrt();
    (greatest * (1.0 + over) / sample.mean_diameter).max(1.0)
}

/// Height of the walls and of the least sample between them, five d̄, over d̄; `layers`: thickness
/// of all walls over d̄.
pub(crate) fn least_height(layers: f64) -> f64 {
    layers + 5.0
}

/// x^(1/3) of a positive number: Newton's steps from a start that is right to some ulps.
pub(crate) fn cube_root(x: f64) -> f64 {
    let third = portable_ln(x) / 3.0;
    let start = if third > 0.0 {
        1.0 / portable_exp(-third)
    } else {
        portable_exp(third)
    };
    (0..2).fold(start, |y, _| y - (y - x / (y * y)) / 3.0)
}

/// The length (m) of a cubic box (square in 2D) of this volume (m³; m²).
pub(crate) fn box_length(dimension: Dimensions, volume: f64) -> f64 {
    match dimension {
        Dimensions::Two => volume.sqrt(),
        Dimensions::Three => cube_root(volume),
    }
}

/// P (Pa) at which the mean overlap is d̄/κ: F = k_n(δ̄) δ̄ = P d̄, in 3D P d̄², for two grains of
/// the mean radius.
pub(crate) fn pressure(law: &Law, sample: &Sample, stiffness_number: f64) -> f64 {
    let diameter = sample.mean_diameter;
    let radius = 0.5 * diameter;
    let overlap = diameter / stiffness_number;
    let per_section = diameter / sample.mean_section();
    law.normal_stiffness(radius, radius, overlap) / stiffness_number * per_section
}

/// F_c (N; N/m in 2D) of two mean grains: the force that separates them.
pub fn mean_attraction(contact: &Contact, sample: &Sample) -> f64 {
    let radii = [0.5 * sample.mean_diameter; 2];
    let adhesion = contact.adhesion.as_ref();
    adhesion.map_or(0.0, |adhesion| adhesion.pull_off(radii))
}

/// The attraction (N; N/m in 2D) of two mean grains under a load (N; N/m in 2D).
pub(crate) fn attraction_under(load: f64, contact: &Contact, sample: &Sample) -> f64 {
    let radii = [0.5 * sample.mean_diameter; 2];
    let adhesion = contact.adhesion.as_ref();
    adhesion.map_or(0.0, |adhesion| adhesion.under_load(load, radii))
}

/// κ at which the mean overlap under the given P (Pa) is d̄/κ: bisection of a function that falls
/// as κ grows, down to neighbouring floats. `None` if κ would lie outside of the range that
/// `load.stiffness_number` may have.
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

/// m_min (kg; kg/m in 2D) and k_n,max (N/m; Pa in 2D): the lightest grain, and the stiffness of a
/// contact of two of them at ten times the mean overlap (m), but no more than the law's last
/// overlap.
fn lightest_and_stiffest(law: &Law, sample: &Sample, mean_overlap: f64) -> [f64; 2] {
    let radius = sample.radius_min;
    let overlap = (10.0 * mean_overlap).min(OVERLAP_LIMIT * 2.0 * radius);
    let stiffness = law.normal_stiffness(radius, radius, overlap);
    let volume = sample.dimension().volume(radius);
    [law.masses().of(0, volume), stiffness]
}

/// √(m_min/k_n,max) (s).
pub fn contact_time(law: &Law, sample: &Sample, mean_overlap: f64) -> f64 {
    let [mass, stiffness] = lightest_and_stiffest(law, sample, mean_overlap);
    (mass / stiffness).sqrt()
}

/// Default Δt (s): a tenth of [`contact_time`], but no more than [`step_limit`].
pub(crate) fn default_step(contact_time: f64, step_limit: f64) -> f64 {
    (0.1 * contact_time).min(step_limit)
}

/// Largest Δt (s) that is stable whatever sticks, for the lightest grains in contacts as stiff as
/// any. `friction`: contacts may stick; they may resist rolling and twisting.
///
/// For small motions, M a = -K q - C v, the scheme is stable where λ_max(¼Δt² M⁻¹K + Δt M⁻¹C) ≤ 1:
/// the dampers take the velocity predicted from the step before, so they limit Δt as the springs
/// do. Where each of a grain's six contacts gets a sixth of its mass, λ_max is at most that of one
/// contact by itself, whose normal, tangential and rolling motion are apart: K has 12 k_n/m, 36
/// k_t/m and 24 k_r/(mR²), and C the same of the damping constants. Spheres have twelve: 24 k_n/m
/// and, with their inertia, 84 k_t/m and 60 k_r/(mR²), of twisting, too. Of a stiffness k of the
/// configuration k_r is kR²/4 between equal grains; of a grain and a much larger one it is kR², but
/// only one of the two turns, which counts as kR²/2.
pub(crate) fn step_limit(
    law: &Law,
    contact: &Contact,
    sample: &Sample,
    mean_overlap: f64,
    friction: bool,
) -> f64 {
    let [mass, secant] = lightest_and_stiffest(law, sample, mean_overlap);
    let rigid = law.rigidity(secant, mass, friction);
    // Of two equal grains 2 I_r/(mR²); ¾m of disks is that of A22.
    let [along, across, turning, inertia_of_rolling] =
        sample.by_dimension([12.0, 36.0, 24.0, 0.75], [24.0, 84.0, 60.0, 0.7]);
    let mut modes = vec![
        Mode {
            share: along,
            stiffness: rigid.normal,
            damping: rigid.damping[0],
        },
        Mode {
            share: across,
            stiffness: rigid.tangential,
            damping: rigid.damping[1],
        },
    ];
    let rolls = contact.rolling_stiffness.map(|k| 0.5 * k);
    let twists = contact.twisting_stiffness.map(|k| 0.5 * k).or(rolls);
    if contact.rolling_friction > 0.0 {
        let stiffness = rolls.unwrap_or(rigid.rolling);
        let eta = contact.rolling_damping_ratio;
        modes.push(Mode {
            share: turning,
            stiffness,
            damping: 2.0 * eta * (inertia_of_rolling * stiffness * mass).sqrt(),
        });
    }
    if contact.twisting_friction > 0.0 {
        let stiffness = twists.unwrap_or(rigid.rolling);
        let eta = contact.twisting_damping_ratio;
        modes.push(Mode {
            share: turning,
            stiffness,
            damping: 2.0 * eta * (0.2 * stiffness * mass).sqrt(),
        });
    }
    let limits = modes.iter().map(|mode| mode.step_limit(mass));
    limits.fold(f64::INFINITY, f64::min)
}

/// A mode of the motion of a grain on its contacts.
struct Mode {
    /// Its stiffness and damping constant, over those of one contact.
    share: f64,
    stiffness: f64,
    damping: f64,
}

impl Mode {
    /// The greatest Δt (s) at which it is stable, with this mass (kg; kg/m in 2D).
    fn step_limit(&self, mass: f64) -> f64 {
        let square = self.share * self.stiffness / mass;
        let damping = self.share * self.damping / mass;
        2.0 / (damping + (damping * damping + square).sqrt())
    }
}

/// The default gain of a servo (m/(s Pa)): with it the wall yields to a wave as a sample of the
/// same grains would, 1/Z of the impedance Z = √(m̄ k)/d̄, in 3D over d̄², with k at the mean
/// overlap (m).
pub(crate) fn servo_gain(law: &Law, sample: &Sample, mean_overlap: f64) -> f64 {
    let mass = law.masses().of(0, sample.mean_volume);
    sample.mean_section() / (mass * mean_stiffness(law, sample, mean_overlap)).sqrt()
}

/// The greatest gain of a servo (m/(s Pa)) for Δt (s). A wall on contacts that have together the
/// stiffness K (Pa/m) and the damping constant C (Pa s/m) is stable while gain (K Δt + 3 C) < 1;
/// they are taken as four contacts of mean grains at this overlap (m) on every d̄, in 3D d̄².
pub(crate) fn servo_gain_limit(law: &Law, sample: &Sample, overlap: f64, step: f64) -> f64 {
    let mass = law.masses().of(0, sample.mean_volume);
    let rigid = law.rigidity(mean_stiffness(law, sample, overlap), mass, false);
    let per_contact = rigid.normal * step + 3.0 * rigid.damping[0];
    sample.mean_section() / (4.0 * per_contact)
}

/// The least mass (kg; kg/m in 2D) of the top wall for Δt (s): on contacts that have together the
/// stiffness K and the damping constant C, K Δt² + C Δt/2. They are taken as four contacts of mean
/// grains at this overlap (m) on every d̄, in 3D d̄².
pub(crate) fn least_wall_mass(law: &Law, sample: &Sample, overlap: f64, step: f64) -> f64 {
    let mass = law.masses().of(0, sample.mean_volume);
    let rigid = law.rigidity(mean_stiffness(law, sample, overlap), mass, false);
    let contacts = 4.0 * sample.base() / sample.mean_section();
    contacts * (rigid.normal * step + 0.5 * rigid.damping[0]) * step
}

/// k (N/m; Pa in 2D) of two grains of the mean radius at this overlap (m).
fn mean_stiffness(law: &Law, sample: &Sample, overlap: f64) -> f64 {
    let radius = 0.5 * sample.mean_diameter;
    law.normal_stiffness(radius, radius, overlap)
}

/// H (m) of the packed sample, walls included: N π⟨R²⟩/(0.84 L_x), in 3D N (4/3)π⟨R³⟩/(0.64 L_x
/// L_y).
pub(crate) fn packed_height(sample: &Sample) -> f64 {
    f64::from(sample.grains) * sample.mean_volume / (packed_fraction(sample) * sample.base())
}

/// The fewest grains whose packing is so high (m).
pub(crate) fn least_grains(sample: &Sample, height: f64) -> f64 {
    let volume = packed_fraction(sample) * sample.base() * height;
    (volume / sample.mean_volume).ceil()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use gshear_dem::laws::damping::damping_ratio;
    use gshear_dem::laws::hooke::{self, Springs};
    use gshear_dem::laws::lee_hurley::{self, Material, normal_stiffness};

    use super::*;

    const MATERIAL: Material = Material {
        young_modulus: 1e9,
        poisson_ratio: 0.2,
        density: 2500.0,
        damping_ratio: 0.1,
        sliding_damping: 0.0,
    };
    const SAMPLE: Sample = Sample::uniform(1000, 0.5e-6, 1e-6, 48e-6);

    const SPRINGS: Springs = Springs {
        normal_stiffness: 1e8,
        tangential_stiffness: 5e7,
        density: 2500.0,
        damping_ratio: 0.1,
        sliding_damping: 0.0,
        ageing: None,
    };

    fn law() -> Law {
        damped(MATERIAL.damping_ratio)
    }

    fn damped(damping_ratio: f64) -> Law {
        let material = Material {
            damping_ratio,
            ..MATERIAL
        };
        Law::of(&lee_hurley::KIND, material)
    }

    fn close(a: f64, b: f64, relative: f64) {
        assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
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

    /// E*, k_n at a typical overlap, and P = k_n/κ with k_n = 0.26 E*.
    #[test]
    fn numbers_of_the_paper() {
        close(MATERIAL.effective_modulus(), 0.5208e9, 1e-4);
        close(normal_stiffness(1.0, 1.0, 1.0, 2e-4), 0.26, 0.02);
        close(pressure(&law(), &SAMPLE, 1e4), 13.5e3, 5e-3);
    }

    /// Against a Hertz line contact solved by itself: with x = a²/(16R²), F = 4πE*·2R·x and δ/(8R)
    /// = x (ln(1/x) - 1).
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
            close(pressure(&law(), &SAMPLE, kappa), expected, 1e-12);
        }
    }

    /// Linear springs: P = k_n/κ, and a contact time that does not depend on the load.
    #[test]
    fn numbers_of_linear_springs() {
        let law = Law::of(&hooke::KIND, SPRINGS);
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
            let p = pressure(&law(), &SAMPLE, kappa);
            close(stiffness_number(&law(), &SAMPLE, p).unwrap(), kappa, 1e-14);
        }
        assert_eq!(stiffness_number(&law(), &SAMPLE, 1e9), None);
        assert_eq!(stiffness_number(&law(), &SAMPLE, 1e-9), None);
    }

    #[test]
    fn time_step_of_the_paper() {
        let t = contact_time(&law(), &SAMPLE, SAMPLE.mean_diameter / 1e4);
        // √(m/k_n) is about 6 ns for a mean grain at the mean overlap; the smallest grain and a
        // stiffer contact give less.
        assert!((2e-9..6e-9).contains(&t), "{t}");
        let overlap = SAMPLE.mean_diameter / 1e4;
        let limit = step_limit(&law(), &contact(0.3), &SAMPLE, overlap, true);
        assert_eq!(default_step(t, limit), 0.1 * t);
    }

    fn contact(rolling_damping_ratio: f64) -> Contact {
        Contact {
            friction: 0.7,
            rolling_friction: 0.01,
            rolling_damping_ratio,
            ..Contact::NONE
        }
    }

    /// Strong dampers limit Δt to 1/(Δt M⁻¹C) = 1: the default stays below.
    #[test]
    fn the_default_step_is_never_over_the_limit() {
        for kappa in [11.0, 1e4, 1e10] {
            let overlap = SAMPLE.mean_diameter / kappa;
            let t = contact_time(&law(), &SAMPLE, overlap);
            let mut last = f64::INFINITY;
            for ratio in [0.0, 0.1, 0.3, 0.99] {
                let limit = step_limit(&damped(ratio), &contact(ratio), &SAMPLE, overlap, true);
                assert!(limit < last && default_step(t, limit) <= limit);
                last = limit;
            }
            assert!(last < 0.1 * t);
        }
    }

    /// The bound holds for a lattice at its stiffest: ω² of a triangular lattice reaches 6 k/m, at
    /// most 12 k/m. Sticking lattices are in `tests/all/stress`.
    #[test]
    fn step_limit_is_below_that_of_a_triangular_lattice() {
        let directions: Vec<[f64; 2]> = (0..6)
            .map(|k| (f64::from(k) * PI / 3.0).sin_cos())
            .map(|(s, c)| [c, s])
            .collect();
        let mut greatest = 0.0_f64;
        for i in 0..60 {
            for j in 0..60 {
                let q = [f64::from(i) * PI / 15.0, f64::from(j) * PI / 15.0];
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
        assert!(greatest > 5.5, "{greatest}");
        let mut smooth = contact(0.0);
        smooth.rolling_friction = 0.0;
        let overlap = SAMPLE.mean_diameter / 1e4;
        let [mass, stiffness] = lightest_and_stiffest(&law(), &SAMPLE, overlap);
        let limit = step_limit(&damped(0.0), &smooth, &SAMPLE, overlap, false);
        assert!(limit < 2.0 / (greatest * stiffness / mass).sqrt());
    }

    /// Linear springs: 1/Z = d̄/√(m̄ k), and d̄/(4 (k Δt + 3 c)) with c = 2α√(k m̄/2).
    #[test]
    fn gain_of_a_servo() {
        let law = Law::of(&hooke::KIND, SPRINGS);
        let mass = 2500.0 * PI * 1.75e-12 / 3.0;
        let gain = 1.5e-6 / (mass * 1e8_f64).sqrt();
        close(servo_gain(&law, &SAMPLE, 1e-10), gain, 1e-14);
        let damping = 0.2 * (1e8 * 0.5 * mass).sqrt();
        let limit = 1.5e-6 / (4.0 * (0.1 + 3.0 * damping));
        close(servo_gain_limit(&law, &SAMPLE, 1e-10, 1e-9), limit, 1e-14);
    }

    /// Of three disks of R_max in a gap of 2 R_min, by the law of cosines; spheres higher; and
    /// narrow sizes.
    #[test]
    fn walls_are_as_high_as_what_closes_their_holes() {
        assert_eq!(wall_layers(&SAMPLE), 1.0);
        let wide = Sample::uniform(1000, 0.2e-6, 1e-6, 48e-6);
        // Apart by 2 (R_max + R_min), each beside the third by 2 R_max.
        let cosine = (4.0 + 2.4 * 2.4 - 4.0) / (2.0 * 2.0 * 2.4_f64);
        let height = 1.0 + 2.0 * cosine.acos().sin();
        close(wall_layers(&wide), height / 1.2, 1e-14);
        let spheres = Sample {
            width: 48e-6,
            ..wide
        };
        assert!(wall_layers(&spheres) > wall_layers(&wide));
    }

    #[test]
    fn height_of_the_default_sample() {
        close(packed_height(&SAMPLE), 45.45e-6, 1e-3);
        let enough = least_grains(&SAMPLE, least_height(2.0) * SAMPLE.mean_diameter);
        let [less, enough] = [enough - 1.0, enough].map(|grains| {
            let grains = grains as u32;
            packed_height(&Sample { grains, ..SAMPLE })
        });
        let least = 7.0 * SAMPLE.mean_diameter;
        assert!(less < least && enough >= least);
    }
}
