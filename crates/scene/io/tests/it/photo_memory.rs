//! Memory of photos that are much larger than the kept size.

use flate2::read::GzDecoder;
use image::codecs::jpeg::JpegEncoder;
use std::io::Read;
use std::path::Path;
use std::process::Command;
use weaver_io::PhotoFile;

/// The photo that a process of its own is to read, so that nothing but reading it counts.
const PHOTO: &str = "WEAVER_IO_LARGE_PHOTO";

/// The most memory that this process has had, in MB.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? / 1000)
}

/// Four photos of 48 megapixels, as cameras write them and progressive, read and resized by four threads.
///
/// Under stress alone, for a photo takes many seconds to make and to read where nothing is optimized.
///
/// Promise (photos): four photos of 48 megapixels are read and shrunk within 300 MB, progressive ones too where
/// colors have half the resolution, as cameras write them.
#[test]
fn four_large_photos_fit_into_300_mb() {
    if let Some(photo) = std::env::var_os(PHOTO) {
        let resize = || PhotoFile::at(&photo).unwrap().resize_whole(512, 384).unwrap();
        std::thread::scope(|scope| (0..4).for_each(|_| drop(scope.spawn(resize))));
        let Some(peak) = peak() else { return };
        println!("peak {peak} MB");
        assert!(peak < 300, "{peak} MB");
        return;
    }
    if std::env::var_os("WEAVER_STRESS").is_none() {
        return println!("skipped: only under stress (photos of 48 megapixels)");
    }
    if peak().is_none() {
        return println!("skipped: this system does not tell the memory of a process");
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, write) in [("baseline", write_large as fn(&Path)), ("progressive", write_progressive)] {
        let path = folder.path().join("large.jpg");
        write(&path);
        let test = ["--exact", "photo_memory::four_large_photos_fit_into_300_mb", "--nocapture"];
        let output = Command::new(std::env::current_exe().unwrap()).args(test).env(PHOTO, &path).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{name}: {text}{}", String::from_utf8_lossy(&output.stderr));
        let peak = text.lines().find(|line| line.starts_with("peak")).expect("what was measured");
        println!("{name}: {peak}");
    }
}

/// 8000 x 6000 pixels with detail everywhere.
fn write_large(path: &Path) {
    let pixel = |x: u32, y: u32| image::Rgb([((x * y) >> 6) as u8, (x ^ y) as u8, (x / 8 + y / 4) as u8]);
    let photo = image::RgbImage::from_fn(8000, 6000, pixel);
    JpegEncoder::new_with_quality(std::fs::File::create(path).unwrap(), 90).encode_image(&photo).unwrap();
}

/// 8000 x 6000 pixels of one color, so that the file is small. Its colors have half the resolution.
fn write_progressive(path: &Path) {
    let packed = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/progressive_48mp.jpg.gz");
    let mut photo = Vec::new();
    GzDecoder::new(std::fs::File::open(packed).unwrap()).read_to_end(&mut photo).unwrap();
    std::fs::write(path, photo).unwrap();
}
