//! Integration tests of weaver-data.

mod capture;
mod procedural;
mod quality;
mod real_captures;
mod sampler;
mod scene;
