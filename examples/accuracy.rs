//! Prints how far the program is from the law integrated independently, against Δt: `docs/accuracy.md`.

#[path = "../tests/accuracy/reference.rs"]
#[allow(dead_code, reason = "shared with tests/accuracy.rs")]
mod reference;
#[path = "../tests/accuracy/scenes.rs"]
#[allow(dead_code, reason = "shared with tests/accuracy.rs")]
mod scenes;

use scenes::{FIELDS, Scene};

fn main() {
    let tables = [
        (
            "Impact, sticking, within contact",
            scenes::sticking_impact(),
        ),
        ("Impact, sliding, within contact", scenes::sliding_impact()),
        ("Shear under load, sticking", scenes::sticking_shear()),
        ("Shear under load, sliding", scenes::sliding_shear()),
        (
            "Whole oblique impact, damped",
            scenes::whole_impact(0.1, 0.5),
        ),
        (
            "Whole oblique impact, undamped",
            scenes::whole_impact(0.0, 0.5),
        ),
    ];
    for (title, scene) in tables {
        table(title, &scene);
    }
}

fn table(title: &str, scene: &Scene) {
    let reference = scene.reference(400);
    let converged = scene.errors(&reference, &scene.reference(200).1);
    println!("\n### {title}\n");
    for (time, pair, regime) in &reference.0.switches {
        println!("switch at {time:.4e} s of pair {pair}: {regime:?}");
    }
    print!("| Δt / τ |");
    for field in FIELDS {
        print!(" {field} | order |");
    }
    println!("\n|{}", " --- |".repeat(11));
    let mut last: Option<[f64; 5]> = None;
    for halving in 0..9 {
        let steps = 200 << halving;
        let errors = scene.errors(&reference, &scene.program(steps));
        let step = scene.duration / steps as f64 / scene.time_scale();
        print!("| {step:.2e} |");
        for f in 0..5 {
            match last {
                Some(l) if errors[f] > 0.0 => {
                    print!(" {:.2e} | {:.2} |", errors[f], (l[f] / errors[f]).log2())
                }
                _ => print!(" {:.2e} | |", errors[f]),
            }
        }
        println!();
        last = Some(errors);
    }
    let converged = converged.map(|e| format!("{e:.0e}")).join(", ");
    println!("\nreference against itself at half as many steps: {converged}");
}
