//! What the program does where it is hard: what was done, what was expected, what came out.
//!
//! `make stress` does all of it, the long ones too, and writes `docs/stress.md`.

mod common;
#[path = "stress/edges.rs"]
mod edges;
#[path = "stress/extremes.rs"]
mod extremes;
#[path = "stress/held.rs"]
mod held;
#[path = "stress/impact.rs"]
mod impact;
#[path = "accuracy/reference.rs"]
#[allow(dead_code, reason = "shared with tests/accuracy.rs")]
mod reference;
#[path = "stress/rig.rs"]
mod rig;
#[path = "stress/runs.rs"]
mod runs;
#[path = "accuracy/scenes.rs"]
#[allow(dead_code, reason = "shared with tests/accuracy.rs")]
mod scenes;
#[path = "stress/stability.rs"]
mod stability;
#[path = "stress/table.rs"]
mod table;

/// One test a point, and the list of all for the table.
macro_rules! points {
    ($($(#[$attribute:meta])* $name:ident: $title:literal, $lines:path;)*) => {
        $(
            #[test]
            $(#[$attribute])*
            fn $name() {
                table::check(&$lines());
            }
        )*
        const POINTS: &[table::Point] = &[$(($title, $lines)),*];
    };
}

points! {
    time_step_until_it_blows_up: "Δt raised until a loaded, sticking arrangement departs from rest", stability::found_by_running;
    limit_of_the_map: "The limit of Δt, from the eigenvalues of one step", stability::limit_of_the_map;
    limit_that_the_program_states: "The limit that the program states, against all that sticks at ten times the mean overlap", stability::stated_by_the_program;
    strong_damping: "Strong damping", runs::strong_damping;
    sizes_and_loads: "Very different sizes and loads, against the reference", extremes::sizes_and_loads;
    size_ratio: "Sizes 1:20 in a sample", runs::size_ratio;
    stiffness_numbers: "κ from 10² to 10⁵", runs::stiffness_numbers;
    #[ignore = "minutes; make stress"]
    great_stiffness_numbers: "κ from 10⁶ to 10⁷", runs::great_stiffness_numbers;
    energy_budget: "The energy budget", runs::energy_budget;
    oblique_impacts: "Oblique impacts: no gain of energy, a fault of other codes", impact::no_gain;
    sliding_impacts: "Grazing impacts: the loss by friction", impact::sliding_loss;
    turned_while_sliding: "Turned while sliding", held::sliding_pair;
    turned_while_sticking: "Turned while sticking", held::sticking_pair;
    held_for_a_million_steps: "Held for 10⁶ steps", held::held_for_a_million_steps;
    #[ignore = "minutes; make stress"]
    held_for_a_hundred_million_steps: "Held for 10⁸ steps", held::held_for_a_hundred_million_steps;
    touch: "Overlap at 0", edges::touch;
    end_of_the_law: "Overlap at the law's end", edges::end;
    end_of_the_law_in_a_run: "Overlap at the law's end, through the program", runs::end_of_the_law;
    lone_grain: "A grain that touches nothing", edges::lone_grain;
    crushed: "Crushed grains", edges::crushed;
    wall_velocity: "A wall that bounces", edges::wall_velocity;
    shear_rate: "A shear rate a thousand times too high", runs::shear_rate;
    packing_with_friction: "Packing with friction", runs::packing_with_friction;
    far_from_the_origin: "Far from the origin", extremes::far_from_the_origin;
}

const HEAD: &str = "\
# Under stress

What the program does where it is hard. Every line is a test of `tests/stress.rs`; this page is written by

    make stress

What is expected comes from closed forms, from the linearised contacts, or from the reference of `docs/accuracy.md`, which shares no code
with the program. R, δ: radius and overlap; a: half width of the contact; τ: √(m/k).
";

#[test]
#[ignore = "everything, into docs/stress.md; make stress"]
fn all_into_the_table() {
    let (tables, broken) = table::markdown(POINTS);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/stress.md");
    std::fs::write(path, format!("{HEAD}{tables}")).expect("docs/stress.md is written");
    assert_eq!(broken, 0, "lines that do not hold are marked in {path}");
}
