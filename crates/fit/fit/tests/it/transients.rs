//! A thing in one photo alone is left out, and nothing else is.

use crate::scenes::finish;
use weaver_fit::{Fit, FitSettings, Photo, init, mean_color, steps_in};
use weaver_geometry::glam::DVec2;
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::PointCloud;

const SIZE: [usize; 2] = [80, 60];
const VIEWS: usize = 9;
/// The photo with a thing before it, and the sides of the thing: left, right, top, bottom.
const PLANTED: usize = 4;
const THING: [usize; 4] = [24, 48, 18, 40];

fn in_thing(at: usize) -> bool {
    let (x, y) = (at % SIZE[0], at / SIZE[0]);
    (THING[0]..THING[1]).contains(&x) && (THING[2]..THING[3]).contains(&y)
}

/// Photos of a procedural scene, one with a chessboard before it, and points of the scene.
fn world(planted: bool) -> (Vec<Photo>, PointCloud) {
    let scene = scene(3, &ProceduralOptions { width: SIZE[0], height: SIZE[1], views: VIEWS });
    let mut points = PointCloud::default();
    let photos = scene.views.iter().enumerate().map(|(i, view)| {
        let mut rgb = view.image.to_bytes();
        for (at, depth) in view.depth.iter().flatten().enumerate().filter(|(at, z)| at % 29 == 0 && **z > 0.0) {
            let pixel = DVec2::new((at % SIZE[0]) as f64 + 0.5, (at / SIZE[0]) as f64 + 0.5);
            points.positions.push(view.camera.unproject(pixel, f64::from(*depth)).as_vec3().to_array());
            points.colors.push([rgb[3 * at], rgb[3 * at + 1], rgb[3 * at + 2]]);
        }
        let cells = (0..SIZE[0] * SIZE[1]).filter(|at| planted && i == PLANTED && in_thing(*at));
        for at in cells {
            let dark = (at % SIZE[0] / 8 + at / SIZE[0] / 8).is_multiple_of(2);
            rgb[3 * at..3 * at + 3].copy_from_slice(if dark { &[20, 0, 60] } else { &[250, 240, 0] });
        }
        Photo { name: view.name.clone(), camera: view.camera, rgb: rgb.into(), mask: None, lens: None }
    });
    (photos.collect(), points)
}

fn fit(planted: bool, transients: bool) -> Fit {
    let (photos, points) = world(planted);
    let mut settings =
        FitSettings { steps: 600, gaussians: 3000, sh_degree: 0, transients, dropout: 0.1, ..FitSettings::default() };
    settings.background = mean_color(&photos);
    let initial = init::from_points(&points, &settings).expect("points");
    Fit::new(photos, &initial, settings).expect("a fit")
}

fn finished(planted: bool, transients: bool) -> Fit {
    let mut fit = fit(planted, transients);
    finish(&mut fit);
    fit
}

/// Mean squared difference between the scene and the photo without the thing, where the thing is.
fn error_behind(fit: &mut Fit) -> f64 {
    let camera = fit.camera(PLANTED);
    let image = fit.render(&camera).expect("an image");
    let (clean, _) = world(false);
    let value = |at: usize| f64::from(image[at]) - f64::from(clean[PLANTED].rgb[at]) / 255.0;
    let square = |at: usize| (3 * at..3 * at + 3).map(value);
    let inside: Vec<f64> = (0..SIZE[0] * SIZE[1]).filter(|at| in_thing(*at)).flat_map(square).collect();
    inside.iter().map(|d| d * d).sum::<f64>() / inside.len() as f64
}

/// Promise (kept): an object before one photo is left out of it, and nothing of a clean capture; a stopped fit goes
/// on with the objects it had found.
#[test]
fn a_thing_before_one_photo_is_left_out() {
    let mut fit = self::fit(true, true);
    while fit.transients(PLANTED).is_none() {
        fit.step().expect("a step");
    }
    fit.step().expect("a step");
    let mut resumed = self::fit(true, true);
    resumed.restore(&fit.state()).expect("a state");
    assert_eq!(resumed.transients(PLANTED), fit.transients(PLANTED));
    finish(&mut fit);
    finish(&mut resumed);
    assert!(resumed.population() == fit.population());

    let found = fit.transients(PLANTED).expect("the thing").at_size(SIZE[0], SIZE[1]);
    let [mut both, mut either] = [0, 0];
    for (at, hidden) in found.iter().enumerate() {
        both += usize::from(*hidden && in_thing(at));
        either += usize::from(*hidden || in_thing(at));
    }
    assert!(both as f64 > 0.6 * either as f64, "{both} of {either} cells");
    for other in (0..VIEWS).filter(|photo| *photo != PLANTED) {
        let part = fit.transients(other).map_or(0.0, weaver_fit::Transients::part);
        assert!(part < 0.02, "photo {other}: {part}");
    }
    let counted = fit.counted(PLANTED).expect("a mask");
    assert!(counted.iter().zip(&found).all(|(counts, hidden)| counts != hidden));
    let (with, without) = (error_behind(&mut fit), error_behind(&mut finished(true, false)));
    assert!(with < 0.9 * without, "{with} behind the thing, {without} where it is not left out");
}

/// Where every photo shows the scene, nothing is left out.
///
/// Promise of `a_thing_before_one_photo_is_left_out`.
#[test]
fn nothing_is_left_out_of_a_clean_capture() {
    let fit = finished(false, true);
    let parts: Vec<f64> = (0..VIEWS).filter_map(|photo| Some(fit.transients(photo)?.part())).collect();
    assert!(parts.iter().sum::<f64>() < 0.02, "{parts:?}");
    assert!(fit.counted(0).is_none() || !parts.is_empty());
}

/// A run that is timed leaves no trace, and no transients.
#[test]
fn timing_leaves_nothing_behind() {
    let (mut timed, fresh) = (fit(true, true), fit(true, true));
    steps_in(&mut timed, 10.0).expect("steps");
    assert!((0..VIEWS).all(|photo| timed.transients(photo).is_none()));
    assert!(timed.population() == fresh.population());
}

/// The mean color is taken over the pixels that count, white where none does.
#[test]
fn mean_colors() {
    let (mut photos, _) = world(false);
    assert_eq!(mean_color(&[]), [1.0; 3]);
    let photo = &mut photos[0];
    photo.rgb.chunks_exact_mut(3).enumerate().for_each(|(at, pixel)| {
        pixel.copy_from_slice(if at % 2 == 0 { &[255, 51, 0] } else { &[0, 102, 9] });
    });
    photo.mask = Some((0..SIZE[0] * SIZE[1]).map(|at| at % 2 == 0).collect());
    assert_eq!(mean_color([&photos[0]]), [1.0, 0.2, 0.0]);
}
