//! Hard cases: what each test does, what it expects, and the result.
//!
//! `make stress` runs all of them, the long ones included, and writes `docs/validation/stress.md`.

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

const HEAD: &str = "\
# Stress tests

Does the program hold in hard cases? Yes: each case below gives the expected number, or ends the run
with one message and an exit code, and no file holds a NaN.

| question | answer | tests |
| --- | --- | --- |
| When is a time step unstable? | at the Δt of the linearised contacts, within 0.2 % | [measured](#smallest-unstable-δt-of-loaded-sticking-arrangements), [from eigenvalues](#stability-limit-from-the-eigenvalues-of-one-step) |
| Is the limit that the program states safe? | below that of loaded arrangements, as is the default Δt; far above it a run fails with a message | [limit](#the-programs-stability-limit-against-sticking-arrangements-at-ten-times-the-mean-overlap), [strong damping](#strong-damping) |
| Sizes and loads far apart? | second order at sizes 1:100 and forces 1:10⁴; sizes 1:20 in a sample | [pairs](#large-ratios-of-sizes-and-loads-against-the-reference), [sample](#sizes-120-in-a-sample) |
| Soft and stiff samples? | κ from 10² to 10⁷ carry the load, with the overlaps of the virial | below |
| Is energy kept? | the budget closes to 1e-6 of the work; no impact gains energy; friction loses what it must | [budget](#the-energy-budget), [impacts](#oblique-impacts-gain-no-energy), [grazing](#grazing-impacts-the-loss-by-friction) |
| Do contacts drift? | not in 1,000 revolutions, nor in 10⁸ steps at rest | [sliding](#a-rotating-sliding-pair), [sticking](#a-rotating-sticking-pair) |
| Do the ends of the law hold? | to 1e-12 from the first touch to the greatest overlap; beyond it the run ends | [touch](#the-first-touch-bit-by-bit), [end](#the-greatest-overlap-of-the-law), [in a run](#the-greatest-overlap-of-the-law-in-a-run) |
| What if a sample is destroyed? | one message with the step, the grains and their places | [crushed](#crushed-grains), [too fast](#a-shear-rate-a-thousand-times-too-high) |
| Walls, packings, loose grains? | walls move to the last bit, samples come to rest, a grain without contacts moves on a straight line | [wall](#a-wall-that-bounces), [packing](#packing-with-friction), [grain](#a-grain-without-contacts) |
| Far from the origin? | as at the origin up to rounding, at 10⁶ diameters, too | [impacts](#far-from-the-origin) |

Every line below is a test of `tests/all/stress`: what it does, what it expects, and the result. A
result that is not as expected is marked so. `make stress` runs them all and writes this page.

The expected values come from closed forms, from the linearised contacts, or from the reference
integration of [accuracy.md](accuracy.md), which shares no code with the program.
R: radius; δ: overlap; a: half-width of the contact; τ: √(m/k).
";

#[test]
#[ignore = "runs everything and writes docs/validation/stress.md; make stress"]
fn all_into_the_table() {
    let (tables, broken) = table::markdown(POINTS);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/validation/stress.md");
    std::fs::write(path, format!("{HEAD}{tables}")).expect("docs/validation/stress.md is written");
    assert_eq!(broken, 0, "lines that do not hold are marked in {path}");
}
