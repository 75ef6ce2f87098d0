//! Drawings recorded into commands of one's own.

use crate::device::{narrow, rasterizer, render};
use crate::scene::{Planes, Scene};
use weaver_gpu::{DeviceGaussians, GpuRasterizer, GpuWorkspace, wgpu};
use weaver_splat::Region;

/// A buffer of these numbers, as an embedder would have it.
fn buffer(rasterizer: &GpuRasterizer, numbers: &[f32]) -> wgpu::Buffer {
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    let buffer = rasterizer.context().device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes.len().max(16) as u64,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    rasterizer.context().queue().write_buffer(&buffer, 0, &bytes);
    buffer
}

/// The Gaussians as shaders see them.
fn params(scene: &Scene<f32>) -> Vec<f32> {
    let row = |n: usize| {
        let (mean, quat, scale) = (&scene.means[3 * n..][..3], &scene.quats[4 * n..][..4], &scene.scales[3 * n..][..3]);
        [mean, quat, scale, &[scene.opacities[n], f32::NAN]].concat()
    };
    (0..scene.opacities.len()).flat_map(row).collect()
}

/// Draws by recorded commands: the image with its background, and the totals.
fn recorded(
    rasterizer: &GpuRasterizer,
    workspace: &mut GpuWorkspace,
    scene: &Scene<f32>,
    capacity: usize,
) -> (Planes<f32>, [u32; 3]) {
    let device = rasterizer.context().device();
    let (params, colors) = (buffer(rasterizer, &params(scene)), buffer(rasterizer, &scene.colors));
    let gaussians =
        DeviceGaussians { count: scene.opacities.len(), params: &params, colors: &colors, degree: scene.degree };
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let drawn = rasterizer
        .encode(&mut encoder, gaussians, &scene.cameras(), &scene.settings, capacity, workspace)
        .unwrap_or_else(|error| panic!("{error}"));
    let size = scene.pixels() as u64 * 20;
    let read = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: size + 12,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    encoder.copy_buffer_to_buffer(drawn.pixels, 0, &read, 0, size);
    encoder.copy_buffer_to_buffer(drawn.totals, 0, &read, size, 12);
    rasterizer.context().queue().submit([encoder.finish()]);
    read.slice(..).map_async(wgpu::MapMode::Read, Result::unwrap);
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let bytes = read.slice(..).get_mapped_range().unwrap().to_vec();
    let word = |i: usize| <[u8; 4]>::try_from(&bytes[4 * i..][..4]).unwrap();
    let number = |i: usize| f32::from_le_bytes(word(i));
    let mut planes = Planes { image: vec![], alpha: vec![], depth: vec![], features: vec![] };
    for pixel in 0..scene.pixels() {
        let transmittance = number(5 * pixel + 4);
        planes.image.extend((0..3).map(|c| number(5 * pixel + c) + transmittance * scene.background[c]));
        planes.alpha.push(1.0 - transmittance);
        planes.depth.push(number(5 * pixel + 3));
    }
    (planes, [0, 1, 2].map(|i| u32::from_le_bytes(word(5 * scene.pixels() + i))))
}

fn scenes() -> [Scene<f32>; 3] {
    let mut part = Scene::random(31, 300, 1, (70, 50), Some(2)).with_channels(0);
    part.settings.region = Some(Region { x: 7, y: 5, width: 60, height: 33 });
    let plain = Scene::random(32, 200, 1, (33, 20), None).with_channels(0);
    [part, plain, Scene::random(33, 0, 1, (20, 17), None).with_channels(0)].map(|scene| scene.to_f32())
}

/// With just enough room and with far more, after each other and after other drawings.
///
/// Promise (results): a drawing recorded into an embedder's commands has the bits of any other; an overflow is
/// reported.
#[test]
fn a_recorded_drawing_has_the_bits_of_any_other() {
    let Some(rasterizer) = rasterizer() else { return };
    let mut workspace = GpuWorkspace::default();
    for scene in scenes() {
        let (expected, stats) = render(&rasterizer, &mut workspace, &scene);
        for capacity in [stats.entries, 3 * stats.entries + 777] {
            workspace.spoil(rasterizer.context());
            let (planes, totals) = recorded(&rasterizer, &mut workspace, &scene, capacity);
            assert_eq!(totals.map(|n| n as usize), [stats.splats, stats.entries, stats.rejected]);
            assert!(planes == expected, "{capacity} entries");
        }
    }
}

/// Too little room leaves out the farthest entries, says so, and spoils nothing.
///
/// Promise of `a_recorded_drawing_has_the_bits_of_any_other`.
#[test]
fn an_overflow_is_told() {
    let Some(rasterizer) = rasterizer() else { return };
    let mut workspace = GpuWorkspace::default();
    let scene = &scenes()[0];
    let (expected, stats) = render(&rasterizer, &mut workspace, scene);
    let least = |planes: &Planes<f32>| planes.alpha.iter().fold(0.0_f64, |sum, a| sum + f64::from(*a));
    let mut covered = 0.0;
    for capacity in [1, stats.entries / 4, stats.entries / 2] {
        let (planes, totals) = recorded(&rasterizer, &mut workspace, scene, capacity);
        assert!(totals[1] as usize == stats.entries && stats.entries > capacity);
        assert!(planes.flat().iter().all(|x| x.is_finite()));
        assert!(least(&planes) >= covered && least(&planes) < least(&expected));
        covered = least(&planes);
    }
    assert!(covered > 0.0);
    let (again, _) = recorded(&rasterizer, &mut workspace, scene, stats.entries);
    assert!(again == expected);
}

#[test]
fn buffers_and_rooms_that_do_not_fit_are_refused() {
    let Some(rasterizer) = narrow() else { return };
    let scene = Scene::random(34, 10, 1, (8, 8), None).with_channels(0).to_f32();
    let pair = Scene::random(34, 10, 2, (8, 8), None).with_channels(0).to_f32();
    let refused = |params: &[f32], colors: &[f32], scene: &Scene<f32>, capacity: usize| {
        let (params, colors) = (buffer(&rasterizer, params), buffer(&rasterizer, colors));
        let gaussians = DeviceGaussians { count: 10, params: &params, colors: &colors, degree: None };
        let mut encoder = rasterizer.context().device().create_command_encoder(&Default::default());
        let mut workspace = GpuWorkspace::default();
        let (cameras, settings) = (scene.cameras(), scene.settings);
        let error = rasterizer.encode(&mut encoder, gaussians, &cameras, &settings, capacity, &mut workspace);
        error.unwrap_err().to_string()
    };
    let all = params(&scene);
    let error = refused(&all[..108], &scene.colors, &scene, 100);
    assert!(error.contains("a buffer of 432 bytes, 480 are needed: parameters of the Gaussians"), "{error}");
    let error = refused(&all, &scene.colors[..27], &scene, 100);
    assert!(error.contains("a buffer of 108 bytes, 120 are needed: colors of the Gaussians"), "{error}");
    let error = refused(&all, &scene.colors, &pair, 100);
    assert!(error.contains("2 cameras, expected one"), "{error}");
    let error = refused(&all, &scene.colors, &scene, 20_000);
    assert!(
        error.contains("max_storage_buffer_binding_size of 49152, 80000 are needed: a capacity of 20000 entries"),
        "{error}"
    );
}
