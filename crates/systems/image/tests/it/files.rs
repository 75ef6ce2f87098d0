//! Files: what is written is read, and what is not a file is refused.

use crate::random::{error, gaussians, picture};
use proptest::prelude::*;
use std::ops::ControlFlow;
use weaver_codec::{Container, Stream};
use weaver_image::{CUT, FitSettings, Fitted, decode, encode, fit};

fn random(seed: u64, count: usize, size: [usize; 2]) -> Fitted {
    Fitted { gaussians: gaussians(seed, count, size, [0.3, 20.0]), cut: CUT, reset: 0 }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 8))]

    #[test]
    fn what_was_read_is_written_to_the_same_bytes(seed: u64, count in 0_usize..60, width in 8_usize..6000) {
        let bytes = encode(&random(seed, count, [width, 90]), width, 90).unwrap();
        let back = decode(&bytes).unwrap();
        prop_assert_eq!((back.width, back.height, back.fitted.gaussians.len()), (width, 90, count));
        prop_assert_eq!(encode(&back.fitted, width, 90).unwrap(), bytes);
    }

    #[test]
    fn changed_bytes_are_refused_or_a_picture(seed: u64, at: proptest::sample::Index, to: u8) {
        let mut bytes = encode(&random(seed, 20, [64, 64]), 64, 64).unwrap();
        let at = at.index(bytes.len());
        let same = bytes[at] == to;
        bytes[at] = to;
        prop_assert_eq!(decode(&bytes).is_ok(), same);
    }
}

#[test]
fn shortened_files_are_refused() {
    let bytes = encode(&random(1, 20, [64, 64]), 64, 64).unwrap();
    for end in 0..bytes.len() {
        assert!(decode(&bytes[..end]).is_err());
    }
    let message = decode(b"PNG..").unwrap_err().to_string();
    assert!(message.starts_with("byte 0: expected"), "{message}");
}

#[test]
fn symbols_are_near_the_numbers() {
    let before = random(2, 1, [100, 100]);
    let back = decode(&encode(&before, 100, 100).unwrap()).unwrap().fitted.gaussians;
    for axis in 0..2 {
        assert!((back.centers[axis] - before.gaussians.centers[axis]).abs() < 1.5);
    }
    let sorted = |s: &[f32]| [s[0].max(s[1]), s[0].min(s[1])];
    for (a, b) in sorted(&back.scales).into_iter().zip(sorted(&before.gaussians.scales)) {
        assert!((a / b).log2().abs() < 0.36, "{a} {b}");
    }
}

#[test]
fn a_coded_fit_is_what_its_file_holds() {
    let picture = picture(3, 64, 64);
    let mut settings = FitSettings::new(60, 120);
    let free = fit(&picture, &settings, &mut |_| ControlFlow::Continue(())).unwrap();
    settings.coded = true;
    let coded = fit(&picture, &settings, &mut |_| ControlFlow::Continue(())).unwrap();
    let back = |fitted: &Fitted| decode(&encode(fitted, 64, 64).unwrap()).unwrap().fitted.gaussians;
    let (rounded, staged) = (error(&picture, &back(&free)), error(&picture, &back(&coded)));
    let told = error(&picture, &coded.gaussians);
    assert!((staged - told).abs() < 0.02 * told, "{staged} {told}");
    assert!(staged < rounded, "{staged} {rounded}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 4))]

    #[test]
    fn any_symbols_behind_right_checksums_are_a_picture_or_refused(
        symbols in proptest::collection::vec(any::<u8>(), 0..400),
        gaussians in 0_u64..3000,
        [width, height] in proptest::array::uniform2(0_u32..5000),
        end in any::<[u8; 2]>(),
    ) {
        let head: Vec<u8> = [&width.to_le_bytes()[..], &height.to_le_bytes(), &end].concat();
        let stream = |name, symbols, bytes: Vec<u8>| Stream { name, symbols, bytes: bytes.into() };
        let streams = vec![stream(*b"pict", 1, head), stream(*b"gaus", gaussians, symbols)];
        if let Ok(coded) = decode(&Container { gaussians, coefficients: 0, streams }.write()) {
            coded.fitted.gaussians.check().unwrap();
        }
    }
}
