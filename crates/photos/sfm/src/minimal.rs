//! Minimal solvers: poses from as few observations as possible.

mod five_points;
mod polynomial;
mod three_points;

pub(crate) use five_points::five_points;
pub(crate) use three_points::three_points;
