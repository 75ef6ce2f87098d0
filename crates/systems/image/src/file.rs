//! Files of pictures: symbols in classes and Morton order, by adaptive models of order 0.

use crate::error::ImageError;
use crate::fit::Fitted;
use crate::gaussians::Gaussians;
use crate::rounding::{CLASSES, Grid, LARGEST_RATIO, Parts, Symbols, angle_bits, class};
use crate::settings::Descent;
use crate::window::Window;
use weaver_codec::{
    AdaptiveModel, CodeLength, CodecError, Coder, Container, RangeDecoder, RangeEncoder, Stream, from_morton2, morton2,
};

/// Names of the streams.
const HEAD: [u8; 4] = *b"pict";
const SYMBOLS: [u8; 4] = *b"gaus";
/// Bytes of the head: width, height, which cut, weights of the colors' predictions.
const HEAD_BYTES: usize = 10;
/// Weights of the mean of the last three colors in the prediction of the next, in twentieths.
const WEIGHTS: [i64; 4] = [0, 7, 14, 20];
/// Bits of the longest numbers: of counts and colors, and of scales.
const LONG: usize = 32;
const SHORT: usize = 8;

/// A picture as it is in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Coded {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The Gaussians, and where they end.
    pub fitted: Fitted,
}

/// The bytes of a file of a picture, its numbers rounded to symbols. A fit that is
/// [`coded`](crate::FitSettings::coded) has them rounded already, all but exactly.
///
/// The layout is in docs/pictures.md of the repository.
///
/// # Errors
/// Gaussians that [`Gaussians::check`] refuses, a picture without pixels or with more than 2^28.
///
/// ```
/// use std::ops::ControlFlow;
/// use weaver_image::{FitSettings, Picture, decode, encode, fit};
/// let picture = Picture::new(32, 24, (0..32 * 24 * 3).map(|i| (i % 96) as f32 / 96.0).collect())?;
/// let mut settings = FitSettings::new(12, 50);
/// settings.coded = true;
/// let fitted = fit(&picture, &settings, &mut |_| ControlFlow::Continue(()))?;
/// let bytes = encode(&fitted, 32, 24)?;
/// let back = decode(&bytes)?;
/// assert!(bytes.len() < 200 && back.fitted.gaussians.len() == 12);
/// # Ok::<(), weaver_image::ImageError>(())
/// ```
pub fn encode(fitted: &Fitted, width: usize, height: usize) -> Result<Vec<u8>, ImageError> {
    fitted.gaussians.check()?;
    Window::whole(width, height).check()?;
    let grid = Grid { size: [width, height] };
    let mut symbols: Vec<Symbols> = (0..fitted.gaussians.len()).map(|i| grid.symbols(&fitted.gaussians, i)).collect();
    symbols.sort_by_key(|s| (class(s.scale), morton2(s.position), s.scale, s.ratio, s.angle, s.color));
    let length = |weights: [usize; 3]| {
        let mut length = CodeLength::default();
        Models::new(grid, weights).code(&mut length, &symbols, symbols.len()).map(|_| length.bits)
    };
    let mut weights = [0; 3];
    for channel in 0..3 {
        let mut least = f64::INFINITY;
        for weight in 0..WEIGHTS.len() {
            let mut with = weights;
            with[channel] = weight;
            let bits = length(with)?;
            if bits < least {
                (least, weights) = (bits, with);
            }
        }
    }
    let mut encoder = RangeEncoder::default();
    Models::new(grid, weights).code(&mut encoder, &symbols, symbols.len())?;
    let published = fitted.cut != Descent::Squared.cut();
    let mut head = Vec::with_capacity(HEAD_BYTES);
    head.extend((width as u32).to_le_bytes());
    head.extend((height as u32).to_le_bytes());
    head.push(u8::from(published));
    head.push((weights[0] | weights[1] << 2 | weights[2] << 4) as u8);
    let streams = [(HEAD, 1, head), (SYMBOLS, symbols.len() as u64, encoder.finish())];
    let streams = streams.map(|(name, symbols, bytes)| Stream { name, symbols, bytes: bytes.into() });
    Ok(Container { gaussians: symbols.len() as u64, coefficients: 0, streams: streams.into() }.write())
}

/// Reads what [`encode`] wrote.
///
/// # Errors
/// Bytes that are no picture, of a later version, missing, left over or changed; symbols out of range.
pub fn decode(bytes: &[u8]) -> Result<Coded, ImageError> {
    let container = Container::read(bytes)?;
    let names: Vec<[u8; 4]> = container.streams.iter().map(|stream| stream.name).collect();
    if names != [HEAD, SYMBOLS] {
        let found: Vec<String> = names.iter().map(|name| name.escape_ascii().to_string()).collect();
        return Err(invalid("streams", "those of a picture, pict and gaus", found.join(" ")));
    }
    let [head, symbols] = [&container.streams[0].bytes, &container.streams[1].bytes];
    if head.len() != HEAD_BYTES {
        return Err(invalid("head of a picture", HEAD_BYTES, head.len()));
    }
    let number = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]) as usize;
    let (width, height) = (number(0), number(4));
    let window = Window::whole(width, height);
    window.check()?;
    // The container has at least a byte for eight of them, so that this fits into memory.
    let count = container.gaussians as usize;
    if count > window.pixels() {
        return Err(invalid("Gaussians of a picture", format!("at most {}, its pixels", window.pixels()), count));
    }
    let descent = match head[8] {
        0 => Descent::Squared,
        1 => Descent::Published,
        other => return Err(invalid("cut of a picture", "0 or 1", other)),
    };
    let weights = [0, 2, 4].map(|shift| usize::from(head[9] >> shift & 3));
    let grid = Grid { size: [width, height] };
    let mut decoder = RangeDecoder::new(symbols);
    let found = Models::new(grid, weights).code(&mut decoder, &[], count)?;
    if !decoder.is_whole() {
        return Err(invalid("stream gaus", "symbols that fill it", format!("others in {} bytes", symbols.len())));
    }
    let mut gaussians = Gaussians::zeros(found.len());
    for (i, symbols) in found.iter().enumerate() {
        let last = [0, 1].map(|axis| grid.last(class(symbols.scale), axis));
        if (0..2).any(|axis| symbols.position[axis] > last[axis]) {
            return Err(invalid(
                "position of a Gaussian",
                format!("up to {last:?}"),
                format!("{:?}", symbols.position),
            ));
        }
        grid.write(symbols, &mut gaussians, i, Parts { shape: true, position: true, color: true });
    }
    Ok(Coded { width, height, fitted: Fitted { gaussians, cut: descent.cut(), reset: 0 } })
}

fn invalid(place: &str, expected: impl ToString, found: impl ToString) -> ImageError {
    CodecError::Invalid { place: place.to_string(), expected: expected.to_string(), found: found.to_string() }.into()
}

/// A model of whole numbers: length in bits, the two bits behind the highest one, raw bits, sign.
struct Number {
    length: AdaptiveModel,
    top: Vec<AdaptiveModel>,
    sign: AdaptiveModel,
}

impl Number {
    fn new(longest: usize) -> Self {
        let top = (0..=longest).map(|_| AdaptiveModel::new(4)).collect();
        Self { length: AdaptiveModel::new(longest + 1), top, sign: AdaptiveModel::new(2) }
    }

    fn code(&mut self, coder: &mut impl Coder, value: u64) -> u64 {
        let length = self.length.code(coder, (u64::BITS - value.leading_zeros()) as usize) as u32;
        if length < 2 {
            return u64::from(length);
        }
        let below = length - 1;
        let modeled = below.min(2);
        let rest = below - modeled;
        let top = self.top[length as usize].code(coder, (value >> rest & ((1 << modeled) - 1)) as usize);
        let mut found = 1 << modeled | (top as u64 & ((1 << modeled) - 1));
        let mut left = rest;
        while left > 0 {
            let bits = left.min(32);
            left -= bits;
            let part = value >> left & ((1 << bits) - 1);
            found = found << bits | u64::from(coder.raw(bits, part as u32));
        }
        found
    }

    fn signed(&mut self, coder: &mut impl Coder, value: i64) -> i64 {
        let magnitude = self.code(coder, value.unsigned_abs()) as i64;
        match magnitude {
            0 => 0,
            _ if self.sign.code(coder, usize::from(value < 0)) == 1 => -magnitude,
            _ => magnitude,
        }
    }
}

/// Models of all symbols.
struct Models {
    grid: Grid,
    counts: Number,
    positions: Number,
    scales: Number,
    ratios: Number,
    colors: [Number; 3],
    /// Of predictions of colors, by their numbers in [`WEIGHTS`].
    weights: [usize; 3],
}

impl Models {
    fn new(grid: Grid, weights: [usize; 3]) -> Self {
        Self {
            grid,
            counts: Number::new(LONG),
            positions: Number::new(SHORT),
            scales: Number::new(SHORT),
            ratios: Number::new(SHORT),
            colors: [(); 3].map(|()| Number::new(LONG)),
            weights,
        }
    }

    /// Codes all symbols, in order of classes and Morton codes; those of a decoder are taken from its stream.
    fn code(&mut self, coder: &mut impl Coder, given: &[Symbols], count: usize) -> Result<Vec<Symbols>, ImageError> {
        let mut out: Vec<Symbols> = Vec::with_capacity(count);
        for class_now in 0..CLASSES {
            let own = given.iter().filter(|s| class(s.scale) == class_now).count();
            let own = self.counts.code(coder, own as u64);
            if own > (count - out.len()) as u64 {
                return Err(invalid("Gaussians of a class", format!("at most {}", count - out.len()), own));
            }
            self.positions = Number::new(self.grid.morton_bits(class_now));
            self.scales = Number::new(SHORT);
            self.ratios = Number::new(SHORT);
            let first = out.len();
            let mut morton = 0_u64;
            for _ in 0..own {
                let symbols = given.get(out.len()).copied().unwrap_or_default();
                let step = self.positions.code(coder, morton2(symbols.position).wrapping_sub(morton));
                morton = morton.wrapping_add(step);
                let next = self.gaussian(coder, &symbols, &out[first..])?;
                out.push(Symbols { position: from_morton2(morton), ..next });
                if class(next.scale) != class_now || coder.exhausted() {
                    return Err(invalid("scale of a Gaussian", format!("one of class {class_now}"), next.scale));
                }
            }
        }
        if out.len() < count {
            return Err(invalid("Gaussians of all classes", count, out.len()));
        }
        Ok(out)
    }

    /// Codes all but the position of a Gaussian, after the others of its class.
    fn gaussian(&mut self, coder: &mut impl Coder, given: &Symbols, before: &[Symbols]) -> Result<Symbols, ImageError> {
        let scale = self.scales.signed(coder, given.scale);
        let ratio = self.ratios.code(coder, given.ratio as u64) as i64;
        if ratio > LARGEST_RATIO {
            return Err(invalid("ratio of scales", format!("at most {LARGEST_RATIO}"), ratio));
        }
        let angle = match angle_bits(ratio) {
            0 => 0,
            bits => coder.raw(bits, given.angle),
        };
        let last = &before[before.len().saturating_sub(3)..];
        let mut color = [0; 3];
        for (c, to) in color.iter_mut().enumerate() {
            let sum: i64 = last.iter().map(|s| s.color[c]).sum();
            let parts = 20 * last.len().max(1) as i64;
            // Rounded to the nearest, in whole numbers.
            let expected = (2 * WEIGHTS[self.weights[c]] * sum + parts).div_euclid(2 * parts);
            *to = expected + self.colors[c].signed(coder, given.color[c] - expected);
        }
        Ok(Symbols { scale, ratio, angle, position: given.position, color })
    }
}
