//! Rate-and-state friction (FR; Dieterich 1979, Ruina 1983): the law, a spring slider that obeys it, what velocity
//! steps and slide-hold-slide tests show of it, and fits to them.

mod experiment;
mod fit;
mod jackknife;
mod law;
mod measures;
mod noise;
mod protocol;
mod record;
mod slider;
mod stack;
mod window;

#[cfg(test)]
mod tests;

pub use experiment::{Experiment, Fitted, fit_all};
pub use fit::{Estimate, Fit, chi_squared, fit};
pub use jackknife::jackknife;
pub use law::{Evolution, Law, State};
pub use measures::{
    Healing, Hold, Peaks, Reslide, Steady, Step, healing, holds, steady_segments, steps,
};
pub use noise::{Correlation, block_error, correlation};
pub use protocol::{Segment, of_drive};
pub use record::{Record, merge};
pub use slider::Slider;
pub use stack::{Piece, Stack, stacks};
pub use window::{Window, modelled};
