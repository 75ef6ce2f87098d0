//! Keypoints: where they are found, and found again.

use std::process::Command;
use weaver_geometry::glam::{DVec2, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose, so3};
use weaver_kernels::random::Stream;
use weaver_sfm::{DESCRIPTOR, Epipolar, Features, Keypoint, Match, matches, matches_along};

/// A photo of one round spot.
fn spot(at: DVec2, sigma: f64, size: [usize; 2]) -> Vec<f32> {
    let [height, width] = size;
    let value = |i: usize| {
        let pixel = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        (0.2 + 0.6 * (-0.5 * pixel.distance_squared(at) / (sigma * sigma)).exp()) as f32
    };
    (0..width * height).map(value).collect()
}

#[test]
fn spots_are_found_where_they_are() {
    for (width, height) in [(64, 48), (192, 160), (384, 256), (600, 400)] {
        for (i, sigma) in [1.5, 2.5, 4.0, 6.0].into_iter().enumerate() {
            let stream = Stream::new(width as u64, i as u64, "test.spots");
            let at = |k: u64, size: usize| size as f64 * (0.4 + 0.2 * stream.uniform::<f64>(k));
            let at = DVec2::new(at(0, width), at(1, height));
            let features = Features::new(&spot(at, sigma, [height, width]), [height, width], None, 10);
            let off = features.keypoints.iter().map(|k| k.pixel.distance(at)).fold(f64::INFINITY, f64::min);
            assert!(off < 0.06 * sigma, "{width}x{height}, sigma {sigma}: off by {off}");
        }
    }
}

/// A turned, shrunk and darker photo: most of its keypoints are found again, at the right places.
#[test]
fn keypoints_are_found_again_in_a_turned_photo() {
    let wave = |k: u64| {
        let stream = Stream::new(9, k, "test.waves");
        let frequency = DVec2::new(stream.normal(0), stream.normal(1)) * 0.18;
        (frequency, 6.0 * stream.uniform::<f64>(2))
    };
    let waves: Vec<(DVec2, f64)> = (0..14).map(wave).collect();
    let texture = |p: DVec2| 0.5 + 0.05 * waves.iter().map(|(f, phase)| (f.dot(p) + phase).sin()).sum::<f64>();
    let (width, height) = (240, 200);
    let center = DVec2::new(120.0, 100.0);
    let turn = DVec2::from_angle(0.6);
    let there = |p: DVec2| turn.rotate(p - center) * 1.25 + center;
    let photo = |of: &dyn Fn(DVec2) -> f64| -> Features {
        let gray: Vec<f32> = (0..width * height)
            .map(|i| of(DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)) as f32)
            .collect();
        Features::new(&gray, [height, width], None, 400)
    };
    let (first, second) = (photo(&texture), photo(&|p| 0.1 + 0.7 * texture(there(p))));
    let found = matches(&second, &first);
    let right = found.iter().filter(|m| {
        there(second.keypoints[m.first as usize].pixel).distance(first.keypoints[m.second as usize].pixel) < 1.0
    });
    let right = right.count();
    assert!(right > 40 && 20 * right > 19 * found.len(), "{right} of {} matches are right", found.len());
}

#[test]
fn masked_and_empty_photos_have_no_keypoints() {
    let size = [48, 64];
    let photo = spot(DVec2::new(20.0, 20.0), 3.0, size);
    let mask = vec![false; photo.len()];
    assert!(Features::new(&photo, size, Some(&mask), 100).keypoints.is_empty());
    assert!(Features::new(&[0.5; 64 * 48], size, None, 100).keypoints.is_empty());
    assert!(Features::new(&[0.5; 12], [3, 4], None, 100).keypoints.is_empty());
    let empty = Features::default();
    assert!(matches(&empty, &Features::new(&photo, size, None, 100)).is_empty());
}

/// A photo of several round spots.
fn spots(places: &[DVec2], sigma: f64, [height, width]: [usize; 2]) -> Vec<f32> {
    let mut photo = vec![0.2_f32; width * height];
    for at in places {
        let reach = 5.0 * sigma;
        let range = |at: f64, size: usize| (at - reach).max(0.0) as usize..((at + reach) as usize).min(size);
        for y in range(at.y, height) {
            for x in range(at.x, width) {
                let square = DVec2::new(x as f64 + 0.5, y as f64 + 0.5).distance_squared(*at);
                photo[y * width + x] += 0.6 * (-0.5 * square / (sigma * sigma)).exp() as f32;
            }
        }
    }
    photo
}

/// Enlarged four times, twice and not at all, upright and lying, in every octave that spots of these sizes are found
/// in: places are right on average over all offsets from pixels, which single ones need not be.
#[test]
fn places_are_unbiased_in_every_octave() {
    const PHASES: usize = 16;
    for (width, height) in [(200, 150), (150, 200), (384, 256), (256, 384), (1100, 768), (768, 1100)] {
        // Photos that are not enlarged show no smaller ones.
        let least = if width.max(height) < 1024 { 1.4 } else { 2.6 };
        for sigma in [least, 4.0, 7.0, 12.0] {
            // Sixteen offsets, spread over one pixel as over the eight that no octave's pixels here exceed, none of
            // them half-way; as many photos of as many spots as have room.
            let room = 10.0 * sigma + 10.0;
            let grid = [width, height].map(|size| ((size as f64 / room) as usize).max(1));
            let cells = (grid[0] * grid[1]).min(PHASES);
            let offset = |k: usize| (k % PHASES) as f64 / 16.0 + 1.0 / 32.0 + (3 * k % 8) as f64 - 4.0;
            let mut sum = DVec2::ZERO;
            for first in (0..PHASES).step_by(cells) {
                let place = |k: usize| {
                    let i = k - first;
                    let cell = DVec2::new((i % grid[0]) as f64 + 0.5, (i / grid[0]) as f64 + 0.5);
                    let middle = cell * DVec2::new(width as f64 / grid[0] as f64, height as f64 / grid[1] as f64);
                    middle.floor() + DVec2::new(offset(k), offset(7 * k + 3))
                };
                let places: Vec<DVec2> = (first..(first + cells).min(PHASES)).map(place).collect();
                let features = Features::new(&spots(&places, sigma, [height, width]), [height, width], None, 1000);
                for at in &places {
                    let off = |k: &Keypoint| k.pixel.distance(*at);
                    let like = |k: &&Keypoint| k.scale > 0.6 * sigma && k.scale < 1.7 * sigma;
                    let nearest = features.keypoints.iter().filter(like).min_by(|a, b| off(a).total_cmp(&off(b)));
                    let nearest = nearest.unwrap_or_else(|| panic!("{width}x{height}, sigma {sigma}: nothing at {at}"));
                    assert!(off(nearest) < 0.1 * sigma, "{width}x{height}, sigma {sigma}: off by {}", off(nearest));
                    sum += nearest.pixel - *at;
                }
            }
            let mean = sum / PHASES as f64;
            println!("{width}x{height}, sigma {sigma}: {mean}");
            assert!(mean.abs().max_element() < 0.02, "{width}x{height}, sigma {sigma}: {mean} on average");
        }
    }
}

/// A place seen twice as near, or half as much again, is found where it then is.
#[test]
fn places_do_not_move_with_magnification() {
    let wave = |k: u64| {
        let stream = Stream::new(4, k, "test.waves");
        let length = 5.0 * 2.0_f64.powf(4.0 * stream.uniform::<f64>(3));
        let direction = DVec2::from_angle(std::f64::consts::TAU * stream.uniform::<f64>(0));
        (direction * std::f64::consts::TAU / length, 6.0 * stream.uniform::<f64>(2))
    };
    let waves: Vec<(DVec2, f64)> = (0..40).map(wave).collect();
    let texture = |p: DVec2| 0.5 + 0.03 * waves.iter().map(|(f, phase)| (f.dot(p) + phase).sin()).sum::<f64>();
    let photo = |zoom: f64, [height, width]: [usize; 2]| -> Features {
        let pixel = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5) / zoom;
        let gray: Vec<f32> = (0..width * height).map(|i| texture(pixel(i)) as f32).collect();
        Features::new(&gray, [height, width], None, 3000)
    };
    let first = photo(1.0, [300, 400]);
    for (zoom, size) in [(1.0, [400, 300]), (1.5, [450, 600]), (2.0, [600, 800]), (3.0, [900, 1200]), (0.7, [210, 280])]
    {
        let second = photo(zoom, size);
        let off = |m: Match| second.keypoints[m.second as usize].pixel / zoom - first.keypoints[m.first as usize].pixel;
        let found: Vec<DVec2> =
            matches(&first, &second).into_iter().map(off).filter(|off| off.length() < 0.7).collect();
        let mean = found.iter().sum::<DVec2>() / found.len() as f64;
        let deviation = (found.iter().map(|off| off.length_squared()).sum::<f64>() / found.len() as f64).sqrt();
        println!("{zoom}: {} {mean} +- {deviation}", found.len());
        assert!(found.len() > 200 && mean.abs().max_element() < 0.03, "{zoom} times: {mean} of {}", found.len());
    }
}

/// Two photos of many keypoints; most look like one of the other photo, some twice.
fn alike(count: usize, seed: u64) -> [Features; 2] {
    let number = |photo: u64, k: usize, at: u64| {
        // Every fifth looks like the one before it.
        let k = if k % 5 == 4 && at < 128 { k - 1 } else { k };
        Stream::new(seed, k as u64 + (photo << 32), "test.alike").uniform::<f64>(at)
    };
    [0, 1].map(|photo| {
        let mut features = Features::default();
        for k in 0..count {
            let pixel = DVec2::new(400.0 * number(photo, k, 1000), 300.0 * number(photo, k, 1001));
            features.keypoints.push(Keypoint { pixel, scale: 1.0, angle: 0.0, contrast: 1.0 });
            let noise = if k % 4 == 0 { 1.0 } else { 0.2 };
            let mixed =
                |at: u64| (number(0, k, at).powi(3) * (1.0 - noise) + number(photo, k, at).powi(3) * noise).sqrt();
            let numbers: Vec<f64> = (0..DESCRIPTOR as u64).map(mixed).collect();
            let length = numbers.iter().map(|x| x * x).sum::<f64>().sqrt();
            features.descriptors.extend(numbers.iter().map(|x| (250.0 * x / length).round().min(127.0) as u8));
        }
        features
    })
}

/// Slow twin of [`matches()`] and [`matches_along`], one keypoint after the other.
fn slow(first: &Features, second: &Features, allows: impl Fn(DVec2, DVec2) -> bool) -> Vec<Match> {
    let similarity = |i: usize, j: usize| -> Option<f32> {
        let [a, b] = [&first.descriptors[DESCRIPTOR * i..], &second.descriptors[DESCRIPTOR * j..]];
        let sum: u32 = a[..DESCRIPTOR].iter().zip(&b[..DESCRIPTOR]).map(|(a, b)| u32::from(*a) * u32::from(*b)).sum();
        allows(first.keypoints[i].pixel, second.keypoints[j].pixel).then_some(sum as f32 / 62_500.0)
    };
    let (n, m) = (first.keypoints.len(), second.keypoints.len());
    let best = |of: &dyn Fn(usize) -> Option<f32>, count: usize| -> Option<(usize, f32)> {
        let all = (0..count).filter_map(|k| of(k).map(|s| (k, s)));
        all.fold(None, |best: Option<(usize, f32)>, (k, s)| best.filter(|b| b.1 >= s).or(Some((k, s))))
    };
    let distance = |s: f32| (2.0 - 2.0 * s).max(1e-12).sqrt();
    let mut taken = vec![false; m];
    let found = (0..n).filter_map(|i| {
        let (j, s) = best(&|j| similarity(i, j), m)?;
        let next = best(&|k| similarity(i, k).filter(|_| k != j), m).map_or(0.3, |next| next.1.max(0.3));
        // Of two that are as similar to the same, the first is taken.
        let mutual = best(&|i| similarity(i, j), n)?.1 == s && !std::mem::replace(&mut taken[j], true);
        let ratio = distance(s) / distance(next);
        (mutual && ratio < 0.85).then_some(Match { first: i as u32, second: j as u32, ratio })
    });
    let mut found: Vec<Match> = found.collect();
    found.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    found
}

/// Matches are the slow twin's, to the bit and with every instruction set.
#[test]
fn matches_are_those_of_the_slow_twin() {
    for (seed, count) in [1, 15, 200, 333].into_iter().enumerate() {
        let [first, second] = alike(count, seed as u64);
        let found = matches(&first, &second);
        assert_eq!(found, slow(&first, &second, |_, _| true), "{count} keypoints");
        assert!(count < 100 || found.len() > count / 3, "{} matches of {count} keypoints", found.len());
    }
}

/// Lines across and down, through photos and past them, and cameras that stand in the same place.
#[test]
fn matches_along_lines_are_those_of_the_slow_twin() {
    let intrinsics = Intrinsics { fx: 300.0, fy: 310.0, cx: 200.0, cy: 150.0 };
    let camera = |turn: DVec3, move_by: DVec3| Camera {
        pose: Pose::new(so3::exp(turn), move_by),
        intrinsics,
        width: 400,
        height: 300,
    };
    let here = camera(DVec3::ZERO, DVec3::ZERO);
    let [first, second] = alike(300, 9);
    let mut some = 0;
    for (turn, move_by) in [
        (DVec3::ZERO, DVec3::X),
        (DVec3::ZERO, DVec3::Y),
        (DVec3::ZERO, DVec3::Z),
        (DVec3::ZERO, DVec3::ZERO),
        (DVec3::new(0.1, 0.2, 0.4), DVec3::new(1.0, 0.7, 0.1)),
        (DVec3::new(0.0, 1.2, 0.0), DVec3::new(1.0, 0.3, -0.5)),
        (DVec3::new(0.9, 0.0, 0.3), DVec3::new(0.2, 1.0, 0.1)),
    ] {
        for farthest in [0.7, 6.0, 80.0] {
            let epipolar = Epipolar::new(&here, &camera(turn, move_by), farthest);
            let found = matches_along(&first, &second, &epipolar);
            assert_eq!(found, slow(&first, &second, |a, b| epipolar.allows(a, b)), "{turn} {move_by} {farthest}");
            some += usize::from(found.len() > 20);
        }
    }
    assert!(some > 8, "{some} with matches");
    let empty = Features::default();
    let epipolar = Epipolar::new(&here, &camera(DVec3::ZERO, DVec3::X), 3.0);
    assert!(
        matches_along(&empty, &second, &epipolar).is_empty() && matches_along(&first, &empty, &epipolar).is_empty()
    );
}

/// Where keypoints are, by the instruction sets that this processor would not choose: each has a process of its own.
#[test]
fn lesser_instruction_sets_find_the_same() {
    for level in ["portable", "avx2"] {
        let mut command = Command::new(std::env::current_exe().expect("a test has an executable"));
        command.args(["features::places_are", "features::spots", "features::keypoints", "features::matches"]);
        let output = command.env("WEAVER_SIMD", level).output().expect("a test can be started again");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && !text.contains("running 0 tests"), "{level}: {text}");
    }
}
