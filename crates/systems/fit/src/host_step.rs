//! Steps with the rasterizer of the host, or one that keeps no Gaussians.

use crate::FitError;
use crate::cameras::{Alignment, Views, moved};
use crate::comparison::{Buffers, Compared};
use crate::fit::Fit;
use crate::gradients::Gradients;
use crate::photos::at_level;
use crate::population::Population;
use crate::strategy::Moment;
use crate::transients::counted;
use std::time::Instant;
use weaver_kernels::random::Stream;
use weaver_scene::{CameraSlices, Model, intrinsics_row, viewmat};
use weaver_splat::{Cotangents, Gradients as RasterGradients, Images, Target};

impl Fit {
    /// Draws a photo's view and finds all gradients; camera and correction take their steps. Returns the loss, the mean
    /// squared difference and the pairs.
    pub(crate) fn gradients_of(
        &mut self,
        index: usize,
        level: usize,
        moment: &Moment,
    ) -> Result<(f64, f64, u64), FitError> {
        let start = Instant::now();
        let camera = self.camera(index);
        let (photo, level) = self.photos[index].level(level);
        let camera = at_level(&camera, level);
        let (height, width) = (camera.height, camera.width);
        let (viewmats, intrinsics) = (viewmat(&camera.pose), intrinsics_row(&camera));
        let background = &self.settings.background;
        let cameras = CameraSlices {
            viewmats: &viewmats,
            intrinsics: &intrinsics,
            background,
            width,
            height,
            model: Model::Pinhole,
        };
        let raster = self.raster;
        let buffers = &mut self.buffers;
        buffers.resize(height * width);
        let rounded = match &mut self.rounding {
            Some((from, rounding)) if moment.fraction() >= *from => {
                let rounded = rounding.rounded(&self.population.to_gaussians(0));
                Some(Population::drawn(rounded.map_err(|source| FitError::Rounding { step: moment.step, source })?))
            }
            _ => None,
        };
        let drawn = rounded.as_ref().unwrap_or(&self.population);
        self.activated.update(drawn);
        if self.settings.dropout > 0.0 {
            let part = self.settings.dropout * moment.fraction();
            self.activated.drop_part(part, Stream::new(self.settings.seed, self.step as u64, "fit.dropout"));
        }
        let gaussians = self.activated.slices(drawn);
        let rate = self.settings.poses.rate_at(moment.fraction());
        let depth = (rate > 0.0).then_some(&mut buffers.depth[..]);
        let images = Images { image: &mut buffers.image, alpha: &mut buffers.alpha, depth, features: None };
        let stats = self.session.forward(&gaussians, &cameras, &raster, images)?;
        self.timings.forward = start.elapsed();

        let start = Instant::now();
        let exposure = self.exposures.get_mut(index);
        let mask = counted(photo, self.transients[index].as_ref());
        let seen = Compared { rgb: &photo.rgb, mask: mask.as_deref(), size: [height, width] };
        let (loss, mse) = buffers.compare(&seen, exposure, &self.settings, self.objective.as_mut());
        if !loss.is_finite() {
            return Err(self.diverged(loss, index, moment));
        }
        self.timings.loss = start.elapsed();

        let start = Instant::now();
        self.gradients.resize(&self.population);
        let Gradients { means, quats, scales, opacities, sh } = &mut self.gradients;
        let statistics = self.strategy.wants_statistics(moment).then_some(&mut self.statistics[..]);
        let targets = RasterGradients {
            means: Some(Target::write(means)),
            quats: Some(Target::write(quats)),
            scales: Some(Target::write(scales)),
            opacities: Some(Target::write(opacities)),
            colors: Some(Target::write(sh)),
            statistics,
            ..RasterGradients::default()
        };
        let cotangents = Cotangents { image: Some(&buffers.gradient), ..Cotangents::default() };
        self.session.backward(&gaussians, &cameras, &raster, &cotangents, targets)?;
        self.strategy.regularizer(moment, self.population.len()).add(&mut self.gradients);
        if rate > 0.0 {
            let Buffers { target, image, corrected, alpha, depth, .. } = &self.buffers;
            let image = if self.exposures.is_empty() { image } else { corrected };
            let mask = mask.as_deref();
            let alignment = Alignment::new(&camera, &Views { image, alpha, depth, photo: target, mask });
            if let Some(twist) = alignment.twist() {
                self.poses[index] = moved(&self.poses[index], twist, rate);
            }
        }
        self.timings.backward = start.elapsed();
        Ok((loss, mse, stats.pairs))
    }
}
