//! Bands of grains, and steps that follow each other through them, give the bits of single steps of
//! one band: with threads, and on ranks whose messages take time.

use std::time::{Duration, Instant};

use gshear_dem::dimension::{Three, Two};
use gshear_dem::domain::{Exchange, Solo, total};
use gshear_dem::drive::{Drive, GrainWalls, NoWalls, Piston, Slider, Top};
use gshear_dem::laws::LawSpace;
use gshear_dem::observe;
use gshear_dem::protocol::Protocol;
use gshear_dem::state::{Cell, body};
use gshear_dem::step::{StepRequest, advance};
use gshear_dem::system::{Setup, SweepSettings};

use crate::common::{Rig, gas, gas_law, setup};
use crate::ranks::Job;

const STEPS: u64 = 1500;

/// How steps go through a gas.
#[derive(Debug, Clone, Copy)]
struct Way {
    /// Grains of a band.
    band: usize,
    /// Steps that follow each other.
    steps: u64,
    threads: usize,
}

impl Way {
    /// One step of one band on one thread.
    const PLAIN: Self = Self {
        band: usize::MAX,
        steps: 1,
        threads: 1,
    };

    const fn new(band: usize, steps: u64, threads: usize) -> Self {
        Self {
            band,
            steps,
            threads,
        }
    }
}

const WAYS: [Way; 7] = [
    Way::new(1, 1, 1),
    Way::new(1, 2, 1),
    Way::new(1, 7, 1),
    Way::new(40, 3, 1),
    Way::new(40, 16, 1),
    Way::new(40, 5, 2),
    Way::new(1, 4, 3),
];

/// What a run says: the digest, and the greatest numbers of bands and of steps at once.
type Outcome = (String, usize, u64);

/// Advances by [`STEPS`].
fn run<D: LawSpace, W: Drive<D>>(
    exchange: &dyn Exchange,
    mut rig: Rig<D, W>,
    state: impl Fn(&W) -> Vec<f64>,
) -> Outcome {
    let (mut bands, mut at_once, mut left) = (0, 0, STEPS);
    while left > 0 {
        let request = StepRequest {
            most: left,
            ..StepRequest::default()
        };
        let (law, walls) = (rig.law.as_ref(), &mut rig.walls);
        let advanced = advance(exchange, &mut rig.system, law, walls, request).expect("sound");
        left -= advanced.steps;
        at_once = at_once.max(advanced.steps);
        bands = bands.max(rig.system.bands());
    }
    assert_eq!(rig.system.steps, STEPS);
    assert!(rig.system.list.rebuilds > 3, "too few lists");
    let touching = rig.system.contacts.touching().count();
    assert!(total(exchange, touching as u64) > 10);
    let state = state(&rig.walls);
    let law = rig.law.as_ref();
    let digest = observe::digest(
        exchange,
        &mut rig.system,
        law,
        bytemuck::cast_slice(&state),
        STEPS,
    );
    (digest, bands, at_once)
}

fn with<D: LawSpace>(side: usize, way: Way) -> Setup {
    Setup {
        sweep: SweepSettings {
            band: Some(way.band),
            steps: way.steps,
        },
        threads: way.threads,
        ..setup::<D>(side, 0.2, (0.1, 0))
    }
}

/// A gas whose lowest and highest layers are walls: the lower one vibrates, the upper one is loaded
/// and pulled by a spring.
fn between_walls<D: LawSpace>(
    exchange: &dyn Exchange,
    side: usize,
    way: Way,
) -> Rig<D, GrainWalls> {
    let mut setup = with::<D>(side, way);
    let Setup { cell, step, .. } = &mut setup;
    *cell = Cell::between_walls(cell.periods);
    let mut grains = gas::<D>(side, 0.5, 5);
    let heights = || grains.iter().map(|g| g.position[D::UP]);
    let [low, high] = [
        heights().fold(f64::INFINITY, f64::min),
        heights().fold(0.0, f64::max),
    ];
    let third = (high - low) / side as f64;
    for grain in &mut grains {
        let height = grain.position[D::UP];
        if height < low + third {
            grain.body = body::BOTTOM;
        } else if height > high - third {
            grain.body = body::TOP;
        }
        if grain.body != body::FREE {
            grain.velocity = [0.0; 3];
            grain.angular_velocity = [0.0; 3];
        }
    }
    let piston = Piston {
        height: high,
        velocity: 0.0,
        acceleration: 0.0,
        mass: 5.0,
        load: 1e-2,
    };
    let slider = Slider::new(Protocol::new(*step, [(0.1, u64::MAX >> 12)]), Some(0.1));
    let top = Top::new(piston, slider, None, true);
    if exchange.rank() > 0 {
        grains.clear();
    }
    let walls = GrainWalls::new(top);
    Rig::on(exchange, setup, gas_law::<D>(), walls, (grains, Vec::new()))
}

fn run_between_walls<D: LawSpace>(exchange: &dyn Exchange, side: usize, way: Way) -> Outcome {
    let rig = between_walls::<D>(exchange, side, way);
    run(exchange, rig, |walls| walls.motion.state().to_vec())
}

fn bits_are_those_of_one_band<D: LawSpace>(side: usize) {
    let walls = |way| run_between_walls::<D>(&Solo, side, way);
    let (expected, bands, at_once) = walls(Way::PLAIN);
    assert_eq!((bands, at_once), (1, 1));
    for way in WAYS {
        let (digest, bands, at_once) = walls(way);
        assert!(
            bands > 3 && at_once == way.steps,
            "{bands} bands, {at_once}"
        );
        assert_eq!(digest, expected, "{way:?}");
    }
    // In a cell that is periodic along all axes steps are single.
    let periodic = |band| {
        let grains = (gas::<D>(side, 0.5, 5), Vec::new());
        let setup = with::<D>(side, Way::new(band, 8, 1));
        let rig = Rig::new(setup, gas_law::<D>(), NoWalls, grains);
        run(&Solo, rig, |_| Vec::new())
    };
    let (expected, bands, _) = periodic(usize::MAX);
    assert_eq!(bands, 1);
    for band in [1, 40] {
        let (digest, bands, at_once) = periodic(band);
        assert!(bands > 2 && at_once == 1, "{bands} bands, {at_once}");
        assert_eq!(digest, expected, "bands of {band}");
    }
}

#[test]
fn steps_that_follow_each_other_give_the_bits_of_single_ones() {
    bits_are_those_of_one_band::<Two>(24);
    bits_are_those_of_one_band::<Three>(9);
}

/// Messages of ghosts, and sums, that arrive late change no bit. Where several steps follow each
/// other, bands go on while a sum is under way.
#[test]
fn ranks_whose_messages_take_time_give_the_bits_of_one() {
    let (expected, ..) = run_between_walls::<Two>(&Solo, 24, Way::PLAIN);
    let job = |ranks, microseconds| Job::new(ranks, Duration::from_micros(microseconds));
    for (job, way) in [
        (job(2, 0), Way::PLAIN),
        (job(2, 0), Way::new(40, 4, 1)),
        (job(2, 30).far(), Way::new(40, 8, 1)),
        (job(3, 0).far(), Way::new(1, 3, 1)),
        (job(2, 0), Way::new(40, 4, 2)),
    ] {
        let outcomes = job.run(|rank| {
            let outcome = run_between_walls::<Two>(rank, 24, way);
            (outcome, rank.sent_during_sums())
        });
        for ((digest, bands, at_once), sent_during_sums) in outcomes {
            assert_eq!(digest, expected, "{way:?}");
            assert_eq!((bands > 1, at_once), (way.steps > 1, way.steps));
            assert_eq!(sent_during_sums > 0, way.steps > 1, "{way:?}");
        }
    }
}

/// How much longer a step of 100,000 grains on two ranks takes if messages take time, which is
/// printed: run it alone, with `--ignored --nocapture`.
#[test]
#[ignore = "times"]
fn latency_of_messages_is_hidden() {
    let side = 316;
    for (way, is_near, name) in [
        (
            Way::new(1000, 8, 1),
            false,
            "8 steps at once, messages of 8 bands",
        ),
        (
            Way::new(1000, 8, 1),
            true,
            "8 steps at once, messages of a band",
        ),
        (Way::new(usize::MAX, 1, 1), true, "1 step at once"),
    ] {
        for microseconds in [0, 10, 30, 100, 300, 1000] {
            let job = Job::new(2, Duration::from_micros(microseconds));
            let job = if is_near { job } else { job.far() };
            let times = job.run(|rank| {
                let mut rig = between_walls::<Two>(rank, side, way);
                let begun = Instant::now();
                let mut left = 200;
                while left > 0 {
                    let request = StepRequest {
                        most: left,
                        ..StepRequest::default()
                    };
                    let (law, walls) = (rig.law.as_ref(), &mut rig.walls);
                    let advanced = advance(rank, &mut rig.system, law, walls, request);
                    left -= advanced.expect("sound").steps;
                }
                begun.elapsed().as_secs_f64() / 200.0
            });
            let step = 1e3 * times[0];
            println!("{name}, latency {microseconds} us: {step:.3} ms a step");
        }
    }
}
