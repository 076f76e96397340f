//! From the raw configuration to a scene in which nothing is optional.

mod analysis;
mod extent;
mod law;
mod load;
mod periodic;
mod sample;
mod shear;
mod time;
mod walls;

use crate::ReadPacking;
use crate::checker::Checker;
use crate::packing::GrainLimit;
use crate::raw::{self, Raw};
use crate::scene::{Bookkeeping, Boundary, Dimensions, Scene};
use crate::source::Input;
use crate::write;
use gshear_dem::failure::Failure;
use gshear_dem::simd::Isa;
use gshear_dem::system::ListSettings;

/// Checks every value by itself, then those that must agree, and derives what follows. `tables`
/// says where each begins; `boxed`: the scene has a `[box]`; `limit`: of inserted grains; `packing` is called for the file of a
/// packing, if the scene has one.
pub(super) fn scene(
    raw: &Raw,
    input: Input<'_>,
    tables: Vec<(String, usize)>,
    boxed: bool,
    limit: &GrainLimit,
    packing: ReadPacking<'_>,
) -> Result<Scene, Failure> {
    let mut c = Checker::new(input, tables);
    let title = c.text(&raw.title);
    let author = c.text(&raw.author);
    let seed = c.count(&raw.seed);
    let dimension = match c.count(&raw.dimension) {
        3 => Dimensions::Three,
        _ => Dimensions::Two,
    };
    let (law, contact) = law::check(&mut c, dimension, &raw.material, &raw.contact);
    time::check(&mut c, &raw.time, &law, boxed);
    let range = i64::from(limit.most) + 1..=i64::from(u32::MAX);
    let grains = raw.sample.grains.value().map(|n| n.0);
    if let Some(grains) = grains.filter(|n| range.contains(n)) {
        let GrainLimit { most, reason } = limit;
        let what = format!("{grains} grains are more than the {most} that {reason}; give fewer");
        c.refuse(&raw.sample.grains, &what);
    }
    let keep_checkpoints = c.flag_or_default(&raw.output.keep_checkpoints);
    let bookkeeping = check_bookkeeping(&mut c, &raw.bookkeeping);
    let (default_title, sample, mut boundary) = if boxed {
        let (sample, periodic) = periodic::check(&mut c, dimension, (raw, seed))?;
        ("Periodic box", sample, Boundary::Periodic(periodic))
    } else {
        let (sample, walls) = walls::check(&mut c, dimension, &law, raw, packing)?;
        ("Plane shear", sample, Boundary::Walls(walls))
    };
    let time_step = time::derive(&mut c, &raw.time, (&law, &contact), &sample, &boundary)?;
    if let Boundary::Walls(walls) = &mut boundary {
        load::derive_servo(&mut c, &raw.load, (&law, &sample), walls, time_step.step);
        c.settle()?;
    }
    let mut scene = Scene {
        title: title.unwrap_or_else(|| default_title.into()),
        author,
        seed,
        dimension,
        law,
        contact,
        sample,
        time_step,
        boundary,
        keep_checkpoints,
        bookkeeping,
        toml: String::new(),
    };
    walls::allow_steps(&mut scene, &raw.pack);
    extent::check(&mut c, raw, &scene)?;
    scene.toml = write::toml(&scene);
    Ok(scene)
}

fn check_bookkeeping(c: &mut Checker<'_>, bookkeeping: &raw::Bookkeeping) -> Bookkeeping {
    let skin = c.number(&bookkeeping.skin);
    let rebuild_every = c.count(&bookkeeping.rebuild_every);
    let simd = c.choice_or_default(&bookkeeping.simd);
    let watchdog = c.number_or_default(&bookkeeping.watchdog);
    if let Some(name) = simd.filter(|name| Isa::named(name).is_none()) {
        c.refuse(
            &bookkeeping.simd,
            &format!("this processor has no {name}; give \"auto\", which takes the best it has"),
        );
    }
    Bookkeeping {
        list: ListSettings {
            skin,
            rebuild_every,
        },
        simd: simd.unwrap_or("auto"),
        watchdog,
    }
}
