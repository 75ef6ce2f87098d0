//! `splatweaver bench`: speed of the main parts on this machine, beside the machine's own peak.

mod arguments;
mod draws;
mod dump;
mod engine;
mod fit;
mod mixture;
mod processor;
mod raster;
#[cfg(feature = "lidar")]
mod surfels;
mod workload;

pub use arguments::Bench;

use arguments::Subject;
use weaver_command::{Console, Failure, Interrupt, in_pool};
use weaver_kernels::order::median_mean;

/// Runs a benchmark and prints its figures, as a table or as JSON. A benchmark with a run folder saves when it is
/// interrupted.
///
/// Fails on an unreadable workload or capture, on a missing device, and on figures that cannot be written.
#[cfg_attr(
    not(feature = "compression"),
    expect(unused_variables, reason = "comparisons of methods alone keep a folder")
)]
pub fn run(arguments: &Bench, console: &mut Console, interrupt: &Interrupt) -> Result<(), Failure> {
    match &arguments.subject {
        #[cfg(feature = "compression")]
        Subject::Compress(scenes) => weaver_compression::command::run(scenes, console, interrupt),
        Subject::Engine(engine) => in_pool(engine.threads.count(), || engine::run(engine, console)),
        Subject::Fit(fit) => in_pool(fit.threads.count(), || fit::run(fit, console)),
        Subject::Mixture(mixture) => in_pool(mixture.threads.count(), || mixture::run(mixture, console)),
        Subject::Raster(raster) => in_pool(raster.threads.count(), || raster::run(raster, console)),
        #[cfg(feature = "lidar")]
        Subject::Surfels(surfels) => in_pool(surfels.threads.count(), || surfels::run(surfels, console)),
    }
}

/// The median of some numbers; NaN for an empty list.
fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    median_mean(&mut values.into_iter().collect::<Vec<_>>()).unwrap_or(f64::NAN)
}

/// The example of the README, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
mod tests {
    use super::median;

    #[test]
    fn the_middle_is_not_moved_by_one_slow_run() {
        assert_eq!(median([3.0, 1.0, 1000.0]), 3.0);
        assert_eq!(median([4.0, 1.0, 2.0, 1000.0]), 3.0);
        assert_eq!(median([2.0]), 2.0);
        assert!(median([]).is_nan());
    }
}
