//! From the raw configuration to a scene in which nothing is optional.

mod analysis;
pub(crate) mod law;
mod load;
pub(super) mod periodic;
mod sample;
mod shear;

use super::ReadPacking;
use super::checker::Checker;
use super::derived;
use super::key::Key;
use super::raw::{self, Number, Raw, show};
use super::scene::{Bookkeeping, Dimensions, Law, Pack, Scene, StepChoice, TimeStep, Walls};
use super::source::Input;
use super::write;
use gshear_dem::failure::Failure;
use gshear_dem::simd::Isa;
use gshear_dem::system::ListSettings;
pub(crate) use law::law_keys;
use sample::SampleKeys;

/// Checks every value by itself, then those that must agree, and derives what follows. `tables`
/// says where each begins; `packing` is called for the file of a packing, if the scene has one.
pub(super) fn scene(
    raw: Raw,
    input: Input<'_>,
    tables: Vec<(String, usize)>,
    packing: ReadPacking<'_>,
) -> Result<Scene, Failure> {
    let mut c = Checker::new(input, tables);
    let Head {
        title,
        seed,
        dimension,
    } = head(&mut c, &raw);
    let (law, contact) = law::check(&mut c, dimension, raw.material, raw.contact);
    let sample = sample::check(&mut c, dimension, raw.sample);
    let load_keys = load::check(&mut c, raw.load);
    let time = raw.time;
    let step = c.number(&time.step);
    let collision_speed = c.number(&time.collision_speed);
    c.at_most_one(&[&time.step, &time.collision_speed]);
    let force = c.flag_or_default(&time.force);
    if force && step.is_none() && collision_speed.is_none() {
        c.refuse(
            &time.force,
            "there is no step to force; give time.step (s), or leave both out",
        );
    }
    if collision_speed.is_some() && law.collision_time(1.0, 1.0).is_none() {
        c.refuse(
            &time.collision_speed,
            "applies to laws whose collisions take a time that depends on their speed, such as \"hertz\"; give time.step (s), or leave it out",
        );
    }
    let pack = check_pack(&mut c, &raw.pack, &sample);
    let mut shear = shear::check(&mut c, raw.shear);
    let output = shear::output(&mut c, &raw.output, &shear);
    let analysis = analysis::check(&mut c, &raw.analysis, dimension, &shear, &output);
    let bookkeeping = check_bookkeeping(&mut c, &raw.bookkeeping);
    c.settle()?;

    let (sample, origin) = sample::derive(&mut c, &sample, pack.skip, packing)?;
    let (load, load_choice) = load::derive(&mut c, &law, &sample, load_keys)?;
    shear::derive(&mut shear, &sample, &load);
    let mean_overlap = sample.mean_diameter / load.stiffness_number;
    let contact_time = derived::contact_time(&law, &sample, mean_overlap);
    check_range(
        &c,
        &[
            ("pressure", load.pressure),
            ("normal force", load.normal_force),
            ("time scale of a contact", contact_time),
        ],
    )?;
    let friction = contact.friction > 0.0 || pack.friction > 0.0;
    let limit_of = |law: &Law| derived::step_limit(law, &contact, &sample, mean_overlap, friction);
    let mut limit = limit_of(&law);
    if !pack.skip {
        let packing = law.while_packing(sample.mean_diameter, load.pressure);
        limit = limit.min(limit_of(&packing));
    }
    let default = derived::default_step(contact_time, limit);
    let (given, of_step) = match (step, collision_speed) {
        (Some(step), _) => (StepChoice::Given, step),
        (None, Some(speed)) => (
            StepChoice::Collision(speed),
            0.01 * law
                .collision_time(sample.radius_min, speed)
                .unwrap_or(f64::NAN),
        ),
        (None, None) => (StepChoice::Derived, default),
    };
    let of_key = if step.is_some() {
        &time.step
    } else {
        &time.collision_speed
    };
    let time_step = check_step(&mut c, [limit, default], of_key, (given, of_step), force)?;

    let mut scene = Scene {
        title: title.unwrap_or_else(|| "Plane shear".into()),
        seed,
        dimension,
        law,
        contact,
        sample,
        origin,
        load,
        time_step,
        pack,
        shear,
        output,
        analysis,
        bookkeeping,
        toml: String::new(),
    };
    scene.toml = write::toml(&scene, load_choice, force);
    Ok(scene)
}

/// What stands above all tables.
struct Head {
    title: Option<String>,
    seed: u64,
    dimension: Dimensions,
}

fn head(c: &mut Checker<'_>, raw: &Raw) -> Head {
    Head {
        title: c.text(&raw.title),
        seed: c.count(&raw.seed),
        dimension: match c.count(&raw.dimension) {
            3 => Dimensions::Three,
            _ => Dimensions::Two,
        },
    }
}

fn check_pack(c: &mut Checker<'_>, pack: &raw::Pack, sample: &SampleKeys) -> Pack {
    let friction = c.number_or_default(&pack.friction);
    let tolerance = c.number_or_default(&pack.tolerance);
    let max_steps = c.count(&pack.max_steps);
    let packing = sample.packing().is_given();
    let skip = c.flag(&pack.skip).unwrap_or(packing);
    if skip && !packing {
        c.refuse(
            &pack.skip,
            "inserted grains are loose and must be packed; give sample.packing, or leave it out",
        );
    }
    if skip && packing {
        let skipped = match pack.skip.offset() {
            Some(at) => c.mention(at),
            None => "the default with sample.packing".into(),
        };
        let places = [
            pack.friction.place(),
            pack.tolerance.place(),
            pack.max_steps.place(),
        ];
        for place in places {
            if place.1.is_some() {
                c.refuse_among(
                    &[place],
                    &format!("says how to pack, but pack.skip = true ({skipped}); leave it out, or give pack.skip = false"),
                );
            }
        }
    }
    if !skip && packing && sample.walls == Some(Walls::Types) {
        c.refuse(
            &pack.skip,
            "contradicts sample.walls = \"types\": a sample that is compressed gets its walls afterwards; leave out one of the two",
        );
    }
    Pack {
        skip,
        friction,
        tolerance,
        max_steps,
    }
}

fn check_bookkeeping(c: &mut Checker<'_>, bookkeeping: &raw::Bookkeeping) -> Bookkeeping {
    let skin = c.number(&bookkeeping.skin);
    let rebuild_every = c.count(&bookkeeping.rebuild_every);
    let simd = c.choice_or_default(&bookkeeping.simd);
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
    }
}

/// Values that are each within their bounds can still overflow together, such as a radius of 1e-200
/// m squared.
fn check_range(c: &Checker<'_>, derived: &[(&str, f64)]) -> Result<(), Failure> {
    match derived.iter().find(|(_, x)| !x.is_normal()) {
        Some((name, x)) => Err(c.out_of_range(&format!(
            "the {name} comes out as {x:?}; check the units (SI) of [material], [sample] and [load]"
        ))),
        None => Ok(()),
    }
}

fn check_step(
    c: &mut Checker<'_>,
    [limit, default]: [f64; 2],
    key: &Key<Number>,
    (given, step): (StepChoice, f64),
    force: bool,
) -> Result<TimeStep, Failure> {
    if step > limit && !force {
        c.refuse(
            key,
            &format!(
                "{} s is over the stability limit of {limit:.3e} s; give less, or leave it out for {default:.3e} s, or run it all the same with time.force = true",
                show(step)
            ),
        );
    }
    c.settle()?;
    Ok(TimeStep { step, limit, given })
}
