//! Checkpoints in the published names: their results, and messages about checkpoints that do not fit. The network is a
//! small one of the same modules.

use crate::in_process::{Outcome, splatweaver};
use half::bf16;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use weaver_autograd::Params;
use weaver_inference::published::CONFIG;
use weaver_inference::{CameraSource, Density, Photos, Predictor, SplatWeaverPredictor};
use weaver_io::safetensors::Tensors;
use weaver_io::{Background, Image};
use weaver_model::{ModelConfig, SplatWeaver};

const WIDTH: usize = 32;
const HEIGHT: usize = 24;

fn config() -> ModelConfig {
    let mut config = ModelConfig::preset("micro").unwrap();
    let published = ModelConfig::splatweaver_1b();
    (config.width, config.height) = (WIDTH, HEIGHT);
    config.backbone.position_table = Some([5, 5]);
    config.camera.pose_frame = published.camera.pose_frame;
    config.dense.pixel_point = published.dense.pixel_point;
    config.gaussians = weaver_model::GaussianConfig {
        sh_degree: 2,
        router_hidden: config.gaussians.router_hidden,
        projector: config.gaussians.projector,
        predictor: config.gaussians.predictor,
        ..published.gaussians
    };
    config
}

/// A checkpoint as it is published: `encoder.` before every name, the aggregator in half precision.
pub fn checkpoint(prefix: &str) -> Tensors {
    let mut params = Params::<f32>::new();
    SplatWeaver::new(config(), &mut params, 11);
    let mut tensors = Tensors::default();
    for (_, param) in params.iter() {
        let (name, shape) = (format!("{prefix}{}", param.name()), param.shape());
        if param.name().starts_with("aggregator.") {
            let narrow = param.value().iter().map(|x| bf16::from_f32(*x)).collect();
            tensors.insert(name, shape.dims(), narrow);
        } else {
            tensors.insert(name, shape.dims(), param.value().to_vec());
        }
    }
    tensors.insert(format!("{prefix}aggregator.patch_embed.mask_token"), &[1, 32], vec![bf16::ONE; 32]);
    tensors.metadata.insert(CONFIG.into(), serde_json::to_string(&config()).unwrap());
    tensors
}

/// Photos and a checkpoint, made once.
pub struct Scene {
    folder: tempfile::TempDir,
    photos: Vec<PathBuf>,
}

impl Scene {
    pub fn shared() -> &'static Self {
        static SCENE: OnceLock<Scene> = OnceLock::new();
        SCENE.get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let photo = |i: usize| {
                let mut image = Image::filled(WIDTH, HEIGHT, [0.0; 3]);
                let wave = |x: usize, y: usize| 0.5 + 0.5 * ((x * (i + 2) + 3 * y) as f32 * 0.37).sin();
                for (at, pixel) in image.pixels.chunks_mut(3).enumerate() {
                    let (x, y) = (at % WIDTH, at / WIDTH);
                    pixel.copy_from_slice(&[wave(x, y), wave(y, x), (x + y) as f32 / 56.0]);
                }
                let path = folder.path().join(format!("{i}.png"));
                image.write_png(&path).unwrap();
                path
            };
            let photos = (0..3).map(photo).collect();
            checkpoint("encoder.").write(folder.path().join("model.safetensors")).unwrap();
            Self { folder, photos }
        })
    }

    pub fn weights(&self) -> PathBuf {
        self.folder.path().join("model.safetensors")
    }

    fn infer(&self, weights: &Path, out: &Path, more: &[&str]) -> Outcome {
        let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"infer", &"--weights", &weights, &"-o", &out];
        more.iter().for_each(|argument| line.push(argument));
        self.photos.iter().for_each(|photo| line.push(photo));
        splatweaver(&line)
    }
}

/// A PLY reader of the test's own: names of the properties and rows of numbers.
fn read_ply(path: &Path) -> (Vec<String>, Vec<Vec<f32>>) {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\nelement vertex "), "{header}");
    let names: Vec<String> =
        header.lines().filter_map(|l| l.strip_prefix("property float ")).map(str::to_string).collect();
    let numbers: Vec<f32> = bytes[end..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    (names.clone(), numbers.chunks_exact(names.len()).map(<[f32]>::to_vec).collect())
}

/// The file has the network's Gaussians in the form that public viewers expect.
#[test]
fn gaussians_are_stored_as_viewers_expect() {
    let scene = Scene::shared();
    let out = scene.folder.path().join("exact");
    let done = scene.infer(&scene.weights(), &out, &[]).fine();
    assert!(done.stdout.contains("Gaussians") && done.stderr.contains("3 photos at 32x24"), "{done:?}");

    // The same network in this process, its weights widened by hand.
    let mut params = Params::<f32>::new();
    let model = SplatWeaver::declare(config(), &mut params);
    let file = Tensors::read(scene.weights()).unwrap();
    for id in params.ids() {
        let key = format!("encoder.{}", params.get(id).name());
        let values = file.widened(&key, params.get(id).shape().dims()).unwrap().into_owned();
        params.set(id, weaver_autograd::ParamValues::Owned(std::sync::Arc::new(values)));
    }
    let mut planes = Vec::new();
    for photo in &scene.photos {
        let image = Image::read(photo, Background::White).unwrap();
        (0..3).for_each(|c| planes.extend(image.pixels.iter().skip(c).step_by(3)));
    }
    let stream = weaver_kernels::random::Stream::new(0, 0, "inference");
    let photos = Photos { planes: &planes, inside: None, height: HEIGHT, width: WIDTH };
    let mut predictor = SplatWeaverPredictor::new(model, params, weaver_router::AllocationKind::Sampled, 1.0);
    let prediction = predictor.predict(photos, CameraSource::Predicted, Density::default(), stream).unwrap();
    let expected = prediction.gaussians;

    let (names, rows) = read_ply(&out.join("scene.ply"));
    let rest = (0..24).map(|i| format!("f_rest_{i}"));
    let reference: Vec<String> = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
        .map(String::from)
        .into_iter()
        .chain(rest)
        .chain(["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"].map(String::from))
        .collect();
    assert_eq!(names, reference);
    assert_eq!(rows.len(), expected.opacities.len());
    assert!(rows.len() > 500, "{} Gaussians", rows.len());
    let column = |name: &str| names.iter().position(|n| n == name).unwrap();
    let [dc, rest, opacity, scale, rotation] = ["f_dc_0", "f_rest_0", "opacity", "scale_0", "rot_0"].map(column);
    for (i, row) in rows.iter().enumerate() {
        assert_eq!(&row[..6], &[&expected.means[3 * i..3 * i + 3], &[0.0; 3]].concat()[..]);
        let probability = 1.0 / (1.0 + (-f64::from(row[opacity])).exp());
        assert!((probability - f64::from(expected.opacities[i])).abs() < 1e-6, "a logit");
        for a in 0..3 {
            let length = f64::from(row[scale + a]).exp();
            assert!((length / f64::from(expected.scales[3 * i + a]) - 1.0).abs() < 1e-5, "a logarithm");
            for k in 0..9 {
                let at = if k == 0 { dc + a } else { rest + 8 * a + k - 1 };
                assert_eq!(row[at], expected.sh[27 * i + 3 * k + a], "color-major");
            }
        }
        assert_eq!(&row[rotation..rotation + 4], &expected.quats[4 * i..4 * i + 4], "wxyz");
        let norm: f32 = row[rotation..rotation + 4].iter().map(|q| q * q).sum();
        assert!((norm - 1.0).abs() < 1e-5);
    }
}

#[test]
fn the_same_bits_whatever_the_threads_and_the_files() {
    let scene = Scene::shared();
    let folder = tempfile::tempdir().unwrap();
    let ply = |weights: &Path, name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        scene.infer(weights, &out, more).fine();
        std::fs::read(out.join("scene.ply")).unwrap()
    };
    let whole = ply(&scene.weights(), "one", &["--threads", "1"]);
    assert_eq!(ply(&scene.weights(), "two", &["--threads", "2"]), whole);
    assert_ne!(ply(&scene.weights(), "other", &["--seed", "1"]), whole);
    assert_ne!(ply(&scene.weights(), "argmax", &["--allocation", "argmax"]), whole);

    // In two files under an index, with the names of a training checkpoint.
    let tensors = checkpoint("model.encoder.");
    let mut parts = [Tensors::default(), Tensors::default()];
    let mut map = serde_json::Map::new();
    for (i, (name, tensor)) in tensors.tensors.into_iter().enumerate() {
        map.insert(name.clone(), format!("part-{}.safetensors", i % 2).into());
        parts[i % 2].tensors.insert(name, tensor);
    }
    parts[1].metadata = tensors.metadata;
    let sharded = folder.path().join("sharded");
    std::fs::create_dir(&sharded).unwrap();
    for (i, part) in parts.iter().enumerate() {
        part.write(sharded.join(format!("part-{i}.safetensors"))).unwrap();
    }
    let index = serde_json::json!({"weight_map": map}).to_string();
    std::fs::write(sharded.join("model.safetensors.index.json"), index).unwrap();
    assert_eq!(ply(&sharded, "three", &[]), whole);
}

#[test]
fn without_gaussians_there_are_points() {
    let scene = Scene::shared();
    let folder = tempfile::tempdir().unwrap();
    // VGGT's own names, and heads that nothing here uses.
    let mut tensors = checkpoint("");
    tensors.tensors.retain(|name, _| !name.starts_with("gaussian_param_head."));
    tensors.insert("point_head.norm.weight", &[4], vec![1.0f32; 4]);
    let vggt = folder.path().join("vggt.safetensors");
    tensors.write(&vggt).unwrap();
    let out = folder.path().join("vggt");
    let done = scene.infer(&vggt, &out, &[]).fine();
    assert!(done.stdout.contains("points.ply") && done.stderr.contains("no Gaussians"), "{done:?}");
    let depth = Tensors::read(out.join("depth.safetensors")).unwrap();
    let depth = depth.values::<f32>("depth", &[3, HEIGHT, WIDTH]).unwrap().to_vec();
    assert!(depth.iter().all(|d| *d > 0.0));
    assert!(out.join("transforms.json").is_file() && !out.join("scene.ply").exists());

    // The same depth from the whole checkpoint, when no Gaussians are wanted.
    let other = folder.path().join("geometry");
    scene.infer(&scene.weights(), &other, &["--geometry"]).fine();
    let [own, others] = [&out, &other].map(|folder| std::fs::read(folder.join("depth.safetensors")).unwrap());
    assert_eq!(own, others);
    // VGGT has no margin on the tangent of half the field of view, SplatWeaver has 1e-3.
    let tangents = |folder: &Path| -> Vec<f64> {
        let cameras = weaver_io::Transforms::read(folder.join("transforms.json")).unwrap();
        let tangent = |f: &weaver_scene::Frame| f.camera.width as f64 / 2.0 / f.camera.intrinsics.fx;
        cameras.frames.iter().map(tangent).collect()
    };
    for (vggt, splatweaver) in tangents(&out).into_iter().zip(tangents(&other)) {
        assert!((splatweaver - vggt - 1e-3).abs() < 1e-6, "{vggt} {splatweaver}");
    }
}

#[test]
fn given_cameras_take_the_place_of_predicted_ones() {
    let scene = Scene::shared();
    let run = crate::run::Run::shared();
    let folder = tempfile::tempdir().unwrap();
    let photos: Vec<PathBuf> = (0..3).map(|i| run.data().join(format!("images/{i:02}.png"))).collect();
    let infer = |weights: &Path, name: &str| {
        let (data, out) = (run.data(), folder.path().join(name));
        let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"infer", &"--weights", &weights, &"-o", &out];
        line.extend([&"--cameras" as &dyn AsRef<std::ffi::OsStr>, &data]);
        photos.iter().for_each(|photo| line.push(photo));
        splatweaver(&line)
    };
    let done = infer(&scene.weights(), "posed").fine();
    assert!(done.stderr.contains("cameras given") && done.stderr.contains("brought to the points"), "{}", done.stderr);
    let written = weaver_io::Transforms::read(folder.path().join("posed/transforms.json")).unwrap().frames;
    let known = weaver_io::colmap::Model::read(run.data().join("sparse/0")).unwrap().frames();
    let turn = |frames: &[weaver_scene::Frame]| frames[0].camera.pose.angle_to(&frames[2].camera.pose);
    assert!(turn(&known) > 0.01 && (turn(&written) - turn(&known)).abs() < 1e-6, "{} {}", turn(&written), turn(&known));

    let mut tensors = checkpoint("");
    tensors.tensors.retain(|name, _| !name.starts_with("gaussian_param_head."));
    let vggt = folder.path().join("vggt.safetensors");
    tensors.write(&vggt).unwrap();
    infer(&vggt, "none").refused(1, &["cameras", "makes Gaussians"]);
}

#[test]
fn photos_of_any_shape() {
    let scene = Scene::shared();
    let folder = tempfile::tempdir().unwrap();
    let wide = folder.path().join("wide.png");
    Image::filled(160, 50, [0.2, 0.4, 0.6]).write_png(&wide).unwrap();
    let infer = |more: &[&str], name: &str| {
        let out = folder.path().join(name);
        let mut line: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"infer", &"--weights"];
        let weights = scene.weights();
        line.extend([&weights as &dyn AsRef<std::ffi::OsStr>, &wide, &wide, &"-o", &out]);
        more.iter().for_each(|argument| line.push(argument));
        splatweaver(&line)
    };
    assert!(infer(&[], "crop").fine().stderr.contains("2 photos at 32x24"));
    assert!(infer(&["--keep-aspect"], "aspect").fine().stderr.contains("2 photos at 32x8"));
    assert!(infer(&["--size", "48x16"], "size").fine().stderr.contains("2 photos at 48x16"));
    infer(&["--size", "30"], "odd").refused(2, &["multiples of 8", "found 30"]);
    infer(&["--size", "none"], "none").refused(2, &["448x252"]);
}

/// All faults of a checkpoint, in one line, and nothing written.
#[test]
fn everything_that_does_not_fit_is_listed() {
    let scene = Scene::shared();
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("bad.safetensors"), folder.path().join("out"));
    let refused = |tensors: &Tensors, parts: &[&str]| {
        tensors.write(&path).unwrap();
        scene.infer(&path, &out, &[]).refused(1, parts);
        assert!(!out.exists());
    };
    let mut tensors = checkpoint("encoder.");
    for name in ["encoder.camera_head.trunk.0.norm1.bias", "encoder.depth_head.norm.weight"] {
        tensors.tensors.remove(name).unwrap();
    }
    tensors.insert("encoder.depth_head.norm.bias", &[3], vec![0.0f32; 3]);
    tensors.insert("encoder.camera_head.token_norm.bias", &[64], vec![0i64; 64]);
    tensors.insert("encoder.surprise.weight", &[1], vec![0.0f32]);
    tensors.insert("decoder.weight", &[1], vec![0.0f32]);
    let fc2 = "encoder.camera_head.pose_branch.fc2.bias";
    tensors.insert(fc2, &[9], [[0.0f32; 8].as_slice(), &[f32::NAN]].concat());
    refused(
        &tensors,
        &[
            "2 tensors missing: encoder.camera_head.trunk.0.norm1.bias, encoder.depth_head.norm.weight",
            "2 tensors of another shape or type",
            "encoder.depth_head.norm.bias (expected [64], found [3])",
            "encoder.camera_head.token_norm.bias (expected [64], found I64)",
            "1 tensors with NaN or infinity: encoder.camera_head.pose_branch.fc2.bias",
            "2 tensors not of this network: decoder.weight, encoder.surprise.weight",
        ],
    );
    let mut other = Tensors::default();
    other.insert("transformer.wte.weight", &[1], vec![0.0f32]);
    refused(&other, &["encoder.aggregator.camera_token", "transformer.wte.weight"]);

    let whole = std::fs::read(scene.weights()).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    scene.infer(&path, &out, &[]).refused(1, &["bad.safetensors", "complete safetensors file", "cut short"]);
    scene.infer(&folder.path().join("none.safetensors"), &out, &[]).refused(1, &["none.safetensors"]);
    scene.infer(&folder.path().join("model.ckpt"), &out, &[]).refused(1, &["convert-weights"]);
    // Sizes in the metadata that no file of this many tensors can have, and sizes that cannot be run.
    for (key, value, message) in [("backbone", "rounds", "layers"), ("gaussians", "neighbors", "neighbors")] {
        let mut impossible = checkpoint("encoder.");
        let mut config: serde_json::Value = serde_json::from_str(&impossible.metadata[CONFIG]).unwrap();
        config[key][value] = 1_000_000u64.into();
        impossible.metadata.insert(CONFIG.into(), config.to_string());
        refused(&impossible, &["metadata splatweaver_model", message]);
    }
    // A file where the folder is to be: said before the network runs.
    scene
        .infer(&scene.weights(), &path, &[])
        .refused(1, &["bad.safetensors: folder: expected one that can be written to"]);
    // Larger than any machine: refused with the figure and the remedy.
    scene
        .infer(&scene.weights(), &out, &["--size", "16384"])
        .refused(75, &["GB", "fewer photos", "--size", "--geometry"]);
    assert!(!out.exists());
    let photo = folder.path().join("a.png");
    std::fs::write(&photo, "no picture").unwrap();
    splatweaver(&[&"infer", &"--weights", &scene.weights(), &photo, &"-o", &out])
        .refused(1, &["a.png", "JPEG, PNG, TIFF or WebP"]);
    assert!(!out.exists());
}

#[test]
fn pytorch_checkpoints_are_converted() {
    let folder = tempfile::tempdir().unwrap();
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures/torch_checkpoint.ckpt");
    let out = folder.path().join("model.safetensors");
    let done = splatweaver(&[&"convert-weights", &sample, &"-o", &out]).fine();
    assert!(done.stdout.contains("8 tensors"), "{done:?}");
    let info = splatweaver(&[&"info", &out]).fine().stdout;
    assert!(info.contains("b.narrow BF16 [3]"), "{info}");
    let other = folder.path().join("other.safetensors");
    splatweaver(&[&"convert-weights", &out, &"-o", &other]).refused(1, &["model.safetensors", "metadata format"]);
    splatweaver(&[&"convert-weights", &out, &"-o", &out]).refused(2, &["model.safetensors", "what is read"]);
}
