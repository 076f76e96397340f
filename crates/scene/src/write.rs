//! The checked scene as TOML again, with every default filled in: what the user chose stays as
//! chosen, what follows from it stands in comments, so that reading it gives the same scene to the
//! last bit.

use std::fmt::Write;

use super::key::{Key, Kind};
use super::periodic::{Method, PeriodicScene};
use super::raw::{self, Flag, KeyTable, Number, Numbers, Text, Whole, show};
use super::scene::{
    Bookkeeping, Contact, Dimensions, Law, Motion, Origin, Part, Sample, Scene, Sizes, StepChoice,
    WallSpeed, Walls,
};

/// How the load was given: κ, P (Pa) or N (N/m).
#[derive(Debug, Clone, Copy)]
pub(super) enum LoadChoice {
    StiffnessNumber(f64),
    Pressure(f64),
    NormalForce(f64),
}

/// Lines of TOML.
struct Lines(String);

impl Lines {
    fn line(&mut self, text: &str) {
        self.0.push_str(text);
        self.0.push('\n');
    }

    /// Begins a table. Returns its keys.
    fn table<T: KeyTable>(&mut self) -> T {
        self.line(&format!("\n[{}]", T::NAME));
        T::default()
    }

    /// Gives a key a value, written as TOML.
    fn give<T: Kind>(&mut self, key: &Key<T>, value: &str) {
        self.line(&format!("{} = {value}", key.declared.name()));
    }

    fn number(&mut self, key: &Key<Number>, x: f64) {
        self.give(key, &show(x));
    }

    fn whole(&mut self, key: &Key<Whole>, n: u64) {
        self.give(key, &n.to_string());
    }

    fn flag(&mut self, key: &Key<Flag>, b: bool) {
        self.give(key, &b.to_string());
    }

    fn text(&mut self, key: &Key<Text>, s: &str) {
        self.give(key, &toml::Value::String(s.into()).to_string());
    }

    fn numbers(&mut self, key: &Key<Numbers>, list: &[String]) {
        self.give(key, &format!("[{}]", list.join(", ")));
    }
}

/// The configuration of a scene; `force` is `time.force`.
pub(super) fn toml(scene: &Scene, load: LoadChoice, force: bool) -> String {
    let mut t = Lines(String::new());
    t.line("# What is run: every default filled in. What follows from it:");
    t.0.push_str(&derived_comments(scene));
    let common = Common {
        title: &scene.title,
        seed: scene.seed,
        dimension: scene.dimension,
        law: &scene.law,
        contact: scene.contact,
    };
    head(&mut t, &common);
    plane_shear(&mut t, scene, load, force);
    t.0
}

/// The configuration of a scene in a periodic box; `force` is `time.force`.
pub(super) fn periodic(scene: &PeriodicScene, force: bool) -> String {
    let mut t = Lines(String::new());
    t.line("# What is run: every default filled in. What follows from it:");
    t.line(&format!("# time step = {:?}", scene.time_step.step));
    t.line(&format!(
        "# its limit of stability = {:?}",
        scene.time_step.limit
    ));
    let common = Common {
        title: &scene.title,
        seed: scene.seed,
        dimension: scene.dimension,
        law: &scene.law,
        contact: scene.contact,
    };
    head(&mut t, &common);
    let keys: raw::Sample = t.table();
    t.whole(&keys.grains, scene.sample.grains.into());
    radii(&mut t, &scene.sample, Some(&scene.sizes));
    let keys: raw::BoxTable = t.table();
    t.number(&keys.solid_fraction, scene.solid_fraction);
    let keys: raw::Time = t.table();
    if scene.time_step.given == StepChoice::Given {
        t.number(&keys.step, scene.time_step.step);
    }
    t.flag(&keys.force, force);
    let keys: raw::Relax = t.table();
    let relax = &scene.relax;
    let name = Method::NAMES
        .iter()
        .find(|(_, known)| *known == relax.method);
    t.text(&keys.method, name.map_or("", |(name, _)| name));
    t.number(&keys.tolerance, relax.tolerance);
    t.number(&keys.drag, relax.drag);
    t.whole(&keys.max_steps, relax.max_steps);
    let keys: raw::Aqs = t.table();
    let aqs = &scene.aqs;
    t.number(&keys.strain_step, aqs.strain_step);
    t.whole(&keys.steps, aqs.steps);
    t.whole(&keys.frame_every, aqs.frame_every);
    t.flag(&keys.spectrum, aqs.spectrum);
    if aqs.spectrum {
        t.number(&keys.birth_precision, aqs.birth_precision);
        t.number(&keys.until_imaginary, aqs.until_imaginary);
    }
    if let Some(newtonian) = &scene.newtonian {
        let keys: raw::Newtonian = t.table();
        t.number(&keys.growth_times, newtonian.growth_times);
        t.whole(&keys.rows, newtonian.rows);
        t.whole(&keys.frames, newtonian.frames);
        t.whole(&keys.spectra, newtonian.spectra);
    }
    let keys: raw::Output = t.table();
    t.flag(&keys.keep_checkpoints, scene.keep_checkpoints);
    bookkeeping(&mut t, &scene.bookkeeping);
    t.0
}

/// What scenes with and without walls have in common.
struct Common<'a> {
    title: &'a str,
    seed: u64,
    dimension: Dimensions,
    law: &'a Law,
    contact: Contact,
}

fn head(t: &mut Lines, scene: &Common<'_>) {
    let keys = raw::Raw::KEYS;
    t.text(&keys.title, scene.title);
    t.whole(&keys.seed, scene.seed);
    t.whole(&keys.dimension, scene.dimension.axes() as u64);
    let values = |t: &mut Lines, table: &str| {
        for (key, value) in scene.law.given() {
            if key.table() == table {
                t.number(&Key::absent((*key).into()), *value);
            }
        }
    };
    let _: raw::Material = t.table();
    values(t, raw::Material::NAME);
    let keys: raw::Contact = t.table();
    t.text(&keys.law, scene.law.kind().name);
    values(t, raw::Contact::NAME);
    t.number(&keys.friction, scene.contact.friction);
    if scene.dimension == Dimensions::Two && scene.law.kind().rolling {
        t.number(&keys.rolling_friction, scene.contact.rolling_friction);
        t.number(
            &keys.rolling_damping_ratio,
            scene.contact.rolling_damping_ratio,
        );
    }
}

fn plane_shear(t: &mut Lines, scene: &Scene, load: LoadChoice, force: bool) {
    let keys: raw::Sample = t.table();
    if let Origin::Packing { file, walls } = &scene.origin {
        t.text(&keys.packing, &file.path.display().to_string());
        let copies = &file.replicate[..scene.dimension.axes() - 1];
        let copies: Vec<String> = copies.iter().map(u32::to_string).collect();
        t.numbers(&keys.replicate, &copies);
        let name = Walls::NAMES.iter().find(|(_, known)| known == walls);
        t.text(&keys.walls, name.map_or("", |(name, _)| name));
    }
    t.whole(&keys.grains, scene.sample.grains.into());
    let sizes = match &scene.origin {
        Origin::Insertion(sizes) => Some(sizes),
        Origin::Packing { .. } => None,
    };
    radii(t, &scene.sample, sizes);
    t.number(&keys.length, scene.sample.length);
    if scene.dimension == Dimensions::Three {
        t.number(&keys.width, scene.sample.width);
    }

    let keys: raw::Load = t.table();
    match load {
        LoadChoice::StiffnessNumber(kappa) => t.number(&keys.stiffness_number, kappa),
        LoadChoice::Pressure(p) => t.number(&keys.pressure, p),
        LoadChoice::NormalForce(n) => t.number(&keys.normal_force, n),
    }
    t.number(&keys.gravity, scene.load.gravity);

    let keys: raw::Time = t.table();
    match scene.time_step.given {
        StepChoice::Derived => {}
        StepChoice::Given => t.number(&keys.step, scene.time_step.step),
        StepChoice::Collision(speed) => t.number(&keys.collision_speed, speed),
    }
    t.flag(&keys.force, force);

    let keys: raw::Pack = t.table();
    t.flag(&keys.skip, scene.pack.skip);
    if !scene.pack.skip {
        t.number(&keys.friction, scene.pack.friction);
        t.number(&keys.tolerance, scene.pack.tolerance);
        t.whole(&keys.max_steps, scene.pack.max_steps);
    }

    let keys: raw::Shear = t.table();
    if let Some(spring) = scene.shear.spring {
        match spring.number {
            Some(number) => t.number(&keys.spring_number, number),
            None => t.number(&keys.spring_stiffness, spring.stiffness),
        }
    }
    match &scene.shear.motion {
        Motion::Strain { drive, strain } => {
            match drive {
                WallSpeed::InertialNumber(i) => t.number(&keys.inertial_number, *i),
                WallSpeed::Velocity(v) => t.number(&keys.velocity, *v),
            }
            t.number(&keys.strain, *strain);
        }
        Motion::Protocol(parts) => {
            let mut list = String::from("[\n");
            for Part {
                velocity,
                time,
                distance,
            } in parts
            {
                let (name, length) = match distance {
                    Some(distance) => ("distance", distance),
                    None => ("time", time),
                };
                // Writing to a string cannot fail.
                let _ = writeln!(
                    list,
                    "    {{ velocity = {}, {name} = {} }},",
                    show(*velocity),
                    show(*length)
                );
            }
            t.give(&keys.protocol, &(list + "]"));
        }
    }

    let keys: raw::Output = t.table();
    let output = &scene.output;
    match scene.shear.motion {
        Motion::Strain { .. } => {
            t.number(&keys.frame_strain, output.frame_strain);
            t.number(&keys.frame_start, output.frame_start);
            t.number(&keys.series_strain, output.series_strain);
            t.number(&keys.checkpoint_strain, output.checkpoint_strain);
        }
        Motion::Protocol(_) => {
            t.whole(&keys.frame_rows, output.frame_rows);
            t.whole(&keys.series_rows, output.series_rows);
        }
    }
    t.flag(&keys.keep_checkpoints, output.keep_checkpoints);
    t.whole(&keys.progress_lines, scene.output.progress_lines);
    t.flag(&keys.energy, scene.output.energy);

    let keys: raw::Analysis = t.table();
    t.flag(&keys.scalars, scene.analysis.scalars);
    if let Motion::Strain { .. } = scene.shear.motion {
        if scene.analysis.strain > 0.0 {
            t.number(&keys.strain, scene.analysis.strain);
        }
        t.number(&keys.start, scene.analysis.start);
    }

    bookkeeping(t, &scene.bookkeeping);
}

/// Between which radii, and how they are distributed, if the grains are inserted.
fn radii(t: &mut Lines, sample: &Sample, sizes: Option<&Sizes>) {
    let keys = raw::Sample::KEYS;
    if !matches!(sizes, Some(Sizes::List(_))) {
        t.number(&keys.radius_min, sample.radius_min);
        t.number(&keys.radius_max, sample.radius_max);
    }
    let Some(sizes) = sizes else { return };
    t.text(&keys.sizes, sizes.name());
    match sizes {
        Sizes::Uniform => {}
        Sizes::Normal { mean, deviation } => {
            t.number(&keys.radius_mean, *mean);
            t.number(&keys.radius_deviation, *deviation);
        }
        Sizes::Binary { large_fraction } => t.number(&keys.large_fraction, *large_fraction),
        Sizes::List(radii) => {
            let radii: Vec<String> = radii.iter().map(|r| show(*r)).collect();
            t.numbers(&keys.radii, &radii);
        }
    }
}

fn bookkeeping(t: &mut Lines, bookkeeping: &Bookkeeping) {
    let keys: raw::Bookkeeping = t.table();
    if let Some(skin) = bookkeeping.list.skin {
        t.number(&keys.skin, skin);
    }
    t.whole(&keys.rebuild_every, bookkeeping.list.rebuild_every);
    t.text(&keys.simd, bookkeeping.simd);
}

fn derived_comments(scene: &Scene) -> String {
    let mut s = String::new();
    let mut comment = |symbol: &str, x: f64, unit: &str| {
        // Writing to a string cannot fail.
        let _ = writeln!(
            s,
            "# {symbol} = {x:?}{}{unit}",
            if unit.is_empty() { "" } else { " " }
        );
    };
    for (symbol, value, unit) in scene.law.derived() {
        comment(symbol, value, unit);
    }
    comment("pressure P", scene.load.pressure, "Pa");
    let of_force = match scene.dimension {
        Dimensions::Two => "N/m",
        Dimensions::Three => "N",
    };
    comment("normal force N", scene.load.normal_force, of_force);
    if let Some(spring) = scene.shear.spring {
        let unit = match scene.dimension {
            Dimensions::Two => "Pa",
            Dimensions::Three => "N/m",
        };
        comment("stiffness of the spring k", spring.stiffness, unit);
        let number = spring.stiffness * scene.sample.mean_diameter / scene.load.normal_force;
        comment("spring number k d/N", number, "");
    }
    comment("stiffness number kappa", scene.load.stiffness_number, "");
    comment("time step", scene.time_step.step, "s");
    comment(
        "stability limit of the time step",
        scene.time_step.limit,
        "s",
    );
    s
}

#[cfg(test)]
mod tests {
    use crate::{Scene, Source, Study, load, study};

    /// The default scene with linear springs.
    const HOOKE: &[&str] = &[
        "contact.law=hooke",
        "material.young_modulus=none",
        "material.poisson_ratio=none",
        "contact.normal_stiffness=1e8",
    ];

    /// With the smoothed law, and grains of equal masses.
    const MINDLIN: &[&str] = &[
        "contact.law=mindlin",
        "material.young_modulus=none",
        "material.poisson_ratio=none",
        "material.density=none",
        "material.mass=1.25e-9",
        "contact.normal_stiffness=1e11",
        "contact.damping_ratio=none",
        "contact.rolling_friction=none",
        "contact.rolling_damping_ratio=none",
    ];

    fn with(sets: &[&str]) -> Scene {
        let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
        load(&Source::embedded(), &sets).unwrap()
    }

    /// Equal as values and in every digit: `{:?}` tells -0 from 0 too.
    fn reads_back(scene: &Scene) {
        let again = load(&Source::new("scene.toml", scene.toml.clone()), &[]).unwrap();
        assert_eq!(&again, scene);
        assert_eq!(format!("{again:?}"), format!("{scene:?}"));
    }

    #[test]
    fn every_choice_reads_back_as_the_same_scene() {
        for sets in [
            &[][..],
            &[
                "load.stiffness_number=none",
                "load.pressure=12345.678901234567",
            ],
            &[
                "load.stiffness_number=none",
                "load.normal_force=0.7123456789012345",
            ],
            &["contact.damping_ratio=none", "contact.restitution=0.73"],
            &["contact.damping_ratio=none", "contact.restitution=1"],
            &["shear.inertial_number=none", "shear.velocity=0.0003"],
            &["time.step=1e-10"],
            HOOKE,
            &[
                "contact.law=hooke",
                "material.young_modulus=none",
                "material.poisson_ratio=none",
                "contact.normal_stiffness=123456789.3",
                "contact.tangential_stiffness=98765432.1",
            ],
            MINDLIN,
            &["time.step=1e-6", "time.force=true"],
            &["bookkeeping.skin=0.3", "bookkeeping.rebuild_every=17"],
            &["output.frame_strain=0", "output.frame_start=0.01"],
            &["analysis.scalars=true", "analysis.start=0.02"],
            &[
                "analysis.scalars=true",
                "analysis.strain=7e-5",
                "output.frame_strain=0",
            ],
            &[
                "sample.radius_min=0.1",
                "sample.radius_max=0.30000000000000004",
                "sample.length=9.3",
                "seed=9223372036854775807",
            ],
            &["title='''a \"quoted\" \\ title\twith # and a 'tick'. '''"],
        ] {
            reads_back(&with(sets));
        }
    }

    #[test]
    fn the_choice_is_kept() {
        let scene = with(&["contact.damping_ratio=none", "contact.restitution=0.73"]);
        assert!(
            scene.toml.contains("\nrestitution = 0.73\n"),
            "{}",
            scene.toml
        );
        assert!(scene.toml.contains("\ninertial_number = 0.0002\n"));
        assert!(!scene.toml.contains("\ndamping_ratio"));
        assert!(!scene.toml.contains("\nstep"));
    }

    /// No key is forgotten: all but the alternatives that were not chosen are there.
    #[test]
    fn every_default_is_filled_in() {
        let of_hertz = [
            "normal_damping",
            "tangential_damping",
            "tangential_damping_ratio",
            "impact_speed",
            "impact_diameter",
        ];
        let of_hooke = ["normal_stiffness", "tangential_stiffness"];
        let of_lee_hurley = ["young_modulus", "poisson_ratio"];
        let never = [
            "restitution",
            "pressure",
            "normal_force",
            "velocity",
            "packing",
            "replicate",
            "walls",
            "mass",
        ];
        let of_sizes = [
            "radius_mean",
            "radius_deviation",
            "large_fraction",
            "radii",
            "width",
        ];
        let of_protocols = [
            "protocol",
            "spring_stiffness",
            "spring_number",
            "frame_rows",
            "series_rows",
            "collision_speed",
        ];
        let always = [&of_hertz[..], &never, &of_sizes, &of_protocols].concat();
        for (law, other) in [(&[][..], of_hooke), (HOOKE, of_lee_hurley)] {
            let sets = [&["time.step=1e-10", "bookkeeping.skin=0.3"], law].concat();
            missing_are(&with(&sets).toml, &[&always[..], &other].concat());
        }
        let spheres = [
            "dimension=3",
            "contact.law=none",
            "contact.rolling_friction=none",
            "contact.rolling_damping_ratio=none",
            "contact.damping_ratio=none",
            "contact.normal_damping=1e12",
            "sample.width=20e-6",
            "sample.grains=8000",
            "sample.sizes=normal",
            "sample.radius_mean=0.7e-6",
            "sample.radius_deviation=0.1e-6",
            "shear.inertial_number=none",
            "shear.strain=none",
            "shear.spring_number=425",
            "shear.protocol=[{velocity=1e-3,distance=1e-6},{velocity=0,time=2e-3}]",
            "output.frame_strain=none",
            "output.series_strain=none",
            "output.checkpoint_strain=none",
            "time.collision_speed=10",
            "bookkeeping.skin=0.3",
            "load.stiffness_number=none",
            "load.pressure=1e5",
        ];
        let scene = with(&spheres);
        reads_back(&scene);
        let not = [
            "damping_ratio",
            "tangential_damping_ratio",
            "restitution",
            "impact_speed",
            "impact_diameter",
            "normal_stiffness",
            "tangential_stiffness",
            "rolling_friction",
            "rolling_damping_ratio",
            "large_fraction",
            "radii",
            "packing",
            "replicate",
            "walls",
            "mass",
            "stiffness_number",
            "normal_force",
            "step",
            "inertial_number",
            "velocity",
            "strain",
            "spring_stiffness",
            "frame_strain",
            "frame_start",
            "series_strain",
            "checkpoint_strain",
            "start",
            "mass",
        ];
        missing_are(&scene.toml, &not);
    }

    #[test]
    fn a_scene_in_a_box_reads_back() {
        let text = include_str!("../../../configs/bonfanti.toml");
        for set in [
            "seed=2",
            "dimension=2",
            "time.step=0.01",
            "aqs.spectrum=false",
        ] {
            let mut sets = vec![set.to_string()];
            if set == "aqs.spectrum=false" {
                sets.push("aqs.until_imaginary=none".into());
            }
            let read = |text: &str, sets: &[String]| {
                let source = Source::new("scene.toml", text);
                match study(&source, sets, &mut |_, _| panic!("no packing")).unwrap() {
                    Study::Periodic(scene) => scene,
                    Study::PlaneShear(_) => panic!("walls"),
                }
            };
            let scene = read(text, &sets);
            let again = read(&scene.toml, &[]);
            assert_eq!(format!("{again:?}"), format!("{scene:?}"));
        }
    }

    fn missing_are(toml: &str, missing: &[&str]) {
        let of_a_box = |table: &str| table == "box" || crate::OF_A_BOX.contains(&table);
        for key in crate::raw::TABLES
            .iter()
            .filter(|table| !of_a_box(table.name))
            .flat_map(|table| &table.keys)
            .map(|key| key.name)
        {
            let there = toml.contains(&format!("\n{key} = "));
            assert_eq!(there, !missing.contains(&key), "{key} in {toml}");
        }
    }

    #[test]
    fn every_distribution_and_drive_reads_back() {
        for sets in [
            &["sample.sizes=binary", "sample.large_fraction=0.25"][..],
            &[
                "sample.radius_min=none",
                "sample.radius_max=none",
                "sample.sizes=list",
                "sample.radii=[0.5e-6, 0.75e-6, 1e-6]",
            ],
            &["shear.spring_stiffness=1e6"],
            &["load.gravity=9.81"],
        ] {
            reads_back(&with(sets));
        }
    }
}
