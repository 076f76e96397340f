//! The body that a grain belongs to.

/// None: the grain moves freely.
pub const FREE: u32 = 0;
/// The bottom wall.
pub const BOTTOM: u32 = 1;
/// The top wall.
pub const TOP: u32 = 2;
/// None any more: the grain passed a wall and was removed. It rests where it was, and nothing
/// touches it.
pub const REMOVED: u32 = 3;
