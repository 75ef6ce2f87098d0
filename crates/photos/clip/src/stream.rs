//! The stream of pictures in a clip: its record, and what its first pictures show.

use crate::Error;
use crate::decoder;
use std::path::Path;
use std::sync::mpsc::channel;

/// Pictures that are looked at.
const LOOKED_AT: &str = "60";
/// Fewer of them tell no order of fields.
const FEW: usize = 10;
/// Part of them that has to agree.
const MOST: f64 = 0.9;

/// The stream of pictures of a clip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stream {
    /// Width and height as stored.
    pub size: (usize, usize),
    /// Degrees clockwise by which it is turned when it is shown.
    pub rotation: f64,
    /// Its order of fields by the record, by marks of its pictures, and by what they show.
    pub recorded: Option<Scan>,
    pub marked: Option<Scan>,
    pub seen: Option<Scan>,
    pub color: Color,
    /// About how many pictures it has: its length times its rate.
    pub about: Option<usize>,
}

/// Order in which the lines of a picture were taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scan {
    /// All at once.
    Progressive,
    /// Every second one half a picture later, the top one among the first.
    TopFirst,
    /// The same with the top one among the second.
    BottomFirst,
}

/// Names of the color space by the record, as ffmpeg has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Color {
    pub matrix: Option<String>,
    pub primaries: Option<String>,
    pub transfer: Option<String>,
    /// The largest luminance, cd/m^2: of its pixels, else of the display that it was made with.
    pub peak: Option<f64>,
}

impl Stream {
    /// Looks at the beginning of a clip.
    pub fn of(clip: &Path) -> Result<Self, Error> {
        let (send, said) = channel();
        // The order of fields by luma alone: chroma misleads where it is coarse.
        let filter = "showinfo=checksum=0,format=gray,idet";
        let output = ["-frames:v", LOOKED_AT, "-f", "null", "-"];
        let listener = move |line: &str| send.send(line.to_string()).unwrap_or_default();
        let ffmpeg = decoder::start(clip, (&["-noautorotate"], filter, &output), listener)?;
        // What it complains about is said by those who read on.
        decoder::end(clip, ffmpeg)?;
        Ok(Self::read(&said.iter().collect::<Vec<_>>()))
    }

    /// The order of fields: what is seen, else what the record says, else the marks.
    pub fn scan(&self) -> Scan {
        self.seen.unwrap_or_else(|| self.stated())
    }

    /// The order of fields by record and marks.
    pub fn stated(&self) -> Scan {
        let interlaced = |scan: &Scan| *scan != Scan::Progressive;
        self.recorded.filter(interlaced).or(self.marked).unwrap_or(Scan::Progressive)
    }

    /// Reads the messages of an ffmpeg.
    fn read(lines: &[String]) -> Self {
        let record = record(lines);
        let turn = |line: &String| line.split_once("rotation of ")?.1.split(' ').next()?.parse().ok();
        let shown: Vec<&String> = lines.iter().filter(|line| line.contains("showinfo")).collect();
        let first = |key| shown.iter().find_map(|line| word(line, key));
        let marks: Vec<&str> = shown.iter().filter_map(|line| word(line, " i:")).collect();
        let [top, bottom] = ["T", "B"].map(|mark| marks.iter().filter(|other| **other == mark).count());
        // Newer versions count pictures of none first.
        let counted = lines.iter().rev().find(|line| line.contains("Multi frame detection:"));
        let color = |key| first(key).filter(|name| !["unknown", "unspecified", "reserved"].contains(name));
        let peak = |key| first(key)?.trim_end_matches(',').parse().ok().filter(|peak| *peak > 0.0);
        Self {
            size: first(" s:").and_then(sides).unwrap_or_default(),
            // ffmpeg counts the other way round.
            rotation: -record.iter().find_map(turn).unwrap_or(0.0),
            recorded: record.first().and_then(|line| recorded(line)),
            marked: match (marks.len(), top + bottom) {
                (0, _) => None,
                (_, 0) => Some(Scan::Progressive),
                _ => Some(if top >= bottom { Scan::TopFirst } else { Scan::BottomFirst }),
            },
            seen: counted.and_then(|line| seen(line)),
            color: Color {
                matrix: color("color_space:").map(Into::into),
                primaries: color("color_primaries:").map(Into::into),
                transfer: color("color_trc:").map(Into::into),
                peak: peak("MaxCLL=").or_else(|| peak("max_luminance=")),
            },
            about: record.first().and_then(|line| about(lines, line)),
        }
    }
}

/// The lines about the stream whose pictures are read: `Stream #0:1 -> #0:0 (hevc ...` tells which.
fn record(lines: &[String]) -> &[String] {
    let stream = |line: &String| Some(line.split_once("] ")?.1.trim().strip_prefix("Stream #0:")?.to_string());
    let chosen = lines.iter().filter_map(stream).find(|rest| rest.contains(" -> #0:"));
    let Some(number) = chosen.as_ref().and_then(|rest| rest.split(' ').next()) else { return &[] };
    let described = |rest: String| rest.strip_prefix(number).is_some_and(|rest| rest.starts_with(['[', '(', ':']));
    let Some(begin) = lines.iter().position(|line| stream(line).is_some_and(described)) else { return &[] };
    let more = lines[begin + 1..].iter().take_while(|line| stream(line).is_none()).count();
    &lines[begin..=begin + more]
}

/// The word that follows a key in a line, up to the next blank.
fn word<'a>(line: &'a str, key: &str) -> Option<&'a str> {
    line.split_once(key)?.1.split_whitespace().next()
}

fn sides(size: &str) -> Option<(usize, usize)> {
    let (width, height) = size.split_once('x')?;
    Some((width.parse().ok()?, height.parse().ok()?))
}

/// The order of fields that the description of a stream names. Files hold the order of storage, too, and programs
/// differ in which is which; ffmpeg's decoders go by this one.
fn recorded(line: &str) -> Option<Scan> {
    let named = [
        ("top first", Scan::TopFirst),
        ("top coded first", Scan::TopFirst),
        ("bottom first", Scan::BottomFirst),
        ("bottom coded first", Scan::BottomFirst),
        ("progressive", Scan::Progressive),
    ];
    named.into_iter().find(|(name, _)| line.contains(name)).map(|(_, scan)| scan)
}

/// The order of fields that pictures show, where nearly all show the same.
fn seen(line: &str) -> Option<Scan> {
    let count = |key| word(line, key).and_then(|count| count.parse().ok());
    let counts = [("TFF:", Scan::TopFirst), ("BFF:", Scan::BottomFirst), ("Progressive:", Scan::Progressive)];
    let counts = counts.map(|(key, scan)| (count(key).unwrap_or(0_usize), scan));
    let all: usize = counts.iter().map(|(count, _)| count).sum::<usize>() + count("Undetermined:").unwrap_or(0);
    let (most, scan) = counts.into_iter().max_by_key(|(count, _)| *count)?;
    (most >= FEW && most as f64 >= MOST * all as f64).then_some(scan)
}

/// Length times rate, if ffmpeg tells both.
fn about(lines: &[String], stream: &str) -> Option<usize> {
    let time = lines.iter().find_map(|line| line.split_once("Duration: "))?.1.split(',').next()?;
    let seconds = time.split(':').try_fold(0.0, |sum, part| Some(60.0 * sum + part.trim().parse::<f64>().ok()?))?;
    let rate: f64 = stream.split_once(" fps")?.0.rsplit(' ').next()?.parse().ok()?;
    Some((seconds * rate) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Stream {
        Stream::read(&text.lines().map(|line| format!("[info] {}", line.trim_start())).collect::<Vec<_>>())
    }

    /// Of the streams in a file the one that is chosen counts, with its own turn and peak.
    #[test]
    fn the_chosen_stream_is_described() {
        let stream = read(
            "Duration: 00:01:02.50, start: 0.0, bitrate: 1 kb/s
             Stream #0:0[0x1](und): Video: mjpeg, yuvj420p(pc, bt470bg/unknown/unknown), 8x8, 90k tbr (attached pic)
             Side data:
             displaymatrix: rotation of 180.00 degrees
             Stream #0:1[0x2](und): Video: hevc, yuv420p10le(tv, bt2020nc/bt2020/smpte2084, top first), 8x4, 24 fps
             Side data:
             Display Matrix: rotation of -90.00 degrees
             Stream #0:2[0x3](und): Audio: aac
             Stream mapping:
             Stream #0:1 -> #0:0 (hevc (native) -> wrapped_avframe (native))
             [Parsed_showinfo_0 @ 0x1] n:   0 pts:      0 pts_time:0 fmt:yuv420p10le sar:1/1 s:8x4 i:B iskey:1
             [Parsed_showinfo_0 @ 0x1] side data - Mastering display metadata: max_luminance=4000.000000
             [Parsed_showinfo_0 @ 0x1] side data - Content light level metadata: MaxCLL=800, MaxFALL=300
             [Parsed_showinfo_0 @ 0x1] color_range:tv color_space:bt2020nc color_primaries:unknown color_trc:smpte2084
             [Parsed_idet_2 @ 0x1] Multi frame detection: TFF: 0 BFF: 0 Progressive: 0 Undetermined: 0
             [Parsed_idet_2 @ 0x2] Multi frame detection: TFF: 55 BFF: 1 Progressive: 0 Undetermined: 4",
        );
        let color = Color {
            matrix: Some("bt2020nc".into()),
            primaries: None,
            transfer: Some("smpte2084".into()),
            peak: Some(800.0),
        };
        let expected = Stream {
            size: (8, 4),
            rotation: 90.0,
            recorded: Some(Scan::TopFirst),
            marked: Some(Scan::BottomFirst),
            seen: Some(Scan::TopFirst),
            color,
            about: Some(1500),
        };
        assert_eq!(stream, expected);
    }

    /// Few pictures, and pictures that differ, show no order; without any description all is usual.
    #[test]
    fn doubtful_orders_of_fields_are_not_seen() {
        let line = |counts| seen(&format!("Multi frame detection: {counts}"));
        assert_eq!(line("TFF:     0 BFF:    60 Progressive:     1 Undetermined:     0"), Some(Scan::BottomFirst));
        assert_eq!(line("TFF:     9 BFF:     0 Progressive:     0 Undetermined:     0"), None);
        assert_eq!(line("TFF:    42 BFF:    12 Progressive:     7 Undetermined:     0"), None);
        assert_eq!(line("TFF:     0 BFF:     0 Progressive:    30 Undetermined:    30"), None);
        assert_eq!(read("nothing of all this"), Stream::default());
        assert_eq!(Stream::default().scan(), Scan::Progressive);
    }
}
