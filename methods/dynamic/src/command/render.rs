//! `splatweaver dynamic render`.

use crate::run::Run;
use clap::Args;
use serde_json::json;
use std::path::PathBuf;
use weaver_clip::{Film as _, VIDEOS, Video};
use weaver_command::camera_files::{self, Size};
use weaver_command::{Console, Failure, Output, Progress, Threads, memory, rate};
use weaver_geometry::Camera;
use weaver_io::OutputFolder;

/// Draws the mixture along time, from one of the film's cameras or along a path, as PNG files or as a video.
#[derive(Args, Debug)]
#[command(after_help = "Examples:
  splatweaver dynamic render --run runs/film --times 0:1:60 -o frames
  splatweaver dynamic render --run runs/film --times 0.2:0.8:40 --camera 4 --gate -o frames
  splatweaver dynamic render --run runs/film --times 0:1:90 --cameras path.json --video film.mp4")]
pub struct DynamicRender {
    /// Folder of the run
    #[arg(long, value_name = "RUN")]
    pub run: PathBuf,
    /// First time, last time, number of pictures; a film runs from 0 to 1
    #[arg(long, value_name = "FROM:TO:N", default_value = "0:1:30", value_parser = times)]
    pub times: Times,
    /// Number of one of the film's cameras [default: one that was held out, else the first]
    #[arg(long, value_name = "N", conflicts_with = "cameras")]
    pub camera: Option<usize>,
    /// transforms.json, a folder with a COLMAP model, or a RealEstate10K camera file: a path that is followed as time
    /// passes
    #[arg(long, value_name = "FILE")]
    pub cameras: Option<PathBuf>,
    /// Shows one expert instead of the mixture
    #[arg(long, value_name = "NAME")]
    pub expert: Option<String>,
    /// Writes maps of the gate beside the pictures
    #[arg(long, requires = "out")]
    pub gate: bool,
    /// Folder for the pictures
    #[arg(short, long, value_name = "DIR", required_unless_present = "video", value_parser = Output::folder())]
    pub out: Option<Output>,
    /// Makes a video of the pictures, with an ffmpeg on the PATH
    #[arg(long, value_name = "FILE.mp4", value_parser = Output::file(VIDEOS))]
    pub video: Option<Output>,
    /// Pictures of the video per second
    #[arg(long, value_name = "F", default_value = "30", value_parser = rate(), requires = "video")]
    pub fps: f64,
    /// Prints the result as JSON, and nothing else on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub threads: Threads,
}

/// Times from the first to the last, evenly spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    pub from: f64,
    pub to: f64,
    pub count: usize,
}

impl Times {
    /// All times, in order.
    pub fn all(self) -> impl Iterator<Item = f64> {
        let step = (self.to - self.from) / (self.count.max(2) - 1) as f64;
        (0..self.count).map(move |i| self.from + step * i as f64)
    }
}

pub fn run(arguments: &DynamicRender, console: &mut Console) -> Result<(), Failure> {
    let read: Vec<&PathBuf> = std::iter::once(&arguments.run).chain(&arguments.cameras).collect();
    let out = arguments.out.as_ref().map(|out| OutputFolder::claim(out, "dynamic render", &read)).transpose()?;
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
        Some(file) => Some(Box::new(Video::create(file, (first.width, first.height), arguments.fps)?)),
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
    let video = video.map(|video| video.finish()).transpose()?;
    let folder = arguments.out.as_ref().map(|folder| folder.to_path_buf());
    let outputs: Vec<PathBuf> = folder.into_iter().chain(video).collect();
    let places: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
    let text = format!("{count} pictures in {}", places.join(" and "));
    console.answer(arguments.json, &outputs, json!({ "pictures": count }), &text)
}

/// The cameras of the path.
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

fn times(text: &str) -> Result<Times, String> {
    let parts: Vec<&str> = text.split(':').collect();
    let [from, to, count] = parts[..] else { return Err("expected FROM:TO:N".into()) };
    let time = |text: &str| match text.parse() {
        Ok(time) if (0.0..=1.0).contains(&time) => Ok(time),
        _ => Err(format!("expected times from 0 to 1, found {text}")),
    };
    let count = match count.parse() {
        Ok(count @ 1..=100_000) => count,
        _ => return Err(format!("expected 1 to 100000 pictures, found {count}")),
    };
    Ok(Times { from: time(from)?, to: time(to)?, count })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_evenly_spread() {
        let all = |text: &str| times(text).map(|times| times.all().collect::<Vec<_>>());
        assert_eq!(all("0:1:3"), Ok(vec![0.0, 0.5, 1.0]));
        assert_eq!(all("0.5:0.5:1"), Ok(vec![0.5]));
        assert!(all("0:2:3").unwrap_err().contains("0 to 1") && all("0:1").is_err() && all("0:1:0").is_err());
        assert!(times("0:nan:3").is_err());
    }
}
