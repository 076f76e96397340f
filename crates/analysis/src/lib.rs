//! Analysis of simulated states: pure functions on frames, states and time series. Nothing here
//! reads or writes files or knows of MPI ranks.
//!
//! Abbreviations: LH is Lee & Hurley (disks in plane shear), FR Ferdowsi & Rubin (spring-driven
//! gouge), BO Bonfanti et al. (athermal quasi-static shear). `[L]` and `[N]` give the length of an
//! array: L rows of a time series, N grains.
//!
//! | modules | quantities |
//! | --- | --- |
//! | [`phases`], [`tau`], [`drop_stages`], [`phase_measures`], [`correlate`] | stick and slip phases of τ, statistics per phase and their correlations |
//! | [`interval`], [`dmin`], [`displacement`], [`overlap`] | D²min and displacements between two frames |
//! | [`events`] | clusters of D²min in space and time, and their propagator |
//! | [`regions`], [`dbscan`], [`rattlers`] | regions of rearranging grains (GR regions) |
//! | [`forces`], [`mod@stress`], [`frame_scalars`] | contact forces, stresses, scalars of a frame |
//! | [`moments`], [`time_mean`], [`spearman`], [`ranges`] | statistics |
//! | [`rate_state`] | rate-and-state friction: steps, holds, fits |
//! | [`jacobian`], [`growth`] | stiffness matrix K, growth of its modes; [`gshear_spectrum`] has its eigenvalues |
//!
//! # Example
//! Stick and slip phases of τ(γ), and the rank correlation of their durations and changes of τ:
//!
//! ```
//! use gshear_analysis::phases::{self, PhaseKind};
//! use gshear_analysis::spearman::Spearman;
//!
//! let strain = [0.00, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06];
//! let tau = [0.10, 0.15, 0.22, 0.18, 0.19, 0.21, 0.12];
//! let found = phases::find(&strain, &tau);
//! let kinds: Vec<PhaseKind> = found.iter().map(|phase| phase.kind).collect();
//! assert_eq!(kinds, [PhaseKind::Stick, PhaseKind::Slip, PhaseKind::Stick, PhaseKind::Slip]);
//! assert_eq!(phases::largest_drop(&found).unwrap().end, 6);
//!
//! let pairs = found.iter().map(|phase| [phase.duration() as f64, phase.change]);
//! let correlation = Spearman::default().of(pairs);
//! assert_eq!(correlation.count, 4);
//! assert!(correlation.rho > 0.8 && correlation.p > 0.05);
//! ```

pub mod aftermath;
pub mod correlate;
pub mod dbscan;
pub mod displacement;
pub mod dmin;
pub mod drop_stages;
pub mod events;
pub mod forces;
pub mod frame_scalars;
pub mod growth;
pub mod interval;
pub mod jacobian;
pub mod moments;
mod neighbourhood;
pub mod overlap;
pub mod phase_measures;
pub mod phases;
pub mod ranges;
pub mod rate_state;
pub mod rattlers;
pub mod regions;
pub mod spearman;
pub mod stability;
pub mod stress;
pub(crate) mod student;
pub mod tau;
pub mod time_mean;

#[cfg(test)]
mod testing;
