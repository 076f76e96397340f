//! `events`: clusters of D²min in space and time, what they release, and their propagator.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::PathBuf;
use std::str::FromStr;

use super::dmin::Rattlers;
use super::figure_arguments::FigureArguments;
use crate::frame_pairs::{self, DminOfPairs, FramePair, PairWork};
use crate::printer::Printer;
use crate::results::{Results, vector_columns};
use gshear_analysis::dmin::{NonAffine, RADIUS};
use gshear_analysis::events::propagator::{Harmonic, Mode, Phase, Propagator, Quantity};
use gshear_analysis::events::{
    ActiveInterval, Event, Links, PairCount, Surroundings, find, pair_counts,
};
use gshear_analysis::rattlers::RattlerRule;
use gshear_dem::failure::Result;
use gshear_dem::state::Frame;
use gshear_report::drawing;
use gshear_report::events::{self as figures, EventMark};
use gshear_store::csv_table::Table;
use gshear_store::run_reader::{FrameFields, RunFile};

/// Greatest distance over the mean diameter in the table of pairs.
const RINGS: usize = 20;

/// Write the events of a run: clusters of D²min in space and time, and their propagator
///
/// A free grain is active in an interval between two frames if its D²min is at least a threshold:
/// by default that of the greatest hundredth of all D²min of the run. Active grains that touch or
/// are within 1.5 mean diameters are one event, and so are those of intervals that follow each
/// other. events.csv: one line per event, with its time, place, size, strain and stress drop.
/// events-grains.csv: its active grains. events-propagator.csv: harmonics of the mean displacement
/// and the mean change of stress around an event, events-map.csv their map; events-pairs.csv: pairs
/// of events by their distance in space and time. Figures: events, events-sizes,
/// events-displacement, events-stress, events-propagator.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A run.h5, or the folder of a run; run.h5/aqs, run.h5/newtonian or run.h5/shear for a later
    /// stage
    pub run: PathBuf,
    /// Folder to write into [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Share of all D²min of free grains, the greatest ones, that are active
    #[arg(long, value_name = "SHARE", default_value_t = 0.01, value_parser = share)]
    share: f64,
    /// D²min from which on a grain is active, over the square of the mean radius, instead
    /// of a share
    #[arg(long, value_name = "D2MIN", value_parser = super::positive, conflicts_with = "share")]
    threshold: Option<f64>,
    /// Farthest distance of the centres of two grains that are linked, in mean diameters; those
    /// that touch are, too
    #[arg(long, value_name = "R", default_value_t = 1.5, value_parser = super::positive)]
    reach: f64,
    /// Most intervals without activity within an event
    #[arg(long, value_name = "N", default_value_t = 0)]
    gap: usize,
    /// Numbers of grains of the events that count for the propagator and the pairs: from A to B,
    /// both included, or from A on [default: 1..]
    #[arg(
        long,
        value_name = "A..[B]",
        default_value = "1..",
        hide_default_value = true
    )]
    grains: GrainCounts,
    /// Take every Nth frame
    #[arg(long, value_name = "N", default_value_t = NonZeroUsize::MIN)]
    every: NonZeroUsize,
    /// Shear strain of the first frame
    #[arg(long, value_name = "STRAIN", value_parser = super::strain)]
    from: Option<f64>,
    /// Cutoff of the neighbours of D²min in the earlier frame, in mean radii
    #[arg(long, value_name = "R", default_value_t = RADIUS, value_parser = super::positive)]
    radius: f64,
    /// Which grains are neither centres nor neighbours of D²min
    #[arg(long, value_enum, default_value_t = Rattlers::LeeHurley)]
    rattlers: Rattlers,
    #[command(flatten)]
    figures: FigureArguments,
}

/// A range of numbers of grains, both ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct GrainCounts {
    fewest: usize,
    most: usize,
}

impl GrainCounts {
    fn include(&self, event: &Event) -> bool {
        (self.fewest..=self.most).contains(&event.grains)
    }
}

impl FromStr for GrainCounts {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let counts = text.split_once("..").and_then(|(fewest, most)| {
            let most = if most.is_empty() {
                usize::MAX
            } else {
                most.parse().ok()?
            };
            let fewest = fewest.parse().ok()?;
            (1..=most)
                .contains(&fewest)
                .then_some(Self { fewest, most })
        });
        counts.ok_or_else(|| "write A.. or A..B: numbers of grains, from 1 on".into())
    }
}

/// Parses a share of the values.
fn share(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if value > 0.0 && value <= 1.0 => Ok(value),
        _ => Err("must be a share above 0, at most 1, such as 0.01".into()),
    }
}

/// An event, with the stress that it releases.
struct ReleasingEvent {
    event: Event,
    /// Fall of the shear stress (Pa) and of the stress ratio; NaN until it is known.
    stress_drop: f64,
    stress_ratio_drop: f64,
}

/// A run, and the frames that are taken.
struct Taken<'a> {
    run: &'a RunFile,
    frames: Vec<usize>,
    /// γ of all frames.
    strains: Vec<f64>,
    /// By which rattlers are marked.
    rattlers: RattlerRule,
    /// Of the neighbourhood (m).
    radius: f64,
}

impl Arguments {
    /// # Errors
    /// A run with fewer than two frames, or without D²min; a damaged run; a file that cannot be
    /// written.
    pub fn run(&self, printer: &mut Printer) -> Result<()> {
        let run = &RunFile::open_any(&self.run)?;
        let results = Results::of(self.out.as_deref(), run.folder());
        let taken = self.taken(run)?;
        let active = taken.active(self, printer)?;
        let diameter = 2.0 * run.grains().mean_radius();
        let links = Links {
            reach: self.reach * diameter,
            gap: self.gap,
        };
        let events = find(run.grains(), &active.intervals, links, run.dimension());
        let mut propagator = Propagator::new(
            run.dimension(),
            (events.iter())
                .filter(|event| self.grains.include(event))
                .count(),
            diameter,
            reach_of(run),
        );
        let mut events: Vec<ReleasingEvent> = (events.into_iter())
            .map(|event| ReleasingEvent {
                event,
                stress_drop: f64::NAN,
                stress_ratio_drop: f64::NAN,
            })
            .collect();
        taken.release(&mut events, self.grains, &mut propagator)?;
        let harmonics = propagator.harmonics();
        let large: Vec<Event> = (events.iter())
            .map(|event| &event.event)
            .filter(|event| self.grains.include(event))
            .cloned()
            .collect();
        let intervals = taken.frames.len() - 1;
        let pairs = pair_counts(
            &large,
            intervals,
            run.cell(taken.frames[0]),
            run.dimension(),
            diameter,
            RINGS,
        );
        summary(&events, large.len(), &harmonics, intervals, printer)?;
        let axes = run.dimension().axes();
        let tables = [
            ("events.csv", taken.of_events(&events, active.threshold)),
            (
                "events-grains.csv",
                taken.of_grains(&events, &active.intervals),
            ),
            ("events-propagator.csv", of_harmonics(&harmonics)),
            ("events-map.csv", of_map(&propagator)),
            ("events-pairs.csv", of_pairs(&pairs, diameter)),
        ];
        for (name, csv) in &tables {
            results.table_in(axes, name, csv, printer)?;
        }
        let marks: Vec<EventMark> = (events.iter())
            .map(|event| taken.mark(&event.event))
            .collect();
        for (name, svg) in [
            ("events.svg", figures::in_strain(&marks, axes)),
            ("events-sizes.svg", figures::sizes(&marks)),
            (
                "events-displacement.svg",
                figures::displacement(&harmonics, diameter),
            ),
            ("events-stress.svg", figures::stress(&harmonics, diameter)),
            ("events-propagator.svg", figures::map(&propagator, diameter)),
        ] {
            let path = results.place(name)?;
            drawing::write(&path, &svg, &self.figures.formats)?;
            for format in &self.figures.formats {
                printer.wrote(&path.with_extension(format.ending()))?;
            }
        }
        Ok(())
    }

    /// Chooses the frames.
    fn taken<'a>(&self, run: &'a RunFile) -> Result<Taken<'a>> {
        let strains = run.frame_strains()?;
        let first = match self.from {
            Some(from) => {
                (strains.iter().position(|strain| *strain >= from)).unwrap_or(strains.len())
            }
            None => 0,
        };
        let frames: Vec<usize> = (first..run.frames()).step_by(self.every.get()).collect();
        if frames.len() < 2 {
            let from = self
                .from
                .map_or(String::new(), |from| format!(" from γ = {from} on"));
            return Err(run.wrong(format!(
                "has {} frames{from}, of which every {} is taken: events need two or more; give a lesser --from or --every, or run it with more frames (output.frame_strain)",
                run.frames().saturating_sub(first),
                self.every
            )));
        }
        Ok(Taken {
            run,
            frames,
            strains,
            rattlers: self.rattlers.rule(run),
            radius: self.radius * run.grains().mean_radius(),
        })
    }
}

/// The farthest distance around an event: half of the shortest side of the sample (m).
fn reach_of(run: &RunFile) -> f64 {
    let cell = run.cell(0);
    let across = match cell.sheared {
        Some(sheared) => sheared.height,
        None => run.height(),
    };
    let sides = cell.periods.into_iter().chain([across]);
    0.5 * sides
        .filter(|side| side.is_finite())
        .fold(f64::INFINITY, f64::min)
}

/// D²min of a free grain in an interval.
#[derive(Debug, Clone, Copy)]
struct GrainDmin {
    interval: usize,
    grain: u32,
    /// (m²)
    dmin: f64,
}

/// All active grains.
struct Active {
    intervals: Vec<ActiveInterval>,
    /// The least D²min of an active grain (m²).
    threshold: f64,
}

/// The greatest D²min of a run.
struct GreatestDmin {
    /// At most so many are kept.
    most: usize,
    kept: Vec<GrainDmin>,
    /// Number of all values.
    values: u64,
}

impl GreatestDmin {
    fn add(&mut self, value: GrainDmin) {
        self.kept.push(value);
        if self.kept.len() >= self.most.saturating_mul(2).max(1 << 16) {
            self.cut(self.most);
        }
    }

    /// Keeps the greatest ones, of equals the earlier.
    fn cut(&mut self, count: usize) {
        if count >= self.kept.len() {
            return;
        }
        self.kept.select_nth_unstable_by(count, |a, b| {
            let order = b.dmin.total_cmp(&a.dmin);
            order.then((a.interval, a.grain).cmp(&(b.interval, b.grain)))
        });
        self.kept.truncate(count);
    }
}

impl Taken<'_> {
    /// The pairs of frames that the intervals lie between.
    fn pairs(&self) -> Vec<[usize; 2]> {
        let pairs = self.frames.windows(2);
        pairs.map(|pair| [pair[0], pair[1]]).collect()
    }

    /// Finds the active grains.
    fn active(&self, arguments: &Arguments, printer: &mut Printer) -> Result<Active> {
        let grains = self.run.grains();
        let free = grains.body.iter().filter(|body| **body == 0).count();
        let square = grains.mean_radius().powi(2);
        let pairs = self.pairs();
        let least = arguments.threshold.map(|threshold| threshold * square);
        let mut greatest = GreatestDmin {
            most: match least {
                Some(_) => usize::MAX,
                None => (arguments.share * (free * pairs.len()) as f64).ceil() as usize,
            },
            kept: Vec::new(),
            values: 0,
        };
        let work = DminOfPairs {
            run: self.run,
            radius: self.radius,
            rattlers_by: self.rattlers,
        };
        frame_pairs::each(self.run, &pairs, &work, |first, rows| {
            for (k, (dmin, _)) in rows.iter().enumerate() {
                for (n, dmin) in dmin.iter().enumerate() {
                    if grains.body[n] != 0 || !dmin.is_finite() {
                        continue;
                    }
                    greatest.values += 1;
                    if least.is_none_or(|least| *dmin >= least) {
                        greatest.add(GrainDmin {
                            interval: first + k,
                            grain: n as u32,
                            dmin: *dmin,
                        });
                    }
                }
            }
            Ok(())
        })?;
        if greatest.values == 0 {
            return Err(self.run.wrong(
                "D²min is not defined for any free grain: all are rattlers or have too few neighbours; give --rattlers none or a greater --radius",
            ));
        }
        if arguments.threshold.is_none() {
            let count = (arguments.share * greatest.values as f64).round() as usize;
            greatest.cut(count.max(1));
        }
        let mut kept = greatest.kept;
        kept.sort_unstable_by_key(|value| (value.interval, value.grain));
        let threshold = match least {
            Some(least) => least,
            None => kept
                .iter()
                .map(|value| value.dmin)
                .fold(f64::INFINITY, f64::min),
        };
        writeln!(
            printer,
            "active from D²min = {threshold:.4e} m² = {:.4e} r̄² on: {} of {} values in {} intervals",
            threshold / square,
            kept.len(),
            greatest.values,
            pairs.len()
        )?;
        let work = ActiveGrains {
            taken: self,
            kept: &kept,
        };
        let with_any: BTreeSet<usize> = kept.iter().map(|value| value.interval).collect();
        let pairs: Vec<[usize; 2]> = with_any.into_iter().map(|k| pairs[k]).collect();
        let mut intervals = Vec::with_capacity(pairs.len());
        frame_pairs::each(self.run, &pairs, &work, |_, found| {
            intervals.extend(found);
            Ok(())
        })?;
        Ok(Active {
            intervals,
            threshold,
        })
    }

    /// The frames before and after an event.
    fn ends(&self, event: &Event) -> [usize; 2] {
        let [first, last] = event.intervals;
        [self.frames[first], self.frames[last + 1]]
    }

    /// Finds what the events release, and adds those that count to their propagator.
    fn release(
        &self,
        events: &mut [ReleasingEvent],
        counted: GrainCounts,
        propagator: &mut Propagator,
    ) -> Result<()> {
        let mut order: Vec<usize> = (0..events.len()).collect();
        order.sort_by_key(|k| self.ends(&events[*k].event));
        let mut pairs: Vec<[usize; 2]> =
            order.iter().map(|k| self.ends(&events[*k].event)).collect();
        pairs.dedup();
        let mut order = order.into_iter().peekable();
        let (mut number, mut pair) = (0, pairs.iter());
        frame_pairs::each(self.run, &pairs, &SurroundingsOfPairs(self), |_, found| {
            for (surroundings, ends) in found.iter().zip(pair.by_ref()) {
                while let Some(k) = order.next_if(|k| self.ends(&events[*k].event) == *ends) {
                    let event = &mut events[k];
                    event.stress_drop = surroundings.stress_drop;
                    event.stress_ratio_drop = surroundings.stress_ratio_drop;
                    if counted.include(&event.event) {
                        propagator.add(number, event.event.place, &surroundings.change);
                        number += 1;
                    }
                }
            }
            Ok(())
        })
    }

    /// Returns one line per event.
    fn of_events(&self, events: &[ReleasingEvent], threshold: f64) -> String {
        let steps = self.run.frame_steps();
        let times = self.run.frame_times();
        let dimension = self.run.dimension();
        let axes = dimension.axes();
        let ends: Vec<[usize; 2]> = events.iter().map(|event| self.ends(&event.event)).collect();
        // Frames at the starts of the event before and of each event.
        let starts: Vec<Option<[usize; 2]>> = (0..events.len())
            .map(|k| Some([ends[k.checked_sub(1)?][0], ends[k][0]]))
            .collect();
        Table::of(events.iter().enumerate())
            .column("event", |(k, _)| *k)
            .columns(["start_frame", "end_frame"], |(k, _)| ends[*k])
            .columns(["start_step", "end_step"], |(k, _)| {
                ends[*k].map(|frame| steps[frame])
            })
            .columns(["start_time", "end_time"], |(k, _)| {
                ends[*k].map(|frame| times[frame])
            })
            .columns(["start_strain", "end_strain"], |(k, _)| {
                ends[*k].map(|frame| self.strains[frame])
            })
            .column("intervals", |(_, ReleasingEvent { event, .. })| {
                event.intervals[1] - event.intervals[0] + 1
            })
            .columns(vector_columns("", "", dimension), |(_, event)| {
                event.event.place.into_iter().take(axes)
            })
            .column("grains", |(_, event)| event.event.grains)
            .columns(vector_columns("extent_", "", dimension), |(_, event)| {
                event.event.extent.into_iter().take(axes)
            })
            .column("gyration", |(_, event)| event.event.gyration)
            .column("dmin_greatest", |(_, event)| event.event.dmin_greatest)
            .column("dmin_sum", |(_, event)| event.event.dmin_sum)
            .column("strain_sum", |(_, event)| event.event.strain_sum)
            .column("shear_strain_sum", |(_, event)| {
                event.event.shear_strain_sum
            })
            .column("stress_drop", |(_, event)| event.stress_drop)
            .column("stress_ratio_drop", |(_, event)| event.stress_ratio_drop)
            .column("waiting_time", |(k, _)| waiting(starts[*k], times))
            .column("waiting_strain", |(k, _)| {
                waiting(starts[*k], &self.strains)
            })
            .column("threshold", |_| threshold)
            .csv()
    }

    /// Returns one line per active grain of every event.
    fn of_grains(&self, events: &[ReleasingEvent], active: &[ActiveInterval]) -> String {
        let axes = self.run.dimension().axes();
        let rows = events.iter().enumerate().flat_map(|(k, event)| {
            let members = event.event.members.iter();
            members.map(move |[interval, grain]| {
                let interval = &active[*interval];
                (k, interval.number, interval.grains[*grain])
            })
        });
        Table::of(rows)
            .column("event", |(k, ..)| *k)
            .columns(["start_frame", "end_frame"], |(_, interval, _)| {
                [*interval, interval + 1].map(|k| self.frames[k])
            })
            .column("grain", |(.., grain)| grain.grain)
            .columns(
                vector_columns("", "", self.run.dimension()),
                |(.., grain)| grain.from.into_iter().take(axes),
            )
            .column("dmin", |(.., grain)| grain.dmin)
            .column("strain", |(.., grain)| grain.strain.invariant)
            .column("shear_strain", |(.., grain)| grain.strain.along)
            .csv()
    }

    /// What figures show of an event.
    fn mark(&self, event: &Event) -> EventMark {
        let [start, _] = self.ends(event);
        EventMark {
            strain: self.strains[start],
            time: self.run.frame_times()[start],
            height: event.place[self.run.dimension().axes() - 1],
            grains: event.grains,
            strain_sum: event.strain_sum,
        }
    }
}

/// The active grains of pairs of frames.
struct ActiveGrains<'a> {
    taken: &'a Taken<'a>,
    /// In order of interval and grain.
    kept: &'a [GrainDmin],
}

impl PairWork for ActiveGrains<'_> {
    type Frame = Frame;
    type Buffer = NonAffine;
    type Value = ActiveInterval;

    fn read(&self, range: Range<usize>) -> Result<Vec<Frame>> {
        self.taken.run.records_with(range, FrameFields::Pairs)
    }

    fn value(&self, non_affine: &mut NonAffine, pair: FramePair<'_, Frame>) -> ActiveInterval {
        let run = self.taken.run;
        let interval = run.interval(pair.numbers, pair.frames);
        let number = self
            .taken
            .frames
            .partition_point(|frame| *frame < pair.numbers[0]);
        let first = self.kept.partition_point(|value| value.interval < number);
        let of_interval = self.kept[first..].iter();
        let dmin: Vec<(u32, f64)> = of_interval
            .take_while(|value| value.interval == number)
            .map(|value| (value.grain, value.dmin))
            .collect();
        let ids: Vec<u32> = dmin.iter().map(|(grain, _)| *grain).collect();
        non_affine.rattlers_by = self.taken.rattlers;
        let strains = non_affine.strains(run.grains(), &interval, self.taken.radius, &ids);
        ActiveInterval::new(number, &interval, &dmin, &strains)
    }
}

/// From one frame to the other; NaN without an event before.
fn waiting(starts: Option<[usize; 2]>, times: &[f64]) -> f64 {
    starts.map_or(f64::NAN, |[before, now]| times[now] - times[before])
}

/// What happens between the frames of pairs.
struct SurroundingsOfPairs<'a>(&'a Taken<'a>);

impl PairWork for SurroundingsOfPairs<'_> {
    type Frame = Frame;
    type Buffer = ();
    type Value = Surroundings;

    fn read(&self, range: Range<usize>) -> Result<Vec<Frame>> {
        self.0.run.records_with(range, FrameFields::Forces)
    }

    fn value(&self, (): &mut (), pair: FramePair<'_, Frame>) -> Surroundings {
        let run = self.0.run;
        let interval = run.interval(pair.numbers, pair.frames);
        Surroundings::of(run.grains(), &interval, self.0.rattlers)
    }
}

/// Returns one line per quantity, ring and order.
fn of_harmonics(harmonics: &[Harmonic]) -> String {
    Table::of(harmonics)
        .column("quantity", |harmonic| harmonic.quantity.name())
        .column(
            "range",
            |harmonic| if harmonic.is_far { "far" } else { "ring" },
        )
        .columns(["from", "to"], |harmonic| harmonic.ring)
        .column("at", |harmonic| harmonic.at)
        .column("order", |harmonic| harmonic.order)
        .columns(["cos", "cos_error"], |harmonic| harmonic.cos)
        .columns(["sin", "sin_error"], |harmonic| harmonic.sin)
        .column("grains", |harmonic| harmonic.grains)
        .csv()
}

fn of_map(propagator: &Propagator) -> String {
    Table::of(propagator.map())
        .columns(["flow", "gradient"], |cell| cell.place)
        .columns(["u_flow", "u_gradient"], |cell| cell.displacement)
        .column("shear_stress", |cell| cell.shear)
        .column("pressure", |cell| cell.pressure)
        .column("grains", |cell| cell.grains)
        .csv()
}

fn of_pairs(pairs: &[PairCount], diameter: f64) -> String {
    Table::of(pairs)
        .columns(["lag_from", "lag_to"], |count| count.range.lag)
        .columns(["distance_from", "distance_to"], |count| {
            count.range.distance.map(|distance| distance / diameter)
        })
        .column("pairs", |count| count.pairs)
        .column("expected", |count| count.expected)
        .csv()
}

/// An amplitude of the far field that the summary prints.
struct FarField {
    what: &'static str,
    mode: Mode,
    unit: &'static str,
}

static FAR_FIELD: [FarField; 7] = [
    FarField {
        what: "radial displacement, sin 2θ",
        mode: Mode {
            quantity: Quantity::Radial,
            order: 2,
            phase: Phase::Sin,
        },
        unit: "m",
    },
    FarField {
        what: "radial displacement, all around",
        mode: Mode {
            quantity: Quantity::Radial,
            order: 0,
            phase: Phase::Cos,
        },
        unit: "m",
    },
    FarField {
        what: "tangential displacement, cos 2θ",
        mode: Mode {
            quantity: Quantity::Tangential,
            order: 2,
            phase: Phase::Cos,
        },
        unit: "m",
    },
    FarField {
        what: "tangential displacement, all around",
        mode: Mode {
            quantity: Quantity::Tangential,
            order: 0,
            phase: Phase::Cos,
        },
        unit: "m",
    },
    FarField {
        what: "change of the shear stress, cos 4θ",
        mode: Mode {
            quantity: Quantity::Shear,
            order: 4,
            phase: Phase::Cos,
        },
        unit: "Pa",
    },
    FarField {
        what: "change of the shear stress, all around",
        mode: Mode {
            quantity: Quantity::Shear,
            order: 0,
            phase: Phase::Cos,
        },
        unit: "Pa",
    },
    FarField {
        what: "change of the pressure, sin 2θ",
        mode: Mode {
            quantity: Quantity::Pressure,
            order: 2,
            phase: Phase::Sin,
        },
        unit: "Pa",
    },
];

/// Prints how many events there are, and their far field.
fn summary(
    events: &[ReleasingEvent],
    counted: usize,
    harmonics: &[Harmonic],
    intervals: usize,
    printer: &mut Printer,
) -> Result<()> {
    let most = events
        .iter()
        .map(|event| event.event.grains)
        .max()
        .unwrap_or_default();
    writeln!(
        printer,
        "{} events in {intervals} intervals, of up to {most} grains; {counted} count for the propagator",
        events.len()
    )?;
    let Some(far) = harmonics.iter().find(|harmonic| harmonic.is_far) else {
        return Ok(());
    };
    writeln!(
        printer,
        "mean far field from {:.3e} m to {:.3e} m, at {:.3e} m, with standard errors:",
        far.ring[0], far.ring[1], far.at
    )?;
    for FarField { what, mode, unit } in &FAR_FIELD {
        let mut far = harmonics.iter().filter(|harmonic| harmonic.is_far);
        let found = far.find_map(|harmonic| mode.amplitude(harmonic));
        let [value, error] = found.unwrap_or([f64::NAN; 2]);
        writeln!(printer, "  {what:<40}{value:>11.3e} ± {error:.1e} {unit}")?;
    }
    Ok(())
}
