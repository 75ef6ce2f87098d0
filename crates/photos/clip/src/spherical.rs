//! Clips that show the whole sphere, by their own records.

use std::ops::Range;
use std::path::Path;
use weaver_io::{Result, file_length, read_part};

/// The most of a file that is looked at: the record stands among the descriptions of tracks.
const MOST: u64 = 64 << 20;
/// Where Matroska has its descriptions.
const HEAD: u64 = 1 << 20;
/// The element `ProjectionType` of Matroska, of one byte with the number of the equirectangular projection.
const MATROSKA: &[u8] = &[0x76, 0x71, 0x81, 0x01];

/// True if a clip's own record says that its pictures are equirectangular: MP4 by Google's Spherical Video, version 1
/// (XML in a box of the track) or 2 (boxes `sv3d`, `proj` and `equi`), Matroska by its element.
///
/// Source: Google, Spherical Video RFC and Spherical Video V2 RFC.
pub(crate) fn is_spherical(clip: &Path) -> bool {
    let length = file_length(clip).unwrap_or(0);
    let start = read_part(clip, 0..length.min(HEAD)).unwrap_or_default();
    if start.starts_with(&[0x1a, 0x45, 0xdf, 0xa3]) {
        return contains(&start, MATROSKA);
    }
    let descriptions = movie(clip, length).ok().flatten();
    let descriptions = descriptions.and_then(|range| read_part(clip, range).ok()).unwrap_or_default();
    let version_1 = contains(&descriptions, b"GSpherical:ProjectionType>equirectangular");
    let version_2 = [&b"sv3d"[..], b"proj", b"equi"].iter().all(|name| contains(&descriptions, name));
    version_1 || version_2
}

/// The place of the box `moov`, which describes the tracks: at the beginning or behind the pictures.
fn movie(clip: &Path, length: u64) -> Result<Option<Range<u64>>> {
    let mut at = 0;
    while at + 8 <= length {
        let header = read_part(clip, at..length.min(at + 16))?;
        let short = u64::from(u32::from_be_bytes([header[0], header[1], header[2], header[3]]));
        let long = header.get(8..16).and_then(|bytes| bytes.try_into().ok()).map(u64::from_be_bytes);
        let size = match short {
            0 => length - at,
            1 => long.unwrap_or(0),
            size => size,
        };
        // A smaller box would never end.
        let Some(end) = at.checked_add(size).filter(|end| size >= 8 && *end <= length) else { return Ok(None) };
        if &header[4..8] == b"moov" {
            return Ok(Some(at..end.min(at + MOST)));
        }
        at = end;
    }
    Ok(None)
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes_of(name: &[u8; 4], content: &[u8]) -> Vec<u8> {
        [&(content.len() as u32 + 8).to_be_bytes()[..], name, content].concat()
    }

    fn spherical(bytes: &[u8]) -> bool {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        std::fs::write(&path, bytes).unwrap();
        is_spherical(&path)
    }

    /// Boxes as both versions of Spherical Video have them, behind the pictures and before.
    ///
    /// Promise (photos): clips of 360-degree cameras are recognized by their record.
    #[test]
    fn spherical_clips_are_recognized() {
        let uuid = b"\xff\xcc\x82\x63\xf8\x55\x4a\x93\x88\x14\x58\x7a\x02\x52\x1f\xdd";
        let xml = b"<?xml version=\"1.0\"?><rdf:SphericalVideo><GSpherical:Spherical>true</GSpherical:Spherical>\
                    <GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType></rdf:SphericalVideo>";
        let ftyp = bytes_of(b"ftyp", b"isom\0\0\0\0");
        let pictures = bytes_of(b"mdat", &[7; 100]);
        let track = |content: &[u8]| bytes_of(b"moov", &bytes_of(b"trak", content));
        let version_1 = track(&bytes_of(b"uuid", &[&uuid[..], xml].concat()));
        let version_2 = track(&bytes_of(b"sv3d", &bytes_of(b"proj", &bytes_of(b"equi", &[0; 20]))));
        assert!(spherical(&[&ftyp[..], &pictures, &version_1].concat()));
        assert!(spherical(&[&ftyp[..], &version_2, &pictures].concat()));
        // A box with a length of eight bytes.
        let long = [&[0, 0, 0, 1][..], b"mdat", &20_u64.to_be_bytes(), &[0; 4]].concat();
        assert!(spherical(&[&ftyp[..], &long, &version_1].concat()));
        assert!(spherical(&[&[0x1a, 0x45, 0xdf, 0xa3][..], &[0; 40], MATROSKA].concat()));
    }

    #[test]
    fn other_clips_are_not() {
        let ftyp = bytes_of(b"ftyp", b"isom\0\0\0\0");
        assert!(!spherical(b"") && !spherical(b"abc") && !spherical(&ftyp));
        assert!(!spherical(&[&ftyp[..], &bytes_of(b"moov", &bytes_of(b"trak", &[0; 50]))].concat()));
        // The words among the pictures, and boxes that do not end.
        let words = bytes_of(b"mdat", b"GSpherical:ProjectionType>equirectangular");
        assert!(!spherical(&[&ftyp[..], &words].concat()));
        assert!(!spherical(&[&ftyp[..], &[0, 0, 0, 2], b"moov"].concat()));
        assert!(!spherical(&[&ftyp[..], &[0xff; 16]].concat()));
        assert!(!spherical(&[&[0x1a, 0x45, 0xdf, 0xa3][..], &[0; 40]].concat()));
    }
}
