//! Where a photo was taken, and how its camera was held, by the photo itself.

use crate::{Error, Result};
use exif::{Exif, In, Tag, Value};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use weaver_geometry::geodesy::Geographic;
use weaver_geometry::glam::DVec3;

/// Bytes at the start of a file that hold its XMP: JPEGs have it before the picture.
const HEAD: u64 = 1 << 18;

/// A place of a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoPlace {
    /// Where the camera was.
    pub position: Geographic,
    /// The direction up in the camera's axes (right, down, forward) of the photo as it is stored, by the gimbal of a
    /// drone; a unit vector.
    pub up: Option<DVec3>,
}

/// Reads the place of a photo: `drone-dji` entries of its XMP, which have more digits, else the GPS of its EXIF; `None`
/// if the file has none.
///
/// A camera that is pitched by `p` and rolled by `r` has up at `(-cos p sin r, -cos p cos r, sin p)`.
///
/// # Errors
/// When the file cannot be opened. Malformed entries are ignored.
pub fn photo_place(path: impl AsRef<Path>) -> Result<Option<PhotoPlace>> {
    let path = path.as_ref();
    let open = || File::open(path).map_err(Error::io(path));
    let mut head = Vec::new();
    open()?.take(HEAD).read_to_end(&mut head).map_err(Error::io(path))?;
    let xmp = String::from_utf8_lossy(&head);
    let up = match (entry(&xmp, "GimbalPitchDegree"), entry(&xmp, "GimbalRollDegree")) {
        (Some(pitch), Some(roll)) => {
            let ((sin_p, cos_p), (sin_r, cos_r)) = (pitch.to_radians().sin_cos(), roll.to_radians().sin_cos());
            Some(DVec3::new(-cos_p * sin_r, -cos_p * cos_r, sin_p))
        }
        _ => None,
    };
    // Early firmware misspells the longitude.
    let longitude = entry(&xmp, "GpsLongitude").or_else(|| entry(&xmp, "GpsLongtitude"));
    let dji = match (entry(&xmp, "GpsLatitude"), longitude, entry(&xmp, "AbsoluteAltitude")) {
        (Some(latitude), Some(longitude), Some(altitude)) => Some(Geographic { latitude, longitude, altitude }),
        _ => None,
    };
    let of_exif = || exif::Reader::new().read_from_container(&mut BufReader::new(File::open(path).ok()?)).ok();
    let position = dji.or_else(|| gps(&of_exif()?)).filter(is_place);
    Ok(position.map(|position| PhotoPlace { position, up }))
}

/// True for a place on the Earth. Receivers without a fix write zeros.
fn is_place(place: &Geographic) -> bool {
    let Geographic { latitude, longitude, altitude } = *place;
    latitude.abs() <= 90.0
        && longitude.abs() <= 360.0
        && (-1e4..1e5).contains(&altitude)
        && (latitude, longitude) != (0.0, 0.0)
}

/// An entry of DJI, an attribute or an element.
fn entry(xmp: &str, key: &str) -> Option<f64> {
    let at = xmp.find(&format!("drone-dji:{key}"))?;
    let rest = xmp[at..].split_once(['"', '>'])?.1;
    let value = rest.split(['"', '<']).next()?;
    value.trim().parse().ok().filter(|x: &f64| x.is_finite())
}

/// The GPS entries of EXIF. A missing altitude is 0.
fn gps(exif: &Exif) -> Option<Geographic> {
    let field = |tag| exif.get_field(tag, In::PRIMARY);
    let numbers = |tag| match &field(tag)?.value {
        Value::Rational(numbers) => Some(numbers.iter().map(|x| x.to_f64()).collect::<Vec<_>>()),
        _ => None,
    };
    let is = |tag, letter: u8| match field(tag).map(|field| &field.value) {
        Some(Value::Ascii(text)) => text.first().is_some_and(|text| text.first() == Some(&letter)),
        Some(Value::Byte(bytes)) => bytes.first() == Some(&letter),
        _ => false,
    };
    let angle = |tag, negative: bool| {
        let parts = numbers(tag)?;
        let degrees: f64 = parts.iter().zip([1.0, 60.0, 3600.0]).map(|(x, by)| x / by).sum();
        degrees.is_finite().then_some(if negative { -degrees } else { degrees })
    };
    let latitude = angle(Tag::GPSLatitude, is(Tag::GPSLatitudeRef, b'S'))?;
    let longitude = angle(Tag::GPSLongitude, is(Tag::GPSLongitudeRef, b'W'))?;
    let height = numbers(Tag::GPSAltitude).and_then(|x| x.first().copied()).filter(|x| x.is_finite()).unwrap_or(0.0);
    let altitude = if is(Tag::GPSAltitudeRef, 1) { -height } else { height };
    Some(Geographic { latitude, longitude, altitude })
}
