//! Pure functions on frames and time series: no files, no ranks.

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
