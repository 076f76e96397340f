//! Made-up grains, frames and checkpoints: every number a function of what it belongs to, and of
//! nothing else.

#![allow(dead_code)]

use gshear_dem::boundary::ROUGH_WALLS;
use gshear_dem::state::{
    BoxEdges, ContactForce, ContactSample, ContactState, Displacement, FramePart, GrainPosition,
    GrainSample, GrainState, HeldState, SeriesRow, Snapshot,
};
use gshear_store::h5::Attribute;
use gshear_store::trajectory::{FrameFormat, GrainShape, RunHeader};

fn hash(a: u64, b: u64, c: u64) -> u64 {
    let mut x =
        a.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ b.wrapping_mul(0xbf58_476d_1ce4_e5b9) ^ c << 17;
    for _ in 0..3 {
        x = (x ^ x >> 31).wrapping_mul(0x94d0_49bb_1331_11eb);
    }
    x ^ x >> 29
}

fn number(a: u64, b: u64, c: u64) -> f64 {
    hash(a, b, c) as f64 / u64::MAX as f64 - 0.5
}

/// The rank that has grain `id` at time `t`: irregular, and another one now and then.
pub fn owner(t: u64, id: u64, ranks: usize) -> usize {
    (hash(t / 7, id, 99) % (2 * ranks as u64 - 1)) as usize / 2
}

pub fn shapes(grains: u64) -> Vec<GrainShape> {
    let shape = |id| GrainShape {
        id: id as u32,
        body: (id % 3) as u32,
        radius: 1.0 + number(0, id, 1),
        mass: 1.0 + number(0, id, 2),
        material: id % 2,
    };
    (0..grains).map(shape).collect()
}

pub fn header(grains: &[GrainShape]) -> RunHeader<'_> {
    RunHeader {
        boundary: &ROUGH_WALLS,
        units: true,
        series: &SeriesRow::COLUMNS,
        form: FrameFormat::new(2, false),
        edges: [20.0, 15.5, 0.0],
        author: "the test",
        history_unit: "N",
        grains,
        ids: None,
        attributes: &[],
    }
}

pub fn attributes() -> Vec<(&'static str, Attribute)> {
    vec![
        ("scene", "seed = 1\n[sample]\n# µ\n".into()),
        ("ranks", 7.into()),
        ("time_step", 6.0e-11.into()),
    ]
}

pub fn at_the_end() -> Vec<(&'static str, Attribute)> {
    vec![
        ("digest", "0123456789abcdef".into()),
        ("speed", 1.5e7.into()),
        ("rank_map", vec![0.0, 10.0, 20.0].into()),
    ]
}

/// The box at time `t`.
pub fn edges(t: u64) -> BoxEdges {
    let height = 15.5 + number(t, 0, 20);
    [[20.0, 0.0, 0.0], [0.0, height, 0.0], [0.0, 0.0, 1.0]]
}

fn image(t: u64, id: u64) -> [i64; 3] {
    [0, 1, 2].map(|axis| (hash(t, id, 30 + axis) % 7) as i64 - 3)
}

pub fn grain(t: u64, id: u64) -> GrainSample {
    GrainSample {
        id: id as u32,
        removed: 0,
        position: [number(t, id, 3), number(t, id, 4), 0.0],
        velocity: [number(t, id, 5), number(t, id, 6), 0.0],
        angular_velocity: [0.0, 0.0, number(t, id, 7)],
        image: image(t, id),
    }
}

/// Pairs (i, j) in order; some frames have none.
pub fn pairs(t: u64, grains: u64) -> Vec<(u32, u32)> {
    let mut pairs = Vec::new();
    for i in 0..if t % 9 == 4 { 0 } else { grains } {
        let some = (i + 1..grains).filter(|j| hash(t, i, 1000 + j).is_multiple_of(grains / 2 + 1));
        pairs.extend(some.map(|j| (i as u32, j as u32)));
    }
    pairs
}

pub fn contact(t: u64, (i, j): (u32, u32)) -> ContactSample {
    let of = |c| number(t, u64::from(i) << 32 | u64::from(j), c);
    ContactSample {
        i,
        j,
        normal_force: of(1),
        tangential_force: [of(2), 0.0, 0.0],
        tangential_history: [of(3), 0.0, 0.0],
        rolling_history: of(4),
        overlap: of(5),
        sliding: u64::from(of(6) > 0.0),
        rolling: u64::from(of(7) > 0.0),
        torques: [0.0; 4],
        twisting: 0,
        idle: u64::from(of(8) > 0.0),
        age: 0.0,
    }
}

pub fn row(k: u64) -> SeriesRow {
    bytemuck::cast::<[f64; SeriesRow::COLUMNS.len()], _>(std::array::from_fn(|c| {
        number(k, c as u64, 8)
    }))
}

/// The state of a checkpoint at `t`, with contacts in order.
pub fn snapshot(t: u64, grains: u64) -> Snapshot {
    let grain = |id| GrainState {
        id: id as u32,
        body: (id % 3) as u32,
        position: [10, 11, 12].map(|c| number(t, id, c)),
        velocity: [13, 14, 15].map(|c| number(t, id, c)),
        angular_velocity: [16, 17, 18].map(|c| number(t, id, c)),
        radius: number(t, id, 19),
        force: [20, 21, 22].map(|c| number(t, id, c)),
        torque: [23, 24, 25].map(|c| number(t, id, c)),
        image: image(t, id),
        material: id % 2,
    };
    let contact = |(i, j)| ContactState {
        i,
        j,
        history: std::array::from_fn(|c| {
            number(t, u64::from(i) << 32 | u64::from(j), 26 + c as u64)
        }),
        limits: i64::from((t as u32 + i + j) % 8),
        // At even times none.
        torques: [40, 41, 42, 43]
            .map(|c| (t % 2) as f64 * number(t, u64::from(i) << 32 | u64::from(j), c)),
        // At times that three does not divide none.
        age: f64::from(u8::from(t.is_multiple_of(3)))
            * number(t, u64::from(i) << 32 | u64::from(j), 44),
    };
    let place = |id| GrainPosition {
        id: id as u32,
        body: 0,
        position: [27, 28].map(|c| number(t, id, c)),
        image: image(t, id)[0],
    };
    let force = |(i, j)| ContactForce {
        i,
        j,
        normal_force: number(t, u64::from(i) << 32 | u64::from(j), 29),
        tangential_force: number(t, u64::from(i) << 32 | u64::from(j), 30),
    };
    let displacement = |id| Displacement {
        id: id as u32,
        body: 0,
        start: [31, 32, 33].map(|c| number(t, id, c)),
        angle: [34, 35, 36].map(|c| number(t, id, c)),
        image: image(t, id),
    };
    let held = |radius| HeldState {
        grains: (0..grains)
            .map(|id| GrainState {
                radius,
                ..grain(id)
            })
            .collect(),
        contacts: pairs(t, grains).into_iter().map(contact).collect(),
    };
    Snapshot {
        grains: (0..grains).map(grain).collect(),
        contacts: pairs(t, grains).into_iter().map(contact).collect(),
        held: vec![held(1.0), held(2.0)],
        analysed: Some(FramePart {
            grains: (0..grains).map(place).collect(),
            contacts: pairs(t, grains).into_iter().map(force).collect(),
        }),
        displacements: Some((0..grains).map(displacement).collect()),
    }
}
