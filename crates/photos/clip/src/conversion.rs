//! The filters of ffmpeg by which the pictures of a clip become photos: without combs, upright and in sRGB.

use crate::Error;
use crate::decoder::works;
use crate::program::INSTALL;
use crate::stream::{Color, Scan, Stream};
use std::path::Path;

/// Luminance of white in HDR, cd/m^2.
///
/// Source: Report ITU-R BT.2408, table 1.
const WHITE: f64 = 203.0;
/// The largest luminance of HLG, and of PQ where no record tells it, cd/m^2.
const PEAK: f64 = 1000.0;
/// From this size on pictures without a record of their matrix have HD's.
const HD: (usize, usize) = (1280, 577);
/// Degrees by which a turn may differ from quarter turns.
const UPRIGHT: f64 = 1.0;

/// The work of ffmpeg on each picture of a clip.
#[derive(Debug, Default, PartialEq)]
pub struct Conversion {
    /// Arguments before the clip.
    before: Vec<&'static str>,
    deinterlace: Option<String>,
    /// A turn that ffmpeg does not make by itself.
    turn: Option<&'static str>,
    map: Option<String>,
    /// The matrix of its colors, where the record lacks it and ffmpeg takes another.
    matrix: Option<&'static str>,
}

/// Filters that do the same, and the arguments that they need before the clip.
struct Way {
    name: &'static str,
    before: &'static [&'static str],
    filter: String,
}

impl Way {
    fn new(name: &'static str, filter: String) -> Self {
        Self { name, before: &[], filter }
    }
}

/// Lines for the user.
#[derive(Debug, Default, PartialEq)]
pub struct Remarks {
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
}

impl Conversion {
    /// The conversion of a clip, and remarks for the user about it.
    ///
    /// # Errors
    /// When there is no ffmpeg, or it does not read the file.
    pub fn of(clip: &Path) -> Result<(Self, Stream, Remarks), Error> {
        let stream = Stream::of(clip)?;
        let (mut conversion, mut remarks) = (Self::default(), Remarks::default());
        conversion.set_fields(clip, &stream, &mut remarks)?;
        conversion.set_turn(clip, &stream, &mut remarks);
        conversion.set_colors(clip, &stream, &mut remarks)?;
        Ok((conversion, stream, remarks))
    }

    /// Arguments before the clip.
    pub fn before(&self) -> &[&'static str] {
        &self.before
    }

    /// The filter by which all pictures become gray, the longer side at most so many pixels.
    pub fn to_gray(&self, long_side: usize) -> String {
        let factor = format!("min(1,{long_side}/max(iw*sar,ih))");
        let side = |side: &str| format!("max(1,round({side}*{factor}))");
        let scale = format!("scale=w='{}':h='{}':flags=area,setsar=1,format=gray", side("iw*sar"), side("ih"));
        chain([self.deinterlace.as_deref(), Some(&scale), self.turn])
    }

    /// The filter by which those pictures that `select` chooses become photos.
    pub fn to_color(&self, select: &str) -> String {
        let matrix = self.matrix.map_or(String::new(), |matrix| format!("in_color_matrix={matrix}:"));
        let flags = "flags=bicubic+accurate_rnd+full_chroma_int";
        let scale = format!("scale={matrix}w='max(1,round(iw*sar))':h=ih:{flags},setsar=1,format=rgb24");
        chain([self.deinterlace.as_deref(), Some(select), self.turn, self.map.as_deref(), Some(&scale)])
    }

    fn set_fields(&mut self, clip: &Path, stream: &Stream, remarks: &mut Remarks) -> Result<(), Error> {
        let (scan, stated, name) = (stream.scan(), stream.stated(), clip.display());
        let said = |scan| match scan {
            Scan::Progressive => "progressive",
            Scan::TopFirst => "interlaced, the top field first",
            Scan::BottomFirst => "interlaced, the bottom field first",
        };
        let though = match scan == stated {
            true => String::new(),
            false => format!(", as its pictures show; it is marked as {}", said(stated)),
        };
        let parity = match scan {
            Scan::Progressive if scan == stated => return Ok(()),
            Scan::Progressive => {
                remarks.notes.push(format!("clip: {name} is progressive{though}; its frames stay as they are"));
                return Ok(());
            }
            Scan::TopFirst => "tff",
            Scan::BottomFirst => "bff",
        };
        // Where pictures are marked, some may be whole among those with fields.
        let marks = stream.marked.is_some_and(|marked| marked != Scan::Progressive);
        let which = if marks { "interlaced" } else { "all" };
        let way = |name| Way::new(name, format!("{name}=mode=send_frame:parity={parity}:deint={which}"));
        match first_that_works(clip, ["bwdif", "yadif"].map(way))? {
            Some(way) => {
                let by = way.name;
                remarks.notes.push(format!("clip: {name} is {}{though}; {by} of ffmpeg deinterlaces it", said(scan)));
                self.deinterlace = Some(way.filter);
            }
            None => remarks.warnings.push(format!(
                "{name}: {}, and this ffmpeg has neither bwdif nor yadif: what moves has combs; {INSTALL}",
                said(scan)
            )),
        }
        Ok(())
    }

    fn set_turn(&mut self, clip: &Path, stream: &Stream, remarks: &mut Remarks) {
        let quarters = (stream.rotation / 90.0).round();
        let odd = (stream.rotation - 90.0 * quarters).abs() > UPRIGHT;
        // Other turns would bring black corners. Fields have to be joined before they are turned, which ffmpeg does
        // first, also mirrored pictures.
        if !odd && self.deinterlace.is_none() {
            return;
        }
        self.before.push("-noautorotate");
        self.turn = match (quarters as i64).rem_euclid(4) {
            0 => None,
            1 => Some("transpose=clock"),
            2 => Some("hflip,vflip"),
            _ => Some("transpose=cclock"),
        };
        if odd {
            let [found, made] = [stream.rotation, 90.0 * quarters].map(|degrees| degrees.rem_euclid(360.0));
            remarks.warnings.push(format!(
                "{}: expected a turn by 0, 90, 180 or 270 degrees in its record, found {found:.0}; its frames are \
                 turned by {made:.0}",
                clip.display()
            ));
        }
    }

    fn set_colors(&mut self, clip: &Path, stream: &Stream, remarks: &mut Remarks) -> Result<(), Error> {
        let (color, name) = (&stream.color, clip.display());
        let hdr = match color.transfer.as_deref() {
            Some("smpte2084") => Some("PQ"),
            Some("arib-std-b67") => Some("HLG"),
            _ => None,
        };
        let (kind, ways) = match (hdr, color.is_wide()) {
            (Some(hdr), _) => (format!("HDR colors ({hdr})"), color.hdr_to_srgb()),
            (None, true) => ("wide colors".into(), color.wide_to_srgb()),
            (None, false) => {
                let hd = stream.size.0 >= HD.0 || stream.size.1 >= HD.1;
                self.matrix = (color.matrix.is_none() && hd).then_some("bt709");
                return Ok(());
            }
        };
        let names = ways.iter().map(|way| way.name).collect::<Vec<_>>().join(", ");
        match first_that_works(clip, ways)? {
            Some(way) => {
                remarks.notes.push(format!("clip: {kind} of {name} become sRGB by {} of ffmpeg", way.name));
                self.before.extend(way.before);
                self.map = Some(way.filter);
            }
            None => remarks.warnings.push(format!(
                "{name}: {kind} stay as they are and look pale: none of {names} works in this ffmpeg; one with \
                 libzimg maps them, {INSTALL}"
            )),
        }
        Ok(())
    }
}

impl Color {
    /// True if sRGB has other primaries, or ffmpeg alone no such matrix.
    fn is_wide(&self) -> bool {
        let is = |name: &Option<String>, names: &[&str]| name.as_deref().is_some_and(|name| names.contains(&name));
        is(&self.primaries, &["bt2020", "smpte431", "smpte432"]) || is(&self.matrix, &["bt2020c", "ictcp", "ycgco"])
    }

    /// From PQ and HLG: up to 0.3 of white all keeps its luminance, and what is brighter is compressed up to the peak.
    fn hdr_to_srgb(&self) -> Vec<Way> {
        let peak = match self.transfer.as_deref() {
            Some("smpte2084") => self.peak.unwrap_or(PEAK).clamp(WHITE, 10_000.0),
            _ => PEAK,
        };
        // Exactly: the approximation of HLG knows nothing of luma.
        let linear = "t=linear:p=bt709:m=gbr:agamma=0";
        let linear = format!("zscale={}:{linear}:npl={WHITE},format=gbrpf32le", self.of_input("bt2020"));
        let mapped = format!("tonemap=mobius:desat=0:peak={}", peak / WHITE);
        let srgb = "zscale=t=iec61966-2-1:r=full,format=gbrp";
        let placebo = "libplacebo=colorspace=gbr:color_primaries=bt709:color_trc=iec61966-2-1:range=full:\
                       peak_detect=0:tonemapping=mobius:format=rgba";
        // Of 100 cd/m^2.
        let opencl = format!("tonemap_opencl=tonemap=mobius:desat=0:peak={}:t=bt709:m=bt709:p=bt709", peak / 100.0);
        vec![
            Way::new("zscale and tonemap", format!("{linear},{mapped},{srgb}")),
            Way {
                name: "libplacebo",
                before: &["-init_hw_device", "vulkan"],
                filter: format!("format=yuv444p10le,hwupload,{placebo},hwdownload,format=rgba"),
            },
            Way {
                name: "tonemap_opencl",
                before: &["-init_hw_device", "opencl"],
                filter: format!("format=p010,hwupload,{opencl}:format=nv12,hwdownload,format=nv12"),
            },
        ]
    }

    /// From other primaries, or another matrix.
    fn wide_to_srgb(&self) -> Vec<Way> {
        let transfer = self.transfer.as_deref().unwrap_or("bt709");
        let to = format!("t={transfer}:p=bt709:m=gbr:r=full:agamma=0");
        let primaries = self.primaries.as_deref().unwrap_or("bt709");
        let matrix = self.matrix.as_deref().unwrap_or("bt2020nc");
        let from = format!("ispace={matrix}:iprimaries={primaries}:itrc={transfer}");
        vec![
            Way::new("zscale", format!("zscale={}:{to},format=gbrp", self.of_input("bt709"))),
            Way::new("colorspace", format!("colorspace={from}:all=bt709:format=yuv444p")),
        ]
    }

    /// Options of zscale for its input, with these primaries where there is no record of them.
    fn of_input(&self, primaries: &str) -> String {
        let matrix = self.matrix.as_deref().unwrap_or("bt2020nc");
        let primaries = self.primaries.as_deref().unwrap_or(primaries);
        let transfer = self.transfer.as_deref().unwrap_or("bt709");
        format!("tin={transfer}:pin={primaries}:min={matrix}")
    }
}

/// The first of some ways by which ffmpeg makes a picture of a clip.
fn first_that_works(clip: &Path, ways: impl IntoIterator<Item = Way>) -> Result<Option<Way>, Error> {
    for way in ways {
        if works(clip, (way.before, &way.filter))? {
            return Ok(Some(way));
        }
    }
    Ok(None)
}

/// Filters one behind the other.
fn chain<const N: usize>(filters: [Option<&str>; N]) -> String {
    filters.into_iter().flatten().collect::<Vec<_>>().join(",")
}
