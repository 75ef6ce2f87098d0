//! Messages between processes; by hand one process, under `mpirun` several.

use weaver_ranks::Processes;

/// A test process that no MPI launched gets no ranks.
#[test]
fn without_a_launcher_there_are_no_processes() {
    let launched = std::env::vars_os().any(|(name, _)| name.to_string_lossy().starts_with("OMPI_COMM"));
    assert_eq!(Processes::launched().is_some(), launched);
}
