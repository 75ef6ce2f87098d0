//! Steps with the rasterizer of the host, or one that keeps no Gaussians.

use crate::FitError;
use crate::cameras::{Alignment, TWIST, Views, moved};
use crate::comparison::{Buffers, Compared};
use crate::exposure;
use crate::fit::Fit;
use crate::gradients::GradientsMut;
use crate::photos::at_level;
use crate::population::Population;
use crate::strategy::Moment;
use crate::surfaces::{DrawnDepth, Facing, Surface};
use crate::transients::counted;
use std::mem::take;
use std::time::Instant;
use weaver_geometry::lens::LensCamera;
use weaver_kernels::random::Stream;
use weaver_scene::{CameraSlices, GaussianSlices, intrinsics_row, viewmat};
use weaver_splat::{Cotangents, GaussianStatistics, Gradients as RasterGradients, Images, Target};

/// Outcome of a look at a photo, beside gradients with respect to the Gaussians.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look {
    pub loss: f64,
    /// The mean squared difference.
    pub mse: f64,
    pub pairs: u64,
    /// Gradient with respect to the photo's color correction, if photos have them.
    pub exposure: Option<[f32; exposure::NUMBERS]>,
    /// Movement of the camera to where its photo fits the scene, if cameras move at this step.
    pub twist: Option<[f64; TWIST]>,
}

/// A photo, and how often it is halved.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PhotoLevel {
    pub photo: usize,
    pub level: usize,
}

impl Fit {
    /// Draws a photo's view and finds all gradients; camera and correction take their steps. Returns the loss, the mean
    /// squared difference and the pairs.
    pub(crate) fn gradients_of(
        &mut self,
        index: usize,
        level: usize,
        moment: &Moment,
    ) -> Result<(f64, f64, u64), FitError> {
        let drawn = self.activate(moment)?;
        let (mut gradients, mut statistics) = (take(&mut self.gradients), take(&mut self.statistics));
        gradients.resize(&self.population);
        let wanted = self.strategy.wants_statistics(moment).then_some(&mut statistics[..]);
        let look = self.look(PhotoLevel { photo: index, level }, drawn.as_ref(), moment, gradients.parts_mut(), wanted);
        (self.gradients, self.statistics) = (gradients, statistics);
        let look = look?;
        self.strategy.regularizer(moment, self.population.len()).add(&mut self.gradients);
        self.follow_look(index, &look, moment);
        Ok((look.loss, look.mse, look.pairs))
    }

    /// Computes the Gaussians to draw at this step: the activated form of the Gaussians, or of rounded ones, which are
    /// then returned.
    pub(crate) fn activate(&mut self, moment: &Moment) -> Result<Option<Population>, FitError> {
        let start = Instant::now();
        let rounded = match &mut self.rounding {
            Some((from, rounding)) if moment.fraction() >= *from => {
                let rounded = rounding.rounded(&self.population.to_gaussians(0));
                Some(Population::drawn(rounded.map_err(|source| FitError::Rounding { step: moment.step, source })?))
            }
            _ => None,
        };
        self.activated.update(rounded.as_ref().unwrap_or(&self.population));
        if self.settings.dropout > 0.0 {
            let part = self.settings.dropout * moment.fraction();
            self.activated.drop_part(part, Stream::new(self.settings.seed, self.step as u64, "fit.dropout"));
        }
        self.timings.forward = start.elapsed();
        (self.timings.loss, self.timings.backward) = Default::default();
        Ok(rounded)
    }

    /// Draws a photo's view at a level, writes gradients with respect to the activated Gaussians and adds to the
    /// statistics, if any are wanted. Nothing of the fit moves.
    pub(crate) fn look(
        &mut self,
        PhotoLevel { photo: index, level }: PhotoLevel,
        drawn: Option<&Population>,
        moment: &Moment,
        to: GradientsMut<'_>,
        statistics: Option<&mut [GaussianStatistics<f32>]>,
    ) -> Result<Look, FitError> {
        let start = Instant::now();
        let camera = self.camera(index);
        let (photo, level) = self.photos[index].level(level);
        let camera = at_level(&camera, level);
        let (height, width) = (camera.height, camera.width);
        let viewmats = viewmat(&camera.pose);
        let intrinsics = intrinsics_row(&camera);
        let background = &self.settings.background;
        let cameras = CameraSlices {
            viewmats: &viewmats,
            intrinsics: &intrinsics,
            background,
            width,
            height,
            model: photo.model(),
        };
        let raster = self.raster;
        let buffers = &mut self.buffers;
        buffers.resize(height * width);
        let population = drawn.unwrap_or(&self.population);
        let gaussians = self.activated.slices(population);
        let rate = self.settings.poses.rate_at(moment.fraction());
        let (surfaces, known) = (&mut self.surfaces, self.depths[index].as_ref());
        let has_surface = surfaces.begin(&self.settings.surfaces, moment.fraction(), known.is_some(), photo);
        let depth = (rate > 0.0 || has_surface).then_some(&mut buffers.depth[..]);
        let facing = Facing::new(population, gaussians.scales, &camera);
        let (normals, picture) = surfaces.drawn_normals(&facing, [height, width]);
        let with_normals = GaussianSlices { features: normals, ..gaussians };
        let images = Images { image: &mut buffers.image, alpha: &mut buffers.alpha, depth, features: picture };
        let stats = self.session.forward(&with_normals, &cameras, &raster, images)?;
        self.timings.forward += start.elapsed();

        let start = Instant::now();
        let mask = counted(photo, self.transients[index].as_ref());
        let seen = Compared { rgb: &photo.rgb, mask: mask.as_deref(), size: [height, width] };
        let (mut loss, mse, exposure) = buffers.compare(&seen, self.exposures.get(index), self.settings.ssim_weight);
        if has_surface {
            let drawn = DrawnDepth { depth: &buffers.depth, alpha: &buffers.alpha, camera: &camera };
            loss += surfaces.compare(&drawn, known, self.settings.surfaces.off);
        }
        if !loss.is_finite() {
            return Err(self.diverged(loss, index, moment));
        }
        self.timings.loss += start.elapsed();

        let start = Instant::now();
        let GradientsMut { means, quats, scales, opacities, sh } = to;
        let Surface { normals, of_normals, of_picture, of_depth, of_alpha } = surfaces.surface();
        let targets = RasterGradients {
            means: Some(Target::write(means)),
            quats: Some(Target::write(&mut *quats)),
            scales: Some(Target::write(scales)),
            opacities: Some(Target::write(opacities)),
            colors: Some(Target::write(sh)),
            features: of_normals.map(Target::write),
            statistics,
            ..RasterGradients::default()
        };
        let cotangents =
            Cotangents { image: Some(&buffers.gradient), alpha: of_alpha, depth: of_depth, features: of_picture };
        let with_normals = GaussianSlices { features: normals, ..gaussians };
        self.session.backward(&with_normals, &cameras, &raster, &cotangents, targets)?;
        surfaces.pull_back(&facing, quats);
        let twist = (rate > 0.0).then(|| {
            let Buffers { target, image, corrected, alpha, depth, .. } = &self.buffers;
            let image = if self.exposures.is_empty() { image } else { corrected };
            let mask = mask.as_deref();
            let camera = LensCamera::new(camera, photo.lens);
            Alignment::new(&camera, &Views { image, alpha, depth, photo: target, mask }).twist()
        });
        self.timings.backward += start.elapsed();
        Ok(Look { loss, mse, pairs: stats.pairs, exposure, twist: twist.flatten() })
    }

    /// Takes the steps of a photo's camera and color correction.
    pub(crate) fn follow_look(&mut self, index: usize, look: &Look, moment: &Moment) {
        if let (Some(exposure), Some(gradient)) = (self.exposures.get_mut(index), &look.exposure) {
            let rates = &self.settings.rates;
            exposure.descend(gradient, [rates.exposure, rates.exposure_rest].map(|rate| rate as f32));
        }
        if let Some(twist) = look.twist {
            let rate = self.settings.poses.rate_at(moment.fraction());
            self.poses[index] = moved(&self.poses[index], twist, rate);
        }
    }
}
