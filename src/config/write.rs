//! The checked scene as TOML again, with every default filled in: what the user chose stays as chosen, what follows from it
//! stands in comments, so that reading it gives the same scene to the last bit.

use std::fmt::Write;

use super::raw::show;
use super::scene::{Drive, Law, Origin, Scene, Walls};

/// How the damping was given.
#[derive(Debug, Clone, Copy)]
pub(super) enum DampingChoice {
    Ratio(f64),
    Restitution(f64),
}

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

    fn table(&mut self, name: &str) {
        self.line(&format!("\n[{name}]"));
    }

    fn number(&mut self, key: &str, x: f64) {
        self.line(&format!("{key} = {}", show(x)));
    }

    fn whole(&mut self, key: &str, n: u64) {
        self.line(&format!("{key} = {n}"));
    }

    fn text(&mut self, key: &str, s: &str) {
        self.line(&format!("{key} = {}", toml::Value::String(s.into())));
    }
}

/// The configuration of a scene; `force` is `time.force`.
pub(super) fn toml(scene: &Scene, damping: DampingChoice, load: LoadChoice, force: bool) -> String {
    let mut t = Lines(String::new());
    t.line("# What is run: every default filled in. What follows from it:");
    t.0.push_str(&derived_comments(scene));
    t.text("title", &scene.title);
    t.whole("seed", scene.seed);

    t.table("material");
    if let Law::LeeHurley(material) = scene.law {
        t.number("young_modulus", material.young_modulus);
        t.number("poisson_ratio", material.poisson_ratio);
    }
    t.number("density", scene.law.density());

    t.table("contact");
    t.text("law", scene.law.name());
    if let Law::Hooke(springs) = scene.law {
        t.number("normal_stiffness", springs.normal_stiffness);
        t.number("tangential_stiffness", springs.tangential_stiffness);
    }
    t.number("friction", scene.contact.friction);
    t.number("rolling_friction", scene.contact.rolling_friction);
    match damping {
        DampingChoice::Ratio(alpha) => t.number("damping_ratio", alpha),
        DampingChoice::Restitution(e) => t.number("restitution", e),
    }
    t.number("rolling_damping_ratio", scene.contact.rolling_damping_ratio);

    t.table("sample");
    if let Origin::Packing { file, walls } = &scene.origin {
        t.text("packing", &file.path.display().to_string());
        let name = Walls::NAMES.iter().find(|(_, known)| known == walls);
        t.text("walls", name.map_or("", |(name, _)| name));
    }
    t.whole("grains", scene.sample.grains.into());
    t.number("radius_min", scene.sample.radius_min);
    t.number("radius_max", scene.sample.radius_max);
    t.number("length", scene.sample.length);

    t.table("load");
    match load {
        LoadChoice::StiffnessNumber(kappa) => t.number("stiffness_number", kappa),
        LoadChoice::Pressure(p) => t.number("pressure", p),
        LoadChoice::NormalForce(n) => t.number("normal_force", n),
    }

    t.table("time");
    if scene.time_step.given {
        t.number("step", scene.time_step.step);
    }
    t.line(&format!("force = {force}"));

    t.table("pack");
    t.line(&format!("skip = {}", scene.pack.skip));
    if !scene.pack.skip {
        t.number("friction", scene.pack.friction);
        t.number("tolerance", scene.pack.tolerance);
        t.whole("max_steps", scene.pack.max_steps);
    }

    t.table("shear");
    match scene.shear.drive {
        Drive::InertialNumber(i) => t.number("inertial_number", i),
        Drive::Velocity(v) => t.number("velocity", v),
    }
    t.number("strain", scene.shear.strain);

    t.table("output");
    t.number("frame_strain", scene.output.frame_strain);
    t.number("frame_start", scene.output.frame_start);
    t.number("series_strain", scene.output.series_strain);
    t.number("checkpoint_strain", scene.output.checkpoint_strain);
    t.whole("progress_lines", scene.output.progress_lines);
    t.line(&format!("energy = {}", scene.output.energy));

    t.table("bookkeeping");
    if let Some(skin) = scene.bookkeeping.skin {
        t.number("skin", skin);
    }
    t.whole("rebuild_every", scene.bookkeeping.rebuild_every);
    t.text("simd", scene.bookkeeping.simd);
    t.0
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
    if let Law::LeeHurley(material) = scene.law {
        comment("effective modulus E*", material.effective_modulus(), "Pa");
    }
    comment("damping ratio alpha", scene.contact.damping_ratio, "");
    comment("pressure P", scene.load.pressure, "Pa");
    comment("normal force N", scene.load.normal_force, "N/m");
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
    use crate::config::{Scene, Source, load};

    /// The default scene with linear springs.
    const HOOKE: &[&str] = &[
        "contact.law=hooke",
        "material.young_modulus=none",
        "material.poisson_ratio=none",
        "contact.normal_stiffness=1e8",
    ];

    fn with(sets: &[&str]) -> Scene {
        let sets: Vec<String> = sets.iter().map(|s| s.to_string()).collect();
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
            &["time.step=1e-6", "time.force=true"],
            &["bookkeeping.skin=0.3", "bookkeeping.rebuild_every=17"],
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
        let of_lee_hurley = ["young_modulus", "poisson_ratio"];
        let of_hooke = ["normal_stiffness", "tangential_stiffness"];
        for (law, other) in [(&[][..], of_hooke), (HOOKE, of_lee_hurley)] {
            let sets = [&["time.step=1e-10", "bookkeeping.skin=0.3"], law].concat();
            let toml = with(&sets).toml;
            for (_, keys) in crate::config::raw::TABLES {
                for key in *keys {
                    let alternative = [
                        "restitution",
                        "pressure",
                        "normal_force",
                        "velocity",
                        "packing",
                        "walls",
                    ]
                    .contains(key);
                    assert_eq!(
                        toml.contains(&format!("\n{key} = ")),
                        !alternative && !other.contains(key),
                        "{key} in {toml}"
                    );
                }
            }
        }
    }
}
