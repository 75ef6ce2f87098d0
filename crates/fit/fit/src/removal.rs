//! Gaussians that are not worth their bits.

use crate::FitError;
use crate::fit::Fit;
use crate::strategy::Moment;
use weaver_geometry::Camera;
use weaver_scene::{ActivatedGaussians, CameraRows, CameraSlices, Model};
use weaver_splat::{Compared, Images, RasterError, Workspace, rasterize};

/// Longest side of the pictures, pixels.
const LONG_SIDE: usize = 400;
/// Pictures at most.
const PICTURES: usize = 64;
/// Rounds of removal, and the part of the Gaussians that each takes at most: where some hide others that look like
/// them, the cost of each alone says nothing of the cost of all.
const ROUNDS: usize = 5;
const MOST: f64 = 0.1;

/// Pictures of scenes as the photos are taken.
struct Drawing<'a> {
    fit: &'a Fit,
    workspace: Workspace<f32>,
}

impl Drawing<'_> {
    fn cameras(&self) -> impl Iterator<Item = (Camera, Model)> + use<'_> {
        let photos = self.fit.photos();
        let of = |photo| (self.fit.camera(photo).shrunk(LONG_SIDE), self.fit.photo(photo).model());
        (0..photos).step_by(photos.div_ceil(PICTURES)).map(of)
    }

    fn draw(&mut self, scene: &ActivatedGaussians, (camera, model): (Camera, Model)) -> Result<Vec<f32>, RasterError> {
        let pixels = camera.width * camera.height;
        let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
        let rows = CameraRows::new(&[camera]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let cameras = CameraSlices { model, ..rows.as_slices(&self.fit.settings.background) };
        rasterize(&scene.as_slices(), &cameras, &self.fit.raster, &mut self.workspace, images)?;
        Ok(image)
    }
}

impl Fit {
    /// Cost of removing each Gaussian alone, `[N]`: the sum over pixels and channels of squared changes of the pictures
    /// of up to 64 photos, whose longest side is at most 400 pixels.
    ///
    /// A pixel shows `C = Σ w_i c_i` over the background. Without Gaussian i it changes by `w_i (c_i - B_i)`, with
    /// `B_i` the color of everything behind.
    ///
    /// # Errors
    /// When the rasterizer refuses.
    pub fn removal_costs(&self) -> Result<Vec<f64>, FitError> {
        let scene = self.gaussians().to_activated();
        let mut costs = vec![0.0; scene.opacities.len()];
        let [mut rises, mut shown] = [0, 1].map(|_| vec![0.0; costs.len()]);
        let mut drawing = self.drawing();
        let map = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        for camera in drawing.cameras().collect::<Vec<_>>() {
            let image = drawing.draw(&scene, camera)?;
            let (error, counts) = (vec![0.0; image.len()], vec![1.0; image.len() / 3]);
            let compared = Compared { image: &image, error: &error, counts: &counts, map };
            drawing.workspace.removal(&compared, &mut rises, &mut shown)?;
            costs.iter_mut().zip(&rises).for_each(|(cost, rise)| *cost += f64::from(*rise));
        }
        Ok(costs)
    }

    fn drawing(&self) -> Drawing<'_> {
        Drawing { fit: self, workspace: Workspace::new() }
    }

    /// Removes Gaussians that are not [worth](crate::Rounding::worth) their bits, if a round of that is due.
    pub(crate) fn remove_worthless(&mut self, moment: &Moment) -> Result<(), FitError> {
        let step = moment.step;
        let due = self.rounding.as_mut().filter(|(from, _)| is_due(*from, moment));
        let Some((_, rounding)) = due.filter(|(_, rounding)| rounding.worth() > 0.0) else { return Ok(()) };
        let worth = rounding.worth();
        let rounded = rounding.rounded(&self.population.to_gaussians(0));
        let rounded = rounded.map_err(|source| FitError::Rounding { step, source })?.to_activated();
        let scene = self.population.to_gaussians(0).to_activated();
        let mut drawing = self.drawing();
        let cameras = drawing.cameras().collect::<Vec<_>>();
        let mut error = 0.0;
        for camera in cameras {
            let (before, after) = (drawing.draw(&scene, camera)?, drawing.draw(&rounded, camera)?);
            error += before.iter().zip(&after).map(|(x, y)| f64::from(x - y).powi(2)).sum::<f64>();
        }
        let costs = self.removal_costs()?;
        let count = costs.len();
        let least = worth * error / costs.len() as f64;
        let mut order: Vec<usize> = (0..count).filter(|i| costs[*i] < least).collect();
        order.sort_unstable_by(|a, b| costs[*a].total_cmp(&costs[*b]).then(a.cmp(b)));
        let mut keep = vec![true; count];
        order.into_iter().take((MOST * count as f64) as usize).for_each(|i| keep[i] = false);
        self.population.retain(&keep);
        self.statistics.clear();
        self.statistics.resize(self.population.len(), Default::default());
        Ok(())
    }
}

/// True if a round is due at a moment: in the first half of the steps from a part of the run on, evenly spread.
fn is_due(from: f64, moment: &Moment) -> bool {
    let begin = (from * moment.steps as f64).ceil() as usize;
    let every = (moment.steps.saturating_sub(begin) / 2 / ROUNDS).max(1);
    let last = |at: usize| begin + (at / every).min(ROUNDS - 1) * every;
    moment.step.checked_sub(begin).is_some_and(|at| last(at) >= moment.since)
}
