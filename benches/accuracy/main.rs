//! How accurate the program is, against Δt and against the time that it takes.
//!
//! Prints the tables of the law against its independent integration; measures errors against run
//! time, prints their table and writes them to `docs/figures/accuracy.csv` and
//! `docs/figures/accuracy.svg`.

mod cost;
mod energy;
mod figure;
#[path = "../../tests/all/accuracy/reference.rs"]
#[allow(dead_code, reason = "shared with the tests")]
mod reference;
mod sample;
#[path = "../../tests/all/accuracy/scenes.rs"]
#[allow(dead_code, reason = "shared with the tests")]
mod scenes;
mod scheme;
mod tables;

/// The argument that asks for it: a plain `cargo bench` is about speed and leaves `docs/` alone.
const MEASURE: &str = "measure";

fn main() {
    if !std::env::args().any(|argument| argument == MEASURE) {
        println!("accuracy: left out; `make accuracy` measures it and writes into docs/");
        return;
    }
    println!("{}", processor());
    tables::print();
    let curves = cost::measure();
    cost::write(&curves);
    figure::write(&curves);
}

fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = text.lines().find(|l| l.starts_with("model name"));
    let name = model.and_then(|l| l.split(": ").nth(1));
    format!(
        "{}, {}",
        name.unwrap_or("processor unknown"),
        gshear_dem::simd::Isa::detect().name()
    )
}
