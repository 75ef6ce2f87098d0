//! Encodes pictures into a video with the installed ffmpeg.

use crate::Error;
use crate::film::Film;
use crate::program::{INSTALL, Program};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Stdio};
use weaver_io::{Image, UnfinishedFile};

/// Endings of names of videos.
pub const VIDEOS: &[&str] = &["mp4", "m4v", "mov", "mkv", "webm", "avi"];
/// ffmpeg's name of each format.
const FORMATS: [&str; 6] = ["mp4", "mp4", "mov", "matroska", "webm", "avi"];

/// A video that is being written: it takes its name when it is complete.
#[derive(Debug)]
pub struct Video {
    path: PathBuf,
    // Before the file: what ffmpeg still writes is removed after it has ended.
    ffmpeg: Program,
    unfinished: UnfinishedFile,
    /// Where ffmpeg reads, until all is written.
    pipe: Option<ChildStdin>,
}

impl Video {
    /// A video of pictures of this size, `rate` of them a second.
    pub fn create(path: &Path, (width, height): (usize, usize), rate: f64) -> Result<Self, Error> {
        let failed = |error: std::io::Error| weaver_io::Error::Io { path: path.into(), source: error };
        let mut unfinished = UnfinishedFile::begin(path).map_err(failed)?;
        // A file without a name is handed to ffmpeg as its standard output.
        let (to, stdout) = match unfinished.name() {
            Some(name) => (name.to_path_buf(), Stdio::null()),
            None => ("/proc/self/fd/1".into(), unfinished.as_file().try_clone().map_err(failed)?.into()),
        };
        let mut command = Command::new("ffmpeg");
        command
            .args(["-loglevel", "error", "-nostdin", "-xerror", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{width}x{height}"), "-framerate", &rate.to_string(), "-i", "pipe:0"])
            // Players expect chroma at half resolution, which needs even sides.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-movflags", "+faststart"])
            .args(["-f", format(path)])
            .arg(to)
            .stdin(Stdio::piped())
            .stdout(stdout);
        let missing = format!(
            "--video needs the program ffmpeg, and there is none on the PATH; {INSTALL}; without --video, pictures are written"
        );
        let ffmpeg = Program::start(command, &missing)?;
        let pipe = ffmpeg.stdin();
        Ok(Self { path: path.to_owned(), ffmpeg, unfinished, pipe })
    }

    /// Ends the input, waits for ffmpeg, and passes on its error messages.
    fn end(&mut self) -> Result<(), Error> {
        drop(self.pipe.take());
        let ended = self.ffmpeg.end()?;
        // Some versions end well where a disk was full when they wrote the end of the file.
        let full = || ended.complaints().filter(|_| ended.kind() != ErrorKind::Other);
        let fault = ended.fault().or_else(|| Some(format!("ffmpeg: {}", full()?)));
        fault.map_or(Ok(()), |fault| Err(self.failure(io::Error::new(ended.kind(), fault))))
    }

    /// A failure of writing, whose kind tells a full disk from a fault of the input.
    fn failure(&self, source: io::Error) -> Error {
        weaver_io::Error::Io { path: self.path.clone(), source }.into()
    }
}

impl Film for Video {
    fn push(&mut self, image: &Image) -> Result<(), Error> {
        let written =
            self.pipe.as_mut().map_or(Err(ErrorKind::BrokenPipe.into()), |pipe| pipe.write_all(&image.to_bytes()));
        match written {
            // The process has ended, too early even if it ended well; its messages say why.
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.end().and_then(|()| Err(self.failure(error))),
            written => written.map_err(|error| Error::input(format!("ffmpeg: {error}"))),
        }
    }

    fn finish(mut self: Box<Self>) -> Result<PathBuf, Error> {
        self.end()?;
        let Self { path, unfinished, .. } = *self;
        unfinished.persist().map_err(|source| weaver_io::Error::Io { path: path.clone(), source })?;
        Ok(path)
    }
}

/// ffmpeg's name of the format that a file's name ends with.
fn format(path: &Path) -> &'static str {
    let ending = path.extension().unwrap_or_default();
    let place = VIDEOS.iter().position(|known| ending.eq_ignore_ascii_case(known));
    FORMATS[place.unwrap_or_default()]
}
