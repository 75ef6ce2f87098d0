//! Features of videos: in memory, or in files that are read when needed.

use crate::{Error, Result};
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use weaver_io::Npy;

/// Possible numbers of crops in a file: ten for UCF-Crime and ShanghaiTech, five for XD-Violence.
const CROPS: [usize; 2] = [10, 5];

/// The features of a video, `[crops, snippets, width]`.
#[derive(Clone, Debug)]
pub struct Features {
    snippets: usize,
    width: usize,
    crops: Vec<Crop>,
}

/// The features of one crop, `[snippets, width]`.
#[derive(Clone, Debug)]
enum Crop {
    Memory(Vec<f32>),
    File(FileCrop),
}

#[derive(Clone, Debug)]
struct FileCrop {
    path: PathBuf,
    array: Npy,
    /// Offset of the crop, and stride between its snippets, in numbers.
    start: usize,
    stride: usize,
}

impl Features {
    /// One crop, `[snippets, width]`, from memory.
    ///
    /// # Panics
    /// When the values are no rows of that width.
    pub fn in_memory(values: Vec<f32>, width: usize) -> Self {
        assert!(width > 0 && !values.is_empty() && values.len().is_multiple_of(width), "rows of {width} numbers");
        Self { snippets: values.len() / width, width, crops: vec![Crop::Memory(values)] }
    }

    /// Opens one file with a crop, `[S, D]`, or all, `[S, crops, D]` or `[crops, S, D]`, or one file for each crop.
    ///
    /// # Errors
    /// When a file cannot be read, has another shape, or another number of snippets than the first.
    pub fn open(files: &[PathBuf]) -> Result<Self> {
        let mut all: Option<Self> = None;
        for path in files {
            let one = Self::open_file(path)?;
            let Some(all) = &mut all else {
                all = Some(one);
                continue;
            };
            if (one.snippets, one.width) != (all.snippets, all.width) {
                let expected = format!("[{}, {}] as in {}", all.snippets, all.width, files[0].display());
                return Err(Error::invalid(path, "shape", expected, format!("[{}, {}]", one.snippets, one.width)));
            }
            all.crops.extend(one.crops);
        }
        all.ok_or_else(|| Error::invalid(Path::new(""), "files", "at least one", "none"))
    }

    fn open_file(path: &Path) -> Result<Self> {
        let array = Npy::open(path)?;
        let shape = array.shape().to_vec();
        let crop =
            |start, stride| Crop::File(FileCrop { path: path.to_path_buf(), array: array.clone(), start, stride });
        let (snippets, width, crops) = match shape[..] {
            [snippets, width] => (snippets, width, vec![crop(0, width)]),
            [snippets, n, width] if CROPS.contains(&n) => {
                (snippets, width, (0..n).map(|c| crop(c * width, n * width)).collect())
            }
            [n, snippets, width] if CROPS.contains(&n) => {
                (snippets, width, (0..n).map(|c| crop(c * snippets * width, width)).collect())
            }
            _ => {
                let expected = "[S, D], [S, crops, D] or [crops, S, D] with 5 or 10 crops";
                return Err(Error::invalid(path, "shape", expected, format!("{shape:?}")));
            }
        };
        if snippets == 0 || width == 0 {
            return Err(Error::invalid(path, "shape", "at least one snippet with features", format!("{shape:?}")));
        }
        Ok(Self { snippets, width, crops })
    }

    /// Snippets of the video.
    pub fn snippets(&self) -> usize {
        self.snippets
    }

    /// Numbers for each snippet.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Crops of the video.
    pub fn crops(&self) -> usize {
        self.crops.len()
    }

    /// The file of the first crop, if it is in one.
    pub fn path(&self) -> Option<&Path> {
        match self.crops.first()? {
            Crop::Memory(_) => None,
            Crop::File(file) => Some(&file.path),
        }
    }

    /// Crop `c`, `[snippets, width]`.
    ///
    /// # Errors
    /// When a number is not finite.
    ///
    /// # Panics
    /// When there is no such crop.
    pub fn crop(&self, c: usize) -> Result<Cow<'_, [f32]>> {
        let file = match &self.crops[c] {
            Crop::Memory(values) => return Ok(Cow::Borrowed(values)),
            Crop::File(file) => file,
        };
        let rows = (0..self.snippets).map(|row| file.start + row * file.stride);
        let values: Vec<f32> = if file.stride == self.width {
            file.array.numbers(file.start..file.start + self.snippets * self.width)
        } else {
            rows.flat_map(|start| file.array.numbers(start..start + self.width)).collect()
        };
        match values.iter().position(|x| !x.is_finite()) {
            None => Ok(Cow::Owned(values)),
            Some(at) => {
                let place = format!("crop {c}, snippet {}, number {}", at / self.width, at % self.width);
                Err(Error::invalid(&file.path, place, "a finite number", values[at]))
            }
        }
    }
}
