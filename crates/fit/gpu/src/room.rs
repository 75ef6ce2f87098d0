//! Memory on the device that only grows.

use crate::context::Context;
use crate::error::GpuError;

/// A buffer that grows to the requested size and stays: calls of sizes seen before allocate nothing.
#[derive(Debug, Default)]
pub(crate) struct Room {
    buffer: Option<wgpu::Buffer>,
    bytes: u64,
}

/// Usages of storage buffers.
const STORAGE: wgpu::BufferUsages =
    wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_SRC).union(wgpu::BufferUsages::COPY_DST);
/// Usages of buffers that the host reads.
const READ: wgpu::BufferUsages = wgpu::BufferUsages::MAP_READ.union(wgpu::BufferUsages::COPY_DST);

impl Room {
    /// The first bytes of an embedder's buffer.
    pub fn of(buffer: &wgpu::Buffer, bytes: u64) -> Self {
        Self { buffer: Some(buffer.clone()), bytes: bytes.max(16) }
    }

    /// Room for `count` elements of `each` bytes that shaders see; `what` names them in the error.
    ///
    /// # Errors
    ///
    /// More than the adapter allows in a buffer.
    pub fn storage(&mut self, context: &Context, what: &str, count: usize, each: u64) -> Result<(), GpuError> {
        self.grow(context, what, count as u64 * each, STORAGE)
    }

    /// Room for `bytes` that the host reads.
    pub fn read(&mut self, context: &Context, bytes: u64) -> Result<(), GpuError> {
        self.grow(context, "what is read back", bytes, READ)
    }

    fn grow(&mut self, context: &Context, what: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<(), GpuError> {
        // No binding is empty, and none of vectors shorter than one of them.
        self.bytes = bytes.max(16).next_multiple_of(4);
        if self.buffer.as_ref().is_none_or(|buffer| buffer.size() < self.bytes) {
            let most = context.device().limits().max_buffer_size;
            context.at_most("max_buffer_size", self.bytes, most, || what.into())?;
            // The old one first: there may be no room for both.
            self.buffer = None;
            let descriptor = wgpu::BufferDescriptor { label: None, size: self.bytes, usage, mapped_at_creation: false };
            self.buffer = Some(context.device().create_buffer(&descriptor));
        }
        Ok(())
    }

    /// The buffer.
    ///
    /// # Panics
    ///
    /// Before room was made.
    pub fn buffer(&self) -> &wgpu::Buffer {
        self.buffer.as_ref().expect("room is made before it is used")
    }

    /// Bytes of the last request.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The numbers of the last request, as a shader sees them.
    pub fn all(&self) -> wgpu::BindingResource<'_> {
        self.part(0, self.bytes)
    }

    /// A part of it; `from` is a multiple of 256.
    pub fn part(&self, from: u64, bytes: u64) -> wgpu::BindingResource<'_> {
        let size = wgpu::BufferSize::new(bytes.max(16).min(self.bytes.max(16)));
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: self.buffer(), offset: from, size })
    }

    /// Fills it with ones, as leftovers of another drawing might.
    pub fn spoil(&self, context: &Context) {
        if let Some(buffer) = self.buffer.as_ref().filter(|buffer| buffer.usage().contains(STORAGE)) {
            context.queue().write_buffer(buffer, 0, &vec![0xff; buffer.size() as usize]);
        }
    }
}

/// A small buffer of numbers that all threads read.
pub(crate) fn uniform(context: &Context, words: &[u32]) -> wgpu::Buffer {
    // Not mapped at its creation: on a device that is lost, that would be a panic.
    let buffer = context.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 4 * words.len() as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    context.queue().write_buffer(&buffer, 0, bytemuck::cast_slice(words));
    buffer
}

/// The first bytes of a buffer that the host may read, once all work is done.
pub(crate) fn mapped(context: &Context, buffer: &wgpu::Buffer, bytes: u64) -> Result<Vec<u8>, GpuError> {
    if bytes == 0 {
        return Ok(Vec::new());
    }
    let slice = buffer.slice(..bytes);
    let (sender, receiver) = std::sync::mpsc::channel();
    slice.map_async(wgpu::MapMode::Read, move |result| {
        // The receiver waits below.
        let _ = sender.send(result);
    });
    let waited = context.device().poll(wgpu::PollType::wait_indefinitely());
    context.check()?;
    waited.map_err(|error| context.failure(error.to_string()))?;
    match receiver.recv() {
        Ok(Ok(())) => {}
        Ok(Err(error)) => return Err(context.failure(error.to_string())),
        Err(_) => return Err(context.failure("the device does not answer")),
    }
    let view = slice.get_mapped_range().map_err(|error| context.failure(error.to_string()))?;
    let copy = view.to_vec();
    drop(view);
    buffer.unmap();
    Ok(copy)
}
