//! Range coder and adaptive models: identity, length in bytes, length by closed form.

use proptest::prelude::*;
use weaver_codec::{
    AdaptiveModel, CodeLength, Coder, GaussianModel, MixedModel, RangeDecoder, RangeEncoder, Slices, WHOLE,
    gaussian_rate,
};
use weaver_kernels::random::Stream;

/// ln Γ by Stirling's series, after the argument was made large.
fn ln_gamma(mut x: f64) -> f64 {
    let mut shift = 0.0;
    while x < 20.0 {
        shift -= x.ln();
        x += 1.0;
    }
    let series = 1.0 / (12.0 * x) - 1.0 / (360.0 * x.powi(3)) + 1.0 / (1260.0 * x.powi(5));
    shift + (x - 0.5) * x.ln() - x + 0.5 * (2.0 * std::f64::consts::PI).ln() + series
}

/// Symbols that thin out geometrically.
fn skewed(count: usize, alphabet: usize, share: f64) -> Vec<usize> {
    let random = Stream::new(1, 0, "codec.skewed");
    let draw = |i| (random.uniform::<f64>(i as u64).ln() / (1.0 - share).ln()) as usize;
    (0..count).map(|i| draw(i).min(alphabet - 1)).collect()
}

fn assert_short(bytes: usize, bits: f64) {
    assert!(bytes as f64 <= bits / 8.0 * 1.001 + 64.0, "{bytes} bytes for {} of the model", bits / 8.0);
}

#[test]
fn coded_bytes_are_the_models_bits() {
    for (alphabet, share) in [(2, 0.5), (2, 0.999), (40, 0.2), (256, 0.02), (300, 0.9), (1, 0.5), (1 << 15, 0.001)] {
        let symbols = skewed(60_000, alphabet, share);
        let (mut encoder, mut model) = (RangeEncoder::default(), AdaptiveModel::new(alphabet));
        let (mut length, mut twin) = (CodeLength::default(), AdaptiveModel::new(alphabet));
        for &symbol in &symbols {
            model.code(&mut encoder, symbol);
            twin.code(&mut length, symbol);
        }
        let bytes = encoder.finish();
        assert_short(bytes.len(), length.bits);
        let (mut decoder, mut model) = (RangeDecoder::new(&bytes), AdaptiveModel::new(alphabet));
        assert!(symbols.iter().all(|&symbol| model.code(&mut decoder, 0) == symbol));
        assert!(decoder.is_whole());
    }
}

#[test]
fn adaptive_length_is_that_of_the_gamma_functions() {
    for (alphabet, share) in [(2, 0.3), (2, 0.9), (16, 0.4), (64, 0.1)] {
        let symbols = skewed(20_000, alphabet, share);
        let (mut length, mut model) = (CodeLength::default(), AdaptiveModel::new(alphabet));
        let mut counts = vec![0.0; alphabet];
        for &symbol in &symbols {
            model.code(&mut length, symbol);
            counts[symbol] += 1.0;
        }
        let (n, half) = (symbols.len() as f64, alphabet as f64 / 2.0);
        let product: f64 = counts.iter().map(|c| ln_gamma(c + 0.5) - ln_gamma(0.5)).sum();
        let exact = -(ln_gamma(half) - ln_gamma(n + half) + product) / std::f64::consts::LN_2;
        // Each symbol keeps a part of 2^16, which the others miss.
        let rounding = n * alphabet as f64 / f64::from(WHOLE) / std::f64::consts::LN_2;
        assert!((length.bits - exact).abs() < rounding + 1e-3 * exact, "{} against {exact}", length.bits);
    }
}

#[test]
fn mixed_length_comes_near_the_better_context() {
    // Numbers that one context predicts, and another one does not.
    let random = Stream::new(2, 0, "codec.mixed");
    let numbers: Vec<(usize, i32)> = (0..30_000)
        .map(|i| {
            let context = random.below(2 * i, 8);
            let noise = random.normal::<f64>(2 * i + 1);
            (context, (noise + 2.0 * context as f64 - 7.0).round() as i32)
        })
        .collect();
    let length = |contexts: [usize; 2], pick: fn(usize) -> [usize; 2]| {
        let (mut length, mut model) = (CodeLength::default(), MixedModel::new(contexts));
        numbers.iter().for_each(|&(context, number)| _ = model.code(&mut length, pick(context), number));
        length.bits / numbers.len() as f64
    };
    let [told, mixed, untold] =
        [length([8, 1], |c| [c, 0]), length([8, 8], |c| [c, 7 - c]), length([1, 1], |_| [0, 0])];
    // The entropy of a rounded normal number is 2.05 bits.
    assert!(told < 2.25 && mixed < 2.25 && untold > 4.0, "{told} {mixed} {untold}");
}

#[test]
fn bytes_of_mixed_models_are_their_bits() {
    let random = Stream::new(7, 0, "codec.length");
    for deviation in [0.05, 1.0, 400.0] {
        let numbers: Vec<i32> = (0..40_000).map(|i| (deviation * random.normal::<f64>(i)).round() as i32).collect();
        let (mut encoder, mut model) = (RangeEncoder::default(), MixedModel::new([1, 3]));
        let (mut length, mut twin) = (CodeLength::default(), MixedModel::new([1, 3]));
        for (i, &number) in numbers.iter().enumerate() {
            model.code(&mut encoder, [0, i % 3], number);
            twin.code(&mut length, [0, i % 3], number);
        }
        assert_short(encoder.finish().len(), length.bits);
    }
}

#[test]
fn streams_that_end_early_or_late_are_noticed() {
    let mut encoder = RangeEncoder::default();
    let values: Vec<u32> = (0..100).map(|i: u32| i.wrapping_mul(0x9e37_79b9) >> 7 | 1).collect();
    for &value in &values {
        encoder.raw(25, value & 0x01ff_ffff);
    }
    let bytes = encoder.finish();
    let read = |bytes: &[u8]| {
        let mut decoder = RangeDecoder::new(bytes);
        let same = values.iter().all(|&value| decoder.raw(25, 0) == value & 0x01ff_ffff);
        (same, decoder.is_whole())
    };
    assert_eq!(read(&bytes), (true, true));
    assert!(!read(&bytes[..bytes.len() - 8]).1);
    assert!(!read(&[&bytes[..], &[1; 8]].concat()).1);
    assert!(!read(&[]).1);
}

proptest! {
    #[test]
    fn numbers_come_back(numbers in prop::collection::vec((-(1 << 24) + 1..1 << 24, 0..6_usize), 0..200), shift in 0..24) {
        let mut encoder = RangeEncoder::default();
        let mut model = MixedModel::new([5, 1, 3]);
        for &(number, context) in &numbers {
            model.code(&mut encoder, [context, 0, context / 2], number >> shift);
        }
        let bytes = encoder.finish();
        let mut decoder = RangeDecoder::new(&bytes);
        let mut model = MixedModel::new([5, 1, 3]);
        for &(number, context) in &numbers {
            prop_assert_eq!(model.code(&mut decoder, [context, 0, context / 2], 0), number >> shift);
        }
        prop_assert!(decoder.is_whole());
    }

    #[test]
    fn raw_bits_and_bits_come_back(values in prop::collection::vec((any::<u32>(), 0..33_u32, 1..WHOLE), 0..200)) {
        let mut encoder = RangeEncoder::default();
        let low = |value: u32, bits: u32| value & (u64::from(u32::MAX) >> (32 - bits)) as u32;
        for &(value, bits, p) in &values {
            encoder.raw(bits, low(value, bits));
            encoder.bit(p, value % 2 == 0);
        }
        let bytes = encoder.finish();
        let mut decoder = RangeDecoder::new(&bytes);
        for &(value, bits, p) in &values {
            prop_assert_eq!(decoder.raw(bits, 0), low(value, bits));
            prop_assert_eq!(decoder.bit(p, false), value % 2 == 0);
        }
        prop_assert!(decoder.is_whole());
    }

    #[test]
    fn any_bytes_decode_to_something(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
        let mut decoder = RangeDecoder::new(&bytes);
        let (mut adaptive, mut mixed) = (AdaptiveModel::new(77), MixedModel::new([2]));
        for i in 0..500 {
            prop_assert!(adaptive.code(&mut decoder, 0) < 77);
            mixed.code(&mut decoder, [i % 2], 0);
        }
    }

    #[test]
    fn slices_tile_the_whole(symbols in prop::collection::vec(0..9_usize, 0..50)) {
        let (mut model, mut length) = (AdaptiveModel::new(9), CodeLength::default());
        for symbol in symbols {
            model.code(&mut length, symbol);
            let mut next = 0;
            for symbol in 0..9 {
                let (first, size) = model.slice(symbol);
                prop_assert!(first == next && size > 0);
                prop_assert_eq!([model.at(first), model.at(first + size - 1)], [symbol; 2]);
                next = first + size;
            }
            prop_assert_eq!(next, WHOLE);
        }
    }
}

/// Promise (scenes): numbers coded by a predicted normal distribution come back, at the bits of their rate.
#[test]
fn numbers_come_back_at_their_gaussian_rate() {
    let random = Stream::new(3, 0, "codec.gaussian");
    let draw = |i: u64| {
        let (mean, log) = (20.0 * random.normal::<f64>(3 * i), 6.0 * random.uniform::<f64>(3 * i + 1) - 2.0);
        ((mean + log.exp() * random.normal::<f64>(3 * i + 2)).round() as i32, mean, log)
    };
    let numbers: Vec<(i32, f64, f64)> = (0..20_000).map(draw).collect();
    // Near the mean, where each number has a slice of its own.
    let (near, expected) = numbers.iter().filter(|(x, m, log)| (f64::from(*x) - m).abs() < 30.0 && *log < 2.0).fold(
        (CodeLength::default(), 0.0),
        |(mut length, bits), (x, mean, log)| {
            GaussianModel::new(*mean, *log).code(&mut length, *x);
            (length, bits + gaussian_rate(f64::from(*x), *mean, log.exp(), 1.0).bits)
        },
    );
    assert!((near.bits / expected - 1.0).abs() < 0.01, "{} of {expected} bits", near.bits);
    let mut encoder = RangeEncoder::default();
    let extreme = [
        (i32::MAX, 0.0, 0.0),
        (i32::MIN, 1e30, f64::NAN),
        (5, f64::NAN, f64::INFINITY),
        (7, 0.0, -1e9),
        (1 << 24, -3.5, 1.0),
    ];
    let all: Vec<_> = numbers.iter().chain(&extreme).collect();
    all.iter().for_each(|(x, mean, log)| _ = GaussianModel::new(*mean, *log).code(&mut encoder, *x));
    let bytes = encoder.finish();
    let mut decoder = RangeDecoder::new(&bytes);
    for (x, mean, log) in all {
        let found = GaussianModel::new(*mean, *log).code(&mut decoder, 0);
        assert_eq!(found, (*x).clamp(-(1 << 24), 1 << 24));
    }
    assert!(decoder.is_whole());
}

proptest! {
    #[test]
    fn slices_of_a_gaussian_share_all_parts(mean in -3.0..3.0_f64, log in -20.0..20.0_f64, part in 0..WHOLE) {
        let model = GaussianModel::new(mean, log);
        let mut next = 0;
        for symbol in 0..83 {
            let (first, size) = model.slice(symbol);
            prop_assert!(first == next && size > 0, "{} of {} and {}", symbol, first, size);
            next = first + size;
        }
        prop_assert_eq!(next, WHOLE);
        let (first, size) = model.slice(model.at(part));
        prop_assert!((first..first + size).contains(&part));
    }
}
