//! Binning: which primitives each tile has to look at, in drawing order.
//!
//! Primitives are sorted by depth once per picture, then put into the lists of the tiles in that order: a stable
//! counting sort, parallel over parts of the sorted sequence.

use super::coverage::{CHUNK, Chunk};
use crate::memory::grown;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use weaver_kernels::parallel;

/// The lists of all tiles of all pictures, one after the other.
#[derive(Debug, Default)]
pub(crate) struct Lists {
    /// Number of entries of each part of the sorted sequence in each tile, then the place of its next entry there:
    /// `[parts, tiles]`.
    cursors: Vec<u32>,
    /// Where each tile's list starts, `[V * K * tiles + 1]`.
    starts: Vec<u32>,
    /// Primitives (v N + n), tile by tile, front to back.
    entries: Vec<AtomicU32>,
    len: usize,
}

/// Runs `body` on the primitives of sorted keys with their places, which are anywhere in memory: fetched well ahead.
#[inline(always)]
fn for_each_places(sorted: &[AtomicU64], chunks: &[Chunk], mut body: impl FnMut(usize, &[AtomicU32])) {
    const AHEAD: usize = 16;
    let primitive = |i: usize| sorted.get(i).map(|key| (key.load(Relaxed) as u32) as usize);
    for i in 0..sorted.len() {
        if let Some(n) = primitive(i + 2 * AHEAD) {
            chunks[n / CHUNK].prefetch_start(n % CHUNK);
        }
        if let Some(n) = primitive(i + AHEAD) {
            chunks[n / CHUNK].prefetch_places(n % CHUNK);
        }
        if let Some(n) = primitive(i) {
            body(n, chunks[n / CHUNK].places(n % CHUNK));
        }
    }
}

/// A picture whose primitives are put into lists.
pub(super) struct Picture<'a> {
    pub number: usize,
    /// The first primitive of its view, and the tiles of all of these.
    pub first: usize,
    pub chunks: &'a [Chunk],
}

impl Lists {
    /// Makes room for `entries` entries in `tiles` tiles, over all pictures.
    pub fn prepare(&mut self, tiles: usize, entries: usize) {
        grown(&mut self.starts, tiles + 1);
        grown(&mut self.entries, entries);
        self.starts[0] = 0;
        self.len = entries;
    }

    /// Bins the primitives of a picture, after those of the pictures before; `sorted` are their keys by depth. A
    /// picture has `tiles` tiles.
    pub fn bin(&mut self, picture: Picture<'_>, tiles: usize, sorted: &[AtomicU64]) {
        let Picture { number, first, chunks } = picture;
        // Enough parts for many threads, few enough for the cursors to stay in the cache. The result does not depend
        // on them.
        let parts = (sorted.len() / 4096).clamp(1, 32);
        let part_len = sorted.len().div_ceil(parts);
        let ids = |part: usize| {
            let end = ((part + 1) * part_len).min(sorted.len());
            &sorted[(part * part_len).min(end)..end]
        };
        let cursors = grown(&mut self.cursors, parts * tiles);
        parallel::for_chunks(cursors, tiles, |part, counts| {
            counts.fill(0);
            for_each_places(ids(part), chunks, |_, places| {
                places.iter().for_each(|tile| counts[tile.load(Relaxed) as usize] += 1);
            });
        });
        let starts = &mut self.starts[number * tiles..];
        let mut next = starts[0];
        for tile in 0..tiles {
            starts[tile] = next;
            for part in 0..parts {
                let cursor = &mut cursors[part * tiles + tile];
                next += std::mem::replace(cursor, next);
            }
        }
        starts[tiles] = next;
        let list = &self.entries[..];
        parallel::for_chunks(cursors, tiles, |part, cursors| {
            for_each_places(ids(part), chunks, |n, places| {
                let id = (first + n) as u32;
                for place in places {
                    let cursor = &mut cursors[place.load(Relaxed) as usize];
                    list[*cursor as usize].store(id, Relaxed);
                    place.store(*cursor, Relaxed);
                    *cursor += 1;
                }
            });
        });
    }

    /// Entries of all lists together.
    pub fn len(&self) -> usize {
        self.len
    }

    /// The range of entries of tile `t` (of all pictures).
    pub fn range(&self, t: usize) -> Range<usize> {
        self.starts[t] as usize..self.starts[t + 1] as usize
    }

    /// The primitives of tile `t`.
    pub fn of_tile(&self, t: usize) -> &[AtomicU32] {
        &self.entries[self.range(t)]
    }
}
