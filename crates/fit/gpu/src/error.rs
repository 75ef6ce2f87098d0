//! Errors of a device.

use crate::adapter::Adapter;
use thiserror::Error;
use weaver_splat::RasterError;

/// Errors of a device.
#[derive(Clone, Debug, Error)]
#[non_exhaustive]
pub enum GpuError {
    /// The machine has no adapter of the requested kind.
    #[error("device {asked}: {}", offered(.found))]
    NoAdapter {
        /// The requested device.
        asked: String,
        /// All that there are.
        found: Vec<Adapter>,
    },
    /// An adapter offers less than is needed.
    #[error("{adapter} allows {limit} of {found}, {needed} are needed: {what}")]
    Limit {
        /// The adapter.
        adapter: String,
        /// WebGPU's name of the limit.
        limit: &'static str,
        /// The adapter's limit.
        found: u64,
        /// The amount needed.
        needed: u64,
        /// The purpose.
        what: String,
    },
    /// An adapter refuses to be opened.
    #[error("{adapter} cannot be opened: {message}")]
    Refused {
        /// The adapter.
        adapter: String,
        /// Its reason.
        message: String,
    },
    /// An adapter refuses a shader.
    #[error("{adapter} refuses shaders/{file}: {message}")]
    Shader {
        /// The file that the entry point is in.
        file: &'static str,
        /// The adapter.
        adapter: String,
        /// Its reason.
        message: String,
    },
    /// A buffer of an embedder's is too small.
    #[error("a buffer of {found} bytes, {needed} are needed: {what}")]
    Buffer {
        /// Its contents.
        what: String,
        /// Bytes that are needed.
        needed: u64,
        /// Bytes that it has.
        found: u64,
    },
    /// Work that was under way failed: the device is lost, or its memory exhausted.
    #[error("{adapter} failed: {message}")]
    Failed {
        /// The adapter.
        adapter: String,
        /// The message.
        message: String,
    },
}

/// The adapters there are, and how to name them.
fn offered(found: &[Adapter]) -> String {
    if found.is_empty() {
        return "no adapter, neither a GPU nor a software one; is a Vulkan driver installed?".into();
    }
    let named: Vec<String> = found.iter().map(|adapter| format!("gpu:{} {adapter}", adapter.number)).collect();
    let listed = named.join(", ");
    format!("no such adapter; a software one has to be asked for by number or name. Found: {listed}")
}

impl From<GpuError> for RasterError {
    fn from(error: GpuError) -> Self {
        let message = error.to_string();
        match error {
            GpuError::Limit { .. } => RasterError::TooMany(message),
            GpuError::Buffer { .. } => RasterError::Arguments(message),
            _ => RasterError::Device(message),
        }
    }
}
