use crate::keys::tables;
use crate::testing::{embedded, overrides};
use crate::{Scene, Source, load};

/// The default scene with linear springs.
const HOOKE: &str = "
    contact.law=hooke material.young_modulus=none material.poisson_ratio=none
    contact.normal_stiffness=1e8";

/// With the smoothed law, and grains of equal masses.
const MINDLIN: &str = "
    contact.law=mindlin material.young_modulus=none material.poisson_ratio=none
    material.density=none material.mass=1.25e-9 contact.normal_stiffness=1e11
    contact.damping_ratio=none contact.rolling_friction=none contact.rolling_damping_ratio=none";

fn with(sets: &str) -> Scene {
    embedded(sets).unwrap()
}

/// With columns of its own.
const OBSERVED: &str = r#"
    observable=[{name="v",quantity="0.5*v_x^2",y=[0.25,0.75],radius=[0,1],unit="m/s"},{name="s",plane=0.5},{name="e",expression="v/s"}]
    output.columns=["e","strain"]"#;

/// The default scene without walls, strained after its shear.
const BOTH: &str = "
    sample.boundary=periodic relax.tolerance=1e-9 relax.drag=1e3 aqs.strain_step=1e-4
    aqs.steps=3";

fn boxed(sets: &str) -> Scene {
    let text = include_str!("../../../configs/bonfanti.toml");
    load(&Source::new("box.toml", text), &overrides(sets)).unwrap()
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
        "",
        "load.stiffness_number=none load.pressure=12345.678901234567",
        "load.stiffness_number=none load.normal_force=0.7123456789012345",
        "contact.damping_ratio=none contact.restitution=0.73",
        "contact.damping_ratio=none contact.restitution=1",
        "shear.inertial_number=none shear.velocity=0.0003",
        "time.step=1e-10",
        HOOKE,
        "contact.law=hooke material.young_modulus=none material.poisson_ratio=none
         contact.normal_stiffness=123456789.3 contact.tangential_stiffness=98765432.1",
        MINDLIN,
        "contact.law=hooke material.young_modulus=none material.poisson_ratio=none
         contact.normal_stiffness=1e8 contact.ageing=0.02 contact.ageing_time=1e-4",
        "time.step=1e-6 time.force=true",
        "bookkeeping.skin=0.3 bookkeeping.rebuild_every=17",
        "bookkeeping.band_grains=300 bookkeeping.steps_at_once=3",
        "output.frame_strain=0 output.frame_start=0.01",
        "output.temperatures=true",
        "output.histories=false",
        OBSERVED,
        "output.compress=false",
        "analysis.scalars=true analysis.start=0.02",
        "analysis.scalars=true analysis.strain=7e-5 output.frame_strain=0",
        "sample.radius_min=0.1 sample.radius_max=0.30000000000000004 sample.length=9.3
            seed=9223372036854775807",
        "sample.sizes=binary sample.large_fraction=0.25",
        "sample.radius_min=none sample.radius_max=none sample.sizes=list
            sample.radii=[0.5e-6,0.75e-6,1e-6]",
        "sample.radius_min=none sample.radius_max=none sample.sizes=list
            sample.radii=[0.5e-6,0.75e-6,1e-6] sample.radii_weights=[0.3,1,2.5]",
        &given_radii(),
        GRADED,
        "sample.sizes=lognormal sample.radius_mean=0.7e-6 sample.radius_deviation=0.2e-6",
        "sample.sizes=power sample.radius_exponent=2.5",
        "contact.attraction=0.1",
        "shear.spring_stiffness=1e6",
        "load.gravity=9.81",
        "load.control=servo",
        "load.control=servo load.servo_gain=1e-7 load.servo_speed_max=0.1",
        SPHERES,
        BOTH,
        "sample.boundary=periodic relax.tolerance=1e-9 relax.drag=1e3",
        "sample.boundary=periodic relax.tolerance=1e-9 relax.drag=1e3 newtonian.growth_times=1",
    ] {
        reads_back(&with(sets));
    }
    assert_eq!(with(&given_radii()).sample.grains, 1000);
    let title = "title='''a \"quoted\" \\ title\twith # and a 'tick'. '''";
    reads_back(&load(&Source::embedded(), &[title.into()]).unwrap());
}

#[test]
fn the_choice_is_kept() {
    let toml = with("contact.damping_ratio=none contact.restitution=0.73").toml;
    assert!(toml.contains("\nrestitution = 0.73\n"), "{toml}");
    assert!(toml.contains("\ninertial_number = 0.0002\n"));
    assert!(!toml.contains("\ndamping_ratio") && !toml.contains("\nstep ="));
}

/// A grading curve.
const GRADED: &str = "
    sample.radius_min=none sample.radius_max=none sample.sizes=table
    sample.sieves=[1e-6,1.5e-6,2e-6] sample.passing=[0.0,0.4,1.0]";

/// The radius of each of a thousand grains.
fn given_radii() -> String {
    let radii: Vec<f64> = (0..1000)
        .map(|k| 0.5e-6 + 0.5e-9 * f64::from(k % 997))
        .collect();
    let radii = format!("{radii:?}").replace(' ', "");
    format!(
        "sample.grains=none sample.radius_min=none sample.radius_max=none sample.sizes=given
        sample.radii={radii}"
    )
}

/// Spheres in parts.
const SPHERES: &str = "
    dimension=3 contact.law=none contact.rolling_friction=none
    contact.rolling_damping_ratio=none contact.damping_ratio=none contact.normal_damping=1e12
    sample.width=20e-6 sample.grains=8000 sample.sizes=normal sample.radius_mean=0.7e-6
    sample.radius_deviation=0.1e-6 shear.inertial_number=none shear.strain=none
    shear.spring_number=425
    shear.protocol=[{velocity=1e-3,distance=1e-6},{velocity=0,time=2e-3}]
    output.frame_strain=none output.series_strain=none output.checkpoint_strain=none
    time.collision_speed=10 bookkeeping.skin=0.3 load.stiffness_number=none load.pressure=1e5";

/// Of a strain, a protocol and a box.
#[test]
fn every_constant_default_is_written() {
    let binary = "sample.sizes=binary sample.large_fraction=0.25";
    let mut scenes = ["", GRADED, binary, SPHERES].map(with).to_vec();
    scenes.push(boxed("aqs.pressure=1e-2"));
    for table in tables() {
        for key in table.keys().iter().filter(|key| !key.default.is_empty()) {
            let line = format!("\n{} = ", key.name());
            let is_written = |scene: &Scene| {
                let start = match table.name {
                    "" => 0,
                    name => scene.toml.find(&format!("\n[{name}]\n"))? + 1,
                };
                let own = &scene.toml[start..];
                let end = own.find("\n[").unwrap_or(own.len());
                own[..end].contains(&line).then_some(())
            };
            let found = scenes.iter().find_map(is_written);
            assert!(found.is_some(), "{}", key.path);
        }
    }
}

#[test]
fn scenes_in_boxes_read_back() {
    let without_spectra = "aqs.spectrum=none aqs.until_imaginary=none ";
    let turned = "
        stages=['aqs','shear'] load.pressure=1e-2 shear.velocity=1e-3 shear.strain=0.1
        newtonian.growth_times=none newtonian.frames=none
        newtonian.spectra=none";
    for (first, more) in [
        ("", turned),
        (
            "",
            "aqs.strain_step=none aqs.steps=none aqs.spectrum=none aqs.until_imaginary=none",
        ),
        ("", "seed=2"),
        ("", "dimension=2"),
        ("", "sample.aspect=[1.3,1.1,1]"),
        ("", "dimension=2 sample.aspect=[2,1]"),
        ("", "time.step=0.01"),
        ("", "aqs.spectrum=false aqs.until_imaginary=none"),
        (
            without_spectra,
            "aqs.deformation=simple-shear aqs.pressure=1e-2",
        ),
        (without_spectra, "aqs.deformation=pure-shear"),
        (without_spectra, "aqs.deformation=biaxial aqs.pressure=1e-2"),
        (
            without_spectra,
            "aqs.deformation=compression aqs.pressure_tolerance=1e-3 aqs.steps=none
             aqs.pressures=[1e-3,2e-3]",
        ),
        (
            without_spectra,
            "aqs.deformation=protocol aqs.steps=none aqs.protocol=[{shear_strain=0.01,cycles=2},\
             {stress_xx=1e-2,steps=3},{strain_yy=-0.02,volume_strain=0}]",
        ),
    ] {
        let scene = boxed(&format!("{first}{more}"));
        let again = load(&Source::new("scene.toml", scene.toml.clone()), &[]).unwrap();
        assert_eq!(format!("{again:?}"), format!("{scene:?}"), "{more}");
    }
}

/// Two materials with a law of spheres, and what their pairs have.
const MIXTURE: &str = r#"
    dimension = 3
    material = [
        { name = "a", young_modulus = 1e8, poisson_ratio = 0.2, density = 2500.0 },
        { name = "b", young_modulus = 4e8, poisson_ratio = 0.3, density = 5000.0, fraction = 0.3 },
    ]
    contact.law = "hertz"
    contact.friction = 0.4
    contact.normal_damping = 1e6
    contact.rolling_friction = 0.1
    contact.rolling_stiffness = 1e3
    contact.pair = [{ materials = ["b", "b"], friction = 0.1 }]
    sample = { grains = 4000, radius_min = 8e-4, radius_max = 1e-3, length = 0.016, width = 0.016 }
    load.pressure = 100.0
    shear = { inertial_number = 1e-2, strain = 0.02 }
"#;

/// Every value of `scene.toml` by itself, as an override: it changes neither the scene nor what is
/// written.
#[test]
fn a_default_that_is_written_down_changes_nothing() {
    let mut sources: Vec<(String, Vec<String>)> = Vec::new();
    let default = include_str!("../../../configs/plane-shear-2d.toml");
    let flat = format!("{HOOKE} sample.walls=flat");
    let of_default = [
        "",
        HOOKE,
        MINDLIN,
        GRADED,
        SPHERES,
        "load.control=servo",
        "load.gravity=9.81",
        "sample.boundary=periodic",
        "sample.boundary=periodic load.control=volume",
        &flat,
        BOTH,
    ];
    sources.extend(of_default.map(|sets| (default.into(), overrides(sets))));
    sources.push((MIXTURE.into(), Vec::new()));
    let of_box = include_str!("../../../configs/bonfanti.toml");
    for sets in ["", "aqs.pressure=1e-2"] {
        sources.push((of_box.into(), overrides(sets)));
    }
    for (text, sets) in &sources {
        let scene = |more: Option<String>| {
            let sets: Vec<_> = sets.iter().cloned().chain(more.clone()).collect();
            let found = load(&Source::new("scene.toml", text), &sets);
            found.unwrap_or_else(|e| panic!("{sets:?}: {e}"))
        };
        let alone = scene(None);
        let written: toml::Table = toml::from_str(&alone.toml).unwrap();
        let mut keys = 0;
        for table in tables() {
            for key in table.keys() {
                let written = match table.name {
                    "" => Some(&written),
                    name => written.get(name).and_then(toml::Value::as_table),
                };
                let value = written.and_then(|table| table.get(key.name()));
                let is_list = |value: &&toml::Value| value.is_array();
                let Some(value) = value.filter(|value| !is_list(value)) else {
                    continue;
                };
                let with = scene(Some(format!("{}={value}", key.path)));
                assert_eq!(format!("{with:?}"), format!("{alone:?}"), "{}", key.path);
                keys += 1;
            }
        }
        assert!(keys > 20, "{keys} keys of {sets:?}");
    }
}

/// The stiffnesses of rolling and twisting are not written, so that a branch with another modulus
/// has another one. Written down they change nothing either, nor does the time step.
#[test]
fn the_stiffness_of_rolling_may_be_written_down() {
    for sets in ["", HOOKE] {
        let scene = with(sets);
        let stiffness = scene.law.rolling_stiffness().expect("has one");
        let again = with(&format!("{sets} contact.rolling_stiffness={stiffness:?}"));
        assert_eq!(again.contact, scene.contact);
        assert_eq!(again.time_step, scene.time_step);
    }
    let spheres = format!(
        "{SPHERES} contact.rolling_friction=0.1 contact.rolling_stiffness=1e3
        contact.twisting_friction=0.1"
    )
    .replace("contact.rolling_friction=none", "");
    let scene = with(&spheres);
    let again = with(&format!("{spheres} contact.twisting_stiffness=1e3"));
    assert_eq!(
        (again.contact, again.time_step),
        (scene.contact, scene.time_step)
    );
}

/// Keys whose default follows from others: each is written in the scene of some kind, but for
/// those that are left out for a reason.
#[test]
fn what_follows_from_other_keys_is_written() {
    // What follows would not follow a change of what it comes from.
    const FOLLOWS: [&str; 3] = [
        "time.step",
        "contact.rolling_stiffness",
        "contact.twisting_stiffness",
    ];
    // Without them nothing is said: other keys, files or whoever runs the scene decide.
    const NOTHING: [&str; 15] = [
        "author",
        "bookkeeping.skin",
        "bookkeeping.band_grains",
        "load.solid_fraction",
        "load.wall_mass",
        "material.fraction",
        "material.atom_type",
        "sample.radii_weights",
        "sample.aspect",
        "sample.replicate",
        "sample.walls",
        "sample.wall_material",
        "sample.large_material",
        "aqs.steps",
        "output.columns",
    ];
    let mut scenes = [
        "",
        GRADED,
        SPHERES,
        HOOKE,
        MINDLIN,
        BOTH,
        "load.control=servo",
    ]
    .map(with)
    .to_vec();
    let of_flow = "sample.boundary=periodic load.control=servo";
    scenes.push(with(of_flow));
    scenes.push(boxed("aqs.pressure=1e-2"));
    let tsuji = "contact.law=hertz-tsuji contact.normal_damping=none contact.restitution=0.5";
    for sets in ["", tsuji] {
        let mixture = Source::new("mixture.toml", MIXTURE);
        scenes.push(load(&mixture, &overrides(sets)).unwrap());
    }
    for table in tables() {
        for key in table.keys() {
            let follows = key.default.is_empty() && !["", "none"].contains(&key.otherwise);
            if !follows || FOLLOWS.contains(&key.path) || NOTHING.contains(&key.path) {
                continue;
            }
            let is_written = |scene: &Scene| {
                let written: toml::Table = toml::from_str(&scene.toml).unwrap();
                match table.name {
                    "" => written.contains_key(key.name()),
                    name => written
                        .get(name)
                        .is_some_and(|table| table.get(key.name()).is_some()),
                }
            };
            assert!(scenes.iter().any(is_written), "{}", key.path);
        }
    }
}
