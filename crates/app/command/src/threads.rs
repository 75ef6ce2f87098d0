//! Threads of a command.

use crate::Failure;

/// Runs `job` where parallel loops use `threads` threads, or one per core.
///
/// Fails where the system refuses the threads, and where the job does.
pub fn in_pool<R: Send>(threads: Option<usize>, job: impl FnOnce() -> Result<R, Failure> + Send) -> Result<R, Failure> {
    rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build()?.install(job)
}
