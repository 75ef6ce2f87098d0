//! Inputs that cannot be lifted are refused with a message.

use crate::random::{Splats, cameras};
use std::ops::Range;
use weaver_lift::{Dense, LiftError, LiftOptions, Maps, Observations, Operator, Raster, Solver, Stop, lift, scores};
use weaver_splat::RasterSettings;

/// One number per pixel, some of them masked.
struct Masked {
    values: Vec<f64>,
    factors: Vec<f64>,
}

impl Observations<f64> for Masked {
    fn channels(&self) -> usize {
        1
    }
    fn factors(&mut self, _view: usize, factors: &mut [f64]) -> Result<(), LiftError> {
        factors.copy_from_slice(&self.factors);
        Ok(())
    }
    fn read(&mut self, _view: usize, _channels: Range<usize>, out: &mut [f64]) -> Result<(), LiftError> {
        out.copy_from_slice(&self.values);
        Ok(())
    }
}

fn dense() -> Dense<f64> {
    Dense::new(vec![0.5, 0.5, 0.0, 0.0, 1.0, 0.0, 0.2, 0.3, 0.0], 3, 1).unwrap()
}

fn message<R: std::fmt::Debug>(result: Result<R, LiftError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn pixels_that_do_not_count_may_hold_anything() {
    let with = |value, solver| {
        let mut masked = Masked { values: vec![1.0, value, 3.0], factors: vec![1.0, 0.0, 2.0] };
        lift(&mut dense(), &mut masked, &LiftOptions { loss: true, ..LiftOptions::with(solver) }, &mut || ()).unwrap()
    };
    for solver in [Solver::RowSum, Solver::Squared, Solver::exact(3), Solver::Damped { mu: 0.1, stop: Stop::default() }]
    {
        let found = with(f64::NAN, solver);
        assert_eq!(found, with(7.0, solver));
        assert!(found.features.iter().all(|x| x.is_finite()) && found.loss.unwrap().is_finite());
        assert_eq!((found.coverage.masked, found.coverage.unseen), (1, 1));
        // The third Gaussian is in no row.
        assert_eq!((found.features[2], found.seen[2]), (0.0, 0.0));
    }
    // Factors are part of the features.
    assert!((with(0.0, Solver::RowSum).features[0] - (0.5 * 1.0 + 0.2 * 6.0) / 0.7).abs() < 1e-12);
}

#[test]
fn what_has_no_answer_is_refused() {
    let options = LiftOptions::default();
    let mut masked = Masked { values: vec![1.0; 3], factors: vec![0.0; 3] };
    let text = message(lift(&mut dense(), &mut masked, &options, &mut || ()));
    assert!(text.contains("all 3 masked"), "{text}");
    let mut none = Maps { views: vec![vec![]], channels: 0 };
    assert!(matches!(lift(&mut dense(), &mut none, &options, &mut || ()), Err(LiftError::NoChannels)));
    let mut short = Maps { views: vec![vec![1.0; 5]], channels: 2 };
    let text = message(lift(&mut dense(), &mut short, &options, &mut || ()));
    assert!(text.contains("expected 6 numbers, found 5"), "{text}");
    assert!(Dense::new(vec![1.0; 7], 3, 1).is_err());

    // Behind all cameras.
    let mut splats = Splats::<f64>::random(1, 5);
    splats.means.iter_mut().for_each(|x| *x -= 100.0);
    let cameras = cameras(2);
    let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
    let mut maps = Maps { views: (0..2).map(|v| vec![1.0; raster.rays(v)]).collect(), channels: 1 };
    let text = message(lift(&mut raster, &mut maps, &options, &mut || ()));
    assert!(text.contains("found none that do") && text.contains('5'), "{text}");
    assert!(raster.forward(0, &[1.0], 1, &mut []).is_err());
}

#[test]
fn settings_have_a_range() {
    let refused = |solver| {
        let mut maps = Maps { views: vec![vec![1.0; 3]], channels: 1 };
        message(lift(&mut dense(), &mut maps, &LiftOptions::with(solver), &mut || ()))
    };
    assert!(refused(Solver::exact(0)).contains("passes: expected at least 1, found 0"));
    for mu in [-1.0, f64::NAN, f64::INFINITY] {
        assert!(refused(Solver::Damped { mu, stop: Stop::default() }).contains("mu: expected"));
    }
    let stop = Stop { tolerance: f64::NAN, ..Stop::default() };
    assert!(refused(Solver::Damped { mu: 1.0, stop }).contains("tolerance"));
    assert!(scores(&[1.0; 5], &[1.0; 2], 2).is_err() && scores(&[1.0; 4], &[1.0; 3], 2).is_err());
    assert!(scores::<f32>(&[], &[], 0).is_err());
}

/// The number of visited views equals the announced work.
#[test]
fn work_is_what_was_said() {
    let mut maps = Maps { views: vec![vec![1.0; 9], vec![2.0; 9]], channels: 3 };
    let mut operator = Dense::new([0.3, 0.7, 0.5, 0.1, 0.9, 0.05].repeat(2), 2, 2).unwrap();
    for solver in [Solver::RowSum, Solver::Squared, Solver::exact(4)] {
        let stop = Stop { passes: 4, tolerance: 0.0 };
        let solver = if solver == Solver::exact(4) { Solver::Damped { mu: 0.0, stop } } else { solver };
        let options = LiftOptions { block: 2, loss: true, ..LiftOptions::with(solver) };
        let mut views = 0;
        lift(&mut operator, &mut maps, &options, &mut || views += 1).unwrap();
        assert_eq!(views, options.work(2, 3), "{solver:?}");
    }
}
