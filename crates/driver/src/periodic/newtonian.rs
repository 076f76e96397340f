//! Newton's equations from the last state at rest: the growth of a complex pair (BO section IV).

use bytemuck::{Pod, Zeroable};

use super::observe::observe;
use super::record::NewtonianRecorder;
use super::spectrum::Whole;
use super::{Header, Pair, PeriodicRun};
use gshear_scene::Newtonian;
use gshear_dem::kernel::PairForce;
use gshear_dem::dimension::Dimension;
use gshear_mpi_exchange::Parallel;
use gshear_dem::drive::NoWalls;
use gshear_dem::failure::Failure;
use gshear_store::collective::gathered;
use gshear_dem::kernel::ContactForces;
use crate::run::Ending;
use gshear_dem::state::{GrainState, Travel};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::System;

/// Without a pair, its growth time is taken to be so many steps.
const STEPS_WITHOUT_A_PAIR: f64 = 1000.0;

impl PeriodicRun<'_> {
    pub(super) fn newtonian<D: Dimension>(
        &self,
        system: &mut System<D>,
        law: &dyn PairForce<D>,
        of: &Newtonian,
        header: &Header,
        travels: Option<&[Travel]>,
    ) -> Result<Ending, Failure> {
        let progress = &header.progress;
        let (exchange, scene) = (self.exchange, self.scene);
        let step = system.step;
        let steps = match &progress.pair {
            Some(pair) => (of.growth_times / pair.omega_i / step).ceil(),
            None => (of.growth_times * STEPS_WITHOUT_A_PAIR).ceil(),
        } as u64;
        let every = |count: u64| match count {
            0 => u64::MAX,
            count => (steps / count).max(1),
        };
        let dense = progress.pair.map(|pair| Dense::new(&pair, steps, step));
        let spectra = every(of.spectra);
        let frames = match (&progress.pair, every(of.frames)) {
            (Some(pair), request) if request != u64::MAX => strobe(pair, request, step),
            (_, request) => request,
        };
        // All rows lie at multiples of the dense ones' interval, so that none is between two of them.
        let grid = dense.as_ref().map_or(1, |dense| dense.every);
        let rows = every(of.rows).div_ceil(grid).saturating_mul(grid);
        let mut out = NewtonianRecorder::open(exchange, scene, system, &self.options.out, header)?;
        self.terminal.newtonian(steps, step);
        let mut motion = match travels {
            Some(travels) => Motion::resume(exchange, system, travels),
            None => {
                system.rebuild(exchange, law, &mut NoWalls)?;
                initial_forces(exchange, system, law, &mut NoWalls, None)?;
                Motion::begin(system)
            }
        };
        let mut samples = ContactForces::default();
        let first = header.newtonian.map_or(0, |moving| moving.steps + 1);
        for done in first..=steps {
            let mut stop = false;
            if done > 0 {
                let last = self.options.stop_at == Some(progress.steps + done);
                let request = StepRequest {
                    samples: None,
                    stop: last || self.asked_here(),
                };
                stop = advance(exchange, system, law, &mut NoWalls, request)?;
                motion.turn(exchange, system);
            }
            let time = done as f64 * step;
            let oscillation = dense.as_ref().is_some_and(|dense| dense.due(done));
            let (row, frame) = (done % rows == 0 || oscillation, done % frames == 0);
            if row || frame {
                let observed = observe(exchange, system, law, &mut samples, scene.sample.grains);
                if row {
                    out.row(
                        exchange,
                        done,
                        time,
                        &observed,
                        &motion.measure(exchange, system),
                    )?;
                }
                if frame {
                    out.frame(exchange, system, law, &samples, done, time)?;
                }
            }
            if spectra != u64::MAX && done % spectra == 0 {
                let whole = Whole::gather(exchange, system, law);
                out.spectrum(
                    exchange,
                    time,
                    &whole.eigenvalues::<D>(exchange, system, law)?,
                )?;
            }
            if stop && done < steps || row && out.saves.due(exchange) {
                let travels = motion.travels.clone();
                out.checkpoint(exchange, system, law, header, done, travels)?;
            }
            if stop && done < steps {
                self.terminal.stopped(&self.options.out, "newtonian", done);
                return Ok(Ending::Stopped);
            }
        }
        let digest = out.finish(exchange, system, law, steps)?;
        self.terminal.moved(&digest, &self.options.out);
        Ok(Ending::Done)
    }
}

/// Steps between frames, about as many as `request`, but a 24th of a period of the pair more than whole ones: frame by frame, the
/// oscillation is seen slowed down.
fn strobe(pair: &Pair, request: u64, step: f64) -> u64 {
    let period = std::f64::consts::TAU / pair.omega_r / step;
    let whole = (request as f64 / period).round();
    ((whole + 1.0 / 24.0) * period).round().max(1.0) as u64
}

/// Two stretches in which rows lie so densely that they show the oscillation of the pair.
struct Dense {
    begins: [u64; 2],
    length: u64,
    every: u64,
}

impl Dense {
    /// Where they begin, over the whole stage; periods of the mean square displacement, π/ω_r, in each; rows in each period.
    const BEGINS: [f64; 2] = [0.5, 0.7];
    const PERIODS: f64 = 20.0;
    const ROWS: f64 = 16.0;

    fn new(pair: &Pair, steps: u64, step: f64) -> Self {
        let period = std::f64::consts::PI / pair.omega_r / step;
        let every = ((period / Self::ROWS) as u64).max(1);
        Self {
            begins: Self::BEGINS.map(|part| (part * steps as f64) as u64 / every * every),
            length: (Self::PERIODS * period) as u64,
            every,
        }
    }

    fn due(&self, step: u64) -> bool {
        let of = |begin: u64| {
            let since = step.checked_sub(begin);
            since.is_some_and(|since| since <= self.length && since % self.every == 0)
        };
        self.begins.into_iter().any(of)
    }
}

/// How the grains have moved since the start.
struct Motion {
    /// Of the own grains, in their order.
    travels: Vec<Travel>,
    /// Rebuilds of the list, at which grains change hands.
    rebuilds: u64,
}

/// Sums over the grains.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Moved {
    pub id: u64,
    /// Mean of |Δr|² + R² |Δθ|² (BO eq. 10).
    pub msd: f64,
    pub kinetic_energy: f64,
}

impl Motion {
    fn begin<D: Dimension>(system: &mut System<D>) -> Self {
        let at_rest = |g: &GrainState| Travel {
            id: g.id,
            body: g.body,
            start: g.position,
            angle: [0.0; 3],
        };
        Self {
            travels: system.grain_states().iter().map(at_rest).collect(),
            rebuilds: system.list.rebuilds,
        }
    }

    /// From all grains' travels, over the ranks in any order.
    fn resume<D: Dimension>(
        exchange: &dyn Parallel,
        system: &mut System<D>,
        travels: &[Travel],
    ) -> Self {
        let all = gathered(exchange, travels, |travel| travel.id);
        let grains = system.grains();
        let own = grains.id[..grains.owned].iter();
        Self {
            travels: own.map(|&id| all[id as usize]).collect(),
            rebuilds: system.list.rebuilds,
        }
    }

    /// The turns of the step that is done.
    fn turn<D: Dimension>(&mut self, exchange: &dyn Parallel, system: &mut System<D>) {
        if self.rebuilds != system.list.rebuilds {
            *self = Self::resume(exchange, system, &self.travels);
        }
        let step = system.step;
        let grains = system.grains();
        for (g, travel) in self.travels.iter_mut().enumerate() {
            let fields = grains.fields(g);
            for k in 0..D::SPINS {
                travel.angle[k] += step * fields[D::HALF_SPIN + k];
            }
        }
    }

    fn measure<D: Dimension>(&self, exchange: &dyn Parallel, system: &mut System<D>) -> Moved {
        let cell = system.cell;
        let grains = system.grains();
        let square = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let own: Vec<Moved> = self
            .travels
            .iter()
            .enumerate()
            .map(|(g, travel)| {
                let (fields, radius) = (grains.fields(g), grains.radius[g]);
                let moved = square(&cell.separation::<D>(fields, &travel.start));
                let velocity = square(&fields[D::VELOCITY..D::VELOCITY + D::AXES]);
                let spin = square(&fields[D::SPIN..D::SPIN + D::SPINS]);
                Moved {
                    id: travel.id.into(),
                    msd: moved + radius * radius * square(&travel.angle),
                    kinetic_energy: 0.5
                        * grains.mass[g]
                        * (velocity + D::INERTIA * radius * radius * spin),
                }
            })
            .collect();
        let all = gathered(exchange, &own, |moved| moved.id);
        Moved {
            id: 0,
            msd: all.iter().map(|m| m.msd).sum::<f64>() / all.len() as f64,
            kinetic_energy: all.iter().map(|m| m.kinetic_energy).sum(),
        }
    }
}
