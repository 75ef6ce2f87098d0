//! `splatweaver bench`: speed of the main parts on this machine, beside the machine's own peak.

mod draws;
mod dump;
mod engine;
mod fit;
pub(crate) mod memory;
mod mixture;
mod processor;
mod raster;
mod workload;

use crate::Console;
use crate::arguments::{Bench, Subject};
use crate::failure::Failure;
use crate::in_pool;

pub fn run(arguments: &Bench, console: &mut Console) -> Result<(), Failure> {
    match &arguments.subject {
        Subject::Engine(engine) => in_pool(engine.threads.count(), || engine::run(engine, console)),
        Subject::Fit(fit) => in_pool(fit.threads.count(), || fit::run(fit, console)),
        Subject::Mixture(mixture) => in_pool(mixture.threads.count(), || mixture::run(mixture, console)),
        Subject::Raster(raster) => in_pool(raster.threads.count(), || raster::run(raster, console)),
    }
}

/// The median of some numbers; NaN for an empty list.
fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let (low, high) = (values.len().saturating_sub(1) / 2, values.len() / 2);
    match values.get(low..=high) {
        Some(middle) => middle.iter().sum::<f64>() / middle.len() as f64,
        None => f64::NAN,
    }
}

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
