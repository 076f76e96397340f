//! The analysis against other programs: `references/make.py` says which, and made the values in
//! `references/*.json`.

use gshear_analysis::dbscan::Dbscan;
use gshear_analysis::dmin::NonAffine;
use gshear_analysis::interval::Interval;
use gshear_analysis::spearman::{Spearman, ranks};
use gshear_dem::dimension::{Dimensions, Two};
use gshear_dem::state::{Cell, ContactSample, Frame, GrainConstants, GrainSample};
use serde_json::Value;

/// The cases of a file, each a JSON object.
fn cases(json: &str) -> Vec<Value> {
    serde_json::from_str(json).expect("JSON")
}

fn count(case: &Value, name: &str) -> usize {
    case[name].as_u64().expect("a count") as usize
}

/// NaN for null.
fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// As `uniform` of `make.py`.
fn uniform(seed: u64, count: usize) -> Vec<f64> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53)
    };
    (0..count).map(|_| next()).collect()
}

#[test]
fn spearman_p_and_ranks_are_those_of_scipy() {
    let cases = cases(include_str!("references/spearman.json"));
    assert_eq!(cases.len(), 21);
    for case in &cases {
        let (n, seed) = (count(case, "count"), case["seed"].as_u64().expect("a seed"));
        let (weight, levels) = (number(&case["weight"]), number(&case["levels"]));
        let mut x = uniform(2 * seed, n);
        let noise = uniform(2 * seed + 1, n);
        let mix = x.iter().zip(&noise);
        let mut y: Vec<f64> = mix
            .map(|(x, noise)| weight * x + (1.0 - weight.abs()) * noise)
            .collect();
        if levels > 0.0 {
            let values = x.iter_mut().chain(&mut y);
            values.for_each(|value| *value = (*value * levels).floor());
        }
        let pairs = x.iter().zip(&y).map(|(x, y)| [*x, *y]);
        let found = Spearman::default().of(pairs);
        let (rho, p) = (number(&case["rho"]), number(&case["p"]));
        assert_eq!(found.count, n);
        if rho.is_nan() {
            assert!(found.rho.is_nan() && found.p.is_nan(), "{case}: {found:?}");
        } else {
            assert!((found.rho - rho).abs() <= 1e-12, "{case}: {found:?}");
            assert!((found.p - p).abs() <= 1e-12, "{case}: {found:?}");
            // Small ones too, as far as the last bit of ρ, magnified by the power of 1-ρ², lets
            // them.
            let magnified = n as f64 / (1.0 - rho * rho);
            if rho.abs() < 0.9999 {
                let allowed = 1e-12 + f64::EPSILON * magnified;
                assert!((found.p / p - 1.0).abs() <= allowed, "{case}: {found:?}");
            }
        }
        if let Some(wanted) = case["ranks"].as_array() {
            for (values, wanted) in [&x, &y].into_iter().zip(wanted) {
                let wanted: Vec<f64> = wanted
                    .as_array()
                    .expect("ranks")
                    .iter()
                    .map(number)
                    .collect();
                assert_eq!(ranks(values), wanted, "{case}");
            }
        }
    }
}

#[test]
fn clusters_are_those_of_scikit_learn() {
    let cases = cases(include_str!("references/dbscan.json"));
    assert_eq!(cases.len(), 50);
    let (mut dbscan, mut labels) = (Dbscan::default(), Vec::new());
    let cell = Cell::between_walls([1.0, f64::INFINITY]);
    let mut noise = 0;
    for case in &cases {
        let n = count(case, "count");
        let coordinates = uniform(case["seed"].as_u64().expect("a seed"), 2 * n);
        let points: Vec<[f64; 3]> = (coordinates.chunks(2).map(|r| [r[0], r[1], 0.0])).collect();
        let (reach, least) = (number(&case["reach"]), count(case, "min_points"));
        let clusters = dbscan.clusters::<Two>(cell, reach, least, &points, &mut labels);
        let wanted: Vec<i64> = case["labels"]
            .as_array()
            .expect("labels")
            .iter()
            .map(|label| label.as_i64().expect("a label"))
            .collect();
        assert_eq!(wanted.len(), n);
        assert_eq!(clusters as i64, wanted.iter().max().expect("points") + 1);
        // The same up to renaming: -1 is noise, and each name of the one is one name of the other.
        let mut names = vec![None; clusters];
        for (label, wanted) in labels.iter().zip(&wanted) {
            match label {
                None => assert_eq!(*wanted, -1, "{case}"),
                Some(label) => {
                    let name = names[*label as usize].get_or_insert(*wanted);
                    assert_eq!(*name, *wanted, "{case}");
                }
            }
        }
        noise += wanted.iter().filter(|label| **label < 0).count();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), clusters, "{case}");
    }
    assert!(noise > 100, "the sets have noise in them");
}

#[test]
fn dmin_is_the_sum_of_ovito_over_the_number_of_neighbours() {
    let cases = cases(include_str!("references/dmin.json"));
    assert_eq!(cases.len(), 3);
    for case in &cases {
        let n = count(case, "count");
        let (side, moved) = (number(&case["side"]), number(&case["moved"]));
        let u = uniform(case["seed"].as_u64().expect("a seed"), 4 * n);
        let earlier: Vec<[f64; 2]> = (0..n).map(|k| [u[k] * side, u[n + k] * side]).collect();
        let later = (0..n).map(|k| {
            let [x, y] = earlier[k];
            let [dx, dy] = [u[2 * n + k], u[3 * n + k]];
            [x + 0.01 * y + moved * (dx - 0.5), y + moved * (dy - 0.5)]
        });
        let grains = GrainConstants {
            radius: vec![1.0; n],
            body: vec![0; n],
            mass: vec![1.0; n],
        };
        // Every grain with every other: no rattlers, as OVITO knows none.
        let none: ContactSample = bytemuck::Zeroable::zeroed();
        let contacts = (0..n as u32).map(|i| ContactSample {
            i: i.min((i + 1) % n as u32),
            j: i.max((i + 1) % n as u32),
            ..none
        });
        let contacts: Vec<ContactSample> = contacts.clone().chain(contacts).collect();
        let grain = |[x, y]: &[f64; 2]| GrainSample {
            position: [x.rem_euclid(side), *y, 0.0],
            image: [x.div_euclid(side) as i64, 0, 0],
            ..bytemuck::Zeroable::zeroed()
        };
        let frame = |places: &[[f64; 2]]| Frame {
            dimension: Dimensions::Two,
            cell: Cell::between_walls([side, f64::INFINITY]),
            step: 0,
            time: 0.0,
            grains: places.iter().map(grain).collect(),
            contacts: contacts.clone(),
            wall_contacts: Vec::new(),
        };
        let later: Vec<[f64; 2]> = later.collect();
        let frames = [frame(&earlier), frame(&later)];
        let interval = Interval::between_walls([&frames[0], &frames[1]]);
        let mut found = vec![0.0; n];
        NonAffine::default().between(&grains, &interval, 5.0, &mut found);
        let wanted = case["dmin"].as_array().expect("values");
        assert_eq!(wanted.len(), n);
        for (grain, (found, wanted)) in found.iter().zip(wanted).enumerate() {
            let wanted = number(wanted);
            assert!(
                (found - wanted).abs() <= 1e-10 * wanted,
                "{n} grains, grain {grain}: {found:e} against {wanted:e}"
            );
        }
    }
}
