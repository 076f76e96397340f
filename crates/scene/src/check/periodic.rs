//! The scene without walls: `[box]`, `[relax]`, `[aqs]` and `[newtonian]`.

use super::{Checker, Head, head, law, sample};
use crate::derived;
use crate::periodic::{Aqs, Method, Newtonian, PeriodicScene, Relax};
use crate::raw::{self, Raw};
use crate::scene::{Dimensions, StepChoice, TimeStep};
use crate::source::Input;
use crate::write;
use gshear_dem::failure::Failure;

/// Overlap over d̄ that packings are expected to have, of which ten times bounds the time step.
const OVERLAP: f64 = 0.03;

/// Of whose dense matrix all eigenvalues are found after every strain step.
const MOST_UNKNOWNS: u64 = 6000;

/// As `super::scene`.
pub(crate) fn scene(
    raw: Raw,
    input: Input<'_>,
    tables: Vec<(String, usize)>,
) -> Result<PeriodicScene, Failure> {
    let mut c = Checker::new(input, tables);
    let Head {
        title,
        seed,
        dimension,
    } = head(&mut c, &raw);
    let (law, contact) = law::check(&mut c, dimension, raw.material, raw.contact);
    let grains = sample::check_boxed(&mut c, dimension, raw.sample);
    let solid_fraction = c.required(&raw.r#box.solid_fraction);
    let time = raw.time;
    let step = c.number(&time.step);
    let force = c.flag_or_default(&time.force);
    c.useless(&time.collision_speed, "applies to scenes with walls only");
    let relax = relax(&mut c, &raw.relax);
    let aqs = aqs(&mut c, &raw.aqs);
    let newtonian = newtonian(&mut c, &raw.newtonian);
    let keep_checkpoints = output(&mut c, &raw.output);
    let bookkeeping = super::check_bookkeeping(&mut c, &raw.bookkeeping);
    c.settle()?;

    let (sample, sizes) = grains.derive(&mut c, solid_fraction)?;
    let per_grain = match dimension {
        Dimensions::Two => 3,
        Dimensions::Three => 6,
    };
    if aqs.spectrum && u64::from(sample.grains) * per_grain > MOST_UNKNOWNS {
        return Err(c.out_of_range(&format!(
            "aqs.spectrum finds all eigenvalues at once, of up to {} grains in this dimension; leave it out, and take gshear-reduce spectrum \
             of checkpoints or frames",
            MOST_UNKNOWNS / per_grain
        )));
    }
    let mean_overlap = OVERLAP * sample.mean_diameter;
    let limit = derived::step_limit(
        &law,
        &contact,
        &sample,
        mean_overlap,
        contact.friction > 0.0,
    );
    let contact_time = derived::contact_time(&law, &sample, mean_overlap);
    let default = derived::default_step(contact_time, limit);
    let given = match step {
        Some(step) => (StepChoice::Given, step),
        None => (StepChoice::Derived, default),
    };
    let time_step: TimeStep =
        super::check_step(&mut c, [limit, default], &time.step, given, force)?;
    let mut scene = PeriodicScene {
        title: title.unwrap_or_else(|| "Periodic box".into()),
        seed,
        dimension,
        law,
        contact,
        sample,
        sizes,
        solid_fraction,
        time_step,
        relax,
        aqs,
        newtonian,
        keep_checkpoints,
        bookkeeping,
        toml: String::new(),
    };
    scene.toml = write::periodic(&scene, force);
    Ok(scene)
}

/// Whether checkpoints are kept. The intervals of output of a box are those of `[aqs]` and
/// `[newtonian]`.
fn output(c: &mut Checker<'_>, output: &raw::Output) -> bool {
    let why = "applies to scenes with walls only; a [box] has aqs.frame_every, newtonian.frames and newtonian.rows";
    c.useless(&output.frame_strain, why);
    c.useless(&output.frame_start, why);
    c.useless(&output.series_strain, why);
    c.useless(&output.checkpoint_strain, why);
    c.useless(&output.frame_rows, why);
    c.useless(&output.series_rows, why);
    c.useless(&output.progress_lines, why);
    c.useless(&output.energy, why);
    c.flag_or_default(&output.keep_checkpoints)
}

fn relax(c: &mut Checker<'_>, relax: &raw::Relax) -> Relax {
    let name = c.choice_or_default(&relax.method);
    let method = Method::NAMES.iter().find(|(known, _)| Some(*known) == name);
    Relax {
        method: method.map_or(Method::Newton, |(_, method)| *method),
        tolerance: c.required(&relax.tolerance),
        drag: c.required(&relax.drag),
        max_steps: c.count(&relax.max_steps),
    }
}

fn aqs(c: &mut Checker<'_>, aqs: &raw::Aqs) -> Aqs {
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
fn newtonian(c: &mut Checker<'_>, newtonian: &raw::Newtonian) -> Option<Newtonian> {
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
