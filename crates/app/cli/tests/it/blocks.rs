//! Captures cut into blocks, and their fits joined.

use crate::capture;
use crate::in_process::{Outcome, splatweaver};
use std::collections::BTreeSet;
use std::path::Path;
use weaver_data::capture::{HoldOut, survey};
use weaver_geometry::glam::DVec2;
use weaver_io::{Transforms, read_gaussians};
use weaver_procedural::{ProceduralOptions, Walk};
use weaver_reconstruct::blocks::BlockFile;
use weaver_scene::{Frame, PointCloud};

/// Runs a line that `split` printed, with more words behind it.
fn line(text: &str, more: &str) -> Outcome {
    let words: Vec<&str> = text.split(' ').skip(1).chain(more.split(' ')).collect();
    let words: Vec<&dyn AsRef<std::ffi::OsStr>> = words.iter().map(|word| word as &dyn AsRef<_>).collect();
    splatweaver(&words)
}

fn block(folder: &Path, number: usize) -> BlockFile {
    let text = std::fs::read_to_string(folder.join(format!("block-{number:02}/block.json"))).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Photos along a street, with points that they show.
fn street(folder: &Path) {
    let walk = Walk::street(1, &ProceduralOptions { width: 32, height: 24, views: 48 });
    std::fs::create_dir_all(folder.join("images")).unwrap();
    let (mut transforms, mut points) = (Transforms::default(), PointCloud::default());
    for (i, camera) in walk.cameras().iter().enumerate() {
        let (view, name) = (walk.view(i), format!("images/{i:02}.png"));
        view.image.write_png(folder.join(&name)).unwrap();
        transforms.frames.push(Frame::new(name, *camera));
        for at in (10..768).step_by(50) {
            let pixel = DVec2::new((at % 32) as f64 + 0.5, (at / 32) as f64 + 0.5);
            let z = f64::from(view.depth.as_ref().unwrap()[at]);
            if z > 0.0 {
                points.positions.push(camera.unproject(pixel, z).as_vec3().to_array());
                points.colors.push([90; 3]);
            }
        }
    }
    transforms.write(folder.join("transforms.json")).unwrap();
    weaver_io::ply::write_points(folder.join("sparse_pc.ply"), &points).unwrap();
}

/// Each block is fitted by its printed line, and the joined scene has the Gaussians of each fit inside its block; where
/// all photos see all blocks, the cut is reported as not worth it.
///
/// Promise of `colors_of_blocks_agree`.
#[test]
fn blocks_are_fitted_apart_and_joined() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture::colmap(&path("capture"), capture::VIEWS);
    let cut =
        splatweaver(&[&"split", &path("capture"), &"--blocks", &"2", &"-o", &path("blocks"), &"--gaussians", &"400"])
            .fine();
    let lines: Vec<&str> = cut.stdout.lines().collect();
    assert_eq!(lines.len(), 2);
    assert!(cut.stderr.contains("one fit of the whole is better"), "{}", cut.stderr);
    // A block's capture is one that can be read, with the photos, points and tracks of the whole.
    let whole = survey(path("capture"), HoldOut::Listed, false).unwrap();
    for number in 0..2 {
        let part = survey(path(&format!("blocks/block-{number:02}/capture")), HoldOut::Listed, false).unwrap();
        let file = block(&path("blocks"), number);
        assert_eq!((part.photos.len(), part.points.len()), (file.photos + file.held_out, file.points));
        for photo in &part.photos {
            let there = whole.photos.iter().find(|other| other.frame.path.file_name() == photo.frame.path.file_name());
            let there = there.unwrap();
            assert!(photo.camera.pose.angle_to(&there.camera.pose) < 1e-6 && photo.held_out == there.held_out);
            let places = |points: &[[f32; 3]], of: &[u32]| -> BTreeSet<[u32; 3]> {
                of.iter().map(|i| points[*i as usize].map(f32::to_bits)).collect()
            };
            let seen = places(&part.points.positions, &photo.visible);
            let all = places(&whole.points.positions, &there.visible);
            assert!(seen.is_subset(&all) && (photo.held_out || seen == all), "{}", photo.frame.name);
        }
    }
    let early = splatweaver(&[&"merge", &path("blocks"), &"-o", &path("scene.ply")]);
    early.refused(1, &["block-00/fit: blocks: expected a complete fit of", "found none"]);
    lines.iter().for_each(|text| _ = line(text, "--steps 30 --no-html").fine());
    splatweaver(&[&"merge", &path("blocks"), &"-o", &path("scene.ply")]).fine();
    let merged = read_gaussians(path("scene.ply")).unwrap();
    let kept: Vec<usize> = (0..2)
        .map(|number| {
            let region = block(&path("blocks"), number).region;
            let fit = read_gaussians(path(&format!("blocks/block-{number:02}/fit/scene.ply"))).unwrap();
            fit.means.iter().filter(|mean| region.contains(**mean)).count()
        })
        .collect();
    assert!(merged.len() == kept.iter().sum::<usize>() && kept.iter().all(|kept| *kept > 0), "{kept:?}");
}

/// As few blocks as fit; a bound that none keeps, a capture without points and blocks of two splits are refused.
#[test]
fn what_cannot_be_cut_or_joined_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    street(&path("capture"));
    let split = |count: &[&str], out: &str| {
        let (capture, out) = (path("capture"), path(out));
        let mut words: Vec<&dyn AsRef<std::ffi::OsStr>> =
            vec![&"split", &capture, &"-o", &out, &"--gaussians", &"90000"];
        words.extend(count.iter().map(|word| word as &dyn AsRef<_>));
        splatweaver(&words)
    };
    split(&["--memory", "10"], "one").fine();
    assert_eq!(block(&path("one"), 0).blocks, 1);
    let whole = block(&path("one"), 0).memory as f64;
    split(&["--memory", &format!("{:.6}", 0.99e-9 * whole)], "more").fine();
    assert!(block(&path("more"), 0).blocks > 1 && (block(&path("more"), 0).memory as f64) < 0.99 * whole);
    split(&["--memory", "0.001"], "none").refused(1, &["memory: expected at least", "found 1 MB"]);
    assert!(!path("none").exists());
    capture::transforms(&path("bare"), 6);
    let bare = splatweaver(&[&"split", &path("bare"), &"--blocks", &"2", &"-o", &path("bare-blocks")]);
    bare.refused(1, &["points: expected points", "splatweaver cameras", "found none"]);
    split(&["--blocks", "2"], "two").fine();
    let three = split(&["--blocks", "3"], "three").fine();
    assert!(!three.stderr.contains("one fit of the whole is better"), "{}", three.stderr);
    std::fs::remove_dir_all(path("two/block-01")).unwrap();
    std::fs::rename(path("three/block-01"), path("two/block-01")).unwrap();
    let mixed = splatweaver(&[&"merge", &path("two"), &"-o", &path("scene.ply")]);
    mixed.refused(1, &["two/block-01", "of the same split as the first, found another"]);
    let partial = splatweaver(&[&"merge", &path("three"), &"-o", &path("scene.ply")]);
    partial.refused(1, &["three/block-01: blocks: expected a block that `splatweaver split` wrote, found none"]);
}
