//! `phases`: writes the table of stick and slip phases.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use crate::printer::Printer;
use crate::results::Results;
use gshear_analysis::moments::mean;
use gshear_analysis::phases::{self, Phase, PhaseKind};
use gshear_analysis::tau::{TauReading, WallForces};
use gshear_dem::failure::Result;
use gshear_store::csv_table::Table;
use gshear_store::run_reader::RunFile;

/// Write the stick and slip phases of τ into phases.csv
///
/// A phase is a maximal monotone run of τ in the time series. Durations t_p are counted in
/// intervals Δγ of the series. The options change what τ is; Lee & Hurley leave that open.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder that holds one
    pub run: PathBuf,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Shear strain from which on phases are found
    #[arg(long, value_name = "STRAIN", default_value_t = 0.0, value_parser = super::strain)]
    from: f64,
    /// N in τ = S/N
    #[arg(long, value_enum, default_value_t = NormalForce::Measured)]
    normal_force: NormalForce,
    /// Take every Nth row of the time series as the end of an interval
    #[arg(long, value_name = "N", default_value_t = NonZeroUsize::MIN)]
    every: NonZeroUsize,
    /// Take ⟨S⟩/⟨N⟩ over the rows of an interval as τ
    #[arg(long)]
    average: bool,
    /// Round τ to multiples of this
    #[arg(long, value_name = "UNIT", value_parser = super::positive)]
    round: Option<f64>,
}

/// The normal force in τ = S/N.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum NormalForce {
    /// That of the free grains on the top wall
    Measured,
    /// That imposed on it
    Imposed,
}

impl Arguments {
    /// # Errors
    /// A run with a free surface, or without an imposed normal force, if that is asked for; a file
    /// that cannot be written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = RunFile::open_sheared(&self.run)?;
        let series = run.series();
        let shear = series.column("shear_force");
        let normal = match self.normal_force {
            NormalForce::Measured => series.column("normal_force").to_vec(),
            NormalForce::Imposed => imposed(&run)?,
        };
        let all = series.column("strain");
        let first = phases::onset(all, self.from);
        let reading = TauReading {
            every: self.every,
            average: self.average,
            round: self.round,
        };
        let (rows, tau) = reading.of(WallForces {
            shear: &shear[first..],
            normal: &normal[first..],
        });
        let rows: Vec<usize> = rows.into_iter().map(|row| first + row).collect();
        let strain: Vec<f64> = rows.iter().map(|row| all[*row]).collect();
        let phases = phases::find(&strain, &tau);
        summary(&phases, rows.len().saturating_sub(1), printer)?;
        let results = Results::of(self.out.as_deref(), run.folder());
        results.table("phases.csv", &table(&phases, &rows, &series.step), printer)
    }
}

/// The normal force that the run imposed on every row.
fn imposed(run: &RunFile) -> Result<Vec<f64>> {
    const IMPOSED: &str = "imposed_normal_force";
    let series = run.series();
    if series.has(IMPOSED) {
        return Ok(series.column(IMPOSED).to_vec());
    }
    let imposed = run.number("normal_force").ok_or_else(|| {
        run.wrong("parameters/normal_force is missing: use --normal-force measured")
    })?;
    Ok(vec![imposed; series.rows()])
}

/// Returns one line per phase. `rows`: the rows of the time series in which it was found.
fn table(found: &[Phase], rows: &[usize], step: &[u64]) -> String {
    Table::of(found.iter().enumerate())
        .column("phase", |(k, _)| *k)
        .column("kind", |(_, phase)| phase.kind.name())
        .column("length", |(_, phase)| phase.length_name())
        .column("start_row", |(_, phase)| rows[phase.start])
        .column("end_row", |(_, phase)| rows[phase.end])
        .column("start_step", |(_, phase)| step[rows[phase.start]])
        .column("end_step", |(_, phase)| step[rows[phase.end]])
        .columns(["start_strain", "end_strain"], |(_, phase)| phase.strain)
        .column("t_p", |(_, phase)| phase.duration())
        .column("t_p_strain", |(_, phase)| phase.duration_strain())
        .column("delta_tau_p", |(_, phase)| phase.change)
        .csv()
}

fn summary(found: &[Phase], intervals: usize, printer: &mut Printer) -> Result<()> {
    writeln!(
        printer,
        "{:<8}{:>10}{:>10}{:>16}{:>16}",
        "phases", "number", "long", "mean |Δτ_p|", "mean t_p/Δγ"
    )?;
    for kind in [PhaseKind::Stick, PhaseKind::Slip] {
        let phases: Vec<&Phase> = found.iter().filter(|phase| phase.kind == kind).collect();
        let changes: Vec<f64> = phases.iter().map(|phase| phase.change.abs()).collect();
        let durations: Vec<f64> = (phases.iter())
            .map(|phase| phase.duration() as f64)
            .collect();
        let (change, duration) = (mean(&changes), mean(&durations));
        let long = phases.iter().filter(|phase| phase.is_long()).count();
        writeln!(
            printer,
            "{:<8}{:>10}{long:>10}{change:>16.3e}{duration:>16.2}",
            kind.name(),
            phases.len()
        )?;
    }
    if intervals > 0 {
        let per_interval = found.len() as f64 / intervals as f64;
        writeln!(
            printer,
            "per interval: {per_interval:.4} phases, {:.4} cycles of a stick and a slip ({intervals} intervals)",
            0.5 * per_interval
        )?;
    }
    if let Some(drop) = phases::largest_drop(found) {
        writeln!(
            printer,
            "largest drop: Δτ_p = {:.4e} from γ = {:.6e} to {:.6e}",
            drop.change, drop.strain[0], drop.strain[1]
        )?;
    }
    Ok(())
}
