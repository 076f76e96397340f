//! The checked scene as TOML again, with every default filled in: what the user chose stays as
//! chosen, what follows from it stands in comments, so that reading it gives the same scene to the
//! last bit.

use crate::checker::Checker;
use crate::derived::mean_attraction;
use crate::keys::tables;
use crate::materials::{MaterialKeys, OTHERS};
use crate::scene::Scene;
use crate::value::Value;

/// The configuration of a scene: the values that the checks left, in the order of the declarations.
pub(crate) fn toml(c: &Checker<'_>, scene: &Scene) -> String {
    let mut text = String::from("# What is run: every default filled in. What follows from it:\n");
    for (symbol, x, unit) in derived(scene) {
        text += format!("# {symbol} = {x:?} {unit}").trim_end();
        text.push('\n');
    }
    for table in tables() {
        let lines = table.keys().into_iter().filter_map(|key| {
            let value = c.written(key)?.toml();
            Some(format!("{} = {value}\n", key.name()))
        });
        let lines: String = lines.collect();
        let others = match c.written(&OTHERS) {
            Some(Value::Tables(others)) if table.name == MaterialKeys::TABLE.name => &others[..],
            _ => &[],
        };
        if !others.is_empty() {
            text += &format!("\n[[{}]]\n", table.name);
        } else if !lines.is_empty() && !table.name.is_empty() {
            text += &format!("\n[{}]\n", table.name);
        }
        text += &lines;
        for entries in others {
            text += &format!("\n[[{}]]\n", table.name);
            for (name, value) in entries {
                text += &format!("{name} = {}\n", value.toml());
            }
        }
    }
    text
}

/// What follows from the keys: symbol, value, unit.
fn derived(scene: &Scene) -> Vec<(&'static str, f64, &'static str)> {
    let (step, limit) = (scene.time_step.step, scene.time_step.limit);
    let Some(walls) = scene.shear() else {
        return vec![
            ("time step", step, ""),
            ("its limit of stability", limit, ""),
        ];
    };
    let force_unit = scene.sample.by_dimension("N/m", "N");
    let stiffness_unit = scene.sample.by_dimension("Pa", "N/m");
    let load = &walls.load;
    let mut derived = scene.law.derived();
    let attraction = mean_attraction(&scene.contact, &scene.sample);
    if attraction > 0.0 {
        let number = attraction / (load.pressure * scene.sample.mean_section());
        derived.push(("attraction F_c of mean grains", attraction, force_unit));
        derived.push(("cohesion number F_c/(P d)", number, ""));
    }
    derived.push(("pressure P", load.pressure, "Pa"));
    // After strain steps it is by a cell that is not known yet.
    if scene.stages.first_shear().is_some() {
        derived.push(("normal force N", load.normal_force, force_unit));
    }
    if let Some(spring) = walls.shear.spring {
        let number = spring * scene.sample.mean_diameter / load.normal_force;
        derived.push(("stiffness of the spring k", spring, stiffness_unit));
        derived.push(("spring number k d/N", number, ""));
    }
    derived.push(("stiffness number kappa", load.stiffness_number, ""));
    derived.push(("time step", step, "s"));
    derived.push(("stability limit of the time step", limit, "s"));
    derived
}
