//! Mutated files: every reader refuses them or reads the rest, without a panic, in little memory and time.
//!
//! `cargo xtask stress parsers` draws many more than an ordinary run, for all readers or those whose name contains
//! `WEAVER_READER`. A file is drawn from the reader's name and a number alone, so that a failure that is printed can be
//! repeated.

use crate::array::{HEADER, npy};
use crate::colmap::model;
use crate::mutations::{files, mutate};
use flate2::Crc;
use flate2::read::GzDecoder;
use std::io::Read;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};
use weaver_codec::{Container, Stream as Coded};
use weaver_io::realestate::Clip;
use weaver_io::safetensors::Mapped;
use weaver_io::safetensors::Tensors;
use weaver_io::{Background, Image, PhotoFile, TorchCheckpoint, Transforms, colmap, ply};
use weaver_kernels::random::Stream;
use weaver_scene::Gaussians;

/// Memory that a reader may hold: so many times its input, and some more for its tables and windows.
const TIMES: u64 = 64;
const MORE: u64 = 4 << 20;
/// A decoded photo, beside a copy of it in another form.
const LARGEST: u64 = 3 * (512 << 20);
/// Long for a small file even on a busy machine in a debug build.
const LONG: Duration = Duration::from_secs(10);

/// A reader and its input: files by name, the first of them to open.
struct Reader {
    name: &'static str,
    files: Vec<(String, Vec<u8>)>,
    /// Function that makes a file of mutated content, such as compression.
    seal: fn(&[u8]) -> Vec<u8>,
    /// Reads the file of this path; false if it was refused.
    read: fn(&Path) -> bool,
    /// Bytes that it may hold beyond a multiple of its input.
    more: u64,
}

fn one(name: &'static str, file: &'static str, bytes: Vec<u8>, read: fn(&Path) -> bool) -> Reader {
    several(name, vec![(file.into(), bytes)], read)
}

fn several(name: &'static str, files: Vec<(String, Vec<u8>)>, read: fn(&Path) -> bool) -> Reader {
    Reader { name, files, seal: <[u8]>::to_vec, read, more: MORE }
}

/// The bytes that something writes to a path.
fn written(name: &str, write: impl FnOnce(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    write(&folder.path().join(name));
    std::fs::read(folder.path().join(name)).unwrap()
}

fn readers() -> Vec<Reader> {
    let gaussians = |name: &str| written(name, |path| weaver_io::write_gaussians(path, &splats()).unwrap());
    let gradient = |i: usize| (i % 97) as f32 / 97.0;
    let image = Image { width: 13, height: 9, pixels: (0..13 * 9 * 3).map(gradient).collect() };
    let png = written("a.png", |path| image.write_png(path).unwrap());
    let rgb = image::load_from_memory(&png).unwrap();
    let [tiff, webp] = ["a.tif", "a.webp"].map(|name| written(name, |path| rgb.to_rgb8().save(path).unwrap()));
    let jpeg = written("a.jpg", |path| rgb.to_rgb8().save(path).unwrap());
    // Wide enough for the threads that a decoder of reduced scales starts.
    let wide = rgb.resize_exact(272, 8, image::imageops::FilterType::Triangle).to_rgb8();
    let wide = written("a.jpg", |path| wide.save(path).unwrap());
    let mut tensors = Tensors::default();
    tensors.insert("weight", &[3, 4], vec![0.5_f32; 12]);
    tensors.insert("bias", &[4], vec![1.5_f32; 4]);
    let safetensors = written("a.safetensors", |path| tensors.write(path).unwrap());
    let index =
        r#"{"metadata": {"total_size": 64}, "weight_map": {"weight": "a.safetensors", "bias": "a.safetensors"}}"#;
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let fixture = |name: &str| std::fs::read(fixtures.join(name)).unwrap();
    let torch =
        std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../tests/fixtures/torch_checkpoint.ckpt"));
    let points = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n0 1 2 255 0 0\n1 2.5 -3e-1 0 9 1\n";
    let transforms = r#"{"fl_x": 40.0, "fl_y": 41.0, "cx": 20, "cy": 16.5, "w": 40, "h": 32, "frames": [
        {"file_path": "a.png", "transform_matrix": [[1,0,0,0.5],[0,1,0,0],[0,0,1,2],[0,0,0,1]]},
        {"file_path": "b.png", "w": 20, "transform_matrix": [[1,0,0,-1],[0,1,0,0],[0,0,1,2],[0,0,0,1]]}]}"#;
    let frames = "https://www.youtube.com/watch?v=x\n1000 0.5 0.9 0.5 0.5 0 0 1 0 0 0.5 0 1 0 0 0 0 1 2\n2000 0.5 0.9 0.5 0.5 0 0 1 0 0 0.25 0 1 0 0 0 0 1 2\n";
    let text = |text: &str| text.as_bytes().to_vec();
    let spz: fn(&Path) -> bool = |path| weaver_io::read_gaussians(path).is_ok();
    let wsz: fn(&Path) -> bool = |path| weaver_io::read_gaussians(path).is_ok();
    let photo: fn(&Path) -> bool = |path| Image::read(path, Background::White).is_ok();
    let shrunk: fn(&Path) -> bool =
        |path| PhotoFile::at(path).and_then(|photo| photo.shrink_from(0).resize_whole(44, 1)).is_ok();
    let folder: fn(&Path) -> bool = |path| colmap::Model::read(path.parent().unwrap()).is_ok();
    vec![
        one("ply", "a.ply", gaussians("a.ply"), |path| weaver_io::read_gaussians(path).is_ok()),
        one("ply points", "a.ply", text(points), |path| ply::read_points(path).is_ok()),
        one("compressed ply", "a.compressed.ply", gaussians("a.compressed.ply"), |path| {
            weaver_io::read_gaussians(path).is_ok()
        }),
        one("splat", "a.splat", gaussians("a.splat"), |path| weaver_io::read_gaussians(path).is_ok()),
        one("spz", "a.spz", gaussians("a.spz"), spz),
        one("wsz", "a.wsz", gaussians("a.wsz"), wsz),
        Reader { seal: containing, ..one("wsz content", "a.wsz", contained(&gaussians("a.wsz")), wsz) },
        Reader { seal: gzip, ..one("spz content", "a.spz", gunzip(&gaussians("a.spz")), spz) },
        // A stream names its window, which is reserved.
        Reader { more: MORE + (9 << 20), ..one("spz 4", "a.spz", gaussians("a.v4.spz"), spz) },
        one("sog", "a.sog", gaussians("a.sog"), |path| weaver_io::read_gaussians(path).is_ok()),
        several("sog folder", sog_files(), |path| weaver_io::read_gaussians(path).is_ok()),
        one("glb", "a.glb", gaussians("a.glb"), |path| weaver_io::read_gaussians(path).is_ok()),
        one("gltf", "a.gltf", gaussians("a.gltf"), |path| weaver_io::read_gaussians(path).is_ok()),
        one("gltf accessors", "a.gltf", crate::gltf::hard().to_string().into_bytes(), |path| {
            weaver_io::read_gaussians(path).is_ok()
        }),
        one("gltf packed", "a.gltf", text(&crate::gltf_packed::packed(2).0.to_string()), |path| {
            weaver_io::read_gaussians(path).is_ok()
        }),
        one("usda", "a.usda", gaussians("a.usda"), |path| weaver_io::read_gaussians(path).is_ok()),
        one("usda of another program", "a.usda", text(crate::usd::LAYER), |path| {
            weaver_io::read_gaussians(path).is_ok()
        }),
        one("usdz", "a.usdz", gaussians("a.usdz"), |path| weaver_io::read_gaussians(path).is_ok()),
        one("ksplat", "a.ksplat", fixture("splats/minimal.ksplat"), |path| weaver_io::read_gaussians(path).is_ok()),
        one("ksplat 2", "a.ksplat", crate::ksplat::file(2, 2), |path| weaver_io::read_gaussians(path).is_ok()),
        several("colmap binary", colmap_files("bin"), folder),
        several("colmap text", colmap_files("txt"), folder),
        one("transforms", "a.json", text(transforms), |path| Transforms::read_cameras(path).is_ok()),
        one("llff", "poses_bounds.npy", crate::llff::bytes(&[crate::llff::ROW; 2]), |path| {
            weaver_io::llff::read_poses_bounds(path).is_ok()
        }),
        several("nerfies", nerfies_files(), |path| weaver_io::nerfies::Capture::read(path.parent().unwrap()).is_ok()),
        one("realestate", "a.txt", text(frames), |path| Clip::read(path).is_ok()),
        one("tensors", "a.safetensors", safetensors.clone(), |path| Tensors::read(path).is_ok()),
        several(
            "index",
            vec![("model.safetensors.index.json".into(), text(index)), ("a.safetensors".into(), safetensors)],
            |path| Mapped::open(path).is_ok(),
        ),
        one("npy", "a.npy", npy(1, HEADER, &[7; 24]), |path| weaver_io::open_array(path).is_ok()),
        one("torch", "a.ckpt", torch.unwrap(), |path| TorchCheckpoint::open(path).is_ok()),
        one("png", "a.png", png.clone(), photo),
        Reader { seal: checksummed, ..one("png content", "a.png", png, photo) },
        one("jpeg", "a.jpg", jpeg, photo),
        one("jpeg, shrunk", "a.jpg", wide, shrunk),
        one("jpeg, cmyk", "a.jpg", fixture("cmyk.jpg"), photo),
        one("tiff", "a.tif", tiff, photo),
        // Of one color it takes no bits, so that any size may be true.
        Reader { more: LARGEST, ..one("webp, lossless", "a.webp", webp, photo) },
        // Its decoder takes the length of a partition, of 24 bits, at its word.
        Reader { more: MORE + (16 << 20), ..one("webp, lossy", "a.webp", fixture("lossy.webp"), photo) },
        one("exif", "a.jpg", crate::exif::photo(crate::exif::FOCAL, 26), |path| {
            weaver_io::focal_35mm(path).is_ok_and(|focal| focal.is_some())
        }),
        one("jpeg, progressive", "a.jpg", fixture("progressive.jpg"), |path| {
            PhotoFile::at(path).and_then(|photo| photo.shrink_from(0).resize_whole(4, 2)).is_ok()
        }),
    ]
}

fn splats() -> Gaussians {
    let number = |i: usize| (i % 7) as f32 * 0.25 - 0.5;
    Gaussians {
        means: (0..12).map(|i| [number(i), number(i + 1), number(i + 2)]).collect(),
        log_scales: vec![[-3.0, -2.0, -1.0]; 12],
        quats: vec![[1.0, 0.0, 0.5, 0.0]; 12],
        opacity_logits: (0..12).map(number).collect(),
        sh: (0..12 * 12).map(number).collect(),
        degree: 1,
    }
}

fn sog_files() -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    weaver_io::write_gaussians(folder.path().join("meta.json"), &splats()).unwrap();
    let others = ["means_l", "means_u", "scales", "quats", "sh0", "shN_centroids", "shN_labels"];
    let names = ["meta.json".to_string()].into_iter().chain(others.map(|name| format!("{name}.webp")));
    names.map(|name| (name.clone(), std::fs::read(folder.path().join(name)).unwrap())).collect()
}

fn colmap_files(extension: &str) -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let write = if extension == "bin" { colmap::Model::write_binary } else { colmap::Model::write_text };
    write(&model(), folder.path()).unwrap();
    let names = ["cameras", "images", "points3D"].map(|name| format!("{name}.{extension}"));
    names.map(|name| (name.clone(), std::fs::read(folder.path().join(name)).unwrap())).to_vec()
}

fn nerfies_files() -> Vec<(String, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    crate::nerfies::written(folder.path());
    let names = ["scene.json", "camera/a.json", "camera/b.json", "dataset.json", "metadata.json"];
    names.map(|name| (name.into(), std::fs::read(folder.path().join(name)).unwrap())).to_vec()
}

/// A gzip file of mutated bytes, which no checksum would let through otherwise; stored, for compressing takes longer
/// than reading.
fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut sum = Crc::new();
    sum.update(bytes);
    let length = u16::try_from(bytes.len()).expect("small enough for one block");
    let header = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255];
    let mut out = [&header[..], &[1], &length.to_le_bytes(), &(!length).to_le_bytes(), bytes].concat();
    out.extend(sum.sum().to_le_bytes());
    out.extend(u32::from(length).to_le_bytes());
    out
}

fn gunzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    GzDecoder::new(bytes).read_to_end(&mut out).unwrap();
    out
}

/// The sizes and streams of a container without its checksums.
fn contained(bytes: &[u8]) -> Vec<u8> {
    let container = Container::read(bytes).unwrap();
    let mut out = vec![container.coefficients];
    out.extend((container.gaussians as u32).to_le_bytes());
    for stream in &container.streams {
        out.extend(stream.name);
        [stream.symbols as u32, stream.bytes.len() as u32].iter().for_each(|n| out.extend(n.to_le_bytes()));
        out.extend(&*stream.bytes);
    }
    out
}

/// A container of mutated bytes, with checksums that fit.
fn containing(bytes: &[u8]) -> Vec<u8> {
    let word = |at: usize| -> [u8; 4] { std::array::from_fn(|i| bytes.get(at + i).copied().unwrap_or(0)) };
    // A container is filled up to an eighth of its Gaussians.
    let gaussians = u64::from(u32::from_le_bytes(word(1)) % (1 << 16));
    let (mut streams, mut at) = (Vec::new(), 5);
    while at + 12 <= bytes.len() {
        let [symbols, length] = [at + 4, at + 8].map(|at| u32::from_le_bytes(word(at)));
        let end = (at + 12).saturating_add(length as usize).min(bytes.len());
        streams.push(Coded { name: word(at), symbols: symbols.into(), bytes: (&bytes[at + 12..end]).into() });
        at = end;
    }
    Container { gaussians, coefficients: bytes.first().copied().unwrap_or(0), streams }.write()
}

/// Gives the chunks of a PNG the checksums of their data.
fn checksummed(bytes: &[u8]) -> Vec<u8> {
    let (mut out, mut at) = (bytes.to_vec(), 8);
    while let Some(length) = out.get(at..at + 4) {
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        let Some(end) = at.checked_add(8 + length).filter(|end| end + 4 <= out.len()) else { break };
        let mut sum = Crc::new();
        sum.update(&out[at + 4..end]);
        out[end..end + 4].copy_from_slice(&sum.sum().to_be_bytes());
        at = end + 4;
    }
    out
}

/// The fault of reading a file, if there is one.
fn fault(reader: &Reader, path: &Path, input: u64, refused: &mut u64) -> Option<String> {
    let (started, mut done) = (Instant::now(), None);
    let used = allocation_counter::measure(|| {
        done = catch_unwind(AssertUnwindSafe(|| (reader.read)(path))).ok();
    });
    let (took, most) = (started.elapsed(), TIMES * input + reader.more);
    let Some(read) = done else { return Some("a panic".into()) };
    *refused += u64::from(!read);
    if used.bytes_max > most {
        return Some(format!("{} bytes held for an input of {input}", used.bytes_max));
    }
    // Twice in a row, for the machine may have done something else meanwhile.
    let again = || {
        let started = Instant::now();
        (reader.read)(path);
        started.elapsed()
    };
    (took > LONG && again() > LONG).then(|| format!("{took:?} for an input of {input} bytes"))
}

/// Promise (kept): no file, however damaged, makes a reader panic or take much memory.
#[test]
fn readers_bear_any_file() {
    let files = files();
    let mut faults = Vec::new();
    let some = std::env::var("WEAVER_READER").unwrap_or_default();
    for reader in readers().into_iter().filter(|reader| reader.name.contains(&some)) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(&reader.files[0].0);
        let lay = |files: &[(String, Vec<u8>)]| -> u64 {
            let sealed = files.iter().map(|(name, bytes)| (name, (reader.seal)(bytes)));
            let write = |(name, bytes): (&String, Vec<u8>)| {
                let path = folder.path().join(name);
                std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                std::fs::write(path, &bytes).unwrap();
                bytes.len() as u64
            };
            sealed.map(write).sum()
        };
        lay(&reader.files);
        assert!((reader.read)(&path), "{}: the unchanged file", reader.name);
        let (mut refused, mut found, started) = (0, 0, Instant::now());
        for number in 0..files {
            let rng = Stream::new(number, 0, reader.name);
            let mut changed = reader.files.clone();
            let which = rng.below(0, changed.len());
            mutate(&mut changed[which].1, rng.fork(1));
            let input = lay(&changed);
            if let Some(fault) = fault(&reader, &path, input, &mut refused) {
                found += 1;
                if found <= 3 {
                    faults.push(format!("{}, file {number}: {fault}", reader.name));
                }
            }
        }
        println!("{}: {files} files in {:.0?}, {refused} refused, {found} faults", reader.name, started.elapsed());
        assert!(refused * 10 > files, "{}: {refused} of {files} mutated files were refused", reader.name);
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
