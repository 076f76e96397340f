//! Contact laws: numbers in, numbers out.

pub mod lee_hurley;
