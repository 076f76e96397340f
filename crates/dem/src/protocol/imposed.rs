//! What a segment of a protocol imposes on the walls.

use crate::wave::Wave;

/// What is imposed during a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imposed {
    /// Along x, on the top.
    pub along: Along,
    /// Along the normal of the top. `None`: the load of the piston stays as it is; either all
    /// segments of a protocol have it or none.
    pub normal: Option<Normal>,
    /// How the bottom vibrates, if it does.
    pub bottom: Vibration,
    /// The lengths of a cell without walls across its height, if they change; either all segments
    /// of a protocol have it or none.
    pub lateral: Option<Lateral>,
}

/// How the lengths of a cell without walls across its height change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lateral {
    /// All lengths change by the same factor, and the load is of the mean of the normal stresses.
    Isotropic,
    /// Along x, and in 3D along y.
    Axes([LateralAxis; 2]),
}

/// What is imposed along an axis across the height of a cell without walls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LateralAxis {
    /// The length stays.
    Fixed,
    /// The normal stress (Pa), compression positive.
    Stress(Course),
    /// The natural strain over the segment, compression positive, at a constant rate.
    Strain(f64),
}

/// The vibration of the bottom: displacements (m).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vibration {
    /// Along x.
    pub along: Option<Wave>,
    /// Along its normal.
    pub normal: Option<Wave>,
}

impl Vibration {
    pub(super) fn axes(&self) -> [Option<Wave>; 2] {
        [self.along, self.normal]
    }

    /// Whether there is some.
    pub fn is_some(&self) -> bool {
        *self != Self::default()
    }
}

/// What is imposed along x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Along {
    /// The velocity of the drive (m/s); 0 is a hold.
    Velocity(f64),
    /// The velocity of the drive, which it reaches along a ramp.
    Ramp(Ramp),
    /// The drive oscillates about its position at the start of the segment (m).
    Oscillation(Wave),
    /// The top is free, and pulled by this force (N; N/m in 2D).
    Force(Course),
}

/// What is imposed along the normal of the top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Normal {
    /// The load N (N; N/m in 2D).
    Load(Course),
    /// The velocity away from the bottom (m/s); 0 is a constant volume.
    Velocity(f64),
}

/// A velocity that changes linearly from one value to another, and is then constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// At the start (m/s).
    pub from: f64,
    /// At the end of the ramp, and from then on.
    pub to: f64,
    /// Duration of the ramp: in steps, of a part of a scene in seconds. Need not be whole.
    pub time: f64,
}

impl Ramp {
    /// The velocity (m/s) this long after the start, in the unit of the ramp's time.
    pub fn velocity(&self, time: f64) -> f64 {
        if time >= self.time {
            self.to
        } else {
            self.from + (self.to - self.from) * (time / self.time)
        }
    }

    /// The integral of the velocity (m/s times the unit of time) over this time.
    pub fn distance(&self, time: f64) -> f64 {
        if time >= self.time {
            self.to * time + 0.5 * (self.from - self.to) * self.time
        } else {
            time * (self.from + 0.5 * (self.to - self.from) * (time / self.time))
        }
    }

    /// The mean velocity (m/s) in the step after so many steps, of a ramp whose time is in steps.
    pub(super) fn velocity_in_step(&self, steps: f64) -> f64 {
        if steps >= self.time {
            self.to
        } else {
            self.distance(steps + 1.0) - self.distance(steps)
        }
    }

    /// The greatest speed (m/s).
    pub(super) fn fastest(&self) -> f64 {
        self.from.abs().max(self.to.abs())
    }
}

/// The course of a force during a segment: linear from one value to another, and a sinusoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    /// At the start (N; N/m in 2D).
    pub from: f64,
    /// At the end.
    pub to: f64,
    /// Added to it.
    pub wave: Option<Wave>,
}

impl Course {
    /// A constant force.
    pub fn constant(value: f64) -> Self {
        Self {
            from: value,
            to: value,
            wave: None,
        }
    }

    /// The amplitude of what is added to it.
    pub fn amplitude(&self) -> f64 {
        self.wave.map_or(0.0, |wave| wave.amplitude)
    }

    /// The force after so many of all steps of the segment.
    pub fn at(&self, steps: u64, all: u64) -> f64 {
        let linear = if steps >= all {
            self.to
        } else {
            self.from + (self.to - self.from) * (steps as f64 / all as f64)
        };
        self.wave.map_or(linear, |wave| linear + wave.at(steps))
    }
}

impl From<Along> for Imposed {
    fn from(along: Along) -> Self {
        Self {
            along,
            normal: None,
            bottom: Vibration::default(),
            lateral: None,
        }
    }
}
