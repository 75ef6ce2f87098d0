//! The threads that everything is computed on.

use crate::failed::Failed;
use crate::failure_kind::FailureKind;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Arc, Mutex, PoisonError};
use weaver_command::{cores, pool_size};

/// The pool in use. A process that was forked has none of its parent's threads, and makes a pool of its own.
static POOL: Mutex<Pool> = Mutex::new(Pool { wanted: None, running: None });

struct Pool {
    /// The number of threads that was set; `None` is one per core.
    wanted: Option<usize>,
    /// The process, and its pool.
    running: Option<(u32, Arc<ThreadPool>)>,
}

/// The most threads that the command line takes.
const MOST: usize = weaver_command::MOST_THREADS as usize;

/// Sets the number of threads; None is one per core, and more than eight per core are not used. Results do not depend
/// on it.
#[pyfunction]
#[pyo3(signature = (count))]
pub fn set_threads(count: Option<usize>) -> Result<(), Failed> {
    if count.is_some_and(|count| !(1..=MOST).contains(&count)) {
        return Err(Failed::input(format!(
            "threads: expected 1 to {MOST}, or None for one per core, found {}",
            count.unwrap_or(0)
        )));
    }
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    pool.wanted = count;
    discard(pool.running.take());
    Ok(())
}

/// The number of threads that was set; None is one per core.
#[pyfunction]
pub fn threads() -> Option<usize> {
    POOL.lock().unwrap_or_else(PoisonError::into_inner).wanted
}

/// Leaves a pool. One of the parent process has no threads that could end it.
fn discard(running: Option<(u32, Arc<ThreadPool>)>) {
    if let Some((process, pool)) = running
        && process != std::process::id()
    {
        std::mem::forget(pool);
    }
}

/// Runs `job` on the pool, with the lock of the interpreter released.
pub fn compute<R: Send>(py: Python<'_>, job: impl FnOnce() -> Result<R, Failed> + Send) -> Result<R, Failed> {
    py.detach(|| on_pool(job))
}

/// Runs `job` on the pool, from a thread that does not have the lock of the interpreter.
pub fn on_pool<R: Send>(job: impl FnOnce() -> Result<R, Failed> + Send) -> Result<R, Failed> {
    current()?.install(job)
}

fn current() -> Result<Arc<ThreadPool>, Failed> {
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((of, running)) = &pool.running
        && *of == process
    {
        return Ok(running.clone());
    }
    discard(pool.running.take());
    let made = ThreadPoolBuilder::new().num_threads(pool.wanted.map_or(0, |wanted| pool_size(wanted, cores()))).build();
    let made = Arc::new(made.map_err(|error| Failed::new(FailureKind::Other, format!("threads: {error}")))?);
    pool.running = Some((process, made.clone()));
    Ok(made)
}
