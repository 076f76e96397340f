use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::propagator::{Change, FAR, Harmonic, Propagator, Quantity};
use super::*;
use crate::testing::grains_of;
use gshear_dem::state::Sheared;

const L: f64 = 20.0;

/// Active grains of an interval at these places (m) with this D²min each, which do not move; the
/// strain of each is that of its number.
fn active(number: usize, cell: Cell, grains: &[(u32, [f64; 3], f64)]) -> ActiveInterval {
    let grain = |(grain, place, dmin): &(u32, [f64; 3], f64)| ActiveGrain {
        grain: *grain,
        dmin: *dmin,
        strain: LocalStrain {
            along: 1.0 + f64::from(*grain),
            invariant: 0.5,
        },
        from: *place,
        to: *place,
        displacement: [0.0; 3],
    };
    ActiveInterval {
        number,
        cell,
        grains: grains.iter().map(grain).collect(),
    }
}

const TWO: Dimensions = Dimensions::Two;
const THREE: Dimensions = Dimensions::Three;

fn walls() -> Cell {
    Cell::between_walls([L, f64::INFINITY])
}

fn links(reach: f64, gap: usize) -> Links {
    Links { reach, gap }
}

/// The grains of each event.
fn members(events: &[Event], active: &[ActiveInterval]) -> Vec<Vec<u32>> {
    let grain = |[k, n]: &[usize; 2]| active[*k].grains[*n].grain;
    let members = events.iter().map(|event| event.members.iter().map(grain));
    members.map(Iterator::collect).collect()
}

#[test]
fn near_grains_of_an_interval_are_one_event_also_across_the_edge() {
    // A row of three, two across the edge, and one alone. The reach is 1.5.
    let grains = grains_of(&[0.5; 10]);
    let interval = active(
        4,
        walls(),
        &[
            (0, [5.0, 3.0, 0.0], 1.0),
            (2, [6.4, 3.0, 0.0], 1.0),
            (3, [19.5, 7.0, 0.0], 3.0),
            (5, [7.8, 3.0, 0.0], 2.0),
            (8, [0.5, 7.0, 0.0], 1.0),
            (9, [12.0, 9.0, 0.0], 5.0),
        ],
    );
    let active = [interval];
    let events = find(&grains, &active, links(1.5, 0), TWO);
    assert_eq!(
        members(&events, &active),
        [vec![0, 2, 5], vec![3, 8], vec![9]]
    );
    let [row, edge, alone] = &events[..] else {
        panic!("three events")
    };
    assert_eq!((row.intervals, row.grains), ([4, 4], 3));
    // Weights 1, 1, 2: (5 + 6.4 + 15.6)/4.
    assert!((row.place[0] - 6.75).abs() < 1e-14 && row.place[1] == 3.0);
    assert!((row.extent[0] - 2.8).abs() < 1e-14 && row.extent[1] == 0.0);
    // Three points 1.4 apart: 1.4 √(2/3).
    assert!((row.gyration - 1.4 * (2.0_f64 / 3.0).sqrt()).abs() < 1e-14);
    assert_eq!(
        (row.dmin_sum, row.dmin_greatest, row.strain_sum),
        (4.0, 2.0, 1.5)
    );
    assert_eq!(row.shear_strain_sum, 1.0 + 3.0 + 6.0);
    // Weights 3 at 19.5 and 1 at 20.5.
    assert!((edge.place[0] - 19.75).abs() < 1e-14, "{:?}", edge.place);
    assert_eq!((edge.extent[0], edge.gyration), (1.0, 0.5));
    assert_eq!(
        (alone.grains, alone.gyration, alone.place),
        (1, 0.0, [12.0, 9.0, 0.0])
    );
}

#[test]
fn an_event_that_goes_around_the_cell_is_not_torn() {
    // Twelve grains 1.5 apart, beginning near the edge: half the period is 10.
    let grains = grains_of(&[0.5; 12]);
    let places = (0..12).map(|k| (k, [(15.0 + 1.5 * f64::from(k)) % L, 3.0, 0.0], 1.0));
    let active = [active(0, walls(), &places.collect::<Vec<_>>())];
    let events = find(&grains, &active, links(1.6, 0), TWO);
    assert_eq!((events.len(), events[0].grains), (1, 12));
    assert!((events[0].extent[0] - 16.5).abs() < 1e-12);
    assert!((events[0].place[0] - (15.0 + 8.25 - L)).abs() < 1e-12);
    // Of n points at a distance a: a √((n² - 1)/12).
    assert!((events[0].gyration - 1.5 * (143.0_f64 / 12.0).sqrt()).abs() < 1e-12);
}

#[test]
fn grains_that_touch_are_near_whatever_the_reach() {
    let mut grains = grains_of(&[0.5; 3]);
    (grains.radius[0], grains.radius[1]) = (3.0, 2.0);
    let places = [
        (0, [5.0, 5.0, 0.0], 1.0),
        (1, [10.0, 5.0, 0.0], 1.0),
        (2, [15.0, 5.0, 0.0], 1.0),
    ];
    let active = [active(0, walls(), &places)];
    let events = find(&grains, &active, links(1.5, 0), TWO);
    assert_eq!(members(&events, &active), [vec![0, 1], vec![2]]);
}

#[test]
fn events_go_on_in_consecutive_intervals_and_across_gaps_that_are_allowed() {
    let grains = grains_of(&[0.5; 9]);
    let place = [5.0, 3.0, 0.0];
    let beside = [6.0, 3.0, 0.0];
    let active = [
        active(0, walls(), &[(0, place, 1.0), (7, [15.0, 3.0, 0.0], 1.0)]),
        // Another grain beside the first one.
        active(1, walls(), &[(1, beside, 1.0)]),
        active(4, walls(), &[(0, place, 1.0)]),
        active(6, walls(), &[(1, beside, 1.0), (7, [15.0, 3.0, 0.0], 1.0)]),
    ];
    let of_gap = |gap| {
        let events = find(&grains, &active, links(1.5, gap), TWO);
        let intervals = events.iter().map(|event| event.intervals);
        (members(&events, &active), intervals.collect::<Vec<_>>())
    };
    let (found, intervals) = of_gap(0);
    assert_eq!(found, [vec![0, 1], vec![7], vec![0], vec![1], vec![7]]);
    assert_eq!(intervals, [[0, 1], [0, 0], [4, 4], [6, 6], [6, 6]]);
    assert_eq!(of_gap(1).0, [vec![0, 1], vec![7], vec![0, 1], vec![7]]);
    let (found, intervals) = of_gap(2);
    assert_eq!(found, [vec![0, 1, 0, 1], vec![7], vec![7]]);
    assert_eq!(intervals[0], [0, 6]);
    assert_eq!(of_gap(5).0, [vec![0, 1, 0, 1], vec![7, 7]]);
}

/// A grain that moves by 3 in the first interval activates one that is near where it ends.
#[test]
fn links_in_time_are_in_the_frame_between() {
    let grains = grains_of(&[0.5; 2]);
    let mut first = active(0, walls(), &[(0, [19.0, 3.0, 0.0], 1.0)]);
    (first.grains[0].to, first.grains[0].displacement) = ([2.0, 3.0, 0.0], [3.0, 0.0, 0.0]);
    let intervals = [first, active(1, walls(), &[(1, [3.0, 3.0, 0.0], 1.0)])];
    let events = find(&grains, &intervals, links(1.5, 0), TWO);
    assert_eq!((events.len(), events[0].grains), (1, 2));
    // From 19 over 22 to 23.
    assert_eq!(events[0].extent[0], 4.0);
    assert_eq!(events[0].place[0], 1.0);
}

#[test]
fn spheres_are_linked_across_all_edges_of_a_sheared_box() {
    let grains = grains_of(&[0.5; 4]);
    let offset = 3.0;
    let mut cell = Cell {
        periods: [L; 2],
        sheared: Some(Sheared::upright(L)),
    };
    cell.shear(offset);
    // The image of the second one above the first is at x = 7 - 3 + 3.
    let interval = active(
        0,
        cell,
        &[
            (0, [7.0, 3.0, 19.6], 1.0),
            (1, [4.0, 3.0, 0.4], 1.0),
            (2, [12.0, 19.5, 9.0], 1.0),
            (3, [12.0, 0.5, 9.0], 1.0),
        ],
    );
    let active = [interval];
    let events = find(&grains, &active, links(1.5, 0), THREE);
    assert_eq!(members(&events, &active), [vec![0, 1], vec![2, 3]]);
    let near = |found: [f64; 3], wanted: [f64; 3]| {
        let far = (0..3).map(|axis| (found[axis] - wanted[axis]).abs());
        assert!(far.sum::<f64>() < 1e-12, "{found:?} {wanted:?}");
    };
    near(events[0].extent, [0.0, 0.0, 0.8]);
    // On the edge: at the bottom, less the offset.
    near(events[0].place, [4.0, 3.0, 0.0]);
    near(events[1].extent, [0.0, 1.0, 0.0]);
}

#[test]
fn pairs_of_events_are_counted_by_lag_and_distance() {
    let event = |start: usize, x: f64| Event {
        intervals: [start, start],
        place: [x, 0.0, 0.0],
        grains: 1,
        members: Vec::new(),
        extent: [0.0; 3],
        gyration: 0.0,
        dmin_greatest: 1.0,
        dmin_sum: 1.0,
        strain_sum: 1.0,
        shear_strain_sum: 1.0,
    };
    // 19 and 1 are 2 apart.
    let events = [event(0, 1.0), event(0, 19.0), event(1, 1.5), event(5, 11.0)];
    let counts = pair_counts(&events, 10, walls(), TWO, 1.0, 4);
    let of = |lag: [usize; 2], from: f64, to: f64| {
        let wanted = PairRange {
            lag,
            distance: [from, to],
        };
        let count = counts.iter().find(|count| count.range == wanted);
        *count.unwrap_or_else(|| panic!("{wanted:?}"))
    };
    let all = |lag| of(lag, 0.0, f64::INFINITY);
    let lags = [[0, 1], [1, 2], [2, 4], [4, 8], [8, 10]];
    assert_eq!(lags.map(|lag| all(lag).pairs), [1, 2, 0, 3, 0]);
    // Of 100 pairs of starts in ten intervals 10 are equal, 18 one apart, 16 + 14 two or three.
    let shares = [0.10, 0.18, 0.30, 0.36, 0.06];
    for (lag, share) in lags.into_iter().zip(shares) {
        assert!((all(lag).expected - 6.0 * share).abs() < 1e-12, "{lag:?}");
    }
    assert_eq!(of([0, 1], 2.0, 3.0).pairs, 1);
    assert_eq!(of([1, 2], 0.0, 1.0).pairs, 1);
    // 19 to 1.5 is 2.5. Two of six pairs are 2 to 3 apart, and two of six have this lag.
    let found = of([1, 2], 2.0, 3.0);
    assert_eq!(found.pairs, 1);
    assert!((found.expected - 2.0 * 2.0 / 6.0).abs() < 1e-12);
    let expected: f64 = counts
        .iter()
        .filter(|c| c.range.distance[1] < 9.0)
        .map(|c| c.expected)
        .sum();
    assert!((expected - 3.0).abs() < 1e-12, "{expected}");
}

/// What the events of a test change, by the place from an event: u and the changes of both
/// stresses.
type Planted = dyn Fn([f64; 3]) -> ([f64; 3], f64, f64);

/// The harmonics around 60 events at random places of a cell full of grains, whose changes are
/// `planted`.
fn harmonics_of(dimension: Dimensions, planted: &Planted) -> Vec<Harmonic> {
    const GRAINS: usize = 400;
    const EVENTS: usize = 60;
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let axes = dimension.axes();
    let mut place = || {
        let mut place = [0.0; 3];
        place[..axes].fill_with(|| L * random.random::<f64>());
        place
    };
    let cell = Cell {
        periods: [L, if axes == 2 { f64::INFINITY } else { L }],
        sheared: Some(Sheared::upright(L)),
    };
    let mut propagator = Propagator::new(dimension, EVENTS, 1.0, 0.5 * L);
    for number in 0..EVENTS {
        let centre = place();
        let places: Vec<[f64; 3]> = (0..GRAINS).map(|_| place()).collect();
        let changes = places.iter().map(|r| {
            planted(match dimension {
                Dimensions::Two => cell.separation::<Two>(r, &centre),
                Dimensions::Three => cell.separation::<Three>(r, &centre),
            })
        });
        let (mut displacement, mut shear, mut pressure) = (Vec::new(), Vec::new(), Vec::new());
        for (u, of_shear, of_pressure) in changes {
            displacement.push(u);
            shear.push(of_shear);
            pressure.push(of_pressure);
        }
        let mut included = vec![true; GRAINS];
        // One grain that does not count.
        (displacement[0], included[0]) = ([1e9; 3], false);
        let change = Change {
            cell,
            place: places,
            displacement,
            shear,
            pressure,
            included,
        };
        propagator.add(number, centre, &change);
    }
    propagator.harmonics()
}

/// The amplitudes of a quantity that are not 0: order, 0 for cos and 1 for sin, amplitude times
/// r₀^decay, over all rings of enough grains; asserts that they are the same in all of them.
fn amplitudes(found: &[Harmonic], quantity: Quantity, decay: i32) -> Vec<(usize, usize, f64)> {
    let mut nonzero: Vec<(usize, usize, f64)> = Vec::new();
    let of_quantity = found
        .iter()
        .filter(|h| h.quantity == quantity && h.ring[0] > 0.0);
    for harmonic in of_quantity {
        for (part, [amplitude, error]) in [harmonic.cos, harmonic.sin].into_iter().enumerate() {
            let scaled = amplitude * harmonic.at.powi(decay);
            assert!(error.abs() < 1e-9, "{harmonic:?}");
            if scaled.abs() < 1e-9 {
                continue;
            }
            let known = nonzero
                .iter()
                .find(|(order, p, _)| (*order, *p) == (harmonic.order, part));
            match known {
                Some((.., value)) => assert!((value - scaled).abs() < 1e-9, "{harmonic:?}"),
                None => nonzero.push((harmonic.order, part, scaled)),
            }
        }
    }
    nonzero
}

/// The far field of a point-like shear strain in two dimensions without compression (Picard et al.
/// 2004), a rotation and a dilation: each amplitude comes back, and no other.
#[test]
fn a_planted_quadrupole_comes_back_with_its_amplitude_and_nothing_else() {
    let (quadrupole, vortex, dilation) = (0.7, -0.2, 0.1);
    let found = harmonics_of(TWO, &move |[x, y, _]| {
        let r = x.hypot(y);
        let double = 2.0 * x * y / (r * r);
        let radial = (quadrupole * double + dilation) / r;
        let tangential = vortex / r;
        let u = [
            (radial * x - tangential * y) / r,
            (radial * y + tangential * x) / r,
            0.0,
        ];
        let fourfold = 1.0 - 2.0 * double * double;
        (u, 3.0 * fourfold / (r * r), -2.0 * double / (r * r))
    });
    let near = |found: Vec<(usize, usize, f64)>, wanted: &[(usize, usize, f64)]| {
        assert_eq!(found.len(), wanted.len(), "{found:?}");
        for (found, wanted) in found.iter().zip(wanted) {
            assert_eq!((found.0, found.1), (wanted.0, wanted.1));
            assert!((found.2 - wanted.2).abs() < 1e-9, "{found:?} {wanted:?}");
        }
    };
    let of = |quantity, decay| amplitudes(&found, quantity, decay);
    near(
        of(Quantity::Radial, 1),
        &[(0, 0, dilation), (2, 1, quadrupole)],
    );
    near(of(Quantity::Tangential, 1), &[(0, 0, vortex)]);
    near(of(Quantity::Shear, 2), &[(4, 0, 3.0)]);
    near(of(Quantity::Pressure, 2), &[(2, 1, -2.0)]);
    // The far field is the last one.
    let last = found.last().expect("a harmonic");
    assert_eq!(last.ring, [FAR, 0.5 * L]);
}

/// u = a (n·E n) n / r² with E = ½ (e_x e_z + e_z e_x), the far field in three dimensions without
/// compression (Eshelby 1957): n·E n = ½ s² sin 2θ.
#[test]
fn the_quadrupole_of_spheres_comes_back() {
    let found = harmonics_of(THREE, &|[x, y, z]| {
        let r = (x * x + y * y + z * z).sqrt();
        let radial = 4.0 * (x * z / (r * r)) / (r * r);
        ([x, y, z].map(|x| radial * x / r), 0.0, 0.0)
    });
    let radial = amplitudes(&found, Quantity::Radial, 2);
    let [(2, 1, amplitude)] = radial[..] else {
        panic!("{radial:?}")
    };
    assert!((amplitude - 2.0).abs() < 1e-9, "{amplitude}");
    assert_eq!(amplitudes(&found, Quantity::Tangential, 2), []);
}

/// Independent noise of variance 1 on top: an amplitude of n grains, whose function has the mean
/// square ½, has the error √(2/n).
#[test]
fn errors_are_those_of_the_scatter() {
    use std::cell::RefCell;
    let random = RefCell::new(ChaCha8Rng::seed_from_u64(9));
    let found = harmonics_of(TWO, &move |_| {
        // The sum of three has the variance 1.
        let uniform = || 2.0 * random.borrow_mut().random::<f64>() - 1.0;
        ([0.0; 3], uniform() + uniform() + uniform(), 1.0)
    });
    let mut ratios = Vec::new();
    let mut deviations = Vec::new();
    for harmonic in found
        .iter()
        .filter(|h| h.quantity == Quantity::Shear && h.order > 0)
    {
        if harmonic.ring[0] < 2.0 || harmonic.is_far {
            continue;
        }
        for [amplitude, error] in [harmonic.cos, harmonic.sin] {
            ratios.push(error / (2.0 / harmonic.grains as f64).sqrt());
            deviations.push(amplitude / error);
        }
    }
    let count = ratios.len() as f64;
    let mean = ratios.iter().sum::<f64>() / count;
    assert!((mean - 1.0).abs() < 0.1, "{mean}");
    let spread = (deviations.iter().map(|d| d * d).sum::<f64>() / count).sqrt();
    assert!((spread - 1.0).abs() < 0.3, "{spread}");
}
