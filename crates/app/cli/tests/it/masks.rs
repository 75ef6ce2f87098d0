//! Masks on the command line: with photos alone, and with a capture.

use crate::in_process::splatweaver;
use crate::run::Run;
use std::path::Path;
use weaver_io::{Background, Image};

/// A copy of the run's photos, the left half of each masked and full of garbage.
fn masked(folder: &Path, garbage: f32) -> Vec<std::path::PathBuf> {
    for name in ["images", "masks", "sparse/0"] {
        std::fs::create_dir_all(folder.join(name)).unwrap();
    }
    for entry in std::fs::read_dir(Run::shared().data().join("sparse/0")).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), folder.join("sparse/0").join(entry.file_name())).unwrap();
    }
    let photos = weaver_io::list_photos(Run::shared().data().join("images")).unwrap();
    let write = |photo: &std::path::PathBuf| {
        let name = photo.file_name().unwrap();
        let mut image = Image::read(photo, Background::White).unwrap();
        let mut mask = image.clone();
        for (i, (color, mask)) in image.pixels.chunks_mut(3).zip(mask.pixels.chunks_mut(3)).enumerate() {
            let inside = i % 40 >= 20;
            mask.fill(f32::from(inside));
            if !inside {
                color.fill((garbage * i as f32).fract());
            }
        }
        mask.write_png(folder.join("masks").join(name)).unwrap();
        let path = folder.join("images").join(name);
        image.write_png(&path).unwrap();
        path
    };
    photos.iter().map(write).collect()
}

/// Promise of `masked_garbage_changes_no_bit`.
#[test]
fn infer_and_eval_see_nothing_of_what_masks_leave_out() {
    let (run, folder) = (Run::shared(), tempfile::tempdir().unwrap());
    let found = [0.37, 0.81].map(|garbage| {
        let name = format!("{garbage}");
        let capture = folder.path().join(&name);
        let photos = masked(&capture, garbage);
        let [alone, posed] = ["alone", "posed"].map(|kind| folder.path().join(format!("{name}-{kind}")));
        let (a, b) = (&photos[0], &photos[1]);
        splatweaver(&[&"infer", &"--run", &run.path(), a, b, &"--masks", &"-o", &alone]).fine();
        splatweaver(&[&"infer", &"--run", &run.path(), a, b, &"--cameras", &capture, &"--masks", &"-o", &posed]).fine();
        let eval = |masks: &[&dyn AsRef<std::ffi::OsStr>]| {
            let run = run.path();
            let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"eval", &"--run", &run, &"--data", &capture];
            line.extend([&"--cameras" as &dyn AsRef<std::ffi::OsStr>, &"given"]);
            line.extend(masks);
            let text = splatweaver(&line).fine().stdout;
            text.lines().last().unwrap().to_string()
        };
        let scene = splatweaver(&[&"compare", &posed.join("scene.ply"), &"--data", &capture, &"--masks"]);
        let scenes = [alone, posed].map(|out| {
            // The left half of the map of Gaussians per pixel is black.
            let counts = Image::read(out.join("experts/00.png"), Background::White).unwrap();
            let left = counts.pixels.chunks(3).enumerate().filter(|(i, _)| i % counts.width < counts.width / 2 - 1);
            assert!(left.clone().all(|(_, color)| color[0] == 0.0) && counts.pixels.contains(&1.0));
            std::fs::read(out.join("scene.ply")).unwrap()
        });
        (scenes, eval(&[&"--masks"]), scene.fine().stdout, eval(&[]))
    });
    let [(scenes, masked, of_scene, plain), (others, other_masked, of_other, other_plain)] = found;
    assert!(scenes == others);
    assert_eq!((masked, of_scene), (other_masked, of_other));
    assert_ne!(plain, other_plain);
}

/// Photos without masks are refused with the names of the missing files.
#[test]
fn photos_without_masks_are_refused() {
    let (run, folder) = (Run::shared(), tempfile::tempdir().unwrap());
    let photo = run.data().join("images/00.png");
    let out = folder.path().join("out");
    splatweaver(&[&"infer", &"--run", &run.path(), &photo, &"--masks", &"-o", &out])
        .refused(1, &["00.png: mask: expected", "masks", "no such file, and no alpha"]);
    assert!(!out.exists());
}

#[test]
fn training_sees_nothing_of_what_masks_leave_out() {
    let folder = tempfile::tempdir().unwrap();
    let weights = folder.path().join("alex.safetensors");
    crate::lpips::random_weights(&weights);
    let file = format!("stages.1.losses.image.lpips_weights={:?}", weights.display().to_string());
    let trained = |garbage: f32, masks: bool| {
        let name = format!("{garbage}-{masks}");
        let (capture, out) = (folder.path().join(&name).join("capture"), folder.path().join(&name).join("run"));
        masked(&capture, garbage);
        let masks = format!("data.masks={masks}");
        let line: [&dyn AsRef<std::ffi::OsStr>; 15] = [
            &"train",
            &"--preset",
            &"micro",
            &"--steps",
            &"3",
            &"--data",
            &capture,
            &"--out",
            &out,
            &"--set",
            &file,
            &"--set",
            &"stages.1.losses.image.lpips=0.1",
            &"--set",
            &masks,
        ];
        splatweaver(&line).fine();
        checksum(&out)
    };
    assert_eq!(trained(0.37, true), trained(0.81, true));
    assert_ne!(trained(0.37, false), trained(0.81, false));
}

fn checksum(run: &Path) -> String {
    let text = std::fs::read_to_string(run.join("summary.json")).unwrap();
    serde_json::from_str::<serde_json::Value>(&text).unwrap()["checksum"].as_str().unwrap().into()
}
