//! Integration tests of weaver-data.
#![cfg_attr(not(unix), allow(unused, reason = "some tests are of what Unix systems have alone"))]

mod capture;
mod dtu;
mod estimated;
mod exif;
mod film_layouts;
mod frame_times;
mod learned;
mod masked;
mod own_photos;
mod photo_masks;
mod placing;
mod posed;
mod quality;
mod real_captures;
mod sampler;
mod scene;
mod spheres;
mod unreadable;

/// A folder for results.
fn claimed(folder: &std::path::Path) -> weaver_data::OutputFolder {
    weaver_data::OutputFolder::claim(folder, "test", [""; 0]).unwrap()
}
