//! Places of photos.

use exif::experimental::Writer;
use exif::{Field, In, Rational, Tag, Value};
use std::io::Cursor;
use weaver_geometry::glam::DVec3;
use weaver_io::photo_place;

fn jpeg(segments: &[&[u8]]) -> Vec<u8> {
    let mut bytes = vec![0xff, 0xd8];
    for segment in segments {
        bytes.extend([0xff, 0xe1]);
        bytes.extend((segment.len() as u16 + 2).to_be_bytes());
        bytes.extend(*segment);
    }
    bytes.extend([0xff, 0xd9]);
    bytes
}

fn gps(latitude: [u32; 3], letters: [&str; 2], longitude: [u32; 3], altitude: (u8, u32)) -> Vec<u8> {
    let parts =
        |x: [u32; 3]| Value::Rational(vec![(x[0], 1).into(), (x[1], 1).into(), Rational { num: x[2], denom: 100 }]);
    let letter = |text: &str| Value::Ascii(vec![text.as_bytes().to_vec()]);
    let fields = [
        (Tag::GPSLatitudeRef, letter(letters[0])),
        (Tag::GPSLatitude, parts(latitude)),
        (Tag::GPSLongitudeRef, letter(letters[1])),
        (Tag::GPSLongitude, parts(longitude)),
        (Tag::GPSAltitudeRef, Value::Byte(vec![altitude.0])),
        (Tag::GPSAltitude, Value::Rational(vec![Rational { num: altitude.1, denom: 10 }])),
    ];
    let fields = fields.map(|(tag, value)| Field { tag, ifd_num: In::PRIMARY, value });
    let (mut writer, mut bytes) = (Writer::new(), Cursor::new(Vec::new()));
    fields.iter().for_each(|field| writer.push_field(field));
    writer.write(&mut bytes, true).unwrap();
    [b"Exif\0\0", &bytes.into_inner()[..]].concat()
}

/// The XMP that drones of DJI write, shortened.
const DJI: &str = r#"http://ns.adobe.com/xap/1.0/ <x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF>
  <rdf:Description rdf:about="DJI Meta Data" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"
   drone-dji:AbsoluteAltitude="+198.31" drone-dji:RelativeAltitude="+50.20" drone-dji:GpsLatitude="46.842612345"
   drone-dji:GpsLongtitude="-91.994123456" drone-dji:GimbalRollDegree="+0.00" drone-dji:GimbalYawDegree="-27.60"
   drone-dji:GimbalPitchDegree="-60.00"/></rdf:RDF></x:xmpmeta>"#;

/// Promise (photos): the place of a photo is read from its EXIF, and from what drones of DJI write beside it.
#[test]
fn photos_tell_where_they_were_taken() {
    let folder = tempfile::tempdir().unwrap();
    let place = |bytes: &[u8]| {
        let path = folder.path().join("a.jpg");
        std::fs::write(&path, bytes).unwrap();
        photo_place(path).unwrap()
    };
    // The first photo of OpenDroneMap's caliterra.
    let north = gps([30, 10, 1640], ["N", "W"], [98, 5, 2397], (0, 3173));
    let found = place(&jpeg(&[&north])).unwrap();
    assert!((found.position.latitude - (30.0 + 10.0 / 60.0 + 16.4 / 3600.0)).abs() < 1e-12);
    assert!((found.position.longitude + 98.0 + 5.0 / 60.0 + 23.97 / 3600.0).abs() < 1e-12);
    assert_eq!((found.position.altitude, found.up), (317.3, None));
    let south = place(&jpeg(&[&gps([30, 0, 0], ["S", "E"], [98, 0, 0], (1, 123))])).unwrap().position;
    assert_eq!((south.latitude, south.longitude, south.altitude), (-30.0, 98.0, -12.3));
    // A drone's own entries have more digits, and the gimbal's pitch: 60 degrees below the horizon.
    let found = place(&jpeg(&[&north, DJI.as_bytes()])).unwrap();
    assert_eq!((found.position.latitude, found.position.longitude), (46.842612345, -91.994123456));
    assert_eq!(found.position.altitude, 198.31);
    let up = DVec3::new(0.0, -0.5, -(0.75_f64.sqrt()));
    assert!(found.up.unwrap().distance(up) < 1e-12, "{:?}", found.up);
    // No fix, no place on the Earth, no entries.
    assert_eq!(place(&jpeg(&[&gps([0, 0, 0], ["N", "E"], [0, 0, 0], (0, 0))])), None);
    assert_eq!(place(&jpeg(&[&gps([95, 0, 0], ["N", "E"], [1, 0, 0], (0, 0))])), None);
    assert_eq!(place(&jpeg(&[])), None);
    assert_eq!(place(&jpeg(&[&north[..40]])), None);
}
