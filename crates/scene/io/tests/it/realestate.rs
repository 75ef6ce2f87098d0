use proptest::prelude::*;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_io::realestate::{Clip, ClipFrame};

const LINE: &str = "52553000 0.474 0.843 0.5 0.5 0 0 1 0 0 -0.25 0 0 -1 0.5 0 1 0 2";

fn clip() -> Clip {
    let frame = |i: u64| ClipFrame {
        timestamp: 33_000 * i,
        normalized: [0.5, 0.9, 0.5, 0.5],
        pose: Pose::from_wxyz([1.0, 0.3 * i as f64, -0.1, 0.2], DVec3::new(0.1, 0.2, i as f64)),
    };
    Clip { url: "https://www.youtube.com/watch?v=x".into(), frames: (0..4).map(frame).collect() }
}

#[test]
fn reads_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    std::fs::write(&path, format!("https://www.youtube.com/watch?v=x\n{LINE}\n")).unwrap();
    let clip = Clip::read(&path).unwrap();
    let frame = clip.frames[0];
    assert_eq!(frame.timestamp, 52_553_000);
    assert_eq!(frame.intrinsics(200, 100).fy, 84.3);
    assert_eq!(frame.pose.translation, DVec3::new(-0.25, 0.5, 2.0));
    assert!((frame.pose.apply(DVec3::Z) - DVec3::new(-0.25, -0.5, 2.0)).length() < 1e-12);
}

#[test]
fn round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    clip().write(&path).unwrap();
    let back = Clip::read(&path).unwrap();
    assert_eq!(back.frames.len(), 4);
    for (a, b) in clip().frames.iter().zip(&back.frames) {
        assert_eq!((a.timestamp, a.normalized), (b.timestamp, b.normalized));
        assert!(a.pose.angle_to(&b.pose) < 1e-7 && a.pose.translation == b.pose.translation);
    }
}

#[test]
fn messages_name_file_line_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    let message = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Clip::read(&path).unwrap_err().to_string()
    };
    let cases = [
        (String::new(), "line 1: expected a URL"),
        (format!("http://x\n{LINE} 7"), "line 2: expected 19 numbers, found 20"),
        (
            format!("http://x\n{}", LINE.replace("0.843", "nan")),
            "line 2, column 3: expected a finite number, found nan",
        ),
        (format!("http://x\n{}", LINE.replace("0.5 0.5 0 0", "0.5 0.5 0 0.1")), "line 2, distortion"),
        (format!("http://x\n{}", LINE.replace("-1 0.5", "-2 0.5")), "line 2, matrix: expected a rigid"),
    ];
    for (text, expected) in cases {
        let message = message(&text);
        assert!(message.contains("a.txt: ") && message.contains(expected), "{message}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 10))]

    #[test]
    fn hostile_files_never_panic(at in 0.0..1.0f64, byte in any::<u8>(), keep in 0.0..1.0f64) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        clip().write(&path).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let index = (at * bytes.len() as f64) as usize;
        bytes[index] = byte;
        bytes.truncate((keep * 2.0 * bytes.len() as f64) as usize);
        std::fs::write(&path, &bytes).unwrap();
        let _ = Clip::read(&path);
    }
}
