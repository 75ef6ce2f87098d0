//! The loss of an image against a photo, and its gradient, on the device.

use crate::context::Context;
use crate::error::GpuError;
use crate::forward::GROUP;
use crate::passes::Passes;
use crate::room::{Room, uniform};
use crate::shader::Kernel;
use crate::workspace::GpuWorkspace;
use weaver_fit::PhotoStep;

/// Width of the Gaussian window of SSIM, and its standard deviation, pixels.
const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;

/// Buffers of the loss, and its three sums.
#[derive(Debug, Default)]
pub(crate) struct PhotoLosses {
    /// Bytes red, green, blue, and whether the pixel counts.
    photo: Room,
    packed: Vec<u32>,
    /// Means along rows, then maps spread down; maps of windows.
    rows: Room,
    maps: Room,
    parts: Room,
    sums: Room,
    windows: usize,
}

impl PhotoLosses {
    /// Windows of the last image.
    pub fn windows(&self) -> usize {
        self.windows
    }

    /// From the first drawing of the workspace, which is of the whole photo, to cotangents.
    pub fn encode(
        &mut self,
        context: &Context,
        step: &PhotoStep<'_>,
        workspace: &mut GpuWorkspace,
    ) -> Result<(), GpuError> {
        let (width, height) = (step.camera.width, step.camera.height);
        let (pixels, border) = (width * height, WINDOW - 1);
        // Without windows the loss is the absolute error at any weight.
        let windowed = width >= WINDOW && height >= WINDOW && step.ssim_weight > 0.0;
        let across = if windowed { width - border } else { 0 };
        self.windows = if windowed { across * (height - border) } else { 0 };
        let groups = |count: usize| count.div_ceil(GROUP);
        let parts = groups(self.windows) + groups(pixels);
        self.photo.storage(context, "the photo", pixels, 4)?;
        self.rows.storage(context, "rows of windows", across * height, 60)?;
        self.maps.storage(context, "windows", self.windows, 36)?;
        self.parts.storage(context, "parts of the loss", parts, 16)?;
        self.sums.storage(context, "the loss", 3, 4)?;
        self.packed.clear();
        let pixel = |(i, rgb): (usize, &[u8; 3])| {
            let counts = step.mask.is_none_or(|mask| mask[i]);
            u32::from_le_bytes([rgb[0], rgb[1], rgb[2], if counts { 255 } else { 0 }])
        };
        self.packed.extend(step.rgb.as_chunks::<3>().0.iter().enumerate().map(pixel));
        let GpuWorkspace { staging, profile, drawings, gradients, .. } = workspace;
        staging.write(context, &self.photo, &self.packed);

        let weight = if windowed { step.ssim_weight } else { 0.0 };
        let ssim_slope = weight / (3 * self.windows).max(1) as f64;
        let l1_slope = (1.0 - weight) / (3 * pixels) as f64;
        let mut words: Vec<u32> = step.camera.background[..3].iter().map(|x| x.to_bits()).collect();
        words.push((ssim_slope as f32).to_bits());
        words.extend(taps().map(|tap| (tap as f32).to_bits()));
        words.extend([width as u32, height as u32, (l1_slope as f32).to_bits(), parts as u32]);
        let loss = uniform(context, &words);
        let loss = || (0, loss.as_entire_binding());
        let (drawn, photo) = ((1, drawings[0].pixels.all()), (2, self.photo.all()));
        let (rows, maps) = ((3, self.rows.all()), (4, self.maps.all()));
        let parts = (6, self.parts.all());
        let mut passes = Passes::new(context, profile.as_mut());
        if windowed {
            let along = groups(across * height);
            passes.run(Kernel::WindowRows, along, &[loss(), drawn.clone(), photo.clone(), rows.clone()]);
            let bindings = [loss(), rows.clone(), maps.clone(), parts.clone()];
            passes.run(Kernel::WindowMaps, groups(self.windows), &bindings);
            passes.run(Kernel::SpreadMaps, along, &[loss(), rows.clone(), maps]);
        }
        let bindings = [loss(), drawn, photo, rows, (5, gradients.cotangents.all()), parts.clone()];
        passes.run(Kernel::Compare, groups(pixels), &bindings);
        passes.run(Kernel::SumLosses, 1, &[loss(), parts, (7, self.sums.all())]);
        passes.submit()
    }

    /// The sums of |image - photo|, of 1 - SSIM and of squared differences.
    pub fn read(&self, context: &Context, workspace: &mut GpuWorkspace) -> Result<[f32; 3], GpuError> {
        let bytes = Passes::new(context, None).read(&mut workspace.staging, &[(self.sums.buffer(), 12)])?;
        let words = bytes.as_chunks::<4>().0;
        Ok([0, 1, 2].map(|i| f32::from_le_bytes(words[i])))
    }
}

/// The weights of the window along an axis, up to the middle one, and nothing behind them.
fn taps() -> [f64; 8] {
    let middle = WINDOW / 2;
    let weight = |k: usize| (-0.5 * ((k as f64 - middle as f64) / SIGMA).powi(2)).exp();
    let total: f64 = (0..WINDOW).map(weight).sum();
    std::array::from_fn(|k| if k <= middle { weight(k) / total } else { 0.0 })
}
