//! `render` from every source of cameras.

use crate::capture;
use crate::in_process::splatweaver;
use std::path::{Path, PathBuf};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::realestate::{Clip, ClipFrame};
use weaver_io::{Background, Image, Transforms, write_gaussians};
use weaver_scene::{Frame, Gaussians, Keyframes};

/// A red Gaussian before a large blue one, on the z axis.
pub fn splats() -> Gaussians {
    Gaussians {
        means: vec![[0.0, 0.0, 2.0], [0.0, 0.0, 3.0]],
        log_scales: vec![[-2.0; 3], [0.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        opacity_logits: vec![8.0, 8.0],
        sh: vec![1.7, -1.7, -1.7, -1.7, -1.7, 1.7],
        degree: 0,
    }
}

fn scene(folder: &Path) -> PathBuf {
    let path = folder.join("scene.ply");
    write_gaussians(&path, &splats()).unwrap();
    path
}

fn clip(folder: &Path) -> PathBuf {
    let path = folder.join("clip.txt");
    let frame = |i: u64| ClipFrame {
        timestamp: 1000 * i,
        normalized: [0.8, 1.0, 0.5, 0.5],
        pose: Pose::new(Default::default(), DVec3::new(0.1 * i as f64, 0.0, 0.0)),
    };
    Clip { url: "http://example.org".into(), frames: (0..3).map(frame).collect() }.write(&path).unwrap();
    path
}

#[test]
fn a_clip_needs_a_size_and_gets_a_picture_per_camera() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, clip, out) = (scene(folder.path()), clip(folder.path()), folder.path().join("out"));
    splatweaver(&[&"render", &scene, &"--cameras", &clip, &"-o", &out]).refused(2, &["--width", "clip.txt"]);
    let size: [&str; 6] = ["--width", "20", "--height", "16", "--background", "0,1,0"];
    let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"render", &scene, &"--cameras", &clip, &"-o", &out];
    line.extend(size.iter().map(|s| s as &dyn AsRef<std::ffi::OsStr>));
    let done = splatweaver(&line).fine();
    assert!(done.stdout.contains("pictures: 3 of 2 Gaussians"), "{}", done.stdout);
    for name in ["0.png", "1000.png", "2000.png"] {
        assert_eq!(Image::dimensions(out.join(name)).unwrap(), (20, 16));
    }
    let image = Image::read(out.join("0.png"), Background::Black).unwrap();
    let pixel = |x: usize, y: usize| &image.pixels[(y * 20 + x) * 3..][..3];
    let middle = pixel(10, 8);
    assert!(middle[0] > 0.8 && middle[1] < 0.1, "red in the middle: {middle:?}");
    let corner = pixel(0, 0);
    assert!(corner[0] < 0.1 && corner[1] + corner[2] > 0.9, "blue and background in the corner: {corner:?}");
}

#[test]
fn transforms_and_colmap_give_the_same_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let transforms = capture::transforms(folder.path(), 2);
    capture::colmap(folder.path(), 2);
    // The photos are not needed here.
    std::fs::remove_dir_all(folder.path().join("images")).unwrap();
    let results = tempfile::tempdir().unwrap();
    let (a, b) = (results.path().join("a"), results.path().join("b"));
    splatweaver(&[&"render", &scene, &"--cameras", &transforms, &"--width", &"60", &"-o", &a]).fine();
    splatweaver(&[&"render", &scene, &"--cameras", &folder.path(), &"--width", &"60", &"-o", &b]).fine();
    for name in ["00.png", "01.png"] {
        assert_eq!(Image::dimensions(a.join(name)).unwrap(), (60, 48));
        let read = |folder: &Path| Image::read(folder.join(name), Background::Black).unwrap().to_bytes();
        let differ = read(&a).iter().zip(read(&b)).any(|(x, y)| x.abs_diff(y) > 1);
        assert!(!differ, "{name}");
    }
}

#[test]
fn an_orbit_goes_around() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, out) = (scene(folder.path()), folder.path().join("out"));
    splatweaver(&[&"render", &scene, &"--orbit", &"4", &"--width", &"32", &"-o", &out]).fine();
    let middle = |name: &str| {
        let image = Image::read(out.join(name), Background::Black).unwrap();
        assert_eq!((image.width, image.height), (32, 24));
        let at = (12 * 32 + 16) * 3;
        [image.pixels[at], image.pixels[at + 2]]
    };
    let (front, back) = (middle("0000.png"), middle("0002.png"));
    assert!(front[0] > front[1], "the red one is in front: {front:?}");
    assert!(back[1] > back[0], "the blue one is, from behind: {back:?}");
}

/// Promise (scenes): `render --path` films keyframes at equal times, and refuses keys that contradict.
#[test]
fn keyframes_are_filmed() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, keys, out) = (scene(folder.path()), folder.path().join("path.json"), folder.path().join("out"));
    let intrinsics = Intrinsics { fx: 20.0, fy: 20.0, cx: 10.0, cy: 8.0 };
    let key = |time: f64, x: f64| {
        let pose = Pose::new(Default::default(), DVec3::new(x, 0.0, 0.0));
        Frame { time: Some(time), ..Frame::new("key", Camera { pose, intrinsics, width: 20, height: 16 }) }
    };
    let write = |path: &Path, frames: &[Frame]| {
        Transforms { frames: frames.to_vec(), ..Transforms::default() }.write(path).unwrap();
    };
    let frames = [key(0.0, 0.0), key(0.1, 0.4), key(0.3, -0.2)];
    write(&keys, &frames);
    let done = splatweaver(&[&"render", &scene, &"--path", &keys, &"-o", &out]).fine();
    assert!(done.stdout.contains("pictures: 10 of 2 Gaussians"), "{}", done.stdout);
    let (cameras, same) = (folder.path().join("film.json"), folder.path().join("same"));
    write(&cameras, &Keyframes::new(&frames).unwrap().frames(10));
    splatweaver(&[&"render", &scene, &"--cameras", &cameras, &"-o", &same]).fine();
    for i in 0..10 {
        let [film, single] = [&out, &same].map(|folder| std::fs::read(folder.join(format!("{i:04}.png"))).unwrap());
        assert!(film == single, "picture {i}");
    }
    let few = folder.path().join("few");
    splatweaver(&[&"render", &scene, &"--path", &keys, &"--pictures", &"3", &"-o", &few]).fine();
    assert!(few.join("0002.png").exists() && !few.join("0003.png").exists());
    let render = |path: &dyn AsRef<std::ffi::OsStr>| splatweaver(&[&"render", &scene, &"--path", path, &"-o", &out]);
    render(&"ellipse").refused(2, &["--path: expected --cameras"]);
    render(&"circle").refused(2, &["ellipse, spline, dolly"]);
    let both = [&"render" as &dyn AsRef<_>, &scene, &"--path", &keys, &"--cameras", &cameras, &"-o", &out];
    splatweaver(&both).refused(2, &["without --cameras"]);
    write(&keys, &frames[..1]);
    render(&keys).refused(1, &["path.json", "at least two keys, found 1"]);
    write(&keys, &[key(0.0, 0.0), key(0.0, 1.0)]);
    render(&keys).refused(1, &["path.json", "frames[1].time: expected a time after 0, found 0"]);
    std::fs::write(&keys, r#"{"frames": [{"time": NaN}]}"#).unwrap();
    render(&keys).refused(1, &["path.json", "NaN"]);
}

#[test]
fn other_forms_of_gaussians_render_too() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("scene.splat"), folder.path().join("out"));
    // One Gaussian: position, scale, RGBA, rotation with 128 for zero and 255 for one.
    let floats = [0.0f32, 0.0, 0.0, 0.5, 0.5, 0.5];
    let mut bytes: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([255, 0, 0, 255, 255, 128, 128, 128]);
    std::fs::write(&path, bytes).unwrap();
    splatweaver(&[&"render", &path, &"--orbit", &"1", &"--width", &"16", &"-o", &out]).fine();
    let image = Image::read(out.join("0000.png"), Background::Black).unwrap();
    let middle = &image.pixels[(6 * 16 + 8) * 3..][..3];
    assert!(middle[0] > 0.9 && middle[1] < 0.3, "{middle:?}");
}

#[test]
fn files_that_cannot_be_rendered_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (path, cameras, out) = (folder.path().join("scene.ply"), clip(folder.path()), folder.path().join("out"));
    let render =
        || splatweaver(&[&"render", &path, &"--cameras", &cameras, &"-o", &out, &"--width", &"8", &"--height", &"8"]);
    render().refused(1, &["scene.ply"]);
    scene(folder.path());
    render().fine();
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() - 9]).unwrap();
    render().refused(1, &["scene.ply", "vertex"]);
    write_gaussians(&path, &Gaussians::default()).unwrap();
    splatweaver(&[&"render", &path, &"--orbit", &"3", &"-o", &out]).refused(1, &["scene.ply", "found none"]);
    std::fs::write(&path, whole).unwrap();
    std::fs::write(&cameras, "http://example.org\n").unwrap();
    render().refused(1, &["clip.txt", "expected a camera"]);
}

/// A scene is drawn as its summary says unless flags do.
///
/// Promise (options): `render` draws by the scene's summary, unless flags differ.
#[test]
fn flags_win_over_the_summary() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, clip) = (scene(folder.path()), clip(folder.path()));
    let picture = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"render", &scene, &"--cameras", &clip, &"-o", &out];
        line.extend(["--width", "20", "--height", "16"].iter().map(|s| s as &dyn AsRef<std::ffi::OsStr>));
        more.iter().for_each(|argument| line.push(argument));
        splatweaver(&line).fine();
        Image::read(out.join("0.png"), Background::Black).unwrap().pixels
    };
    let plain = picture("plain", &[]);
    // Without the red Gaussian, half as opaque, before another color.
    let flags = ["--near=2.5", "--alpha-max=0.5", "--background=black", "--antialiased"];
    let by_flags = picture("flags", &flags);
    for flag in flags {
        assert_ne!(picture("one", &[flag]), plain, "{flag}");
    }
    let summary = r#"{"near": 2.5, "alpha_max": 0.5, "background": [0, 0, 0], "antialiased": true}"#;
    std::fs::write(folder.path().join("summary.json"), summary).unwrap();
    assert_eq!(picture("summary", &[]), by_flags);
    let back = ["--near=0.01", "--alpha-max=0.99", "--background=white", "--antialiased=false"];
    assert_eq!(picture("back", &back), plain);
}

/// A network's result is drawn from its file as the network drew it.
#[test]
fn a_result_says_how_it_is_drawn() {
    let run = crate::run::Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let (photos, out, again) = (run.data().join("images"), folder.path().join("out"), folder.path().join("again"));
    splatweaver(&[&"infer", &"--run", &run.path(), &photos, &"-o", &out]).fine();
    let summary: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
    assert_eq!((&summary["near"], &summary["alpha_max"]), (&0.02.into(), &0.99.into()));
    let (scene, cameras) = (out.join("scene.ply"), out.join("transforms.json"));
    splatweaver(&[&"render", &scene, &"--cameras", &cameras, &"-o", &again]).fine();
    for name in ["00.png", "09.png"] {
        let [a, b] = [out.join("render"), again.clone()].map(|f| Image::read(f.join(name), Background::Black).unwrap());
        let largest = a.pixels.iter().zip(&b.pixels).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest <= 1.5 / 255.0, "{name}: {largest}");
    }
    // A run keeps its own.
    let kept = std::fs::read(run.path().join("summary.json")).unwrap();
    let copy = run.copy();
    std::fs::write(copy.path().join("summary.json"), &kept).unwrap();
    splatweaver(&[&"infer", &"--run", &run.path(), &photos, &"-o", &copy.path()]).refused(2, &["summary.json"]);
    assert_eq!(std::fs::read(copy.path().join("summary.json")).unwrap(), kept);
}

/// Promise (scenes): `render --projection` draws whole spheres and fisheyes, as pictures and films.
#[test]
fn whole_spheres_and_fisheyes() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, transforms) = (scene(folder.path()), capture::transforms(folder.path(), 2));
    let out = folder.path().join("spheres");
    let sphere: [&str; 4] = ["--projection", "equirectangular", "--width", "64"];
    let [a, b, c, d] = sphere;
    splatweaver(&[&"render", &scene, &"--cameras", &transforms, &a, &b, &c, &d, &"-o", &out]).fine();
    assert_eq!(Image::dimensions(out.join("00.png")).unwrap(), (64, 32));
    let film = folder.path().join("path.gif");
    let path: [&dyn AsRef<std::ffi::OsStr>; 4] = [&"--path", &"spline", &"--pictures", &"3"];
    let [e, f, g, h] = path;
    splatweaver(&[&"render", &scene, &"--cameras", &transforms, &a, &b, &c, &d, e, f, g, h, &"--gif", &film]).fine();
    assert!(film.is_file());
    let out = folder.path().join("fisheyes");
    splatweaver(&[
        &"render",
        &scene,
        &"--orbit",
        &"2",
        &"--projection",
        &"fisheye:180",
        &"--width",
        &"40",
        &"--background",
        &"0,1,0",
        &"-o",
        &out,
    ])
    .fine();
    let image = Image::read(out.join("0000.png"), Background::Black).unwrap();
    assert_eq!((image.width, image.height), (40, 40));
    let middle = &image.pixels[(20 * 40 + 20) * 3..][..3];
    assert!(middle[0] + middle[2] > 0.8, "the scene in the middle: {middle:?}");
    for (given, found) in [
        (["--projection", "fisheye"], "fisheye:DEGREES"),
        (["--projection", "fisheye:0"], "from 1 to 360"),
        (["--projection", "mercator"], "pinhole, equirectangular"),
    ] {
        splatweaver(&[&"render", &scene, &"--orbit", &"1", &given[0], &given[1], &"-o", &folder.path().join("x")])
            .refused(2, &[found]);
    }
    let square: [&str; 4] = ["--width", "64", "--height", "64"];
    let [w, x, y, z] = square;
    splatweaver(&[&"render", &scene, &"--orbit", &"1", &a, &b, &w, &x, &y, &z, &"-o", &folder.path().join("x")])
        .refused(2, &["twice as wide as high", "--height 64"]);
}
