//! A fit that stays on the device, against the same steps on the CPU.

use crate::device::{decided, rasterizer, rounded};
use crate::scene::{Planes, Scene, relative};
use proptest::prelude::*;
use weaver_fit::{DeviceFit, FitRasterizer, Fitted, FittedRates, PhotoLoss, PhotoStep};
use weaver_kernels::Real;
use weaver_kernels::optim::AdamW;
use weaver_kernels::random::Stream;
use weaver_losses::Photometric;
use weaver_splat::{GaussianStatistics, RasterSettings, Workspace};

/// Rates that move every parameter visibly.
const RATES: FittedRates =
    FittedRates { means: 2e-3, quats: 2e-3, scales: 1e-2, opacities: 2e-2, sh: 1e-2, sh_rest: 5e-4 };

/// Stored parameters and their moments: means, quaternions, logarithms of scales, logits, harmonics.
#[derive(Clone, Debug, PartialEq)]
struct Stored<T>([[Vec<T>; 3]; 5]);

/// A scene whose Gaussians are stored, and a photo of it.
#[derive(Clone)]
struct Example {
    scene: Scene<f64>,
    rgb: Vec<u8>,
    mask: Option<Vec<bool>>,
    weight: f64,
    regularizer: [f32; 2],
}

impl<T: Real> Stored<T> {
    fn of(scene: &Scene<T>) -> Self {
        let with_moments = |values: Vec<T>| {
            let zeros = vec![T::ZERO; values.len()];
            [values, zeros.clone(), zeros]
        };
        let logs = scene.scales.iter().map(|s| T::from_f64(s.to_f64().ln())).collect();
        let logits = scene.opacities.iter().map(|o| T::from_f64((o.to_f64() / (1.0 - o.to_f64())).ln())).collect();
        Self([scene.means.clone(), scene.quats.clone(), logs, logits, scene.colors.clone()].map(with_moments))
    }

    /// The scene as it is drawn.
    fn activate(&self, scene: &mut Scene<T>) {
        let [means, quats, logs, logits, colors] = &self.0;
        scene.means.clone_from(&means[0]);
        scene.quats.clone_from(&quats[0]);
        scene.scales = logs[0].iter().map(|x| x.exp()).collect();
        scene.opacities = logits[0].iter().map(|x| T::ONE / (T::ONE + (T::ZERO - *x).exp())).collect();
        scene.colors.clone_from(&colors[0]);
    }
}

impl Example {
    fn new(seed: u64, n: usize, size: (usize, usize), degree: usize, masked: bool) -> Self {
        let mut scene = rounded(&Scene::random(seed, n, 1, size, Some(degree)).with_channels(0));
        scene.opacities.iter_mut().for_each(|opacity| *opacity = opacity.clamp(1e-3, 0.98));
        // The photo of other Gaussians nearby.
        let mut other = Scene::random(seed, n, 1, size, Some(degree)).with_channels(0);
        let stream = Stream::new(seed, 1, "gpu.photo");
        other.colors.iter_mut().enumerate().for_each(|(i, x)| *x += 0.3 * stream.normal::<f64>(i as u64));
        let rgb = other.render().image.iter().map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8).collect();
        let mask = masked.then(|| (0..size.0 * size.1).map(|i| stream.below(i as u64, 5) != 0).collect());
        Self { scene, rgb, mask, weight: 0.2, regularizer: [1e-4, 2e-4] }
    }

    fn step<'a>(&'a self, single: &'a Scene<f32>, step: u64) -> PhotoStep<'a> {
        PhotoStep {
            camera: single.cameras(),
            settings: &self.scene.settings,
            rgb: &self.rgb,
            mask: self.mask.as_deref(),
            ssim_weight: self.weight,
            regularizer: self.regularizer,
            step,
            rates: RATES,
            statistics: true,
        }
    }

    /// The loss and gradients with respect to the stored form, on the CPU; statistics.
    fn on_cpu<T: Real>(&self, scene: &Scene<T>) -> (f64, f64, [Vec<T>; 5], Vec<T>) {
        let mut workspace = Workspace::new();
        let (mut drawn, _) = scene.render_in(&mut workspace);
        let mut target: Vec<T> = self.rgb.iter().map(|x| T::from_f64(f64::from(*x) / 255.0)).collect();
        let masked = |i: usize| self.mask.as_ref().is_some_and(|mask| !mask[i / 3]);
        for i in (0..target.len()).filter(|i| masked(*i)) {
            drawn.image[i] = T::from_f64(drawn.image[i].to_f64().clamp(0.0, 1.0));
            target[i] = drawn.image[i];
        }
        let mut gradient = vec![T::ZERO; target.len()];
        let size = [scene.height, scene.width];
        let value = Photometric::new().value_and_gradient(&drawn.image, &target, size, self.weight, &mut gradient);
        gradient.iter_mut().enumerate().filter(|(i, _)| masked(*i)).for_each(|(_, g)| *g = T::ZERO);
        let square = |(a, b): (&T, &T)| (a.to_f64().clamp(0.0, 1.0) - b.to_f64()).powi(2);
        let mse = drawn.image.iter().zip(&target).map(square).sum::<f64>() / target.len() as f64;
        let none = vec![T::ZERO; scene.pixels()];
        let cotangents = Planes { image: gradient, alpha: none.clone(), depth: none, features: Vec::new() };
        let [means, quats, mut scales, mut opacities, colors, .., statistics] =
            scene.gradients_in(&cotangents, &mut workspace);
        let [by_opacity, by_scale] = self.regularizer.map(|x| T::from_f64(f64::from(x)));
        scales.iter_mut().zip(&scene.scales).for_each(|(g, s)| *g = (*g + by_scale) * *s);
        opacities.iter_mut().zip(&scene.opacities).for_each(|(g, o)| *g = (*g + by_opacity) * *o * (T::ONE - *o));
        (value.loss, mse, [means, quats, scales, opacities, colors], statistics)
    }
}

/// The fit on the device, with the stored form loaded.
fn loaded(stored: &Stored<f32>, degree: usize) -> Option<Box<dyn DeviceFit>> {
    let mut fit = rasterizer()?.device_fit().expect("a device has one");
    let [means, quats, log_scales, logits, sh] = stored.0.each_ref().map(|field| field.each_ref().map(|x| &x[..]));
    fit.load(&Fitted { means, quats, log_scales, logits, sh, degree }).unwrap_or_else(|error| panic!("{error}"));
    Some(fit)
}

/// The numbers on the device.
fn fetched(fit: &mut dyn DeviceFit, like: &Stored<f32>, degree: usize) -> (Stored<f32>, Vec<f32>) {
    let mut stored = like.clone();
    let mut statistics = vec![GaussianStatistics::default(); like.0[3][0].len()];
    let [means, quats, log_scales, logits, sh] = stored.0.each_mut().map(|field| field.each_mut().map(|x| &mut x[..]));
    let gaussians = Fitted { means, quats, log_scales, logits, sh, degree };
    fit.store(gaussians, &mut statistics).unwrap_or_else(|error| panic!("{error}"));
    (stored, crate::scene::flatten(&statistics))
}

const FIELDS: [&str; 5] = ["means", "quats", "log_scales", "logits", "sh"];

fn close(name: &str, ours: f64, theirs: f64) -> Result<(), TestCaseError> {
    prop_assert!((ours - theirs).abs() <= 1e-5 + 1e-4 * theirs.abs(), "{name}: {ours}, on the CPU {theirs}");
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 32, failure_persistence: None, ..Default::default() })]

    /// Loss, gradients (ten times Adam's first moments) and statistics equal the CPU's; Adam's step is right; and the
    /// next step draws the stored result of the first one.
    #[test]
    fn a_step_is_that_of_the_cpu(
        seed: u64,
        n in 1_usize..150,
        size in (1_usize..50, 1_usize..40),
        degree in 0_usize..=3,
        weight in prop::sample::select(vec![0.0, 0.2, 1.0]),
        masked: bool,
        antialiased: bool,
    ) {
        let mut example = Example { weight, ..Example::new(seed, n, size, degree, masked) };
        example.scene.settings = RasterSettings { antialiased, ..RasterSettings::default() };
        let stored = Stored::of(&example.scene.to_f32());
        // From the numbers that `f32` stores, so that both begin with the same ones.
        let exact_stored = Stored(stored.0.clone().map(|field| field.map(|x| x.iter().map(|x| f64::from(*x)).collect())));
        exact_stored.activate(&mut example.scene);
        // Where rounding decides, the photo does not count.
        let decided = decided(&example.scene);
        if decided.contains(&false) {
            let mask = example.mask.get_or_insert_with(|| vec![true; decided.len()]);
            mask.iter_mut().zip(decided).filter(|(_, decided)| !decided).for_each(|(mask, _)| *mask = false);
        }
        let mut single = example.scene.to_f32();
        stored.activate(&mut single);
        let Some(mut fit) = loaded(&stored, degree) else { return Ok(()) };
        let found = fit.step(&example.step(&single, 1)).unwrap();
        let (after, statistics) = fetched(&mut *fit, &stored, degree);

        let (loss, mse, gradients, expected_statistics) = example.on_cpu(&example.scene);
        let (.., of_f32, _) = example.on_cpu(&single);
        close("loss", found.loss, loss)?;
        close("mse", found.mse, mse)?;
        for (i, name) in FIELDS.iter().enumerate() {
            let [values, first, second] = &after.0[i];
            let gradient: Vec<f32> = first.iter().map(|m| 10.0 * m).collect();
            let (error, of_rounding) = (relative(&gradient, &gradients[i], 1e-6), relative(&of_f32[i], &gradients[i], 1e-6));
            prop_assert!(error <= 1e-4_f64.max(2.0 * of_rounding), "{name}: {error:e}, on the CPU {of_rounding:e}");
            let width = values.len() / n;
            for (k, value) in values.iter().enumerate() {
                let rate = [RATES.means, RATES.quats, RATES.scales, RATES.opacities][i.min(3)];
                let rate = if i < 4 { rate } else if k % width < 3 { RATES.sh } else { RATES.sh_rest };
                let (g, v) = (f64::from(gradient[k]), f64::from(second[k]));
                // Squares below the smallest normal number may be zero.
                if g.abs() > 1e-15 {
                    prop_assert!((v - 1e-3 * g * g).abs() <= 1e-5 * v, "{name}: second moment {v:e} of {g:e}");
                    let expected = f64::from(stored.0[i][0][k]) - f64::from(rate) * g.signum();
                    let error = (f64::from(*value) - expected).abs();
                    prop_assert!(error <= 1e-6 * (1.0 + expected.abs()), "{name}: {value}, not {expected}");
                }
            }
        }
        let error = relative(&statistics, &expected_statistics, 1e-6);
        prop_assert!(error <= 1e-4, "statistics: {error:e}");

        // The next drawing starts from the stored numbers.
        let next = fit.step(&example.step(&single, 2)).unwrap();
        let moved = Stored(after.0.map(|field| field.map(|x| x.iter().map(|x| f64::from(*x)).collect())));
        moved.activate(&mut example.scene);
        let (loss, mse, ..) = example.on_cpu(&example.scene);
        // Here rounding may decide at some pixels.
        prop_assert!((next.loss - loss).abs() <= 1e-3 * (1.0 + loss), "{}, on the CPU {loss}", next.loss);
        prop_assert!((next.mse - mse).abs() <= 1e-3 * (1.0 + mse), "{}, on the CPU {mse}", next.mse);
    }
}

/// Fits an example for some steps on the device: losses of all steps, and the stored form at the end.
fn fitted(example: &Example, steps: u64, degree: usize) -> Option<(Vec<PhotoLoss>, Stored<f32>)> {
    let stored = Stored::of(&example.scene.to_f32());
    let mut fit = loaded(&stored, degree)?;
    let single = example.scene.to_f32();
    let losses = (1..=steps).map(|step| fit.step(&example.step(&single, step)).unwrap()).collect();
    Some((losses, fetched(&mut *fit, &stored, degree).0))
}

#[test]
fn a_fit_has_the_same_bits_every_time() {
    let example = Example::new(5, 120, (45, 33), 1, true);
    let Some(first) = fitted(&example, 12, 1) else { return };
    assert!(first.0.iter().all(|loss| loss.loss.is_finite()));
    for _ in 0..3 {
        assert!(fitted(&example, 12, 1).unwrap() == first, "another fit, other bits");
    }
}

/// A fit of so many steps ends within 0.1 dB of the same on the CPU.
#[test]
fn a_fit_ends_where_that_of_the_cpu_does() {
    let (n, steps) = if std::env::var_os("WEAVER_STRESS").is_some() { (2000, 300) } else { (300, 100) };
    let mut example = Example::new(6, n, (64, 48), 1, false);
    example.scene.scales.iter_mut().for_each(|scale| *scale *= 0.3);
    let Some((losses, _)) = fitted(&example, steps, 1) else { return };
    let psnr = |mse: f64| -10.0 * mse.log10();
    let (begin, on_device) = (psnr(losses[0].mse), psnr(losses.last().unwrap().mse));
    let mut single = example.scene.to_f32();
    let mut stored = Stored::of(&single);
    let mut on_cpu = f64::NAN;
    for step in 1..=steps {
        stored.activate(&mut single);
        let (_, mse, gradients, _) = example.on_cpu(&single);
        on_cpu = psnr(mse);
        let width = stored.0[4][0].len() / n;
        let harmonics: Vec<f32> = (0..width).map(|k| if k < 3 { RATES.sh } else { RATES.sh_rest }).collect();
        let rates = [RATES.means, RATES.quats, RATES.scales, RATES.opacities, 1.0];
        for (i, ([values, first, second], gradient)) in stored.0.iter_mut().zip(&gradients).enumerate() {
            let adam =
                AdamW { rate: rates[i], beta1: 0.9, beta2: 0.999, eps: 1e-15, weight_decay: 0.0, gradient_scale: 1.0 };
            match i {
                4 => adam.step_columns(step, values, gradient, first, second, &harmonics),
                _ => adam.step(step, values, gradient, first, second),
            }
        }
    }
    println!("{begin:.3} dB to {on_device:.3} dB, on the CPU {on_cpu:.3} dB");
    assert!(on_device > begin + 3.0, "{begin} to {on_device}");
    assert!((on_device - on_cpu).abs() < 0.1, "{on_device}, on the CPU {on_cpu}");
}

/// A photo that a fit cannot take is refused, and the fit stays usable.
#[test]
fn photos_that_do_not_fit_are_refused() {
    let example = Example::new(7, 10, (20, 15), 0, false);
    let stored = Stored::of(&example.scene.to_f32());
    let Some(mut fit) = loaded(&stored, 0) else { return };
    let single = example.scene.to_f32();
    let short = PhotoStep { rgb: &example.rgb[3..], ..example.step(&single, 1) };
    let error = fit.step(&short).unwrap_err().to_string();
    assert!(error.contains("one photo of 20 x 15 pixels"), "{error}");
    assert!(fit.step(&example.step(&single, 1)).is_ok());
}
