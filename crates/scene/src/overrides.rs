//! `--set key.path=value`: values from the command line replace those of the file.

use std::borrow::Cow;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::keys::{resolve, unknown_in_list};
use super::source::Input;
use super::sweep::takes_sweep_away;
use super::words::TAKE_AWAY;
use gshear_dem::failure::Result;

/// Puts every override into the tree, later ones over earlier ones.
pub(super) fn apply<'a>(tree: &mut DeTable<'a>, input: &Input<'a>) -> Result<()> {
    for (k, set) in input.overrides.iter().enumerate() {
        if takes_sweep_away(set) {
            continue;
        }
        let start = input.override_offset(k);
        let span = start..start + set.len();
        let Some((path, value)) = set.split_once('=') else {
            let what = "expected key.path=value, such as --set sample.grains=2000";
            return Err(input.failure(start, "", what));
        };
        let (path, value) = (path.trim(), value.trim());
        let key = resolve(path).map_err(|what| input.failure(start, "", &what))?;
        let target = match key.table() {
            "" => &mut *tree,
            name => {
                let entry = tree
                    .entry(Spanned::new(span.clone(), Cow::Borrowed(name)))
                    .or_insert(Spanned::new(span.clone(), DeValue::Table(DeTable::new())));
                match entry.get_mut() {
                    DeValue::Table(inner) => inner,
                    other => {
                        let what = match other {
                            DeValue::Array(_) => "several tables, which no --set reaches, in",
                            _ => "not a table in",
                        };
                        let file = input.source.name();
                        let what = format!("{name} is {what} {file}; change it there");
                        return Err(input.failure(start, "", &what));
                    }
                }
            }
        };
        if value == TAKE_AWAY {
            target.remove(key.name());
            continue;
        }
        let value = parse(value).map_err(|what| input.failure(start, "", &what))?;
        let mut problems = Vec::new();
        unknown_in_list(key, &value, &mut problems);
        if let Some(problem) = problems.first() {
            return Err(input.failure(start, "", &problem.what));
        }
        target.insert(
            Spanned::new(span.clone(), Cow::Borrowed(key.name())),
            Spanned::new(span, value),
        );
    }
    Ok(())
}

/// A TOML value, or a bare word taken as a string, since the shell eats quotes.
fn parse(value: &str) -> Result<DeValue<'_>, String> {
    if value.is_empty() {
        return Err("no value after `=`".into());
    }
    match DeValue::parse(value) {
        Ok(parsed) => Ok(parsed.into_inner()),
        Err(_) if !value.contains(['"', '\'', '[', ']', '{', '}', '\n']) => {
            Ok(DeValue::String(Cow::Borrowed(value)))
        }
        Err(e) => Err(format!("no TOML value: {}", e.message())),
    }
}

#[cfg(test)]
mod tests {
    use crate::testing::{cases, embedded};
    use crate::{Motion, Source, WallSpeed, load};

    fn message(set: &str) -> String {
        let refused = load(&Source::embedded(), &[set.into()]);
        refused.unwrap_err().to_string()
    }

    /// The last of two wins.
    #[test]
    fn values_replace_those_of_the_file() {
        let sets = [
            "sample.length = 24e-6",
            "title=Half as many",
            "seed=7",
            "seed=8",
        ];
        let scene = load(&Source::embedded(), &sets.map(Into::into)).unwrap();
        assert_eq!(scene.sample.length, 24e-6);
        assert_eq!((&scene.title[..], scene.seed), ("Half as many", 8));
    }

    #[test]
    fn none_takes_a_key_away() {
        let scene = embedded("shear.inertial_number=none shear.velocity=1e-3").unwrap();
        let (drive, ramp, strain) = (WallSpeed::Velocity(1e-3), 0.0, 0.1);
        let motion = &scene.plane_shear("the scene").unwrap().shear.motion;
        assert_eq!(
            *motion,
            Motion::Strain {
                drive,
                ramp,
                strain
            }
        );
    }

    #[test]
    fn a_sweep_is_taken_away() {
        let scene = include_str!("../../../configs/plane-shear-2d.toml");
        let source = Source::new("sweep.toml", format!("{scene}\n[sweep]\nseed = [2, 3]\n"));
        let seed =
            |set: &str| load(&source, &[set.into(), "seed=7".into()]).map(|scene| scene.seed);
        assert_eq!(seed("sweep=none").unwrap(), 7);
        assert_eq!(seed(" sweep = none").unwrap(), 7);
        assert!(
            seed("title=x")
                .unwrap_err()
                .to_string()
                .contains("makes 2 runs")
        );
    }

    #[test]
    fn bad_overrides() {
        for [set, expected] in cases(
            r#"
            sample.grains | expected key.path=value, such as --set sample.grains=2000
            sample.grains= | no value after `=`
            extends=base.toml | only a file extends another one; write extends at its top
            sweep.seed=[1, 2] | only a file has a sweep; write [sweep] and its lists into it
            load={pressure=1} | [load] is a table; set its keys one by one, such as load.stiffness_number=…
            sample.radius_min=-1 | must be greater than 0, found -1.0
            sample.radius_min=small | expected a number, found the string "small"
            sample.radius_min=[1, 2] | expected a number, found an array
            sample.grains=1e3 | expected an integer without decimal point or exponent, found the number 1000.0
            title=3 | expected a string in quotes, found the integer 3
            time.force=yes | expected true or false, found the string "yes"
            shear.protocol=[{velocty="1 m/s", time=1}] | part 1: unknown key velocty; did you mean velocity? A part knows velocity, ramp, distance, time, cycles, strain_amplitude, frequency, shear_stress, shear_stress_end, shear_stress_amplitude, pressure, pressure_end, pressure_amplitude, pressure_frequency, wall_velocity, mean_pressure, mean_pressure_end, stress_xx, stress_xx_end, strain_xx, stress_yy, stress_yy_end, strain_yy, bottom_amplitude, bottom_frequency, bottom_amplitude_x, bottom_frequency_x, bottom_phase_x, until_stress_ratio_below, until_stress_ratio_above, until_drop, until_slip_rate_below, until_slip_rate_above, until_slip, until_checks
            shear.velocity=1e-3 | contradicts shear.inertial_number (line 33); give exactly one of inertial_number, velocity; --set shear.inertial_number=none takes that one away
            "#,
        ) {
            assert_eq!(message(&set), format!("--set {set}: {expected}"));
        }
        let expected = "embedded default scene:20: [sample] lacks grains: the number of grains, such as grains = 1000";
        assert_eq!(message("sample.grains=none"), expected);
        assert!(message("title=\"open").starts_with("--set title=\"open: no TOML value: "));
    }

    #[test]
    fn two_overrides_can_contradict_each_other() {
        let refused = embedded("load.pressure=1e4 load.stiffness_number=none load.normal_force=1");
        assert_eq!(
            refused.unwrap_err().to_string(),
            "--set load.normal_force=1: contradicts load.pressure (--set load.pressure=1e4); give exactly one of stiffness_number, pressure, normal_force; --set load.pressure=none takes that one away"
        );
    }
}
