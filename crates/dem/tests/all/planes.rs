//! The smooth planes of the packing.

use bytemuck::Zeroable;
use gshear_dem::dimension::{Dimension, Three, Two};
use gshear_dem::domain::Solo;
use gshear_dem::drive::{Piston, Planes};
use gshear_dem::laws::Contact;
use gshear_dem::laws::hooke::{Hooke, Springs};
use gshear_dem::state::{Cell, GrainState, Masses};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{Setup, System};

const SPRINGS: Springs = Springs {
    normal_stiffness: 1.0,
    tangential_stiffness: 0.5,
    density: 1.0,
    damping_ratio: 0.0,
    sliding_damping: 0.0,
};

/// A heavy plane that falls on a grain at rest gives it twice its own velocity, though nothing else
/// moves that would have the list made anew.
fn hits<D: Dimension>(law: impl Fn() -> Hooke<D, false, false>)
where
    Hooke<D, false, false>: gshear_dem::kernel::PairForce<D>,
{
    const SPEED: f64 = 0.05;
    let mut position = [5.0; 3];
    position[D::UP] = 10.0;
    if D::AXES == 2 {
        position[2] = 0.0;
    }
    let grain = GrainState {
        radius: 0.5,
        position,
        ..GrainState::zeroed()
    };
    let width = if D::AXES == 2 { f64::INFINITY } else { 10.0 };
    let setup = Setup::new(
        Cell::between_walls([10.0, width]),
        0.5,
        Masses::Density(1.0),
        0.05,
    )
    .with_skin(0.02);
    let piston = Piston {
        height: 12.0,
        velocity: -SPEED,
        acceleration: 0.0,
        mass: 1e9,
        load: 0.0,
    };
    let mut planes = Planes::new(Box::new(law()), piston, 0.0);
    let law = law();
    let mut system = System::<D>::new(&Solo, setup).expect("one rank");
    system
        .replace(&Solo, &law, &mut planes, vec![grain], Vec::new())
        .expect("a list");
    initial_forces(&Solo, &mut system, &law, &mut planes, None).expect("nothing touches");
    for _ in 0..900 {
        advance(
            &Solo,
            &mut system,
            &law,
            &mut planes,
            StepRequest::default(),
        )
        .expect("it bounces");
    }
    let velocity = system.grains().state(0).velocity[D::UP];
    assert!((velocity + 2.0 * SPEED).abs() < 1e-3 * SPEED, "{velocity}");
}

#[test]
fn a_plane_that_falls_meets_a_grain_at_rest() {
    hits::<Two>(|| Hooke::new(&SPRINGS, &Contact::NONE));
    hits::<Three>(|| Hooke::new(&SPRINGS, &Contact::NONE));
}
