//! `--device`: drawing on a GPU of any kind, and without one.

use std::path::Path;
use std::process::{Command, Output};

fn command(folder: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_splatweaver"));
    command.current_dir(folder).args(line.split_whitespace());
    command
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[cfg(not(feature = "gpu"))]
#[test]
fn a_program_without_gpus_says_how_to_build_one() {
    let folder = tempfile::tempdir().unwrap();
    for line in [
        "render scene.ply --orbit 1 -o out --device gpu",
        "train --device gpu:0",
        "fit capture --device llvmpipe",
        "infer photo.png -o out --device gpu",
        "bench raster --synthetic 10,8,8 --device gpu",
        "bench fit --device gpu",
        "info --devices",
    ] {
        let done = command(folder.path(), line).output().unwrap();
        // A scene that is not there is found out first.
        if line.starts_with("render") {
            assert_eq!(done.status.code(), Some(1), "{line}");
            continue;
        }
        assert_eq!(done.status.code(), Some(2), "{line}: {}", said(&done));
        assert!(said(&done).contains("--features gpu"), "{line}: {}", said(&done));
    }
    let done = command(folder.path(), "bench raster --synthetic 10,8,8 --runs 1 --device cpu").output().unwrap();
    assert!(done.status.success(), "{}", said(&done));
}

#[cfg(feature = "gpu")]
mod with {
    use super::*;
    use serde_json::Value;
    use weaver_io::safetensors::Tensors;
    use weaver_io::{Background, Image, Transforms, write_gaussians};
    use weaver_scene::Frame;

    /// Runs a line that must succeed.
    fn fine(folder: &Path, line: &str) -> Output {
        let done = command(folder, line).output().unwrap();
        assert!(done.status.success(), "{line}: {}", said(&done));
        done
    }

    /// True if there is anything to draw on.
    fn any() -> bool {
        let listed = fine(&std::env::temp_dir(), "info --devices --json");
        let found: Value = serde_json::from_slice(&listed.stdout).unwrap();
        let devices = found.as_array().unwrap();
        for (number, device) in devices.iter().enumerate() {
            assert_eq!(device["number"], number);
            assert!(device["name"].is_string() && device["binding_bytes"].as_u64() >= Some(128 << 20), "{device}");
        }
        if devices.is_empty() {
            println!("skipped: no adapter");
        }
        !devices.is_empty()
    }

    /// The largest difference that no more than one number in two hundred exceeds.
    fn apart(ours: &[f32], theirs: &[f32]) -> f32 {
        assert_eq!(ours.len(), theirs.len());
        let mut all: Vec<f32> = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).collect();
        all.sort_unstable_by(f32::total_cmp);
        all[(all.len() - 1) * 199 / 200]
    }

    #[test]
    fn a_bench_draws_what_the_processor_draws() {
        if !any() {
            return;
        }
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let bench = "bench raster --synthetic 3000,80,60 --runs 1 --json --dump";
        fine(folder, &format!("{bench} cpu.safetensors"));
        let done = fine(folder, &format!("{bench} gpu.safetensors --device gpu:0"));
        let report: Value = serde_json::from_slice(&done.stdout).unwrap();
        assert!(report["device"]["name"].is_string() && report["bytes_to_device"].as_u64() > Some(0), "{report}");
        let read = |name: &str| Tensors::read(folder.join(name)).unwrap();
        let (ours, theirs) = (read("gpu.safetensors"), read("cpu.safetensors"));
        let values = |tensors: &Tensors, key: &str| {
            let shape = tensors.get(key).unwrap().shape.clone();
            tensors.values::<f32>(key, &shape).unwrap().to_vec()
        };
        for key in ["out.image", "out.alpha", "out.depth"] {
            let error = apart(&values(&ours, key), &values(&theirs, key));
            assert!(error <= 1e-4, "{key}: {error:e}");
        }
        for key in ["grad.means", "grad.scales", "grad.quats", "grad.opacities", "grad.sh", "grad.viewmat"] {
            let (ours, theirs) = (values(&ours, key), values(&theirs, key));
            let norm = |values: &mut dyn Iterator<Item = f32>| values.map(|x| f64::from(x * x)).sum::<f64>().sqrt();
            let error = norm(&mut ours.iter().zip(&theirs).map(|(a, b)| a - b)) / norm(&mut theirs.iter().copied());
            // All pixels count here, also where rounding decides.
            assert!(error <= 1e-2, "{key}: {error:e}");
        }
    }

    #[test]
    fn pictures_are_those_of_the_processor() {
        if !any() {
            return;
        }
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        write_gaussians(folder.join("scene.ply"), &crate::compare::gaussians()).unwrap();
        let picture = |device: &str| {
            fine(folder, &format!("render scene.ply --orbit 2 --width 96 -o {device} --device {device}"));
            Image::read(folder.join(device).join("0001.png"), Background::Black).unwrap().pixels
        };
        let error = apart(&picture("gpu:0"), &picture("cpu"));
        assert!(error <= 1.01 / 255.0, "{error}");
    }

    #[test]
    fn training_has_the_same_bits_every_time() {
        if !any() {
            return;
        }
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let checksum = |out: &str, device: &str| {
            fine(folder, &format!("train --preset micro --steps 5 --out {out} --device {device}"));
            let summary = std::fs::read_to_string(folder.join(out).join("summary.json")).unwrap();
            serde_json::from_str::<Value>(&summary).unwrap()["checksum"].as_str().unwrap().to_string()
        };
        assert_eq!(checksum("a", "gpu:0"), checksum("b", "gpu:0"));
    }

    #[test]
    fn a_fit_ends_where_that_of_the_processor_does() {
        if !any() {
            return;
        }
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let options = weaver_procedural::ProceduralOptions { width: 64, height: 48, views: 10 };
        let scene = weaver_procedural::scene(2, &options);
        std::fs::create_dir_all(folder.join("capture/images")).unwrap();
        let frame = |(i, view): (usize, &weaver_data::View)| {
            let name = format!("images/{i:02}.png");
            view.image.write_png(folder.join("capture").join(&name)).unwrap();
            Frame::new(name, view.camera)
        };
        let frames = scene.views.iter().enumerate().map(frame).collect();
        Transforms { frames, ..Transforms::default() }.write(folder.join("capture/transforms.json")).unwrap();
        let fitted = |out: &str, device: &str| {
            fine(folder, &format!("fit capture --steps 200 --gaussians 2000 -o {out} --device {device}"));
            let summary = std::fs::read_to_string(folder.join(out).join("summary.json")).unwrap();
            let summary: Value = serde_json::from_str(&summary).unwrap();
            summary["train"]["psnr"].as_f64().unwrap_or_else(|| panic!("{summary}"))
        };
        let (ours, theirs) = (fitted("gpu", "gpu:0"), fitted("cpu", "cpu"));
        println!("{ours:.3} dB, on the processor {theirs:.3} dB");
        assert!((ours - theirs).abs() < 0.1, "{ours} dB, on the processor {theirs} dB");
        assert_eq!(fitted("again", "gpu:0"), ours);
        let bytes = |out: &str| std::fs::read(folder.join(out).join("scene.ply")).unwrap();
        assert!(bytes("again") == bytes("gpu"), "another fit, other bits");
    }

    /// Missing devices are named, with a list of the existing ones.
    #[test]
    fn missing_devices_are_named() {
        let folder = tempfile::tempdir().unwrap();
        for device in ["gpu:99", "no-such-device"] {
            let line = format!("bench raster --synthetic 10,8,8 --device {device}");
            let done = command(folder.path(), &line).output().unwrap();
            assert_eq!(done.status.code(), Some(1), "{}", said(&done));
            let (fault, more) = if any() { ("no such adapter", "Found: gpu:0 ") } else { ("no adapter", "driver") };
            // Drivers may have said something of their own before.
            assert!(said(&done).contains(&format!("error: device {device}: {fault}")), "{}", said(&done));
            assert!(said(&done).contains(more), "{}", said(&done));
        }
        let without = |line: &str| {
            let mut command = command(folder.path(), line);
            for variable in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
                command.env(variable, "/nowhere/driver.json");
            }
            command.output().unwrap()
        };
        let listed = without("info --devices");
        assert!(listed.status.success() && String::from_utf8_lossy(&listed.stdout).contains("no devices"));
        assert_eq!(String::from_utf8_lossy(&without("info --devices --json").stdout).trim(), "[]");
        let done = without("bench raster --synthetic 10,8,8 --device gpu");
        assert_eq!(done.status.code(), Some(1));
        assert!(said(&done).contains("no adapter") && said(&done).contains("driver"), "{}", said(&done));
    }
}
