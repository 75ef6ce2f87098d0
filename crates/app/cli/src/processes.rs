//! The processes that work together, where `mpirun` or `srun` started several.

#[cfg(feature = "mpi")]
pub use weaver_ranks::Processes;

use std::sync::Arc;
use weaver_command::{Console, Failure};
use weaver_ranks::Ranks;

/// Stands for the processes of an MPI in a program that was built without one.
#[cfg(not(feature = "mpi"))]
#[derive(Debug)]
pub enum Processes {}

#[cfg(not(feature = "mpi"))]
impl Processes {
    /// No processes; several that were launched would each begin the same run.
    pub fn launched() -> Option<Self> {
        None
    }

    /// Never true.
    pub fn follows() -> bool {
        false
    }

    /// Never called: there are no processes.
    pub fn ranks(&self) -> Arc<dyn Ranks> {
        match *self {}
    }

    /// Never called, as [`ranks`](Self::ranks).
    pub fn abort(&self, _: u8) -> ! {
        match *self {}
    }
}

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

/// A line about the traffic between processes: the megabytes of a step, and the bandwidth above which two processes
/// gain. A step has `parts` parts of `seconds` each; one part is taken for two.
pub fn network(bytes: u64, parts: usize, seconds: f64) -> String {
    let parts = parts.max(2);
    let saved = (parts - parts.div_ceil(2)) as f64 * seconds;
    let [each, least] = [bytes as f64, 2.0 * bytes as f64 / saved].map(|bytes| bytes / 1e6);
    format!("{:<28}{each:>9.1} MB a step, each way; two gain above {least:.0} MB/s", "between processes")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_pays_where_it_takes_less_than_it_saves() {
        // 10 MB and back take 0.2 s at 100 MB/s; of four parts, two of 0.1 s are saved.
        assert!(network(10_000_000, 4, 0.1).ends_with("10.0 MB a step, each way; two gain above 100 MB/s"));
        // Of three parts, one is saved; one part alone is compared with two.
        assert!(network(10_000_000, 3, 0.1).ends_with("above 200 MB/s"));
        assert_eq!(network(10_000_000, 1, 0.1), network(10_000_000, 2, 0.1));
    }
}
