//! Memory that outlives a step: buffers go back to the pool when they are dropped, and come out again
//! for the next request of their size class, so that a step which has run once allocates nothing.

mod trim;

use std::any::{Any, TypeId};
use std::fmt;
use std::ops::{Deref, DerefMut, Range};
use std::sync::{Arc, Mutex, PoisonError};
use weaver_kernels::{pages, parallel};

/// Bytes of a cache line, at which every buffer begins: a vector as wide as a line then never touches two.
const LINE: usize = 64;

/// Capacities come in four classes an octave: at most a quarter is wasted, and requests that differ a
/// little from step to step (a varying number of Gaussians) find their buffer again.
fn class_of(len: usize) -> usize {
    let len = len.max(16);
    let octave = len.ilog2() as usize;
    let quarter = 1usize << (octave - 2);
    let step = (len - (1 << octave)).div_ceil(quarter);
    octave * 4 + step
}

/// Elements to spare, so that a buffer can begin at a cache line wherever its memory does.
fn margin<U>() -> usize {
    LINE.div_ceil(size_of::<U>().max(1))
}

fn class_capacity(class: usize) -> usize {
    let (octave, step) = (class / 4, class % 4);
    (1 << octave) + step * (1 << (octave - 2))
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
    /// In buffers that are out at the moment, and the most that ever were.
    used_bytes: usize,
    peak_bytes: usize,
}

impl Shelves {
    /// The one value of a type; the default at first.
    fn of_type<S: Default + Send + 'static>(&mut self) -> &mut S {
        let id = TypeId::of::<S>();
        let at = self.by_type.iter().position(|(t, _)| *t == id).unwrap_or_else(|| {
            self.by_type.push((id, Box::new(S::default())));
            self.by_type.len() - 1
        });
        self.by_type[at].1.downcast_mut().expect("shelves are kept by type")
    }
}

/// A shared pool of buffers of any element type. Cloning shares it.
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

    /// A buffer of `len` elements whose contents are unspecified (default or left from an earlier use).
    pub fn buffer<U: Copy + Default + Send + 'static>(&self, len: usize) -> Buffer<U> {
        let class = class_of(len);
        let mut shelves = self.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        let shelf: &mut Shelf<U> = shelves.of_type();
        let free = shelf.classes.get_mut(class).and_then(Vec::pop);
        let data = free.unwrap_or_else(|| {
            let capacity = class_capacity(class);
            let mut data = vec![U::default(); capacity + margin::<U>()];
            pages::prefer_huge(&mut data);
            shelves.allocated_bytes += size_of_val(&data[..]);
            data
        });
        shelves.used_bytes += size_of_val(&data[..]);
        shelves.peak_bytes = shelves.peak_bytes.max(shelves.used_bytes);
        let start = data.as_ptr().align_offset(LINE).min(data.len() - len);
        Buffer { data, range: start..start + len, pool: self.clone() }
    }

    /// A buffer of `len` elements, all set to `value`.
    pub fn filled<U: Copy + Default + Send + 'static>(&self, len: usize, value: U) -> Buffer<U> {
        let mut buffer = self.buffer(len);
        buffer.fill(value);
        buffer
    }

    /// A pooled copy of `source`.
    pub fn copy_of<U: Copy + Default + Send + Sync + 'static>(&self, source: &[U]) -> Buffer<U> {
        let mut buffer = self.buffer(source.len());
        parallel::copy(source, &mut buffer);
        buffer
    }

    /// The value that `build` makes for `key`, made once and kept as long as the pool: tables that ops of the same sizes share.
    ///
    /// ```
    /// let pool = weaver_autograd::Pool::new();
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
        // It may take its time, or buffers of this pool.
        let table = Arc::new(build());
        let mut shelves = shelves();
        let tables = shelves.of_type();
        find(tables).unwrap_or_else(|| {
            tables.push((key, table.clone()));
            table
        })
    }

    /// Bytes that this pool has allocated, and keeps until it is [trimmed](Pool::trim).
    pub fn allocated_bytes(&self) -> usize {
        self.shelves.lock().unwrap_or_else(PoisonError::into_inner).allocated_bytes
    }

    /// Bytes in the buffers that are in use now.
    pub fn used_bytes(&self) -> usize {
        self.shelves.lock().unwrap_or_else(PoisonError::into_inner).used_bytes
    }

    /// The most bytes that were in use at one time. Less than what was allocated, since the free buffers of one size are no
    /// help to another.
    pub fn peak_bytes(&self) -> usize {
        self.shelves.lock().unwrap_or_else(PoisonError::into_inner).peak_bytes
    }

    /// Begins to look for the peak anew.
    pub fn reset_peak(&self) {
        let mut shelves = self.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        shelves.peak_bytes = shelves.used_bytes;
    }
}

/// A slice of pooled memory; dropping it returns the memory to its pool.
pub struct Buffer<U: Copy + Send + 'static> {
    data: Vec<U>,
    range: Range<usize>,
    pool: Pool,
}

impl<U: Copy + Send + 'static> Buffer<U> {
    /// The memory it takes, which is a little more than its length.
    pub(crate) fn capacity_bytes(&self) -> usize {
        size_of_val(&self.data[..])
    }
}

impl<U: Copy + Send + 'static> Drop for Buffer<U> {
    fn drop(&mut self) {
        let data = std::mem::take(&mut self.data);
        let class = class_of(data.len() - margin::<U>());
        let mut shelves = self.pool.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        shelves.used_bytes -= size_of_val(&data[..]);
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
