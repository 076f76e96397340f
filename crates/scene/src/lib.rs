//! Scenes of gshear-mpi: the configuration, checked and with every default filled in, and what
//! follows from it: sweeps, packings, schedules, the time step.
//!
//! [`load`] reads a [`Scene`]: a sample, what bounds it, and what is done to it ([`Stages`]). Every
//! message names file and line, or the `--set` it comes from.
//!
//! ```
//! use gshear_scene::{Source, load};
//!
//! let text = "
//!     material = { young_modulus = 1e9, poisson_ratio = 0.2, density = 2500 }
//!     contact = { friction = 0.7, damping_ratio = 0.1 }
//!     sample = { grains = 1000, radius_min = 0.5e-6, radius_max = 1e-6, length = 48e-6 }
//!     load.stiffness_number = 1e4
//!     shear = { inertial_number = 2e-4, strain = 0.1 }
//! ";
//! let source = Source::new("scene.toml", text);
//! let scene = load(&source, &["seed=2".into()])?;
//! let dt = scene.time_step.step;
//! assert!(dt > 1e-10 && dt <= scene.time_step.limit);
//!
//! let refused = load(&source, &["sample.grains=0".into()]).unwrap_err();
//! assert_eq!(
//!     refused.to_string(),
//!     "--set sample.grains=0: must lie in 1 … 4294967295, found 0"
//! );
//! # Ok::<(), gshear_dem::failure::Failure>(())
//! ```
//!
//! A table of the configuration has a file: the declarations of its keys (name, meaning, unit,
//! range, default), their checks and the checked type. The keys of the contact laws are in
//! [`gshear_dem::laws::keys`]. Reading, messages, `scene.toml`, the table of
//! docs/reference/keys.md and the JSON schema ([`mod@reference`]) use the declarations. The way
//! of a configuration:
//!
//! | module | does |
//! | --- | --- |
//! | `source` | reads files, names the places of the text and of `--set` |
//! | `merge` | merges a file with those that it `extends` |
//! | `overrides`, `units` | applies `--set`, converts values with units |
//! | `table`, `keys` | what is declared of a table; all tables, unknown keys, values of the tree |
//! | `general`, `materials`, `law`, `sample`, `load`, `time`, `walls`, `protocol`, `output`, `quasi_static` | the tables |
//! | `stages` | what is done to the sample, and in which order |
//! | `check`, `checker` | checks the tables in their order; values, defaults and problems |
//! | `extent` | refuses a run that would not end or not fit on a disk |
//! | `write` | writes the values that the checks left as TOML again |
//! | [`templates`] | scenes to start from |
//! | [`holes`] | holes in walls of grains, and what closes them |
//! | [`identity`] | the hash of all that decides the trajectory; changes of a scene at a resume |

mod check;
mod checker;
pub mod derived;
mod extent;
mod general;
mod grains;
pub mod holes;
pub mod identity;
pub mod insertion;
mod keys;
pub mod lammps_data;
mod lammps_dump;
mod lateral;
mod law;
mod load;
mod materials;
mod merge;
mod observable_keys;
mod observables;
mod output;
mod overrides;
pub mod packing;
mod part_keys;
mod part_values;
mod protocol;
mod quasi_static;
pub mod reference;
mod sample;
mod scene;
pub mod schedule;
mod source;
mod stages;
mod strain_protocol;
pub mod sweep;
mod table;
pub mod templates;
#[cfg(test)]
mod testing;
mod time;
mod units;
pub mod unlikely;
mod value;
mod walls;
mod words;
mod write;
#[cfg(test)]
mod write_tests;

use toml::de::DeTable;

use gshear_dem::failure::Result;

pub use general::{Bookkeeping, SIMD_NAMES};
pub use grains::{Sample, Sizes};
pub use gshear_dem::dimension::Dimensions;
pub use gshear_dem::laws::keys::Change;
pub use gshear_dem::laws::{Contact, Law};
pub use gshear_dem::protocol::Part;
pub use keys::key;
pub use load::{Control, Load};
pub use materials::{Materials, atom_type};
pub use output::{Analysis, Output};
pub use protocol::{Motion, Shear, WallSpeed};
pub use quasi_static::{Aqs, Deformation, Method, Newtonian, QuasiStatic, Relax};
pub use sample::{
    Arrangement, ContactFile, Origin, PackingFile, PackingPaths, Placement, ReadPacking, Walls,
};
pub use scene::Scene;
pub use source::Source;
pub use stages::{RunStage, Stages};
pub use strain_protocol::{StrainPart, StressControl};
pub use time::TimeStep;
pub use walls::{Pack, PlaneShear};

use checker::Checker;
use packing::{GrainLimit, Packing};
use source::Input;
use stages::GivenStages;

/// Reads the configuration of a run, replaces values by the overrides (`key.path=value`, as `--set`
/// gives them), checks it and derives the rest.
///
/// An override's value is TOML, or a bare word taken as a string; `none` takes a key away.
///
/// # Errors
/// `Failure::Input` with the first problem: where it is, what is wrong, and what would be right.
pub fn load(source: &Source, overrides: &[String]) -> Result<Scene> {
    load_with(source, overrides, &mut |paths, arrangement| {
        let packing = Packing::read(paths.grains, arrangement)?;
        Ok(packing.with_contacts(paths.contacts)?.file)
    })
}

/// [`load`], with `packing` called for the file of a packing, if the scene has one.
///
/// # Errors
/// As [`load`].
pub fn load_with(source: &Source, overrides: &[String], packing: ReadPacking<'_>) -> Result<Scene> {
    load_within(source, overrides, &GrainLimit::default(), packing)
}

/// [`load_with`], refusing more inserted grains than the limit. `packing` sees to those of a file.
///
/// # Errors
/// As [`load`].
pub fn load_within(
    source: &Source,
    overrides: &[String],
    limit: &GrainLimit,
    packing: ReadPacking<'_>,
) -> Result<Scene> {
    let input = Input { source, overrides };
    let mut tree = merge::tree(&input)?;
    let tables = keys::places(&tree);
    overrides::apply(&mut tree, &input)?;
    let numbers = units::numbers(&mut tree, &input)?;
    units::put(&mut tree, &numbers);

    let stages = GivenStages::of(&tree);
    if !stages.shears {
        keys::refuse_tables_of_shear(&tree, &input)?;
    }
    let given = keys::read(tree, &input)?;
    check::scene(Checker::new(input, tables, given), stages, limit, packing)
}

/// Whether a text sets a key, such as `shear.protocol`; not if it is no TOML.
pub fn has_key(text: &str, path: &str) -> bool {
    let Ok(tree) = DeTable::parse(text) else {
        return false;
    };
    let (above, name) = path.rsplit_once('.').unwrap_or(("", path));
    let mut tables = above.split('.').filter(|table| !table.is_empty());
    let table = tables.try_fold(tree.get_ref(), |table, name| {
        table.get(name)?.get_ref().as_table()
    });
    table.is_some_and(|table| table.contains_key(name))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use gshear_dem::system::ListSettings;

    use super::testing::embedded;
    use super::*;

    fn config(name: &str) -> Source {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        Source::read(configs.join(name)).unwrap()
    }

    fn shipped(name: &str) -> Scene {
        load(&config(name), &[]).unwrap()
    }

    fn walls(scene: &Scene) -> &PlaneShear {
        scene.plane_shear("the scene").unwrap()
    }

    fn motion(scene: &Scene) -> (WallSpeed, f64) {
        match walls(scene).shear.motion {
            Motion::Strain { drive, strain, .. } => (drive, strain),
            Motion::Protocol(_) => panic!("a protocol"),
        }
    }

    #[test]
    fn the_embedded_scene_is_the_shipped_one() {
        let scene = embedded("").unwrap();
        assert_eq!(scene, shipped("plane-shear-2d.toml"));
        assert_eq!(motion(&scene), (WallSpeed::InertialNumber(2e-4), 0.1));
        assert_eq!(walls(&scene).output.progress_lines, 20);
        assert_eq!(scene.bookkeeping.list.skin, None);
    }

    /// The numbers of the paper, and samples about as high as they are long.
    #[test]
    fn the_scenes_of_the_paper() {
        let small = shipped("lee-hurley-small.toml");
        let large = shipped("lee-hurley-large.toml");
        for (scene, frame, start) in [(&small, 7.2e-7, 0.022), (&large, 1.8e-6, 0.054)] {
            let (drive, strain) = motion(scene);
            assert_eq!(drive, WallSpeed::InertialNumber(4e-6));
            assert_eq!(walls(scene).load.stiffness_number, 1e4);
            assert!((13e3..14e3).contains(&walls(scene).load.pressure));
            let mut given = scene.law.given().iter();
            let alpha = given.find(|(key, _)| key.path == "contact.damping_ratio");
            assert_eq!(alpha.unwrap().1, 0.1);
            assert_eq!(walls(scene).output.frame_strain, 0.0);
            assert!(walls(scene).analysis.scalars);
            let analysis = walls(scene).analysis;
            assert_eq!([analysis.strain, analysis.start], [frame, start]);
            let frames = (strain - start) / frame;
            assert!((frames - 130_000.0).abs() < 1.0, "{frames}");
            let ratio = derived::packed_height(&scene.sample) / scene.sample.length;
            assert!((0.9..1.1).contains(&ratio), "{ratio}");
        }
        assert_eq!(small.contact, large.contact);
        assert_eq!(small.law, large.law);
        // P follows from κ and E* alone.
        let difference = walls(&small).load.pressure - walls(&large).load.pressure;
        assert!(difference.abs() < 1e-12 * walls(&small).load.pressure);
    }

    /// Their sweep has the small scene among its runs.
    #[test]
    fn the_frictions_of_the_paper() {
        let source = config("lee-hurley-frictions.toml");
        let members = sweep::members(&source).unwrap().unwrap();
        assert_eq!(members.len(), 12);
        let mut set = members[9].set.clone();
        set.push("title=Lee & Hurley, small sample".into());
        let ours = load(&source.of_member(), &set).unwrap();
        assert_eq!(ours, shipped("lee-hurley-small.toml"));
    }

    /// A scene of the least keys has the declared defaults, and besides only what is not constant.
    #[test]
    fn defaults() {
        let text = "
            material = { young_modulus = 1e9, poisson_ratio = 0.2, density = 2500.0 }
            contact = { friction = 0.7, damping_ratio = 0.1 }
            sample = { grains = 1000, radius_min = 0.5e-6, radius_max = 1e-6, length = 48e-6 }
            load.stiffness_number = 10000.0
            shear = { velocity = 1e-4, strain = 0.1 }
        ";
        let scene = load(&Source::new("least.toml", text), &[]).unwrap();
        let given = identity::values(text);
        let mut found = identity::values(&scene.toml);
        found.retain(|path, value| given.get(path) != Some(value));
        let found: Vec<_> = found
            .iter()
            .map(|(path, x)| format!("{path} = {x}"))
            .collect();
        assert_eq!(
            found,
            [
                "analysis.start = 0.0",
                "analysis.strain = 0.0001",
                "contact.law = \"lee-hurley\"",
                "pack.skip = false",
                "title = \"Plane shear\"",
            ]
        );
        let walls = walls(&scene);
        assert_eq!(walls.pack.max_steps, 5_000_000);
        assert!(walls.output.energy);
        assert_eq!(scene.bookkeeping.list, ListSettings::default());
    }

    #[test]
    fn keys_are_found_in_any_form() {
        for text in [
            "[shear]\nprotocol = []",
            "shear.protocol = []",
            "shear = { protocol = [] }",
        ] {
            assert!(has_key(text, "shear.protocol"), "{text}");
        }
        for text in [
            "",
            "[shear]",
            "shear = 1",
            "protocol = 1",
            "[shear.protocol",
        ] {
            assert!(!has_key(text, "shear.protocol"), "{text}");
        }
        assert!(has_key("seed = 1", "seed") && !has_key("seed = 1", "seed.of"));
    }

    #[test]
    fn load_is_given_in_three_ways() {
        let by = |sets: &str| walls(&embedded(sets).unwrap()).load;
        let reference = by("");
        let p = format!("load.pressure={:?}", reference.pressure);
        let n = format!("load.normal_force={:?}", reference.normal_force);
        for set in [p, n] {
            let load = by(&format!("load.stiffness_number=none {set}"));
            assert!((load.stiffness_number / 1e4 - 1.0).abs() < 1e-14);
            assert!((load.pressure / reference.pressure - 1.0).abs() < 1e-15);
            assert!((load.normal_force / reference.normal_force - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn a_forced_step_is_taken_as_it_is() {
        let scene = embedded("time.step=1e-6 time.force=true").unwrap();
        let time_step = scene.time_step;
        assert_eq!(time_step.step, 1e-6);
        assert!(time_step.limit < 1e-6);
    }
}
