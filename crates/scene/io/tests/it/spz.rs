use crate::shared;
use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;
use std::io::Write;
use weaver_io::read_gaussians;
use weaver_kernels::order::median_high;
use weaver_scene::Gaussians;

/// One Gaussian of version 3, degree 1, before compression.
fn unpacked() -> Vec<u8> {
    let mut data = b"NGSP".to_vec();
    data.extend(3u32.to_le_bytes());
    data.extend(1u32.to_le_bytes());
    data.extend([1, 8, 0, 0]);
    data.extend([0, 1, 0, 0x80, 0xff, 0xff, 0, 2, 0]); // 1, -0.5, 2
    data.push(51); // opacity 0.2
    data.extend([255, 0, 51]); // color
    data.extend([160, 144, 0]); // log scales 0, -1, -10
    data.extend((3 << 30 | 511u32 << 20 | 512 << 10).to_le_bytes()); // x = sqrt(1/2), y = z = 0, w left out
    data.extend([192, 128, 64, 160, 128, 128, 0, 128, 128]); // (0.5 0 -0.5) (0.25 0 0) (-1 0 0)
    data
}

fn read(data: &[u8]) -> weaver_io::Result<Gaussians> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.spz");
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(data).unwrap();
    std::fs::write(&path, gzip.finish().unwrap()).unwrap();
    read_gaussians(&path)
}

#[test]
fn by_hand() {
    let splats = read(&unpacked()).unwrap();
    assert_eq!((splats.means[0], splats.log_scales[0]), ([1.0, 0.5, -2.0], [0.0, -1.0, -10.0]));
    assert!((splats.opacity_logits[0] - (0.2f32 / 0.8).ln()).abs() < 1e-6);
    for (a, b) in splats.quats[0].iter().zip([0.5f32.sqrt(), 0.5f32.sqrt(), 0.0, 0.0]) {
        assert!((a - b).abs() < 1e-6, "{:?}", splats.quats[0]);
    }
    // y and z turn around, and with them the harmonics that are odd in them: -y and z, not -x.
    let expected = [0.5 / 0.15, -0.5 / 0.15, -0.3 / 0.15, -0.5, 0.0, 0.5, -0.25, 0.0, 0.0, -1.0, 0.0, 0.0];
    assert_eq!(splats.sh.len(), expected.len());
    for (a, b) in splats.sh.iter().zip(expected) {
        assert!((a - b).abs() < 1e-5, "{:?}", splats.sh);
    }
}

#[test]
fn messages_say_what() {
    let change = |at: usize, byte: u8| {
        let mut data = unpacked();
        data[at] = byte;
        read(&data).unwrap_err().to_string()
    };
    let cases = [
        (change(0, b'X'), "expected NGSP"),
        (change(4, 9), "expected version 1 to 3, found 9"),
        (change(11, 255), "bytes for 4278190081 Gaussians"),
        (change(12, 5), "expected an SH degree up to 4"),
    ];
    for (message, expected) in cases {
        assert!(message.contains("a.spz: byte ") && message.contains(expected), "{message}");
    }
}

/// A small file that would unpack to much more than it speaks of is refused before it does.
#[test]
fn no_more_is_unpacked_than_the_header_speaks_of() {
    let mut data = unpacked();
    data.resize(32 << 20, 0);
    let message = read(&data).unwrap_err().to_string();
    assert!(message.contains("expected 29 bytes for 1 Gaussians, found more"), "{message}");
}

fn median(mut values: Vec<f32>) -> f32 {
    median_high(&mut values).unwrap()
}

#[test]
fn agrees_with_the_ply_it_was_made_from() {
    let Some(folder) = shared::data("splat-files") else { return };
    let ply = read_gaussians(folder.join("playbot-sh2.ply")).unwrap();
    let spz = read_gaussians(folder.join("playbot-sh2.v3.spz")).unwrap();
    assert_eq!((spz.len(), spz.degree), (ply.len(), ply.degree));
    for i in 0..ply.len() {
        for (a, b) in ply.means[i].iter().zip(spz.means[i]) {
            assert!((a - b).abs() < 1.3e-4, "position {i}: {a} {b}");
        }
        let norm = ply.quats[i].iter().map(|x| x * x).sum::<f32>().sqrt();
        let cos: f32 = ply.quats[i].iter().zip(spz.quats[i]).map(|(a, b)| a / norm * b).sum();
        let angle = 2.0 * cos.abs().min(1.0).acos().to_degrees();
        assert!(angle < 0.21, "rotation {i}: {angle} degrees");
        let opacity = |logit: f32| 1.0 / (1.0 + (-logit).exp());
        assert!((opacity(ply.opacity_logits[i]) - opacity(spz.opacity_logits[i])).abs() < 0.51 / 255.0);
    }
    // The format clamps colors and scales; hence medians.
    let differences = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).collect();
    let scales = differences(ply.log_scales.as_flattened(), spz.log_scales.as_flattened());
    assert!(median(scales) < 1.0 / 32.0);
    // Steps of 1/8 for degree 1 and 1/16 beyond, hence errors below 1/16; without the half turn it would be more.
    let k = ply.coefficients();
    for c in 1..k {
        let column = |s: &Gaussians| s.sh.chunks_exact(k * 3).map(|g| g[c * 3]).collect::<Vec<_>>();
        let (a, b) = (column(&ply), column(&spz));
        let turned: Vec<f32> = b.iter().map(|x| -x).collect();
        let (same, opposite) = (median(differences(&a, &b)), median(differences(&a, &turned)));
        assert!(same < 1.0 / 16.0 && same < opposite, "coefficient {c}: {same} {opposite}");
    }
}

#[test]
fn version_two() {
    let Some(folder) = shared::data("splat-files") else { return };
    let splats = read_gaussians(folder.join("minimal-v2.spz")).unwrap();
    assert_eq!(splats.means, [[-1.0, 0.0, 1.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]);
    assert!((splats.sh[0] + 1.111_111).abs() < 1e-5 && splats.log_scales[0][0] == -2.3125);
    let expected = [0.999_976_93, 0.003_921_628, -0.003_921_628, -0.003_921_628];
    for (a, b) in splats.quats[0].iter().zip(expected) {
        assert!((a - b).abs() < 1e-5, "{:?}", splats.quats[0]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 5))]

    #[test]
    fn hostile_files_never_panic(at in 0.0..1.0f64, byte in any::<u8>(), keep in 0.0..1.0f64) {
        let mut data = unpacked();
        let index = (at * data.len() as f64) as usize;
        data[index] = byte;
        data.truncate((keep * 2.0 * data.len() as f64) as usize);
        let _ = read(&data);
        // The same damage to the compressed bytes.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.spz");
        let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
        gzip.write_all(&unpacked()).unwrap();
        let mut packed = gzip.finish().unwrap();
        let index = (at * packed.len() as f64) as usize;
        packed[index] = byte;
        packed.truncate((keep * 2.0 * packed.len() as f64) as usize);
        std::fs::write(&path, &packed).unwrap();
        let _ = read_gaussians(&path);
    }
}
