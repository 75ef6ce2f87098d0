//! `fit --surfaces`: depth of files, and of photos that agree about it.

use crate::capture;
use crate::in_process::{Outcome, line};
use serde_json::{Value, json};
use std::path::Path;
use weaver_io::Transforms;
use weaver_procedural::{ProceduralOptions, scene};

const VIEWS: usize = 8;

/// A capture whose frames name pictures of their depth.
fn capture_with_depth(folder: &Path) {
    let file = capture::transforms(folder, VIEWS);
    let drawn = scene(5, &ProceduralOptions { width: 40, height: 32, views: VIEWS });
    std::fs::create_dir_all(folder.join("depth")).unwrap();
    for (i, view) in drawn.views.iter().enumerate() {
        let depth = view.depth.as_ref().unwrap();
        let units = depth.iter().map(|z| (1000.0 * z).round().min(65_535.0) as u16).collect();
        let picture = image_files::ImageBuffer::<image_files::Luma<u16>, Vec<u16>>::from_raw(40, 32, units).unwrap();
        picture.save(folder.join(format!("depth/{i:02}.png"))).unwrap();
    }
    capture::edit(&file, |text| {
        let mut value: Value = serde_json::from_str(&text).unwrap();
        for (i, frame) in value["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
            frame["depth_file_path"] = json!(format!("depth/{i:02}.png"));
        }
        value.to_string()
    });
    assert!(Transforms::read(&file).unwrap().frames.iter().all(|frame| frame.extras.contains_key("depth_file_path")));
}

fn fit(folder: &Path, out: &str, flags: &str) -> Outcome {
    let size = "--steps 30 --gaussians 2000 --hold-out none --no-html -o";
    line(&[&"fit", &folder.join("capture"), &size, &folder.join(out), &flags])
}

/// Promise (files): depth that a capture's files have counts in `fit --surfaces`; a file that is missing, of another
/// shape or no depth is named.
#[test]
fn depth_of_files_counts() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let capture = folder.join("capture");
    std::fs::create_dir(&capture).unwrap();
    capture_with_depth(&capture);
    let fitted = fit(folder, "with", "--surfaces").fine();
    assert!(fitted.stderr.contains("the depth of 8 photos counts, by depth_file_path"), "{}", fitted.stderr);
    let picture = capture.join("depth/03.png");
    image_files::ImageBuffer::<image_files::Luma<u16>, Vec<u16>>::new(20, 20).save(&picture).unwrap();
    fit(folder, "shape", "--surfaces").refused(1, &["03.png: depth_file_path: expected the shape of the photo, 40x32"]);
    image_files::RgbImage::new(40, 32).save(&picture).unwrap();
    fit(folder, "colors", "--surfaces").refused(1, &["03.png: depth: expected millimeters"]);
    std::fs::remove_file(&picture).unwrap();
    fit(folder, "missing", "--surfaces").refused(1, &["03.png"]);
    let file = capture.join("transforms.json");
    crate::capture::edit(&file, |text| text.replace("\"depth/05.png\"", "5"));
    image_files::ImageBuffer::<image_files::Luma<u16>, Vec<u16>>::new(40, 32).save(&picture).unwrap();
    fit(folder, "number", "--surfaces").refused(1, &["depth_file_path: expected the name of a file, found 5"]);
    // Without the flag nobody asks for it.
    fit(folder, "without", "--keep-all").fine();
}
