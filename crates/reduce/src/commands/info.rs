//! `info`: prints the content of a run.

use std::path::PathBuf;

use console::Term;

use crate::printer::Printer;
use gshear_analysis::moments::extent;
use gshear_dem::columns::joined_names;
use gshear_dem::failure::Result;
use gshear_driver::say::fold_for;
use gshear_driver::stored_run::{condition, stage_beyond};
use gshear_scene::identity;
use gshear_store::part;
use gshear_store::run_reader::{RunFile, RunStage};

/// Show the content of a run
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder of a run; run.h5/aqs, run.h5/newtonian or run.h5/shear for a later
    /// stage
    pub run: PathBuf,
}

impl Arguments {
    /// # Errors
    /// A damaged run, or one without the parameters that define its strain.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let text = describe(&RunFile::open_any(&self.run)?)?;
        write!(printer, "{}", fold_for(&Term::stdout(), &text))
    }
}

fn describe(run: &RunFile) -> Result<String> {
    let bytes = std::fs::metadata(part::file_of(run.path())).map_or(0, |file| file.len());
    let mut state = condition(run).to_string();
    if let Some(digest) = run.digest() {
        state += &format!(", digest {digest}");
    }
    let beyond = stage_beyond(run).map(|(stage, condition)| format!("then {stage}: {condition}"));
    let family = family(run.scene(), run.grains().count());
    let grains = run.grains();
    let all = grains.count();
    let [free, bottom, top] =
        [0, 1, 2].map(|body| grains.body.iter().filter(|known| **known == body).count());
    let walls = run.boundary().has_walls();
    let count = if walls {
        format!("{all}: {free} free, {bottom} in the bottom wall, {top} in the top wall")
    } else {
        all.to_string()
    };
    let [least, most] = extent(grains.radius.iter().copied());
    let mean = grains.mean_radius();
    let (length, height) = (run.periods()[0], run.height());
    let width = match run.periods()[1] {
        f64::INFINITY => String::new(),
        width => format!(" × {width:.4e} m"),
    };
    let height_words = if walls {
        format!("(periodic) × {height:.4e} m at the start")
    } else {
        format!("× {height:.4e} m (periodic)")
    };
    let mut lines = vec![
        ("run", run.path().display().to_string()),
        ("size", format!("{:.1} MB", bytes as f64 / 1e6)),
        ("state", state),
    ];
    lines.extend(beyond.map(|words| ("", words)));
    lines.extend([
        ("family", identity::hash(family.as_bytes())),
        ("grains", count),
        (
            "radius",
            format!("{least:.4e} … {most:.4e} m, mean {mean:.4e} m"),
        ),
        ("box", format!("{length:.4e} m{width} {height_words}")),
    ]);
    if let Some(lengths) = lengths_at_the_end(run)
        && (lengths[0] != length || lengths.last() != Some(&height))
    {
        let words: Vec<String> = lengths.iter().map(|l| format!("{l:.4e} m")).collect();
        let text = format!("{} (periodic) at the end", words.join(" × "));
        lines.push(("", text));
    }

    let strains = run.frame_strains()?;
    let steps = run.frame_steps();
    lines.push(("frames", span(steps, &strains)));
    if let (Some(contacts), true) = (run.contact_offsets().last(), run.frames() > 0) {
        let mean = *contacts as f64 / run.frames() as f64;
        lines.push(("contacts", format!("{contacts}, {mean:.1} per frame")));
    }
    let series = run.series();
    let strains = match run.stage() {
        RunStage::Shear => series.column("strain"),
        RunStage::Strain => &series.time,
        RunStage::Newtonian => &strains[..0],
    };
    lines.push(("series", span(&series.step, strains)));
    lines.push(("columns", joined_names(series.declared, ", ")));

    let facts = lines
        .iter()
        .map(|(name, value)| format!("{name:<10}{value}\n"));
    let one_line = run.parameters().iter().filter(|(name, _)| *name != "scene");
    let parameters = one_line.map(|(name, value)| format!("  {name:<19} {value}\n"));
    let scene = run.scene().lines().map(|line| format!("  {line}\n"));
    Ok([
        facts.collect(),
        "\nparameters\n".to_string(),
        parameters.collect(),
        "\nscene\n".into(),
        scene.collect(),
    ]
    .concat())
}

/// Returns the lengths of a box at its last row, or if there is none at its last frame.
fn lengths_at_the_end(run: &RunFile) -> Option<Vec<f64>> {
    let axes = run.dimension().axes();
    if run.stage() == RunStage::Strain {
        let names = ["length_x", "length_y", "length_z"];
        let columns = names[..axes].iter().map(|name| run.series().column(name));
        let lengths: Option<Vec<f64>> = columns.map(|column| column.last().copied()).collect();
        if lengths.is_some() {
            return lengths;
        }
    }
    if run.boundary().has_walls() {
        return None;
    }
    let last = run.frames().checked_sub(1)?;
    let edges = run.box_edges(last);
    Some((0..axes).map(|axis| edges[axis][axis]).collect())
}

/// Returns the number of entries and the range of steps and, where they have one, of strains: the
/// least and the greatest if they return.
fn span(step: &[u64], strain: &[f64]) -> String {
    let count = step.len();
    let returns = strain.windows(2).any(|pair| pair[1] < pair[0]);
    let [least, most] = extent(strain.iter().copied());
    let strains = match strain {
        [_, .., _] if returns => format!(", γ between {least:.8} and {most:.8}"),
        [from, .., to] => format!(", γ = {from:.8} … {to:.8}"),
        [at] => format!(", γ = {at:.8}"),
        [] => String::new(),
    };
    match step {
        [first, .., last] => format!("{count}: step {first} … {last}{strains}"),
        [only] => format!("1: step {only}{strains}"),
        [] => "none".to_string(),
    }
}

/// What runs have in common that differ in their seed and outputs only.
fn family(scene: &str, grains: usize) -> String {
    let others = ["seed", "title", "output", "analysis", "bookkeeping"];
    let mut family = format!("{grains} grains\n");
    for (path, value) in identity::values(scene) {
        let table = path.split('.').next().unwrap_or_default();
        if !others.contains(&table) {
            family += &format!("{path} = {value}\n");
        }
    }
    family
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run made before a key existed has its constant default.
    #[test]
    fn a_family_differs_in_what_its_scenes_say() {
        let of = |seed: u32, contact: &str| {
            let scene = format!("seed = {seed}\ntitle = \"run {seed}\"\n[contact]\n{contact}\n");
            family(&scene, 12)
        };
        let old = of(1, "friction = 0.7");
        assert_eq!(of(2, "sliding_damping = 0.0\nfriction = 0.7"), old);
        assert_ne!(of(2, "sliding_damping = 1.0\nfriction = 0.7"), old);
        assert_ne!(of(2, "friction = 0.5"), old);
        assert_ne!(family("[contact]\nfriction = 0.7\n", 13), old);
    }
}
