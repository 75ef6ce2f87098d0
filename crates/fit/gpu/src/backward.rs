//! Backward: sums over pixels for each entry, then gradients Gaussian by Gaussian, and the camera's.

use crate::context::Context;
use crate::error::GpuError;
use crate::forward::{Call, GROUP, MOMENTS, PARAMS, of_share, shares};
use crate::passes::Passes;
use crate::room::{Room, uniform};
use crate::shader::Kernel;
use crate::uniforms::{Band, Grid, Share, view_words, with_share};
use crate::workspace::{Drawing, GpuWorkspace, GradientRooms};
use weaver_splat::{CAMERA_SUMS, Cotangents, GaussianStatistics, Gradients, Region, View};

/// Bytes of a part of the camera's gradient.
const CAMERA: u64 = 80;
/// Numbers of a Gaussian's statistics, behind as many that are summed over the bands of a view.
pub(crate) const STATISTICS: usize = 6;

/// A backward pass under way.
pub(crate) struct Backward<'a> {
    context: &'a Context,
    call: Call<'a>,
    workspace: &'a mut GpuWorkspace,
    /// True if gradients stay on the device, and statistics of earlier calls with them.
    stays: bool,
    kept_statistics: bool,
}

impl<'a> Backward<'a> {
    pub fn new(context: &'a Context, call: Call<'a>, workspace: &'a mut GpuWorkspace) -> Self {
        Self { context, call, workspace, stays: false, kept_statistics: false }
    }

    /// Differentiates all views.
    pub fn run(mut self, cotangents: &Cotangents<'_, f32>, mut gradients: Gradients<'_, f32>) -> Result<(), GpuError> {
        let (.., extent) = self.call;
        self.rooms(gradients.statistics.is_some())?;
        let mut cameras = vec![[0.0; CAMERA_SUMS]; extent.views];
        for i in 0..self.workspace.used {
            self.pack(i, cotangents);
            let sums = self.differentiate(i, gradients.statistics.is_some())?;
            let view = &mut cameras[self.workspace.drawings[i].view];
            view.iter_mut().zip(sums).for_each(|(total, sum)| *total += f64::from(sum));
        }
        self.background(cotangents, &mut gradients);
        self.cameras(&cameras, &mut gradients);
        self.gaussians(&mut gradients)
    }

    /// Differentiates the one view that is drawn, by cotangents that are on the device, and leaves the gradients there.
    /// Statistics are added to earlier ones, if these are kept.
    pub fn resident(mut self, statistics: bool, kept: bool) -> Result<(), GpuError> {
        (self.stays, self.kept_statistics) = (true, kept);
        self.rooms(statistics)?;
        self.differentiate(0, statistics).map(|_| ())
    }

    fn rooms(&mut self, statistics: bool) -> Result<(), GpuError> {
        let (.., extent) = self.call;
        let (context, n) = (self.context, extent.gaussians);
        let rooms = &mut self.workspace.gradients;
        let drawings = &self.workspace.drawings[..self.workspace.used];
        let most = |of: fn(&Drawing) -> usize| drawings.iter().map(of).max().unwrap_or(0);
        let entries = most(|drawing| drawing.entries);
        let pixels = most(|drawing| drawing.region.map_or(0, |region| region.pixels()));
        rooms.cotangents.storage(context, "cotangents", pixels, 20)?;
        rooms.moments.storage(context, "sums of entries", entries, MOMENTS)?;
        rooms.weights.storage(context, "weights of entries", if statistics { entries } else { 0 }, 8)?;
        rooms.dparams.storage(context, "gradients of the Gaussians", n, PARAMS)?;
        rooms.dcolor.storage(context, "gradients of the colors", n, 4 * extent.color_len as u64)?;
        rooms.camera.storage(context, "parts of the camera's gradient", n.div_ceil(GROUP), CAMERA)?;
        rooms.camera_sums.storage(context, "the camera's gradient", 1, CAMERA)?;
        rooms.statistics.storage(context, "statistics", if statistics { n } else { 0 }, 8 * STATISTICS as u64)
    }

    /// Brings the cotangents of a drawing to the device.
    fn pack(&mut self, i: usize, cotangents: &Cotangents<'_, f32>) {
        let whole = self.call.3.region;
        let GpuWorkspace { drawings, gradients, host, staging, .. } = &mut *self.workspace;
        host.clear();
        for at in pixels_of(&drawings[i], &whole) {
            let image = cotangents.image.filter(|image| !image.is_empty());
            host.extend_from_slice(image.map_or(&[0.0; 3], |image| &image[3 * at..][..3]));
            host.push(cotangents.alpha.map_or(0.0, |alpha| alpha[at]));
            host.push(cotangents.depth.filter(|depth| !depth.is_empty()).map_or(0.0, |depth| depth[at]));
        }
        staging.write(self.context, &gradients.cotangents, host);
    }

    /// Adds the gradients of a drawing on the device; returns the camera's.
    fn differentiate(&mut self, i: usize, statistics: bool) -> Result<[f32; CAMERA_SUMS], GpuError> {
        let (gaussians, cameras, settings, extent) = self.call;
        let (context, n) = (self.context, extent.gaussians);
        let GpuWorkspace { params, color, drawings, used, gradients, staging, profile, .. } = &mut *self.workspace;
        let drawing = &drawings[i];
        let band = Band {
            first: i == 0 || drawings[i - 1].view != drawing.view,
            last: i + 1 == *used || drawings[i + 1].view != drawing.view,
        };
        let statistics = statistics.then_some(band);
        let region = drawing.region.unwrap_or(extent.region);
        let words = view_words(cameras, drawing.view, settings, &gaussians.color, extent, &region);
        let all = Share { first: 0, count: n, add: i > 0 || self.kept_statistics, statistics };
        let view = uniform(context, &with_share(words, all));
        let view = || (0, view.as_entire_binding());
        let GradientRooms { cotangents, moments, weights, dparams, dcolor, camera, camera_sums, statistics: tallies } =
            gradients;
        let mut passes = Passes::new(context, profile.as_mut());
        let bindings = [
            view(),
            (1, drawing.splats.all()),
            (2, drawing.owners.all()),
            (3, drawing.entry.all()),
            (4, drawing.starts.all()),
            (5, drawing.pixels.all()),
            (6, cotangents.all()),
            (7, moments.all()),
            (8, weights.all()),
        ];
        // One more, for entries that were counted in vain.
        passes.run(Kernel::Moments, Grid::of(&region).tiles() + 1, &bindings);
        if statistics.is_some() {
            let bindings = [
                view(),
                (1, drawing.splats.all()),
                (2, drawing.first.all()),
                (3, drawing.rank.all()),
                (4, moments.all()),
                (5, weights.all()),
                (6, tallies.all()),
            ];
            passes.run(Kernel::Statistics, n.div_ceil(GROUP), &bindings);
        }
        for share in shares(context, extent) {
            let view = uniform(context, &with_share(words, Share { add: i > 0, ..share }));
            let bindings = [
                (0, view.as_entire_binding()),
                (1, of_share(params, share, PARAMS)),
                (2, of_share(color, share, 4 * extent.color_len as u64)),
                (3, drawing.first.all()),
                (4, drawing.rank.all()),
                (5, moments.all()),
                (6, of_share(dparams, share, PARAMS)),
                (7, of_share(dcolor, share, 4 * extent.color_len as u64)),
                (8, camera.all()),
            ];
            passes.run(Kernel::Gaussian, share.count.div_ceil(GROUP), &bindings);
        }
        if self.stays {
            return passes.submit().map(|()| [0.0; CAMERA_SUMS]);
        }
        let parts = uniform(context, &[n.div_ceil(GROUP) as u32, 0, 0, 0]);
        let bindings = [(0, parts.as_entire_binding()), (1, camera.all()), (2, camera_sums.all())];
        passes.run(Kernel::Camera, 1, &bindings);
        let read = passes.read(staging, &[(camera_sums.buffer(), 4 * CAMERA_SUMS as u64)])?;
        let words = read.as_chunks::<4>().0;
        Ok(std::array::from_fn(|i| f32::from_le_bytes(words[i])))
    }

    /// The sum over the pixels of T times the gradient of the image.
    fn background(&self, cotangents: &Cotangents<'_, f32>, gradients: &mut Gradients<'_, f32>) {
        let (_, cameras, _, extent) = self.call;
        let Some(target) = &mut gradients.background else { return };
        let shared = cameras.background.len() == 3;
        let mut sums = vec![0.0_f64; cameras.background.len()];
        for drawing in &self.workspace.drawings[..self.workspace.used] {
            let Some(image) = cotangents.image.filter(|image| !image.is_empty()) else { continue };
            let to = if shared { 0 } else { 3 * drawing.view };
            for (at, pixel) in pixels_of(drawing, &extent.region).zip(drawing.drawn.as_chunks::<5>().0) {
                (0..3).for_each(|c| sums[to + c] += f64::from(pixel[4]) * f64::from(image[3 * at + c]));
            }
        }
        sums.iter().enumerate().for_each(|(i, sum)| target.put(i, *sum as f32));
    }

    fn cameras(&self, sums: &[[f64; CAMERA_SUMS]], gradients: &mut Gradients<'_, f32>) {
        let (_, cameras, ..) = self.call;
        let matrix_len = cameras.matrix_len();
        for (v, sums) in sums.iter().enumerate() {
            let (matrix, intrinsics) = View::of(cameras, v).gradient(sums);
            if let Some(target) = &mut gradients.viewmats {
                (0..matrix_len).for_each(|i| target.put(v * matrix_len + i, matrix.get(i).copied().unwrap_or(0.0)));
            }
            if let Some(target) = &mut gradients.intrinsics {
                (0..4).for_each(|i| target.put(4 * v + i, intrinsics[i]));
            }
        }
    }

    /// Brings the gradients of the Gaussians to the host.
    fn gaussians(&mut self, gradients: &mut Gradients<'_, f32>) -> Result<(), GpuError> {
        let (.., extent) = self.call;
        let n = extent.gaussians;
        let drawn = self.workspace.used > 0;
        let GpuWorkspace { gradients: rooms, staging, .. } = &mut *self.workspace;
        // Without a view nothing was written on the device.
        let mut read = |room: &Room, len: usize| -> Result<Vec<u8>, GpuError> {
            let bytes = 4 * len as u64;
            if !drawn {
                return Ok(vec![0; bytes as usize]);
            }
            Passes::new(self.context, None).read(staging, &[(room.buffer(), bytes)])
        };
        let params = read(&rooms.dparams, 12 * n)?;
        let params = params.as_chunks::<4>().0;
        let targets = [
            (&mut gradients.means, 0, 3),
            (&mut gradients.quats, 3, 4),
            (&mut gradients.scales, 7, 3),
            (&mut gradients.opacities, 10, 1),
        ];
        for (target, from, count) in targets {
            let Some(target) = target else { continue };
            for (n, row) in params.as_chunks::<12>().0.iter().enumerate() {
                (0..count).for_each(|k| target.put(count * n + k, f32::from_le_bytes(row[from + k])));
            }
        }
        if let Some(target) = &mut gradients.colors {
            let colors = read(&rooms.dcolor, extent.color_len * n)?;
            let numbers = colors.as_chunks::<4>().0.iter().enumerate();
            numbers.for_each(|(i, bytes)| target.put(i, f32::from_le_bytes(*bytes)));
        }
        if let Some(target) = gradients.features.as_mut().filter(|target| !target.add) {
            target.values.fill(0.0);
        }
        if let Some(all) = &mut gradients.statistics {
            let rows = read(&rooms.statistics, 2 * STATISTICS * n)?;
            let rows = rows.as_chunks::<4>().0.as_chunks::<STATISTICS>().0;
            for (to, row) in all.iter_mut().zip(rows.iter().skip(1).step_by(2)) {
                add_statistics(to, row.map(f32::from_le_bytes));
            }
        }
        Ok(())
    }
}

/// The pixels of a drawing, by their places in images of the whole region.
fn pixels_of(drawing: &Drawing, whole: &Region) -> std::ops::Range<usize> {
    let region = drawing.region.unwrap_or(*whole);
    let first = drawing.view * whole.pixels() + (region.y - whole.y) * whole.width;
    first..first + region.pixels()
}

pub(crate) fn add_statistics(
    to: &mut GaussianStatistics<f32>,
    [screen_gradient, absgrad, views, radius, contribution, largest_weight]: [f32; STATISTICS],
) {
    to.screen_gradient += screen_gradient;
    to.absgrad += absgrad;
    to.views += views as u32;
    to.radius = to.radius.max(radius);
    to.contribution += contribution;
    to.largest_weight = to.largest_weight.max(largest_weight);
}
