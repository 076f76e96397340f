//! Hard cases: what each test does, what it expects, and the result.
//!
//! `make stress` runs all of them, the long ones included, and writes `docs/figures/stress.csv`.

mod edges;
mod extremes;
mod held;
mod impact;
mod rig;
mod runs;
mod stability;
mod table;

/// Declares one test per point, and the list of all points for the table.
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
    smallest_unstable_time_step: "Smallest unstable Δt of loaded, sticking arrangements", stability::found_by_running;
    limit_of_the_map: "Stability limit from the eigenvalues of one step", stability::limit_of_the_map;
    limit_of_the_program: "The program's stability limit against sticking arrangements at ten times the mean overlap", stability::stated_by_the_program;
    strong_damping: "Strong damping", runs::strong_damping;
    sizes_and_loads: "Large ratios of sizes and loads, against the reference", extremes::sizes_and_loads;
    size_ratio: "Sizes 1:20 in a sample", runs::size_ratio;
    stiffness_numbers: "κ from 10² to 10⁵", runs::stiffness_numbers;
    #[ignore = "minutes; make stress"]
    great_stiffness_numbers: "κ from 10⁶ to 10⁷", runs::great_stiffness_numbers;
    energy_budget: "The energy budget", runs::energy_budget;
    oblique_impacts: "Oblique impacts gain no energy", impact::no_gain;
    sliding_impacts: "Grazing impacts: the loss by friction", impact::sliding_loss;
    turned_while_sliding: "A rotating sliding pair", held::sliding_pair;
    turned_while_sticking: "A rotating sticking pair", held::sticking_pair;
    held_for_a_million_steps: "A grain at rest for 10⁶ steps", held::held_for_a_million_steps;
    #[ignore = "minutes; make stress"]
    held_for_a_hundred_million_steps: "A grain at rest for 10⁸ steps", held::held_for_a_hundred_million_steps;
    touch: "The first touch, bit by bit", edges::touch;
    end_of_the_law: "The greatest overlap of the law", edges::end;
    end_of_the_law_in_a_run: "The greatest overlap of the law, in a run", runs::end_of_the_law;
    lone_grain: "A grain without contacts", edges::lone_grain;
    crushed: "Crushed grains", edges::crushed;
    wall_velocity: "A wall that bounces", edges::wall_velocity;
    shear_rate: "A shear rate a thousand times too high", runs::shear_rate;
    packing_with_friction: "Packing with friction", runs::packing_with_friction;
    far_from_the_origin: "Far from the origin", extremes::far_from_the_origin;
}

#[test]
#[ignore = "runs everything and writes docs/figures/stress.csv; make stress"]
fn all_into_the_table() {
    let (table, broken) = table::csv(POINTS);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/figures/stress.csv");
    std::fs::write(path, table).expect("docs/figures/stress.csv is written");
    assert_eq!(broken, 0, "lines that do not hold are marked in {path}");
}
