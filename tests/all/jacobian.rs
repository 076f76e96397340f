//! J as the paper has it, and the spectra of K of spheres by the smoothed law. That K is the
//! derivative of the forces of every law is tested in `tests/all/stiffness_of_laws.rs`.

use bytemuck::Zeroable;
use faer::Mat;
use gshear_analysis::jacobian::{History, NetworkState, assemble, paper_form};
use gshear_dem::dimension::{Dimension, Three};
use gshear_dem::laws::Contact;
use gshear_dem::laws::mindlin::{Mindlin, MindlinSprings};
use gshear_dem::state::{Cell, ContactState, GrainState, Masses, Sheared, length};
use gshear_spectrum::{Problem, Solver, Spectrum};

type Vector = [f64; 3];

const CONTACT: Contact = Contact {
    friction: 0.4,
    ..Contact::NONE
};
const MASSES: Masses = Masses::Density(1.3);

/// Grains along each axis, and about as many mean diameters.
const SIDE: usize = 5;

struct Random(u64);

impl Random {
    /// In [-1, 1).
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Grains of random radii near a lattice, in a sheared box, pressed together; no pair is about to
/// touch or to part.
struct Packing {
    grains: Vec<GrainState>,
    cell: Cell,
    /// Overlap and n of the touching pairs.
    pairs: Vec<([u32; 2], f64, Vector)>,
}

impl Packing {
    fn new<D: Dimension>() -> Self {
        (1..)
            .map(Self::of_seed::<D>)
            .find(|packing| packing.pairs.len() > 1)
            .expect("one of many")
    }

    fn of_seed<D: Dimension>(seed: u64) -> Self {
        const SPACING: f64 = 0.97;
        let mut random = Random(seed);
        let box_side = SPACING * SIDE as f64;
        let cell = Cell {
            periods: [box_side, box_side],
            sheared: Some(Sheared {
                offset: 0.02,
                ..Sheared::upright(box_side)
            }),
        };
        let mut grains = Vec::new();
        for id in 0..SIDE.pow(D::AXES as u32) {
            let mut position = [0.0; 3];
            for (axis, x) in position[..D::AXES].iter_mut().enumerate() {
                let row = id / SIDE.pow(axis as u32) % SIDE;
                *x = SPACING * (row as f64 + 0.5 + 0.01 * random.next());
            }
            grains.push(GrainState {
                id: id as u32,
                radius: 0.5 + 0.03 * random.next(),
                position,
                ..GrainState::zeroed()
            });
        }
        let mut pairs = Vec::new();
        for (i, a) in grains.iter().enumerate() {
            for b in &grains[i + 1..] {
                let r = cell.separation::<D>(&a.position, &b.position);
                let overlap = a.radius + b.radius - length(r);
                if overlap.abs() < 1e-3 {
                    pairs.clear();
                    return Self {
                        grains,
                        cell,
                        pairs,
                    };
                }
                if overlap > 0.0 {
                    let n = r.map(|x| x / length(r));
                    pairs.push(([a.id, b.id], overlap, n));
                }
            }
        }
        Self {
            grains,
            cell,
            pairs,
        }
    }
}

const SMOOTH: MindlinSprings = MindlinSprings {
    normal_stiffness: 1.0,
    tangential_stiffness: 2.0 / 7.0,
    masses: MASSES,
};

/// Forces and torques over R by BO's eqs A3–A8 themselves, where t stays as n turns: q is of (r, R
/// θ), grain after grain.
fn forces_of_the_paper(
    grains: &[GrainState],
    contacts: &[ContactState],
    cell: Cell,
    q: &[f64],
) -> Vec<f64> {
    let at =
        |g: u32, first: usize| -> Vector { std::array::from_fn(|k| q[6 * g as usize + first + k]) };
    let mut sums = vec![0.0; q.len()];
    for c in contacts {
        let (a, b) = (&grains[c.i as usize], &grains[c.j as usize]);
        let r = cell.separation::<Three>(&at(c.i, 0), &at(c.j, 0));
        let n = r.map(|x| x / length(r));
        let overlap = a.radius + b.radius - length(r);
        // dr_ij and R_i dθ_i + R_j dθ_j from where the histories are.
        let before = cell.separation::<Three>(&a.position, &b.position);
        let dr: Vector = std::array::from_fn(|k| r[k] - before[k]);
        let (s_i, s_j) = (at(c.i, 3), at(c.j, 3));
        let s: Vector = std::array::from_fn(|k| s_i[k] + s_j[k]);
        let along = dr[0] * n[0] + dr[1] * n[1] + dr[2] * n[2];
        let surface_velocity = cross(n, s);
        let t: Vector =
            std::array::from_fn(|k| c.history[k] + dr[k] - along * n[k] + surface_velocity[k]);
        let part = length(t) / (0.4 * 3.5 * overlap);
        assert!(part < 1.0);
        let secant = 2.0 / 7.0 * overlap.sqrt() * (1.0 + part - part * part);
        let friction = t.map(|t| -secant * t);
        let moment = cross(n, friction);
        for k in 0..3 {
            let force = overlap.powf(1.5) * n[k] + friction[k];
            sums[6 * c.i as usize + k] += force;
            sums[6 * c.j as usize + k] -= force;
            sums[6 * c.i as usize + 3 + k] -= moment[k];
            sums[6 * c.j as usize + 3 + k] -= moment[k];
        }
    }
    sums
}

fn cross(a: Vector, b: Vector) -> Vector {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Spheres of mass 1 with contacts below their limits, all of them free.
fn spheres_of_the_paper() -> (Vec<GrainState>, Vec<ContactState>, Cell) {
    let packing = Packing::new::<Three>();
    let mut random = Random(5);
    let contacts = packing.pairs.iter().map(|&([i, j], overlap, n)| {
        let any = [random.next(), random.next(), random.next()];
        let t = cross(n, any);
        let size = (0.5 + 0.4 * random.next()) * 0.4 * 3.5 * overlap / length(t);
        let history = t.map(|x| size * x);
        ContactState::new(i, j, history)
    });
    let contacts = contacts.collect();
    (packing.grains, contacts, packing.cell)
}

/// Every block of B15 by its definition (B11–B14), and the spectrum of K of the law whose t does
/// not turn.
#[test]
fn the_form_of_the_paper() {
    const H: f64 = 2e-5;
    let (grains, contacts, cell) = spheres_of_the_paper();
    let state = NetworkState {
        flat: None,
        grains: &grains,
        contacts: &contacts,
        cell,
        masses: &Masses::Equal(1.0),
        at_rest: true,
    };
    let law = Mindlin::<Three, true>::new(&SMOOTH, &CONTACT);
    let jacobian = assemble::<Three>(state, &law, History::Unturned);
    let turned = assemble::<Three>(state, &law, History::Turned);
    let apart = turned.k.to_dense() - jacobian.k.to_dense();
    assert!(apart.norm_max() > 1e-3 * turned.k.to_dense().norm_max());
    assert_eq!(jacobian.sliding, 0);
    let j = paper_form(&jacobian, |g| grains[g as usize].radius).to_dense();
    let count = grains.len();
    let mut q: Vec<f64> = Vec::new();
    for g in &grains {
        q.extend(g.position);
        q.extend([0.0; 3]);
    }
    let mut worst = 0.0f64;
    for i in 0..count {
        for alpha in 0..6 {
            let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(|part| {
                let mut moved = q.clone();
                moved[6 * i + alpha] += part * H;
                forces_of_the_paper(&grains, &contacts, cell, &moved)
            });
            for k in 0..count {
                for beta in 0..6 {
                    let at = 6 * k + beta;
                    let slope = (a[at] - 8.0 * b[at] + 8.0 * c[at] - d[at]) / (12.0 * H);
                    // ∂F/∂r and ∂T̃/∂θ̃ with the sign turned round (B11, B14), ∂T̃/∂r and ∂F/∂θ̃ as
                    // they are (B13, B12).
                    let sign = if (alpha < 3) == (beta < 3) { -1.0 } else { 1.0 };
                    let inertia = if alpha < 3 { 1.0 } else { 0.4 };
                    let found = j[(alpha * count + i, beta * count + k)];
                    worst = worst.max((found - sign * slope / inertia).abs());
                }
            }
        }
    }
    assert!(worst < 1e-8 * j.norm_max(), "{worst:e}");

    let of_j = j.eigenvalues().expect("convergence");
    let null = jacobian.translations();
    let problem = Problem::new(&jacobian.k, &jacobian.mass, null.as_ref()).expect("a problem");
    let of_k = Spectrum::dense(&problem);
    assert_eq!(of_j.len(), of_k.eigenvalues.len());
    let norm = problem.norm();
    for e in &of_k.eigenvalues {
        let apart = of_j.iter().map(|z| (z - e.value).norm());
        let apart = apart.fold(f64::INFINITY, f64::min);
        let moves = e.condition.min(1e6) * 1e-11 * norm;
        assert!(apart < moves, "{}: {apart:e}", e.value);
    }
}

/// Translations are null vectors of K and of its transpose without walls; a force that leaves no
/// trace in the sum is found back.
#[test]
fn translations_are_null_vectors() {
    let (grains, contacts, cell) = spheres_of_the_paper();
    let state = NetworkState {
        flat: None,
        grains: &grains,
        contacts: &contacts,
        cell,
        masses: &MASSES,
        at_rest: true,
    };
    let law = Mindlin::<Three, true>::new(&SMOOTH, &CONTACT);
    let jacobian = assemble::<Three>(state, &law, History::Turned);
    let null = jacobian.translations();
    assert_eq!(null.ncols(), 3);
    let problem = Problem::new(&jacobian.k, &jacobian.mass, null.as_ref()).expect("null vectors");
    assert_eq!(problem.null().ncols(), 3);
    let image: Mat<f64> = jacobian.k.as_ref() * &null;
    assert!(image.norm_max() < 1e-14 * jacobian.k.to_dense().norm_max());
}

/// K x = b gives back what b was made of, whatever else moves freely, with one order of elimination
/// for all matrices of one pattern.
#[test]
fn linear_systems_are_solved() {
    let (mut grains, mut contacts, cell) = spheres_of_the_paper();
    // A sphere that touches none, and one that hangs on a single contact, about which it can turn.
    let free = grains.len() as u32;
    for _ in 0..2 {
        let mut grain = grains[0];
        grain.id = grains.len() as u32;
        grain.position[2] += 0.5 * SIDE as f64;
        grains.push(grain);
    }
    let r = cell.separation::<Three>(&grains[0].position, &grains[free as usize + 1].position);
    let onto = 0.97 * (grains[0].radius + grains[free as usize + 1].radius) / length(r);
    let (near, apart) = (grains[0].position, r.map(|x| onto * x));
    grains[free as usize + 1].position = std::array::from_fn(|k| near[k] - apart[k]);
    contacts.push(ContactState::new(0, free + 1, [0.0; 3]));
    let law = Mindlin::<Three, true>::new(&SMOOTH, &CONTACT);
    let mut solver = Solver::default();
    let mut random = Random(17);
    for part in [1.0, 0.5] {
        for c in &mut contacts {
            c.history = c.history.map(|t| part * t);
        }
        let state = NetworkState {
            flat: None,
            grains: &grains,
            contacts: &contacts,
            cell,
            masses: &Masses::Equal(1.0),
            at_rest: true,
        };
        let jacobian = assemble::<Three>(state, &law, History::Turned);
        let problem = jacobian.problem().expect("a problem");
        let factors = solver.factor(&problem).expect("factors");
        // Of all but the two spheres, and without translations: with masses of 1 their mean
        // displacement is 0.
        let held = 6 * free as usize;
        let mut x: Vec<f64> = (0..jacobian.unknowns()).map(|_| random.next()).collect();
        x[held..].fill(0.0);
        for axis in 0..3 {
            let mean = x[..held].iter().skip(axis).step_by(6).sum::<f64>() / f64::from(free);
            x[..held]
                .iter_mut()
                .skip(axis)
                .step_by(6)
                .for_each(|x| *x -= mean);
        }
        let right = Mat::from_fn(x.len(), 1, |i, _| x[i]);
        let b: Mat<f64> = jacobian.k.as_ref() * &right;
        let b: Vec<f64> = (0..x.len()).map(|i| b[(i, 0)]).collect();
        let solution = factors.solve(&b);
        assert!(solution.residual < 1e-13, "{:e}", solution.residual);
        let again: Mat<f64> = jacobian.k.as_ref() * Mat::from_fn(x.len(), 1, |i, _| solution.x[i]);
        let size = b.iter().fold(0.0f64, |most, b| most.max(b.abs()));
        for (i, b) in b.iter().enumerate() {
            assert!((again[(i, 0)] - b).abs() < 1e-12 * size, "{i}");
        }
        // Up to what moves freely the solution is x itself.
        for (i, (found, x)) in solution.x.iter().zip(&x).enumerate().take(held) {
            assert!((found - x).abs() < 1e-8, "{i}: {found} is not {x}");
        }
        assert!(solution.x[held..held + 6].iter().all(|x| *x == 0.0));
        for (g, [moved, turned]) in jacobian.by_grain(&solution.x) {
            let first = 6 * g as usize;
            assert_eq!(moved, solution.x[first..first + 3]);
            assert_eq!(turned, solution.x[first + 3..first + 6]);
        }
        let back = jacobian.unknowns_of(|g| {
            let x = &solution.x[6 * g as usize..];
            [[x[0], x[1], x[2]], [x[3], x[4], x[5]]]
        });
        assert_eq!(back, solution.x);
    }
    assert_eq!(solver.analyses, 1);
}

/// Eigenvalues alone are those with vectors, and the same at each call.
#[test]
fn eigenvalues_alone() {
    let (grains, contacts, cell) = spheres_of_the_paper();
    let state = NetworkState {
        flat: None,
        grains: &grains,
        contacts: &contacts,
        cell,
        masses: &Masses::Equal(1.0),
        at_rest: true,
    };
    let law = Mindlin::<Three, true>::new(&SMOOTH, &CONTACT);
    let problem = assemble::<Three>(state, &law, History::Turned)
        .problem()
        .expect("a problem");
    let values = Spectrum::values(&problem);
    assert_eq!(values, Spectrum::values(&problem));
    let whole = Spectrum::dense(&problem);
    assert_eq!(values.len(), whole.eigenvalues.len());
    for e in &whole.eigenvalues {
        let apart = values.iter().map(|z| (z - e.value).norm());
        let apart = apart.fold(f64::INFINITY, f64::min);
        let moves = e.condition.min(1e6) * 1e-12 * problem.norm();
        assert!(apart < moves, "{}: {apart:e}", e.value);
    }
}
