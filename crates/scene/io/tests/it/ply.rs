use crate::shared;
use proptest::prelude::*;
use std::path::Path;
use weaver_io::ply::{read_points, write_points};

use weaver_io::{read_gaussians, write_gaussians};
use weaver_scene::{Gaussians, PointCloud};

fn sample(n: usize, degree: usize) -> Gaussians {
    let k = (degree + 1) * (degree + 1);
    let value = |i: usize| (i as f32 * 0.37).sin();
    Gaussians {
        means: (0..n).map(|i| [value(i), value(i + 1), i as f32]).collect(),
        log_scales: (0..n).map(|i| [value(i), -3.0, -4.5]).collect(),
        quats: (0..n).map(|i| [1.0, value(i), 0.1, 0.2]).collect(),
        opacity_logits: (0..n).map(value).collect(),
        sh: (0..n * k * 3).map(|i| i as f32).collect(),
        degree,
    }
}

#[test]
fn round_trip_at_every_degree() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for degree in 0..=4 {
        for n in [0, 5] {
            write_gaussians(&path, &sample(n, degree)).unwrap();
            assert_eq!(read_gaussians(&path).unwrap(), sample(n, degree));
        }
    }
}

#[test]
fn the_rest_is_channel_major() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    write_gaussians(&path, &sample(1, 1)).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let head = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let row: Vec<f32> = bytes[head..].chunks_exact(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect();
    // x y z nx ny nz, then coefficient 0 of red green blue, then coefficients 1 2 3 of red, of green, of blue.
    assert_eq!(row[6..18], [0.0, 1.0, 2.0, 3.0, 6.0, 9.0, 4.0, 7.0, 10.0, 5.0, 8.0, 11.0]);
}

const ASCII: &str = "ply\r\nformat ascii 1.0\ncomment by hand\nelement camera 1\nproperty uchar id\nelement vertex 1
property double x\nproperty float y\nproperty float z\nproperty float f_dc_0\nproperty float f_dc_1
property float f_dc_2\nproperty float opacity\nproperty float scale_0\nproperty float scale_1\nproperty float scale_2
property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\nelement face 1
property list uchar int vertex_indices\nend_header\n200\n1 2 3 0.1 0.2 0.3 -1 -2 -3 -4 1 0 0 0.5\n3 0 0 0\n";

#[test]
fn reads_text() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    std::fs::write(&path, ASCII).unwrap();
    let splats = read_gaussians(&path).unwrap();
    assert_eq!((splats.means[0], splats.quats[0]), ([1.0, 2.0, 3.0], [1.0, 0.0, 0.0, 0.5]));
    assert_eq!((splats.sh.as_slice(), splats.opacity_logits[0]), ([0.1, 0.2, 0.3].as_slice(), -1.0));
}

#[test]
fn missing_properties_are_filled_as_viewers_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let read = |text: String| {
        std::fs::write(&path, text).unwrap();
        read_gaussians(&path).unwrap()
    };
    let rename = |names: &[(&str, &str)]| {
        names
            .iter()
            .fold(ASCII.to_string(), |text, (from, to)| text.replace(&format!("float {from}"), &format!("float {to}")))
    };
    assert_eq!(read(rename(&[("opacity", "alpha")])).opacity_logits, [f32::INFINITY]);
    let unturned = [("rot_0", "a"), ("rot_1", "b"), ("rot_2", "c"), ("rot_3", "d")];
    assert_eq!(read(rename(&unturned)).quats, [[1.0, 0.0, 0.0, 0.0]]);
    let gray = read(rename(&[("f_dc_0", "a"), ("f_dc_1", "b"), ("f_dc_2", "c")]));
    assert_eq!((gray.sh, gray.degree), (vec![0.0; 3], 0));
    let colored = rename(&[("f_dc_0", "red"), ("f_dc_1", "green"), ("f_dc_2", "blue")]);
    let colored = read(colored.replace("0.1 0.2 0.3", "255 127.5 0"));
    assert!((colored.sh[0] * 0.2820948 - 0.5).abs() < 1e-6 && colored.sh[1] == 0.0 && colored.sh[2] < 0.0);
}

#[test]
fn messages_say_where() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let cases = [
        (ASCII.replace("ply\r", "plx\r"), "header line 1: expected a PLY file"),
        (ASCII.replace("format ascii", "format binary_big_endian"), "header line 2: expected format"),
        (ASCII.replace("float rot_2", "float turn"), "element vertex: expected a property rot_2, found only x y z"),
        (ASCII.replace("float scale_0", "float size"), "element vertex: expected Gaussians, found a point cloud"),
        (ASCII.replace("f_dc_1", "green"), "element vertex: expected a property f_dc_1"),
        (ASCII.replace("float opacity", "half opacity"), "header line 13: expected a scalar type"),
        (ASCII.replace("element vertex 1", "element vertex 99999999999"), "element vertex: expected 99999999999 rows"),
        (ASCII.replace("0.5\n3 0", "nan\n3 0"), "vertex 0, rotation: expected finite numbers"),
        (ASCII.replace("0.3 -1", "0.3 x"), "vertex 0, property opacity: expected a number, found x"),
        (ASCII.replace("float f_dc_0", "float f_rest_0"), "expected 0, 9, 24, 45 or 72 properties f_rest_*, found 1"),
        (ASCII.replace("uchar id", "list uchar int id"), "element camera: expected scalar properties"),
        (
            ASCII.replace("float f_dc_0", "uint packed_position"),
            "header: expected format binary_little_endian 1.0, found ascii",
        ),
        (ASCII.replace("element vertex", "element point"), "header: expected an element named vertex"),
    ];
    for (text, expected) in cases {
        std::fs::write(&path, text).unwrap();
        let message = read_gaussians(&path).unwrap_err().to_string();
        assert!(message.contains("a.ply: ") && message.contains(expected), "{message}\n{expected}");
    }
    let broken = Gaussians { sh: vec![], ..sample(2, 1) };
    let message = write_gaussians(&path, &broken).unwrap_err().to_string();
    assert!(message.contains("expected 2 Gaussians"), "{message}");
}

#[test]
fn point_clouds() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let points = PointCloud { positions: vec![[0.0, 1.0, 2.0]; 3], colors: vec![[1, 2, 3]; 3] };
    write_points(&path, &points).unwrap();
    assert_eq!(read_points(&path).unwrap(), points);
    let text = weaver_io::info(&path).unwrap();
    assert!(text.contains("PLY, 3 vertices") && text.contains("green        2.0000 to 2.0000"), "{text}");
    assert!(write_points(&path, &PointCloud { colors: vec![], ..points }).is_err());
    std::fs::write(&path, "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n")
        .unwrap();
    assert_eq!(read_points(&path).unwrap(), PointCloud { positions: vec![[1.0, 2.0, 3.0]], colors: vec![[255; 3]] });
}

/// Rows of numbers from a CSV file with a header.
fn csv(path: &Path) -> Vec<Vec<f32>> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect()
}

fn assert_row(splats: &Gaussians, i: usize, row: &[f32], tolerance: f32) {
    let k = splats.coefficients();
    let sh = &splats.sh[i * k * 3..][..k * 3];
    let norm = splats.quats[i].iter().map(|x| x * x).sum::<f32>().sqrt();
    let unit = splats.quats[i].map(|x| x / norm);
    let rest = (0..3).flat_map(|channel| (1..k).map(move |c| sh[c * 3 + channel]));
    let ours = (splats.means[i].into_iter())
        .chain(splats.log_scales[i])
        .chain(sh[..3].iter().copied())
        .chain([splats.opacity_logits[i]])
        .chain(unit)
        .chain(rest);
    let ours: Vec<f32> = ours.collect();
    assert_eq!(ours.len(), row.len());
    for (a, b) in ours.iter().zip(row) {
        assert!((a - b).abs() < tolerance, "Gaussian {i}: {a} {b}");
    }
}

#[test]
fn files_of_other_tools() {
    let Some(folder) = shared::data("splat-files") else { return };
    let splats = read_gaussians(folder.join("playbot-sh2.ply")).unwrap();
    assert_eq!((splats.len(), splats.degree), (8406, 2));
    for (i, row) in csv(&folder.join("playbot-sh2.first64.csv")).iter().enumerate() {
        assert_row(&splats, i, row, 1e-5);
    }
    let splats = read_gaussians(folder.join("minimal.splat")).unwrap();
    assert_eq!(splats.len(), 4);
    for (i, row) in csv(&folder.join("minimal.splat.decoded.csv")).iter().enumerate() {
        // The other tool takes 127.5 for the zero of rotations, half a step from ours.
        assert_row(&splats, i, row, 4e-3);
    }
    let compressed = read_gaussians(folder.join("playbot-sh2.compressed.ply")).unwrap();
    assert_eq!((compressed.len(), compressed.degree), (8406, 2));
    let plain = read_gaussians(folder.join("playbot-sh2.ply")).unwrap();
    let distance = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f32>().sqrt();
    let mut alike = 0;
    for (i, mean) in compressed.means.iter().enumerate().step_by(10) {
        let near = (0..plain.len())
            .min_by(|a, b| distance(mean, &plain.means[*a]).total_cmp(&distance(mean, &plain.means[*b])))
            .unwrap();
        assert!(distance(mean, &plain.means[near]) < 6.1e-4, "Gaussian {i}");
        // Another Gaussian may be as near.
        let opacity = |g: &Gaussians, i: usize| 1.0 / (1.0 + (-g.opacity_logits[i]).exp());
        alike += usize::from(
            (opacity(&compressed, i) - opacity(&plain, near)).abs() < 0.51 / 255.0
                && distance(&compressed.log_scales[i], &plain.log_scales[near]) < 0.02,
        );
    }
    assert!(alike > 800, "{alike} of 841");
    let guitar = read_gaussians(folder.join("guitar.compressed.ply")).unwrap();
    assert_eq!((guitar.len(), guitar.degree), (90854, 0));
}

#[test]
fn splat_records() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.splat");
    let mut bytes = Vec::new();
    for x in [1.0f32, 2.0, 3.0, 1.0, 0.5, 0.0] {
        bytes.extend(x.to_le_bytes());
    }
    bytes.extend([255, 0, 0, 255, 255, 128, 128, 0]);
    std::fs::write(&path, &bytes).unwrap();
    let splats = read_gaussians(&path).unwrap();
    assert_eq!((splats.means[0], splats.opacity_logits[0]), ([1.0, 2.0, 3.0], f32::INFINITY));
    assert_eq!(splats.quats[0], [127.0 / 128.0, 0.0, 0.0, -1.0]);
    assert!((splats.sh[0] * 0.2820948 - 0.5).abs() < 1e-6 && splats.log_scales[0][0] == 0.0);
    bytes.pop();
    std::fs::write(&path, &bytes).unwrap();
    let message = read_gaussians(&path).unwrap_err().to_string();
    assert!(message.contains("length: expected a multiple of 32 bytes, found 31"), "{message}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 5))]

    #[test]
    fn hostile_files_never_panic(at in 0.0..1.0f64, byte in any::<u8>(), keep in 0.0..1.0f64) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        write_gaussians(&path, &sample(3, 1)).unwrap();
        for mut bytes in [std::fs::read(&path).unwrap(), ASCII.as_bytes().to_vec()] {
            let index = (at * bytes.len() as f64) as usize;
            bytes[index] = byte;
            bytes.truncate((keep * 2.0 * bytes.len() as f64) as usize);
            std::fs::write(&path, &bytes).unwrap();
            let _ = read_gaussians(&path);
            let _ = read_gaussians(&path);
        }
    }

    #[test]
    fn hostile_headers_never_panic(words in proptest::collection::vec("(ply|element|vertex|property|float|list|uchar|end_header|format|ascii|1.0|x|[0-9]{1,20}|\n| )", 0..40)) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let text = format!("ply\nformat ascii 1.0\n{}\nend_header\n", words.join(" "));
        std::fs::write(&path, text).unwrap();
        prop_assert!(read_gaussians(&path).is_err());
    }
}

/// The error of an empty file or a text named .ply differs from a damaged PLY's.
///
/// Promise (files): an empty file or text with the name of a PLY is called so.
#[test]
fn a_file_that_is_no_ply_is_called_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for (bytes, found) in [
        (&b""[..], "found an empty file"),
        (b"Dear diary, nothing happened", "found text that begins with \"Dear diary, nothing \""),
        (b"plyboard\n", "found text that begins with \"plyboard\""),
        (&[0x1f, 0x8b, 8, 0, 0, 0], "found other bytes"),
        (&[b'a'; 1 << 16], "found text that begins with \"aaaaaaaaaaaaaaaaaaaa\""),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let message = read_gaussians(&path).unwrap_err().to_string();
        let expected = "header line 1: expected a PLY file (\"ply\" in its first line), ";
        assert!(message.ends_with(&format!("{expected}{found}")), "{message}");
    }
}
