//! Pictures that go into a folder and into films at once.

use crate::{Error, Film};
use rayon::prelude::*;
use std::fmt;
use std::path::PathBuf;
use weaver_io::{Image, OutputFolder};

/// Destinations of pictures: a folder, which gets a PNG of each, and films.
#[derive(Default)]
pub struct PictureSink<'a> {
    /// The folder.
    pub folder: Option<&'a OutputFolder>,
    /// The films.
    pub films: Vec<Box<dyn Film>>,
}

impl fmt::Debug for PictureSink<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PictureSink").field("folder", &self.folder).finish_non_exhaustive()
    }
}

impl PictureSink<'_> {
    /// Writes pictures of these names, without endings.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&mut self, pictures: &[(&str, Image)]) -> Result<(), Error> {
        if let Some(folder) = self.folder {
            let write = |(stem, image): &(&str, Image)| image.write_png(folder.file(format!("{stem}.png"))?);
            pictures.par_iter().try_for_each(write)?;
        }
        let push = |film: &mut Box<dyn Film>| pictures.iter().try_for_each(|(_, image)| film.push(image));
        self.films.par_iter_mut().try_for_each(push)
    }

    /// Draws a picture for each name, and writes it: all threads draw one picture after the other, while up to
    /// `at_once` earlier pictures are written, one per thread.
    ///
    /// # Errors
    /// As [`write`](Self::write), and as `draw`, which receives the number of the name.
    pub fn fill<E: From<Error> + Send>(
        &mut self,
        names: &[String],
        at_once: usize,
        mut draw: impl FnMut(usize) -> Result<Image, E> + Send,
    ) -> Result<(), E> {
        let mut waiting = Vec::new();
        let numbered: Vec<(usize, &String)> = names.iter().enumerate().collect();
        for group in numbered.chunks(at_once.max(1)) {
            let mut drawn =
                || group.iter().map(|(i, name)| Ok((name.as_str(), draw(*i)?))).collect::<Result<Vec<_>, E>>();
            let (drawn, written) = rayon::join(&mut drawn, || self.write(&waiting));
            written?;
            waiting = drawn?;
        }
        Ok(self.write(&waiting)?)
    }

    /// Completes the films, and returns the paths of folder and films.
    ///
    /// # Errors
    /// When a film cannot be completed.
    pub fn finish(self) -> Result<Vec<PathBuf>, Error> {
        let folder = self.folder.map(|folder| Ok(folder.path().to_path_buf()));
        folder.into_iter().chain(self.films.into_iter().map(|film| film.finish())).collect()
    }
}
