//! The processes that train together, where `mpirun` or `srun` started several.

#[cfg(feature = "mpi")]
pub use weaver_mpi::Processes;

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

    /// Of no process.
    pub fn ranks(&self) -> std::sync::Arc<dyn weaver_trainer::Ranks> {
        match *self {}
    }

    /// Ends no process.
    pub fn abort(&self, _: u8) -> ! {
        match *self {}
    }
}
