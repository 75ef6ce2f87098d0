//! Photos with masks, loaded for a network: pixels outside of them have no influence.

use std::fs;
use std::path::{Path, PathBuf};
use weaver_data::capture::{CaptureOptions, HoldOut, load, load_cameras, load_images, load_masked_images};
use weaver_geometry::Distortion;
use weaver_io::{Image, Transforms};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::{Frame, PointCloud};

const OPTIONS: CaptureOptions =
    CaptureOptions { width: 20, height: 20, scene_scale: None, hold_out: HoldOut::Nothing, masks: true };

/// True if a pixel of photo `view` counts: all of photo 0, half of the others with a slanted border.
fn counts(view: usize, x: usize, y: usize) -> bool {
    view == 0 || 2 * x + y < 60
}

/// Four photos of 64 x 48 with masks and `garbage` outside of them; the last photo's mask is its alpha.
fn captured(folder: &Path, garbage: Option<u8>, lens: Option<Distortion>) {
    let truth = scene(3, &ProceduralOptions { width: 64, height: 48, views: 4 });
    for name in ["images", "masks"] {
        fs::create_dir_all(folder.join(name)).unwrap();
    }
    let mut frames = Vec::new();
    for (view, photo) in truth.views.iter().enumerate() {
        let colors = photo.image.to_bytes();
        let at = |i: usize| (i % 64, i / 64);
        let inside = |i: usize| counts(view, at(i).0, at(i).1);
        let color = |i: usize| match garbage {
            Some(garbage) if !inside(i) => [garbage ^ (i % 251) as u8, garbage, 255 - garbage],
            _ => [colors[3 * i], colors[3 * i + 1], colors[3 * i + 2]],
        };
        let alpha = |i: usize| if inside(i) { 255 } else { 0 };
        let name = format!("images/{view}.png");
        if view == 3 {
            let rgba = (0..64 * 48).flat_map(|i| [color(i)[0], color(i)[1], color(i)[2], alpha(i)]).collect();
            image::RgbaImage::from_raw(64, 48, rgba).unwrap().save(folder.join(&name)).unwrap();
        } else {
            let rgb = (0..64 * 48).flat_map(color).collect();
            image::RgbImage::from_raw(64, 48, rgb).unwrap().save(folder.join(&name)).unwrap();
            let mask = (0..64 * 48).map(alpha).collect();
            image::GrayImage::from_raw(64, 48, mask).unwrap().save(folder.join(format!("masks/{view}.png"))).unwrap();
        }
        frames.push(Frame { distortion: lens, ..Frame::new(name, photo.camera) });
    }
    let positions: Vec<[f32; 3]> = truth.points.iter().map(|p| p.as_vec3().to_array()).collect();
    let cloud = PointCloud { colors: vec![[9; 3]; positions.len()], positions };
    weaver_io::ply::write_points(folder.join("points3D.ply"), &cloud).unwrap();
    Transforms { frames, ..Transforms::default() }.write(folder.join("transforms.json")).unwrap();
}

fn paths(folder: &Path) -> Vec<PathBuf> {
    (0..4).map(|view| folder.join(format!("images/{view}.png"))).collect()
}

#[test]
fn nothing_of_what_a_mask_leaves_out_is_seen() {
    for lens in [None, Some(Distortion::radial(-0.1))] {
        let loaded = [7, 200].map(|garbage| {
            let folder = tempfile::tempdir().unwrap();
            captured(folder.path(), Some(garbage), lens);
            let images = load_masked_images(&paths(folder.path()), 20, 20).unwrap();
            let file = folder.path().join("transforms.json");
            let given = load_cameras(&file, &paths(folder.path()), [20, 20], true).unwrap();
            (load(folder.path(), &OPTIONS).unwrap(), images, given)
        });
        let [(first, images, given), (second, other_images, other_given)] = &loaded;
        assert_eq!((images, given), (other_images, other_given));
        for (view, (a, b)) in first.views.iter().zip(&second.views).enumerate() {
            assert_eq!((&a.image, &a.inside, &a.depth), (&b.image, &b.inside, &b.depth), "{view}");
            assert_eq!((&given.images[view], &given.inside[view]), (&a.image, &a.inside), "{view}");
            let Some(inside) = &a.inside else {
                assert_eq!(view, 0, "a mask that leaves nothing out is none");
                continue;
            };
            let outside = inside.iter().filter(|inside| !**inside).count();
            assert!(outside > 80 && outside < 320, "{view}: {outside} of 400");
            let pixels = a.image.pixels.chunks(3).zip(a.depth.as_ref().unwrap());
            for ((color, depth), _) in pixels.zip(inside).filter(|(_, inside)| !**inside) {
                assert_eq!((color, *depth), (&[1.0; 3][..], 0.0), "{view}");
            }
            assert!(a.depth.as_ref().unwrap().iter().any(|depth| *depth > 0.0), "{view}");
        }
    }
}

#[test]
fn what_counts_has_its_own_colors_up_to_the_border() {
    let (masked, clean) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    captured(masked.path(), Some(120), None);
    captured(clean.path(), None, None);
    let plain = load(clean.path(), &CaptureOptions { masks: false, ..OPTIONS }).unwrap();
    let loaded = load(masked.path(), &OPTIONS).unwrap();
    assert_eq!((&loaded.views[0].image, &loaded.views[0].depth), (&plain.views[0].image, &plain.views[0].depth));
    // The last photo is over white itself.
    for (a, b) in loaded.views[1..3].iter().zip(&plain.views[1..3]) {
        let apart = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let pixels = a.image.pixels.chunks(3).zip(b.image.pixels.chunks(3)).zip(a.inside.as_ref().unwrap());
        let errors: Vec<f32> = pixels.filter(|(_, inside)| **inside).map(|(pixel, _)| apart(pixel)).collect();
        let mean = errors.iter().sum::<f32>() / errors.len() as f32;
        // With white mixed in, the border alone would bring that to twice as much.
        assert!(mean < 0.015, "{mean}");
    }
}

/// Photos that are masked altogether are left out and named.
#[test]
fn photos_without_pixels_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    captured(folder, Some(9), None);
    image::GrayImage::new(64, 48).save(folder.join("masks/1.png")).unwrap();
    let scene = load(folder, &OPTIONS).unwrap();
    let names: Vec<&str> = scene.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["images/0.png", "images/2.png", "images/3.png"]);
    assert_eq!(scene.visible.len(), 3);
    assert!(scene.remarks.len() == 1 && scene.remarks[0].contains("altogether"), "{:?}", scene.remarks);
    assert!(scene.remarks[0].contains("images/1.png") && !scene.remarks[0].contains("2.png"), "{:?}", scene.remarks);
}

/// Masks that are missing or of another size are errors.
#[test]
fn missing_and_misfit_masks_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    captured(folder, None, None);
    image::GrayImage::new(32, 48).save(folder.join("masks/2.png")).unwrap();
    let says = |part: &str| {
        let capture = load(folder, &OPTIONS).unwrap_err().to_string().replace('\\', "/");
        let photos = load_masked_images(&paths(folder), 20, 20).unwrap_err().to_string().replace('\\', "/");
        for message in [capture, photos] {
            assert!(message.contains(part), "{part}: {message}");
        }
    };
    says("masks/2.png: image size: expected 64x48, its photo's, found 32x48");
    fs::remove_file(folder.join("masks/2.png")).unwrap();
    says("images/2.png: mask: expected");
    let plain: Vec<Image> = load_images(&paths(folder), 20, 20).unwrap();
    assert_eq!(plain.len(), 4);
}
