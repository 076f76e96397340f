//! Smooth rigid planes, between which a sample is packed.

use bytemuck::Zeroable;

use super::{Drive, Felt, Piston, WallForces, WallMotion, WallSums, WallVelocities};
use crate::dimension::Dimension;
use crate::domain::{Accumulator, FixedPoint};
use crate::kernel::{PairForce, Pass, PassInput, Scratch};
use crate::simd::Isa;
use crate::state::{Bands, CandidatePair, Cell, Contacts, Grains, LocalGrains, Remembered};

/// Smooth rigid planes at 0 and at the piston's height along the last axis, the upper one pressed
/// by N.
///
/// A smooth rigid plane is the plane of symmetry of a contact of two equal grains: each grain near
/// it touches its mirror image, by the law of the grains without friction.
#[derive(Debug)]
pub struct Planes<D: Dimension> {
    /// The upper plane.
    pub piston: Piston,
    /// The drag on grains and planes (1/s).
    pub drag: f64,
    law: Box<dyn PairForce<D>>,
    /// Grains within the cutoff of a plane, and whether it is the upper one.
    candidates: Vec<(u32, bool)>,
    record: Vec<D::Record>,
    force: Vec<D::Force>,
    contacts: Contacts,
    scratch: Box<Scratch<D>>,
}

impl<D: Dimension> Planes<D> {
    /// Planes that touch grains by `law`, which has no friction.
    pub fn new(law: Box<dyn PairForce<D>>, piston: Piston, drag: f64) -> Self {
        Self {
            piston,
            drag,
            law,
            candidates: Vec::new(),
            record: Vec::new(),
            force: Vec::new(),
            contacts: Contacts::default(),
            scratch: Box::default(),
        }
    }

    /// Adds this rank's part of the force on a plane, away from the sample.
    pub fn load_on(&self, upper: bool, fixed: &FixedPoint, to: &mut Accumulator) {
        for (k, &(_, side)) in self.candidates.iter().enumerate() {
            if side == upper {
                fixed.add(to, self.force[2 * k][D::UP].abs());
            }
        }
    }
}

impl<D: Dimension> Drive<D> for Planes<D> {
    /// Also on spins: a grain without contacts would otherwise never come to rest.
    fn drag(&self) -> Option<[f64; 2]> {
        Some([self.drag; 2])
    }

    fn speed(&self) -> f64 {
        self.piston.velocity.abs()
    }

    fn planes(&self) -> Option<[f64; 2]> {
        Some([0.0, self.piston.height])
    }

    fn start(&mut self, load: WallForces) {
        self.piston.acceleration = (load.up - self.piston.load) / self.piston.mass;
    }

    fn drift(&mut self, step: f64) -> Option<WallMotion> {
        self.piston.half_kick_and_drift(step);
        None
    }

    fn forces(&mut self, isa: Isa, cell: Cell, step: f64, grains: &mut Grains<D>) -> Option<usize> {
        let up = D::UP;
        let velocity = self.piston.predicted(step);
        for (k, &(g, upper)) in self.candidates.iter().enumerate() {
            let (plane, speed) = if upper {
                (self.piston.height, velocity)
            } else {
                (0.0, 0.0)
            };
            let record = grains.record[g as usize];
            let mut image = record;
            let mirrored = D::fields_mut(&mut image);
            mirrored[up] = 2.0 * plane - mirrored[up];
            let v = &mut mirrored[D::VELOCITY + up];
            *v = 2.0 * speed - *v;
            self.record[2 * k] = record;
            self.record[2 * k + 1] = image;
        }
        self.force.fill(Zeroable::zeroed());
        let part = self.contacts.of_one_share();
        let input = PassInput {
            isa,
            units: grains.units,
            cell,
            step,
            travelled: None,
            is_cold: false,
            counting: None,
        };
        let pass = Pass::new(input, &self.record, &mut self.force, part);
        let outcome = self.law.pass(pass, &mut self.scratch);
        for (k, &(g, _)) in self.candidates.iter().enumerate() {
            grains.force[g as usize][up] += self.force[2 * k][up];
        }
        outcome.outside.or(outcome.too_strong).map(|(block, lane)| {
            let k = self.contacts.grains(block).i[lane] as usize / 2;
            self.candidates[k].0 as usize
        })
    }

    fn load(&self, felt: &Felt<'_, D>, sums: &mut WallSums) {
        self.load_on(true, felt.fixed, &mut sums.up);
    }

    fn kick(&mut self, step: f64, load: WallForces) -> Option<WallVelocities> {
        self.piston.full_kick(step, load.up, self.drag);
        None
    }

    fn renumber(&mut self, isa: Isa, grains: &mut Grains<D>, skin: f64) {
        self.candidates.clear();
        for g in 0..grains.owned {
            let y = grains.fields(g)[D::UP];
            let cutoff = grains.radius[g] + skin;
            for (upper, gap) in [(false, y), (true, self.piston.height - y)] {
                if gap < cutoff {
                    self.candidates.push((g as u32, upper));
                }
            }
        }
        let with_image = |k: u32| CandidatePair {
            grains: [2 * k, 2 * k + 1],
            gap: 0.0,
        };
        let pairs: Vec<_> = (0..self.candidates.len() as u32).map(with_image).collect();
        let id: Vec<_> = (0..2 * self.candidates.len() as u32).collect();
        let grains_of = || self.candidates.iter().map(|&(g, _)| g as usize);
        let radius: Vec<_> = grains_of().flat_map(|g| [grains.radius[g]; 2]).collect();
        let material: Vec<_> = grains_of().flat_map(|g| [grains.material[g]; 2]).collect();
        self.record.clear();
        self.record.resize(radius.len(), Zeroable::zeroed());
        self.force.clear();
        self.force.resize(radius.len(), Zeroable::zeroed());
        self.contacts.replace(
            isa,
            None,
            self.law.as_ref(),
            &pairs,
            &Remembered::default(),
            LocalGrains {
                id: &id,
                radius: &radius,
                material: &material,
                owned: radius.len(),
                has_feet: false,
                bands: &Bands::one(radius.len()),
                ghosts_move: 0.0,
            },
        );
    }
}
