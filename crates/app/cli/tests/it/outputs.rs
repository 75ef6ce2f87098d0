//! Existing files: no command replaces them, whichever output folder is given.

use crate::command::{BINARY, capture, printed, refused, splatweaver, text};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use weaver_io::Transforms;
use weaver_scene::Gaussians;

/// All files below a folder with their content.
fn snapshot(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(snapshot(&path));
        } else {
            files.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    files
}

/// A capture of every kind of file that commands read: photos, both forms of cameras, a scene, features, masks.
fn inputs(folder: &Path) {
    capture(folder);
    let data = folder.join("capture");
    let frames = Transforms::read(data.join("transforms.json")).unwrap().frames;
    fs::create_dir_all(data.join("sparse/0")).unwrap();
    weaver_io::colmap::Model::from_frames(&frames).write_binary(data.join("sparse/0")).unwrap();
    let gaussians = Gaussians {
        means: vec![[0.0, 0.0, 2.0]],
        log_scales: vec![[-2.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.0],
        sh: vec![0.5; 3],
        degree: 0,
    };
    weaver_io::write_gaussians(data.join("scene.ply"), &gaussians).unwrap();
    fs::create_dir(data.join("features")).unwrap();
    weaver_io::write_npy(data.join("features/00.npy"), &[2, 2], &[1.0, 0.0, 0.0, 1.0]).unwrap();
    fs::write(data.join("list.txt"), "00.npy\n").unwrap();
    for name in ["page.html", "scene.wsz", "w.safetensors", "images/00.ply"] {
        fs::write(data.join(name), "mine").unwrap();
    }
}

/// Command lines whose results would replace their inputs or land among them.
const OVER: [&str; 46] = [
    "fit capture -o capture",
    "fit capture -o capture/fit",
    "fit capture -o capture/images",
    "fit capture/transforms.json -o capture --steps 2",
    "fit capture --cameras estimated -o capture",
    "cameras capture/images -o capture",
    "cameras capture/images -o capture/images",
    "cameras capture/images/00.png capture/images/01.png -o capture/images",
    "cameras capture/images -o capture/images/found",
    "reconstruct capture/images -o capture",
    "reconstruct capture/images -o capture/images",
    "reconstruct capture -o capture",
    "infer capture/images -o capture",
    "infer capture/images -o capture/images",
    "infer capture/images --cameras capture/transforms.json -o capture",
    "render capture/scene.ply --cameras capture/transforms.json -o capture/images",
    "render capture/scene.ply --cameras capture -o capture/images",
    "align capture/scene.ply --photos capture/images --cameras capture/transforms.json -o capture",
    "align capture/scene.ply --photos capture/images --cameras capture/transforms.json -o capture/images",
    "query capture/scene.ply --cameras capture/transforms.json --features capture/features/00.npy --prompts capture/features/00.npy -o capture/images",
    "lift capture/scene.ply --cameras capture/transforms.json --features capture/features -o capture/features/00.npy",
    "lift capture/scene.ply --cameras capture/transforms.json --features capture/features -o capture/scene.ply",
    "train --preset micro --data capture --out capture --set data.scene_scale=1",
    "train --preset micro --data capture --out capture/run --set data.scene_scale=1",
    "train --preset micro --data capture --out run --trace capture/transforms.json --set data.scene_scale=1",
    "convert-weights capture/w.safetensors -o capture/w.safetensors",
    "dynamic train --data capture -o capture",
    "vad train --features capture/features --list capture/list.txt --out capture/features",
    "vad score --run capture/scene.ply capture/features/00.npy -o capture/images",
    "vad eval --run run --features capture/features --list capture/list.txt --annotation capture/page.html --report capture/page.html",
    "merge capture -o capture/scene.ply",
    "merge capture -o capture/images/00.ply",
    "convert capture/scene.ply capture/scene.ply",
    "convert capture/scene.ply capture/scene.ply --scale 2",
    "mesh capture/scene.ply --cameras capture/transforms.json -o capture/scene.ply",
    "mesh capture -o capture/scene.ply",
    "compress capture/scene.wsz --psnr 40 -o capture/scene.wsz",
    "view capture/scene.ply --cameras capture --html capture/page.html",
    "view capture/scene.ply --cameras capture/page.html --html capture/page.html",
    "bench compress capture/scene.ply --cameras capture/page.html --html capture/page.html",
    "bench compress capture/scene.ply --data capture --html capture/page.html",
    "bench compress capture/scene.ply --data capture -o capture",
    "bench compress capture/scene.ply --data capture -o capture/sub",
    "bench raster --workload capture/w.safetensors --dump capture/w.safetensors",
    "infer capture/images --run capture -o capture/images",
    "split capture --blocks 2 -o capture/blocks",
];

/// Command lines that would put a file of another kind in place of a photo.
const OVER_PHOTOS: [&str; 17] = [
    "image fit capture/images/00.png -o PHOTO",
    "image draw capture/scene.ply -o capture/images/01.jpg",
    "mesh capture/scene.ply --cameras capture/transforms.json -o PHOTO",
    "mesh capture -o PHOTO",
    "view capture/scene.ply --html PHOTO",
    "view capture/scene.ply --cameras capture/transforms.json --html PHOTO",
    "render capture/scene.ply --orbit 2 --gif PHOTO",
    "render capture/scene.ply --orbit 2 --webp PHOTO",
    "render capture/scene.ply --orbit 2 --video PHOTO",
    "render capture/scene.ply --orbit 2 --video capture/scene.ply",
    "compress capture/scene.ply -o PHOTO",
    "bench compress capture/scene.ply --html PHOTO",
    "bench raster --synthetic 10,8,8 --dump PHOTO",
    "train --preset micro --out run --trace PHOTO",
    "convert-weights capture/w.safetensors -o PHOTO",
    "lift capture/scene.ply --cameras capture/transforms.json --features capture/features -o PHOTO",
    "vad eval --run run --report PHOTO",
];

/// A file for results has the ending of its kind, so that a mistyped name costs no photo.
///
/// Promise (files): a file for results has the ending of its kind, so that a mistyped name costs no photo.
#[test]
fn no_photo_is_replaced_by_another_kind() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    let before = snapshot(folder);
    for line in OVER_PHOTOS {
        let message = refused(folder, &line.replace("PHOTO", "capture/images/01.png"), 2);
        assert!(message.contains("expected a name that ends with ."), "{line}: {message}");
        assert!(snapshot(folder) == before, "{line}");
    }
    // The formats of scenes have a message of their own.
    for line in ["convert capture/scene.ply capture/images/01.png", "merge blocks -o capture/images/01.png"] {
        let message = refused(folder, line, 1);
        assert!(message.contains("file name: expected .ply"), "{line}: {message}");
        assert!(snapshot(folder) == before, "{line}");
    }
}

/// No command writes over its inputs or among them.
///
/// Promise of `only_the_writer_replaces_files`.
#[test]
fn no_command_writes_over_what_it_reads() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    let before = snapshot(folder);
    for line in OVER {
        let start = Instant::now();
        let message = refused(folder, line, 2);
        assert!(message.contains("output: expected"), "{line}: {message}");
        assert!(start.elapsed() < Duration::from_secs(20), "{line}: refused only after {:?}", start.elapsed());
        assert!(!message.contains("matching"), "{line}: only after some work: {message}");
        let after = snapshot(folder);
        let changed: Vec<_> = after.keys().chain(before.keys()).filter(|p| before.get(*p) != after.get(*p)).collect();
        assert!(changed.is_empty(), "{line} changed {changed:?}");
    }
}

/// Results are made anew in their place and other files stay.
///
/// Promise of `only_the_writer_replaces_files`.
#[test]
fn results_are_replaced_and_other_files_stay() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    let render = "render capture/scene.ply --cameras capture/transforms.json -o renders";
    printed(folder, render);
    fs::write(folder.join("renders/notes.txt"), "mine").unwrap();
    let first = fs::read(folder.join("renders/00.png")).unwrap();
    fs::write(folder.join("renders/00.png"), "broken").unwrap();
    printed(folder, render);
    assert!(fs::read(folder.join("renders/00.png")).unwrap() == first);
    assert_eq!(fs::read_to_string(folder.join("renders/notes.txt")).unwrap(), "mine");
    // Without the record their origin is unknown.
    fs::remove_file(folder.join("renders/written.jsonl")).unwrap();
    let message = refused(folder, render, 2);
    assert!(message.contains("renders/00.png") && message.contains("a photo"), "{message}");
}

fn start(folder: &Path, line: &str) -> Child {
    let quiet = || Stdio::null();
    let mut command = Command::new(BINARY);
    command.current_dir(folder).args(line.split(' ')).stdout(quiet()).stderr(quiet()).spawn().unwrap()
}

/// Promise of `a_folder_is_written_by_one_run_at_a_time`.
#[test]
fn one_folder_is_written_by_one_run() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    // Both at once: one of them makes the scene, the other nothing.
    let line = "fit capture -o out --steps 400 --gaussians 500";
    let both = [start(folder, line), start(folder, line)].map(|mut child| child.wait().unwrap().code());
    assert!(both == [Some(0), Some(2)] || both == [Some(2), Some(0)], "{both:?}");
    // While one is under way, nothing goes on with it, and nothing else is written there.
    let mut child = start(folder, "fit capture -o long --steps 2000000 --gaussians 500");
    while !folder.join("long/run.json").exists() {
        assert!(child.try_wait().unwrap().is_none(), "ended early");
        std::thread::sleep(Duration::from_millis(5));
    }
    for line in ["fit --resume long", "render capture/scene.ply --orbit 2 -o long"] {
        let message = refused(folder, line, 2);
        assert!(message.contains("long") && message.contains("in use by another run"), "{line}: {message}");
    }
    let message = refused(folder, "fit capture -o long --steps 2", 2);
    assert!(message.contains("a run exists there already"), "{message}");
    child.kill().unwrap();
    child.wait().unwrap();
    printed(folder, "render capture/scene.ply --orbit 2 -o long");
    // The same for training.
    let mut child = start(folder, "train --preset micro --steps 100000 --out run");
    while !folder.join("run/config.toml").exists() {
        assert!(child.try_wait().unwrap().is_none(), "ended early");
        std::thread::sleep(Duration::from_millis(5));
    }
    let message = refused(folder, "train --resume run", 2);
    assert!(message.contains("in use by another run"), "{message}");
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Promise (kept): an output that cannot be written is found before any work.
#[test]
fn what_cannot_be_written_is_found_before_any_work() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    fs::write(folder.join("file"), "").unwrap();
    for line in [
        "cameras capture/images -o file/out",
        "reconstruct capture/images -o file/out",
        "fit capture -o file/out",
        "fit capture --cameras estimated -o file/out",
        "fit capture --cameras estimated --lpips file/lpips.safetensors -o run",
        "fit capture --cameras estimated --init file/scene.ply -o run",
        "infer capture/images -o file/out",
        "render capture/scene.ply --orbit 2 -o file/out",
        "render capture/scene.ply --orbit 2 --video file/out.mp4",
        "align capture/scene.ply --photos capture/images --cameras capture/transforms.json -o file/out",
        "lift capture/scene.ply --cameras capture/transforms.json --features capture/features -o file/out.safetensors",
        "train --preset micro --out file/out",
        "train --preset micro --out run --trace file/trace.json",
        "convert-weights capture/features/00.npy -o file/out.safetensors",
        "dynamic train -o file/out",
        "vad train --out file/out",
        "vad score --run nothing.safetensors capture/features/00.npy -o file/out",
        "bench raster --synthetic 100,64,48 --dump file/out.safetensors",
    ] {
        let done = splatweaver(folder, line);
        let message = text(&done.stderr);
        assert_eq!(done.status.code(), Some(1), "{line}: {message}");
        assert_eq!(message.lines().count(), 1, "{line}: {message}");
        assert!(message.contains("file"), "{line}: {message}");
        assert!(!folder.join("run").exists(), "{line}");
    }
}

/// Promise (kept): pictures too large for memory are refused.
#[test]
fn pictures_too_large_for_memory_are_refused() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    let path = folder.join("capture/transforms.json");
    let mut huge: serde_json::Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    for frame in huge["frames"].as_array_mut().unwrap() {
        frame["w"] = (1 << 20).into();
        frame["h"] = (1 << 20).into();
    }
    fs::write(folder.join("huge.json"), huge.to_string()).unwrap();
    for line in [
        "render capture/scene.ply --orbit 2 --width 65536 --height 65536 -o out",
        "render capture/scene.ply --cameras huge.json -o out",
        "render capture/scene.ply --cameras huge.json --video out.mp4",
    ] {
        let message = refused(folder, line, 75);
        assert!(message.starts_with("error: memory: expected") && message.contains("--width"), "{line}: {message}");
        assert!(!folder.join("out").exists() && !folder.join("out.mp4").exists(), "{line}");
    }
}

/// Promise (figures): a scene without Gaussians has no quality.
#[test]
fn an_empty_scene_has_no_quality() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    weaver_io::write_gaussians(folder.join("empty.ply"), &Gaussians::default()).unwrap();
    let message = refused(folder, "compare empty.ply --data capture", 1);
    assert!(message.contains("empty.ply: expected Gaussians to judge, found none"), "{message}");
}

/// A camera of one pixel is not taken for another format.
///
/// Promise (figures): a camera of one pixel is not taken for another format.
#[test]
fn a_camera_of_one_pixel_keeps_its_format() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    let path = folder.join("capture/transforms.json");
    let mut small: serde_json::Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    for frame in small["frames"].as_array_mut().unwrap() {
        frame["w"] = 1.into();
        frame["h"] = 1.into();
    }
    fs::write(folder.join("small.json"), small.to_string()).unwrap();
    printed(folder, "render capture/scene.ply --cameras small.json -o out");
    assert_eq!(weaver_io::Image::dimensions(folder.join("out/00.png")).unwrap(), (1, 1));
}

/// Promise (kept): names of any bytes, and those that begin with a hyphen, reach the fit of `reconstruct`.
#[cfg(unix)]
#[test]
fn names_of_any_bytes_reach_the_fit() {
    use std::os::unix::ffi::OsStrExt;
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    inputs(folder);
    // Like a flag, and no text.
    let name = std::ffi::OsStr::from_bytes(b"-sc\xffne");
    let mut flag = std::ffi::OsString::from("-o=");
    flag.push(name);
    let mut command = Command::new(BINARY);
    command.current_dir(folder).args(["reconstruct", "capture", "--minutes", "0.05", "--gaussians", "200"]);
    let done = command.arg(flag).output().unwrap();
    let said = text(&done.stderr);
    assert!(done.status.success() && said.contains("cameras: those of capture"), "{said}");
    assert!(folder.join(name).join("scene.ply").is_file());
}

#[cfg(unix)]
#[test]
fn folders_of_any_bytes_can_be_worked_in() {
    use std::os::unix::ffi::OsStrExt;
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join(std::ffi::OsStr::from_bytes(b"J\xfcrgen"));
    if fs::create_dir(&folder).is_err() {
        return println!("skipped: no names that are not UTF-8");
    }
    inputs(&folder);
    // Paths inside of files are relative to them.
    printed(&folder, "cameras capture/images -o cams");
    printed(&folder, "fit cams --steps 5 --gaussians 200 -o fit");
    printed(&folder, "fit --resume fit");
    printed(&folder, "reconstruct capture/images --minutes 0.05 --gaussians 200 -o scene");
    printed(&folder, "fit --resume scene");
    printed(&folder, "compare fit/scene.ply --data fit");
    // Commands that would store the whole path are refused.
    for line in ["train --preset micro --data capture --out run", "dynamic train --data capture --out mix"] {
        let message = refused(&folder, line, 1);
        assert!(message.contains("path: expected UTF-8"), "{line}: {message}");
    }
}
