//! Tests against closed forms, the dense solver and planted eigenvalues.

use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Par, c64};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

fn sparse(n: usize, entries: &[(usize, usize, f64)]) -> SparseColMat<usize, f64> {
    let entries = entries.iter().map(|&(i, j, v)| Triplet::new(i, j, v));
    let entries: Vec<_> = entries.collect();
    SparseColMat::try_new_from_triplets(n, n, &entries).expect("indices within the matrix")
}

/// The entries of a matrix that are not 0.
fn entries_of(dense: &Mat<f64>) -> Vec<(usize, usize, f64)> {
    let places = (0..dense.ncols()).flat_map(|j| (0..dense.nrows()).map(move |i| (i, j)));
    let entries = places.map(|(i, j)| (i, j, dense[(i, j)]));
    entries.filter(|entry| entry.2 != 0.0).collect()
}

fn problem(k: &SparseColMat<usize, f64>) -> Problem {
    let null = Mat::zeros(k.ncols(), 0);
    Problem::new(k, &vec![1.0; k.ncols()], null.as_ref()).expect("fit")
}

fn near(problem: &Problem, shift: c64, count: usize) -> Nearest {
    let symbolic = Symbolic::new(problem.matrix().symbolic());
    let request = Request {
        shift,
        count,
        left: true,
        par: Par::Seq,
    };
    nearest(problem, &symbolic, request).expect("it converges")
}

fn are_all_real(spectrum: &Spectrum) -> bool {
    count_of(spectrum, Verdict::Real) == spectrum.eigenvalues.len()
}

fn count_of(spectrum: &Spectrum, verdict: Verdict) -> usize {
    let is_one = |e: &&Eigenvalue| e.verdict == verdict;
    spectrum.eigenvalues.iter().filter(is_one).count()
}

/// Tridiagonal Toeplitz matrix with b above and c below the diagonal: λ_k = a + 2√(bc) cos(kπ/(n +
/// 1)).
fn toeplitz(n: usize, [a, b, c]: [f64; 3]) -> (SparseColMat<usize, f64>, Vec<c64>) {
    let mut entries = Vec::new();
    for i in 0..n {
        entries.push((i, i, a));
        if i + 1 < n {
            entries.extend([(i, i + 1, b), (i + 1, i, c)]);
        }
    }
    let root = c64::new(b * c, 0.0).sqrt();
    let value =
        |k: usize| a + 2.0 * root * (k as f64 * std::f64::consts::PI / (n as f64 + 1.0)).cos();
    (sparse(n, &entries), (1..=n).map(value).collect())
}

/// Blocks of size 1 (real) and 2 (pairs a ± ib), rotated in random planes, which keeps the matrix
/// normal and sparse.
fn planted(
    blocks: &[(f64, f64)],
    rotations: usize,
    seed: u64,
) -> (SparseColMat<usize, f64>, Vec<c64>) {
    let mut values = Vec::new();
    for &(a, b) in blocks {
        values.push(c64::new(a, b));
        if b != 0.0 {
            values.push(c64::new(a, -b));
        }
    }
    let n = values.len();
    let mut dense = Mat::<f64>::zeros(n, n);
    for (at, value) in values.iter().enumerate() {
        dense[(at, at)] = value.re;
        if value.im > 0.0 {
            dense[(at, at + 1)] = value.im;
            dense[(at + 1, at)] = -value.im;
        }
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..rotations {
        let (p, q) = (random.random_range(0..n), random.random_range(0..n));
        if p == q {
            continue;
        }
        let (s, c) = random.random_range(-3.0..3.0f64).sin_cos();
        let mut turn = |a: (usize, usize), b: (usize, usize)| {
            let (x, y) = (dense[a], dense[b]);
            dense[a] = c * x + s * y;
            dense[b] = c * y - s * x;
        };
        (0..n).for_each(|j| turn((p, j), (q, j)));
        (0..n).for_each(|i| turn((i, p), (i, q)));
    }
    (sparse(n, &entries_of(&dense)), values)
}

/// Asserts that the k eigenvalues found are those of `exact` nearest the shift, one by one, with
/// small residuals.
fn assert_nearest(problem: &Problem, found: &Spectrum, exact: &[c64], shift: c64, tolerance: f64) {
    let distance = |z: &c64| (z - shift).norm();
    let mut rest: Vec<c64> = exact.to_vec();
    rest.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    let distances = found.eigenvalues.iter().map(|e| distance(&e.value));
    let farthest = distances.fold(0.0, f64::max);
    for e in &found.eigenvalues {
        assert!(e.residual <= 1e-12, "{e:?}");
        let apart = |k: usize| (rest[k] - e.value).norm();
        let best = (0..rest.len()).min_by(|&a, &b| apart(a).total_cmp(&apart(b)));
        let best = best.expect("no more than there are");
        let error = (rest.remove(best) - e.value).norm() / problem.norm();
        assert!(error < tolerance, "{e:?}: {error:e}");
    }
    // None of the remaining ones is nearer than those found.
    let least = farthest - 1e-9 * problem.norm();
    assert!(rest.iter().all(|z| distance(z) >= least));
}

#[test]
fn toeplitz_with_real_and_with_complex_eigenvalues() {
    // bc > 0: real; bc < 0: a ± 2i√|bc| cos. √(b/c) stays near 1, so the condition numbers do as
    // well.
    for coefficients in [[2.0, -1.0, -1.05], [1.0, 0.5, -0.52]] {
        let (k, exact) = toeplitz(60, coefficients);
        let problem = problem(&k);
        let dense = Spectrum::dense(&problem);
        assert_eq!(dense.eigenvalues.len(), 60);
        let centre = c64::new(0.0, 0.0);
        assert_nearest(&problem, &dense, &exact, centre, 1e-12);
        for shift in [c64::new(1.3, 0.0), c64::new(1.0, 0.4)] {
            let found = near(&problem, shift, 12);
            assert!(found.spectrum.eigenvalues.len() >= 12);
            assert_nearest(&problem, &found.spectrum, &exact, shift, 1e-11);
        }
    }
}

/// Five-point stencil of ∇² with convection on a square: a sum of two Toeplitz matrices, whose
/// eigenvalues add.
#[test]
fn convection_and_diffusion_on_a_square() {
    let (side, convection) = (30, 0.2);
    let (one, values) = toeplitz(side, [2.0, -1.0 + convection, -1.0 - convection]);
    let mut entries = Vec::new();
    for entry in one.triplet_iter() {
        for other in 0..side {
            let (i, j) = (entry.row, entry.col);
            entries.push((i * side + other, j * side + other, *entry.val));
            entries.push((other * side + i, other * side + j, *entry.val));
        }
    }
    let sums = |a: &c64| values.iter().map(|b| a + b).collect::<Vec<c64>>();
    let exact: Vec<c64> = values.iter().flat_map(sums).collect();
    let problem = problem(&sparse(side * side, &entries));
    // All but those on the diagonal are double, because a + b = b + a.
    let found = near(&problem, c64::new(0.0, 0.0), 25);
    assert_nearest(&problem, &found.spectrum, &exact, c64::new(0.0, 0.0), 1e-10);
    assert!(are_all_real(&found.spectrum));
}

#[test]
fn sparse_and_dense_agree_in_values_vectors_and_conditions() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let n = 150;
    let mut entries = Vec::new();
    for i in 0..n {
        entries.push((i, i, random.random_range(0.0..4.0)));
        for step in [1, 7, 31] {
            let j = (i + step) % n;
            let v = random.random_range(-1.0..0.0);
            entries.push((i, j, v));
            entries.push((j, i, v + random.random_range(-0.3..0.3)));
        }
    }
    let k = sparse(n, &entries);
    let mass: Vec<f64> = (0..n).map(|i| 0.5 + 0.01 * i as f64).collect();
    let problem = Problem::new(&k, &mass, Mat::zeros(n, 0).as_ref()).expect("fit");
    let dense = Spectrum::dense(&problem);
    assert!(dense.eigenvalues.iter().any(|e| e.verdict == Verdict::Pair));
    let exact: Vec<c64> = dense.eigenvalues.iter().map(|e| e.value).collect();
    let grown = amplified(&problem, 0.002, 150);
    assert!(grown.complete);
    let within = |of: &Spectrum| {
        let inside = |e: &&Eigenvalue| e.value.im >= 0.002 * problem.norm();
        let inside = of.eigenvalues.iter().filter(inside);
        let mut values: Vec<c64> = inside.map(|e| e.value).collect();
        values.sort_by(|a, b| a.re.total_cmp(&b.re));
        values
    };
    let (some, all) = (within(&grown.spectrum), within(&dense));
    assert!(all.len() > 3 && some.len() == all.len(), "{some:?} {all:?}");
    assert!(some.iter().zip(&all).all(|(a, b)| (a - b).norm() < 1e-10));
    for shift in [c64::new(1.0, 0.0), c64::new(0.5, 0.3)] {
        let found = near(&problem, shift, 16).spectrum;
        assert_nearest(&problem, &found, &exact, shift, 1e-12);
        for (at, e) in found.eigenvalues.iter().enumerate() {
            let same = |other: &Eigenvalue| (other.value - e.value).norm() < 1e-9;
            let other = dense.eigenvalues.iter().position(same);
            let other = other.expect("it is there");
            let ratio = e.condition / dense.eigenvalues[other].condition;
            assert!((ratio - 1.0).abs() < 1e-6, "{e:?} {ratio}");
            let overlap = found.right.col(at).adjoint() * dense.right.col(other);
            assert!((overlap.norm() - 1.0).abs() < 1e-9);
            // Check K v = λ M v with the unscaled vector.
            let v = found.eigenvector(&problem, at);
            let mut rest: Vec<c64> = (0..n).map(|i| -e.value * mass[i] * v[i]).collect();
            k.triplet_iter()
                .for_each(|k| rest[k.row] += *k.val * v[k.col]);
            assert!(rest.iter().all(|rest| rest.norm() < 1e-11));
        }
    }
}

#[test]
fn planted_pairs_are_found_and_counted() {
    let mut blocks: Vec<(f64, f64)> = (0..80).map(|k| (0.03 + 0.05 * f64::from(k), 0.0)).collect();
    // Wide pairs, one with |Im λ| = 10⁻⁶ ‖A‖, and a double one.
    let pairs = [
        (0.31, 0.5),
        (1.0, 0.02),
        (1.72, 4e-6),
        (2.2, 0.3),
        (2.2, 0.3),
        (3.3, 0.11),
    ];
    blocks.extend(pairs);
    let (k, exact) = planted(&blocks, 150, 7);
    let problem = problem(&k);
    let symbolic = Symbolic::new(problem.matrix().symbolic());
    let bounds = bendixson(&problem);
    let all = scan(&problem, &symbolic, bounds.re, 12, Par::Seq).expect("it converges");
    assert_eq!(all.spectrum.eigenvalues.len(), exact.len());
    assert_nearest(&problem, &all.spectrum, &exact, c64::new(0.0, 0.0), 1e-10);
    assert_eq!(count_of(&all.spectrum, Verdict::Pair), 2 * pairs.len());

    let strip = Rectangle {
        re: [bounds.re[0] - 0.1, bounds.re[1] + 0.1],
        im: [f64::EPSILON.sqrt() * problem.norm(), bounds.im[1] + 0.1],
    };
    let count = |rectangle, known: &[c64]| {
        let counted = winding(&problem, &symbolic, rectangle, known, Par::Seq);
        counted.expect("a clear contour").eigenvalues
    };
    assert_eq!(count(strip, &exact), 6);
    // Two unknown eigenvalues are counted, and a known one that does not exist is not.
    let known: Vec<c64> = exact.iter().copied().filter(|z| z.re != 2.2).collect();
    assert_eq!(count(strip, &known), 6);
    let mut invented = exact.clone();
    invented.extend([c64::new(2.9, 0.4), c64::new(2.9, -0.4)]);
    assert_eq!(count(strip, &invented), 6);
    // Without known eigenvalues: from above the pair of 4·10⁻⁶ on, along a contour that passes no
    // eigenvalue closely.
    let high = Rectangle {
        im: [0.01, strip.im[1]],
        ..strip
    };
    assert_eq!(count(high, &[]), 5);
}

fn amplified(problem: &Problem, resolution: f64, most: usize) -> Unstable {
    let sought = Sought {
        resolution,
        most,
        par: Par::Seq,
    };
    unstable(problem, sought).expect("it converges")
}

/// Growth rates over three decades in one matrix with 800 stable modes: a single polynomial would
/// drown the slowest.
#[test]
fn what_grows_is_found_among_what_does_not() {
    let mut blocks: Vec<(f64, f64)> = (0..800).map(|k| (0.005 * f64::from(k), 0.0)).collect();
    let growing = [
        (0.31, 0.9),
        (1.0, 0.02),
        (1.72, 0.0009),
        (2.2, 0.3),
        (2.2, 0.3),
        (3.3, 0.011),
        (-0.4, 0.0),
        (-1e-3, 0.0),
    ];
    blocks.extend(growing);
    // A pair below the requested resolution.
    blocks.push((2.0, 1e-5));
    let (k, _) = planted(&blocks, 400, 3);
    let problem = problem(&k);
    let found = amplified(&problem, 1e-4, 20);
    let degrees = &found.degrees;
    assert!(found.complete && degrees.len() > 3, "{degrees:?}");
    let mut left: Vec<c64> = growing.iter().map(|&(re, im)| c64::new(re, im)).collect();
    for e in &found.spectrum.eigenvalues {
        assert!(e.residual < 1e-11, "{e:?}");
        // The matrix is normal, but the vectors of a double eigenvalue are any two.
        let double = (e.value.re - 2.2).abs() < 1e-9;
        assert!(double || (e.condition - 1.0).abs() < 1e-6, "{e:?}");
        let upper = c64::new(e.value.re, e.value.im.abs());
        let at = left.iter().position(|z| (z - upper).norm() < 1e-10);
        if e.value.im >= 0.0 {
            left.remove(at.unwrap_or_else(|| panic!("{e:?} was not planted")));
        }
    }
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn nothing_grows_in_a_stable_matrix() {
    let (k, _) = toeplitz(400, [2.0, -1.0, -1.0]);
    let found = amplified(&problem(&k), 1e-3, 20);
    assert!(found.complete && found.spectrum.eigenvalues.is_empty());
}

#[test]
fn exceptional_points_give_no_pair() {
    // Jordan blocks of two and three at 1 and 2, transformed by a similarity that rounds.
    let mut dense = Mat::<f64>::zeros(12, 12);
    let diagonal = [1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0];
    (0..12).for_each(|i| dense[(i, i)] = diagonal[i]);
    dense[(0, 1)] = 1.0;
    dense[(2, 3)] = 1.0;
    dense[(3, 4)] = 1.0;
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let frame = Mat::from_fn(12, 12, |i, j| {
        f64::from(u8::from(i == j)) + 0.2 * random.random_range(-1.0..1.0)
    });
    let inverse = faer::linalg::solvers::DenseSolveCore::inverse(&frame.partial_piv_lu());
    let bent = &frame * dense * inverse;
    let problem = problem(&sparse(12, &entries_of(&bent)));
    for spectrum in [
        Spectrum::dense(&problem),
        near(&problem, c64::new(1.6, 0.0), 5).spectrum,
    ] {
        for e in &spectrum.eigenvalues {
            assert!(e.residual <= 1e-12, "{e:?}");
            assert_ne!(e.verdict, Verdict::Pair, "{e:?}");
            let defective = e.value.re < 2.5;
            assert_eq!(e.condition > 1e6, defective, "{e:?}");
        }
    }
}

#[test]
fn a_pair_just_born_is_evidence_and_one_below_the_limit_is_not() {
    // ((1, 1), (-δ², 1)): 1 ± iδ, with condition about 1/(2δ).
    for (delta, verdict) in [(1e-5, Verdict::Pair), (1e-9, Verdict::Doubtful)] {
        let entries = [
            (0, 0, 1.0),
            (0, 1, 1.0),
            (1, 0, -delta * delta),
            (1, 1, 1.0),
            (2, 2, 3.0),
        ];
        let spectrum = Spectrum::dense(&problem(&sparse(3, &entries)));
        let near_one = |e: &&Eigenvalue| e.value.re < 2.0;
        for e in spectrum.eigenvalues.iter().filter(near_one) {
            assert_eq!(e.verdict, verdict, "{e:?}");
        }
    }
}

#[test]
fn a_singular_shift_is_moved() {
    let (k, exact) = toeplitz(50, [2.0, -1.0, -1.0]);
    let problem = problem(&k);
    let at = exact[20];
    let found = near(&problem, at, 6);
    assert_ne!(found.shift, at);
    assert!((found.shift - at).norm() < 1e-4 * problem.norm());
    assert_nearest(&problem, &found.spectrum, &exact, at, 1e-12);
}

/// A shift that is an eigenvalue to rounding: its θ is so great that rounding drowns the others,
/// though no pivot tells.
#[test]
fn a_shift_at_an_eigenvalue_is_moved() {
    let mut values: Vec<(f64, f64)> = (0..80).map(|k| (1.0 + f64::from(k), 0.0)).collect();
    values.extend((0..20).map(|k| (4.5 + 3.0 * f64::from(k), 0.3)));
    let (k, exact) = planted(&values, 150, 9);
    let problem = problem(&k);
    for at in [exact[30], exact[60]] {
        let found = near(&problem, at, 20);
        assert!((found.shift - at).norm() < 1e-2 * problem.norm());
        assert_nearest(&problem, &found.spectrum, &exact, found.shift, 1e-11);
    }
}

#[test]
fn zero_modes_are_set_apart() {
    // A ring of springs (with translation as zero mode) and two unknowns without springs
    // (rattlers).
    let n = 40;
    let mut entries = Vec::new();
    for i in 0..n {
        entries.extend([(i, i, 2.0), (i, (i + 1) % n, -1.0), ((i + 1) % n, i, -1.0)]);
    }
    entries.push((n, n, 0.0));
    let k = sparse(n + 2, &entries);
    let translation = Mat::from_fn(n + 2, 1, |i, _| if i < n { 1.0 } else { 0.0 });
    let fit = Problem::new(&k, &vec![2.0; n + 2], translation.as_ref()).expect("fit");
    assert_eq!((fit.size(), fit.rattling(), fit.null().ncols()), (n, 2, 1));
    let angle = |k: usize| k as f64 * std::f64::consts::TAU / n as f64;
    let exact = (1..n).map(|k| c64::new(1.0 - angle(k).cos(), 0.0));
    let exact: Vec<c64> = exact.collect();
    let found = near(&fit, c64::new(0.0, 0.0), 6);
    assert_ne!(found.shift, c64::new(0.0, 0.0));
    assert_nearest(&fit, &found.spectrum, &exact, c64::new(0.0, 0.0), 1e-12);
    assert!(are_all_real(&found.spectrum));

    // Without null vectors given, the translation is found and recognised as zero.
    let untold = Problem::new(&k, &vec![2.0; n + 2], Mat::zeros(n + 2, 0).as_ref()).expect("fit");
    let found = near(&untold, c64::new(0.0, 0.0), 7);
    assert_eq!(count_of(&found.spectrum, Verdict::Zero), 1);

    let slope = Mat::from_fn(n + 2, 1, |i, _| i as f64);
    let unfit = Problem::new(&k, &vec![2.0; n + 2], slope.as_ref()).err();
    assert!(matches!(unfit, Some(Unfit::Null(what)) if what.starts_with("column 1: leaves")));
}

#[test]
fn eigenvalues_of_high_multiplicity_are_all_found() {
    let value = |k: u32| if k < 9 { 1.0 } else { 1.5 + f64::from(k) };
    let blocks: Vec<(f64, f64)> = (0..60).map(|k| (value(k), 0.0)).collect();
    let (k, exact) = planted(&blocks, 80, 13);
    let problem = problem(&k);
    let found = near(&problem, c64::new(0.8, 0.0), 12);
    assert_nearest(&problem, &found.spectrum, &exact, c64::new(0.8, 0.0), 1e-12);
}

#[test]
fn participation_counts_grains() {
    let v = [3.0, 4.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0].map(|x| c64::new(0.0, x));
    assert_eq!(participation(&v, &[0, 0, 1, 1, 2, 2, 3, 3]), 0.5);
    assert_eq!(participation(&v[..1], &[0]), 1.0);
}

/// Slightly wrong vectors become right, and their eigenvalues as well.
#[test]
fn residuals_are_refined() {
    let mut random = ChaCha8Rng::seed_from_u64(23);
    let n = 60;
    let mut entries = Vec::new();
    for i in 0..n {
        entries.push((i, i, 1.0 + 0.1 * i as f64));
        for j in [(i + 1) % n, (i + 7) % n] {
            entries.push((i, j, random.random_range(-1.0..1.0)));
            entries.push((j, i, random.random_range(-1.0..1.0)));
        }
    }
    let problem = problem(&sparse(n, &entries));
    let exact = Spectrum::dense(&problem);
    let mut spectrum = Spectrum::dense(&problem);
    for (j, e) in spectrum.eigenvalues.iter_mut().enumerate() {
        e.value += c64::new(1e-8, 1e-8);
        e.residual = 1e-8;
        (0..n).for_each(|i| spectrum.right[(i, j)] += 1e-8 * random.random_range(-1.0..1.0));
    }
    let symbolic = Symbolic::new(problem.matrix().symbolic());
    assert_eq!(spectrum.refine(&problem, &symbolic, Par::Seq), 0);
    for (found, exact) in spectrum.eigenvalues.iter().zip(&exact.eigenvalues) {
        assert!(found.residual <= RESIDUAL, "{:e}", found.residual);
        let apart = (found.value - exact.value).norm();
        let most = 1e-11 * exact.condition * problem.norm();
        assert!(apart < most, "{apart:e}");
    }
}
