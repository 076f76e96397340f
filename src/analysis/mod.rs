//! Pure functions on frames and time series: no files, no ranks.

pub mod dmin;
pub mod neighbourhood;
pub mod phases;
pub mod rate_state;
pub mod rattlers;
pub mod spectrum;

#[cfg(test)]
mod testing;
