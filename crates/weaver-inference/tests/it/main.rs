//! Integration tests of weaver-inference.

mod depth_to_points;
mod given_cameras;
