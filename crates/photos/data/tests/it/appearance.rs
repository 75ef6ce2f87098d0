//! Drawn light and passers-by: their arguments, and the pixels that context views see.

use weaver_data::appearance::{Appearance, Look, Occluder, seen};
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_io::Image;
use weaver_kernels::random::Stream;

const SIZE: [usize; 2] = [32, 24];

fn drawn(seed: u64) -> Appearance {
    Appearance::drawn(Stream::new(seed, 0, "test"), SIZE, 3)
}

#[test]
fn draws_are_within_what_is_said_of_them() {
    let (mut gammas, mut counts) = (Vec::new(), [0; 4]);
    for seed in 0..500 {
        let Appearance { look, occluders } = drawn(seed);
        counts[occluders.len()] += 1;
        gammas.push(look.gamma);
        let logs = look.gain.map(f64::ln);
        assert!(logs.iter().all(|log| (-0.95..=0.65).contains(log)));
        // The common part of all channels is -0.7 to 0.4, the rest within 0.25 of it.
        let spread = logs.iter().copied().fold(f64::MIN, f64::max) - logs.iter().copied().fold(f64::MAX, f64::min);
        assert!(spread <= 0.5);
        for Occluder { at, size, color } in occluders {
            for axis in 0..2 {
                let share = size[axis] as f64 / SIZE[axis] as f64;
                assert!((0.05..0.29).contains(&share) && at[axis] + size[axis] <= SIZE[axis]);
            }
            assert!(color.iter().all(|c| (0.0..1.0).contains(c)));
        }
    }
    assert!(counts.iter().all(|count| (90..170).contains(count)), "{counts:?}");
    let (low, high) = gammas.iter().fold((f64::MAX, f64::MIN), |(a, b), g| (a.min(*g), b.max(*g)));
    assert!(low > (-0.3f64).exp() && low < 0.76 && high < 0.3f64.exp() && high > 1.33, "{low} {high}");
}

/// A photo shows its look and its occluders and nothing where it does not count.
#[test]
fn looks_and_occluders_show_inside_masks_alone() {
    let plain = Image { width: 4, height: 2, pixels: (0..24).map(|i| i as f32 / 24.0).collect() };
    let look = Look { gain: [0.5, 1.0, 3.0], gamma: 2.0 };
    let color = [0.1, 0.9, 0.3];
    let appearance = Appearance { look, occluders: vec![Occluder { at: [1, 0], size: [2, 1], color }] };
    assert_eq!(appearance.uncovered([4, 2]), [true, false, false, true, true, true, true, true]);
    let mut inside = [true; 8];
    inside[7] = false;
    let photo = appearance.photo(&plain, Some(&inside));
    for (i, shown) in photo.pixels.chunks(3).enumerate() {
        for (channel, shown) in shown.iter().enumerate() {
            let before = f64::from(plain.pixels[3 * i + channel]);
            let expected = match i {
                1 | 2 => f64::from(color[channel]),
                7 => before,
                _ => (look.gain[channel] * before * before).min(1.0),
            };
            assert!((f64::from(*shown) - expected).abs() < 1e-6, "{i} {channel}");
        }
    }
    assert_eq!(Appearance { look: Look::PLAIN, occluders: Vec::new() }.photo(&plain, None).pixels, plain.pixels);
}

#[test]
fn what_a_view_shares_is_decided_by_depth() {
    let scene = scene(5, &ProceduralOptions { width: SIZE[0], height: SIZE[1], views: 8 });
    let all = |_: usize, _: usize| true;
    // A view sees all that it shows itself.
    assert!(seen(&scene, 2, &[2], all).unwrap().iter().all(|seen| *seen));
    // Not all is seen from far off, more from both sides; the sky counts as seen.
    let count = |context: &[usize]| seen(&scene, 2, context, all).unwrap().iter().filter(|seen| **seen).count();
    let (far, near, both) = (count(&[7]), count(&[1]), count(&[1, 3]));
    assert!(far < near && near < both && both <= SIZE[0] * SIZE[1], "{far} {near} {both}");
    let sky: Vec<bool> = scene.views[2].depth.as_ref().unwrap().iter().map(|z| *z == 0.0).collect();
    let nothing = seen(&scene, 2, &[1], |_, _| false).unwrap();
    assert_eq!(nothing, sky);
    // Where depth is not known of every pixel, nothing can be said.
    let mut sparse = scene.clone();
    sparse.views[1].instances = None;
    assert_eq!(seen(&sparse, 2, &[1], all), None);
}
