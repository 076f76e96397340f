//! The configuration: raw (serde, unknown keys denied), then checked (a scene in which nothing is optional any more).

mod scene;

pub use scene::*;
