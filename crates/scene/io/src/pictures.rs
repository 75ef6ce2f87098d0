//! Photos and pictures: decoding, orientation, sizes, colors.

pub(crate) mod bitmap;
pub(crate) mod color;
pub(crate) mod depth;
pub(crate) mod exif;
pub(crate) mod heif;
pub(crate) mod image;
pub(crate) mod panorama;
pub(crate) mod photo_file;
pub(crate) mod photo_folder;
pub(crate) mod place;
pub(crate) mod resize;
