//! Rate-and-state friction (FR; Dieterich 1979, Ruina 1983): the constitutive law, a spring slider
//! that obeys it, measurements of velocity steps and slide-hold-slide tests, and fits of the law to
//! records.
//!
//! Friction μ depends on velocity V and state θ:
//!
//! ```text
//! μ = μ* + a ln(V/V*) + b ln(V*θ/D_c)
//! aging law: dθ/dt = 1 - Vθ/D_c      slip law: dθ/dt = -(Vθ/D_c) ln(Vθ/D_c)
//! ```

mod drive_segment;
mod evolution_law;
mod experiment;
mod fit;
mod jackknife;
mod noise;
mod quantity;
mod relaxation;
mod search;
mod slider;
mod slider_record;
mod stack;
mod steps_and_holds;
mod window;

#[cfg(test)]
mod tests;

pub use drive_segment::{DriveSegment, of_displacement, of_drive, with_changes};
pub use evolution_law::{Evolution, LogState, RateStateLaw, SliderModel, StateVariable};
pub use experiment::{Experiment, Fitted, fit_all};
pub use fit::Fit;
pub use jackknife::jackknife;
pub use quantity::{Estimate, FitForm, Quantity};
pub use relaxation::{Relaxation, relaxations};
pub use slider::RateStateSlider;
pub use slider_record::{SliderRecord, merge};
pub use stack::{SlipInterval, Stack, stacks};
pub use steps_and_holds::{Healing, Hold, PeakGrowth, Reslide, Steady, VelocityStep, peak_growth};
pub use window::modelled;
