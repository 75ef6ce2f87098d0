//! The processes of an MPI.

use crate::Ranks;
use mpi::Threading;
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, CommunicatorCollectives, Destination, Root, Source};
use std::fmt::{self, Debug, Formatter};
use std::sync::Arc;

/// Variables that launchers set for each process: Open MPI's, PMI's (MPICH, Intel MPI, Slurm) and PMIx's.
const LAUNCHED: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMI_RANK", "PMIX_RANK"];

/// The variables that hold the number of the process.
const NUMBERED: [&str; 3] = ["OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK"];

/// The processes of an MPI, until this value is dropped. A process that panics ends all.
pub struct Processes {
    world: World,
    _universe: Universe,
}

impl Debug for Processes {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.world.fmt(f)
    }
}

impl Processes {
    /// Joins the processes that were launched with this one; `None` in a process that no MPI launched, and after the
    /// first call.
    pub fn launched() -> Option<Self> {
        LAUNCHED.iter().find_map(std::env::var_os)?;
        let (universe, _) = mpi::initialize_with_threading(Threading::Serialized)?;
        let all = SimpleCommunicator::world();
        let world = World { rank: all.rank() as usize, size: all.size() as usize };
        Some(Self { world, _universe: universe })
    }

    /// True in a process that an MPI launched as another than the first, before it has joined them.
    pub fn follows() -> bool {
        let rank = NUMBERED.iter().find_map(std::env::var_os);
        rank.is_some_and(|rank| rank != "0")
    }

    /// The processes as the ranks of a session.
    pub fn ranks(&self) -> Arc<dyn Ranks> {
        Arc::new(self.world)
    }

    /// Ends all processes with an exit code.
    pub fn abort(&self, code: u8) -> ! {
        SimpleCommunicator::world().abort(code.into())
    }
}

impl Drop for Processes {
    fn drop(&mut self) {
        // The others would wait for this one.
        if std::thread::panicking() {
            self.abort(1);
        }
    }
}

/// All processes. Its methods may be called from any thread, from one at a time.
#[derive(Clone, Copy, Debug)]
struct World {
    rank: usize,
    size: usize,
}

/// The largest message, numbers: MPI counts by `i32`.
const MOST: usize = 1 << 28;

impl Ranks for World {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn send(&self, values: &[f32], to: usize) {
        let all = SimpleCommunicator::world();
        let to = all.process_at_rank(to as i32);
        values.chunks(MOST).for_each(|part| to.send(part));
    }

    fn receive(&self, values: &mut [f32], from: usize) {
        let all = SimpleCommunicator::world();
        let from = all.process_at_rank(from as i32);
        values.chunks_mut(MOST).for_each(|part| _ = from.receive_into(part));
    }

    fn broadcast(&self, values: &mut [f32]) {
        let all = SimpleCommunicator::world();
        let first = all.process_at_rank(0);
        values.chunks_mut(MOST).for_each(|part| first.broadcast_into(part));
    }

    fn gather(&self, word: u64) -> Vec<u64> {
        let mut words = vec![0; self.size];
        SimpleCommunicator::world().all_gather_into(&word, &mut words[..]);
        words
    }
}
