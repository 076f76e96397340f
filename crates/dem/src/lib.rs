//! The discrete element method of gshear-mpi: contact laws, the loop over the contacts, neighbour
//! lists, slabs, walls and the time step.
//!
//! The crate works with numbers only. It knows neither MPI nor HDF5 nor configuration files, and
//! builds on stable Rust without them. Exchange between ranks is behind the trait
//! [`domain::Exchange`]; [`domain::Solo`] is a single rank, and the crate `gshear-mpi-exchange` has
//! the ranks of an MPI job.
//!
//! # Example
//!
//! Three disks with linear springs in a periodic cell: two of them collide with the third.
//!
//! ```
//! use gshear_dem::dimension::Two;
//! use gshear_dem::domain::Solo;
//! use gshear_dem::drive::NoWalls;
//! use gshear_dem::laws::keys::{Key, KeyReader};
//! use gshear_dem::laws::{self, Contact, Law, LawSpace};
//! use gshear_dem::observe::digest;
//! use gshear_dem::simd::Isa;
//! use gshear_dem::state::{Cell, GrainState, body};
//! use gshear_dem::step::{StepRequest, advance, initial_forces};
//! use gshear_dem::system::{ListSettings, Setup, System};
//!
//! /// The values of a law's keys, by path. A program reads them from its configuration.
//! struct Table(&'static [(&'static str, f64)]);
//!
//! impl KeyReader for Table {
//!     fn number(&mut self, key: &Key) -> Option<f64> {
//!         let row = self.0.iter().find(|(path, _)| *path == key.path);
//!         row.map(|&(_, x)| x)
//!     }
//!     fn required(&mut self, key: &Key) -> f64 {
//!         self.number(key).expect(key.path)
//!     }
//!     fn exactly_one(&mut self, keys: &[&Key], what: &str) -> usize {
//!         keys.iter().position(|key| self.number(key).is_some()).expect(what)
//!     }
//!     fn useless(&mut self, _: &Key, _: &str) {}
//!     fn refuse(&mut self, key: &Key, what: &str) {
//!         panic!("{} {what}", key.path)
//!     }
//! }
//!
//! # fn main() -> gshear_dem::failure::Result<()> {
//! // A law of the list `LAWS`, by its name.
//! let kind = laws::kind("hooke").expect("a law of this name");
//! let law = Law::read(kind, &mut Table(&[
//!     ("material.density", 2500.0),
//!     ("contact.normal_stiffness", 1e6),
//!     ("contact.restitution", 0.8),
//! ]));
//! let contact = Contact { friction: 0.5, ..Contact::default() };
//! let force = Two::pair_force(&law, &contact).expect("a law between disks");
//! let force = force.as_ref();
//!
//! // Grains of a radius of 1 mm, without walls.
//! let grain = |id, x: f64, speed: f64| GrainState {
//!     id,
//!     body: body::FREE,
//!     position: [x, 5e-3, 0.0],
//!     velocity: [speed, 0.0, 0.0],
//!     angular_velocity: [0.0; 3],
//!     radius: 1e-3,
//!     force: [0.0; 3],
//!     torque: [0.0; 3],
//!     image: [0; 3],
//!     material: 0,
//! };
//! let grains = vec![grain(0, 4e-3, 0.1), grain(1, 6.1e-3, 0.0), grain(2, 8.2e-3, -0.1)];
//! let cell = Cell::between_walls([20e-3, f64::INFINITY]);
//! let mut system = System::<Two>::new(&Solo, Setup::new(cell, 1e-3, law.masses(), 1e-6))?;
//! system.replace(&Solo, force, &mut NoWalls, grains, Vec::new())?;
//! initial_forces(&Solo, &mut system, force, &mut NoWalls, None)?;
//!
//! for _ in 0..3000 {
//!     advance(&Solo, &mut system, force, &mut NoWalls, StepRequest::default())?;
//! }
//! let grains = system.grain_states();
//! assert!(grains[0].velocity[0] < 0.0 && grains[2].velocity[0] > 0.0);
//! assert!(grains[1].velocity[0].abs() < 1e-5);
//!
//! // A hash of all grains and contacts: the same on every machine and with any number of threads.
//! let steps = system.steps;
//! let state = digest(&Solo, &mut system, force, &[], steps);
//! assert_eq!(state.len(), 32);
//! # Ok(())
//! # }
//! ```
//!
//! # Where to start
//!
//! | module | contents |
//! | --- | --- |
//! | [`step`] | the time step in named phases: read it first |
//! | [`laws`] | the contact laws, one per file, and their list |
//! | [`adhesions`] | what holds grains together beside a law, one per file, and their list |
//! | [`contact`] | the interfaces of a law and of an adhesion |
//! | [`kernel`] | the loop over the contacts, sixteen at a time |
//! | [`simd`], [`threads`] | instruction sets with the same bits, threads of a rank |
//! | [`dimension`] | the differences between 2D and 3D |
//! | [`state`], [`system`] | grains, contacts and the cell; their upkeep between two steps |
//! | [`neighbour`] | cells and the half list of candidate pairs |
//! | [`domain`] | exchange between ranks, slabs, exact sums |
//! | [`boundary`] | what bounds a sample, and what follows from it |
//! | [`drive`], [`protocol`], [`wave`] | its motion, and what is imposed on it |
//! | [`observe`], [`columns`](mod@columns) | rows, frames and the digest; columns of tables |
//! | [`observables`] | columns that scenes and programs add |
//! | [`budget`], [`clock`] | energy budget; time per phase |
//! | [`failure`] | failures and exit codes |
//!
//! # Papers and equation labels
//!
//! | short | paper | system |
//! | --- | --- | --- |
//! | LH | Lee & Hurley, *Microscopic Dynamics of Particle Rearrangement and its Correlation with Stick-slip Behavior in Granular Shear* | 2D plane shear of disks |
//! | FR | Ferdowsi & Rubin, supplement | 3D gouge under a spring slider |
//! | BO | Bonfanti et al., *Oscillatory instabilities in three-dimensional frictional granular matter* | 3D periodic box |
//!
//! A number such as A9 or LH A9 is an equation of that paper. Without the name of a paper it is one
//! of LH, except in the law [`laws::mindlin`] and in the code of spectra, where it is one of BO.
//! `docs/reference/glossary.md` lists the equations and all symbols.
//!
//! # Contracts
//!
//! The program keeps six contracts. None is traded for speed.
//!
//! 1. **Bookkeeping never reaches the numbers.** Ranks, slab cuts, bands, skin, list rebuilds,
//!    threads, instruction set and steps at once do not change a bit.
//! 2. **Output changes nothing.** More frames or rows, analysis on or off: the digest is the same.
//! 3. **Exact restart.** A run stopped at any step and resumed, on any number of ranks, ends with
//!    the
//!    digest of the run that was never stopped.
//! 4. **Replay.** Any window can be recomputed from the checkpoint before it, with denser output,
//!    bit
//!    for bit.
//! 5. **A scene pays only for what it has.** Dimension, law, friction, rolling, damping, gravity,
//!    walls and outputs are chosen once per run, outside the loop.
//! 6. **Nothing is lost, nothing is silent.** Files are written under another name and renamed.
//!    Checkpoints carry checksums, and the one before is kept. A failure names step, grains and
//!    place.
//!
//! In this crate they mean: no fast-math; fused multiply-adds only where written (`mul_add`); no
//! function of the system's mathematical library in anything that a trajectory depends on; no
//! global sum in f64 ([`domain::FixedPoint`]); no order that comes from the extent of a list or
//! from a hash map.

pub mod adhesions;
pub mod boundary;
pub mod budget;
pub mod clock;
pub mod columns;
pub mod contact;
pub mod dimension;
pub mod domain;
pub mod drive;
pub mod failure;
pub mod fluctuations;
pub mod kernel;
pub mod laws;
mod list;
mod motion;
pub mod neighbour;
pub mod observables;
pub mod observe;
pub mod processor;
pub mod profile;
pub mod protocol;
pub mod simd;
pub mod state;
pub mod step;
pub mod sum_over_ranks;
pub mod system;
pub mod threads;
mod under_way;
pub mod until;
pub mod wave;
pub mod workers;
