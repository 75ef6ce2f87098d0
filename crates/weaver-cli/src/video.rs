//! Encodes pictures into a video with the installed ffmpeg.

use crate::failure::Failure;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use weaver_io::Image;

/// A video that is being written: renamed into place when it is complete, removed otherwise.
#[derive(Debug)]
pub struct Video {
    path: PathBuf,
    /// Where ffmpeg writes.
    unfinished: PathBuf,
    ffmpeg: Child,
    /// Messages of ffmpeg, read as they arrive, since a full pipe would block it.
    complaints: Option<JoinHandle<String>>,
}

impl Video {
    /// A video of pictures of this size, `rate` of them a second.
    pub fn create(path: &Path, (width, height): (usize, usize), rate: f64) -> Result<Self, Failure> {
        let name = path.file_name().ok_or_else(|| Failure::Usage(format!("--video {}: not a file", path.display())))?;
        // The extension tells ffmpeg the format.
        let unfinished = path.with_file_name(format!(".weaver-{}-{}", std::process::id(), name.to_string_lossy()));
        let mut ffmpeg = Command::new("ffmpeg")
            .args(["-loglevel", "error", "-nostdin", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{width}x{height}"), "-framerate", &rate.to_string(), "-i", "pipe:0"])
            // Players expect chroma at half resolution, which needs even sides.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-movflags", "+faststart"])
            .arg(&unfinished)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| match error.kind() {
                ErrorKind::NotFound => Failure::message(
                    "--video needs the program ffmpeg, and there is none on the PATH; without --video, pictures are written",
                ),
                _ => Failure::message(format!("ffmpeg: {error}")),
            })?;
        let complaints = ffmpeg.stderr.take().map(|mut pipe| {
            std::thread::spawn(move || {
                let mut text = Vec::new();
                // Messages from before a broken pipe are still reported.
                let _ = pipe.read_to_end(&mut text);
                String::from_utf8_lossy(&text).into_owned()
            })
        });
        Ok(Self { path: path.to_owned(), unfinished, ffmpeg, complaints })
    }

    /// Adds a picture; all have one size.
    pub fn push(&mut self, image: &Image) -> Result<(), Failure> {
        let pipe = self.ffmpeg.stdin.as_mut();
        let written = pipe.map_or(Err(ErrorKind::BrokenPipe.into()), |pipe| pipe.write_all(&image.to_bytes()));
        match written {
            // The process has ended; its messages say why.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.end(),
            written => written.map_err(|error| Failure::message(format!("ffmpeg: {error}"))),
        }
    }

    /// Gives the video its name, and returns it.
    pub fn finish(mut self) -> Result<PathBuf, Failure> {
        self.end()?;
        std::fs::rename(&self.unfinished, &self.path).map_err(|error| self.failure(&error.to_string()))?;
        Ok(std::mem::take(&mut self.path))
    }

    /// Ends the input, waits for ffmpeg, and passes on its error messages.
    fn end(&mut self) -> Result<(), Failure> {
        drop(self.ffmpeg.stdin.take());
        let status = self.ffmpeg.wait().map_err(|error| self.failure(&error.to_string()))?;
        let complaints = self.complaints.take().and_then(|reader| reader.join().ok()).unwrap_or_default();
        if status.success() {
            return Ok(());
        }
        let lines: Vec<&str> = complaints.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
        Err(self.failure(&format!("ffmpeg: {status}; {}", lines.join("; "))))
    }

    fn failure(&self, reason: &str) -> Failure {
        Failure::message(format!("{}: {reason}", self.path.display()))
    }
}

impl Drop for Video {
    fn drop(&mut self) {
        // After a success there is nothing to stop or remove, and both calls fail harmlessly.
        let _ = self.ffmpeg.kill();
        let _ = self.ffmpeg.wait();
        let _ = std::fs::remove_file(&self.unfinished);
    }
}
