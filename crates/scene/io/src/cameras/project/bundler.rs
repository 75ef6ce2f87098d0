//! Cameras and points of Bundler: a text of numbers, and a list of photos.
//!
//! Poses are world to camera with OpenGL's axes; keypoints are offsets from the middle of the photo, y up. A camera
//! without a pose has the focal length 0.

use super::{Project, ProjectKind, Source, lens};
use crate::Result;
use crate::files::file::read_text;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_scene::Frame;

/// The one version that says where points are seen.
const HEADER: &str = "# Bundle file v0.3";
/// Half a turn about the camera's x axis, from OpenGL to OpenCV.
const FLIP: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));

/// The words of a text, and their lines.
struct Words<'a> {
    source: &'a Source<'a>,
    words: Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    line: usize,
}

impl Words<'_> {
    fn next<T: FromStr>(&mut self, what: &str) -> Result<T> {
        let Some((line, word)) = self.words.next() else {
            let place = format!("line {}", self.line);
            return Err(self.source.invalid(place, what, "the end of the file: it is cut off"));
        };
        self.line = line;
        word.parse().map_err(|_| self.source.invalid(format!("line {line}"), what, format!("{word:?}")))
    }

    fn number(&mut self, what: &str) -> Result<f64> {
        let number: f64 = self.next(what)?;
        if number.is_finite() {
            Ok(number)
        } else {
            Err(self.source.invalid(format!("line {}", self.line), what, number))
        }
    }

    fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(what)?;
        }
        Ok(numbers)
    }
}

pub(super) fn read(source: &Source) -> Result<Project> {
    let text = read_text(source.path)?;
    let Some(body) = text.trim_start().strip_prefix(HEADER) else {
        return Err(source.invalid("line 1", HEADER, format!("{:?}", text.lines().next().unwrap_or(""))));
    };
    let words = body.lines().zip(1..).flat_map(|(text, line)| text.split_whitespace().map(move |word| (line, word)));
    let mut words = Words { source, words: Box::new(words), line: 1 };
    let [count, points] = [words.next::<usize>("the number of cameras")?, words.next("the number of points")?];
    let list = list_of(source.path).ok_or_else(|| {
        let names = lists_of(source.path).iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
        source.invalid("list of photos", format!("one of {names}"), "none of them")
    })?;
    let text = read_text(&list)?;
    let names: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).map(name).collect();
    if names.len() != count {
        let expected = format!("a line for each of {count} cameras of {}", source.path.display());
        return Err(crate::Error::invalid(&list, "photos", expected, names.len()));
    }
    let (mut frames, mut unposed) = (Vec::new(), Vec::new());
    // The frame of each camera: some have none.
    let mut places = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let [f, k1, k2] = words.numbers("f, k1 and k2 of a camera")?;
        let r: [f64; 9] = words.numbers("a rotation")?;
        let t: [f64; 3] = words.numbers("a translation")?;
        if f == 0.0 {
            unposed.push(name.to_string());
            places.push(None);
            continue;
        }
        let place = format!("camera {i} ({name})");
        if f < 0.0 {
            return Err(source.invalid(place, "a positive focal length", f));
        }
        let rows = [0, 3, 6].map(|at| [r[at], r[at + 1], r[at + 2], t[at / 3]]);
        let pose = Pose::from_rows(&rows).map_err(|error| source.invalid(&place, "a rotation", error))?;
        let pose = Pose::new(FLIP * pose.rotation, FLIP * pose.translation);
        let (name, path, (width, height)) = source.photo(&place, name, None)?;
        let intrinsics = Intrinsics { fx: f, fy: f, cx: 0.5 * width as f64, cy: 0.5 * height as f64 };
        let distortion = lens::brown([k1, k2, 0.0, 0.0], [0.0; 2], &intrinsics, (width, height)).unwrap_or(None);
        places.push(Some(frames.len()));
        frames.push(Frame { path, distortion, ..Frame::new(name, Camera { pose, intrinsics, width, height }) });
    }
    let mut project = Project::new(ProjectKind::Bundler, frames);
    project.observations = vec![Vec::new(); project.frames.len()];
    for point in 0..points {
        let index = u32::try_from(point).map_err(|_| source.invalid("points", "fewer", points))?;
        project.points.push(words.numbers("a position")?);
        project.colors.push(words.numbers("a color")?.map(|x| x.clamp(0.0, 255.0) as u8));
        for _ in 0..words.next::<usize>("the number of photos of a point")? {
            let camera: usize = words.next("the number of a camera")?;
            let _: usize = words.next("the number of a keypoint")?;
            let [x, y] = words.numbers("a keypoint")?;
            let Some(frame) = places.get(camera) else {
                let line = format!("line {}", words.line);
                return Err(source.invalid(line, format!("a camera below {count}"), camera));
            };
            if let Some(frame) = *frame {
                let Intrinsics { cx, cy, .. } = project.frames[frame].camera.intrinsics;
                project.observations[frame].push(([cx + x, cy - y], index));
            }
        }
    }
    project.remark_unposed(source.path, &unposed);
    Ok(project)
}

/// The name in a line of a list, which may have a zero and a focal length behind it.
fn name(line: &str) -> &str {
    let mut rest = line;
    let mut numbers = 0;
    while let Some((before, word)) = rest.rsplit_once(char::is_whitespace) {
        if numbers == 2 || word.parse::<f64>().is_err() {
            break;
        }
        (rest, numbers) = (before.trim_end(), numbers + 1);
    }
    if numbers == 2 { rest } else { line }
}

/// Where programs put the list of photos.
fn lists_of(path: &Path) -> Vec<PathBuf> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let first = stem.split('.').next().unwrap_or_default();
    let beside = [format!("{stem}.list.txt"), format!("{first}.list.txt"), "list.txt".into(), format!("{stem}.txt")];
    beside.into_iter().map(|name| folder.join(name)).chain([folder.join("../list.txt")]).collect()
}

fn list_of(path: &Path) -> Option<PathBuf> {
    lists_of(path).into_iter().find(|list| list.is_file())
}

#[cfg(test)]
mod tests {
    #[test]
    fn focal_lengths_behind_names_are_left_out() {
        for (line, name) in
            [("./a.jpg", "./a.jpg"), ("a.jpg 0 1234.5", "a.jpg"), ("my photo 2.jpg", "my photo 2.jpg"), ("a 7", "a 7")]
        {
            assert_eq!(super::name(line), name);
        }
    }
}
