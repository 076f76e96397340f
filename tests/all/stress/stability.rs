//! The greatest stable Δt of the program against that of the linearised contacts.
//!
//! For small motions about a load the scheme is linear: M a = -K q - C v, the dampers with v + Δt a
//! of the step before. A mode first grows as it changes sign in every step; q' = -q, v = 0, a' = -a
//! gives
//!
//!     λ_max(¼Δt² M⁻¹K + Δt M⁻¹C) = 1,    without dampers Δt = 2/ω_max.

use std::f64::consts::PI;

use gshear_dem::contact::ContactLaw;
use gshear_dem::contact::stiffness::Stiffness;
use gshear_dem::dimension::Two;
use gshear_dem::state::{GrainState, body, nearest_image};
use gshear_scene::{Scene, Source};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::rig::{Rig, Setting};
use super::table::{Line, line};
use crate::accuracy::reference::Law;
use crate::accuracy::scenes::{LAW, grain, program_law};

/// A contact for small motions about a load without F_t and M, and a run of the program with it.
/// Every law has a list of these.
pub struct Candidate {
    name: String,
    /// ρ (kg/m³).
    density: f64,
    /// The linearised contact of two radii (m) at an overlap (m).
    linear: Box<dyn Fn([f64; 2], f64) -> Linear>,
    departs: Departs,
}

/// Whether the program is unstable in this arrangement at this Δt (s).
type Departs = Box<dyn Fn(&Arrangement, f64) -> bool>;

/// Stiffnesses dF_n/dδ, k_t (Pa), k_r (N/rad), damping constants to them, and F_n (N/m), which
/// turns with n.
#[derive(Debug, Clone, Copy)]
pub struct Linear {
    stiffness: [f64; 3],
    damping: [f64; 3],
    force: f64,
}

/// The law of Lee and Hurley frictionless, frictional, and rolling.
fn lee_hurley(law: Law) -> Vec<Candidate> {
    let damped = if law.damping_ratio > 0.0 {
        format!(
            "α = {}, η_r = {}",
            law.damping_ratio, law.rolling_damping_ratio
        )
    } else {
        "undamped".into()
    };
    let one = |name: &str, parts: [f64; 3], departs: Departs| {
        let linear = move |radii, overlap| lee_hurley_linear(&law, parts, radii, overlap);
        Candidate {
            name: format!("{name}, {damped}"),
            density: law.density,
            linear: Box::new(linear),
            departs,
        }
    };
    vec![
        one(
            "frictionless",
            [1.0, 0.0, 0.0],
            Box::new(move |of, h| departs(program_law::<false, false>(&law), of, law.density, h)),
        ),
        one(
            "frictional",
            [1.0, 1.0, 0.0],
            Box::new(move |of, h| departs(program_law::<true, false>(&law), of, law.density, h)),
        ),
        one(
            "rolling",
            [1.0, 1.0, 1.0],
            Box::new(move |of, h| departs(program_law::<true, true>(&law), of, law.density, h)),
        ),
    ]
}

/// By the formulas of the reference, not of the program. `parts`: 1 for each spring that the law
/// has, else 0.
fn lee_hurley_linear(law: &Law, parts: [f64; 3], radii: [f64; 2], overlap: f64) -> Linear {
    let [r_i, r_j] = radii;
    let [k_n, k_t] = law.stiffnesses(r_i, r_j, overlap);
    // F = 4πE*(R_1+R_2) x with x (ln 1/x - 1) = y gives dF/dδ = πE*/(ℓ-2), where F/δ = πE*/(ℓ-1).
    let tangent = 1.0 / (1.0 / k_n - 1.0 / law.modulus());
    let r_r = r_i * r_j / (r_i + r_j);
    let k_r = 0.25 * law.modulus() * r_r * r_r;
    let reduced = |a: f64, b: f64| a * b / (a + b);
    let (m_i, m_j) = (law.mass(r_i), law.mass(r_j));
    let m = reduced(m_i, m_j);
    let i = reduced(1.5 * m_i * r_i * r_i, 1.5 * m_j * r_j * r_j);
    let (alpha, eta) = (law.damping_ratio, law.rolling_damping_ratio);
    let damper = |ratio: f64, k: f64, m: f64| 2.0 * ratio * (k * m).sqrt();
    Linear {
        stiffness: [parts[0] * tangent, parts[1] * k_t, parts[2] * k_r],
        damping: [
            parts[0] * damper(alpha, k_n, m),
            parts[1] * damper(alpha, k_t, m),
            parts[2] * damper(eta, k_r, i),
        ],
        force: k_n * overlap,
    }
}

/// Radius of the free grains (m).
const RADIUS: f64 = 1e-6;

/// Grains at rest and in balance: every contact overlaps by the same part of R_i + R_j.
pub struct Arrangement {
    name: String,
    length: f64,
    part: f64,
    grains: Vec<GrainState>,
}

impl Arrangement {
    /// One free grain between `count` wall grains, `ratio` times as large, at even angles.
    fn amid(count: usize, ratio: f64, part: f64) -> Self {
        let centre = [8.0 * RADIUS, 0.0];
        let distance = (1.0 + ratio) * RADIUS * (1.0 - part);
        let around = (0..count).map(|k| {
            let angle = 0.3 + 2.0 * PI * k as f64 / count as f64;
            let place = [
                centre[0] + distance * angle.cos(),
                centre[1] + distance * angle.sin(),
            ];
            at(1 + k as u32, ratio * RADIUS, place, body::BOTTOM)
        });
        let size = if ratio == 1.0 {
            String::new()
        } else {
            format!(" {ratio} times as large")
        };
        Self {
            name: format!("a grain between {count} fixed ones{size}"),
            length: 16.0 * RADIUS,
            part,
            grains: std::iter::once(at(0, RADIUS, centre, body::FREE))
                .chain(around)
                .collect(),
        }
    }

    /// A triangular lattice, six grains per period: four rows of free grains between two fixed
    /// rows.
    fn lattice(part: f64) -> Self {
        const COLUMNS: u32 = 6;
        const ROWS: u32 = 4;
        let spacing = 2.0 * RADIUS * (1.0 - part);
        let grains = (0..COLUMNS * (ROWS + 2)).map(|id| {
            let (row, column) = (id / COLUMNS, id % COLUMNS);
            let x = (f64::from(column) + 0.25 + 0.5 * f64::from(row % 2)) * spacing;
            let y = f64::from(row) * 0.75f64.sqrt() * spacing;
            let wall = row == 0 || row == ROWS + 1;
            at(
                id,
                RADIUS,
                [x, y],
                if wall { body::BOTTOM } else { body::FREE },
            )
        });
        Self {
            name: "a lattice of free grains".into(),
            length: f64::from(COLUMNS) * spacing,
            part,
            grains: grains.collect(),
        }
    }

    /// The overlap (m) of two free grains.
    fn overlap(&self) -> f64 {
        2.0 * RADIUS * self.part
    }

    /// The touching pairs with n from j to i.
    fn contacts(&self) -> Vec<(usize, usize, [f64; 2])> {
        let mut found = Vec::new();
        for (i, a) in self.grains.iter().enumerate() {
            for (j, b) in self.grains.iter().enumerate().skip(i + 1) {
                let dx = nearest_image(a.position[0] - b.position[0], self.length);
                let dy = a.position[1] - b.position[1];
                let distance = dx.hypot(dy);
                let walls = a.body != body::FREE && b.body != body::FREE;
                if distance < a.radius + b.radius && !walls {
                    found.push((i, j, [dx / distance, dy / distance]));
                }
            }
        }
        found
    }

    /// M^-½ K M^-½ and M^-½ C M^-½ of the free grains; coordinates x, y, θ of each.
    fn matrices(&self, candidate: &Candidate) -> [DMatrix<f64>; 2] {
        let free: Vec<usize> = (0..self.grains.len())
            .filter(|&g| self.grains[g].body == body::FREE)
            .collect();
        let size = 3 * free.len();
        let mass = candidate.density * PI * RADIUS * RADIUS;
        let inertia = 0.5 * mass * RADIUS * RADIUS;
        let per_root = [mass, mass, inertia].map(|m| 1.0 / m.sqrt());
        let mut matrices = [DMatrix::zeros(size, size), DMatrix::zeros(size, size)];
        for (i, j, n) in self.contacts() {
            let radii = [self.grains[i].radius, self.grains[j].radius];
            let sum = radii[0] + radii[1];
            let contact = (candidate.linear)(radii, self.part * sum);
            let t = [-n[1], n[0]];
            let turn = -contact.force / (sum * (1.0 - self.part));
            let [k, c] = [contact.stiffness, contact.damping];
            // Derivatives of the stretch of the normal, tangential and rolling springs, and of the
            // rotation of n under F_n, by x, y, θ of i and j.
            for (on_i, on_j, k, c) in [
                ([n[0], n[1], 0.0], [-n[0], -n[1], 0.0], k[0], c[0]),
                (
                    [t[0], t[1], -radii[0]],
                    [-t[0], -t[1], -radii[1]],
                    k[1],
                    c[1],
                ),
                ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], k[2], c[2]),
                ([t[0], t[1], 0.0], [-t[0], -t[1], 0.0], turn, 0.0),
            ] {
                let mut row = DVector::zeros(size);
                for (grain, stretch) in [(i, on_i), (j, on_j)] {
                    if let Some(place) = free.iter().position(|&f| f == grain) {
                        for d in 0..3 {
                            row[3 * place + d] = stretch[d] * per_root[d];
                        }
                    }
                }
                for (matrix, constant) in matrices.iter_mut().zip([k, c]) {
                    matrix.ger(constant, &row, &row, 1.0);
                }
            }
        }
        matrices
    }
}

fn at(id: u32, radius: f64, position: [f64; 2], body: u32) -> GrainState {
    GrainState {
        body,
        ..grain(id, radius, position, [0.0; 2], 0.0)
    }
}

fn greatest(of: DMatrix<f64>) -> f64 {
    SymmetricEigen::new(of).eigenvalues.max()
}

/// The greatest stable Δt (s) of the linearised contacts.
fn limit([stiffness, damping]: &[DMatrix<f64>; 2]) -> f64 {
    let undamped = 2.0 / greatest(stiffness.clone()).sqrt();
    let beyond = |h: f64| greatest(0.25 * h * h * stiffness + h * damping) > 1.0;
    bisected(undamped, 1e-8, beyond)
}

/// Whether the scheme's own map of (q, v, a) over one step has an eigenvalue beyond 1:
/// q' = q + Δt v + ½Δt² a, a' = -K q' - C (v + Δt a), v' = v + ½Δt (a + a').
fn map_grows([stiffness, damping]: &[DMatrix<f64>; 2], step: f64) -> bool {
    let n = stiffness.nrows();
    // Time in units of Δt, so that the elements of the map are of order 1.
    let (stiffness, damping) = (step * step * stiffness, step * damping);
    let one = DMatrix::<f64>::identity(n, n);
    let none = DMatrix::<f64>::zeros(n, n);
    let position = [one.clone(), one.clone(), 0.5 * &one];
    let velocity = [none.clone(), one.clone(), 0.5 * &one];
    let predicted = [none, one.clone(), one];
    let mut map = DMatrix::<f64>::zeros(3 * n, 3 * n);
    for k in 0..3 {
        let acceleration = -(&stiffness * &position[k]) - &damping * &predicted[k];
        for (row, block) in [
            &position[k],
            &(&velocity[k] + 0.5 * &acceleration),
            &acceleration,
        ]
        .into_iter()
        .enumerate()
        {
            map.view_mut((row * n, k * n), (n, n)).copy_from(block);
        }
    }
    // A freely rotating grain has a double eigenvalue 1, which rounding splits by √ε.
    map.complex_eigenvalues()
        .iter()
        .any(|e| e.norm() > 1.0 + 1e-6)
}

/// The least value for which `unstable` holds, between 0.01 and 1.2 times `scale`, to the given
/// relative accuracy.
fn bisected(scale: f64, part: f64, unstable: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.01 * scale, 1.2 * scale);
    assert!(!unstable(low), "unstable already at {low:e}");
    assert!(unstable(high), "still stable at {high:e}");
    while high - low > part * low {
        let middle = 0.5 * (low + high);
        if unstable(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    0.5 * (low + high)
}

/// Whether the program, from a state out of balance by 1e-9 of the overlap, moves away from it by
/// 1e-3 of the overlap. No contact slides or opens at this amplitude, so only linear modes can
/// grow.
fn departs<C: ContactLaw<Space = Two> + Stiffness>(
    law: C,
    of: &Arrangement,
    density: f64,
    step: f64,
) -> bool {
    const STEPS: usize = 20_000;
    const LOOK: usize = 50;
    let unit = of.overlap();
    let mut seed = 3u64;
    let mut random = || {
        seed = seed
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut grains = of.grains.clone();
    for g in grains.iter_mut().filter(|g| g.body == body::FREE) {
        for x in &mut g.position[..2] {
            *x += 1e-9 * unit * random();
        }
        g.angular_velocity[2] = 1e-9 * unit / (RADIUS * step) * random();
    }
    let setting = Setting {
        length: of.length,
        density,
        step,
        skin: Some(0.1),
    };
    let mut rig = Rig::free(law, setting, grains, Vec::new()).expect("within the law");
    for k in 0..STEPS {
        if rig.advance().is_err() {
            return true;
        }
        if k % LOOK == 0 {
            let far = rig.grains().iter().zip(&of.grains).any(|(now, was)| {
                let dx = nearest_image(now.position[0] - was.position[0], of.length);
                let moved = dx.hypot(now.position[1] - was.position[1]);
                let turned = RADIUS * now.angular_velocity[2].abs() * step;
                moved.max(turned) > 1e-3 * unit
            });
            if far {
                return true;
            }
        }
    }
    false
}

/// The rolling limit is high, so that contacts neither slide nor roll.
fn sticking(damping_ratio: f64, rolling_damping_ratio: f64) -> Law {
    Law {
        rolling_friction: 0.5,
        damping_ratio,
        rolling_damping_ratio,
        ..LAW
    }
}

/// Every law in every arrangement: the program becomes unstable at the Δt of the linearised
/// contacts.
pub fn found_by_running() -> Vec<Line> {
    const PART: f64 = 1e-3;
    let arrangements = [
        Arrangement::amid(3, 1.0, PART),
        Arrangement::amid(6, 1.0, PART),
        Arrangement::amid(4, 2.0, PART),
        Arrangement::lattice(PART),
    ];
    let mut lines = Vec::new();
    for law in [sticking(0.0, 0.0), sticking(0.1, 0.3)] {
        for candidate in lee_hurley(law) {
            for of in &arrangements {
                let expected = limit(&of.matrices(&candidate));
                let found = bisected(expected, 2e-4, |h| (candidate.departs)(of, h));
                let ratio = found / expected;
                lines.push(line(
                    format!("{}, {}", of.name, candidate.name),
                    format!("unstable from {:.4} ns on", 1e9 * expected),
                    format!("{:.4} ns (ratio {ratio:.4})", 1e9 * found),
                    (ratio - 1.0).abs() < 2e-3,
                ));
            }
        }
    }
    lines
}

/// The formula for the limit against the eigenvalues of the scheme's whole map.
pub fn limit_of_the_map() -> Vec<Line> {
    let mut lines = Vec::new();
    for law in [sticking(0.0, 0.0), sticking(0.1, 0.3), sticking(0.9, 0.9)] {
        for candidate in lee_hurley(law) {
            for of in [
                Arrangement::amid(3, 1.0, 1e-3),
                Arrangement::amid(6, 1.0, 1e-3),
            ] {
                let matrices = of.matrices(&candidate);
                let (stated, found) = (
                    limit(&matrices),
                    bisected(limit(&matrices), 1e-6, |h| map_grows(&matrices, h)),
                );
                lines.push(line(
                    format!("{}, {}", of.name, candidate.name),
                    format!("{:.4} ns", 1e9 * stated),
                    format!("{:.4} ns", 1e9 * found),
                    (found / stated - 1.0).abs() < 1e-4,
                ));
            }
        }
    }
    lines
}

/// The scene of grains of `RADIUS` to `ratio` times as much at this κ.
fn scene(law: &Law, ratio: f64, stiffness_number: f64) -> Scene {
    let text = format!(
        "material = {{ young_modulus = {:?}, poisson_ratio = {:?}, density = {:?} }}
         contact = {{ friction = {:?}, rolling_friction = {:?}, damping_ratio = {:?}, rolling_damping_ratio = {:?} }}
         sample = {{ grains = 1000, radius_min = {RADIUS:?}, radius_max = {:?}, length = {:?} }}
         load.stiffness_number = {stiffness_number:?}
         shear = {{ velocity = 1e-4, strain = 0.1 }}",
        law.young_modulus,
        law.poisson_ratio,
        law.density,
        law.friction,
        law.rolling_friction,
        law.damping_ratio,
        law.rolling_damping_ratio,
        ratio * RADIUS,
        60.0 * ratio * RADIUS,
    );
    gshear_scene::load(&Source::new("limit.toml", text), &[]).expect("a sound scene")
}

/// The program's stability limit and default Δt at ten times the mean overlap, without sliding: in
/// a lattice, and for the smallest grain between as many of the largest as fit around it.
pub fn stated_by_the_program() -> Vec<Line> {
    let mut cases = Vec::new();
    for stiffness_number in [200.0, 1e4, 1e7] {
        for damping in [[0.0, 0.0], [0.1, 0.0], [0.1, 0.3], [0.9, 0.9]] {
            let lattice = Arrangement::lattice(10.0 / stiffness_number);
            cases.push((stiffness_number, damping, 1.0, lattice));
        }
    }
    for (ratio, count) in [(1.3, 5), (2.0, 4), (5.0, 3), (20.0, 2)] {
        let part = 10.0 / 1e4;
        let amid = Arrangement::amid(count, ratio, part);
        cases.push((1e4, [0.1, 0.3], ratio, amid));
    }
    cases
        .into_iter()
        .map(|(stiffness_number, [alpha, eta], ratio, of)| {
            let law = sticking(alpha, eta);
            let exact = lee_hurley(law)
                .iter()
                .map(|candidate| limit(&of.matrices(candidate)))
                .fold(f64::MAX, f64::min);
            let stated = scene(&law, ratio, stiffness_number).time_step;
            line(
                format!(
                    "κ = {stiffness_number:e}, α = {alpha}, η_r = {eta}: {}",
                    of.name
                ),
                format!("limit and default Δt below {:.4} ns", 1e9 * exact),
                format!(
                    "limit {:.4} ns (ratio {:.2}), default {:.4} ns (ratio {:.2})",
                    1e9 * stated.limit,
                    stated.limit / exact,
                    1e9 * stated.step,
                    stated.step / exact
                ),
                stated.limit <= exact && stated.step <= exact,
            )
        })
        .collect()
}
