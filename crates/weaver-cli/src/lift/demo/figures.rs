//! The table: how right each solver is on one scene.

use super::stage::{Stage, Views, one_hot};
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec3;
use weaver_lift::metrics::{accuracy, argmax, mean_iou};
use weaver_lift::{Descent, LiftError, LiftOptions, Maps, Operator, Raster, Solver, Stop, lift};
use weaver_splat::RasterSettings;

/// What the columns of the table are; the first is a control that knows nothing of visibility.
pub const COLUMNS: [&str; 5] = ["center mean", "row-sum", "squared", "exact, 5", "exact, 30"];
/// Pixels that a class must have in a view to count.
const LEAST_PIXELS: usize = 8;

#[derive(Clone, Copy, Debug, Default)]
pub struct Figures {
    /// Splats labeled right, where drawn features of the right labels were lifted.
    pub planted: [f64; 5],
    /// The same at the least squares themselves.
    pub converged: f64,
    /// Held-out mIoU, where the ids of the ray caster were lifted.
    pub held_out: [f64; 5],
    /// Splats labeled right, where those were.
    pub splats: [f64; 5],
    pub mean_alpha: f64,
    pub off_diagonal: f64,
    /// Splats, ids, unseen splats.
    pub counts: [f64; 3],
}

impl Figures {
    pub fn of(stage: &Stage) -> Result<Self, LiftError> {
        let settings = RasterSettings::default();
        let mut training = Raster::new(stage.splats.as_slices(), &stage.training.cameras, settings);
        let mut held_out = Raster::new(stage.splats.as_slices(), &stage.held_out.cameras, settings);
        let (classes, mut figures) = (stage.classes, Self::default());
        let right = |features: &[f32]| accuracy(&argmax(features, classes), &stage.labels);

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
        figures.splats[0] = right(&of_centers);
        figures.held_out[0] = drawn_iou(&mut held_out, &of_centers, &stage.held_out, classes)?;
        for (column, solver) in (1..).zip(solvers) {
            let options = LiftOptions { least_alpha: None, ..LiftOptions::with(solver) };
            let lifted = lift(&mut training, &mut drawn, &options, &mut || ())?;
            figures.planted[column] = right(&lifted.features);
            let coverage = lifted.coverage;
            (figures.mean_alpha, figures.off_diagonal) = (coverage.mean_alpha(), coverage.off_diagonal());
            figures.counts = [stage.labels.len() as f64, (classes - 1) as f64, coverage.unseen as f64];

            let lifted = lift(&mut training, &mut ids, &LiftOptions::with(solver), &mut || ())?;
            figures.splats[column] = right(&lifted.features);
            figures.held_out[column] = drawn_iou(&mut held_out, &lifted.features, &stage.held_out, classes)?;
        }
        let solver =
            Solver::Exact { descent: Descent::ConjugateGradients, stop: Stop { passes: 60, ..Stop::default() } };
        let options = LiftOptions { least_alpha: None, ..LiftOptions::with(solver) };
        figures.converged = right(&lift(&mut training, &mut drawn, &options, &mut || ())?.features);
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
            mean_alpha: mean(&|f| f.mean_alpha),
            off_diagonal: mean(&|f| f.off_diagonal),
            counts: std::array::from_fn(|i| mean(&|f| f.counts[i])),
        }
    }
}

/// The labels that features give to the pixels of a view.
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

/// The control: the mean of the features at each splat's projected center in all views, whatever stands before it.
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

/// The pixel that a point falls on, if any.
fn pixel_of(camera: &Camera, point: DVec3) -> Option<usize> {
    let local = camera.pose.apply(point);
    let pixel = camera.intrinsics.project(local);
    let inside = |x: f64, size: usize| x >= 0.0 && x < size as f64;
    let seen = local.z > 0.0 && inside(pixel.x, camera.width) && inside(pixel.y, camera.height);
    seen.then(|| pixel.y as usize * camera.width + pixel.x as usize)
}
