//! The periodic box: `[box]`, `[relax]`, `[aqs]` and `[newtonian]`.

use super::sample;
use crate::checker::Checker;
use crate::raw::{self, Raw};
use crate::scene::{Aqs, Dimensions, Method, Newtonian, PeriodicBox, Relax, Sample};
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
    let periodic = PeriodicBox {
        sizes,
        solid_fraction: c.required(&raw.r#box.solid_fraction),
        relax: check_relax(c, &raw.relax),
        aqs: check_aqs(c, &raw.aqs),
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
    Ok((sample, periodic))
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

fn check_aqs(c: &mut Checker<'_>, aqs: &raw::Aqs) -> Aqs {
    let spectrum = c.flag_or_default(&aqs.spectrum);
    if !spectrum {
        let why = "applies to the eigenvalues, which need aqs.spectrum = true";
        c.useless(&aqs.birth_precision, why);
        c.useless(&aqs.until_imaginary, why);
    }
    Aqs {
        strain_step: c.required(&aqs.strain_step),
        steps: c.required_count(&aqs.steps),
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
