//! Pure functions on frames and time series: no files, no ranks.

pub mod dmin;
pub mod neighbourhood;
pub mod phases;
pub mod rattlers;

#[cfg(test)]
mod testing;
