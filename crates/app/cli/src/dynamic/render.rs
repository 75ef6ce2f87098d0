//! `splatweaver dynamic render`.

use crate::arguments::DynamicRender;
use crate::video::Video;
use std::path::PathBuf;
use weaver_command::camera_files::{self, Size};
use weaver_command::memory;
use weaver_command::{Console, Failure, Progress};
use weaver_dynamic_run::Run;
use weaver_geometry::Camera;
use weaver_io::OutputFolder;

pub fn run(arguments: &DynamicRender, console: &mut Console) -> Result<(), Failure> {
    let read: Vec<&PathBuf> = std::iter::once(&arguments.run).chain(&arguments.cameras).collect();
    let out = arguments.out.as_ref().map(|out| OutputFolder::claim(out, "dynamic render", &read)).transpose()?;
    arguments.video.as_ref().map_or(Ok(()), |path| weaver_io::check_output_file(path, &read))?;
    let run = Run::open(&arguments.run)?;
    let expert = arguments.expert.as_deref().map(|name| run.settings().expert(name)).transpose()?;
    let path = path(arguments, &run)?;
    let count = arguments.times.count;
    let first = &path[0];
    if let Some(other) = path.iter().find(|camera| (camera.width, camera.height) != (first.width, first.height)) {
        let path = arguments.cameras.as_deref().unwrap_or(&arguments.run).display();
        return Err(Failure::message(format!(
            "{path}: expected cameras of one size, found {} x {} and {} x {}",
            first.width, first.height, other.width, other.height
        )));
    }
    let size = [first.height, first.width];
    let needed = memory::of_picture(first, run.settings().experts.len() + 2);
    memory::check(needed, "cameras of smaller pictures reduce it")?;
    let names = |i: usize| [format!("{i:04}.png"), format!("gate-{i:04}.png")];
    out.as_ref().map_or(Ok(()), |out| out.check((0..count).flat_map(names)))?;
    let mut video = match &arguments.video {
        Some(file) => Some(Video::create(file, (first.width, first.height), arguments.fps)?),
        None => None,
    };
    let mut progress = Progress::new("render", 0, count, console);
    for (i, time) in arguments.times.all().enumerate() {
        // The path is followed as time passes.
        let camera = &path[i * (path.len() - 1) / (count - 1).max(1)];
        let pictures = run.mixture().pictures(run.params(), camera, time)?;
        let image = expert.map_or_else(|| pictures.mixture(size), |index| pictures.expert(index, size));
        if let Some(out) = &out {
            let [name, gate] = names(i);
            image.write_png(out.file(name)?)?;
            if arguments.gate {
                pictures.gate(size).write_png(out.file(gate)?)?;
            }
        }
        if let Some(video) = &mut video {
            video.push(&image)?;
        }
        progress.at(i + 1, count, String::new, console);
    }
    progress.finish();
    let folder = arguments.out.as_ref().map(|folder| folder.display().to_string());
    let video = video.map(Video::finish).transpose()?.map(|path| path.display().to_string());
    let places: Vec<String> = folder.into_iter().chain(video).collect();
    console.print(&format!("{count} pictures in {}", places.join(" and ")))
}

/// The cameras that are followed.
fn path(arguments: &DynamicRender, run: &Run) -> Result<Vec<Camera>, Failure> {
    if let Some(file) = &arguments.cameras {
        return Ok(camera_files::read(file, Size::default())?.into_iter().map(|frame| frame.camera).collect());
    }
    let shots = &run.film().shots;
    let found = match arguments.camera {
        Some(number) => shots.iter().find(|shot| shot.viewpoint == number),
        None => shots.iter().find(|shot| shot.held_out.camera).or(shots.first()),
    };
    let most = shots.iter().map(|shot| shot.viewpoint).max().unwrap_or(0);
    let found = found.ok_or_else(|| {
        Failure::Usage(format!("--camera: expected 0 to {most}, found {}", arguments.camera.unwrap_or(0)))
    })?;
    Ok(vec![found.camera])
}
