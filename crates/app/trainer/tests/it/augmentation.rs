//! Training tuples varied: values that follow, exactly, and values that stay.

use crate::config;
use weaver_data::{Layout, Scene, Tuple};
use weaver_geometry::glam::DVec2;
use weaver_kernels::random::Stream;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::ActivatedGaussians;
use weaver_splat::{RasterSettings, Workspace, render};
use weaver_trainer::{Augmentation, Config, Example, Session};

const OFF: Augmentation = Augmentation { crop: 1.0, flip: 0.0, color: 0.0, order: false };
const SIZE: [usize; 2] = [24, 16];

fn photographed() -> Scene {
    scene(2, &ProceduralOptions { width: SIZE[0], height: SIZE[1], views: 6 })
}

fn example(scene: &Scene) -> Example {
    let tuple = Tuple { scene: 0, context: vec![0, 1, 3], targets: vec![4] };
    Example::new(scene, &Layout::of(scene), tuple).unwrap()
}

fn varied(augmentation: &Augmentation, seed: u64) -> Example {
    let mut found = example(&photographed());
    augmentation.apply(&mut found, Stream::new(seed, 0, "augmentation"));
    found
}

/// Promise of `a_mirrored_scene_rendered_is_the_render_mirrored`.
#[test]
fn what_is_off_changes_no_bit() {
    let plain = example(&photographed());
    let found = varied(&OFF, 5);
    assert_eq!((&found.images, &found.depth, &found.cameras), (&plain.images, &plain.depth, &plain.cameras));
    let tuple = Tuple { scene: 0, context: vec![4, 2, 7], targets: vec![1] };
    assert_eq!(OFF.ordered(tuple.clone(), Stream::new(1, 2, "augmentation")), tuple);
    assert_eq!(Augmentation::default(), OFF);
}

/// Promise (options): augmentation moves cameras with their photos and points, and changes nothing where it is off.
#[test]
fn a_mirrored_scene_rendered_is_the_render_mirrored() {
    let (plain, found) = (example(&photographed()), varied(&Augmentation { flip: 1.0, ..OFF }, 0));
    let [width, height] = SIZE;
    let flipped =
        |values: &[f32]| -> Vec<f32> { values.chunks(width).flat_map(|row| row.iter().rev()).copied().collect() };
    assert_eq!((found.images, found.depth), (flipped(&plain.images), flipped(&plain.depth)));
    assert_ne!(found.cameras, plain.cameras);
    // Gaussians before the first camera, and their mirror images.
    let stream = Stream::new(3, 0, "gaussians");
    let number = |i: usize| stream.uniform::<f32>(i as u64);
    let count = 40;
    let mean = |i: usize| [number(8 * i) - 0.5, number(8 * i + 1) - 0.5, 1.0 + number(8 * i + 2)];
    let gaussians = |mirrored: bool| {
        let sign = if mirrored { -1.0 } else { 1.0 };
        let quat = |i: usize| {
            let q = [0, 1, 2, 3].map(|k| number(1000 + 4 * i + k) - 0.3);
            let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
            [q[0] / norm, q[1] / norm, sign * q[2] / norm, sign * q[3] / norm]
        };
        ActivatedGaussians {
            means: (0..count).flat_map(|i| [sign * mean(i)[0], mean(i)[1], mean(i)[2]]).collect(),
            scales: (0..3 * count).map(|i| 0.02 + 0.1 * number(2000 + i)).collect(),
            quats: (0..count).flat_map(quat).collect(),
            opacities: (0..count).map(|i| 0.2 + 0.7 * number(3000 + i)).collect(),
            sh: (0..3 * count).map(|i| number(4000 + i) - 0.5).collect(),
            degree: 0,
        }
    };
    let drawn = |mirrored: bool, cameras: &[weaver_geometry::Camera]| {
        render(&gaussians(mirrored), cameras, [1.0; 3], &RasterSettings::default(), &mut Workspace::new()).unwrap()
    };
    let (before, after) = (drawn(false, &plain.cameras), drawn(true, &found.cameras));
    assert_eq!((before.len(), after.len()), (4, 4));
    for (before, after) in before.iter().zip(&after) {
        assert!(before.iter().any(|x| *x < 0.9), "something is seen");
        for y in 0..height {
            for x in 0..width {
                let [a, b] = [&before[3 * (y * width + x)..][..3], &after[3 * (y * width + width - 1 - x)..][..3]];
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{x} {y}: {a:?} {b:?}");
            }
        }
    }
}

/// Promise of `a_mirrored_scene_rendered_is_the_render_mirrored`.
#[test]
fn what_a_crop_shows_lies_where_its_cameras_say() {
    let mut plain = example(&photographed());
    // Colors and depths that encode their direction.
    let pixels = SIZE[0] * SIZE[1];
    let seen = |i: usize, camera: &weaver_geometry::Camera| {
        let at = DVec2::new((i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5);
        let direction = camera.intrinsics.unproject(at, 1.0);
        [0.5 + 0.6 * direction.x, 0.5 + 0.6 * direction.y, 0.5].map(|x| x as f32)
    };
    for (view, camera) in plain.cameras.iter().enumerate() {
        for i in 0..pixels {
            for c in 0..3 {
                plain.images[(3 * view + c) * pixels + i] = seen(i, camera)[c];
            }
            if view < 3 {
                plain.depth[view * pixels + i] = 1.0 + seen(i, camera)[0];
            }
        }
    }
    let mut sides = Vec::new();
    for seed in 0..8 {
        let mut found = plain.clone();
        Augmentation { crop: 0.5, ..OFF }.apply(&mut found, Stream::new(seed, 0, "augmentation"));
        let zoom = found.cameras[0].intrinsics.fx / plain.cameras[0].intrinsics.fx;
        assert!((1.0..2.0001).contains(&zoom), "{zoom}");
        sides.push(zoom);
        for (view, camera) in found.cameras.iter().enumerate() {
            let of_view = camera.intrinsics.fx / plain.cameras[view].intrinsics.fx;
            assert!((of_view - zoom).abs() < 1e-12 && camera.pose == plain.cameras[view].pose);
            for i in 0..pixels {
                let expected = seen(i, camera);
                let apart = (0..3).map(|c| (found.images[(3 * view + c) * pixels + i] - expected[c]).abs());
                assert!(apart.fold(0.0, f32::max) < 0.03, "{seed} {view} {i}");
                // Depth is constant within a source pixel, which a crop enlarges.
                let of_pixel = 0.6 / camera.intrinsics.fx * zoom;
                let depth = view < 3 && (found.depth[view * pixels + i] - 1.0 - expected[0]).abs() > of_pixel as f32;
                assert!(!depth, "{seed} {view} {i}");
            }
        }
    }
    sides.sort_by(f64::total_cmp);
    sides.dedup();
    assert_eq!(sides.len(), 8);
}

#[test]
fn all_photos_of_a_tuple_are_recolored_alike() {
    let plain = example(&photographed());
    let pixels = SIZE[0] * SIZE[1];
    let color = |images: &[f32], view: usize, i: usize| [0, 1, 2].map(|c| images[(3 * view + c) * pixels + i]);
    let mut with_patch = plain.clone();
    for view in 0..4 {
        (0..3).for_each(|c| with_patch.images[(3 * view + c) * pixels + 7] = [0.2, 0.5, 0.7][c]);
    }
    with_patch.inside = Some((0..4 * pixels).map(|i| i % pixels != 9).collect());
    let mut patches = Vec::new();
    for seed in 0..6 {
        let mut found = with_patch.clone();
        Augmentation { color: 0.3, ..OFF }.apply(&mut found, Stream::new(seed, 0, "augmentation"));
        let patch = color(&found.images, 0, 7);
        assert!((0..4).all(|view| color(&found.images, view, 7) == patch), "{seed}");
        assert!((0..4).all(|view| color(&found.images, view, 9) == color(&with_patch.images, view, 9)), "masked");
        assert!(found.images.iter().all(|x| (0.0..=1.0).contains(x)));
        assert_eq!((found.cameras, found.depth), (with_patch.cameras.clone(), with_patch.depth.clone()));
        patches.push(patch.map(f32::to_bits));
    }
    patches.sort_unstable();
    patches.dedup();
    assert_eq!(patches.len(), 6);
}

/// The order of the context is random and nothing else.
#[test]
fn only_the_order_of_the_context_is_random() {
    let tuple = Tuple { scene: 0, context: vec![1, 2, 3], targets: vec![8, 9] };
    let shuffled = Augmentation { order: true, ..OFF };
    let mut firsts = [0; 4];
    for step in 0..300 {
        let found = shuffled.ordered(tuple.clone(), Stream::new(0, step, "augmentation"));
        let mut sorted = found.context.clone();
        sorted.sort_unstable();
        assert_eq!((sorted, &found.targets), (vec![1, 2, 3], &tuple.targets));
        firsts[found.context[0]] += 1;
    }
    assert!(firsts[1..].iter().all(|n| *n > 60), "{firsts:?}");
}

#[test]
fn runs_with_augmentation_resume_to_the_same_bits() {
    let with = |augmentation: &Augmentation| {
        let mut config: Config<_> = config(6);
        config.data.augmentation = augmentation.clone();
        config
    };
    let all = Augmentation { crop: 0.6, flip: 0.5, color: 0.2, order: true };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.safetensors");
    let mut first = Session::new(with(&all)).unwrap();
    (0..3).for_each(|_| _ = first.advance().unwrap().unwrap());
    first.save(&path).unwrap();
    let mut second = Session::resume(with(&all), &path).unwrap();
    let single = [
        Augmentation { crop: 0.6, ..OFF },
        Augmentation { flip: 0.5, ..OFF },
        Augmentation { color: 0.2, ..OFF },
        Augmentation { order: true, ..OFF },
        OFF,
    ];
    let mut others = single.map(|one| Session::new(with(&one)).unwrap());
    for session in [&mut first, &mut second].into_iter().chain(&mut others) {
        while session.advance().unwrap().is_some() {}
    }
    assert_eq!(first.checksum(), second.checksum());
    let mut sums: Vec<String> = others.iter().chain([&first]).map(Session::checksum).collect();
    sums.sort();
    sums.dedup();
    assert_eq!(sums.len(), 6, "each changes what is trained");
}
