//! `splatweaver query`.

use crate::command::arguments::Query;
use crate::command::lift::{Drawn, refused};
use crate::{Operator, Raster, guide, scores, to_unit_length};
use std::collections::BTreeMap;
use std::path::Path;
use weaver_command::camera_files::{self, Size};
use weaver_command::{Console, Failure, LiftedFile, Progress, memory};
use weaver_geometry::Camera;
use weaver_io::safetensors::{Storage, Tensors};
use weaver_io::{OutputFolder, false_color, open_array};

pub fn run(arguments: &Query, console: &mut Console) -> Result<(), Failure> {
    let read = [&arguments.scene, &arguments.cameras, &arguments.lifted, &arguments.prompts];
    let out = OutputFolder::claim(&arguments.out, "query", read)?;
    let size = Size { width: arguments.width.map(|w| w as usize), height: arguments.height.map(|h| h as usize) };
    let frames = camera_files::read(&arguments.cameras, size)?;
    let stems = camera_files::stems(&frames);
    let cameras: Vec<Camera> = frames.iter().map(|frame| frame.camera).collect();
    let mut drawn = Drawn::read(&arguments.scene)?;
    let splats = drawn.gaussians.len();

    let path = &arguments.lifted;
    let lifted = LiftedFile::read(path, &arguments.scene, splats)?;
    let channels = lifted.channels;
    let checksum = drawn.checksum();
    if lifted.said("scene_checksum").is_some_and(|other| *other != checksum) {
        console.warning(&format!(
            "{}: features were lifted to other Gaussians than those of {}",
            path.display(),
            arguments.scene.display()
        ));
    }
    let lambda = match lifted.said("lambda") {
        None => 1.0,
        Some(text) => text.parse().map_err(|_| refused(path, "lambda: a number", text))?,
    };
    guide(&mut drawn.gaussians.opacities, lambda).map_err(|e| Failure::message(format!("{}: {e}", path.display())))?;
    let prompts = prompts(&arguments.prompts, channels)?;
    let count = prompts.len() / channels;
    let scores = scores(lifted.features(), &prompts, channels)?;

    for stem in &stems {
        out.check((0..count).map(|prompt| format!("{stem}-{prompt}.png")).chain([numbers(stem)]))?;
    }
    memory::check(
        memory::of_pictures(&frames, 1).saturating_mul(1 + count as u64),
        "a smaller --width and --height, or fewer prompts, reduce it",
    )?;
    let mut raster = Raster::new(drawn.gaussians.as_slices(), &cameras, drawn.settings);
    let mut progress = Progress::new("query", 0, cameras.len(), console);
    for (view, (camera, stem)) in cameras.iter().zip(&stems).enumerate() {
        let mut map = vec![0.0; raster.rays(view) * count];
        raster.forward(view, &scores, count, &mut map)?;
        for prompt in 0..count {
            let of_prompt: Vec<f32> = map.iter().skip(prompt).step_by(count).copied().collect();
            let picture = false_color(&of_prompt, camera.width, camera.height, 0.0, 1.0);
            picture.write_png(out.file(format!("{stem}-{prompt}.png"))?)?;
        }
        let mut tensors = Tensors::default();
        tensors.insert("scores", &[camera.height, camera.width, count], map);
        tensors.write(out.file(numbers(stem))?)?;
        progress.at(view + 1, cameras.len(), String::new, console);
    }
    progress.finish();
    let text = format!("maps: {} prompts in {} views, in {}", count, cameras.len(), arguments.out.display());
    let figures = BTreeMap::from([("prompts", count), ("views", cameras.len())]);
    console.answer(arguments.json, &[&*arguments.out], figures, &text)
}

/// The file of a view's maps.
fn numbers(stem: &str) -> String {
    format!("{stem}.safetensors")
}

/// A table of prompts, each of length 1.
fn prompts(path: &Path, channels: usize) -> Result<Vec<f32>, Failure> {
    let array = open_array(path)?;
    let shape = format!("{:?}", array.shape());
    if array.shape().len() != 2 || array.shape()[1] != channels || array.is_empty() {
        return Err(refused(path, &format!("prompts [prompts, {channels}]"), &shape));
    }
    let mut values = match array.storage()? {
        Storage::F32(slice) => slice.as_ref().to_vec(),
        Storage::Widened(values) => values,
        Storage::F16(slice) => slice.as_ref().iter().map(|x| x.to_f32()).collect(),
        Storage::Bf16(slice) => slice.as_ref().iter().map(|x| x.to_f32()).collect(),
    };
    for (number, prompt) in values.chunks_exact(channels).enumerate() {
        let length = prompt.iter().map(|x| x * x).sum::<f32>();
        if !(length.is_finite() && length > 0.0) {
            return Err(refused(path, "prompts of some length", &format!("{length} for prompt {number}")));
        }
    }
    to_unit_length(&mut values, channels);
    Ok(values)
}
