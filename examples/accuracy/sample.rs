//! The default scene, packed and sheared a little, and short spans of it from there at any Δt.

use std::time::Instant;

use gshear::config::{self, Law, Material, Scene, Source, derived};
use gshear::contact::ContactLaw;
use gshear::dimension::Two;
use gshear::domain::Solo;
use gshear::drive::{GrainWalls, Slider};
use gshear::io::checkpoint;
use gshear::kernel::ContactForces;
use gshear::run::{Header, Options, Run, Stage, Start};
use gshear::schedule::{Protocol, Schedule};
use gshear::simd::Level;
use gshear::state::{GrainState, Snapshot, body, nearest_image};
use gshear::step::{Wanted, advance, initial_forces};
use gshear::system::{Setup, System};

use crate::scheme::{Damped, Dampers};

/// Steps of the shear before the span begins.
const SHEARED: u64 = 100_000;

pub struct Sample {
    pub scene: Scene,
    snapshot: Snapshot,
    walls: (Header, Schedule),
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
        let scene = config::load(&Source::embedded(), &[]).expect("the embedded scene");
        let options = Options {
            out: folder.path().into(),
            stop_at: Some(SHEARED),
            wall_time: None,
            threads: 1,
            replay: None,
        };
        Run::new(&Solo, &scene, &options)
            .and_then(|run| run.run(Start::Insertion))
            .expect("the default scene runs");
        let path = folder.path().join(checkpoint::NAME);
        let (_, snapshot) = checkpoint::read(&Solo, &path).expect("its checkpoint");
        let header: Header = serde_json::from_str(&snapshot.header).expect("its header");
        let Stage::Shear { height } = header.stage else {
            panic!("the run was stopped while it was sheared")
        };
        let schedule = Schedule::new(&scene, height);
        Self {
            scene,
            snapshot,
            walls: (header, schedule),
        }
    }

    pub fn grains(&self) -> f64 {
        f64::from(self.scene.sample.grains)
    }

    /// Of the grains, which the default scene has.
    pub fn material(&self) -> Material {
        match self.scene.law {
            Law::LeeHurley(material) => material,
            _ => unreachable!("the default scene is Lee & Hurley's"),
        }
    }

    /// √(m/k) (s), of which the default Δt is a tenth.
    pub fn contact_time(&self) -> f64 {
        derived::contact_time(
            &self.scene.law,
            &self.scene.sample,
            self.scene.mean_overlap(),
        )
    }

    /// At the start of the span, with forces.
    pub fn start<C: ContactLaw<Space = Two>>(
        &self,
        law: C,
        step: f64,
        dampers: Dampers,
    ) -> Moving<C> {
        let scene = &self.scene;
        let setup = Setup {
            level: Level::detect(),
            bookkeeping: &scene.bookkeeping,
            cell: scene.sample.cell(),
            largest_radius: scene.sample.radius_max,
            mean_diameter: scene.sample.mean_diameter,
            masses: scene.law.masses(),
            step,
            gravity: 0.0,
            typical_force: scene.load.normal_force,
            threads: 1,
        };
        let mut system = System::new(&Solo, setup).expect("one rank is not too many");
        let (header, schedule) = &self.walls;
        // At another Δt the same drive.
        let speed = schedule.protocol.velocity(0);
        let walls = GrainWalls {
            piston: header.piston,
            slider: Slider::new(Protocol::new(step, [(speed, u64::MAX >> 12)]), None),
            along: false,
            top: Vec::new(),
        };
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

    /// Root mean squares over the free grains: of the difference of two states' positions over that of the way from the
    /// start, and of the velocities' over that of the velocities.
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

impl<C: ContactLaw<Space = Two>> Moving<C> {
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
            Wanted {
                samples,
                ..Wanted::default()
            },
        )
        .ok()
        .map(|_| ())
    }
}
