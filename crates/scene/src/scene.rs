//! The checked scene: every default filled in, every contradiction refused. SI units throughout;
//! without a shear at a rate any consistent units, such as BO's reduced ones.

use gshear_dem::boundary::{Boundary, PERIODIC};
use gshear_dem::dimension::Dimensions;
use gshear_dem::failure::{Failure, Result};
use gshear_dem::kernel::PairForce;
use gshear_dem::laws::keys::AGEING;
use gshear_dem::laws::mixture::pair_force;
use gshear_dem::laws::{Contact, Law, LawSpace};
use gshear_dem::state::{Cell, FlatWalls, Sheared};

use crate::general::Bookkeeping;
use crate::grains::Sample;
use crate::materials::Materials;
use crate::sample::{Origin, PackingFile};
use crate::stages::Stages;
use crate::time::TimeStep;
use crate::walls::PlaneShear;

/// A run, ready to be set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The name of the run.
    pub title: String,
    /// Who made the run, if the configuration says it.
    pub author: Option<String>,
    /// Seed of every random number.
    pub seed: u64,
    /// Disks or spheres.
    pub dimension: Dimensions,
    /// The contact law with its constants; with several materials that of the first, of which all
    /// that follows from a law is.
    pub law: Law,
    /// What contacts have whatever their law: friction and rolling resistance; likewise.
    pub contact: Contact,
    /// The materials, and the laws of their pairs.
    pub materials: Materials,
    /// The grains and their cell, as the first stage takes them.
    pub sample: Sample,
    /// Δt and its limit.
    pub time_step: TimeStep,
    /// What is done to the grains.
    pub stages: Stages,
    /// Time between checkpoints besides those of a stage's schedule (s); 0 is never.
    pub checkpoint_time: f64,
    /// Whether every checkpoint is kept, so that stretches can be replayed.
    pub keep_checkpoints: bool,
    /// What changes speed, not results.
    pub bookkeeping: Bookkeeping,
    /// The whole configuration as TOML with every default filled in: what `scene.toml` and the
    /// files of a run hold.
    pub toml: String,
}

impl Scene {
    /// The forces between the grains.
    ///
    /// # Panics
    /// In another dimension than the scene's.
    pub fn force<D: LawSpace>(&self) -> Box<dyn PairForce<D>> {
        self.force_with(|law, contact| (law.clone(), contact.clone()))
    }

    /// [`Scene::force`] with the law and the contacts of each pair changed.
    ///
    /// # Panics
    /// Likewise.
    pub fn force_with<D: LawSpace>(
        &self,
        change: impl Fn(&Law, &Contact) -> (Law, Contact),
    ) -> Box<dyn PairForce<D>> {
        let laws = self.materials.laws.iter();
        let laws: Vec<_> = laws.map(|(law, contact)| change(law, contact)).collect();
        pair_force(&laws).expect("a law of this dimension, as the scene was checked")
    }

    /// What bounds the grains along the last axis.
    pub fn boundary(&self) -> &'static Boundary {
        self.shear().map_or(&PERIODIC, |shear| shear.boundary)
    }

    /// The shear, if the sample is sheared.
    pub fn shear(&self) -> Option<&PlaneShear> {
        self.stages.shear.as_ref()
    }

    /// Whether a grain that passes a wall is removed.
    pub fn removes(&self) -> bool {
        self.shear().is_some_and(|shear| shear.removes)
    }

    /// Whether the friction of contacts depends on their age.
    pub fn ages(&self) -> bool {
        let mut laws = self.materials.laws.iter();
        laws.any(|(law, _)| law.value(&AGEING).is_some_and(|growth| growth > 0.0))
    }

    /// Whether frames have the histories of contacts.
    pub fn writes_histories(&self) -> bool {
        self.shear().is_none_or(|shear| shear.output.histories)
    }

    /// Whether `run.h5` is compressed when the run has ended.
    pub fn compresses(&self) -> bool {
        self.shear().is_none_or(|shear| shear.output.compress)
    }

    /// The shear; messages call the scene `name`.
    ///
    /// # Errors
    /// `Failure::Input` for a scene without one.
    pub fn plane_shear(&self, name: &str) -> Result<&PlaneShear> {
        self.shear()
            .ok_or_else(|| Failure::input(format!("{name}: has no shear at a rate ([shear])")))
    }

    /// The flat walls of a shear between such.
    pub fn flat_walls(&self) -> Option<FlatWalls> {
        if !self.boundary().has_planes() {
            return None;
        }
        Some(FlatWalls {
            first_id: self.sample.grains,
            material: self.materials.wall.unwrap_or(0),
        })
    }

    /// The cell in which the grains begin.
    pub fn cell(&self) -> Cell {
        let file_box = self.packing().and_then(|file| file.boxed);
        let height_and_offset = match self.stages.first_strain() {
            None => file_box,
            Some(strain) => {
                let [_, _, height] = strain.lengths(&self.sample);
                file_box.or(Some([height, 0.0]))
            }
        };
        let sheared = height_and_offset.map(|[height, offset]| Sheared {
            offset,
            ..Sheared::upright(height)
        });
        Cell {
            sheared,
            ..self.sample.cell()
        }
    }

    /// The file that the grains come from, if they do.
    pub fn packing(&self) -> Option<&PackingFile> {
        self.stages.origin().file()
    }

    /// The scene of a shear that begins in a cell of these lengths (m; the second is 1 in 2D), as
    /// strain steps have left it: under the same pressure.
    #[must_use]
    pub fn in_cell(&self, lengths: [f64; 3]) -> Self {
        let mut scene = self.clone();
        let [length, width, height] = lengths;
        scene.sample.length = length;
        if self.dimension == Dimensions::Three {
            scene.sample.width = width;
        }
        if let Some(shear) = &mut scene.stages.shear {
            shear.origin = Origin::StageBefore { height };
            shear.load.normal_force = shear.load.pressure * scene.sample.base();
        }
        scene
    }
}
