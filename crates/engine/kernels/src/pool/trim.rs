//! Returns unused memory to the operating system.

use super::{Pool, Shelf};
use std::sync::PoisonError;

impl Pool {
    /// Frees the buffers of element type `U` that are not in use.
    ///
    /// Call it between parts of a computation whose buffers have different sizes, so that the unused buffers of one
    /// part do not add to the memory of the next.
    ///
    /// ```
    /// let pool = weaver_kernels::Pool::new();
    /// let kept = pool.buffer::<f32>(100);
    /// drop(pool.buffer::<f32>(1 << 20));
    /// pool.trim::<f32>();
    /// assert!(pool.allocated_bytes() < 1000);
    /// drop(kept);
    /// ```
    pub fn trim<U: Send + 'static>(&self) {
        let mut shelves = self.shelves.lock().unwrap_or_else(PoisonError::into_inner);
        let shelf: &mut Shelf<U> = shelves.of_type();
        let freed: Vec<Vec<U>> = shelf.classes.iter_mut().flat_map(std::mem::take).collect();
        shelves.allocated_bytes -= freed.iter().map(|buffer| buffer.len() * size_of::<U>()).sum::<usize>();
    }
}
