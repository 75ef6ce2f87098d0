//! A memory pool: dropped buffers return to it and serve later requests of the same size class, so that a repeated
//! training step allocates nothing.

mod trim;

use crate::{pages, parallel};
use std::any::{Any, TypeId};
use std::fmt;
use std::ops::{Deref, DerefMut, Range};
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of a cache line. Every buffer begins at one, so that no aligned vector straddles two.
const LINE: usize = 64;

/// Classes above its own that a request may be served from: buffers up to twice as large. Lengths that vary a lot from
/// step to step, such as the number of Gaussians of a drawn budget, would else leave buffers of every size that they
/// ever had.
const REACH: usize = 4;

/// The size class of a length. There are four classes per power of two: a new buffer wastes a fifth at most, and
/// lengths that vary a little from step to step find the same buffer again.
fn class_of(len: usize) -> usize {
    let len = len.max(16);
    let octave = len.ilog2() as usize;
    let quarter = 1usize << (octave - 2);
    let step = (len - (1 << octave)).div_ceil(quarter);
    octave * 4 + step
}

/// Extra elements that allow a buffer to begin at a cache line wherever its memory begins.
fn margin<U>() -> usize {
    LINE.div_ceil(size_of::<U>().max(1))
}

fn class_capacity(class: usize) -> usize {
    let (octave, step) = (class / 4, class % 4);
    (1 << octave) + step * (1 << (octave - 2))
}

/// Bytes that a request counts for while it is in use: the size of a buffer of its own class, whichever class serves
/// it.
fn counted<U>(len: usize) -> usize {
    (class_capacity(class_of(len)) + margin::<U>()) * size_of::<U>()
}

/// The free vectors of one element type, by size class.
struct Shelf<U> {
    classes: Vec<Vec<Vec<U>>>,
}

impl<U> Default for Shelf<U> {
    fn default() -> Self {
        Self { classes: Vec::new() }
    }
}

#[derive(Default)]
struct Shelves {
    by_type: Vec<(TypeId, Box<dyn Any + Send>)>,
    allocated_bytes: usize,
    /// Bytes of the buffers in use, and the largest value that has had.
    used_bytes: usize,
    peak_bytes: usize,
}

impl Shelves {
    /// The value kept for a type, created by `Default` at first.
    fn of_type<S: Default + Send + 'static>(&mut self) -> &mut S {
        let id = TypeId::of::<S>();
        let at = self.by_type.iter().position(|(t, _)| *t == id).unwrap_or_else(|| {
            self.by_type.push((id, Box::new(S::default())));
            self.by_type.len() - 1
        });
        self.by_type[at].1.downcast_mut().expect("shelves are kept by type")
    }
}

/// A pool of buffers of any element type. Clones share the same memory.
#[derive(Clone, Default)]
pub struct Pool {
    shelves: Arc<Mutex<Shelves>>,
}

impl fmt::Debug for Pool {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pool").field("allocated_bytes", &self.allocated_bytes()).finish()
    }
}

impl Pool {
    /// An empty pool.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes a buffer of `len` elements with unspecified contents: default values, or the contents of an earlier use.
    #[inline(never)]
    pub fn buffer<U: Copy + Default + Send + 'static>(&self, len: usize) -> Buffer<U> {
        let class = class_of(len);
        let mut shelves = self.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        let shelf: &mut Shelf<U> = shelves.of_type();
        let free = shelf.classes.iter_mut().skip(class).take(1 + REACH).find_map(Vec::pop);
        let data = free.unwrap_or_else(|| {
            let mut data = vec![U::default(); class_capacity(class) + margin::<U>()];
            pages::prefer_huge(&mut data);
            shelves.allocated_bytes += size_of_val(&data[..]);
            data
        });
        shelves.used_bytes += counted::<U>(len);
        shelves.peak_bytes = shelves.peak_bytes.max(shelves.used_bytes);
        let start = data.as_ptr().align_offset(LINE).min(data.len() - len);
        Buffer { data, range: start..start + len, pool: self.clone() }
    }

    /// Takes a buffer of `len` elements and sets all of them to `value`.
    pub fn filled<U: Copy + Default + Send + 'static>(&self, len: usize, value: U) -> Buffer<U> {
        let mut buffer = self.buffer(len);
        buffer.fill(value);
        buffer
    }

    /// Takes a buffer and copies `source` to it.
    #[inline(never)]
    pub fn copy_of<U: Copy + Default + Send + Sync + 'static>(&self, source: &[U]) -> Buffer<U> {
        let mut buffer = self.buffer(source.len());
        parallel::copy(source, &mut buffer);
        buffer
    }

    /// The value that `build` returns for `key`, computed once and kept as long as the pool.
    ///
    /// For tables that ops of equal sizes share.
    ///
    /// ```
    /// let pool = weaver_kernels::Pool::new();
    /// let squares = |n: usize| pool.table(n, || (0..n).map(|i| i * i).collect::<Vec<_>>());
    /// assert!(std::sync::Arc::ptr_eq(&squares(3), &squares(3)));
    /// ```
    pub fn table<K, V>(&self, key: K, build: impl FnOnce() -> V) -> Arc<V>
    where
        K: PartialEq + Send + 'static,
        V: Send + Sync + 'static,
    {
        let find = |tables: &Vec<(K, Arc<V>)>| tables.iter().find(|(k, _)| *k == key).map(|(_, table)| table.clone());
        let shelves = || self.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = find(shelves().of_type()) {
            return found;
        }
        // Built without the lock: it may take long, or take buffers of this pool.
        let table = Arc::new(build());
        let mut shelves = shelves();
        let tables = shelves.of_type();
        find(tables).unwrap_or_else(|| {
            tables.push((key, table.clone()));
            table
        })
    }

    /// Bytes that the pool has allocated. It keeps them until it is [trimmed](Pool::trim).
    pub fn allocated_bytes(&self) -> usize {
        self.shelves.lock().unwrap_or_else(PoisonError::into_inner).allocated_bytes
    }

    /// Bytes of the buffers that are in use.
    pub fn used_bytes(&self) -> usize {
        self.shelves.lock().unwrap_or_else(PoisonError::into_inner).used_bytes
    }

    /// The most bytes that have been in use at one time. The pool may have allocated more, since a free buffer serves
    /// only requests of its own size to half of it, and counts as one of the requested size.
    pub fn peak_bytes(&self) -> usize {
        self.shelves.lock().unwrap_or_else(PoisonError::into_inner).peak_bytes
    }

    /// Resets [`peak_bytes`](Pool::peak_bytes) to the bytes in use now.
    pub fn reset_peak(&self) {
        let mut shelves = self.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        shelves.peak_bytes = shelves.used_bytes;
    }
}

/// A slice of memory from a [`Pool`]; dropping it returns the memory.
pub struct Buffer<U: Copy + Send + 'static> {
    data: Vec<U>,
    range: Range<usize>,
    pool: Pool,
}

impl<U: Copy + Send + 'static> Buffer<U> {
    /// Bytes that it counts for, a little more than the elements need.
    pub fn counted_bytes(&self) -> usize {
        counted::<U>(self.range.len())
    }
}

impl<U: Copy + Send + 'static> Drop for Buffer<U> {
    #[inline(never)]
    fn drop(&mut self) {
        let data = std::mem::take(&mut self.data);
        let class = class_of(data.len() - margin::<U>());
        let mut shelves = self.pool.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        shelves.used_bytes -= counted::<U>(self.range.len());
        let classes = &mut shelves.of_type::<Shelf<U>>().classes;
        if classes.len() <= class {
            classes.resize_with(class + 1, Vec::new);
        }
        classes[class].push(data);
    }
}

impl<U: Copy + Send + 'static> Deref for Buffer<U> {
    type Target = [U];
    fn deref(&self) -> &[U] {
        &self.data[self.range.clone()]
    }
}

impl<U: Copy + Send + 'static> DerefMut for Buffer<U> {
    fn deref_mut(&mut self) -> &mut [U] {
        &mut self.data[self.range.clone()]
    }
}

impl<U: Copy + Send + fmt::Debug + 'static> fmt::Debug for Buffer<U> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter().take(8)).finish()?;
        write!(f, " ({} elements)", self.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_hold_their_lengths() {
        for len in 0..5000 {
            let capacity = class_capacity(class_of(len));
            assert!(capacity >= len.max(16) && (len < 16 || capacity * 4 <= len * 5 + 4), "{len} -> {capacity}");
            assert_eq!(class_of(capacity), class_of(len));
        }
    }

    #[test]
    fn buffers_begin_at_cache_lines() {
        let pool = Pool::new();
        for len in [0, 1, 100, 5000, 1 << 20] {
            assert_eq!(pool.buffer::<f32>(len).as_ptr().addr() % LINE, 0, "{len}");
            assert_eq!(pool.buffer::<u8>(len).as_ptr().addr() % LINE, 0, "{len}");
        }
        assert_eq!(pool.buffer::<[f64; 3]>(7).len(), 7); // and those of any size are as long as they should be
    }

    #[test]
    fn a_table_may_be_made_of_buffers() {
        let pool = Pool::new();
        let squares = || pool.table("squares", || pool.filled::<f32>(4, 2.0).to_vec());
        assert!(Arc::ptr_eq(&squares(), &squares()));
    }

    #[test]
    fn lengths_that_vary_share_their_buffers() {
        let pool = Pool::new();
        let lengths = || (0..40).map(|i| 1000 + 25 * ((i * 17) % 40));
        drop(pool.buffer::<f32>(2000));
        let before = pool.allocated_bytes();
        lengths().for_each(|len| drop(pool.buffer::<f32>(len)));
        assert_eq!(pool.allocated_bytes(), before);
        drop(pool.buffer::<f32>(800)); // less than half of it
        assert!(pool.allocated_bytes() > before);
    }

    #[test]
    fn memory_comes_back() {
        let pool = Pool::new();
        drop(pool.buffer::<f32>(100));
        let before = pool.allocated_bytes();
        let again = pool.filled::<f32>(97, 2.0);
        assert_eq!((pool.allocated_bytes(), again.len(), again[96]), (before, 97, 2.0));
        let other = pool.buffer::<u32>(100);
        assert!(pool.allocated_bytes() > before);
        let both = pool.used_bytes();
        assert!(both >= 4 * 197 && pool.peak_bytes() == both);
        drop(other);
        assert!(pool.used_bytes() < both && pool.peak_bytes() == both);
        pool.reset_peak();
        assert_eq!(pool.peak_bytes(), pool.used_bytes());
    }
}
