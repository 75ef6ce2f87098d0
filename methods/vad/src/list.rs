//! Lists of feature files, and names of videos in them.

use crate::{Error, Features, Result};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A video in a list.
#[derive(Clone, Debug)]
pub struct Listed {
    /// Its name, without folders, crop and extension.
    pub name: String,
    /// The classes of its anomalies, none if it is normal; `None` if unknown from the name.
    pub classes: Option<Vec<String>>,
    /// Its features.
    pub features: Features,
}

/// Parts of a feature file's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileName {
    /// The video.
    pub video: String,
    /// The crop; 0 for files without a number.
    pub crop: usize,
}

impl FileName {
    /// Parses `<Video>_x264__<c>.npy` of UR-DMU, `<Video>_x264_i3d.npy` of RTFM, `<name>__<c>.npy` of XD-Violence.
    /// Folders and extensions of videos are left out as well, so that names in annotations become the same.
    ///
    /// ```
    /// use weaver_vad::FileName;
    /// let name = FileName::of("Abuse/Abuse028_x264__3.npy");
    /// assert_eq!((name.video.as_str(), name.crop), ("Abuse028_x264", 3));
    /// assert_eq!(FileName::of("Abuse028_x264_i3d.npy").video, "Abuse028_x264");
    /// ```
    pub fn of(path: &str) -> Self {
        let name = path.rsplit(['/', '\\']).next().unwrap_or(path);
        let name = [".npy", ".mp4", ".avi"].iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name);
        let name = name.strip_suffix("_i3d").unwrap_or(name);
        let numbered = name.rsplit_once("__").and_then(|(video, crop)| Some((video, crop.parse().ok()?)));
        let (video, crop) = numbered.unwrap_or((name, 0));
        Self { video: video.to_string(), crop }
    }
}

/// The classes in a video's name: the codes after `_label_` (XD-Violence, A is normal), or the letters it begins with
/// (UCF-Crime, Normal is normal). An empty list is normal.
///
/// ```
/// use weaver_vad::classes_of;
/// assert_eq!(classes_of("Bad.Boys.1995__#01-11-55_label_G-B2-0"), Some(vec!["G".into(), "B2".into()]));
/// assert_eq!(classes_of("Normal_Videos_872_x264"), Some(vec![]));
/// assert_eq!(classes_of("01_0015"), None);
/// ```
pub fn classes_of(video: &str) -> Option<Vec<String>> {
    if let Some((_, codes)) = video.rsplit_once("_label_") {
        return Some(codes.split('-').filter(|code| !["A", "0"].contains(code)).map(str::to_string).collect());
    }
    let letters: String = video.chars().take_while(char::is_ascii_alphabetic).collect();
    match letters.as_str() {
        "" => None,
        "Normal" => Some(Vec::new()),
        _ => Some(vec![letters]),
    }
}

/// Reads a list of feature files, one to a line, and opens the features of every video in the order of the list. Crops
/// of a video in files of their own become one video.
///
/// A path is looked for below `folder` as it is, then by its last part.
///
/// # Errors
/// When the list or a file cannot be read, a file is missing, videos have different numbers of crops or features, or a
/// crop is missing.
pub fn read_list(list: &Path, folder: &Path) -> Result<Vec<Listed>> {
    let text = weaver_io::read_text(list)?;
    let mut files: Vec<(String, Vec<(usize, PathBuf)>)> = Vec::new();
    let mut by_name: BTreeMap<String, usize> = BTreeMap::new();
    for (number, line) in text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())) {
        if line.is_empty() {
            continue;
        }
        let FileName { video, crop } = FileName::of(line);
        let at = *by_name.entry(video.clone()).or_insert_with(|| {
            files.push((video, Vec::new()));
            files.len() - 1
        });
        if files[at].1.iter().any(|(other, _)| *other == crop) {
            return Err(Error::invalid(list, format!("line {number}"), "each crop of a video once", line));
        }
        files[at].1.push((crop, find(line, folder, list, number)?));
    }
    let crops = files.first().map_or(0, |(_, files)| files.len());
    let mut videos = Vec::with_capacity(files.len());
    let mut width = None;
    for (name, mut files) in files {
        files.sort();
        let numbers: Vec<usize> = files.iter().map(|(crop, _)| *crop).collect();
        // In lists without crop numbers the first crop is the center crop.
        if numbers != (0..crops).collect::<Vec<_>>() {
            return Err(Error::invalid(list, &name, format!("crops 0 to {}", crops - 1), format!("{numbers:?}")));
        }
        let paths: Vec<PathBuf> = files.into_iter().map(|(_, path)| path).collect();
        let features = Features::open(&paths)?;
        let expected = *width.get_or_insert((features.width(), features.crops()));
        if (features.width(), features.crops()) != expected {
            let found = format!("{} and {}", features.width(), features.crops());
            let expected = format!("{} features and {} crops as before", expected.0, expected.1);
            return Err(Error::invalid(&paths[0], "shape", expected, found));
        }
        videos.push(Listed { classes: classes_of(&name), name, features });
    }
    if videos.is_empty() {
        return Err(Error::invalid(list, "lines", "paths of feature files", "none"));
    }
    Ok(videos)
}

fn find(line: &str, folder: &Path, list: &Path, number: usize) -> Result<PathBuf> {
    let last = line.rsplit(['/', '\\']).next().unwrap_or(line);
    let places = [folder.join(line), folder.join(last)];
    let missing = || Error::invalid(list, format!("line {number}"), format!("a file below {}", folder.display()), line);
    places.into_iter().find(|path| path.is_file()).ok_or_else(missing)
}
