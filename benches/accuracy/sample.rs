//! The default scene, packed and sheared a little, and short spans of it from there at any Δt.

use std::process::Command;
use std::time::Instant;

use gshear_dem::contact::ContactLaw;
use gshear_dem::contact::stiffness::Stiffness;
use gshear_dem::dimension::Two;
use gshear_dem::domain::Solo;
use gshear_dem::drive::{GrainWalls, Piston, Slider, Top};
use gshear_dem::kernel::ContactForces;
use gshear_dem::laws::lee_hurley::{self, Material};
use gshear_dem::protocol::Protocol;
use gshear_dem::simd::Isa;
use gshear_dem::state::{GrainState, Snapshot, body, nearest_image};
use gshear_dem::step::{StepRequest, advance, initial_forces};
use gshear_dem::system::{Setup, System};
use gshear_scene::{Load, Scene, Source, derived};
use gshear_store::checkpoint;

use serde::Deserialize;
use serde_json::Value;

use crate::scheme::{Damped, Dampers};

/// Steps of the shear before the span begins.
const SHEARED: u64 = 100_000;

pub struct Sample {
    pub scene: Scene,
    snapshot: Snapshot,
    piston: Piston,
    /// Of the drive (m/s).
    speed: f64,
}

/// A sample on its way.
pub struct Moving<C> {
    pub system: System<Two>,
    pub drive: Damped<GrainWalls>,
    pub law: C,
    pub samples: ContactForces,
}

impl Sample {
    /// Runs the default scene for a while, in a folder that is removed.
    pub fn prepare() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let ended = Command::new(env!("CARGO_BIN_EXE_gshear-mpi"))
            .arg("--out")
            .arg(folder.path())
            .args(["--stop-at", &SHEARED.to_string()])
            .status()
            .expect("gshear-mpi starts");
        // Stopped at a checkpoint.
        assert_eq!(ended.code(), Some(75), "gshear-mpi");
        let path = folder.path().join(checkpoint::NAME);
        let ([header, _], snapshot) = checkpoint::read(&Solo, &path).expect("its checkpoint");
        let header: Value = serde_json::from_str(&header).expect("its header");
        let piston = Piston::deserialize(&header["piston"]).expect("its piston");
        let run = hdf5::File::open(folder.path().join("run.h5")).expect("its results");
        let velocity = run.dataset("observables/drive_velocity/value");
        let velocity = velocity.and_then(|of| of.read_raw::<f64>());
        Self {
            scene: gshear_scene::load(&Source::embedded(), &[]).expect("the embedded scene"),
            snapshot,
            piston,
            speed: *velocity.expect("a time series").last().expect("rows"),
        }
    }

    pub fn grains(&self) -> f64 {
        f64::from(self.scene.sample.grains)
    }

    /// Of the grains.
    pub fn material(&self) -> Material {
        let law = &self.scene.law;
        assert_eq!(law.kind().name, lee_hurley::KIND.name, "the default scene");
        let of = |path: &str| {
            let mut given = law.given().iter().filter(|(key, _)| key.path == path);
            given.next().expect(path).1
        };
        Material {
            young_modulus: of("material.young_modulus"),
            poisson_ratio: of("material.poisson_ratio"),
            density: of("material.density"),
            damping_ratio: of("contact.damping_ratio"),
            sliding_damping: 0.0,
        }
    }

    fn load(&self) -> &Load {
        let walls = self.scene.plane_shear("the default scene");
        &walls.expect("walls").load
    }

    /// √(m/k) (s), of which the default Δt is a tenth.
    pub fn contact_time(&self) -> f64 {
        derived::contact_time(
            &self.scene.law,
            &self.scene.sample,
            self.load().mean_overlap(&self.scene.sample),
        )
    }

    /// At the start of the span, with forces.
    pub fn start<C: ContactLaw<Space = Two> + Stiffness>(
        &self,
        law: C,
        step: f64,
        dampers: Dampers,
    ) -> Moving<C> {
        let scene = &self.scene;
        let setup = Setup {
            isa: Isa::detect(),
            list: scene.bookkeeping.list,
            cell: scene.sample.cell(),
            largest_radius: scene.sample.radius_max,
            mean_diameter: scene.sample.mean_diameter,
            masses: scene.law.masses(),
            step,
            gravity: [0.0; 2],
            typical_force: self.load().normal_force,
            threads: 1,
            sweep: scene.bookkeeping.sweep,
            thread_clock: None,
        };
        let mut system = System::new(&Solo, setup).expect("one rank is not too many");
        // At another Δt the same drive.
        let slider = Slider::new(Protocol::new(step, [(self.speed, u64::MAX >> 12)]), None);
        let walls = GrainWalls::new(Top::new(self.piston, slider, None, false));
        let mut drive = Damped { walls, dampers };
        let (grains, contacts) = (self.snapshot.grains.clone(), self.snapshot.contacts.clone());
        system
            .replace(&Solo, &law, &mut drive, grains, contacts)
            .expect("one rank");
        let mut samples = ContactForces::default();
        initial_forces(&Solo, &mut system, &law, &mut drive, Some(&mut samples))
            .expect("within the law");
        Moving {
            system,
            drive,
            law,
            samples,
        }
    }

    /// Root mean squares over the free grains: of the difference of two states' positions over that
    /// of the way from the start, and of the velocities' over that of the velocities.
    pub fn difference(&self, state: &[GrainState], right: &[GrainState]) -> [f64; 2] {
        let mut sums = [[0.0; 2]; 2];
        for ((a, b), start) in state.iter().zip(right).zip(&self.snapshot.grains) {
            if b.body != body::FREE {
                continue;
            }
            let apart = |p: &GrainState, q: &GrainState| {
                let dx = nearest_image(p.position[0] - q.position[0], self.scene.sample.length);
                dx.powi(2) + (p.position[1] - q.position[1]).powi(2)
            };
            let [u, v] = [0, 1].map(|k| a.velocity[k] - b.velocity[k]);
            sums[0][0] += apart(a, b);
            sums[0][1] += apart(b, start);
            sums[1][0] += u * u + v * v;
            sums[1][1] += b.velocity[0].powi(2) + b.velocity[1].powi(2);
        }
        sums.map(|[difference, scale]| (difference / scale).sqrt())
    }
}

impl<C: ContactLaw<Space = Two> + Stiffness> Moving<C> {
    /// Some steps; the time that they took (s). `None` where they failed.
    pub fn go(&mut self, steps: usize) -> Option<f64> {
        let start = Instant::now();
        for _ in 0..steps {
            self.one(false)?;
        }
        Some(start.elapsed().as_secs_f64())
    }

    /// One step; with the contact forces in `samples` where wanted. `None` where it failed.
    pub fn one(&mut self, sampled: bool) -> Option<()> {
        let samples = sampled.then_some(&mut self.samples);
        advance(
            &Solo,
            &mut self.system,
            &self.law,
            &mut self.drive,
            StepRequest {
                samples,
                ..StepRequest::default()
            },
        )
        .ok()
        .map(|_| ())
    }
}
