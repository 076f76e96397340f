//! How far the program is from the law integrated independently, against Δt: the tables of
//! `docs/validation/accuracy.md`.

use crate::scenes::{self, Errors, FIELDS, Scene};

pub fn print() {
    for (title, scene) in [
        ("Impact, sticking", scenes::sticking_impact()),
        ("Impact, sliding", scenes::sliding_impact()),
        ("Shear under load, sticking", scenes::sticking_shear()),
        ("Shear under load, sliding", scenes::sliding_shear()),
        ("Whole impact, α = 0.1", scenes::whole_impact(0.1, 0.5)),
        ("Whole impact, α = 0", scenes::whole_impact(0.0, 0.5)),
    ] {
        table(title, &scene);
    }
}

fn table(title: &str, scene: &Scene) {
    let reference = scene.reference(400);
    let coarser = scene.errors(&reference, &scene.reference(200).1);
    println!(
        "\n### {title}\n\n| steps | Δt/τ | {} | orders |",
        FIELDS.join(" | ")
    );
    println!("|{}", " ---: |".repeat(8));
    let cells = |errors: Errors| errors.map(|e| format!("{e:.1e}")).join(" | ");
    let mut last: Option<Errors> = None;
    for k in 0..7 {
        let steps = 24 << (2 * k);
        let errors = scene.errors(&reference, &scene.program(steps));
        let step = scene.duration / steps as f64 / scene.time_scale();
        let orders = last.map_or(String::new(), |last| {
            let order = |f: usize| 0.5 * (last[f] / errors[f]).log2();
            let least = (0..5).map(order).fold(f64::MAX, f64::min);
            let most = (0..5).map(order).fold(f64::MIN, f64::max);
            format!("{least:.2} … {most:.2}")
        });
        println!("| {steps} | {step:.1e} | {} | {orders} |", cells(errors));
        last = Some(errors);
    }
    println!("| reference, half as many steps | | {} | |", cells(coarser));
}
