//! Comparisons with other codecs.

use crate::command::{refused, told, wave};
use weaver_io::Bitmap;

#[test]
fn a_report_has_crops_and_curves_at_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let photo = wave(220, 200, 0.0);
    photo.write_png(here.join("p.png")).unwrap();
    let text = told(here, "bench @p.png -o @out --steps 10 --ratios 50,10");
    assert!(text.contains("JPEG, own") && text.contains("floor"), "{text}");
    assert_eq!(text.lines().count(), 6, "{text}");
    let page = std::fs::read_to_string(here.join("out/report.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("JPEG, own") && page.matches("<img").count() >= 3);
    let bitmap = Bitmap { width: photo.width, height: photo.height, pixels: photo.to_bytes() };
    std::fs::create_dir(here.join("others")).unwrap();
    for quality in [2, 20, 60, 95] {
        std::fs::write(here.join(format!("others/p-{quality}.jpg")), bitmap.to_jpeg(quality).unwrap()).unwrap();
    }
    // An AVIF file, of interest for its length only, and its decoded picture.
    std::fs::write(here.join("others/p-9.avif"), [0; 900]).unwrap();
    bitmap.write_png(here.join("others/p-9.avif.png")).unwrap();
    let text = told(here, "bench @p.png --others @others --steps 10 --ratios 5");
    assert!(text.contains("AVIF") && text.contains("JPEG") && !text.contains("own"), "{text}");
    wave(9, 9, 0.0).write_png(here.join("others/p-9.avif.png")).unwrap();
    refused(
        here,
        "bench @p.png --others @others --steps 10 --ratios 5",
        "expected the picture's [220, 200] pixels, found [9, 9]",
    );
    refused(here, "bench @p.png --ratios 5,0", "--ratios: expected numbers above 0, found 0");
}
