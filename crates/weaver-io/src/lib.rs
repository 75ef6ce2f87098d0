//! File formats: images, PLY, COLMAP, transforms.json, RealEstate10K, safetensors.

mod image;

pub use image::Image;
