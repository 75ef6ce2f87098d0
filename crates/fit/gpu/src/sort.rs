//! A stable radix sort of pairs on the device, four bits a pass.

use crate::context::Context;
use crate::error::GpuError;
use crate::passes::Passes;
use crate::room::{Room, uniform};
use crate::shader::Kernel;
use crate::staging::Staging;

/// Pairs that a work group sorts.
const GROUP: usize = 2048;
/// Bits of a digit.
const BITS: u32 = 4;
/// Words from one pass's numbers to the next's: offsets of bindings are multiples of 256 bytes.
const STRIDE: usize = 64;

/// Sorts pairs of 32 bits by ascending key; equal keys keep their order. It keeps its memory from call to call.
#[derive(Debug, Default)]
pub(crate) struct RadixSort {
    counts: Room,
}

/// Keys and values, and room for as many.
#[derive(Clone, Copy)]
pub(crate) struct Pairs<'a> {
    pub keys: &'a Room,
    pub values: &'a Room,
}

impl RadixSort {
    pub fn counts(&self) -> &Room {
        &self.counts
    }

    /// Passes that keys of so many bits take; the result is in the second pair of buffers where they are odd.
    pub fn passes(bits: u32) -> u32 {
        bits.div_ceil(BITS)
    }

    /// Records the sorting of the first `len` pairs of `from`; `to` is room to work in.
    ///
    /// # Errors
    ///
    /// More pairs than the adapter has room for.
    pub fn encode<'a>(
        &mut self,
        context: &Context,
        passes: &mut Passes<'_>,
        (len, bits): (usize, u32),
        mut from: Pairs<'a>,
        mut to: Pairs<'a>,
    ) -> Result<(), GpuError> {
        let groups = len.div_ceil(GROUP);
        self.counts.storage(context, "counts of digits", 16 * groups, 4)?;
        let count = Self::passes(bits);
        let mut words = vec![0; STRIDE * count.max(1) as usize];
        for (pass, words) in words.chunks_mut(STRIDE).enumerate() {
            words[..3].copy_from_slice(&[len as u32, groups as u32, BITS * pass as u32]);
        }
        let digits = uniform(context, &words);
        for pass in 0..count {
            let digit = || {
                let (offset, size) = (4 * STRIDE as u64 * u64::from(pass), wgpu::BufferSize::new(16));
                wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &digits, offset, size })
            };
            passes.run(Kernel::Count, groups, &[(0, digit()), (1, from.keys.all()), (3, self.counts.all())]);
            passes.run(Kernel::ScanCounts, groups.min(1), &[(0, digit()), (3, self.counts.all())]);
            let bindings = [
                (0, digit()),
                (1, from.keys.all()),
                (2, from.values.all()),
                (3, self.counts.all()),
                (4, to.keys.all()),
                (5, to.values.all()),
            ];
            passes.run(Kernel::Scatter, groups, &bindings);
            std::mem::swap(&mut from, &mut to);
        }
        Ok(())
    }
}

/// Sorts pairs of the host on the device, by the lowest `bits` of their keys.
///
/// Sorts pairs as the rasterizer does by depth and by tile, on slices: to use it alone, and to test it.
///
/// # Errors
///
/// More pairs than the adapter has room for, or a failure of the device.
///
/// # Panics
///
/// With other than as many keys as values.
pub fn sort_pairs(context: &Context, keys: &mut [u32], values: &mut [u32], bits: u32) -> Result<(), GpuError> {
    assert_eq!(keys.len(), values.len(), "a value for each key");
    let len = keys.len();
    let mut rooms: [Room; 4] = Default::default();
    for room in &mut rooms {
        room.storage(context, "pairs to sort", len, 4)?;
    }
    let [a, b, c, d] = &rooms;
    context.queue().write_buffer(a.buffer(), 0, bytemuck::cast_slice(keys));
    context.queue().write_buffer(b.buffer(), 0, bytemuck::cast_slice(values));
    let (from, to) = (Pairs { keys: a, values: b }, Pairs { keys: c, values: d });
    let mut passes = Passes::new(context, None);
    let mut sort = RadixSort::default();
    sort.encode(context, &mut passes, (len, bits), from, to)?;
    let sorted = if RadixSort::passes(bits).is_multiple_of(2) { from } else { to };
    let bytes = 4 * len as u64;
    let parts = [(sorted.keys.buffer(), bytes), (sorted.values.buffer(), bytes)];
    let read = passes.read(&mut Staging::default(), &parts)?;
    let words = read.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes));
    keys.iter_mut().chain(values).zip(words).for_each(|(to, word)| *to = word);
    Ok(())
}
