//! Strain steps that change the lengths of the box: pure shear, biaxial, the parts of a protocol,
//! and compression to a pressure.

use gshear_dem::contact::portable_exp;
use gshear_dem::dimension::Dimension;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::state::strained;

use super::assembly::RestState;
use super::box_state::{Observed, volume_of_cell};
use super::relax::{DisplacementResult, LONGEST};
use super::strain::{SolidFraction, Strain};
use crate::header::{Beyond, Pressing, Search, Stretched};
use gshear_scene::{Deformation, StrainPart};

/// A packing with less than this part of the wanted pressure says nothing of where it is reached.
const LOOSE: f64 = 1e-3;
/// Relative change of the lengths below which a pressure that jumps is not looked for any further.
const FINEST: f64 = 1e-13;

impl<D: Dimension> Strain<'_, D> {
    /// Volume of the grains over that of the cell.
    pub(super) fn solid_fraction(&self) -> f64 {
        let SolidFraction { value, volume } = self.at_start;
        value * (volume / volume_of_cell(&self.assembly.system))
    }

    /// Notes the lengths before the first strain step, if they change in this scene.
    pub(super) fn begin_stretching(&mut self) {
        let simple = self.quasi_static.deformation == Deformation::SimpleShear;
        let lengths = self.assembly.system.cell.lengths::<D>();
        if !simple || self.quasi_static.pressure.is_some() {
            self.progress.stretched = Some(Stretched::new(lengths));
        }
    }

    pub(super) fn observed(&mut self) -> Observed {
        self.assembly.observe(self.scene.sample.grains)
    }

    /// Gives the box these lengths.
    fn stretch(&mut self, to: [f64; 3]) -> Result<DisplacementResult> {
        let least = self.scene.sample.least_box_length();
        let shortest = to[..D::AXES].iter().copied().fold(f64::INFINITY, f64::min);
        if shortest < least {
            return Err(Failure::numbers(format!(
                "strain step {}: the box would become {shortest:.4e} long, so that grains would touch their own images; \
                 give more grains, for a length of at least {least:.4e}",
                self.progress.steps + 1
            )));
        }
        let from = self.assembly.system.cell.lengths::<D>();
        let changes = (0..D::AXES).map(|axis| (to[axis] / from[axis] - 1.0).abs());
        let greatest = changes.fold(0.0, f64::max);
        // The histories follow an affine step to second order.
        let parts = (greatest / LONGEST).ceil().max(1.0) as u64;
        for k in 1..=parts {
            let part = k as f64 / parts as f64;
            let between = std::array::from_fn(|axis| from[axis] + part * (to[axis] - from[axis]));
            let lengths = if k == parts { to } else { between };
            let outcome = self.assembly.stretch(lengths)?;
            if outcome.is_err() {
                return Ok(outcome);
            }
        }
        Ok(Ok(()))
    }

    /// [`Strain::stretch`], which must succeed.
    pub(super) fn stretch_within(&mut self, lengths: [f64; 3]) -> Result<()> {
        let outcome = self.stretch(lengths)?;
        self.within_law(outcome)
    }

    /// Fails if a strain step has led outside the law.
    pub(super) fn within_law(&mut self, outcome: DisplacementResult) -> Result<()> {
        outcome.map_err(|outside| {
            let exchange = self.assembly.exchange;
            let failure = self.assembly.system.explain(exchange, outside);
            self.of_strain_step(failure)
        })
    }

    /// Names the strain step in which numbers fail, and what to do.
    pub(super) fn of_strain_step(&self, failure: Failure) -> Failure {
        match failure {
            Failure::Numbers(what) => Failure::numbers(format!(
                "strain step {}, {what}; give a smaller aqs.strain_step, or less strain",
                self.progress.steps + 1
            )),
            other => other,
        }
    }

    /// Strain step number `step` of pure shear: ε = γ/2 along x, -γ/2 along the last axis. The
    /// lengths are those of the whole strain, so that their product stays the same but for
    /// rounding.
    pub(super) fn pure_shear(&mut self, step: u64) -> Result<Option<Search>> {
        let mut lengths = self.stretched().initial;
        let area = lengths[0] * lengths[D::UP];
        let strain = self.quasi_static.aqs.strain_step * step as f64;
        lengths[0] /= portable_exp(-0.5 * strain);
        lengths[D::UP] = area / lengths[0];
        self.stretch_within(lengths)?;
        Ok(Some(Search::Rest))
    }

    pub(super) fn stretched(&self) -> Stretched {
        let stretched = self.progress.stretched;
        stretched.expect("the stage has begun, or a checkpoint of it was read")
    }

    /// Strain step number `step` of a biaxial box: the last axis shrinks, then the other lengths
    /// change by one factor until the mean stress along them is the wanted one.
    pub(super) fn biaxial(&mut self, step: u64) -> Result<Option<Search>> {
        let before = self.stretched();
        let strain = self.quasi_static.aqs.strain_step * step as f64;
        let mut lengths = self.assembly.system.cell.lengths::<D>();
        lengths[D::UP] = before.initial[D::UP] * portable_exp(-strain);
        let wanted = [self.quasi_static.pressure.unwrap_or(f64::NAN), 0.0, 0.0];
        self.begin_to_correct(lengths, wanted, before.corrected)
    }

    /// Strain step number `step` of a protocol: imposes the strains, then searches for the
    /// stresses.
    pub(super) fn protocol(&mut self, parts: &[StrainPart], step: u64) -> Result<Option<Search>> {
        let (n, within) = StrainPart::of_step(parts, step).expect("a strain step of the protocol");
        let part = &parts[n];
        let mut corrected = self.stretched().corrected;
        if within == 1 {
            // A part may move other axes than the one before.
            corrected = None;
        }
        let wanted = self.wanted_stresses(part.steps + 1 - within);
        let share = part.share(within) - part.share(within - 1);
        if part.shear != 0.0 {
            self.shear(share * part.shear)?;
        }
        let mut lengths = self.assembly.system.cell.lengths::<D>();
        for (length, strain) in lengths.iter_mut().zip(part.strain) {
            *length = strained(*length, share * strain);
        }
        self.begin_to_correct(lengths, wanted, corrected)
    }

    /// A modulus as great as that of a packing can be: of contacts that all overlap by a hundredth.
    pub(super) fn stiff(&self) -> f64 {
        let diameter = self.scene.sample.mean_diameter;
        let radius = 0.5 * diameter;
        let law = &self.scene.law;
        let stiffness = law.normal_stiffness(radius, radius, 0.01 * diameter);
        match D::AXES {
            2 => stiffness,
            _ => stiffness / diameter,
        }
    }

    /// Begins to change all lengths by one factor until the pressure is the wanted one. Never goes
    /// beyond it and back, which would leave its mark on the histories: a packing beyond it is
    /// given up for the one before, which is held. Returns `None` if the pressure is the wanted
    /// one.
    pub(super) fn begin_to_press(&mut self, wanted: f64) -> Result<Option<Search>> {
        let pressure = self.observed().pressure;
        self.held.push(RestState::of(&mut self.assembly));
        self.press(Pressing {
            wanted,
            toward: if pressure < wanted { 1.0 } else { -1.0 },
            pressure,
            change: self.quasi_static.aqs.pressure_step,
            slope: None,
            beyond: None,
        })
    }

    /// Begins the next trial, or ends the search.
    fn press(&mut self, mut pressing: Pressing) -> Result<Option<Search>> {
        let wanted = pressing.wanted;
        while (pressing.pressure - wanted).abs() > self.quasi_static.pressure_tolerance * wanted {
            let Pressing {
                pressure, change, ..
            } = pressing;
            if change < FINEST {
                let jump = pressing.beyond.and_then(|beyond| beyond.pressure);
                let jump = jump.unwrap_or(f64::NAN);
                return Err(Failure::numbers(format!(
                    "strain step {}: the pressure jumps from {pressure:.4e} to {jump:.4e} when the box changes by {change:.0e} \
                     of its length, over the wanted {wanted:.4e}; give another pressure, a greater aqs.pressure_tolerance \
                     or another seed",
                    self.progress.steps + 1
                )));
            }
            let mut lengths = self.assembly.system.cell.lengths::<D>();
            for length in &mut lengths[..D::AXES] {
                *length *= 1.0 - pressing.toward * change;
            }
            if self.stretch(lengths)?.is_ok() {
                return Ok(Some(Search::Pressure(pressing)));
            }
            self.judge(&mut pressing, None)?;
        }
        self.held.pop();
        Ok(None)
    }

    /// Goes on after the relaxation of a trial.
    pub(super) fn press_on(&mut self, mut pressing: Pressing) -> Result<Option<Search>> {
        let now = self.observed().pressure;
        self.judge(&mut pressing, Some(now))?;
        self.press(pressing)
    }

    /// Keeps the packing of a trial with the pressure `now`, or gives it up; `None`: it is outside
    /// the law. Chooses how far to change the lengths next.
    fn judge(&mut self, pressing: &mut Pressing, now: Option<f64>) -> Result<()> {
        let allowed = self.quasi_static.pressure_tolerance * pressing.wanted;
        if pressing.judge(now, allowed, self.quasi_static.aqs.pressure_step) {
            self.held.pop();
            self.held.push(RestState::of(&mut self.assembly));
            return Ok(());
        }
        let state = self.held.last().expect("the packing before").clone();
        state.put_back(&mut self.assembly)
    }
}

impl Pressing {
    /// Goes on after a trial with the pressure `now`, `None` outside the law; its packing is kept
    /// if that is at most so much beyond the wanted one. Returns whether it is kept. `most`: the
    /// greatest change of the lengths.
    fn judge(&mut self, now: Option<f64>, allowed: f64, most: f64) -> bool {
        let change = self.change;
        let mut is_kept = false;
        match now {
            Some(now) if self.toward * (now - self.wanted) <= allowed => {
                is_kept = true;
                let slope = self.toward * (now - self.pressure) / change;
                self.slope = (slope > 0.0).then_some(slope);
                self.pressure = now;
                self.beyond = self.beyond.and_then(|beyond| beyond.nearer(change));
            }
            pressure => self.beyond = Some(Beyond { change, pressure }),
        }
        self.change = self.next_change(most);
        is_kept
    }

    /// How far to change the lengths next. Since the pressure rises ever more steeply, the chord to
    /// a packing beyond the wanted pressure leads before it, and the last slope beyond it.
    fn next_change(&self, most: f64) -> f64 {
        let missing = (self.wanted - self.pressure).abs();
        let is_loose = self.pressure < LOOSE * self.wanted;
        let by_slope = match self.slope {
            Some(slope) if !is_loose => Some(missing / slope),
            _ => None,
        };
        let next = match (by_slope, self.beyond) {
            (Some(by_slope), None) => by_slope,
            (None, None) => most,
            (by_slope, Some(Beyond { change, pressure })) => match (pressure, by_slope) {
                (Some(far), by_slope) if !is_loose => {
                    // A pressure within the tolerance may be nearer to the one beyond it.
                    let chord = (change * missing / (far - self.pressure).abs()).min(change);
                    match by_slope {
                        Some(by_slope) => 0.5 * (chord + by_slope.clamp(chord, change)),
                        None => chord,
                    }
                }
                _ => 0.5 * change,
            },
        };
        next.min(most)
    }
}

impl Beyond {
    /// The same pressure, from a packing that is nearer by this change of the lengths; `None` if
    /// that is not before it.
    fn nearer(self, change: f64) -> Option<Self> {
        let left = self.change - change;
        (left > 0.0).then_some(Self {
            change: left,
            ..self
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks for the wanted pressure of a packing whose pressure is a power of its compression.
    fn trials(power: f64, onset: f64, from: f64, wanted: f64) -> usize {
        let at = |x: f64| (x - onset).max(0.0).powf(power);
        let mut x = from;
        let mut pressing = Pressing {
            wanted,
            toward: if at(from) < wanted { 1.0 } else { -1.0 },
            pressure: at(from),
            change: 1e-3,
            slope: None,
            beyond: None,
        };
        for trial in 0..200 {
            if (pressing.pressure / wanted - 1.0).abs() <= 1e-6 {
                return trial;
            }
            let tried = x + pressing.toward * pressing.change;
            if pressing.judge(Some(at(tried)), 1e-6 * wanted, 1e-3) {
                x = tried;
            }
            // It is not used once the pressure is found.
            let found = (pressing.pressure / wanted - 1.0).abs() <= 1e-6;
            let change = pressing.change;
            assert!(found || change > 0.0 && change <= 1e-3, "{pressing:?}");
        }
        panic!("{power} {onset} {from} {wanted}: not found")
    }

    /// It is asked for the next change before a pressure is known to be near enough.
    #[test]
    fn a_pressure_in_the_tolerance_has_a_next_change() {
        let far = Beyond {
            change: 1e-8,
            pressure: Some(1.0011),
        };
        let pressing = Pressing {
            wanted: 1.0,
            toward: 1.0,
            pressure: 1.0009,
            change: 1e-3,
            slope: Some(1e6),
            beyond: Some(far),
        };
        let next = pressing.next_change(1e-3);
        assert!(next > 0.0 && next <= far.change, "{next}");
    }

    #[test]
    fn a_pressure_is_found_in_few_trials() {
        for power in [1.0, 1.5] {
            for onset in [0.0, 3e-4, 4.7e-3] {
                for wanted in [1e-7, 1e-5, 1e-3] {
                    let up = trials(power, onset, 0.0, wanted);
                    let onto = (onset / 1e-3) as usize + (1e-3f64.powf(power) / wanted) as usize;
                    assert!(up < 40 + onto + 40, "{power} {onset} {wanted}: {up}");
                    let above = onset + (4.0 * wanted).powf(1.0 / power);
                    let more = trials(power, onset, above, wanted);
                    assert!(more < 60, "{power} {onset} {wanted}: {more}");
                }
            }
        }
    }
}
