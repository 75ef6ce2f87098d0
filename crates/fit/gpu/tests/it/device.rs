//! The device that all tests share, and its use.

use crate::scene::{Planes, Scene, flatten};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use weaver_gpu::{Choice, Context, GpuRasterizer, GpuWorkspace, wgpu};
use weaver_splat::{GaussianStatistics, Gradients, Images, RasterStats, Target, Workspace};

/// The first adapter with no more than WebGPU promises; `None`, and a line that says so, where there is none.
pub fn rasterizer() -> Option<GpuRasterizer> {
    static SHARED: OnceLock<Option<GpuRasterizer>> = OnceLock::new();
    let shared = SHARED.get_or_init(|| with_limits(wgpu::Limits::default()));
    if shared.is_none() {
        println!("skipped: no adapter");
    }
    shared.clone()
}

/// The first adapter with limits under which small drawings already go in bands, and their Gaussians in shares.
pub fn narrow() -> Option<GpuRasterizer> {
    static SHARED: OnceLock<Option<GpuRasterizer>> = OnceLock::new();
    let limits = wgpu::Limits { max_storage_buffer_binding_size: NARROW, ..wgpu::Limits::default() };
    let shared = SHARED.get_or_init(|| with_limits(limits));
    if shared.is_none() {
        println!("skipped: no adapter");
    }
    shared.clone()
}

/// Bytes of a binding in [`narrow`].
pub const NARROW: u64 = 48 << 10;

/// The first adapter with these limits.
pub fn with_limits(limits: wgpu::Limits) -> Option<GpuRasterizer> {
    weaver_gpu::adapters().first()?;
    let context = Context::open_with(&Choice::Number(0), limits).unwrap_or_else(|error| panic!("{error}"));
    Some(GpuRasterizer::new(context))
}

/// Draws on the device.
pub fn render(
    rasterizer: &GpuRasterizer,
    workspace: &mut GpuWorkspace,
    scene: &Scene<f32>,
) -> (Planes<f32>, RasterStats) {
    let pixels = scene.pixels();
    let [image, alpha, depth] = [scene.image_channels(), 1, 1].map(|channels| vec![f32::NAN; channels * pixels]);
    let mut out = Planes { image, alpha, depth, features: Vec::new() };
    let images = Images { image: &mut out.image, alpha: &mut out.alpha, depth: Some(&mut out.depth), features: None };
    let stats = rasterizer
        .forward(&scene.gaussians(), &scene.cameras(), &scene.settings, workspace, images)
        .unwrap_or_else(|error| panic!("{error}"));
    (out, stats)
}

/// Gradients on the device, in the order of [`crate::scene::NAMES`], after a forward.
pub fn gradients(
    rasterizer: &GpuRasterizer,
    workspace: &mut GpuWorkspace,
    scene: &Scene<f32>,
    cotangents: &Planes<f32>,
) -> [Vec<f32>; 10] {
    let n = scene.opacities.len();
    let (colors, viewmats, intrinsics) = (scene.colors.len(), scene.viewmats.len(), scene.intrinsics.len());
    let lengths = [3 * n, 4 * n, 3 * n, n, colors, viewmats, intrinsics, scene.background.len(), 0, 0];
    let mut statistics = vec![GaussianStatistics::default(); n];
    let mut out = lengths.map(|len| vec![f32::NAN; len]);
    let [means, quats, scales, opacities, colors, viewmats, intrinsics, background, ..] =
        out.each_mut().map(|values| Some(Target::write(&mut values[..])));
    let targets = Gradients {
        means,
        quats,
        scales,
        opacities,
        colors,
        viewmats,
        intrinsics,
        background,
        features: None,
        statistics: Some(&mut statistics),
    };
    let (gaussians, cameras) = (scene.gaussians(), scene.cameras());
    rasterizer
        .backward(&gaussians, &cameras, &scene.settings, workspace, &cotangents.as_cotangents(), targets)
        .unwrap_or_else(|error| panic!("{error}"));
    out[9] = flatten(&statistics);
    out
}

/// The pixels at which rounding decides nothing: as many Gaussians add to them with all alphas a ten-thousandth larger
/// as with all as much smaller. The same with every alpha means that none is that close to 1/255, and no transmittance
/// to 1e-4.
pub fn decided(scene: &Scene<f64>) -> Vec<bool> {
    let counts = |factor: f64| {
        let mut scene = scene.clone();
        scene.opacities.iter_mut().for_each(|opacity| *opacity *= factor);
        scene.settings.alpha_max *= factor;
        let counts: Vec<AtomicU32> = (0..scene.pixels()).map(|_| AtomicU32::new(0)).collect();
        let mut workspace = Workspace::new();
        scene.render_in(&mut workspace);
        workspace
            .for_each_hit(|pixel, _, _, _| {
                counts[pixel].fetch_add(1, Relaxed);
            })
            .unwrap();
        counts.into_iter().map(AtomicU32::into_inner).collect::<Vec<u32>>()
    };
    counts(1.0 - 1e-4).iter().zip(counts(1.0 + 1e-4)).map(|(less, more)| *less == more).collect()
}

/// Images with zeros where `keep` does not hold.
pub fn masked<T: Copy + Default>(planes: &Planes<T>, keep: &[bool]) -> Planes<T> {
    let mask = |values: &[T]| {
        let channels = values.len() / keep.len().max(1);
        let kept = |i: usize| keep[i / channels.max(1)];
        values.iter().enumerate().map(|(i, x)| if kept(i) { *x } else { T::default() }).collect()
    };
    Planes { image: mask(&planes.image), alpha: mask(&planes.alpha), depth: mask(&planes.depth), features: Vec::new() }
}

/// The scene with numbers that `f32` holds, so that CPU and device draw the very same.
pub fn rounded(scene: &Scene<f64>) -> Scene<f64> {
    let mut scene = scene.clone();
    scene.parts().into_iter().flatten().for_each(|x| *x = f64::from(*x as f32));
    scene
}
