//! `.ksplat` files: a fixture of another tool, and files made by hand at every level.

use crate::fixtures;
use half::f16;
use weaver_io::{SceneFormat, read_gaussians, read_gaussians_from};
use weaver_scene::Gaussians;

/// Promise of `fixtures_of_splat_transform`.
#[test]
fn the_fixture_of_splat_transform() {
    let found = read_gaussians(fixtures::splats("minimal.ksplat")).unwrap();
    fixtures::assert_same("minimal.ksplat", &found, &fixtures::decoded("minimal.ksplat"), 1e-5);
}

/// A file of one section with room for three Gaussians; two are there: one in a full bucket around (10, 0, 0), one in a
/// bucket of one around (0, -10, 0). Harmonic i of both is i / 32.
pub fn file(level: u16, degree: u16) -> Vec<u8> {
    let mut data = vec![0, 1, 0, 0];
    let words = |data: &mut Vec<u8>, words: &[u32]| words.iter().for_each(|word| data.extend(word.to_le_bytes()));
    words(&mut data, &[1, 1, 2, 2, level.into()]);
    data.resize(36, 0);
    [-1.0_f32, 3.0].iter().for_each(|x| data.extend(x.to_le_bytes()));
    data.resize(4096, 0);
    words(&mut data, &[2, 3, 1, 2]);
    data.extend(4.0_f32.to_le_bytes());
    words(&mut data, &[12, 1000, 0, 1, 1, degree.into()]);
    data.resize(4096 + 1024, 0);
    words(&mut data, &[1]);
    [10.0_f32, 0.0, 0.0, 0.0, -10.0, 0.0].iter().for_each(|x| data.extend(x.to_le_bytes()));
    let rest = [0, 9, 24][usize::from(degree)];
    for i in 0..3_u16 {
        let float = |data: &mut Vec<u8>, x: f32| match level {
            0 => data.extend(x.to_le_bytes()),
            _ => data.extend(f16::from_f32(x).to_le_bytes()),
        };
        match level {
            0 => [1.0_f32, 2.0, f32::from(i)].iter().for_each(|x| data.extend(x.to_le_bytes())),
            // In steps of 4 / 2 / 1000: (1, 0, -1) from the center of the bucket.
            _ => [1500_u16, 1000, 500].iter().for_each(|x| data.extend(x.to_le_bytes())),
        }
        [1.0, 0.5, 2.0, 0.5, -0.5, 0.5, -0.5].iter().for_each(|x| float(&mut data, *x));
        data.extend([255, 0, 51, 204]);
        for k in 0..rest {
            match level {
                2 => data.push(k as u8),
                _ => float(&mut data, k as f32 / 32.0),
            }
        }
    }
    data
}

fn read(data: &[u8]) -> weaver_io::Result<Gaussians> {
    let format: SceneFormat = "ksplat".parse().unwrap();
    read_gaussians_from(data, format)
}

#[test]
fn every_level_and_degree_by_hand() {
    for (level, degree) in [(0, 0), (0, 1), (1, 1), (1, 2), (2, 0), (2, 2)] {
        let found = read(&file(level, degree)).unwrap();
        let means = match level {
            0 => [[1.0, 2.0, 0.0], [1.0, 2.0, 1.0]],
            _ => [[11.0, 0.0, -1.0], [1.0, -10.0, -1.0]],
        };
        assert_eq!((&found.means[..], found.degree), (&means[..], usize::from(degree)), "level {level}");
        assert_eq!(found.log_scales[1], [0.0, 0.5_f32.ln(), 2.0_f32.ln()]);
        assert_eq!(found.quats[1], [0.5, -0.5, 0.5, -0.5]);
        assert!((found.opacity_logits[0] - 4.0_f32.ln()).abs() < 1e-5);
        let of = |k: usize| if level == 2 { -1.0 + 4.0 * k as f32 / 255.0 } else { k as f32 / 32.0 };
        let width = 3 * (usize::from(degree) + 1).pow(2);
        if degree > 0 {
            // Of each degree, one color after the other.
            assert_eq!(found.sh[width + 3..width + 9], [0, 3, 6, 1, 4, 7].map(of));
        }
        if degree > 1 {
            assert_eq!(found.sh[width + 12..width + 15], [9, 14, 19].map(of));
        }
    }
}

#[test]
fn messages_say_what() {
    let change = |at: usize, bytes: &[u8]| {
        let mut data = file(1, 1);
        data[at..at + bytes.len()].copy_from_slice(bytes);
        read(&data).unwrap_err().to_string()
    };
    let whole = file(1, 1);
    let cases = [
        (change(0, &[1]), "byte 0: expected version 0.1 or later, found 1.1"),
        (change(4, &[0xff; 4]), "byte 4: expected at most 1 sections in a file of this length, found 4294967295"),
        (change(16, &[3]), "byte 16: expected 2 Gaussians, as sections have, found 3"),
        (change(20, &[3]), "byte 20: expected level 0, 1 or 2, found 3"),
        (change(4096, &[4]), "section 0: expected at most 3 Gaussians, found 4"),
        (change(4100, &[0xff; 4]), "section 0: expected a section within the"),
        (change(4108, &[0xff; 4]), "section 0: expected a section within the"),
        (change(4116, &[4]), "section 0: expected 12 bytes of a bucket's center, found 4"),
        (change(4128, &[0]), "section 0: expected buckets for 2 Gaussians, found 1"),
        (change(4136, &[3]), "section 0: expected harmonics of degree 0 to 2, found 3"),
        (read(&whole[..whole.len() - 1]).unwrap_err().to_string(), "section 0: expected a section within"),
        (read(&whole[..100]).unwrap_err().to_string(), "bytes of a header"),
    ];
    for (message, expected) in cases {
        assert!(message.contains("ksplat: ") && message.contains(expected), "{message} for {expected}");
    }
}
