//! The camera's own record in its photos.

use crate::{Error, Result};
use std::fs::File;
use std::io::{BufReader, Cursor};
use std::path::Path;

/// The focal length of a photo in millimeters, on a film of 36 x 24 mm with the photo's diagonal (EXIF's
/// `FocalLengthIn35mmFilm`); `None` if the file has none.
///
/// # Errors
/// When the file cannot be opened. Malformed EXIF is ignored.
pub fn focal_35mm(path: impl AsRef<Path>) -> Result<Option<f64>> {
    let path = path.as_ref();
    let file = File::open(path).map_err(Error::io(path))?;
    let Ok(fields) = exif::Reader::new().read_from_container(&mut BufReader::new(file)) else { return Ok(None) };
    let field = fields.get_field(exif::Tag::FocalLengthIn35mmFilm, exif::In::PRIMARY);
    Ok(field.and_then(|f| f.value.get_uint(0)).filter(|f| *f > 0).map(f64::from))
}

/// EXIF with such a focal length alone, whole millimeters.
pub(crate) fn exif_of_focal(millimeters: f64) -> Option<Vec<u8>> {
    let value = exif::Value::Short(vec![millimeters as u16]);
    let field = exif::Field { tag: exif::Tag::FocalLengthIn35mmFilm, ifd_num: exif::In::PRIMARY, value };
    let (mut writer, mut bytes) = (exif::experimental::Writer::new(), Cursor::new(Vec::new()));
    writer.push_field(&field);
    writer.write(&mut bytes, true).ok()?;
    Some(bytes.into_inner())
}
