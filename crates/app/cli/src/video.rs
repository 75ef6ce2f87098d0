//! Encodes pictures into a video with the installed ffmpeg.

use crate::ffmpeg::{Ffmpeg, INSTALL};
use crate::film::Film;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Stdio};
use weaver_command::Failure;
use weaver_io::Image;

/// A video that is being written: renamed into place when it is complete, removed otherwise.
#[derive(Debug)]
pub struct Video {
    path: PathBuf,
    /// Where ffmpeg writes.
    unfinished: PathBuf,
    ffmpeg: Ffmpeg,
    /// Where ffmpeg reads, until all is written.
    pipe: Option<ChildStdin>,
}

impl Video {
    /// A video of pictures of this size, `rate` of them a second.
    pub fn create(path: &Path, (width, height): (usize, usize), rate: f64) -> Result<Self, Failure> {
        let name = path.file_name().ok_or_else(|| Failure::Usage(format!("--video {}: not a file", path.display())))?;
        // The extension tells ffmpeg the format.
        let unfinished = path.with_file_name(format!(".weaver-{}-{}", std::process::id(), name.to_string_lossy()));
        let mut command = Command::new("ffmpeg");
        command
            .args(["-loglevel", "error", "-nostdin", "-xerror", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{width}x{height}"), "-framerate", &rate.to_string(), "-i", "pipe:0"])
            // Players expect chroma at half resolution, which needs even sides.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-movflags", "+faststart"])
            .arg(&unfinished)
            .stdin(Stdio::piped())
            .stdout(Stdio::null());
        let missing = format!(
            "--video needs the program ffmpeg, and there is none on the PATH; {INSTALL}; without --video, pictures are written"
        );
        let ffmpeg = Ffmpeg::start(command, &missing)?;
        let pipe = ffmpeg.stdin();
        Ok(Self { path: path.to_owned(), unfinished, ffmpeg, pipe })
    }

    /// Ends the input, waits for ffmpeg, and passes on its error messages.
    fn end(&mut self) -> Result<(), Failure> {
        drop(self.pipe.take());
        let ended = self.ffmpeg.end()?;
        // Some versions end well where a disk was full when they wrote the end of the file.
        let full = || ended.complaints().filter(|_| ended.kind() != ErrorKind::Other);
        let fault = ended.fault().or_else(|| Some(format!("ffmpeg: {}", full()?)));
        fault.map_or(Ok(()), |fault| Err(self.failure(io::Error::new(ended.kind(), fault))))
    }

    /// A failure of writing, whose kind tells a full disk from a fault of the input.
    fn failure(&self, source: io::Error) -> Failure {
        weaver_io::Error::Io { path: self.path.clone(), source }.into()
    }
}

impl Film for Video {
    fn push(&mut self, image: &Image) -> Result<(), Failure> {
        let written =
            self.pipe.as_mut().map_or(Err(ErrorKind::BrokenPipe.into()), |pipe| pipe.write_all(&image.to_bytes()));
        match written {
            // The process has ended, too early even if it ended well; its messages say why.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.end().and_then(|()| Err(self.failure(error))),
            written => written.map_err(|error| Failure::message(format!("ffmpeg: {error}"))),
        }
    }

    fn finish(mut self: Box<Self>) -> Result<PathBuf, Failure> {
        self.end()?;
        std::fs::rename(&self.unfinished, &self.path).map_err(|error| self.failure(error))?;
        Ok(std::mem::take(&mut self.path))
    }
}

impl Drop for Video {
    fn drop(&mut self) {
        // Not before it has ended, or it would be there again. Where it has its name, there is nothing to remove.
        self.ffmpeg.kill();
        let _ = std::fs::remove_file(&self.unfinished);
    }
}
