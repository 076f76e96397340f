//! The periodic box: `[box]`, `[relax]`, `[aqs]` and `[newtonian]`.

use super::sample;
use crate::checker::Checker;
use crate::kind::Numbers;
use crate::raw::{self, Raw};
use crate::scene::{
    Aqs, Deformation, DeformationName, Dimensions, Method, Newtonian, PeriodicBox, Placement,
    Relax, Sample,
};
use gshear_dem::contact::portable_exp;
use gshear_dem::failure::Failure;

/// Of whose dense matrix all eigenvalues are found after every strain step.
const MOST_UNKNOWNS: u64 = 6000;

/// As `super::scene`.
pub(super) fn check(
    c: &mut Checker<'_>,
    dimension: Dimensions,
    (raw, seed): (&Raw, u64),
) -> Result<(Sample, PeriodicBox), Failure> {
    let sizes = sample::check_boxed(c, &raw.sample);
    let deformation = check_deformation(c, raw);
    let name = c.choice_or_default(&raw.sample.placement);
    let placement = Placement::NAMES.iter().find(|(of, _)| Some(*of) == name);
    let periodic = PeriodicBox {
        sizes,
        placement: placement.map_or(Placement::Lattice, |(_, placement)| *placement),
        solid_fraction: c.required(&raw.r#box.solid_fraction),
        pressure: check_pressure(c, &raw.r#box, &deformation),
        pressure_tolerance: c.number_or_default(&raw.r#box.pressure_tolerance),
        relax: check_relax(c, &raw.relax),
        aqs: check_aqs(c, &raw.aqs, &deformation),
        deformation,
        newtonian: check_newtonian(c, &raw.newtonian),
    };
    check_output(c, &raw.output);
    c.settle()?;

    let sample = sample::derive_boxed(c, dimension, (&raw.sample, seed), &periodic)?;
    let per_grain = match dimension {
        Dimensions::Two => 3,
        Dimensions::Three => 6,
    };
    if periodic.aqs.spectrum && u64::from(sample.grains) * per_grain > MOST_UNKNOWNS {
        return Err(c.out_of_range(&format!(
            "aqs.spectrum finds all eigenvalues at once, of up to {} grains in this dimension; leave it out, and take gshear-reduce spectrum \
             of checkpoints or frames",
            MOST_UNKNOWNS / per_grain
        )));
    }
    let least = sample.least_box_length();
    let shortest = shortest(&sample, &periodic);
    if shortest < least {
        return Err(c.out_of_range(&format!(
            "the box would become {shortest:.3e} long, so that grains would touch their own images; give fewer strain steps or more grains, for a length of at least {least:.3e}"
        )));
    }
    Ok((sample, periodic))
}

/// The least length of the box, as far as it follows from the number of strain steps.
fn shortest(sample: &Sample, periodic: &PeriodicBox) -> f64 {
    let strain = periodic.aqs.strain_step * periodic.aqs.steps as f64;
    let shrinks = match periodic.deformation {
        Deformation::PureShear => 0.5 * strain,
        Deformation::Biaxial => strain,
        Deformation::SimpleShear | Deformation::Compression(_) => 0.0,
    };
    sample.length * portable_exp(-shrinks)
}

/// What a strain step does, with the pressures of a compression.
fn check_deformation(c: &mut Checker<'_>, raw: &Raw) -> Deformation {
    let name = c.choice_or_default(&raw.r#box.deformation);
    let known = Deformation::NAMES.iter().find(|(of, _)| Some(*of) == name);
    let pressures = &raw.aqs.pressures;
    let deformation = match known.map(|(_, of)| *of) {
        Some(DeformationName::Compression) => {
            let Some(Numbers(given)) = pressures.value() else {
                c.lacks(pressures.declared.table(), &pressures.declared.lacking());
                return Deformation::Compression(Vec::new());
            };
            let hold = |p: &f64| p.is_finite() && pressures.declared.range.hold(*p);
            if given.is_empty() || !given.iter().all(hold) {
                c.refuse(
                    pressures,
                    "must hold one pressure or more, each greater than 0",
                );
            }
            return Deformation::Compression(given.clone());
        }
        Some(DeformationName::PureShear) => Deformation::PureShear,
        Some(DeformationName::Biaxial) => Deformation::Biaxial,
        Some(DeformationName::SimpleShear) | None => Deformation::SimpleShear,
    };
    let why = "applies to box.deformation = \"compression\"";
    c.useless(pressures, why);
    deformation
}

/// The pressure of the packing before the first strain step.
fn check_pressure(
    c: &mut Checker<'_>,
    size: &raw::BoxTable,
    deformation: &Deformation,
) -> Option<f64> {
    match deformation {
        Deformation::Biaxial => Some(c.required(&size.pressure)),
        Deformation::Compression(_) => {
            c.useless(
                &size.pressure,
                "is the first of aqs.pressures in a compression",
            );
            None
        }
        Deformation::SimpleShear | Deformation::PureShear => {
            if !size.pressure.is_given() {
                c.useless(
                    &size.pressure_tolerance,
                    "applies to a box at a pressure, and there is no box.pressure",
                );
            }
            c.number(&size.pressure)
        }
    }
}

/// The intervals of output of a box are those of `[aqs]` and `[newtonian]`.
fn check_output(c: &mut Checker<'_>, output: &raw::Output) {
    let why = "applies to scenes with walls only; a [box] has aqs.frame_every, newtonian.frames and newtonian.rows";
    c.useless(&output.frame_strain, why);
    c.useless(&output.frame_start, why);
    c.useless(&output.series_strain, why);
    c.useless(&output.checkpoint_strain, why);
    c.useless(&output.frame_rows, why);
    c.useless(&output.series_rows, why);
    c.useless(&output.progress_lines, why);
    c.useless(&output.energy, why);
}

fn check_relax(c: &mut Checker<'_>, relax: &raw::Relax) -> Relax {
    let name = c.choice_or_default(&relax.method);
    let method = Method::NAMES.iter().find(|(known, _)| Some(*known) == name);
    Relax {
        method: method.map_or(Method::Newton, |(_, method)| *method),
        tolerance: c.required(&relax.tolerance),
        drag: c.required(&relax.drag),
        max_steps: c.count(&relax.max_steps),
    }
}

fn check_aqs(c: &mut Checker<'_>, aqs: &raw::Aqs, deformation: &Deformation) -> Aqs {
    let spectrum = c.flag_or_default(&aqs.spectrum);
    if !spectrum {
        let why = "applies to the eigenvalues, which need aqs.spectrum = true";
        c.useless(&aqs.birth_precision, why);
        c.useless(&aqs.until_imaginary, why);
    }
    if spectrum && *deformation != Deformation::SimpleShear {
        c.refuse(
            &aqs.spectrum,
            "applies to box.deformation = \"simple-shear\"; leave it out, and take gshear-reduce spectrum of checkpoints or frames",
        );
    }
    let steps = match deformation {
        Deformation::Compression(pressures) => {
            c.useless(&aqs.steps, "is the number of aqs.pressures");
            pressures.len() as u64
        }
        _ => c.required_count(&aqs.steps),
    };
    Aqs {
        strain_step: c.required(&aqs.strain_step),
        steps,
        frame_every: c.count(&aqs.frame_every),
        spectrum,
        birth_precision: c.number_or_default(&aqs.birth_precision),
        until_imaginary: c.number_or_default(&aqs.until_imaginary),
    }
}

/// `None` if no key of the table is given.
fn check_newtonian(c: &mut Checker<'_>, newtonian: &raw::Newtonian) -> Option<Newtonian> {
    let counts = [&newtonian.rows, &newtonian.frames, &newtonian.spectra];
    if !newtonian.growth_times.is_given() && !counts.iter().any(|key| key.is_given()) {
        return None;
    }
    Some(Newtonian {
        growth_times: c.required(&newtonian.growth_times),
        rows: c.count(&newtonian.rows),
        frames: c.count(&newtonian.frames),
        spectra: c.count(&newtonian.spectra),
    })
}
