//! Tests of the rasterizer.

mod blend_weights;
mod covariance;
mod differences;
mod forms;
mod groups;
mod hostile;
mod invariance;
mod lens;
mod op;
mod parity;
mod readme;
mod render;
mod rules;
mod scene;
mod seam;
mod spherical;
mod splats;
mod surfels;
mod twin;
mod visit;
