//! Properties that hold for any scene.

use super::cloud::{Cloud, apart, camera, disturbed, photo};
use rayon::ThreadPoolBuilder;
use weaver_fit::align::{Aligned, Method, Options, Photo, Scene, align, mean_square};
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Pose, se3};
use weaver_splat::CpuRasterizer;

fn run(scene: &Scene<'_, f64>, photos: &[Photo<'_, f64>], options: &Options) -> Vec<Aligned<f64>> {
    align(&CpuRasterizer, scene, photos, options, mean_square).unwrap()
}

const METHODS: [Method; 3] = [Method::Own, Method::NoPoSplat, Method::TwoXplat];

#[test]
fn a_camera_that_is_right_stays() {
    let cloud = Cloud::new(60, 2, 1);
    let pixels = cloud.draw(&camera());
    for method in METHODS {
        let options = Options { steps: 100, ..Options::of(method) };
        let aligned = run(&cloud.scene(), &[photo(&pixels, camera())], &options);
        assert!(apart(&aligned[0].camera, &camera()).iter().all(|x| *x < 1e-9), "{method:?}");
        assert!(aligned[0].loss[1] < 1e-20);
    }
}

/// The first step is against the gradient of the whole chain.
#[test]
fn the_first_step_is_against_the_gradient() {
    // The sign of each number of the first step of Adam is the sign of a difference of losses.
    for degree in [0, 3] {
        let cloud = Cloud::new(60, degree, 2);
        let pixels = cloud.draw(&camera());
        let guess = disturbed(&camera(), 3.0, 5);
        let options = Options { steps: 1, ..Options::of(Method::NoPoSplat) };
        let first = &run(&cloud.scene(), &[photo(&pixels, guess)], &options)[0];
        let (v, w) = se3::log(&first.camera.pose.relative_to(&guess.pose));
        let step = [v.x, v.y, v.z, w.x, w.y, w.z];
        let loss = |x: [f64; 6]| {
            let pose = se3::exp(DVec3::new(x[0], x[1], x[2]), DVec3::new(x[3], x[4], x[5])).compose(&guess.pose);
            let image = cloud.draw(&Camera { pose, ..guess });
            image.iter().zip(&pixels).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / pixels.len() as f64
        };
        assert!((first.loss[0] - loss([0.0; 6])).abs() < 1e-15);
        for i in 0..6 {
            let at = |h: f64| loss(std::array::from_fn(|j| if i == j { h } else { 0.0 }));
            let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((step[i] + 5e-3 * difference.signum()).abs() < 2e-5, "{i}: {step:?} {difference}");
        }
    }
}

#[test]
fn a_world_that_is_moved_changes_nothing() {
    let cloud = Cloud::new(60, 0, 3);
    let pixels = cloud.draw(&camera());
    let guess = disturbed(&camera(), 3.0, 7);
    let options = Options { steps: 30, ..Options::of(Method::Own) };
    let path = &run(&cloud.scene(), &[photo(&pixels, guess)], &options)[0];
    let motion = Pose::new(DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7), DVec3::new(0.3, -2.0, 1.0));
    let turn = [0.9_f64, 0.1, -0.2, 0.3];
    let motion = Pose::from_wxyz(turn, motion.translation);
    let mut moved = Cloud::new(60, 0, 3);
    for mean in moved.means.chunks_mut(3) {
        mean.copy_from_slice(&motion.apply(DVec3::new(mean[0], mean[1], mean[2])).to_array());
    }
    for q in moved.quats.chunks_mut(4) {
        let [a, b, c, d] = turn;
        let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
        q.copy_from_slice(&[
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]);
    }
    let there = Camera { pose: guess.pose.compose(&motion.inverse()), ..guess };
    let other = &run(&moved.scene(), &[photo(&pixels, there)], &options)[0];
    let back = Camera { pose: other.camera.pose.compose(&motion), ..there };
    assert!(apart(&back, &path.camera).iter().all(|x| *x < 1e-7), "{:?}", apart(&back, &path.camera));
    assert!(path.losses.iter().zip(&other.losses).all(|(a, b)| (a - b).abs() < 1e-9 * (1.0 + a)));
}

#[test]
fn a_world_of_another_size_changes_nothing() {
    let cloud = Cloud::new(60, 0, 3);
    let pixels = cloud.draw(&camera());
    let guess = disturbed(&camera(), 3.0, 7);
    let options = Options { steps: 30, ..Options::of(Method::Own) };
    let path = &run(&cloud.scene(), &[photo(&pixels, guess)], &options)[0];
    let mut large = Cloud::new(60, 0, 3);
    large.means.iter_mut().chain(&mut large.scales).for_each(|x| *x *= 8.0);
    let there = Camera { pose: guess.pose.scaled(8.0), ..guess };
    let other = &run(&large.scene(), &[photo(&pixels, there)], &options)[0];
    let back = Camera { pose: other.camera.pose.scaled(0.125), ..there };
    assert!(apart(&back, &path.camera).iter().all(|x| *x < 1e-7), "{:?}", apart(&back, &path.camera));
    assert!((other.moved[1] - path.moved[1]).abs() < 1e-7);
}

#[test]
fn two_xplat_returns_what_it_drew_last() {
    let cloud = Cloud::new(60, 0, 3);
    let pixels = cloud.draw(&camera());
    let guess = disturbed(&camera(), 0.5, 7);
    let of = |steps| {
        let options = Options { steps, ..Options::of(Method::TwoXplat) };
        run(&cloud.scene(), &[photo(&pixels, guess)], &options).remove(0)
    };
    let aligned = of(10);
    // The tenth camera, which nine updates made, and its loss.
    assert_eq!(aligned.losses.len(), 10);
    assert_eq!(aligned.losses[9], aligned.loss[1]);
    assert_eq!(of(1).camera, guess);
}

#[test]
fn photos_know_nothing_of_one_another() {
    let cloud = Cloud::new(60, 1, 4);
    let cameras = [camera(), disturbed(&camera(), 20.0, 1)];
    let pixels = cameras.map(|camera| cloud.draw(&camera));
    let guesses = [disturbed(&cameras[0], 2.0, 2), disturbed(&cameras[1], 2.0, 3)];
    let photos = [photo(&pixels[0], guesses[0]), photo(&pixels[1], guesses[1])];
    let options = Options { steps: 20, intrinsics: true, ..Options::of(Method::Own) };
    let bits = |threads: usize, photos: &[Photo<'_, f64>]| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let aligned = pool.install(|| run(&cloud.scene(), photos, &options));
        aligned.into_iter().map(|a| (a.camera, a.losses)).collect::<Vec<_>>()
    };
    let one = bits(1, &photos);
    assert_eq!(one, bits(3, &photos));
    let mut turned = bits(2, &[photos[1], photos[0]]);
    turned.reverse();
    assert_eq!(one, turned);
}

#[test]
fn what_is_masked_does_not_matter() {
    let cloud = Cloud::new(60, 0, 5);
    let mut pixels = cloud.draw(&camera());
    let guess = disturbed(&camera(), 2.0, 3);
    let mask: Vec<bool> = (0..64 * 48).map(|at| at % 64 >= 20).collect();
    let options = Options { steps: 20, ..Options::of(Method::Own) };
    let masked = |pixels: &[f64]| {
        let photo = Photo { mask: Some(&mask), ..photo(pixels, guess) };
        run(&cloud.scene(), &[photo], &options).remove(0)
    };
    let before = masked(&pixels);
    for at in (0..64 * 48).filter(|at| !mask[*at]) {
        pixels[3 * at..3 * at + 3].fill(0.9);
    }
    let after = masked(&pixels);
    assert_eq!((before.camera, &before.losses), (after.camera, &after.losses));
    assert!(after.loss[1] < 0.5 * after.loss[0]);
}
