//! The lengths of a cell without walls along its lateral axes, as stresses or strains change them.

use serde::{Deserialize, Serialize};

use super::{Piston, Servo};
use crate::dimension::Dimension;
use crate::protocol::{Lateral, LateralAxis, Protocol, Segment};
use crate::state::{Cell, strained};

/// The lengths of a cell along the axes across its height, L_x and in 3D L_y. A stress moves a
/// length as the load moves the height: m_a d²L_a/dt² = A_a (σ_aa - P_a), or by a servo. A_a is the
/// area across the axis at the start, as the base is for the height.
#[derive(Debug, Clone)]
pub struct LateralLengths {
    /// How the lengths move.
    pub state: LateralState,
    /// The areas across the axes at the start (m²; m in 2D).
    areas: [f64; 2],
    /// The base of the cell at the start (m²; m in 2D).
    base: f64,
    /// What moves each length under a stress. `None`: its mass does.
    servos: Option<[Servo; 2]>,
    /// How far each length grew in the last step (m).
    pub grew: [f64; 2],
}

/// The lengths of a cell across its height, in a checkpoint. SI units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LateralState {
    /// Along x, and in 3D along y: lengths, their velocities and accelerations, masses, loads.
    pub axes: Vec<Piston>,
    /// The Lees–Edwards offset with all periods that were taken from it.
    pub unwrapped_offset: f64,
}

impl LateralState {
    /// The lengths of a cell at rest below a top of this height, mass and base, of which each gets
    /// the mass that gives it the same frequency.
    pub fn at_rest<D: Dimension>(cell: &Cell, top: &Piston) -> Self {
        let axes = cell.periods[..D::UP].iter().map(|length| {
            let ratio = top.height / length;
            Piston {
                height: *length,
                velocity: 0.0,
                acceleration: 0.0,
                mass: top.mass * ratio * ratio,
                load: 0.0,
            }
        });
        Self {
            axes: axes.collect(),
            unwrapped_offset: cell.sheared.map_or(0.0, |sheared| sheared.offset),
        }
    }

    /// The cell with these lengths.
    pub fn in_cell(&self, cell: Cell) -> Cell {
        let mut cell = cell;
        for (period, axis) in cell.periods.iter_mut().zip(&self.axes) {
            *period = axis.height;
        }
        cell
    }

    /// Its part of the state that the digest covers.
    pub fn numbers(&self) -> Vec<f64> {
        let axes = self.axes.iter();
        let numbers = axes.flat_map(|axis| [axis.height, axis.velocity, axis.acceleration]);
        numbers.collect()
    }
}

/// The stresses of a cell (Pa).
#[derive(Debug, Clone, Copy)]
pub(super) struct CellStresses {
    /// Along the lateral axes; 0 along one that 2D lacks.
    pub lateral: [f64; 2],
    /// The mean of all.
    pub mean: f64,
}

impl LateralLengths {
    /// The lengths of a cell of these lengths along the lateral axes and of this height at the
    /// start (m). `servo`: of the height, if it has one.
    pub fn new(state: LateralState, start: &[f64], height: f64, servo: Option<Servo>) -> Self {
        let base: f64 = start.iter().product();
        let mut areas = [0.0; 2];
        for (area, length) in areas.iter_mut().zip(start) {
            *area = base / length * height;
        }
        // The same rate of strain for the same error of the stress.
        let of_axis = |servo: Servo, axis: usize| {
            let ratio = start.get(axis).map_or(1.0, |length| length / height);
            Servo {
                gain: servo.gain * (base / areas[axis]) * ratio,
                fastest: servo.fastest * ratio,
            }
        };
        Self {
            state,
            areas,
            base,
            servos: servo.map(|servo| [0, 1].map(|axis| of_axis(servo, axis))),
            grew: [0.0; 2],
        }
    }

    /// The base of the cell now (m²; m in 2D).
    fn base_now(&self) -> f64 {
        self.state.axes.iter().map(|axis| axis.height).product()
    }

    /// The stresses (Pa) by the forces on top and sides (N; N/m in 2D) of a cell this high (m).
    pub(super) fn stresses(&self, up: f64, lateral: [f64; 2], height: f64) -> CellStresses {
        let base = self.base_now();
        let up = up / base;
        let mut stresses = [0.0; 2];
        for ((stress, force), axis) in stresses.iter_mut().zip(lateral).zip(&self.state.axes) {
            *stress = force * axis.height / (base * height);
        }
        let axes = 1 + self.state.axes.len();
        CellStresses {
            lateral: stresses,
            mean: (up + stresses[0] + stresses[1]) / axes as f64,
        }
    }

    /// A force on the top (N; N/m in 2D) as the stress times the base at the start.
    pub(super) fn of_base_at_start(&self, force: f64) -> f64 {
        force * (self.base / self.base_now())
    }

    /// A stress (Pa) times the base at the start (N; N/m in 2D).
    pub(super) fn on_top(&self, stress: f64) -> f64 {
        stress * self.base
    }

    /// Whether the lengths follow the height in a segment, and the load is of the mean stress.
    pub(super) fn is_isotropic(segment: &Segment) -> bool {
        matches!(segment.imposed.lateral, Some(Lateral::Isotropic))
    }

    /// What moves the length along an axis in a segment, but for one that follows the height.
    fn axis_in(segment: &Segment, axis: usize) -> LateralAxis {
        match segment.imposed.lateral {
            Some(Lateral::Axes(axes)) => axes[axis],
            Some(Lateral::Isotropic) | None => LateralAxis::Fixed,
        }
    }

    /// The load on an axis (N; N/m in 2D) after so many steps of the protocol, if it has one.
    fn load(&self, segment: &Segment, axis: usize, step: u64) -> Option<f64> {
        match Self::axis_in(segment, axis) {
            LateralAxis::Stress(course) => {
                let stress = course.at(step - segment.first, segment.planned);
                Some(stress * self.areas[axis])
            }
            LateralAxis::Fixed | LateralAxis::Strain(_) => None,
        }
    }

    /// The natural strain of an axis in each step of a segment, compression positive.
    fn strain_of_step(segment: &Segment, axis: usize) -> f64 {
        match Self::axis_in(segment, axis) {
            LateralAxis::Strain(strain) => strain / segment.planned as f64,
            LateralAxis::Fixed | LateralAxis::Stress(_) => 0.0,
        }
    }

    /// Computes the accelerations before the first step.
    pub(super) fn start(&mut self, stresses: &CellStresses, protocol: &Protocol) {
        self.load_anew(stresses, protocol.segment(0), None, 0);
    }

    /// Moves the lengths by a step (s) after so many steps of the protocol, in which the height
    /// becomes `ratio` times as great. Returns by what factor each length grows.
    pub(super) fn drift(
        &mut self,
        step: f64,
        now: u64,
        protocol: &Protocol,
        ratio: f64,
    ) -> [f64; 2] {
        let segment = protocol.segment(now);
        let mut stretches = [1.0; 2];
        let axes = self.state.axes.iter_mut().enumerate();
        for ((axis, piston), (stretch, grew)) in axes.zip(stretches.iter_mut().zip(&mut self.grew))
        {
            let before = piston.height;
            match Self::axis_in(segment, axis) {
                _ if Self::is_isotropic(segment) => piston.height *= ratio,
                LateralAxis::Fixed => {}
                LateralAxis::Stress(_) => piston.half_kick_and_drift(step),
                LateralAxis::Strain(_) => {
                    piston.height = strained(piston.height, Self::strain_of_step(segment, axis));
                }
            }
            *grew = piston.height - before;
            *stretch = piston.height / before;
        }
        stretches
    }

    /// The rates at which the lengths grow over the lengths (1/s) at the end of a step (s), after
    /// the drift. `top`: that of the height.
    pub(super) fn predicted(&self, step: f64, now: u64, protocol: &Protocol, top: f64) -> [f64; 2] {
        let segment = protocol.segment_before(now);
        let mut rates = [0.0; 2];
        for ((axis, piston), rate) in self.state.axes.iter().enumerate().zip(&mut rates) {
            *rate = match Self::axis_in(segment, axis) {
                _ if Self::is_isotropic(segment) => top,
                LateralAxis::Fixed => 0.0,
                LateralAxis::Stress(_) => piston.predicted(step) / piston.height,
                LateralAxis::Strain(_) => -Self::strain_of_step(segment, axis) / step,
            };
        }
        rates
    }

    /// Second half kick after so many steps of the protocol, by the stresses. `top`: the rate at
    /// which the height grows over the height (1/s).
    pub(super) fn kick(
        &mut self,
        step: f64,
        stresses: &CellStresses,
        now: u64,
        protocol: &Protocol,
        top: f64,
    ) {
        let (last, next) = (protocol.segment_before(now), protocol.segment(now));
        for axis in 0..self.state.axes.len() {
            let load = self.load(last, axis, now);
            let servo = self.servos.map(|servos| servos[axis]);
            let force = stresses.lateral[axis] * self.areas[axis];
            let piston = &mut self.state.axes[axis];
            match load {
                Some(load) => {
                    piston.load = load;
                    piston.kick_up(servo, step, force);
                }
                None => {
                    let rate = if Self::is_isotropic(last) {
                        top
                    } else {
                        -Self::strain_of_step(last, axis) / step
                    };
                    (piston.velocity, piston.acceleration) = (rate * piston.height, 0.0);
                }
            }
        }
        self.load_anew(stresses, next, Some(last), now);
    }

    /// Gives the axes the loads of the next segment, and the accelerations by these.
    fn load_anew(
        &mut self,
        stresses: &CellStresses,
        next: &Segment,
        last: Option<&Segment>,
        now: u64,
    ) {
        for axis in 0..self.state.axes.len() {
            let Some(load) = self.load(next, axis, now) else {
                continue;
            };
            let before = last.and_then(|last| self.load(last, axis, now));
            let servo = self.servos.map(|servos| servos[axis]);
            let force = stresses.lateral[axis] * self.areas[axis];
            let piston = &mut self.state.axes[axis];
            piston.load = load;
            piston.accelerate(servo, force, before != Some(load));
        }
    }
}
