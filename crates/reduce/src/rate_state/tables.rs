//! The tables of `rate-state` and `rate-state.json`. Numbers have the shortest form that reads back to
//! the same bits.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::Reduction;
use gshear_analysis::rate_state::{Evolution, Experiment, Fitted};

/// Returns names and texts of the files.
pub fn files(reduction: &Reduction) -> Vec<(String, String)> {
    let file = |name: &str, text: String| (name.to_string(), text);
    vec![
        file("rate-state.csv", series(reduction)),
        file("segments.csv", segments(reduction)),
        file("steps.csv", steps(reduction)),
        file("after-steps.csv", after_steps(reduction)),
        file("holds.csv", holds(reduction)),
        file("fits.csv", fits(reduction)),
        file("rate-state.json", format!("{:#}\n", json(reduction))),
    ]
}

/// Formats a number; empty if it is not finite.
fn cell(value: f64) -> String {
    if value.is_finite() {
        format!("{value:?}")
    } else {
        String::new()
    }
}

fn line(csv: &mut String, cells: &[String]) {
    writeln!(csv, "{}", cells.join(",")).expect("a string grows");
}

const BOTH: [Evolution; 2] = [Evolution::Aging, Evolution::Slip];

/// Returns a number of the experiment as predicted by a law.
fn of_law(
    models: &[(Evolution, Experiment)],
    law: Evolution,
    number: impl Fn(&Experiment) -> Option<f64>,
) -> String {
    let model = models.iter().find(|(of, _)| *of == law);
    cell(model.and_then(|(_, e)| number(e)).unwrap_or(f64::NAN))
}

fn series(reduction: &Reduction) -> String {
    let mut csv = String::from("experiment,segment,time,slip,mu,two_sigma,mu_aging,mu_slip\n");
    for (k, experiment) in reduction.experiments.iter().enumerate() {
        let (record, models) = (&experiment.record, &reduction.models[k]);
        for segment in 0..record.drive.len() {
            for row in record.rows(segment) {
                let mut cells = vec![k.to_string(), segment.to_string()];
                let numbers = [
                    record.time[row],
                    record.slip[row],
                    record.friction[row],
                    2.0 * record.deviation[row],
                ];
                cells.extend(numbers.map(cell));
                cells.extend(BOTH.map(|law| of_law(models, law, |e| Some(e.record.friction[row]))));
                line(&mut csv, &cells);
            }
        }
    }
    csv
}

fn segments(reduction: &Reduction) -> String {
    let mut csv =
        String::from("experiment,segment,drive_velocity,duration,rows,slip,mu_ss,error\n");
    for (k, experiment) in reduction.experiments.iter().enumerate() {
        let record = &experiment.record;
        for (segment, drive) in record.drive.iter().enumerate() {
            let rows = record.rows(segment);
            let slip = record.slip[rows.end - 1] - record.slip[rows.start];
            let steady = experiment.steady[segment];
            let [mean, error] = steady.map_or([f64::NAN; 2], |s| [s.friction, s.error]);
            let mut cells = vec![k.to_string(), segment.to_string()];
            cells.extend([drive.velocity, drive.duration].map(cell));
            cells.push(rows.len().to_string());
            cells.extend([slip, mean, error].map(cell));
            line(&mut csv, &cells);
        }
    }
    csv
}

fn steps(reduction: &Reduction) -> String {
    let mut csv = String::from(
        "experiment,segment,velocity_before,velocity_after,direct,direct_error,evolution,evolution_error,net,net_error,direct_aging,direct_slip\n",
    );
    for (k, experiment) in reduction.experiments.iter().enumerate() {
        for (n, step) in experiment.steps.iter().enumerate() {
            let mut cells = vec![k.to_string(), step.segment.to_string()];
            let numbers = [step.velocities, step.direct, step.evolution, step.net];
            cells.extend(numbers.into_iter().flatten().map(cell));
            let direct = |e: &Experiment| Some(e.steps.get(n)?.direct[0]);
            cells.extend(BOTH.map(|law| of_law(&reduction.models[k], law, direct)));
            line(&mut csv, &cells);
        }
    }
    csv
}

fn after_steps(reduction: &Reduction) -> String {
    let mut csv =
        String::from("velocity_before,velocity_after,slip_from,slip_to,steps,change,error\n");
    for stack in &reduction.stacks {
        for piece in &stack.pieces {
            let mut cells: Vec<String> = stack.velocities.map(cell).to_vec();
            cells.extend(piece.slip.map(cell));
            cells.push(piece.steps.to_string());
            cells.extend([piece.change, piece.error].map(cell));
            line(&mut csv, &cells);
        }
    }
    csv
}

fn holds(reduction: &Reduction) -> String {
    let mut csv = String::from(
        "experiment,segment,velocity_before,t_hold,relaxation,velocity_after,peak,slip_at_peak,healing,error,healing_aging,healing_slip\n",
    );
    for (k, experiment) in reduction.experiments.iter().enumerate() {
        for (n, hold) in experiment.holds.iter().enumerate() {
            let mut cells = vec![k.to_string(), hold.segment.to_string()];
            cells.extend([hold.before, hold.duration, hold.relaxation].map(cell));
            let after = hold.reslide.map_or([f64::NAN; 5], |r| {
                [r.velocity, r.peak, r.slip_at_peak, r.healing, r.error]
            });
            cells.extend(after.map(cell));
            let healing = |e: &Experiment| Some(e.holds.get(n)?.reslide?.healing);
            cells.extend(BOTH.map(|law| of_law(&reduction.models[k], law, healing)));
            line(&mut csv, &cells);
        }
    }
    csv
}

fn fits(reduction: &Reduction) -> String {
    let mut csv = String::from("fit,experiment,first_segment,last_segment,law");
    for name in ["a", "b", "a_minus_b", "d_c", "mu_star"] {
        write!(csv, ",{name},{name}_low,{name}_high").expect("a string grows");
    }
    csv += ",v_star,rms,effective_values,chi_squared,why_none\n";
    for fitted in &reduction.fitted {
        let event = fitted
            .event
            .as_ref()
            .map_or(vec![String::new(); 3], |(k, range)| {
                [*k, range.start, range.end - 1]
                    .map(|n| n.to_string())
                    .to_vec()
            });
        for ((law, fit), chi) in fitted.fits.iter().zip(&fitted.chi_squared) {
            let mut cells = vec![fitted.name.to_string()];
            cells.extend(event.clone());
            cells.push(law.name().to_string());
            match fit {
                Ok(fit) => {
                    for (_, e) in fit.estimates() {
                        cells.extend([e.value, e.interval[0], e.interval[1]].map(cell));
                    }
                    let chi = chi.unwrap_or(f64::NAN);
                    cells.extend([fit.law.v_star, fit.rms, fit.effective, chi].map(cell));
                    cells.push(String::new());
                }
                Err(why) => {
                    cells.extend(vec![String::new(); 19]);
                    cells.push(format!("\"{}\"", why.replace('"', "'")));
                }
            }
            line(&mut csv, &cells);
        }
    }
    csv
}

fn json(reduction: &Reduction) -> Value {
    let experiments = reduction.experiments.iter().zip(&reduction.runs);
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "experiments": experiments.map(|(e, runs)| experiment(e, runs)).collect::<Vec<_>>(),
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
    let pair = |[value, error]: [f64; 2]| json!({ "value": value, "error": error });
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
                "healing": pair([reslide.healing, reslide.error]),
            })),
        })
    });
    let healing = experiment.healing.iter().map(|healing| {
        json!({
            "velocities": healing.velocities,
            "holds": healing.holds,
            "slope": healing.slope,
            "interval": healing.interval,
            "intercept": healing.intercept,
        })
    });
    json!({
        "runs": runs,
        "realisations": record.realisations,
        "stiffness_over_normal_force": record.stiffness,
        "protocol": protocol.collect::<Vec<_>>(),
        "steps": steps.collect::<Vec<_>>(),
        "holds": holds.collect::<Vec<_>>(),
        "healing": healing.collect::<Vec<_>>(),
    })
}

fn fit(fitted: &Fitted) -> Value {
    let laws = fitted
        .fits
        .iter()
        .zip(&fitted.chi_squared)
        .map(|((law, fit), chi)| {
            let value = match fit {
                Ok(fit) => {
                    let mut value = json!({
                        "v_star": fit.law.v_star,
                        "critical_stiffness": fit.law.critical_stiffness(),
                        "rms": fit.rms,
                        "effective_values": fit.effective,
                        "chi_squared": chi,
                    });
                    for (name, e) in fit.estimates() {
                        value[name] = json!({ "value": e.value, "interval": e.interval });
                    }
                    value
                }
                Err(why) => json!({ "why_none": why }),
            };
            (law.name().to_string(), value)
        });
    let event = fitted
        .event
        .as_ref()
        .map(|(k, range)| json!({ "experiment": k, "segments": [range.start, range.end - 1] }));
    json!({
        "fit": fitted.name,
        "event": event,
        "laws": laws.collect::<serde_json::Map<_, _>>(),
    })
}
