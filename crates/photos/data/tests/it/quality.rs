//! Baselines that need no model: the training views' mean color, and the nearest context view copied.

use weaver_data::{Scene, evaluation_tuples};

/// Peak signal-to-noise ratio of values in [0, 1], dB.
pub fn psnr(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let error: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    -10.0 * (error / a.len() as f64).log10()
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len() as f64;
    values.sum::<f64>() / n
}

/// Mean over scenes of the mean over held-out views of the nearest context view's PSNR.
pub fn nearest_copied(scenes: &[Scene]) -> f64 {
    mean(scenes.iter().map(|scene| {
        let tuples = evaluation_tuples(scene, 0, 4);
        mean(tuples.iter().map(|tuple| {
            let (target, copy) = (&scene.views[tuple.targets[0]], &scene.views[tuple.context[0]]);
            psnr(&target.image.pixels, &copy.image.pixels)
        }))
    }))
}

/// Mean over scenes of the mean over held-out views of the PSNR of the training views' mean color.
pub fn mean_color(scenes: &[Scene]) -> f64 {
    mean(scenes.iter().map(|scene| {
        let mut sum = [0.0_f64; 3];
        let mut count = 0.0;
        for view in scene.training_views() {
            for pixel in scene.views[view].image.pixels.chunks_exact(3) {
                count += 1.0;
                sum.iter_mut().zip(pixel).for_each(|(s, &p)| *s += f64::from(p));
            }
        }
        let color = sum.map(|s| (s / count) as f32);
        let held_out = scene.held_out_views();
        mean(held_out.iter().map(|&view| {
            let image = &scene.views[view].image;
            psnr(&image.pixels, &color.repeat(image.width * image.height))
        }))
    }))
}
