//! The table: accuracy of each solver on one scene.

use super::gaussians::pixel_of;
use super::stage::{Stage, Views, one_hot};
use crate::metrics::{accuracy, argmax, mean_iou};
use crate::{Descent, LiftError, LiftOptions, Maps, Operator, Raster, Solver, Stop, guide, lift};
use std::time::Instant;
use weaver_geometry::glam::DVec3;

/// Titles of the table's columns; the first is a control without visibility.
pub const COLUMNS: [&str; 5] = ["center mean", "row-sum", "squared", "exact, 5", "exact, 30"];
/// As published.
pub const LAMBDA: f64 = 1.2;
/// Least number of a class's pixels in a view for its IoU.
const LEAST_PIXELS: usize = 8;

#[derive(Clone, Copy, Debug, Default)]
pub struct Figures {
    /// Share of correctly labeled splats after lifting drawn features of the true labels.
    pub planted: [f64; 5],
    /// As [`planted`](Self::planted), at the least squares themselves.
    pub converged: f64,
    /// Held-out mIoU after lifting the ids of the ray caster.
    pub held_out: [f64; 5],
    /// Share of correctly labeled splats after lifting the ids of the ray caster, and their mIoU.
    pub splats: [f64; 5],
    pub splats_iou: [f64; 5],
    /// |A X - B|^2 / |B|^2 of the lifted ids; none of the control.
    pub loss: [f64; 5],
    /// Milliseconds of lifting the ids, for each view and channel.
    pub milliseconds: [f64; 5],
    /// With opacities guided by [`LAMBDA`]: mean alpha, share off the diagonal, held-out mIoU of row-sum.
    pub guided: [f64; 3],
    pub mean_alpha: f64,
    pub off_diagonal: f64,
    /// Splats, ids, unseen splats.
    pub counts: [f64; 3],
}

impl Figures {
    pub fn of(stage: &Stage, least_alpha: f64) -> Result<Self, LiftError> {
        let settings = stage.settings;
        let mut training = Raster::new(stage.splats.as_slices(), &stage.training.cameras, settings);
        let mut held_out = Raster::new(stage.splats.as_slices(), &stage.held_out.cameras, settings);
        let (classes, mut figures) = (stage.classes, Self::default());
        let right = |features: &[f32]| accuracy(&argmax(features, classes), &stage.labels);
        let iou = |features: &[f32]| mean_iou(&argmax(features, classes), &stage.labels, 1).unwrap_or(0.0);

        let planted = one_hot(&stage.labels, classes);
        let mut drawn = Maps { views: Vec::new(), channels: classes };
        for view in 0..training.views() {
            let mut image = vec![0.0; training.rays(view) * classes];
            training.forward(view, &planted, classes, &mut image)?;
            drawn.views.push(image);
        }
        let mut ids = stage.one_hot();
        let solvers = [Solver::RowSum, Solver::Squared, Solver::exact(5), Solver::exact(30)];
        figures.planted[0] = right(&center_mean(stage, &drawn));
        let of_centers = center_mean(stage, &ids);
        (figures.splats[0], figures.splats_iou[0]) = (right(&of_centers), iou(&of_centers));
        figures.loss[0] = f64::NAN;
        figures.milliseconds[0] = f64::NAN;
        figures.held_out[0] = drawn_iou(&mut held_out, &of_centers, &stage.held_out, classes)?;
        for (column, solver) in (1..).zip(solvers) {
            let options = LiftOptions { least_alpha: None, ..LiftOptions::with(solver) };
            let lifted = lift(&mut training, &mut drawn, &options, &mut || ())?;
            figures.planted[column] = right(&lifted.features);
            let coverage = lifted.coverage;
            (figures.mean_alpha, figures.off_diagonal) = (coverage.mean_alpha(), coverage.off_diagonal());
            figures.counts = [stage.labels.len() as f64, (classes - 1) as f64, coverage.unseen as f64];

            let start = Instant::now();
            let options = LiftOptions { least_alpha: Some(least_alpha), ..LiftOptions::with(solver) };
            let lifted = lift(&mut training, &mut ids, &options, &mut || ())?;
            let per = (training.views() * classes) as f64;
            figures.milliseconds[column] = 1e3 * start.elapsed().as_secs_f64() / per;
            (figures.splats[column], figures.splats_iou[column]) = (right(&lifted.features), iou(&lifted.features));
            let with_loss = LiftOptions { loss: true, ..options };
            figures.loss[column] = lift(&mut training, &mut ids, &with_loss, &mut || ())?.loss.unwrap_or(f64::NAN);
            figures.held_out[column] = drawn_iou(&mut held_out, &lifted.features, &stage.held_out, classes)?;
        }
        let solver =
            Solver::Exact { descent: Descent::ConjugateGradients, stop: Stop { passes: 60, ..Stop::default() } };
        let options = LiftOptions { least_alpha: None, ..LiftOptions::with(solver) };
        figures.converged = right(&lift(&mut training, &mut drawn, &options, &mut || ())?.features);
        let mut splats = stage.splats.clone();
        guide(&mut splats.opacities, LAMBDA)?;
        let mut training = Raster::new(splats.as_slices(), &stage.training.cameras, settings);
        let mut held_out = Raster::new(splats.as_slices(), &stage.held_out.cameras, settings);
        let lifted = lift(&mut training, &mut ids, &LiftOptions::with(Solver::RowSum), &mut || ())?;
        let held_out = drawn_iou(&mut held_out, &lifted.features, &stage.held_out, classes)?;
        figures.guided = [lifted.coverage.mean_alpha(), lifted.coverage.off_diagonal(), held_out];
        Ok(figures)
    }

    /// Means over scenes.
    pub fn mean(all: &[&Self]) -> Self {
        let mean = |of: &dyn Fn(&Self) -> f64| all.iter().map(|f| of(f)).sum::<f64>() / all.len().max(1) as f64;
        Self {
            planted: std::array::from_fn(|i| mean(&|f| f.planted[i])),
            converged: mean(&|f| f.converged),
            held_out: std::array::from_fn(|i| mean(&|f| f.held_out[i])),
            splats: std::array::from_fn(|i| mean(&|f| f.splats[i])),
            splats_iou: std::array::from_fn(|i| mean(&|f| f.splats_iou[i])),
            loss: std::array::from_fn(|i| mean(&|f| f.loss[i])),
            milliseconds: std::array::from_fn(|i| mean(&|f| f.milliseconds[i])),
            guided: std::array::from_fn(|i| mean(&|f| f.guided[i])),
            mean_alpha: mean(&|f| f.mean_alpha),
            off_diagonal: mean(&|f| f.off_diagonal),
            counts: std::array::from_fn(|i| mean(&|f| f.counts[i])),
        }
    }
}

/// The labels of a view's pixels by features of Gaussians.
pub fn drawn_labels(
    raster: &mut Raster<'_, f32>,
    features: &[f32],
    view: usize,
    classes: usize,
) -> Result<Vec<u32>, LiftError> {
    let mut image = vec![0.0; raster.rays(view) * classes];
    raster.forward(view, features, classes, &mut image)?;
    Ok(argmax(&image, classes))
}

fn drawn_iou(raster: &mut Raster<'_, f32>, features: &[f32], views: &Views, classes: usize) -> Result<f64, LiftError> {
    let mut ious = Vec::new();
    for (view, truth) in views.ids.iter().enumerate() {
        ious.extend(mean_iou(&drawn_labels(raster, features, view, classes)?, truth, LEAST_PIXELS));
    }
    Ok(ious.iter().sum::<f64>() / ious.len().max(1) as f64)
}

/// The control: the mean of the features at each splat's projected center in all views, regardless of occlusion.
fn center_mean(stage: &Stage, maps: &Maps<f32>) -> Vec<f32> {
    let channels = maps.channels;
    let mut features = vec![0.0; stage.labels.len() * channels];
    for (mean, row) in stage.splats.means.as_chunks().0.iter().zip(features.chunks_exact_mut(channels)) {
        let seen = stage.training.cameras.iter().zip(&maps.views).filter_map(|(camera, map)| {
            Some(&map[pixel_of(camera, DVec3::from(mean.map(f64::from)))? * channels..][..channels])
        });
        for feature in seen {
            row.iter_mut().zip(feature).for_each(|(sum, x)| *sum += x);
        }
    }
    features
}
