//! The ffmpeg that reads clips, as a process beside this one.

use crate::Error;
use crate::program::{INSTALL, Listener, Program};
use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, Stdio};

/// The containers that ffmpeg opens, by its own names: none that names other files, as playlists and manifests do.
const CONTAINERS: &str =
    "mov,matroska,avi,mpeg,mpegts,mpegvideo,m4v,h264,hevc,obu,ivf,ogg,asf,flv,mxf,dv,yuv4mpegpipe,gif";
/// Marks of lines that are no complaints.
const NOTES: [&str; 4] = ["[info] ", "[warning] ", "[verbose] ", "[debug] "];
/// Marks of lines that are.
const COMPLAINTS: [&str; 2] = ["[error] ", "[fatal] "];

/// Starts an ffmpeg that reads the pictures of a clip: with these arguments before the clip, this filter of them, and
/// these arguments for its output.
///
/// The listener is given all of its messages, marked by their kind.
pub fn start(
    clip: &Path,
    (before, filter, output): (&[&str], &str, &[&str]),
    mut listener: impl FnMut(&str) + Send + 'static,
) -> Result<Program, Error> {
    let mut command = Command::new("ffmpeg");
    let threads = rayon::current_num_threads().to_string();
    command.args(["-hide_banner", "-nostats", "-loglevel", "repeat+level+info", "-nostdin"]).args(before);
    command.args(["-protocol_whitelist", "file", "-format_whitelist", CONTAINERS, "-threads", &threads]);
    // Otherwise a name with a colon would be an address. Nothing is read but the clip itself.
    let mut input = OsString::from("file:");
    input.push(clip);
    // Not covers, which are pictures of files that are heard.
    command.arg("-i").arg(input).args(["-map", "0:V:0", "-vf", filter]).args(output);
    command.stdin(Stdio::null()).stdout(Stdio::piped());
    let listener: Listener = Box::new(move |line| {
        listener(line);
        complaint(line)
    });
    Program::listen(command, listener)?.ok_or_else(|| {
        let clip = clip.display();
        Error::input(format!(
            "{clip}: reading a clip needs the program ffmpeg, and there is none on the PATH; {INSTALL}"
        ))
    })
}

/// Waits for an ffmpeg after the last picture, and returns its complaints.
pub fn end(clip: &Path, mut ffmpeg: Program) -> Result<Option<String>, Error> {
    let ended = ffmpeg.end()?;
    let Some(fault) = ended.fault() else { return Ok(ended.complaints()) };
    let clip = clip.display();
    if fault.contains("not on whitelist") {
        let expected = "expected a clip, found a list of other files, or a container that is none of";
        return Err(Error::input(format!("{clip}: {expected} {CONTAINERS}")));
    }
    if fault.contains("No such filter") {
        let expected = "expected an ffmpeg with its usual filters, found one without";
        return Err(Error::input(format!("{clip}: {expected}; {fault}; {INSTALL}")));
    }
    let found = if fault.contains("matches no streams") { "no pictures in it" } else { "another file" };
    let expected = "expected a clip with pictures that ffmpeg decodes";
    Err(Error::input(format!("{clip}: {expected}, found {found}; {fault}")))
}

/// True if ffmpeg makes a first picture of a clip with these arguments and this filter.
pub fn works(clip: &Path, (before, filter): (&[&str], &str)) -> Result<bool, Error> {
    let mut ffmpeg = start(clip, (before, filter, &["-frames:v", "1", "-f", "null", "-"]), |_| ())?;
    Ok(ffmpeg.end()?.fault().is_none())
}

/// A line without its mark, if it is a complaint.
fn complaint(line: &str) -> Option<String> {
    let first = |marks: &[&str]| marks.iter().filter_map(|mark| line.find(mark)).min();
    match (first(&COMPLAINTS), first(&NOTES)) {
        (None, Some(_)) => None,
        (Some(error), Some(note)) if note < error => None,
        (Some(error), _) => Some(format!("{}{}", &line[..error], &line[error + COMPLAINTS[0].len()..])),
        (None, None) => Some(line.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complaints_are_told_from_notes() {
        let text = |line| complaint(line).unwrap_or_default();
        assert_eq!(text("[mov @ 0x1] [error] moov atom not found\n"), "[mov @ 0x1] moov atom not found\n");
        assert_eq!(text("[fatal] no filter\n"), "no filter\n");
        assert_eq!(text("oh no\n"), "oh no\n");
        assert_eq!(text("[info]   title : [error] x\n") + &text("[x @ 0x1] [warning] late\n"), "");
    }
}
