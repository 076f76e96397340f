//! The tables of `rate-state` and `rate-state.json`. Numbers have the shortest form that reads back
//! to the same bits.

use serde_json::{Value, json};

use super::Reduction;
use gshear_analysis::moments::mean;
use gshear_analysis::rate_state::{Estimate, Evolution, Experiment, Fit, Fitted, Quantity};
use gshear_store::csv_table::Table;

/// Returns the tables with their names.
pub fn tables(reduction: &Reduction) -> [(&'static str, String); 7] {
    [
        ("rate-state.csv", series(reduction)),
        ("segments.csv", segments(reduction)),
        ("steps.csv", steps(reduction)),
        ("after-steps.csv", after_steps(reduction)),
        ("holds.csv", holds(reduction)),
        ("relaxations.csv", relaxations(reduction)),
        ("fits.csv", fits(reduction)),
    ]
}

/// Returns the number if it is finite; `None` is an empty cell.
fn known(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Columns of both temperatures.
const SCALED_TEMPERATURES: [&str; 2] = ["scaled_temperature", "scaled_spin_temperature"];

const BOTH: [Evolution; 2] = [Evolution::Aging, Evolution::Slip];

/// Returns a number of the experiment as predicted by the two laws.
fn of_laws(
    models: &[(Evolution, Experiment)],
    number: impl Fn(&Experiment) -> Option<f64>,
) -> [Option<f64>; 2] {
    BOTH.map(|law| {
        let model = models.iter().find(|(known, _)| *known == law);
        model.and_then(|(_, e)| number(e)).and_then(known)
    })
}

fn series(reduction: &Reduction) -> String {
    let rows = reduction.experiments().flat_map(|numbered| {
        let (k, experiment) = (numbered.number, numbered.experiment);
        let record = &experiment.record;
        let segments = 0..record.drive.len();
        segments.flat_map(move |segment| {
            let rows = record.rows(segment);
            rows.map(move |row| (k, record, segment, row))
        })
    });
    Table::of(rows)
        .column("experiment", |(k, ..)| *k)
        .column("segment", |(.., segment, _)| *segment)
        .column("time", |(_, record, _, row)| known(record.time[*row]))
        .column("slip", |(_, record, _, row)| known(record.slip[*row]))
        .column("mu", |(_, record, _, row)| known(record.friction[*row]))
        .column("two_sigma", |(_, record, _, row)| {
            known(2.0 * record.deviation[*row])
        })
        .columns(["mu_aging", "mu_slip"], |(k, .., row)| {
            of_laws(&reduction.models[*k], |e| Some(e.record.friction[*row]))
        })
        .csv()
}

fn segments(reduction: &Reduction) -> String {
    let rows = reduction.experiments().flat_map(|numbered| {
        let (k, experiment) = (numbered.number, numbered.experiment);
        let drive = experiment.record.drive.iter().enumerate();
        drive.map(move |(segment, drive)| (k, experiment, segment, drive))
    });
    Table::of(rows)
        .column("experiment", |(k, ..)| *k)
        .column("segment", |(.., segment, _)| *segment)
        .column("drive_velocity", |(.., drive)| known(drive.velocity))
        .column("duration", |(.., drive)| known(drive.duration))
        .column("rows", |(_, experiment, segment, _)| {
            experiment.record.rows(*segment).len()
        })
        .column("slip", |(_, experiment, segment, _)| {
            let (slip, rows) = (&experiment.record.slip, experiment.record.rows(*segment));
            known(slip[rows.end - 1] - slip[rows.start])
        })
        .columns(["mu_ss", "error"], |(_, experiment, segment, _)| {
            let steady = experiment.steady[*segment];
            [steady.map(|s| s.friction), steady.map(|s| s.error)].map(|x| x.and_then(known))
        })
        .columns(SCALED_TEMPERATURES, |(_, experiment, segment, _)| {
            let record = &experiment.record;
            let [_, half] = record.halves(*segment);
            [&record.temperature, &record.spin_temperature]
                .map(|column| known(mean(&column[half.clone()])))
        })
        .csv()
}

fn steps(reduction: &Reduction) -> String {
    let rows = reduction.experiments().flat_map(|numbered| {
        let (k, experiment) = (numbered.number, numbered.experiment);
        let steps = experiment.steps.iter().enumerate();
        steps.map(move |(n, step)| (k, n, step))
    });
    Table::of(rows)
        .column("experiment", |(k, ..)| *k)
        .column("segment", |(.., step)| step.segment)
        .columns(["velocity_before", "velocity_after"], |(.., step)| {
            step.velocities.map(known)
        })
        .columns(["direct", "direct_error"], |(.., step)| {
            step.direct.map(known)
        })
        .columns(["evolution", "evolution_error"], |(.., step)| {
            step.evolution.map(known)
        })
        .columns(["net", "net_error"], |(.., step)| step.net.map(known))
        .columns(["direct_aging", "direct_slip"], |(k, n, _)| {
            of_laws(&reduction.models[*k], |e| Some(e.steps.get(*n)?.direct[0]))
        })
        .csv()
}

fn after_steps(reduction: &Reduction) -> String {
    let stacks = reduction.stacks.iter();
    let rows = stacks.flat_map(|stack| stack.pieces.iter().map(move |piece| (stack, piece)));
    Table::of(rows)
        .columns(["velocity_before", "velocity_after"], |(stack, _)| {
            stack.velocities.map(known)
        })
        .columns(["slip_from", "slip_to"], |(_, piece)| piece.slip.map(known))
        .column("steps", |(_, piece)| piece.steps)
        .column("change", |(_, piece)| known(piece.change))
        .column("error", |(_, piece)| known(piece.error))
        .csv()
}

fn holds(reduction: &Reduction) -> String {
    let rows = reduction.experiments().flat_map(|numbered| {
        let (k, experiment) = (numbered.number, numbered.experiment);
        let holds = experiment.holds.iter().enumerate();
        holds.map(move |(n, hold)| (k, n, hold))
    });
    Table::of(rows)
        .column("experiment", |(k, ..)| *k)
        .column("segment", |(.., hold)| hold.segment)
        .column("velocity_before", |(.., hold)| known(hold.before))
        .column("t_hold", |(.., hold)| known(hold.duration))
        .column("relaxation", |(.., hold)| known(hold.relaxation))
        .columns(["relaxation_aging", "relaxation_slip"], |(k, n, _)| {
            of_laws(&reduction.models[*k], |e| Some(e.holds.get(*n)?.relaxation))
        })
        .column("velocity_after", |(.., hold)| known(hold.reslide?.velocity))
        .column("peak", |(.., hold)| known(hold.reslide?.peak))
        .column("slip_at_peak", |(.., hold)| {
            known(hold.reslide?.slip_at_peak)
        })
        .column("reload_stiffness", |(.., hold)| hold.reslide?.stiffness)
        .column("healing", |(.., hold)| known(hold.reslide?.healing))
        .column("error", |(.., hold)| known(hold.reslide?.error))
        .columns(["healing_aging", "healing_slip"], |(k, n, _)| {
            of_laws(&reduction.models[*k], |e| {
                Some(e.holds.get(*n)?.reslide?.healing)
            })
        })
        .csv()
}

fn relaxations(reduction: &Reduction) -> String {
    let a = reduction.direct_effect;
    Table::of(reduction.relaxations.iter())
        .column("velocity_before", |relaxation| known(relaxation.before))
        .column("t_hold", |relaxation| known(relaxation.duration))
        .column("time", |relaxation| known(relaxation.time))
        .column("holds", |relaxation| relaxation.holds)
        .column("change", |relaxation| known(relaxation.change))
        .column("error", |relaxation| known(relaxation.error))
        .column("change_direct_effect", |relaxation| {
            known(relaxation.of_direct_effect(a?, relaxation.stiffness))
        })
        .column("reload_stiffness", |relaxation| known(relaxation.reload))
        .column("change_direct_effect_reload", |relaxation| {
            known(relaxation.of_direct_effect(a?, relaxation.reload))
        })
        .columns(SCALED_TEMPERATURES, |relaxation| {
            [relaxation.temperature, relaxation.spin_temperature].map(known)
        })
        .csv()
}

fn fits(reduction: &Reduction) -> String {
    let rows = reduction.fitted.iter().flat_map(|fitted| {
        let fits = fitted.fits.iter().zip(&fitted.chi_squared);
        fits.map(move |((law, fit), chi)| (fitted, law, fit, chi))
    });
    let windows = ["experiment", "first_segment", "last_segment"];
    let estimates = Quantity::ALL
        .map(|quantity| ["", "_low", "_high"].map(|end| format!("{}{end}", quantity.name())));
    Table::of(rows)
        .column("fit", |(fitted, ..)| fitted.name)
        .columns(windows, |(fitted, ..)| match &fitted.event {
            Some((k, range)) => [*k, range.start, range.end - 1].map(Some),
            None => [None; 3],
        })
        .column("law", |(_, law, ..)| law.name())
        .columns(estimates.into_iter().flatten(), |(.., fit, _)| {
            let cells = Quantity::ALL.map(|quantity| {
                let estimate = fit.as_ref().ok().and_then(|fit| fit.estimate(quantity));
                estimate.map_or([None; 3], cells_of)
            });
            cells.into_iter().flatten()
        })
        .columns(
            ["v_star", "rms", "effective_values"],
            |(.., fit, _)| match fit {
                Ok(fit) => [fit.model.law.v_star, fit.rms, fit.effective].map(known),
                Err(_) => [None; 3],
            },
        )
        .column("chi_squared", |(.., fit, chi)| {
            fit.as_ref().ok().and(**chi).and_then(known)
        })
        .column("undetermined", |(.., fit, _)| {
            fit.as_ref().ok().map(|fit| fit.undetermined().join(" "))
        })
        .column("given", |(.., fit, _)| {
            let names = |fit: &Fit| fit.given.iter().map(|q| q.name()).collect::<Vec<_>>();
            fit.as_ref().ok().map(|fit| names(fit).join(" "))
        })
        .column("why_none", |(.., fit, _)| {
            fit.as_ref().err().map(String::as_str)
        })
        .csv()
}

/// An estimate, if the data determine it, and the ends of its interval.
fn cells_of(estimate: Estimate) -> [Option<f64>; 3] {
    let [low, high] = estimate.interval.map(known);
    [value_of(estimate), low, high]
}

/// The value of an estimate, if the data determine it.
fn value_of(estimate: Estimate) -> Option<f64> {
    if estimate.determined {
        known(estimate.value)
    } else {
        None
    }
}

/// Returns the content of `rate-state.json`.
pub fn json(reduction: &Reduction) -> Value {
    let experiments = reduction.experiments();
    let experiments = experiments.map(|numbered| experiment(numbered.experiment, numbered.runs));
    let growth = reduction.peak_growth().into_iter().map(|growth| {
        json!({
            "t_hold": growth.duration,
            "velocity_before": growth.before,
            "peaks": growth.peaks,
            "slope": { "value": growth.slope, "error": growth.error },
            "intercept": growth.intercept,
        })
    });
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "experiments": experiments.collect::<Vec<_>>(),
        "peak_growth": growth.collect::<Vec<_>>(),
        "fits": reduction.fitted.iter().map(fit).collect::<Vec<_>>(),
    })
}

fn experiment(experiment: &Experiment, runs: &[String]) -> Value {
    let record = &experiment.record;
    let protocol = record.drive.iter().zip(&experiment.steady).map(|(drive, steady)| {
        json!({
            "velocity": drive.velocity,
            "duration": drive.duration,
            "mu_ss": steady.map(|s| json!({ "value": s.friction, "error": s.error, "scatter": s.scatter })),
        })
    });
    let steps = experiment.steps.iter().map(|step| {
        json!({
            "segment": step.segment,
            "velocities": step.velocities,
            "direct": pair(step.direct),
            "evolution": pair(step.evolution),
            "net": pair(step.net),
        })
    });
    let holds = experiment.holds.iter().map(|hold| {
        json!({
            "segment": hold.segment,
            "t_hold": hold.duration,
            "velocity_before": hold.before,
            "relaxation": hold.relaxation,
            "reslide": hold.reslide.map(|reslide| json!({
                "velocity": reslide.velocity,
                "peak": reslide.peak,
                "slip_at_peak": reslide.slip_at_peak,
                "reload_stiffness": reslide.stiffness,
                "healing": pair([reslide.healing, reslide.error]),
            })),
        })
    });
    json!({
        "runs": runs,
        "realisations": record.realisations,
        "stiffness_over_normal_force": record.stiffness,
        "protocol": protocol.collect::<Vec<_>>(),
        "steps": steps.collect::<Vec<_>>(),
        "holds": holds.collect::<Vec<_>>(),
        "healing": experiment.healing,
    })
}

/// A value with its standard error.
fn pair(estimate: [f64; 2]) -> Value {
    let [value, error] = estimate;
    json!({ "value": value, "error": error })
}

fn fit(fitted: &Fitted) -> Value {
    let fits = fitted.fits.iter().zip(&fitted.chi_squared);
    let laws = fits.map(|((law, fit), chi)| {
        let value = match fit {
            Ok(fit) => {
                let mut value = json!({
                    "v_star": fit.model.law.v_star,
                    "critical_stiffness": fit.model.law.critical_stiffness(),
                    "rms": fit.rms,
                    "effective_values": fit.effective,
                    "chi_squared": chi,
                    "undetermined": fit.undetermined(),
                });
                for (quantity, e) in &fit.estimates {
                    value[quantity.name()] =
                        json!({ "value": value_of(*e), "interval": e.interval });
                }
                if !fit.given.is_empty() {
                    value["given"] = fit.given.iter().map(|quantity| quantity.name()).collect();
                }
                value
            }
            Err(why) => json!({ "why_none": why }),
        };
        (law.name().to_string(), value)
    });
    let event = fitted.event.as_ref();
    let event = event
        .map(|(k, range)| json!({ "experiment": k, "segments": [range.start, range.end - 1] }));
    json!({
        "fit": fitted.name,
        "event": event,
        "laws": laws.collect::<serde_json::Map<_, _>>(),
    })
}
