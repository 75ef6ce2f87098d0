//! Panoramas: photos of a whole sphere, or of a part of one, by their own records.

use crate::{Error, Result};
use std::f64::consts::{PI, TAU};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use weaver_geometry::glam::{DVec2, DVec3};

/// Bytes at the start of a file that hold its XMP: JPEGs have it before the picture.
const HEAD: u64 = 1 << 18;
/// Makers of cameras whose photos of 2:1 are spheres, as EXIF names them.
const MAKERS: [&str; 3] = ["insta360", "arashi vision", "ricoh"];
/// Difference of proportions, as a part of them, that rounding explains.
const ROUNDED: f64 = 0.01;

/// Where the pixels of an equirectangular photo lie on the sphere: columns are longitudes and rows latitudes, equally
/// spaced. The middle of the sphere is ahead; up is up.
///
/// A direction (x right, y down, z ahead) of length 1 is in column `w (1/2 + atan2(x, z) / 2 pi)` and row `w/2 (1/2 +
/// asin(y) / pi)` of the whole sphere, w its width.
///
/// ```
/// use weaver_geometry::glam::{DVec2, DVec3};
/// use weaver_io::Panorama;
///
/// let whole = Panorama::whole((360, 180));
/// assert_eq!(whole.pixel(DVec3::Z), Some(DVec2::new(180.0, 90.0)));
/// assert_eq!(whole.pixel(DVec3::X), Some(DVec2::new(270.0, 90.0)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panorama {
    /// Width of the whole sphere, in pixels of the photo; its height is half of that.
    pub width: f64,
    /// Column and row of the photo's corner in the whole.
    pub corner: [f64; 2],
    /// Width and height of the photo.
    pub size: (usize, usize),
}

impl Panorama {
    /// A photo of this size that is a whole sphere.
    pub fn whole(size: (usize, usize)) -> Self {
        Self { width: size.0 as f64, corner: [0.0; 2], size }
    }

    /// True for the size of a whole sphere: twice as wide as high.
    pub fn fits((width, height): (usize, usize)) -> bool {
        height > 0 && width / 2 == height
    }

    /// The panorama in a photo of this size, by its own records: the Photo Sphere XMP (`GPano`) with the projection
    /// `equirectangular`, or, for twice as wide as high, an EXIF maker whose cameras take whole spheres (Insta360,
    /// Ricoh). `None` for any other photo.
    ///
    /// `FullPanoWidthPixels`, `FullPanoHeightPixels` and the `CroppedArea` entries place a photo that is a part of the
    /// sphere; a photo that was resized since then is placed by its proportions.
    ///
    /// Source: Google, Photo Sphere XMP Metadata, <https://developers.google.com/streetview/spherical-metadata>.
    ///
    /// # Errors
    /// When the file cannot be opened, and when the entries contradict one another or the photo's size.
    pub fn of(path: impl AsRef<Path>, size: (usize, usize)) -> Result<Option<Self>> {
        let path = path.as_ref();
        let mut head = Vec::new();
        let file = File::open(path).map_err(Error::io(path))?;
        file.take(HEAD).read_to_end(&mut head).map_err(Error::io(path))?;
        let xmp = String::from_utf8_lossy(&head);
        match entry(&xmp, "ProjectionType") {
            Some(projection) if projection.eq_ignore_ascii_case("equirectangular") => {
                Self::of_entries(&xmp, path, size).map(Some)
            }
            _ => Ok((Self::fits(size) && is_by_maker(path)).then(|| Self::whole(size))),
        }
    }

    fn of_entries(xmp: &str, path: &Path, size: (usize, usize)) -> Result<Self> {
        let invalid = |key: &str, expected: String, found: String| Error::invalid(path, key, expected, found);
        let number = |key: &str| -> Result<Option<f64>> {
            let Some(text) = entry(xmp, key) else { return Ok(None) };
            let found = text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0);
            found.map(Some).ok_or_else(|| invalid(&format!("GPano:{key}"), "pixels".into(), text.into()))
        };
        let area = [number("CroppedAreaImageWidthPixels")?, number("CroppedAreaImageHeightPixels")?];
        let full = [number("FullPanoWidthPixels")?, number("FullPanoHeightPixels")?];
        let corner = [number("CroppedAreaLeftPixels")?, number("CroppedAreaTopPixels")?].map(|x| x.unwrap_or(0.0));
        let here = [size.0 as f64, size.1 as f64];
        let area = [0, 1].map(|i| area[i].unwrap_or(here[i]));
        let full = [0, 1].map(|i| full[i].unwrap_or(here[i]));
        let [width, height] = full;
        if (width / (2.0 * height) - 1.0).abs() > ROUNDED || height < 1.0 {
            let expected = "a sphere twice as wide as high, and of a part of it where that part lies".into();
            let found = format!("{width} x {height} for a photo of {} x {}", size.0, size.1);
            return Err(invalid("GPano:FullPanoWidthPixels", expected, found));
        }
        let scale = here[0] / area[0];
        if (scale * area[1] / here[1] - 1.0).abs() > ROUNDED {
            let expected = format!("the photo's proportions, {} x {}; was it cropped since?", size.0, size.1);
            let found = format!("{} x {}", area[0], area[1]);
            return Err(invalid("GPano:CroppedAreaImageWidthPixels", expected, found));
        }
        if (0..2).any(|i| corner[i] + area[i] > (1.0 + ROUNDED) * full[i]) {
            let expected = format!("a part of {width} x {height} pixels");
            let found = format!("{} x {} pixels from column {}, row {}", area[0], area[1], corner[0], corner[1]);
            return Err(invalid("GPano:CroppedAreaLeftPixels", expected, found));
        }
        Ok(Self { width: width * scale, corner: corner.map(|x| x * scale), size })
    }

    /// True if the photo shows all of the sphere.
    pub fn is_whole(&self) -> bool {
        let [left, top] = self.corner;
        left == 0.0 && top == 0.0 && Self::fits(self.size) && (self.width / self.size.0 as f64 - 1.0).abs() < ROUNDED
    }

    /// The pixel of the photo in which a direction (x right, y down, z ahead) is seen; `None` outside of the photo.
    pub fn pixel(&self, direction: DVec3) -> Option<DVec2> {
        let DVec3 { x, y, z } = direction.normalize();
        let column = self.width * (0.5 + x.atan2(z) / TAU) - self.corner[0];
        let row = 0.5 * self.width * (0.5 + y.asin() / PI) - self.corner[1];
        let column = column.rem_euclid(self.width);
        let inside = column <= self.size.0 as f64 && (0.0..=self.size.1 as f64).contains(&row);
        inside.then_some(DVec2::new(column, row))
    }
}

/// An entry of GPano: an attribute or an element.
fn entry<'a>(xmp: &'a str, key: &str) -> Option<&'a str> {
    let name = format!("GPano:{key}");
    let at = |at: usize| {
        let rest = xmp[at + name.len()..].trim_start();
        if let Some(value) = rest.strip_prefix('>') {
            return value.split('<').next();
        }
        let value = rest.strip_prefix('=')?.trim_start();
        let quote = value.chars().next().filter(|quote| "\"'".contains(*quote))?;
        value[1..].split(quote).next()
    };
    xmp.match_indices(&name).find_map(|(place, _)| at(place)).map(str::trim)
}

/// True if EXIF names a maker of cameras that take whole spheres.
fn is_by_maker(path: &Path) -> bool {
    let Ok(file) = File::open(path) else { return false };
    let Ok(fields) = exif::Reader::new().read_from_container(&mut BufReader::new(file)) else { return false };
    let make = fields.get_field(exif::Tag::Make, exif::In::PRIMARY);
    let make = make.map(|field| field.display_value().to_string().to_lowercase()).unwrap_or_default();
    MAKERS.iter().any(|maker| make.contains(maker))
}

/// The segment of a JPEG with XMP of a whole sphere.
fn segment(width: usize, height: usize) -> Vec<u8> {
    let gpano = format!(
        "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\
         <rdf:Description rdf:about=\"\" xmlns:GPano=\"http://ns.google.com/photos/1.0/panorama/\" \
         GPano:ProjectionType=\"equirectangular\" GPano:FullPanoWidthPixels=\"{width}\" \
         GPano:FullPanoHeightPixels=\"{height}\" GPano:CroppedAreaImageWidthPixels=\"{width}\" \
         GPano:CroppedAreaImageHeightPixels=\"{height}\" GPano:CroppedAreaLeftPixels=\"0\" \
         GPano:CroppedAreaTopPixels=\"0\"/></rdf:RDF></x:xmpmeta>"
    );
    let content = [b"http://ns.adobe.com/xap/1.0/\0", gpano.as_bytes()].concat();
    let length = (content.len() + 2) as u16;
    [&[0xff, 0xe1][..], &length.to_be_bytes(), &content].concat()
}

/// The same JPEG, of this size, with the record that it is a whole sphere.
///
/// ```
/// use weaver_io::{Bitmap, Panorama, jpeg_of_panorama};
/// let picture = Bitmap { width: 4, height: 2, pixels: vec![128; 24] };
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("a.jpg");
/// std::fs::write(&path, jpeg_of_panorama(picture.to_jpeg(90).unwrap(), (4, 2))).unwrap();
/// assert_eq!(Panorama::of(&path, (4, 2))?, Some(Panorama::whole((4, 2))));
/// # Ok::<(), weaver_io::Error>(())
/// ```
pub fn jpeg_of_panorama(jpeg: Vec<u8>, (width, height): (usize, usize)) -> Vec<u8> {
    // Behind the marker of the start, and before anything else.
    match jpeg.strip_prefix(&[0xff, 0xd8]) {
        Some(rest) => [&[0xff, 0xd8][..], &segment(width, height), rest].concat(),
        None => jpeg,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bitmap;

    fn directions() -> impl Iterator<Item = DVec3> {
        (0..64).map(|i| {
            let (a, b) = (0.7 * f64::from(i), (f64::from(i) / 32.0 - 1.0).asin());
            DVec3::new(b.cos() * a.sin(), b.sin(), b.cos() * a.cos())
        })
    }

    /// A file of a JPEG with an XMP segment of these GPano entries.
    fn file(folder: &Path, gpano: &str, (width, height): (usize, usize)) -> std::path::PathBuf {
        let jpeg = Bitmap { width, height, pixels: vec![90; 3 * width * height] }.to_jpeg(90).unwrap();
        let content = [b"http://ns.adobe.com/xap/1.0/\0", gpano.as_bytes()].concat();
        let segment = [&[0xff, 0xe1][..], &((content.len() + 2) as u16).to_be_bytes(), &content].concat();
        let path = folder.join("a.jpg");
        std::fs::write(&path, [&jpeg[..2], &segment, &jpeg[2..]].concat()).unwrap();
        path
    }

    fn of(gpano: &str, size: (usize, usize)) -> Result<Option<Panorama>> {
        let folder = tempfile::tempdir().unwrap();
        Panorama::of(file(folder.path(), gpano, size), size)
    }

    /// Entries as attributes, with any quotes, and as elements.
    ///
    /// Promise (photos): panoramas are recognized by their Photo Sphere XMP, cropped ones too, or by their maker.
    #[test]
    fn photo_spheres_are_recognized() {
        let whole = Some(Panorama::whole((32, 16)));
        assert_eq!(of(r#"<rdf:Description GPano:ProjectionType="equirectangular"/>"#, (32, 16)).unwrap(), whole);
        assert_eq!(of("<rdf:Description GPano:ProjectionType = 'Equirectangular'/>", (32, 16)).unwrap(), whole);
        let elements = "<GPano:ProjectionType>equirectangular</GPano:ProjectionType>\n<GPano:FullPanoWidthPixels>6400\
                        </GPano:FullPanoWidthPixels><GPano:FullPanoHeightPixels>3200</GPano:FullPanoHeightPixels>\
                        <GPano:CroppedAreaImageWidthPixels>6400</GPano:CroppedAreaImageWidthPixels>\
                        <GPano:CroppedAreaImageHeightPixels>3200</GPano:CroppedAreaImageHeightPixels>";
        assert_eq!(of(elements, (32, 16)).unwrap(), whole);
        // Twice as wide as high says nothing alone, and other projections are no sphere.
        assert_eq!(of("", (32, 16)).unwrap(), None);
        assert_eq!(of(r#"GPano:ProjectionType="cylindrical""#, (32, 16)).unwrap(), None);
    }

    #[test]
    fn a_part_of_a_sphere_lies_where_it_says() {
        let part = r#"GPano:ProjectionType="equirectangular" GPano:FullPanoWidthPixels="640" GPano:FullPanoHeightPixels="320"
            GPano:CroppedAreaImageWidthPixels="320" GPano:CroppedAreaImageHeightPixels="160"
            GPano:CroppedAreaLeftPixels="160" GPano:CroppedAreaTopPixels="80""#;
        // At half of the size that the entries are for.
        let part = of(part, (160, 80)).unwrap().unwrap();
        assert_eq!(part, Panorama { width: 320.0, corner: [80.0, 40.0], size: (160, 80) });
        assert!(!part.is_whole() && Panorama::whole((160, 80)).is_whole());
        let whole = Panorama::whole((320, 160));
        for direction in directions() {
            let all = whole.pixel(direction).unwrap();
            let inside = all.x >= 80.0 && all.x <= 240.0 && all.y >= 40.0 && all.y <= 120.0;
            assert_eq!(part.pixel(direction), inside.then_some(all - DVec2::new(80.0, 40.0)), "{direction}");
        }
    }

    #[test]
    fn contradicting_entries_are_named() {
        let with = |more: &str, size| {
            of(&format!(r#"GPano:ProjectionType="equirectangular" {more}"#), size).unwrap_err().to_string()
        };
        let error = with("", (32, 24));
        assert!(error.contains("GPano:FullPanoWidthPixels") && error.contains("32 x 24"), "{error}");
        let error = with(r#"GPano:FullPanoWidthPixels="wide""#, (32, 16));
        assert!(error.contains("GPano:FullPanoWidthPixels") && error.contains("wide"), "{error}");
        let full = r#"GPano:FullPanoWidthPixels="64" GPano:FullPanoHeightPixels="32""#;
        let error = with(&format!(r#"{full} GPano:CroppedAreaLeftPixels="40""#), (32, 16));
        assert!(error.contains("GPano:CroppedAreaLeftPixels") && error.contains("column 40"), "{error}");
        let area = r#"GPano:CroppedAreaImageWidthPixels="40" GPano:CroppedAreaImageHeightPixels="20""#;
        let error = with(&format!("{full} {area}"), (32, 24));
        assert!(error.contains("GPano:CroppedAreaImageWidthPixels") && error.contains("40 x 20"), "{error}");
    }

    /// EXIF as a Theta writes it: little-endian, the maker in the first directory.
    #[test]
    fn makers_of_spheres_are_known() {
        let folder = tempfile::tempdir().unwrap();
        let of = |make: &str, (width, height): (usize, usize)| {
            let text = format!("{make}\0");
            let ifd = [
                &b"Exif\0\0II*\0\x08\0\0\0\x01\0\x0f\x01\x02\0"[..],
                &(text.len() as u32).to_le_bytes(),
                &26_u32.to_le_bytes(),
                &[0; 4],
                text.as_bytes(),
            ]
            .concat();
            let jpeg = Bitmap { width, height, pixels: vec![90; 3 * width * height] }.to_jpeg(90).unwrap();
            let segment = [&[0xff, 0xe1][..], &((ifd.len() + 2) as u16).to_be_bytes(), &ifd].concat();
            let path = folder.path().join("b.jpg");
            std::fs::write(&path, [&jpeg[..2], &segment, &jpeg[2..]].concat()).unwrap();
            Panorama::of(&path, (width, height)).unwrap()
        };
        let whole = Some(Panorama::whole((32, 16)));
        assert_eq!(of("RICOH", (32, 16)), whole);
        assert_eq!(of("Insta360", (32, 16)), whole);
        assert_eq!((of("RICOH", (32, 24)), of("Canon", (32, 16))), (None, None));
    }

    #[test]
    fn written_panoramas_are_recognized() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.jpg");
        let picture = Bitmap { width: 64, height: 32, pixels: vec![20; 3 * 64 * 32] };
        std::fs::write(&path, jpeg_of_panorama(picture.to_jpeg(95).unwrap(), (64, 32))).unwrap();
        assert_eq!(Panorama::of(&path, (64, 32)).unwrap(), Some(Panorama::whole((64, 32))));
        assert_eq!(crate::PhotoFile::at(&path).unwrap().read().unwrap().width, 64);
    }
}
