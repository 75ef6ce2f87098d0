//! Procedural films: the same bits everywhere, and motion that every camera sees.

use weaver_data::film::{Film, FilmOptions, FilmPoint, MOTIONS, procedural};
use weaver_geometry::glam::DVec3;

const SMALL: FilmOptions = FilmOptions { width: 40, height: 30, cameras: 4, frames: 6, points: 20 };

#[test]
fn a_film_has_the_same_bits_at_any_thread_count() {
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| procedural(5, &SMALL))
    };
    let one = with_threads(1);
    assert!(one == with_threads(3));
    assert_ne!(one.shots[0].pixels, procedural(6, &SMALL).shots[0].pixels);
}

/// The middle camera and every fourth frame are held out.
#[test]
fn the_held_out_split_of_films() {
    let film = procedural(1, &FilmOptions { cameras: 5, frames: 8, ..SMALL });
    assert_eq!((film.size, film.shots.len(), film.training().len()), ([30, 40], 40, 4 * 6));
    assert_eq!(film.training().len() + film.held_out().len(), 40);
    for (i, shot) in film.shots.iter().enumerate() {
        assert_eq!((shot.viewpoint, shot.time), (i % 5, (i / 5) as f64 / 8.0));
        assert_eq!((shot.held_out.camera, shot.held_out.time), (i % 5 == 2, i / 5 % 4 == 2), "{}", shot.name);
        assert_eq!(shot.image(film.size).unwrap().to_bytes(), *shot.pixels.bytes().unwrap());
    }
    assert_eq!(film.times(), (0..8).map(|f| f64::from(f) / 8.0).collect::<Vec<_>>());
    assert!(film.points.iter().all(|point| film.times().contains(&point.time)));
    let mut times: Vec<f64> = film.points.iter().map(|point| point.time).collect();
    times.dedup();
    assert_eq!((film.points.len(), times.len()), (80, 4));
    assert!((0.5..2.0).contains(&film.extent()), "{}", film.extent());
}

/// Number of pixels of a film's photo that show each kind of motion.
fn shown(film: &Film, shot: usize) -> [usize; MOTIONS.len()] {
    let motion = film.shots[shot].motion.as_ref().unwrap();
    std::array::from_fn(|kind| motion.iter().filter(|pixel| usize::from(**pixel) == kind).count())
}

#[test]
fn every_camera_sees_every_kind_of_motion() {
    let options = FilmOptions { width: 48, height: 36, cameras: 3, frames: 8, points: 0 };
    for seed in 0..8 {
        let film = procedural(seed, &options);
        for viewpoint in 0..3 {
            let frames = (0..8).map(|frame| shown(&film, frame * 3 + viewpoint));
            let most = frames.clone().fold([0; MOTIONS.len()], |a, b| std::array::from_fn(|i| a[i].max(b[i])));
            let least = frames.fold([usize::MAX; MOTIONS.len()], |a, b| std::array::from_fn(|i| a[i].min(b[i])));
            assert!(most[1..].iter().all(|&n| n >= 12), "seed {seed}, camera {viewpoint}: {most:?}");
            // In front of the others, and whole in the picture, but for the last, which is gone at first and in the
            // end.
            assert!(least[1..5].iter().all(|&n| n >= 6) && least[5] == 0, "seed {seed}, camera {viewpoint}: {least:?}");
        }
    }
}

/// Where a single camera stands still, points give the size of the scene.
#[test]
fn a_single_viewpoint_has_the_extent_of_its_points() {
    let mut film = procedural(1, &FilmOptions { width: 4, height: 3, cameras: 1, frames: 2, points: 0 });
    assert_eq!(film.extent(), 1.0);
    let eye = film.shots[0].camera.pose.center();
    let point = |distance: f64| FilmPoint { position: eye + DVec3::X * distance, color: [0.5; 3], time: 0.0 };
    film.points = [7.0, 2.0, 3.0].map(point).to_vec();
    assert!((film.extent() - 3.0).abs() < 1e-12, "{}", film.extent());
}
