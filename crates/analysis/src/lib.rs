//! Analysis of simulated states: pure functions on frames, states and time series. Nothing here
//! reads or writes files or knows of MPI ranks.
//!
//! Abbreviations: LH is Lee & Hurley (disks in plane shear), FR Ferdowsi & Rubin (spring-driven
//! gouge), BO Bonfanti et al. (athermal quasi-static shear). `[L]` and `[N]` give the length of an
//! array: L rows of a time series, N grains.

pub mod correlate;
pub mod dbscan;
pub mod displacement;
pub mod dmin;
pub mod event;
pub mod forces;
pub mod frame_scalars;
pub mod growth;
pub mod jacobian;
pub mod measures;
pub mod neighbourhood;
pub mod phases;
pub mod ranges;
pub mod rate_state;
pub mod rattlers;
pub mod regions;
pub mod spearman;
pub mod spectrum;
pub mod spread;
pub mod stages;
pub mod stress;
pub mod student;

#[cfg(test)]
mod testing;
