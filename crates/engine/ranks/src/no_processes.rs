//! Stands for the processes of an MPI in a program that was built without one.

use crate::Ranks;
use std::sync::Arc;

/// The processes of an MPI: none, as the feature `mpi` is off.
#[derive(Debug)]
pub enum Processes {}

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
