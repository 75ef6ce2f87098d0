//! The camera's own record in its photos.

use weaver_io::focal_35mm;

/// The tag of the focal length that a lens would have on 35 mm film.
pub const FOCAL: u16 = 0xa405;

/// EXIF with one number under a tag of its own directory, after the header of a JPEG file.
pub fn photo(tag: u16, focal: u16) -> Vec<u8> {
    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    let mut directory = |entries: &[[u16; 6]]| {
        tiff.extend((entries.len() as u16).to_le_bytes());
        entries.iter().flatten().for_each(|word| tiff.extend(word.to_le_bytes()));
        tiff.extend([0; 4]);
    };
    // Tag, type (4: 32 bits, 3: 16 bits), count, value.
    directory(&[[0x8769, 4, 1, 0, 26, 0]]);
    directory(&[[tag, 3, 1, 0, focal, 0]]);
    let length = (2 + 6 + tiff.len()) as u16;
    [&[0xff, 0xd8, 0xff, 0xe1][..], &length.to_be_bytes(), b"Exif\0\0", &tiff, &[0xff, 0xd9]].concat()
}

/// Promise (photos): the focal length in a file's EXIF is used where none is given.
#[test]
fn the_focal_length_is_what_the_file_tells() {
    let folder = tempfile::tempdir().unwrap();
    let told = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        focal_35mm(&path).unwrap()
    };
    assert_eq!(told("phone.jpg", &photo(FOCAL, 26)), Some(26.0));
    assert_eq!(told("unknown.jpg", &photo(FOCAL, 0)), None);
    assert_eq!(told("other.jpg", &photo(0xa406, 26)), None);
    assert_eq!(told("cut.jpg", &photo(FOCAL, 26)[..30]), None);
    assert_eq!(told("text.jpg", b"no photo"), None);
    assert!(focal_35mm(folder.path().join("nothing.jpg")).is_err());
}
