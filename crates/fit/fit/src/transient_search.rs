//! The search for transients while a scene is fitted.

use crate::FitError;
use crate::fit::Fit;
use crate::transients::{
    LEAST_OTHERS, LEAST_PASSES, MOMENTS, Seen, Transients, counted, hidden, residuals, thing_residual,
};
use std::borrow::Cow;
use weaver_geometry::Camera;
use weaver_geometry::lens::LensCamera;
use weaver_kernels::parallel;
use weaver_scene::Photo;

impl Fit {
    /// The transients of a photo; `None` where nothing was found.
    pub fn transients(&self, photo: usize) -> Option<&Transients> {
        self.transients.get(photo).and_then(Option::as_ref)
    }

    /// Mask of the pixels of a photo that count: its own mask without [transients](Self::transients); `None` if all do.
    pub fn counted(&self, photo: usize) -> Option<Cow<'_, [bool]>> {
        counted(self.photo(photo), self.transients(photo))
    }

    /// Searches the photos where that is due at this step.
    pub(crate) fn search_transients(&mut self) -> Result<(), FitError> {
        let due = |part: f64| (self.since..=self.step).contains(&((part * self.settings.steps as f64).ceil() as usize));
        let passes = self.step * self.settings.views_per_step / self.photos.len();
        let young = passes < LEAST_PASSES || self.photos.len() <= LEAST_OTHERS;
        if self.settings.transients && MOMENTS.into_iter().any(due) && !young {
            self.transients = self.find_transients()?;
        }
        Ok(())
    }

    fn find_transients(&mut self) -> Result<Vec<Option<Transients>>, FitError> {
        let (photos, cameras): (Vec<_>, Vec<_>) = (0..self.photos.len()).map(|photo| self.small(photo)).unzip();
        let small = photos.iter().zip(cameras).enumerate();
        let seen = small.map(|(i, (photo, camera))| self.seen(i, photo, camera)).collect::<Result<Vec<_>, _>>()?;
        let extent = self.extent();
        let thing = thing_residual(&photos);
        let mut found = vec![None; seen.len()];
        parallel::for_chunks(&mut found, 1, |photo, found| found[0] = hidden(photo, &seen, extent, thing));
        Ok(found)
    }

    /// A small photo, taken by this camera, beside the scene.
    fn seen(&mut self, index: usize, photo: &Photo, camera: Camera) -> Result<Seen, FitError> {
        let [mut image, alpha, mut depths] = self.draw(&camera, photo.model())?;
        let residuals_of = |image: &[f32]| residuals(image, photo);
        let hidden = self.transients(index).map_or(Vec::new(), |t| t.at_size(camera.width, camera.height));
        if let Some(exposure) = self.exposure(index).copied() {
            let drawn = image.clone();
            exposure.apply(&drawn, &mut image);
        }
        depths
            .iter_mut()
            .zip(&alpha)
            .for_each(|(depth, alpha)| *depth = if *alpha < 0.5 { 0.0 } else { *depth / alpha });
        Ok(Seen { camera: LensCamera::new(camera, photo.lens), residuals: residuals_of(&image), depths, hidden })
    }
}
