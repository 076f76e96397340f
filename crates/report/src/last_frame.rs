//! Figures of the last frame of a packing that is seen from outside.

use gshear_analysis::dmin::{NonAffine, RADIUS};
use gshear_dem::failure::Result;
use gshear_dem::state::Frame;
use gshear_store::csv_table::Table;
use gshear_store::run_reader::{RunFile, RunStage};

use super::ReportFigure;
use super::frame_picture::{levels, velocities};
use super::packing::{Label, Packing};
use super::summary::shows_drops;
use super::text::marked;

/// The grains by the values of a quantity.
struct GrainFigure {
    /// Name of the files.
    name: &'static str,
    /// Column of the data.
    column: &'static str,
    label: Label,
    /// Ends the name of the quantity in the caption.
    when: String,
    /// `[N]`
    values: Vec<f64>,
    /// Ends of the scale.
    range: [f64; 2],
}

impl GrainFigure {
    fn drawn(&self, packing: &Packing<'_>, title: &str) -> ReportFigure {
        let (quantity, note) = (marked(self.label.name), packing.note());
        let caption = format!(
            "Grains of the last frame by their {quantity}{}. {note}",
            self.when
        );
        let svg = packing.grains(&self.values, self.range, self.label, title);
        ReportFigure::new(
            self.name,
            caption,
            svg,
            packing.table(self.column, &self.values),
        )
    }
}

/// Draws the last frame: grains by their velocity, by their displacement and D²min in the latter
/// half of the run, and the contact forces. Nothing for disks between walls, which have maps.
///
/// # Errors
/// If the run is damaged.
pub fn figures(run: &RunFile) -> Result<Vec<ReportFigure>> {
    let frames = run.frames();
    if shows_drops(run) || frames == 0 {
        return Ok(Vec::new());
    }
    let last = run.frame(frames - 1)?;
    let (packing, title) = (Packing::new(run, &last), format!("step {}", last.step));
    let mut pictures = Vec::new();
    // Strain steps end at rest.
    if run.stage() != RunStage::Strain {
        let values = velocities(&last);
        let velocity = GrainFigure {
            name: "grains-velocity",
            column: "velocity_x",
            label: Label::VELOCITY,
            when: String::new(),
            range: packing.range_of(&values),
            values,
        };
        pictures.push(velocity.drawn(&packing, &title));
    }
    if frames > 2 {
        let latter_half = latter_half(run, &last, &packing)?;
        pictures.extend(latter_half.map(|figure| figure.drawn(&packing, &title)));
    }
    if !last.contacts.is_empty() {
        pictures.push(forces(&last, &packing, &title));
    }
    Ok(pictures)
}

/// Displacement and D²min in the latter half of the run.
fn latter_half(run: &RunFile, last: &Frame, packing: &Packing<'_>) -> Result<[GrainFigure; 2]> {
    let numbers = [run.frames() / 2, run.frames() - 1];
    let earlier = run.frame(numbers[0])?;
    let interval = run.interval(numbers, [&earlier, last]);
    let when = " in the latter half of the run";
    let ids = 0..last.grains.len();
    let moved: Vec<f64> = ids.map(|n| interval.displacement(n)[0]).collect();
    let displacement = GrainFigure {
        name: "grains-displacement",
        column: "displacement_x",
        label: Label::DISPLACEMENT,
        when: when.into(),
        range: packing.range_of(&moved),
        values: moved,
    };
    let grains = run.grains();
    let (mut non_affine, mut dmin) = (NonAffine::default(), vec![f64::NAN; grains.count()]);
    let radius = RADIUS * grains.mean_radius();
    // Below a free surface pair by pair would round differently from earlier reports.
    non_affine.grain_by_grain(grains, &interval, radius, &mut dmin);
    let defined = non_affine.defined(grains, last, &dmin);
    let levels = levels(grains, &dmin);
    let dmin = GrainFigure {
        name: "grains-dmin",
        column: "log10_dmin_over_square",
        label: Label::DMIN,
        when: format!("{when}, {defined}"),
        range: packing.range_of_levels(&levels),
        values: levels,
    };
    Ok([displacement, dmin])
}

/// The normal forces of the contacts.
fn forces(last: &Frame, packing: &Packing<'_>, title: &str) -> ReportFigure {
    let data = Table::of(&last.contacts)
        .columns(["i", "j"], |c| [c.i, c.j])
        .column("contact_force", |c| c.normal_force)
        .csv();
    let name = match last.dimension.axes() {
        2 => "forces",
        _ => "forces-3d",
    };
    let caption = format!(
        "Normal forces of the last frame: lines between the centres, wider and darker for greater forces. {}",
        packing.note()
    );
    let svg = packing.forces(packing.greatest_force(), title);
    ReportFigure::new(name, caption, svg, data)
}
