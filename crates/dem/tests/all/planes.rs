//! The smooth planes of the packing.

use bytemuck::Zeroable;
use gshear_dem::dimension::{Three, Two};
use gshear_dem::drive::{Piston, Planes};
use gshear_dem::laws::hooke::Springs;
use gshear_dem::laws::{Contact, LawSpace};
use gshear_dem::state::{Cell, GrainState, Masses};
use gshear_dem::system::Setup;

use crate::common::{Rig, elastic, hooke, periods, piston};

const SPRINGS: Springs = elastic(1.0, 0.5, 1.0);

/// A heavy plane that falls on a grain at rest gives it twice its own velocity, though nothing else
/// moves that would have the list made anew.
fn hits<D: LawSpace>() {
    const SPEED: f64 = 0.05;
    let mut position = [5.0; 3];
    position[D::UP] = 10.0;
    position[D::AXES..].fill(0.0);
    let grain = GrainState {
        radius: 0.5,
        position,
        ..GrainState::zeroed()
    };
    let cell = Cell::between_walls(periods::<D>(10.0, 10.0));
    let setup = Setup::new(cell, 0.5, Masses::Density(1.0), 0.05).with_skin(0.02);
    let falling = Piston {
        velocity: -SPEED,
        ..piston(12.0, 1e9, 0.0)
    };
    let law = || hooke::<D>(SPRINGS, &Contact::NONE);
    let planes = Planes::new(law(), falling, 0.0);
    let mut rig = Rig::new(setup, law(), planes, (vec![grain], Vec::new()));
    (0..900).for_each(|_| rig.step());
    let velocity = rig.system.grains().state(0).velocity[D::UP];
    assert!((velocity + 2.0 * SPEED).abs() < 1e-3 * SPEED, "{velocity}");
}

#[test]
fn a_plane_that_falls_meets_a_grain_at_rest() {
    hits::<Two>();
    hits::<Three>();
}
