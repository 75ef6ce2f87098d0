//! Methods: real bytes, and a scene from these alone.

use crate::scenes::{cameras, pictures, scene};
use proptest::prelude::*;
use weaver_compress::Judge;
use weaver_compression::{METHODS, Method, Point, Task, formats};
use weaver_io::safetensors::Tensors;
use weaver_scene::Gaussians;

/// The methods that train.
const TRAINED: [&str; 5] = ["lightgaussian", "mesongs", "c3dgs", "speedysplat", "haclite"];

/// All points of all methods and formats, by name.
fn points() -> Vec<(String, Box<dyn Method>)> {
    let families = METHODS.iter().flat_map(|family| (family.points)().into_iter().map(|point| (family.name, point)));
    let all = formats().into_iter().chain(families);
    all.map(|(name, point)| (format!("{name} {}", point.setting), point.method)).collect()
}

#[test]
fn bytes_alone_give_back_pictures() {
    let gaussians = scene(400, 3);
    let cameras = cameras(&gaussians);
    let mut judge = Judge::new(&gaussians, &pictures(&cameras)).unwrap();
    let task = Task { gaussians: &gaussians, pictures: pictures(&cameras), photos: &[], steps: 20, seed: 1 };
    for (name, method) in points() {
        let bytes = method.encode(&task).unwrap();
        let decoded = method.decode(&bytes).unwrap();
        assert!(decoded.lengths_agree() && !decoded.is_empty() && decoded.len() <= 400, "{name}");
        // Networks predict random numbers badly.
        let much = ["half-random", "haclite"].iter().any(|other| name.starts_with(other)) || name.contains("soft");
        let least = if much { 12.0 } else { 17.0 };
        let psnr = judge.psnr(&decoded).unwrap();
        assert!(psnr > least, "{name}: {psnr} dB of {} bytes", bytes.len());
    }
}

#[test]
fn the_same_bytes_at_any_number_of_threads() {
    let gaussians = scene(200, 5);
    let cameras = cameras(&gaussians);
    let encode = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let task = Task { gaussians: &gaussians, pictures: pictures(&cameras), photos: &[], steps: 10, seed: 1 };
        pool.install(|| points().iter().map(|(_, method)| method.encode(&task).unwrap()).collect::<Vec<_>>())
    };
    assert_eq!(encode(1), encode(3));
}

/// Promise (scenes): a method that trains has the same bytes wherever its training was stopped.
#[test]
fn stopped_trainings_go_on_to_the_same_bytes() {
    let gaussians = scene(60, 6);
    let cameras = cameras(&gaussians);
    let task = Task { gaussians: &gaussians, pictures: pictures(&cameras), photos: &[], steps: 10, seed: 1 };
    for name in TRAINED {
        let family = METHODS.iter().find(|family| family.name == name).unwrap();
        for Point { method, setting } in (family.points)() {
            let whole = method.encode(&task).unwrap();
            let mut training = method.begin(&task).unwrap();
            let [done, all] = training.steps();
            assert_eq!((done, all), (0, method.steps(task.steps)), "{name} {setting}");
            let stops = [0, 1, all / 3, all / 2, all - 1, all];
            for step in 0..=all {
                if stops.contains(&step) {
                    let state = training.state();
                    training = method.begin(&task).unwrap();
                    assert!(training.restore(&Tensors::default()).is_err(), "{name}");
                    training.restore(&state).unwrap();
                    assert_eq!(training.steps(), [step, all]);
                }
                if step < all {
                    assert!(training.step().unwrap().is_finite());
                }
            }
            assert!(training.finish().unwrap() == whole, "{name} {setting}");
        }
    }
}

#[test]
fn training_brings_quality_back() {
    let gaussians = scene(300, 9);
    let cameras = cameras(&gaussians);
    let mut judge = Judge::new(&gaussians, &pictures(&cameras)).unwrap();
    for name in TRAINED {
        let family = METHODS.iter().find(|family| family.name == name).unwrap();
        let method = (family.points)().pop().unwrap().method;
        let mut psnr = |steps: usize| {
            let task = Task { gaussians: &gaussians, pictures: pictures(&cameras), photos: &[], steps, seed: 1 };
            judge.psnr(&method.decode(&method.encode(&task).unwrap()).unwrap()).unwrap()
        };
        let (before, after) = (psnr(0), psnr(150));
        assert!(after > before + 0.3, "{name}: {before} to {after} dB");
    }
}

#[test]
fn scenes_that_cannot_be_encoded_are_named() {
    let mut broken = scene(20, 1);
    let cameras = cameras(&broken);
    broken.sh[7] = f32::NAN;
    for name in ["lite", "lightgaussian", "mesongs", "c3dgs", "haclite"] {
        let family = METHODS.iter().find(|family| family.name == name).unwrap();
        let method = (family.points)().pop().unwrap().method;
        for gaussians in [&broken, &Gaussians::default()] {
            let task = Task { gaussians, pictures: pictures(&cameras), photos: &[], steps: 0, seed: 1 };
            let result = method.encode(&task);
            assert!(gaussians.is_empty() && name == "lite" || result.is_err(), "{name}");
        }
    }
}

#[test]
fn one_gaussian_and_many_in_one_place() {
    for count in [1, 40] {
        let mut gaussians = scene(count, 2);
        let first = gaussians.means[0];
        gaussians.means.fill(first);
        let cameras = cameras(&gaussians);
        for (name, method) in points() {
            let task = Task { gaussians: &gaussians, pictures: pictures(&cameras), photos: &[], steps: 0, seed: 1 };
            assert!(!method.decode(&method.encode(&task).unwrap()).unwrap().is_empty(), "{name}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases / 8, ..ProptestConfig::default() })]
    #[test]
    fn bytes_that_changed_are_refused_or_read(at in any::<prop::sample::Index>(), value in any::<u8>(), cut in any::<bool>()) {
        static FILES: std::sync::LazyLock<Vec<Vec<u8>>> = std::sync::LazyLock::new(|| {
            let gaussians = scene(60, 4);
            let cameras = cameras(&gaussians);
            let task = Task { gaussians: &gaussians, pictures: pictures(&cameras), photos: &[], steps: 0, seed: 1 };
            points().iter().map(|(_, method)| method.encode(&task).unwrap()).collect()
        });
        for ((_, method), bytes) in points().iter().zip(FILES.iter()) {
            let mut bytes = bytes.clone();
            let place = at.index(bytes.len());
            if cut { bytes.truncate(place) } else { bytes[place] = value }
            // No panic.
            let _ = method.decode(&bytes);
        }
    }
}
