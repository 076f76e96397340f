//! The scene without walls: `[box]`, `[relax]`, `[aqs]` and `[newtonian]`.

use super::{Bounds, Checker, Head, Key, NOT_NEGATIVE, POSITIVE, UNIT, head, key, law, sample};
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

const FRACTION: Bounds = Bounds {
    hold: |x| x > 0.3 && x < 1.2,
    words: "must lie in (0.3, 1.2)",
};

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
    } = head(&mut c, raw.title, raw.seed, raw.dimension);
    let (law, contact) = law::check(&mut c, dimension, raw.material, raw.contact);
    let grains = sample::check_boxed(&mut c, dimension, raw.sample);
    let solid_fraction = c.required(
        &Key::new("box.solid_fraction", raw.r#box.solid_fraction),
        &FRACTION,
        "phi, the grains' volume over that of the box, such as solid_fraction = 0.7",
    );
    let time = raw.time;
    let step_key = key!(time.step);
    let force_key = key!(time.force);
    let step = c.number(&step_key, &POSITIVE);
    let force = c.flag(&force_key).unwrap_or(false);
    c.useless(&key!(time.collision_speed), "is for scenes with walls");
    let relax = relax(&mut c, raw.relax);
    let aqs = aqs(&mut c, raw.aqs);
    let newtonian = newtonian(&mut c, raw.newtonian);
    let keep_checkpoints = output(&mut c, raw.output);
    let bookkeeping = super::check_bookkeeping(&mut c, raw.bookkeeping);
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
    let time_step: TimeStep = super::check_step(&mut c, [limit, default], &step_key, given, force)?;
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

/// Whether checkpoints are kept. Intervals of output are those of `[aqs]` and `[newtonian]`.
fn output(c: &mut Checker<'_>, output: raw::Output) -> bool {
    let why = "is for scenes with walls; a [box] has aqs.frame_every, newtonian.frames and newtonian.rows";
    for key in [
        key!(output.frame_strain),
        key!(output.frame_start),
        key!(output.series_strain),
        key!(output.checkpoint_strain),
    ] {
        c.useless(&key, why);
    }
    for key in [
        key!(output.frame_rows),
        key!(output.series_rows),
        key!(output.progress_lines),
    ] {
        c.useless(&key, why);
    }
    c.useless(&key!(output.energy), why);
    c.flag(&key!(output.keep_checkpoints)).unwrap_or(false)
}

fn relax(c: &mut Checker<'_>, relax: raw::Relax) -> Relax {
    let method_key = key!(relax.method);
    let name = c.text(&method_key).unwrap_or_else(|| "newton".into());
    let method = Method::NAMES.iter().find(|(known, _)| *known == name);
    if method.is_none() {
        let names = Method::NAMES.map(|(known, _)| format!("{known:?}"));
        let what = format!("unknown method {name:?}; there are {}", names.join(" and "));
        c.refuse(&method_key, &what);
    }
    Relax {
        method: method.map_or(Method::Newton, |(_, method)| *method),
        tolerance: c.required(
            &key!(relax.tolerance),
            &POSITIVE,
            "the greatest force on a grain at rest, such as tolerance = 5e-14",
        ),
        drag: c.required(
            &key!(relax.drag),
            &POSITIVE,
            "eta_0 of -eta_0 m v (1/time), such as drag = 0.022",
        ),
        max_steps: c
            .whole(&key!(relax.max_steps), 1, i64::MAX)
            .map_or(10_000_000, i64::unsigned_abs),
    }
}

fn aqs(c: &mut Checker<'_>, aqs: raw::Aqs) -> Aqs {
    let spectrum_key = key!(aqs.spectrum);
    let spectrum = c.flag(&spectrum_key).unwrap_or(false);
    let precision_key = key!(aqs.birth_precision);
    let until_key = key!(aqs.until_imaginary);
    if !spectrum {
        let why = "is of the eigenvalues, which aqs.spectrum = true asks for";
        c.useless(&precision_key, why);
        c.useless(&until_key, why);
    }
    Aqs {
        strain_step: c.required(
            &key!(aqs.strain_step),
            &UNIT,
            "delta gamma, such as strain_step = 1e-4",
        ),
        steps: c
            .required_whole(
                &key!(aqs.steps),
                0,
                i64::MAX,
                "the number of strain steps, such as steps = 100",
            )
            .unsigned_abs(),
        frame_every: c
            .whole(&key!(aqs.frame_every), 0, i64::MAX)
            .map_or(0, i64::unsigned_abs),
        spectrum,
        birth_precision: c.number(&precision_key, &POSITIVE).unwrap_or(1e-10),
        until_imaginary: c.number(&until_key, &NOT_NEGATIVE).unwrap_or(0.0),
    }
}

/// `None` where the table is not there.
fn newtonian(c: &mut Checker<'_>, newtonian: raw::Newtonian) -> Option<Newtonian> {
    let growth_times = key!(newtonian.growth_times);
    let counts = [
        key!(newtonian.rows),
        key!(newtonian.frames),
        key!(newtonian.spectra),
    ];
    if growth_times.given.is_none() && counts.iter().all(|key| key.given.is_none()) {
        return None;
    }
    let growth_times = c.required(
        &growth_times,
        &POSITIVE,
        "how long, in times 1/omega_i in which the complex pair grows by e, such as growth_times = 20",
    );
    let mut count = |key, default| c.whole(key, 0, i64::MAX).map_or(default, i64::unsigned_abs);
    Some(Newtonian {
        growth_times,
        rows: count(&counts[0], 20_000),
        frames: count(&counts[1], 200),
        spectra: count(&counts[2], 0),
    })
}
