//! Memory in large pages, for large buffers that are read again and again, or in no order.

/// Asks the operating system to back fresh memory by huge pages (2 MiB) as it is first touched: fewer address
/// translations to look up, fewer page faults. A hint: on other systems than Linux, for little memory, or where the
/// system has them switched off, nothing happens.
///
/// ```
/// let mut buffer: Vec<f32> = Vec::with_capacity(1 << 20);
/// weaver_kernels::pages::prefer_huge(buffer.spare_capacity_mut());
/// buffer.resize(1 << 20, 0.0);
/// ```
pub fn prefer_huge<T>(memory: &mut [T]) {
    #[cfg(target_os = "linux")]
    #[allow(unsafe_code)]
    {
        /// Bytes of a huge page.
        const PAGE: usize = 1 << 21;
        let start = memory.as_mut_ptr() as usize;
        let end = start + size_of_val(memory);
        let (first, last) = (start.next_multiple_of(PAGE), end / PAGE * PAGE);
        if last > first {
            // SAFETY: the pages lie inside memory that we hold exclusively, and the advice changes no content. A failure
            // changes nothing.
            unsafe {
                libc::madvise(first as *mut libc::c_void, last - first, libc::MADV_HUGEPAGE);
            }
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = memory;
}
