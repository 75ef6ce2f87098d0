//! Huge pages for large buffers that are read repeatedly or in random order.

/// Advises the operating system to back new memory with huge pages (2 MiB) when it is first touched.
///
/// Huge pages mean fewer page faults and fewer misses of the address translation cache. This is only a hint: nothing
/// happens on systems other than Linux, for buffers smaller than a page, or where huge pages are disabled.
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
            // SAFETY: the pages lie inside memory that we borrow exclusively, and the advice changes no content. If the
            // call fails, nothing changes.
            unsafe {
                libc::madvise(first as *mut libc::c_void, last - first, libc::MADV_HUGEPAGE);
            }
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = memory;
}
