//! From what was written to a scene in which nothing is optional any more.

mod analysis;
pub(crate) mod law;
mod load;
pub(super) mod periodic;
mod sample;
mod shear;

use super::ReadPacking;
use super::checker::{Checker, Key};
use super::derived;
use super::raw::{self, Number, Raw, show};
use super::scene::*;
use super::source::Input;
use super::write;
use gshear_dem::failure::Failure;
use gshear_dem::laws::keys::{Bounds, NOT_NEGATIVE, POSITIVE, UNIT};
use gshear_dem::simd::Level;
use gshear_dem::system::ListSettings;
pub(crate) use law::law_keys;
use sample::SampleKeys;
use toml::Spanned;

/// `key!(table.name)` takes a value out of the raw table of that name, together with its path.
macro_rules! key {
    ($table:ident.$key:ident) => {
        Key::new(
            concat!(stringify!($table), ".", stringify!($key)),
            $table.$key,
        )
    };
}
use key;

/// Checks every value by itself, then those that must agree, and derives what follows. `tables` says where each begins; `packing`
/// is asked about the file of a packing, if the scene has one.
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
    } = head(&mut c, raw.title, raw.seed, raw.dimension);
    let (law, contact) = law::check(&mut c, dimension, raw.material, raw.contact);
    let sample = sample::check(&mut c, dimension, raw.sample);
    let load_keys = load::check(&mut c, raw.load);
    let time = raw.time;
    let step_key = key!(time.step);
    let speed_key = key!(time.collision_speed);
    let force_key = key!(time.force);
    let step = c.number(&step_key, &POSITIVE);
    let collision_speed = c.number(&speed_key, &POSITIVE);
    c.at_most_one(&[&step_key, &speed_key]);
    let force = c.flag(&force_key).unwrap_or(false);
    if force && step.is_none() && collision_speed.is_none() {
        c.refuse(
            &force_key,
            "there is no step to force; give time.step (s), or leave both out",
        );
    }
    if collision_speed.is_some() && law.collision_time(1.0, 1.0).is_none() {
        c.refuse(
            &speed_key,
            "is for laws whose collision time depends on the speed, such as \"hertz\"; give time.step (s), or leave it out",
        );
    }
    let pack = check_pack(&mut c, raw.pack, &sample);
    let mut shear = shear::check(&mut c, raw.shear);
    let output = shear::output(&mut c, raw.output, &shear);
    let analysis = analysis::check(&mut c, raw.analysis, dimension, &shear, &output);
    let bookkeeping = check_bookkeeping(&mut c, raw.bookkeeping);
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
        &step_key
    } else {
        &speed_key
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

fn head(
    c: &mut Checker<'_>,
    title: Option<Spanned<raw::Text>>,
    seed: Option<Spanned<raw::Whole>>,
    dimension: Option<Spanned<raw::Whole>>,
) -> Head {
    let title = c.text(&Key::new("title", title));
    let seed = c.whole(&Key::new("seed", seed), 0, i64::MAX);
    let dimension = c.whole(&Key::new("dimension", dimension), 2, 3);
    Head {
        title,
        seed: seed.map_or(1, i64::unsigned_abs),
        dimension: match dimension {
            Some(3) => Dimensions::Three,
            _ => Dimensions::Two,
        },
    }
}

fn check_pack(c: &mut Checker<'_>, pack: raw::Pack, sample: &SampleKeys) -> Pack {
    let skip_key = key!(pack.skip);
    let friction_key = key!(pack.friction);
    let tolerance_key = key!(pack.tolerance);
    let max_steps_key = key!(pack.max_steps);
    let friction = c.number(&friction_key, &NOT_NEGATIVE);
    let tolerance = c.number(&tolerance_key, &POSITIVE);
    let max_steps = c.whole(&max_steps_key, 1, i64::MAX);
    let packing = sample.packing.given.is_some();
    let skip = c.flag(&skip_key).unwrap_or(packing);
    if skip && !packing {
        c.refuse(
            &skip_key,
            "inserted grains are loose and must be packed; give sample.packing, or leave it out",
        );
    }
    if skip && packing {
        let place = match skip_key.offset() {
            Some(at) => c.mention(at),
            None => "the default with sample.packing".into(),
        };
        for (path, offset) in [
            (friction_key.path, friction_key.offset()),
            (tolerance_key.path, tolerance_key.offset()),
            (max_steps_key.path, max_steps_key.offset()),
        ] {
            if offset.is_some() {
                c.refuse_among(
                    &[(path, offset)],
                    &format!("says how to pack, but pack.skip = true ({place}); leave it out, or give pack.skip = false"),
                );
            }
        }
    }
    if !skip && packing && sample.walls == Some(Walls::Types) {
        c.refuse(
            &skip_key,
            "contradicts sample.walls = \"types\": a sample that is compressed gets its walls afterwards; leave out one of the two",
        );
    }
    Pack {
        skip,
        friction: friction.unwrap_or(0.0),
        tolerance: tolerance.unwrap_or(1e-7),
        max_steps: max_steps.map_or(5_000_000, i64::unsigned_abs),
    }
}

fn check_bookkeeping(c: &mut Checker<'_>, bookkeeping: raw::Bookkeeping) -> Bookkeeping {
    let skin = c.number(&key!(bookkeeping.skin), &UNIT);
    let rebuild_every = c.whole(&key!(bookkeeping.rebuild_every), 0, i64::MAX);
    let simd_key = key!(bookkeeping.simd);
    let name = c.text(&simd_key).unwrap_or_else(|| "auto".into());
    let simd = SIMD_NAMES.iter().find(|known| **known == name);
    if simd.is_none() {
        c.refuse(
            &simd_key,
            &format!(
                "unknown instruction set {name:?}; it is one of {}",
                SIMD_NAMES.join(", ")
            ),
        );
    } else if Level::named(&name).is_none() {
        c.refuse(
            &simd_key,
            &format!("this processor has no {name}; \"auto\" takes the best it has"),
        );
    }
    Bookkeeping {
        list: ListSettings {
            skin,
            rebuild_every: rebuild_every.map_or(0, i64::unsigned_abs),
        },
        simd: simd.copied().unwrap_or("auto"),
    }
}

/// Values that are each within their bounds can still overflow together, such as a radius of 1e-200 m squared.
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
