//! Numbers and arguments that no caller should pass, and some will.

use crate::device::{gradients, rasterizer, render, with_limits};
use crate::scene::{Planes, Scene};
use weaver_gpu::{Choice, Context, GpuError, GpuRasterizer, GpuWorkspace, adapters, wgpu};
use weaver_splat::{Cotangents, Gradients, Images, Workspace};

/// A number that is not finite is left out and counted, as on the CPU, and spoils nothing else.
#[test]
fn what_is_not_finite_is_left_out() {
    let Some(rasterizer) = rasterizer() else { return };
    let mut workspace = GpuWorkspace::default();
    for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
        for part in 0..5 {
            let mut scene = Scene::random(21, 40, 1, (24, 17), Some(1)).with_channels(0).to_f32();
            let numbers = match part {
                0 => &mut scene.means,
                1 => &mut scene.quats,
                2 => &mut scene.scales,
                3 => &mut scene.opacities,
                _ => &mut scene.colors,
            };
            let len = numbers.len();
            numbers.iter_mut().step_by(len / 7).for_each(|x| *x = bad);
            let (own, stats) = render(&rasterizer, &mut workspace, &scene);
            let (expected, on_cpu) = scene.render_in(&mut Workspace::new());
            // The largest number is finite; its results may be so in one place and not in another.
            if bad != f32::MAX {
                assert_eq!(stats.rejected, on_cpu.rejected, "{bad} in part {part}");
                let error = own.flat().iter().zip(expected.flat()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(error < 2e-2, "{bad} in part {part}: {error:e}");
            }
            assert!(own.flat().iter().all(|x| x.is_finite()), "{bad} in part {part}");
            let ones = Planes {
                image: vec![1.0; own.image.len()],
                alpha: own.alpha.clone(),
                depth: own.depth,
                features: Vec::new(),
            };
            let own = gradients(&rasterizer, &mut workspace, &scene, &ones);
            assert!(own.iter().flatten().all(|x| x.is_finite()), "{bad} in part {part}");
        }
    }
}

#[test]
fn quaternions_of_zeros_are_left_out() {
    let Some(rasterizer) = rasterizer() else { return };
    let mut scene = Scene::random(22, 30, 1, (20, 20), None).with_channels(0).to_f32();
    scene.quats[..20].fill(0.0);
    let (_, stats) = render(&rasterizer, &mut GpuWorkspace::default(), &scene);
    assert_eq!(stats.rejected, scene.render_in(&mut Workspace::new()).1.rejected);
    assert!(stats.rejected >= 5);
}

#[test]
fn arguments_that_do_not_fit_are_refused() {
    let Some(rasterizer) = rasterizer() else { return };
    let scene = Scene::random(23, 3, 1, (4, 4), None);
    let features = scene.clone().with_channels(2).to_f32();
    let scene = scene.with_channels(0).to_f32();
    let mut workspace = rasterizer.workspace();
    let mut drawn = |scene: &Scene<f32>, pixels: usize| {
        let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let (gaussians, cameras) = (scene.gaussians(), scene.cameras());
        let result = rasterizer.forward(&gaussians, &cameras, &scene.settings, &mut workspace, images);
        let none = (&Cotangents::default(), Gradients::default());
        let back = rasterizer.backward(&gaussians, &cameras, &scene.settings, &mut workspace, none.0, none.1);
        (result.map_err(|error| error.to_string()), back.map_err(|error| error.to_string()))
    };
    let (forward, backward) = drawn(&scene, 15);
    assert!(forward.unwrap_err().contains("image has 45 numbers, expected 48"));
    assert!(backward.unwrap_err().contains("backward needs the workspace of a forward"));
    let (forward, backward) = drawn(&scene, 16);
    assert!(forward.is_ok() && backward.is_ok());
    let (mut image, mut alpha, mut drawn) = (vec![0.0; 48], vec![0.0; 16], vec![0.0; 32]);
    let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: Some(&mut drawn) };
    let error = rasterizer
        .forward(&features.gaussians(), &features.cameras(), &features.settings, &mut workspace, images)
        .unwrap_err();
    assert!(error.to_string().contains("features are drawn on the CPU only"), "{error}");
    let grouped = scene.clone().in_groups(1);
    let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
    let error = rasterizer
        .forward(&grouped.gaussians(), &grouped.cameras(), &grouped.settings, &mut workspace, images)
        .unwrap_err();
    assert!(error.to_string().contains("groups are drawn on the CPU only"), "{error}");
}

#[test]
fn limits_that_are_too_small_are_named() {
    let limits = wgpu::Limits { max_storage_buffer_binding_size: 16 << 10, ..wgpu::Limits::default() };
    let Some(narrow) = with_limits(limits) else { return println!("skipped: no adapter") };
    let refused = |scene: &Scene<f32>| {
        let (mut image, mut alpha) = (vec![0.0; 3 * scene.pixels()], vec![0.0; scene.pixels()]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let mut workspace = narrow.workspace();
        let (gaussians, cameras) = (scene.gaussians(), scene.cameras());
        narrow.forward(&gaussians, &cameras, &scene.settings, &mut workspace, images).unwrap_err().to_string()
    };
    let error = refused(&Scene::random(24, 300, 1, (8, 8), None).with_channels(0).to_f32());
    assert!(error.contains("max_storage_buffer_binding_size of 16384, 19200 are needed: 300 splats"), "{error}");
    let mut wide = Scene::random(24, 200, 1, (300, 16), None).with_channels(0).to_f32();
    wide.scales.iter_mut().for_each(|scale| *scale *= 10.0);
    let error = refused(&wide);
    assert!(error.contains("in one row of tiles"), "{error}");
}

/// An adapter that is not there is named with those that are.
#[test]
fn a_missing_adapter_is_named() {
    let asked = [Choice::Number(99), Choice::Name("no such device".into()), Choice::Name(String::new())];
    for choice in asked {
        let error = Context::open(&choice).unwrap_err();
        let GpuError::NoAdapter { found, .. } = &error else { panic!("{error}") };
        assert_eq!(*found, adapters());
        let text = error.to_string();
        assert!(text.contains(&choice.to_string()), "{text}");
        for adapter in found {
            assert!(text.contains(&adapter.name), "{text}");
        }
    }
}

/// A machine without a driver gets an empty list, and an error that names possible reasons. The process is another one,
/// for drivers are looked for once.
#[test]
fn a_machine_without_a_driver_has_no_adapters() {
    const CHILD: &str = "WEAVER_GPU_WITHOUT_DRIVER";
    if std::env::var_os(CHILD).is_some() {
        assert!(adapters().is_empty());
        for choice in [Choice::Fastest, Choice::Number(0), Choice::Name("llvmpipe".into())] {
            let error = Context::open(&choice).unwrap_err().to_string();
            assert!(error.contains("no adapter") && error.contains("driver"), "{error}");
        }
        return;
    }
    let mut child = std::process::Command::new(std::env::current_exe().unwrap());
    child.args(["--exact", "hostile::a_machine_without_a_driver_has_no_adapters"]).env(CHILD, "1");
    for variable in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        child.env(variable, "/nowhere/driver.json");
    }
    let done = child.output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stdout));
}

/// A device that another program has opened.
#[test]
fn a_device_of_ones_own_draws_the_same() {
    let Some(rasterizer) = rasterizer() else { return };
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY)).remove(0);
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
    let own = GpuRasterizer::new(Context::on(&adapter, device, queue).unwrap());
    let scene = Scene::random(26, 50, 1, (33, 20), Some(1)).with_channels(0).to_f32();
    let drawn = |rasterizer: &GpuRasterizer| render(rasterizer, &mut GpuWorkspace::default(), &scene);
    assert!(drawn(&own) == drawn(&rasterizer));
}

/// A device that is gone, and one whose memory does not suffice, are errors that name the adapter.
///
/// Promise (results): a lost device and memory that no buffer may have are errors.
#[test]
fn a_lost_device_is_an_error() {
    let Some(lost) = with_limits(wgpu::Limits::default()) else { return println!("skipped: no adapter") };
    let scene = Scene::random(27, 50, 1, (33, 20), Some(1)).with_channels(0).to_f32();
    let mut workspace = GpuWorkspace::default();
    render(&lost, &mut workspace, &scene);
    lost.context().device().destroy();
    let mut drawn = || {
        let (mut image, mut alpha) = (vec![0.0; 3 * scene.pixels()], vec![0.0; scene.pixels()]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let (gaussians, cameras) = (scene.gaussians(), scene.cameras());
        lost.forward(&gaussians, &cameras, &scene.settings, &mut workspace, images).unwrap_err().to_string()
    };
    // The second time as well, when buffers have to be made anew.
    for _ in 0..2 {
        let error = drawn();
        assert!(error.contains("failed:") && error.contains(&lost.context().adapter().name), "{error}");
    }
}

/// Promise of `a_lost_device_is_an_error`.
#[test]
fn memory_that_no_buffer_may_have_is_an_error() {
    let limits =
        wgpu::Limits { max_buffer_size: 256 << 10, max_storage_buffer_binding_size: 256 << 10, ..Default::default() };
    let Some(small) = with_limits(limits) else { return println!("skipped: no adapter") };
    // The image itself is too large.
    let scene = Scene::random(28, 5, 1, (200, 150), None).with_channels(0).to_f32();
    let (mut image, mut alpha) = (vec![0.0; 3 * scene.pixels()], vec![0.0; scene.pixels()]);
    let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
    let (gaussians, cameras) = (scene.gaussians(), scene.cameras());
    let mut workspace = small.workspace();
    let error = small.forward(&gaussians, &cameras, &scene.settings, &mut workspace, images).unwrap_err().to_string();
    assert!(error.contains("max_buffer_size of 262144, 600000 are needed: pixels"), "{error}");
}
