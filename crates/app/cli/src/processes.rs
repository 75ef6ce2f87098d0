//! The processes that work together, where `mpirun` or `srun` started several.

use std::sync::Arc;
use weaver_command::{Console, Failure};
use weaver_ranks::{Processes, Ranks, least_bandwidth};

/// Calls `run` alone or with the other processes; a failure of one ends all.
pub fn together(
    console: &mut Console,
    run: impl FnOnce(Option<&Arc<dyn Ranks>>, &mut Console) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let processes = Processes::launched();
    let ranks = processes.as_ref().map(Processes::ranks);
    let done = run(ranks.as_ref(), console);
    if let (Some(processes), Some(ranks), Err(failure)) = (&processes, &ranks, &done) {
        // The others would wait for this one.
        let line = failure.line().unwrap_or_default();
        console.note(&format!("error: process {} of {}: {line}", ranks.rank(), ranks.size()));
        processes.abort(failure.exit_code());
    }
    done
}

/// A line about the traffic between processes: the megabytes of a step, and the [`least_bandwidth`].
pub fn network(bytes: u64, parts: usize, seconds: f64) -> String {
    let [each, least] = [bytes as f64, least_bandwidth(bytes, parts, seconds)].map(|bytes| bytes / 1e6);
    format!("{:<28}{each:>9.1} MB a step, each way; two gain above {least:.0} MB/s", "between processes")
}
