//! From what was written to a scene in which nothing is optional any more.

use super::checker::{Bounds, Checker, Key, NOT_NEGATIVE, POSITIVE};
use super::derived::{self, LEAST_HEIGHT, STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use super::raw::{self, Number, Raw, show};
use super::scene::*;
use super::source::Input;
use super::write::{self, DampingChoice, LoadChoice};
use crate::failure::Failure;
use crate::simd::Level;

pub(super) const LAW: &str = "lee-hurley";

const DAMPING: Bounds = Bounds {
    hold: |x| (0.0..1.0).contains(&x),
    words: "must lie in [0, 1)",
};
const UNIT: Bounds = Bounds {
    hold: |x| x > 0.0 && x <= 1.0,
    words: "must lie in (0, 1]",
};
const POISSON: Bounds = Bounds {
    hold: |x| (0.0..=0.5).contains(&x),
    words: "must lie in [0, 0.5]",
};
const STIFFNESS: Bounds = Bounds {
    hold: |x| (STIFFNESS_NUMBER_MIN..=STIFFNESS_NUMBER_MAX).contains(&x),
    words: "must lie in [10.64, 1e10] (from the last overlap of the law to the least that f64 resolves)",
};

/// `key!(table.name)` takes a value out of the raw table of that name, together with its path.
macro_rules! key {
    ($table:ident.$key:ident) => {
        Key::new(
            concat!(stringify!($table), ".", stringify!($key)),
            $table.$key,
        )
    };
}

/// Checks every value by itself, then those that must agree, and derives what follows. `tables` says where each begins.
pub(super) fn scene(
    raw: Raw,
    input: Input<'_>,
    tables: Vec<(String, usize)>,
) -> Result<Scene, Failure> {
    let mut c = Checker::new(input, tables);
    let title = c.text(&Key::new("title", raw.title));
    let seed = c.whole(&Key::new("seed", raw.seed), 0, i64::MAX);
    let material = check_material(&mut c, raw.material);
    let (contact, damping_choice) = check_contact(&mut c, raw.contact);
    let (sample, places) = check_sample(&mut c, raw.sample);
    let (load_choice, load_key) = check_load(&mut c, raw.load);
    let time = raw.time;
    let step_key = key!(time.step);
    let force_key = key!(time.force);
    let step = c.number(&step_key, &POSITIVE);
    let force = c.flag(&force_key).unwrap_or(false);
    if force && step.is_none() {
        c.refuse(
            &force_key,
            "there is no step to force; give time.step (s), or leave both out",
        );
    }
    let pack = check_pack(&mut c, raw.pack);
    let shear = check_shear(&mut c, raw.shear);
    let output = check_output(&mut c, raw.output);
    let bookkeeping = check_bookkeeping(&mut c, raw.bookkeeping);
    c.settle()?;

    check_size(&mut c, &sample, &places)?;
    let load = derive_load(&mut c, &material, &sample, load_choice, &load_key)?;
    let mean_overlap = sample.mean_diameter() / load.stiffness_number;
    let contact_time = derived::contact_time(&material, &sample, mean_overlap);
    check_range(
        &c,
        &[
            ("pressure", load.pressure),
            ("normal force", load.normal_force),
            ("time scale of a contact", contact_time),
        ],
    )?;
    let friction = contact.friction > 0.0 || pack.friction > 0.0;
    let limit = derived::step_limit(&material, &contact, &sample, mean_overlap, friction);
    let default = derived::default_step(contact_time, limit);
    let time_step = check_step(&mut c, [limit, default], &step_key, step, force)?;

    let mut scene = Scene {
        title: title.unwrap_or_else(|| "Plane shear".into()),
        seed: seed.map_or(1, i64::unsigned_abs),
        material,
        contact,
        sample,
        load,
        time_step,
        pack,
        shear,
        output,
        bookkeeping,
        toml: String::new(),
    };
    scene.toml = write::toml(&scene, damping_choice, load_choice, force);
    Ok(scene)
}

fn check_material(c: &mut Checker<'_>, material: raw::Material) -> Material {
    let young_modulus = key!(material.young_modulus);
    let poisson_ratio = key!(material.poisson_ratio);
    let density = key!(material.density);
    Material {
        young_modulus: c.required(
            &young_modulus,
            &POSITIVE,
            "E (Pa), such as young_modulus = 1e9",
        ),
        poisson_ratio: c.required(&poisson_ratio, &POISSON, "nu, such as poisson_ratio = 0.2"),
        density: c.required(
            &density,
            &POSITIVE,
            "rho (kg/m^3), such as density = 2500.0",
        ),
    }
}

fn check_contact(c: &mut Checker<'_>, contact: raw::Contact) -> (Contact, DampingChoice) {
    let law = key!(contact.law);
    if let Some(name) = c.text(&law).filter(|name| name != LAW) {
        c.refuse(&law, &format!("unknown law {name:?}; the law is {LAW:?}"));
    }
    let friction = key!(contact.friction);
    let friction = c.required(&friction, &NOT_NEGATIVE, "mu_s, such as friction = 0.7");
    let rolling_friction = key!(contact.rolling_friction);
    let rolling_friction = c.number(&rolling_friction, &NOT_NEGATIVE);
    let ratio = key!(contact.damping_ratio);
    let restitution = key!(contact.restitution);
    let chosen = c.exactly_one(
        &[&ratio, &restitution],
        "the damping: damping_ratio (alpha), such as damping_ratio = 0.1, or restitution",
    );
    let choice = match (c.number(&ratio, &DAMPING), c.number(&restitution, &UNIT)) {
        (_, Some(e)) if chosen == 1 => DampingChoice::Restitution(e),
        (alpha, _) => DampingChoice::Ratio(alpha.unwrap_or(0.0)),
    };
    let rolling_damping = key!(contact.rolling_damping_ratio);
    let rolling_damping = c.number(&rolling_damping, &DAMPING);
    let checked = Contact {
        friction,
        rolling_friction: rolling_friction.unwrap_or(0.0),
        damping_ratio: match choice {
            DampingChoice::Ratio(alpha) => alpha,
            DampingChoice::Restitution(e) => derived::damping_ratio(e),
        },
        rolling_damping_ratio: rolling_damping.unwrap_or(0.0),
    };
    (checked, choice)
}

/// Keys of [`Sample`] and where they were given, for what they cause together.
type Places = [(&'static str, Option<usize>); 4];

fn check_sample(c: &mut Checker<'_>, sample: raw::Sample) -> (Sample, Places) {
    let grains = key!(sample.grains);
    let radius_min = key!(sample.radius_min);
    let radius_max = key!(sample.radius_max);
    let length = key!(sample.length);
    let checked = Sample {
        // Grains are numbered by u32.
        grains: c.required_whole(
            &grains,
            1,
            u32::MAX.into(),
            "the number of disks, such as grains = 1000",
        ) as u32,
        radius_min: c.required(
            &radius_min,
            &POSITIVE,
            "the least R (m), such as radius_min = 0.5e-6",
        ),
        radius_max: c.required(
            &radius_max,
            &POSITIVE,
            "the greatest R (m), such as radius_max = 1e-6",
        ),
        length: c.required(&length, &POSITIVE, "L_x (m), such as length = 48e-6"),
    };
    let places = [
        (grains.path, grains.offset()),
        (radius_min.path, radius_min.offset()),
        (radius_max.path, radius_max.offset()),
        (length.path, length.offset()),
    ];
    (checked, places)
}

/// What the values of `[sample]` must be to each other.
fn check_size(c: &mut Checker<'_>, sample: &Sample, places: &Places) -> Result<(), Failure> {
    let [_, radius_min, radius_max, length] = *places;
    let (a, b) = (sample.radius_min, sample.radius_max);
    if a > b {
        c.refuse_among(
            &[radius_min, radius_max],
            &format!("radius_min = {a:?} is greater than radius_max = {b:?}; give radius_min <= radius_max"),
        );
    }
    c.settle()?;
    let least = 8.0 * b;
    if sample.length < least {
        c.refuse_among(
            &[length, radius_max],
            &format!(
                "the cell is too narrow for its grains: length = {} m; give at least 4 diameters of the largest, {least:.3e} m",
                show(sample.length)
            ),
        );
    }
    c.settle()?;
    let height = derived::packed_height(sample);
    let needed = LEAST_HEIGHT * sample.mean_diameter();
    if height < needed {
        let least = derived::least_grains(sample);
        let remedy = if least <= f64::from(u32::MAX) {
            format!("give at least {least} grains or a shorter cell")
        } else {
            "give a shorter cell".into()
        };
        c.refuse_among(
            places,
            &format!(
                "box too small for its walls: {} grains fill about {height:.2e} m of height, but two walls of one mean diameter and five between them take {needed:.2e} m; {remedy}",
                sample.grains
            ),
        );
    }
    c.settle()
}

fn check_load(c: &mut Checker<'_>, load: raw::Load) -> (LoadChoice, Key<Number>) {
    let stiffness_number = key!(load.stiffness_number);
    let pressure = key!(load.pressure);
    let normal_force = key!(load.normal_force);
    let chosen = c.exactly_one(
        &[&stiffness_number, &pressure, &normal_force],
        "the load: stiffness_number (kappa), such as stiffness_number = 1e4, or pressure (Pa), or normal_force (N/m)",
    );
    let kappa = c.number(&stiffness_number, &STIFFNESS).unwrap_or(f64::NAN);
    let p = c.number(&pressure, &POSITIVE).unwrap_or(f64::NAN);
    let n = c.number(&normal_force, &POSITIVE).unwrap_or(f64::NAN);
    match chosen {
        0 => (LoadChoice::StiffnessNumber(kappa), stiffness_number),
        1 => (LoadChoice::Pressure(p), pressure),
        _ => (LoadChoice::NormalForce(n), normal_force),
    }
}

/// P, N and κ from one of them.
fn derive_load(
    c: &mut Checker<'_>,
    material: &Material,
    sample: &Sample,
    choice: LoadChoice,
    key: &Key<Number>,
) -> Result<Load, Failure> {
    let (pressure, normal_force) = match choice {
        LoadChoice::StiffnessNumber(kappa) => {
            let p = derived::pressure(material, sample, kappa);
            return Ok(Load {
                pressure: p,
                normal_force: p * sample.length,
                stiffness_number: kappa,
            });
        }
        LoadChoice::Pressure(p) => (p, p * sample.length),
        LoadChoice::NormalForce(n) => (n / sample.length, n),
    };
    match derived::stiffness_number(material, sample, pressure) {
        Some(stiffness_number) => Ok(Load {
            pressure,
            normal_force,
            stiffness_number,
        }),
        None => {
            let least = derived::pressure(material, sample, STIFFNESS_NUMBER_MAX);
            let most = derived::pressure(material, sample, STIFFNESS_NUMBER_MIN);
            let (unit, factor) = match choice {
                LoadChoice::NormalForce(_) => ("N/m", sample.length),
                _ => ("Pa", 1.0),
            };
            c.refuse(
                key,
                &format!(
                    "gives a mean overlap outside {:.1e} … {:.3} mean diameters; it must lie in {:.3e} … {:.3e} {unit}, found {}",
                    1.0 / STIFFNESS_NUMBER_MAX,
                    1.0 / STIFFNESS_NUMBER_MIN,
                    least * factor,
                    most * factor,
                    key.given
                        .as_ref()
                        .map_or(String::new(), |(_, Number(x))| show(*x)),
                ),
            );
            Err(c
                .settle()
                .err()
                .unwrap_or(Failure::input("the load is out of range")))
        }
    }
}

fn check_pack(c: &mut Checker<'_>, pack: raw::Pack) -> Pack {
    let friction = c.number(&key!(pack.friction), &NOT_NEGATIVE);
    let tolerance = c.number(&key!(pack.tolerance), &POSITIVE);
    let max_steps = c.whole(&key!(pack.max_steps), 1, i64::MAX);
    Pack {
        friction: friction.unwrap_or(0.0),
        tolerance: tolerance.unwrap_or(1e-7),
        max_steps: max_steps.map_or(5_000_000, i64::unsigned_abs),
    }
}

fn check_shear(c: &mut Checker<'_>, shear: raw::Shear) -> Shear {
    let inertial_number = key!(shear.inertial_number);
    let velocity = key!(shear.velocity);
    let chosen = c.exactly_one(
        &[&inertial_number, &velocity],
        "the rate: inertial_number (I), such as inertial_number = 2e-4, or velocity (m/s)",
    );
    let i = c.number(&inertial_number, &POSITIVE).unwrap_or(f64::NAN);
    let v = c.number(&velocity, &POSITIVE).unwrap_or(f64::NAN);
    let strain = key!(shear.strain);
    Shear {
        drive: match chosen {
            0 => Drive::InertialNumber(i),
            _ => Drive::Velocity(v),
        },
        strain: c.required(&strain, &POSITIVE, "the total gamma, such as strain = 0.1"),
    }
}

fn check_output(c: &mut Checker<'_>, output: raw::Output) -> Output {
    let frame_strain = c.number(&key!(output.frame_strain), &NOT_NEGATIVE);
    let frame_start = c.number(&key!(output.frame_start), &NOT_NEGATIVE);
    let series_strain = c.number(&key!(output.series_strain), &NOT_NEGATIVE);
    let checkpoint_strain = c.number(&key!(output.checkpoint_strain), &NOT_NEGATIVE);
    let progress_lines = c.whole(&key!(output.progress_lines), 0, i64::MAX);
    Output {
        frame_strain: frame_strain.unwrap_or(1e-4),
        frame_start: frame_start.unwrap_or(0.0),
        series_strain: series_strain.unwrap_or(1e-5),
        checkpoint_strain: checkpoint_strain.unwrap_or(0.02),
        progress_lines: progress_lines.map_or(20, i64::unsigned_abs),
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
        skin,
        rebuild_every: rebuild_every.map_or(0, i64::unsigned_abs),
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
    given: Option<f64>,
    force: bool,
) -> Result<TimeStep, Failure> {
    let step = given.unwrap_or(default);
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
    Ok(TimeStep {
        step,
        limit,
        given: given.is_some(),
    })
}
