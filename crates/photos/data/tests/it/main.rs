//! Integration tests of weaver-data.

mod appearance;
mod capture;
mod dtu;
mod estimated;
mod exif;
mod film;
mod film_layouts;
mod lidar;
mod masked;
mod own_photos;
mod posed;
mod procedural;
mod quality;
mod real_captures;
mod sampler;
mod scene;
mod unreadable;
mod varied;

/// A folder for results.
fn claimed(folder: &std::path::Path) -> weaver_data::OutputFolder {
    weaver_data::OutputFolder::claim(folder, "test", [""; 0]).unwrap()
}
