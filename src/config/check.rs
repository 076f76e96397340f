//! From what was written to a scene in which nothing is optional any more.

use super::ReadPacking;
use super::checker::{Bounds, Checker, Key, NOT_NEGATIVE, POSITIVE};
use super::derived::{self, LEAST_HEIGHT, STIFFNESS_NUMBER_MAX, STIFFNESS_NUMBER_MIN};
use super::raw::{self, Number, Raw, Text, Whole, show};
use super::scene::*;
use super::source::Input;
use super::write::{self, DampingChoice, LoadChoice};
use crate::failure::Failure;
use crate::simd::Level;

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

/// Checks every value by itself, then those that must agree, and derives what follows. `tables` says where each begins; `packing`
/// is asked about the file of a packing, if the scene has one.
pub(super) fn scene(
    mut raw: Raw,
    input: Input<'_>,
    tables: Vec<(String, usize)>,
    packing: ReadPacking<'_>,
) -> Result<Scene, Failure> {
    let mut c = Checker::new(input, tables);
    let title = c.text(&Key::new("title", raw.title));
    let seed = c.whole(&Key::new("seed", raw.seed), 0, i64::MAX);
    let law = check_law(&mut c, raw.material, &mut raw.contact);
    let (contact, damping_choice) = check_contact(&mut c, raw.contact);
    let sample = check_sample(&mut c, raw.sample);
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
    let pack = check_pack(&mut c, raw.pack, &sample);
    let shear = check_shear(&mut c, raw.shear);
    let output = check_output(&mut c, raw.output);
    let bookkeeping = check_bookkeeping(&mut c, raw.bookkeeping);
    c.settle()?;

    let (sample, origin) = derive_sample(&mut c, &sample, pack.skip, packing)?;
    let load = derive_load(&mut c, &law, &sample, load_choice, &load_key)?;
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
    let time_step = check_step(&mut c, contact_time, &step_key, step, force)?;

    let mut scene = Scene {
        title: title.unwrap_or_else(|| "Plane shear".into()),
        seed: seed.map_or(1, i64::unsigned_abs),
        law,
        contact,
        sample,
        origin,
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

/// The law with its constants: takes the keys of the springs out of `[contact]`.
fn check_law(c: &mut Checker<'_>, material: raw::Material, contact: &mut raw::Contact) -> Law {
    let law = Key::new("contact.law", contact.law.take());
    let young_modulus = key!(material.young_modulus);
    let poisson_ratio = key!(material.poisson_ratio);
    let normal_stiffness = Key::new("contact.normal_stiffness", contact.normal_stiffness.take());
    let tangential_stiffness = Key::new(
        "contact.tangential_stiffness",
        contact.tangential_stiffness.take(),
    );
    let density = key!(material.density);
    let name = c.text(&law).unwrap_or_else(|| Law::NAMES[0].into());
    let known = Law::NAMES.contains(&name.as_str());
    if !known {
        let names = Law::NAMES.map(|name| format!("{name:?}")).join(" and ");
        c.refuse(&law, &format!("unknown law {name:?}; there are {names}"));
    }
    let hooke = name == Law::NAMES[1];
    // Of an unknown law nobody knows what it needs.
    let of_other: &[&Key<Number>] = match (known, hooke) {
        (false, _) => &[],
        (true, false) => &[&normal_stiffness, &tangential_stiffness],
        (true, true) => &[&young_modulus, &poisson_ratio],
    };
    for key in of_other.iter().filter(|key| key.given.is_some()) {
        let place = law
            .offset()
            .map_or("the default".into(), |at| c.mention(at));
        let other = Law::NAMES[usize::from(!hooke)];
        let mut what = format!(
            "means nothing to the law {name:?} ({place}), only to {other:?}; leave it out, or choose that law with contact.law"
        );
        if place.starts_with("--set") {
            what += &format!("; --set {}=none takes it away", key.path);
        }
        c.refuse(key, &what);
    }
    if hooke {
        let k_n = c.required(
            &normal_stiffness,
            &POSITIVE,
            "k_n (N/m per unit depth, which is Pa), such as normal_stiffness = 1e8",
        );
        let k_t = c.number(&tangential_stiffness, &POSITIVE);
        if k_t.is_some_and(|k_t| k_t > k_n) {
            let given = show(k_t.unwrap_or(f64::NAN));
            c.refuse(
                &tangential_stiffness,
                &format!(
                    "must lie in (0, normal_stiffness = {}], found {given}",
                    show(k_n)
                ),
            );
        }
        return Law::Hooke(Springs {
            normal_stiffness: k_n,
            tangential_stiffness: k_t.unwrap_or(2.0 / 7.0 * k_n),
            density: check_density(c, &density),
        });
    }
    let needed = |c: &mut Checker<'_>, key, bounds, what| match known {
        true => c.required(key, bounds, what),
        false => f64::NAN,
    };
    Law::LeeHurley(Material {
        young_modulus: needed(
            c,
            &young_modulus,
            &POSITIVE,
            "E (Pa), such as young_modulus = 1e9",
        ),
        poisson_ratio: needed(
            c,
            &poisson_ratio,
            &POISSON,
            "nu, such as poisson_ratio = 0.2",
        ),
        density: check_density(c, &density),
    })
}

fn check_density(c: &mut Checker<'_>, density: &Key<Number>) -> f64 {
    c.required(density, &POSITIVE, "rho (kg/m^3), such as density = 2500.0")
}

fn check_contact(c: &mut Checker<'_>, contact: raw::Contact) -> (Contact, DampingChoice) {
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

/// The keys of `[sample]`, each checked by itself.
struct SampleKeys {
    grains: Key<Whole>,
    radius_min: Key<Number>,
    radius_max: Key<Number>,
    length: Key<Number>,
    packing: Key<Text>,
    walls: Option<Walls>,
}

impl SampleKeys {
    /// Those that make the size of the sample, for what they cause together.
    fn places(&self) -> [(&'static str, Option<usize>); 4] {
        [
            (self.grains.path, self.grains.offset()),
            (self.radius_min.path, self.radius_min.offset()),
            (self.radius_max.path, self.radius_max.offset()),
            (self.length.path, self.length.offset()),
        ]
    }
}

fn check_sample(c: &mut Checker<'_>, sample: raw::Sample) -> SampleKeys {
    let walls = key!(sample.walls);
    let keys = SampleKeys {
        grains: key!(sample.grains),
        radius_min: key!(sample.radius_min),
        radius_max: key!(sample.radius_max),
        length: key!(sample.length),
        packing: key!(sample.packing),
        walls: c.text(&walls).and_then(|name| {
            let known = Walls::NAMES.into_iter().find(|(known, _)| *known == name);
            if known.is_none() {
                let names = Walls::NAMES.map(|(known, _)| format!("{known:?}"));
                c.refuse(
                    &walls,
                    &format!("unknown walls {name:?}; they are {}", names.join(" or ")),
                );
            }
            known.map(|(_, walls)| walls)
        }),
    };
    // Grains are numbered by u32.
    let most = u32::MAX.into();
    if keys.packing.given.is_some() {
        c.whole(&keys.grains, 1, most);
        for key in [&keys.radius_min, &keys.radius_max, &keys.length] {
            c.number(key, &POSITIVE);
        }
        return keys;
    }
    if walls.given.is_some() {
        c.refuse(
            &walls,
            "there is no packing to find walls in; give sample.packing, or leave it out",
        );
    }
    c.required_whole(
        &keys.grains,
        1,
        most,
        "the number of disks, such as grains = 1000",
    );
    for (key, what) in [
        (
            &keys.radius_min,
            "the least R (m), such as radius_min = 0.5e-6",
        ),
        (
            &keys.radius_max,
            "the greatest R (m), such as radius_max = 1e-6",
        ),
        (&keys.length, "L_x (m), such as length = 48e-6"),
    ] {
        c.required(key, &POSITIVE, what);
    }
    keys
}

/// The sample and where it comes from; `skip`: it is not compressed.
fn derive_sample(
    c: &mut Checker<'_>,
    keys: &SampleKeys,
    skip: bool,
    packing: ReadPacking<'_>,
) -> Result<(Sample, Origin), Failure> {
    let Some((at, Text(path))) = &keys.packing.given else {
        let number = |key: &Key<Number>| key.given.as_ref().map_or(f64::NAN, |(_, x)| x.0);
        let sample = Sample::uniform(
            keys.grains.given.as_ref().map_or(0, |(_, n)| n.0 as u32),
            number(&keys.radius_min),
            number(&keys.radius_max),
            number(&keys.length),
        );
        let radii = [keys.places()[1], keys.places()[2]];
        let (a, b) = (sample.radius_min, sample.radius_max);
        if a > b {
            c.refuse_among(
                &radii,
                &format!("radius_min = {a:?} is greater than radius_max = {b:?}; give radius_min <= radius_max"),
            );
        }
        c.settle()?;
        check_size(c, &sample, derived::packed_height(&sample), &keys.places())?;
        return Ok((sample, Origin::Insertion));
    };
    let file = packing(&c.resolve(*at, path)).map_err(|failure| match failure {
        Failure::Input(what) => c.failure(*at, keys.packing.path, &what),
        other => other,
    })?;
    if let Some(n) = c.whole(&keys.grains, 1, u32::MAX.into())
        && n != i64::from(file.grains)
    {
        c.refuse(&keys.grains, &unlike_packing(n, file.grains));
    }
    for (key, of_file) in [
        (&keys.radius_min, file.radius_min),
        (&keys.radius_max, file.radius_max),
        (&keys.length, file.length),
    ] {
        if let Some(x) = c.number(key, &POSITIVE)
            && x != of_file
        {
            c.refuse(key, &unlike_packing(show(x), show(of_file)));
        }
    }
    c.settle()?;
    let sample = Sample {
        grains: file.grains,
        radius_min: file.radius_min,
        radius_max: file.radius_max,
        mean_diameter: file.mean_diameter,
        mean_square_radius: file.mean_square_radius,
        length: file.length,
    };
    let place = [(keys.packing.path, keys.packing.offset())];
    check_size(c, &sample, file.height(), &place)?;
    let walls = keys.walls.unwrap_or(if skip && file.wall_types {
        Walls::Types
    } else {
        Walls::Layers
    });
    Ok((sample, Origin::Packing { file, walls }))
}

fn unlike_packing(given: impl std::fmt::Display, of_file: impl std::fmt::Display) -> String {
    format!("is {of_file} in the packing of sample.packing, found {given}; leave it out")
}

/// What the values of `[sample]` must be to each other; `height` (m) with the walls, `places` that cause it.
fn check_size(
    c: &mut Checker<'_>,
    sample: &Sample,
    height: f64,
    places: &[(&str, Option<usize>)],
) -> Result<(), Failure> {
    let least = 8.0 * sample.radius_max;
    if sample.length < least {
        // The length first, where it was given.
        let reversed: Vec<_> = places.iter().rev().copied().collect();
        c.refuse_among(
            &reversed,
            &format!(
                "the cell is too narrow for its grains: length = {} m; give at least 4 diameters of the largest, {least:.3e} m",
                show(sample.length)
            ),
        );
    }
    c.settle()?;
    let needed = LEAST_HEIGHT * sample.mean_diameter;
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
    law: &Law,
    sample: &Sample,
    choice: LoadChoice,
    key: &Key<Number>,
) -> Result<Load, Failure> {
    let (pressure, normal_force) = match choice {
        LoadChoice::StiffnessNumber(kappa) => {
            let p = derived::pressure(law, sample, kappa);
            return Ok(Load {
                pressure: p,
                normal_force: p * sample.length,
                stiffness_number: kappa,
            });
        }
        LoadChoice::Pressure(p) => (p, p * sample.length),
        LoadChoice::NormalForce(n) => (n / sample.length, n),
    };
    match derived::stiffness_number(law, sample, pressure) {
        Some(stiffness_number) => Ok(Load {
            pressure,
            normal_force,
            stiffness_number,
        }),
        None => {
            let least = derived::pressure(law, sample, STIFFNESS_NUMBER_MAX);
            let most = derived::pressure(law, sample, STIFFNESS_NUMBER_MIN);
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
        energy: c.flag(&key!(output.energy)).unwrap_or(true),
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
    contact_time: f64,
    key: &Key<Number>,
    given: Option<f64>,
    force: bool,
) -> Result<TimeStep, Failure> {
    let limit = derived::step_limit(contact_time);
    let default = derived::default_step(contact_time);
    let step = given.unwrap_or(default);
    if step > limit && !force {
        c.refuse(
            key,
            &format!(
                "{} s is over the stability limit 2/omega_max = {limit:.3e} s; give less, or leave it out for {default:.3e} s, or run it all the same with time.force = true",
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
