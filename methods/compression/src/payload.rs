//! Streams of the methods without a codec of their own: numbers, symbols and positions, coded by order-0 models.

use crate::CompressionError;
use half::f16;
use std::borrow::Cow;
use weaver_codec::{
    AdaptiveModel, CodecError, Coder, Container, RangeDecoder, RangeEncoder, Stream, code_octree, from_morton3, morton3,
};
use weaver_geometry::sh;
use weaver_scene::Gaussians;

/// A grid around all positions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grid {
    origin: [f32; 3],
    cell: f32,
    depth: u32,
}

impl Grid {
    /// The grid of 2^depth voxels a side, and the Gaussians in Morton order: code and number.
    pub(crate) fn new(gaussians: &Gaussians, depth: u32) -> Result<(Self, Vec<(u64, usize)>), CompressionError> {
        check(gaussians)?;
        Ok(Self::about(&gaussians.means, depth))
    }

    /// The grid around finite positions, and these in Morton order.
    pub(crate) fn about(means: &[[f32; 3]], depth: u32) -> (Self, Vec<(u64, usize)>) {
        let bound = |axis: usize, start: f32, of: fn(f32, f32) -> f32| means.iter().map(|m| m[axis]).fold(start, of);
        let low = [0, 1, 2].map(|axis| bound(axis, f32::INFINITY, f32::min));
        let high = [0, 1, 2].map(|axis| bound(axis, f32::NEG_INFINITY, f32::max));
        let extent = (0..3).map(|axis| f64::from(high[axis]) - f64::from(low[axis])).fold(0.0, f64::max);
        let last = f64::from((1_u32 << depth) - 1);
        let cell = ((extent / last).min(f64::from(f32::MAX)) as f32).max(f32::MIN_POSITIVE);
        let grid = Self { origin: low, cell, depth };
        let voxel = |mean: &[f32; 3]| {
            let place = |axis: usize| (f64::from(mean[axis]) - f64::from(low[axis])) / f64::from(cell);
            morton3([0, 1, 2].map(|axis| place(axis).round().min(last) as u32))
        };
        let mut order: Vec<(u64, usize)> = means.iter().map(voxel).zip(0..).collect();
        order.sort_unstable();
        (grid, order)
    }

    /// The position of a voxel.
    pub(crate) fn mean(&self, code: u64) -> [f32; 3] {
        let place = from_morton3(code);
        let at = |axis: usize| f64::from(self.origin[axis]) + f64::from(self.cell) * f64::from(place[axis]);
        [0, 1, 2].map(|axis| at(axis).clamp(-f64::from(f32::MAX), f64::from(f32::MAX)) as f32)
    }
}

/// Checks that there are Gaussians, and that all their numbers but logits are finite.
pub(crate) fn check(gaussians: &Gaussians) -> Result<(), CompressionError> {
    if gaussians.is_empty() || !gaussians.lengths_agree() {
        return Err(broken("scene", "Gaussians with fields of one length", gaussians.len()));
    }
    let width = 3 * gaussians.coefficients();
    let finite = |i: usize| {
        let small = gaussians.means[i].iter().chain(&gaussians.log_scales[i]).chain(&gaussians.quats[i]);
        small.chain(&gaussians.sh[width * i..][..width]).all(|x| x.is_finite()) && !gaussians.opacity_logits[i].is_nan()
    };
    match (0..gaussians.len()).find(|&i| !finite(i)) {
        Some(i) => Err(broken(format!("Gaussian {i}"), "finite numbers", "others")),
        None => Ok(()),
    }
}

/// An error in a stream, or in the data for a new one.
pub(crate) fn broken(
    place: impl std::fmt::Display,
    expected: impl std::fmt::Display,
    found: impl std::fmt::Display,
) -> CompressionError {
    let [place, expected, found] = [place.to_string(), expected.to_string(), found.to_string()];
    CompressionError::Codec(CodecError::Invalid { place, expected, found })
}

/// A writer of streams.
#[derive(Debug, Default)]
pub(crate) struct Writer {
    streams: Vec<Stream<'static>>,
}

impl Writer {
    fn push(&mut self, name: &[u8; 4], symbols: usize, bytes: Vec<u8>) {
        self.streams.push(Stream { name: *name, symbols: symbols as u64, bytes: Cow::Owned(bytes) });
    }

    /// Writes numbers unchanged.
    pub(crate) fn floats(&mut self, name: &[u8; 4], values: &[f32]) {
        self.push(name, values.len(), values.iter().flat_map(|x| x.to_le_bytes()).collect());
    }

    /// Columns `[N, width]` of 16-bit floats, each with models of its upper and its lower bytes.
    pub(crate) fn halves(&mut self, name: &[u8; 4], values: &[f32], width: usize) {
        let mut encoder = RangeEncoder::default();
        for column in 0..width {
            let mut models = [AdaptiveModel::new(256), AdaptiveModel::new(256)];
            for value in values.iter().skip(column).step_by(width) {
                let bytes = f16::from_f32(value.clamp(-65504.0, 65504.0)).to_be_bytes();
                models.iter_mut().zip(bytes).for_each(|(model, byte)| _ = model.code(&mut encoder, usize::from(byte)));
            }
        }
        self.push(name, values.len(), encoder.finish());
    }

    /// Symbols `[N, width]` below `alphabet`, each column with a model.
    pub(crate) fn symbols(&mut self, name: &[u8; 4], alphabet: usize, symbols: &[u32], width: usize) {
        let mut encoder = RangeEncoder::default();
        for column in 0..width {
            let mut model = AdaptiveModel::new(alphabet);
            symbols.iter().skip(column).step_by(width).for_each(|s| _ = model.code(&mut encoder, *s as usize));
        }
        self.push(name, symbols.len(), encoder.finish());
    }

    /// Writes the bytes of an encoder with its number of symbols.
    pub(crate) fn coded(&mut self, name: &[u8; 4], symbols: usize, encoder: RangeEncoder) {
        self.push(name, symbols, encoder.finish());
    }

    /// Writes a grid, and codes in Morton order.
    pub(crate) fn positions(&mut self, grid: &Grid, order: &[(u64, usize)]) -> Result<(), CompressionError> {
        let [x, y, z] = grid.origin;
        self.floats(b"grid", &[x, y, z, grid.cell]);
        let codes: Vec<u64> = order.iter().map(|(code, _)| *code).collect();
        let mut encoder = RangeEncoder::default();
        code_octree(&mut encoder, grid.depth, codes.len(), &codes)?;
        self.push(b"posi", codes.len(), encoder.finish());
        Ok(())
    }

    /// The bytes of all streams.
    pub(crate) fn finish(self, gaussians: usize, degree: usize) -> Vec<u8> {
        let coefficients = sh::coefficients(degree) as u8;
        Container { gaussians: gaussians as u64, coefficients, streams: self.streams }.write()
    }
}

/// A reader of the streams of [`Writer`], in their order.
#[derive(Debug)]
pub(crate) struct Reader<'a> {
    container: Container<'a>,
    next: usize,
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Result<Self, CompressionError> {
        let container = Container::read(bytes)?;
        Ok(Self { container, next: 0 })
    }

    /// Number of Gaussians, which the bytes can hold.
    pub(crate) fn gaussians(&self) -> usize {
        self.container.gaussians as usize
    }

    /// Degree of the harmonics.
    pub(crate) fn degree(&self) -> Result<usize, CompressionError> {
        let found = usize::from(self.container.coefficients);
        let degree = (0..=sh::MAX_DEGREE).find(|degree| sh::coefficients(*degree) == found);
        degree.ok_or_else(|| broken("coefficients", "1, 4, 9, 16 or 25", found))
    }

    fn take(&mut self, name: &[u8; 4]) -> Result<&Stream<'a>, CompressionError> {
        let found = self.container.streams.get(self.next).filter(|stream| stream.name == *name);
        self.next += 1;
        found.ok_or_else(|| broken(format!("stream {}", name.escape_ascii()), "this stream", "another or none"))
    }

    /// A stream of `expected` symbols.
    fn sized(&mut self, name: &[u8; 4], expected: usize) -> Result<&Stream<'a>, CompressionError> {
        let stream = self.take(name)?;
        if stream.symbols != expected as u64 {
            return Err(broken(
                format!("stream {}", name.escape_ascii()),
                format!("{expected} symbols"),
                stream.symbols,
            ));
        }
        Ok(stream)
    }

    /// Number of rows of the next stream, by its symbols: at most `most`.
    pub(crate) fn rows(&self, width: usize, most: usize) -> Result<usize, CompressionError> {
        let symbols = self.container.streams.get(self.next).map_or(0, |stream| stream.symbols);
        let rows = symbols / width.max(1) as u64;
        if rows * width as u64 != symbols || rows > most as u64 {
            return Err(broken("codebook", format!("up to {most} rows of {width}"), format!("{symbols} numbers")));
        }
        Ok(rows as usize)
    }

    pub(crate) fn floats(&mut self, name: &[u8; 4], count: usize) -> Result<Vec<f32>, CompressionError> {
        let stream = self.sized(name, count)?;
        if stream.bytes.len() != 4 * count {
            return Err(broken(
                format!("stream {}", name.escape_ascii()),
                format!("{} bytes", 4 * count),
                stream.bytes.len(),
            ));
        }
        Ok(stream.bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    }

    pub(crate) fn halves(&mut self, name: &[u8; 4], rows: usize, width: usize) -> Result<Vec<f32>, CompressionError> {
        let stream = self.sized(name, rows * width)?;
        let mut decoder = RangeDecoder::new(&stream.bytes);
        let mut values = vec![0.0; rows * width];
        for column in 0..width {
            let mut models = [AdaptiveModel::new(256), AdaptiveModel::new(256)];
            for value in values.iter_mut().skip(column).step_by(width) {
                let bytes = models.each_mut().map(|model| model.code(&mut decoder, 0) as u8);
                *value = f16::from_be_bytes(bytes).to_f32();
            }
            ended(&decoder, name)?;
        }
        whole(&decoder, name)?;
        Ok(values)
    }

    /// Decodes a stream of a given number of symbols.
    pub(crate) fn coded<R>(
        &mut self,
        name: &[u8; 4],
        symbols: usize,
        decode: impl FnOnce(&mut RangeDecoder<'_>) -> R,
    ) -> Result<R, CompressionError> {
        let stream = self.sized(name, symbols)?;
        let mut decoder = RangeDecoder::new(&stream.bytes);
        let decoded = decode(&mut decoder);
        whole(&decoder, name)?;
        Ok(decoded)
    }

    pub(crate) fn symbols(
        &mut self,
        name: &[u8; 4],
        alphabet: usize,
        rows: usize,
        width: usize,
    ) -> Result<Vec<u32>, CompressionError> {
        let stream = self.sized(name, rows * width)?;
        let mut decoder = RangeDecoder::new(&stream.bytes);
        let mut symbols = vec![0; rows * width];
        for column in 0..width {
            let mut model = AdaptiveModel::new(alphabet);
            symbols.iter_mut().skip(column).step_by(width).for_each(|s| *s = model.code(&mut decoder, 0) as u32);
            ended(&decoder, name)?;
        }
        whole(&decoder, name)?;
        Ok(symbols)
    }

    /// Reads a grid of `depth` levels, and its codes.
    pub(crate) fn positions(&mut self, depth: u32) -> Result<(Grid, Vec<u64>), CompressionError> {
        let head = self.floats(b"grid", 4)?;
        let count = self.gaussians();
        let grid = Grid { origin: [head[0], head[1], head[2]], cell: head[3], depth };
        if !head.iter().all(|x| x.is_finite()) {
            return Err(broken("stream grid", "finite numbers", format!("{head:?}")));
        }
        let stream = self.sized(b"posi", count)?;
        let mut decoder = RangeDecoder::new(&stream.bytes);
        let codes = code_octree(&mut decoder, depth, count, &[])?;
        whole(&decoder, b"posi")?;
        Ok((grid, codes))
    }
}

fn ended(decoder: &RangeDecoder, name: &[u8; 4]) -> Result<(), CompressionError> {
    if decoder.exhausted() {
        Err(broken(format!("stream {}", name.escape_ascii()), "all symbols", "its end"))
    } else {
        Ok(())
    }
}

fn whole(decoder: &RangeDecoder, name: &[u8; 4]) -> Result<(), CompressionError> {
    let place = || format!("stream {}", name.escape_ascii());
    if decoder.is_whole() { Ok(()) } else { Err(broken(place(), "no byte behind the last symbol", "more")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weaver_kernels::random::Stream;

    /// Voxels are within half a cell of positions, and every position has one.
    #[test]
    fn positions_are_half_a_cell_from_their_voxels() {
        for (seed, depth) in [(1, 4), (2, 10), (3, 16)] {
            let stream = Stream::new(seed, 0, "test.grid");
            let means: Vec<[f32; 3]> =
                (0..200).map(|i| [0, 1, 2].map(|k| 3.0 * stream.normal::<f32>(3 * i + k))).collect();
            let (grid, order) = Grid::about(&means, depth);
            let mut numbers: Vec<usize> = order.iter().map(|(_, number)| *number).collect();
            assert!(order.is_sorted_by_key(|(code, _)| *code));
            for (code, number) in &order {
                for (found, mean) in grid.mean(*code).iter().zip(means[*number]) {
                    // Half a cell, and the rounding of numbers of this size.
                    let most = 0.5 * f64::from(grid.cell) + 1e-6 * f64::from(mean.abs()).max(1.0);
                    assert!((f64::from(*found) - f64::from(mean)).abs() <= most, "{found} for {mean}");
                }
            }
            numbers.sort_unstable();
            assert_eq!(numbers, (0..200).collect::<Vec<_>>());
        }
    }

    #[test]
    fn streams_come_back_in_their_order() {
        let halves: Vec<f32> = (0..30).map(|i| f16::from_f32(0.37 * i as f32 - 4.0).to_f32()).collect();
        let symbols: Vec<u32> = (0..40).map(|i| i * i % 7).collect();
        let (grid, order) = Grid::about(&[[0.0; 3], [1.0, 2.0, 3.0], [-1.0, 0.5, 0.25]], 8);
        let mut writer = Writer::default();
        writer.positions(&grid, &order).unwrap();
        writer.halves(b"half", &halves, 3);
        writer.symbols(b"symb", 7, &symbols, 4);
        writer.floats(b"flts", &[1.5, f32::MAX]);
        let bytes = writer.finish(3, 2);

        let mut reader = Reader::new(&bytes).unwrap();
        assert_eq!((reader.gaussians(), reader.degree().unwrap()), (3, 2));
        let (read, codes) = reader.positions(8).unwrap();
        assert_eq!(codes, order.iter().map(|(code, _)| *code).collect::<Vec<_>>());
        assert_eq!(read.mean(codes[1]), grid.mean(codes[1]));
        assert_eq!(reader.rows(3, 10).unwrap(), 10);
        assert!(reader.rows(3, 9).is_err() && reader.rows(4, 10).is_err());
        assert_eq!(reader.halves(b"half", 10, 3).unwrap(), halves);
        assert_eq!(reader.symbols(b"symb", 7, 10, 4).unwrap(), symbols);
        assert_eq!(reader.floats(b"flts", 2).unwrap(), [1.5, f32::MAX]);
        let error = Reader::new(&bytes).unwrap().floats(b"flts", 2).unwrap_err();
        assert!(error.to_string().contains("stream flts"), "{error}");
    }

    #[test]
    fn scenes_with_other_than_numbers_are_named() {
        let whole = Gaussians {
            means: vec![[0.0; 3]; 2],
            log_scales: vec![[0.0; 3]; 2],
            quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            opacity_logits: vec![f32::INFINITY, f32::NEG_INFINITY],
            sh: vec![0.0; 6],
            degree: 0,
        };
        check(&whole).unwrap();
        let mut broken = whole.clone();
        broken.sh[4] = f32::INFINITY;
        assert!(check(&broken).unwrap_err().to_string().contains("Gaussian 1"));
        let mut broken = whole.clone();
        broken.opacity_logits[0] = f32::NAN;
        assert!(check(&broken).unwrap_err().to_string().contains("Gaussian 0"));
        assert!(check(&Gaussians { means: vec![[0.0; 3]], ..whole }).is_err());
        assert!(check(&Gaussians::default()).is_err());
    }
}
