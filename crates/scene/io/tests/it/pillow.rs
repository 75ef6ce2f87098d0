//! Resizing against Pillow 11.1 on the same image: noise on its left, hard edges on its right.

use std::path::Path;
use weaver_io::{Background, Image};

fn read(name: &str) -> Image {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/pillow");
    Image::read(folder.join(format!("{name}.png")), Background::White).unwrap()
}

type Resize = fn(&Image, usize, usize) -> Image;

/// Larger, smaller, and larger one way while smaller the other: not one value of 8 bits is another.
///
/// Promise (photos): resizing gives Pillow's values, to the bit.
#[test]
fn resizing_equals_that_of_pillow() {
    let source = read("source");
    let whole: Resize = |image, width, height| image.resize(width, height, [0.0, 0.0, 19.0, 13.0]);
    for (filter, resize) in [("bicubic", Image::resize_bicubic as Resize), ("lanczos", whole)] {
        for (width, height) in [(7, 5), (31, 23), (8, 20), (40, 3), (1, 1)] {
            let name = format!("{filter}_{width}x{height}");
            assert_eq!(resize(&source, width, height).to_bytes(), read(&name).to_bytes(), "{name}");
        }
    }
    assert_eq!(source.resize(9, 6, [0.5, 1.25, 17.5, 12.0]).to_bytes(), read("part_9x6").to_bytes());
}
