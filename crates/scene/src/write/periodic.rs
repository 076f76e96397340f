//! The tables of a periodic box.

use super::lines::Lines;
use crate::raw;
use crate::scene::{Deformation, Method, PeriodicBox, TimeStep};
use crate::words::show;

/// What follows from the keys, in comments.
pub(super) fn derived(t: &mut Lines, time_step: &TimeStep) {
    t.derived("time step", time_step.step, "");
    t.derived("its limit of stability", time_step.limit, "");
}

/// `[box]`.
pub(super) fn size(t: &mut Lines, periodic: &PeriodicBox) {
    let keys: raw::BoxTable = t.table();
    t.number(&keys.solid_fraction, periodic.solid_fraction);
    t.text(&keys.deformation, periodic.deformation.name());
    if let Some(pressure) = periodic.pressure {
        t.number(&keys.pressure, pressure);
    }
    if periodic.has_pressures() {
        t.number(&keys.pressure_tolerance, periodic.pressure_tolerance);
    }
}

/// `[relax]`, `[aqs]`, `[newtonian]` and `[output]`.
pub(super) fn stages(t: &mut Lines, periodic: &PeriodicBox, keep_checkpoints: bool) {
    let keys: raw::Relax = t.table();
    let relax = &periodic.relax;
    let name = Method::NAMES
        .iter()
        .find(|(_, known)| *known == relax.method);
    t.text(&keys.method, name.map_or("", |(name, _)| name));
    t.number(&keys.tolerance, relax.tolerance);
    t.number(&keys.drag, relax.drag);
    t.whole(&keys.max_steps, relax.max_steps);
    let keys: raw::Aqs = t.table();
    let aqs = &periodic.aqs;
    t.number(&keys.strain_step, aqs.strain_step);
    if let Deformation::Compression(pressures) = &periodic.deformation {
        let pressures: Vec<String> = pressures.iter().map(|p| show(*p)).collect();
        t.numbers(&keys.pressures, &pressures);
    } else {
        t.whole(&keys.steps, aqs.steps);
    }
    t.whole(&keys.frame_every, aqs.frame_every);
    t.flag(&keys.spectrum, aqs.spectrum);
    if aqs.spectrum {
        t.number(&keys.birth_precision, aqs.birth_precision);
        t.number(&keys.until_imaginary, aqs.until_imaginary);
    }
    if let Some(newtonian) = &periodic.newtonian {
        let keys: raw::Newtonian = t.table();
        t.number(&keys.growth_times, newtonian.growth_times);
        t.whole(&keys.rows, newtonian.rows);
        t.whole(&keys.frames, newtonian.frames);
        t.whole(&keys.spectra, newtonian.spectra);
    }
    let keys: raw::Output = t.table();
    t.flag(&keys.keep_checkpoints, keep_checkpoints);
}
