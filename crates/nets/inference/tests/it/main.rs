//! Integration tests of weaver-inference.

mod compact;
mod depth_to_points;
mod given_cameras;
mod refined;
mod view_opacity;
