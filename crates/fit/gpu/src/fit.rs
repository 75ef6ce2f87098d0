//! A fit that stays on the device: Gaussians, gradients, the optimizer's memory, and the image's part of the loss.

use crate::backward::{Backward, STATISTICS, add_statistics};
use crate::context::Context;
use crate::error::GpuError;
use crate::forward::{Forward, GROUP, PARAMS};
use crate::loss::PhotoLosses;
use crate::passes::Passes;
use crate::room::{Room, uniform};
use crate::shader::Kernel;
use crate::workspace::GpuWorkspace;
use std::time::Duration;
use weaver_fit::{DeviceFit, Fitted, PhotoLoss, PhotoStep};
use weaver_scene::{CameraSlices, Color, GaussianSlices};
use weaver_splat::{Extent, GaussianStatistics, RasterError, RasterSettings, RasterStats};

/// Numbers of a Gaussian's row of parameters.
const ROW: usize = 12;
/// Adam's decay rates, as in `shaders/adam.wgsl`.
const BETA: [f64; 2] = [0.9, 0.999];

/// Gaussians on the device, with Adam's memory of them.
#[derive(Debug)]
pub(crate) struct GpuFit {
    context: Context,
    /// Parameters as they are drawn, and colors, among others.
    workspace: GpuWorkspace,
    /// Parameters as they are stored, and their first and second moments, `[N, 12]` each.
    stored: [Room; 3],
    /// The moments of the colors, `[N, 3 K]` each.
    color_moments: [Room; 2],
    losses: PhotoLosses,
    gaussians: usize,
    degree: usize,
    /// True if statistics were summed since they were last brought back.
    counted: bool,
}

impl GpuFit {
    pub fn new(context: Context, workspace: GpuWorkspace) -> Self {
        Self {
            context,
            workspace,
            stored: Default::default(),
            color_moments: Default::default(),
            losses: PhotoLosses::default(),
            gaussians: 0,
            degree: 0,
            counted: false,
        }
    }

    /// Numbers of a color.
    fn colors(&self) -> usize {
        3 * (self.degree + 1) * (self.degree + 1)
    }

    /// The sizes of a step, whose Gaussians are not on the host.
    fn extent(&self, camera: &CameraSlices<'_, f32>, settings: &RasterSettings) -> Result<Extent, RasterError> {
        let mut extent = Extent::of(&nothing(self.degree), camera, settings, false)?;
        extent.gaussians = self.gaussians;
        Ok(extent)
    }

    fn draw(&mut self, step: &PhotoStep<'_>, extent: &Extent) -> Result<(RasterStats, [f32; 3]), GpuError> {
        let nothing = nothing(self.degree);
        let call = (&nothing, &step.camera, step.settings, extent);
        let stats = Forward::new(&self.context, call, &mut self.workspace).resident()?;
        let cotangents = &mut self.workspace.gradients.cotangents;
        cotangents.storage(&self.context, "cotangents", extent.pixels(), 20)?;
        self.losses.encode(&self.context, step, &mut self.workspace)?;
        Backward::new(&self.context, call, &mut self.workspace).resident(step.statistics, self.counted)?;
        self.counted |= step.statistics;
        self.descend(step)?;
        let losses = self.losses.read(&self.context, &mut self.workspace)?;
        Ok((stats, losses))
    }

    /// A step of Adam.
    fn descend(&mut self, step: &PhotoStep<'_>) -> Result<(), GpuError> {
        let [first, second] = BETA.map(|beta| 1.0 - beta.powf(step.step as f64));
        let rate = |rate: f32| (f64::from(rate) / first) as f32;
        let (r, root) = (&step.rates, (1.0 / second.sqrt()) as f32);
        let (mean, quat, scale) = (rate(r.means), rate(r.quats), rate(r.scales));
        let columns = [mean, mean, mean, quat, quat, quat, quat, scale, scale, scale, rate(r.opacities), 0.0];
        let mut of_color = [0.0; ROW];
        of_color[..2].copy_from_slice(&[rate(r.sh), rate(r.sh_rest)]);
        let words = |width: usize, rates: [f32; ROW]| {
            let [by_opacity, by_scale] = step.regularizer;
            let mut words = vec![(self.gaussians * width) as u32, width as u32];
            words.extend([root, by_opacity, by_scale, 0.0, 0.0, 0.0].map(f32::to_bits));
            words.extend(rates.map(f32::to_bits));
            uniform(&self.context, &words)
        };
        let (n, colors_len) = (self.gaussians, self.colors());
        let (params, color) = (words(ROW, columns), words(colors_len, of_color));
        let GpuWorkspace { gradients, profile, params: drawn, color: colors, .. } = &mut self.workspace;
        let mut passes = Passes::new(&self.context, profile.as_mut());
        let [values, first, second] = &self.stored;
        let bindings = [
            (0, params.as_entire_binding()),
            (1, gradients.dparams.all()),
            (2, values.all()),
            (3, first.all()),
            (4, second.all()),
            (5, drawn.all()),
        ];
        passes.run(Kernel::DescendParams, (n * ROW).div_ceil(GROUP), &bindings);
        let [first, second] = &self.color_moments;
        let bindings = [
            (0, color.as_entire_binding()),
            (1, gradients.dcolor.all()),
            (2, colors.all()),
            (3, first.all()),
            (4, second.all()),
        ];
        passes.run(Kernel::DescendColor, (n * colors_len).div_ceil(GROUP), &bindings);
        passes.submit()
    }

    fn load_all(&mut self, gaussians: &Fitted<[&[f32]; 3]>) -> Result<(), GpuError> {
        let Fitted { means, quats, log_scales, logits, sh, degree } = gaussians;
        (self.gaussians, self.degree, self.counted) = (logits[0].len(), *degree, false);
        let (context, n, colors) = (&self.context, self.gaussians, self.colors());
        // A pass sees all of them at once.
        let most = context.binding_bytes();
        let need = n as u64 * PARAMS.max(4 * colors as u64);
        context.at_most("max_storage_buffer_binding_size", need, most, || format!("a fit of {n} Gaussians"))?;
        let GpuWorkspace { staging, params, color, host, .. } = &mut self.workspace;
        for (part, room) in self.stored.iter_mut().enumerate() {
            host.clear();
            for i in 0..n {
                host.extend_from_slice(&means[part][3 * i..][..3]);
                host.extend_from_slice(&quats[part][4 * i..][..4]);
                host.extend_from_slice(&log_scales[part][3 * i..][..3]);
                host.extend_from_slice(&[logits[part][i], 0.0]);
            }
            room.storage(context, "stored parameters", n, PARAMS)?;
            staging.write(context, room, host);
            if part == 0 {
                for row in host.as_chunks_mut::<ROW>().0 {
                    row[7..10].iter_mut().for_each(|scale| *scale = scale.exp());
                    row[10] = 1.0 / (1.0 + (-row[10]).exp());
                }
                params.storage(context, "parameters of the Gaussians", n, PARAMS)?;
                staging.write(context, params, host);
            }
        }
        let [color_first, color_second] = &mut self.color_moments;
        for (room, numbers) in [color, color_first, color_second].into_iter().zip(sh) {
            room.storage(context, "colors of the Gaussians", n, 4 * colors as u64)?;
            staging.write(context, room, numbers);
        }
        Ok(())
    }

    fn store_all(
        &mut self,
        mut gaussians: Fitted<[&mut [f32]; 3]>,
        statistics: &mut [GaussianStatistics<f32>],
    ) -> Result<(), GpuError> {
        let (n, colors) = (self.gaussians, self.colors());
        let GpuWorkspace { staging, color, gradients, .. } = &mut self.workspace;
        let mut read = |room: &Room, numbers: usize| -> Result<Vec<f32>, GpuError> {
            let bytes = Passes::new(&self.context, None).read(staging, &[(room.buffer(), 4 * numbers as u64)])?;
            Ok(bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
        };
        for (part, room) in self.stored.iter().enumerate() {
            for (i, row) in read(room, ROW * n)?.as_chunks::<ROW>().0.iter().enumerate() {
                gaussians.means[part][3 * i..][..3].copy_from_slice(&row[..3]);
                gaussians.quats[part][4 * i..][..4].copy_from_slice(&row[3..7]);
                gaussians.log_scales[part][3 * i..][..3].copy_from_slice(&row[7..10]);
                gaussians.logits[part][i] = row[10];
            }
        }
        let [color_first, color_second] = &self.color_moments;
        for (room, to) in [&*color, color_first, color_second].into_iter().zip(&mut gaussians.sh) {
            to.copy_from_slice(&read(room, colors * n)?);
        }
        if std::mem::take(&mut self.counted) {
            let rows = read(&gradients.statistics, 2 * STATISTICS * n)?;
            let rows = rows.as_chunks::<STATISTICS>().0.iter().skip(1).step_by(2);
            statistics.iter_mut().zip(rows).for_each(|(to, row)| add_statistics(to, *row));
        }
        Ok(())
    }
}

/// No Gaussians, with harmonics.
fn nothing(degree: usize) -> GaussianSlices<'static, f32> {
    let color = Color::Sh { coefficients: &[], degree };
    GaussianSlices { means: &[], quats: &[], scales: &[], opacities: &[], color, features: None, groups: None }
}

impl DeviceFit for GpuFit {
    fn load(&mut self, gaussians: &Fitted<[&[f32]; 3]>) -> Result<(), RasterError> {
        Ok(self.load_all(gaussians)?)
    }

    fn step(&mut self, step: &PhotoStep<'_>) -> Result<PhotoLoss, RasterError> {
        let extent = self.extent(&step.camera, step.settings)?;
        let (CameraSlices { width, height, .. }, pixels) = (step.camera, extent.region.pixels());
        let fits = extent.views == 1 && step.settings.region.is_none();
        if !fits || step.rgb.len() != 3 * pixels || step.mask.is_some_and(|mask| mask.len() != pixels) {
            return Err(RasterError::Arguments(format!(
                "a step of a fit needs one photo of {width} x {height} pixels"
            )));
        }
        let (stats, [absolute, dissimilarity, squares]) = self.draw(step, &extent)?;
        let numbers = 3.0 * pixels as f64;
        let (l1, mse) = (f64::from(absolute) / numbers, f64::from(squares) / numbers);
        let loss = match self.losses.windows() {
            0 => l1,
            windows => {
                let dissimilarity = f64::from(dissimilarity) / (3 * windows) as f64;
                (1.0 - step.ssim_weight) * l1 + step.ssim_weight * dissimilarity
            }
        };
        Ok(PhotoLoss { loss, mse, pairs: stats.pairs })
    }

    fn pass_times(&mut self) -> Vec<(&'static str, Duration)> {
        self.workspace.pass_times().into_iter().map(|pass| (pass.name, pass.time)).collect()
    }

    fn store(
        &mut self,
        gaussians: Fitted<[&mut [f32]; 3]>,
        statistics: &mut [GaussianStatistics<f32>],
    ) -> Result<(), RasterError> {
        Ok(self.store_all(gaussians, statistics)?)
    }
}
