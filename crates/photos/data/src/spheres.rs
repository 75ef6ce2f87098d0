//! Panoramas become photos of usual lenses: six faces of a cube each.

mod cut;
mod nadir;

use crate::Error;
use crate::capture::{Mask, PhotoMasks};
use crate::remarks::some_of;
use cut::{Cut, FACES, NAMES};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use weaver_geometry::glam::DMat3;
use weaver_io::{Observe, OutputFolder, Panorama, Part, PhotoFile, Stage};
use weaver_sfm::Mounted;

/// The folder of faces, and of their masks.
const FOLDER: &str = "faces";
const MASKS: &str = "faces/masks";
/// Name of the stage.
const LABEL: &str = "panoramas";

/// Projection of photos that are twice as wide as high.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Projection {
    /// Panoramas: columns are longitudes and rows latitudes.
    Equirectangular,
    /// Photos of usual lenses, whatever their files say.
    Pinhole,
}

/// Panoramas among photos.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SphereOptions {
    /// Projection of photos that are twice as wide as high; `None` follows their files.
    pub projection: Option<Projection>,
    /// Angle around straight down that is left out of panoramas, degrees; `None` leaves out what is the same in all of
    /// them, as a tripod or a logo is.
    pub nadir: Option<f64>,
}

/// The face of a panorama.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Face {
    /// The file of the panorama, and its number among the photos.
    pub panorama: PathBuf,
    pub number: usize,
    /// The name of the side: front, right, back, left, up or down.
    pub side: &'static str,
    /// Rotation from the axes of the front face to its own.
    pub rotation: DMat3,
    /// Focal length over the side.
    pub focal: f64,
}

impl Face {
    /// The place of a face among the others of its panorama, by numbers of photos.
    pub fn mounted(faces: &[Option<Self>], photo: usize) -> Option<Mounted> {
        let face = faces[photo].as_ref()?;
        let of_panorama = |face: &Option<Self>, number: usize| face.as_ref().is_some_and(|face| face.number == number);
        let others = faces[..photo].iter().rev().take_while(|other| of_panorama(other, face.number)).count();
        let on = photo - others;
        let first = faces[on].as_ref()?;
        Some(Mounted { on, rotation: face.rotation * first.rotation.transpose() })
    }

    /// The files of photos and panoramas.
    pub fn photos(paths: &[PathBuf], faces: &[Option<Self>]) -> Vec<PathBuf> {
        let path = |(path, face): (&PathBuf, &Option<Self>)| face.as_ref().map_or(path, |face| &face.panorama).clone();
        let mut photos: Vec<PathBuf> = paths.iter().zip(faces).map(path).collect();
        photos.dedup();
        photos
    }
}

/// Photos whose cameras are to be estimated: files, and faces that panoramas were cut into.
#[derive(Clone, Debug, Default)]
pub struct PhotoSet {
    /// The files.
    pub paths: Vec<PathBuf>,
    /// The file that each was made of, or the same.
    pub originals: Vec<PathBuf>,
    /// True for photos that are only located.
    pub located: Vec<bool>,
    /// Masks of all photos.
    pub masks: Option<PhotoMasks>,
    /// Faces of panoramas.
    pub(crate) faces: Vec<Option<Face>>,
    /// Names of the files that were written.
    written: Vec<String>,
}

/// A photo of a set before it is cut.
#[derive(Clone, Copy, Debug)]
struct Whole<'a> {
    path: &'a Path,
    original: &'a Path,
    located: bool,
    mask: Option<&'a Mask>,
}

impl PhotoSet {
    /// Photos as they are, whatever they show.
    ///
    /// # Panics
    /// If `located` or the masks are not as many as `paths`.
    pub fn new(paths: &[PathBuf], located: &[bool], masks: Option<PhotoMasks>) -> Self {
        assert_eq!(paths.len(), located.len(), "as many photos as flags");
        assert!(masks.as_ref().is_none_or(|masks| masks.masks.len() == paths.len()), "as many photos as masks");
        Self {
            paths: paths.to_vec(),
            originals: paths.to_vec(),
            located: located.to_vec(),
            masks,
            faces: vec![None; paths.len()],
            written: Vec::new(),
        }
    }

    /// The same with all panoramas cut into faces, which are written to the folder `faces` of a result, with their
    /// masks in `faces/masks`; `originals` are the files that the paths were made of.
    ///
    /// A face is a side of a cube around the place of the camera, 95 degrees wide, so that things on an edge are whole
    /// in one of them. It has as many pixels for an angle as the middle of the panorama. Masks leave out the part of a
    /// sphere that a panorama does not show, and what stands below the camera in all of them.
    ///
    /// # Errors
    /// When records of a panorama contradict its size, a panorama or its mask cannot be read, a face cannot be written,
    /// or one panorama is all there is.
    pub fn cut(
        self,
        originals: &[PathBuf],
        options: &SphereOptions,
        out: &OutputFolder,
        observe: &mut dyn Observe,
    ) -> Result<Self, Error> {
        let panoramas = self.panoramas(options, observe)?;
        let count = panoramas.iter().flatten().count();
        let original = |i: usize| originals.get(i).unwrap_or(&self.paths[i]);
        if count == 0 {
            let originals = (0..self.paths.len()).map(|i| original(i).clone()).collect();
            return Ok(Self { originals, ..self });
        }
        if count == 1 && self.paths.len() == 1 {
            let expected = "panoramas from at least two places";
            return Err(Error::unexpected(&self.paths[0], "photos", expected, "a single one: it tells no depth"));
        }
        observe.begin(&Stage { label: LABEL, done: 0, total: count, stops_after: None });
        let mut set = Self { masks: None, ..Self::default() };
        let mut cuts: Vec<Option<Cut>> = Vec::new();
        for (i, panorama) in panoramas.into_iter().enumerate() {
            let mask = self.masks.as_ref().map(|masks| &masks.masks[i]);
            let whole = Whole { path: &self.paths[i], original: original(i), located: self.located[i], mask };
            let cut = panorama.map(|panorama| set.add_faces(&whole, i, panorama, out)).transpose()?;
            match cut {
                Some(_) => {
                    let done = cuts.iter().flatten().count() + 1;
                    let _ = observe.progress(&Part { label: LABEL, done, total: count, note: "cut into faces".into() });
                }
                None => set.add(whole.path, &whole, None),
            }
            cuts.push(cut);
        }
        let sides: Vec<usize> = cuts.iter().flatten().map(|cut| cut.side).collect();
        let faces = set.faces.iter().flatten().count();
        let side = sides.iter().max().copied().unwrap_or(0);
        let folder = out.path().join(FOLDER);
        observe.note(&format!(
            "photos: {count} panoramas cut into {faces} faces of {side} pixels, in {}",
            folder.display()
        ));
        let nadir = match options.nadir {
            Some(degrees) => degrees,
            None => nadir::constant(&cuts.iter().flatten().map(|cut| &cut.below).collect::<Vec<_>>()),
        };
        if let (None, true) = (options.nadir, nadir > 0.0) {
            observe.note(&format!(
                "photos: what is below the camera is the same in all panoramas up to {nadir:.0} degrees, and left out; --nadir 0 keeps it"
            ));
        }
        set.mask(&cuts, self.masks, nadir, out)?;
        Ok(set)
    }

    /// Removes the faces of earlier photos in a folder. To be called once cameras are written: until then the earlier
    /// ones name them.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn remove_earlier_faces(&self, out: &OutputFolder) -> Result<(), Error> {
        Ok(out.remove_others(FOLDER, &self.written)?)
    }

    /// The panorama in each photo.
    fn panoramas(&self, options: &SphereOptions, observe: &mut dyn Observe) -> Result<Vec<Option<Panorama>>, Error> {
        if options.projection == Some(Projection::Pinhole) {
            return Ok(vec![None; self.paths.len()]);
        }
        let asked = options.projection == Some(Projection::Equirectangular);
        let of = |path: &PathBuf| -> Result<(Option<Panorama>, bool), Error> {
            // A photo that cannot be read is named by its reader.
            let Ok(file) = PhotoFile::at(path) else { return Ok((None, false)) };
            let found = Panorama::of(path, file.size())?;
            let fits = Panorama::fits(file.size());
            let found = found.or((asked && fits).then(|| Panorama::whole(file.size())));
            Ok((found, fits && found.is_none()))
        };
        let found: Vec<(Option<Panorama>, bool)> = self.paths.par_iter().map(of).collect::<Result<_, _>>()?;
        let perhaps: Vec<String> = (found.iter().zip(&self.paths).filter(|((_, perhaps), _)| *perhaps))
            .map(|(_, path)| path.display().to_string())
            .collect();
        if !perhaps.is_empty() {
            observe.note(&format!(
                "photos: twice as wide as high, and taken for photos of a usual lens: {}; --projection equirectangular takes them for panoramas",
                some_of(&perhaps)
            ));
        }
        if asked && found.iter().all(|(panorama, _)| panorama.is_none()) {
            let size = self.paths.iter().find_map(|path| Some(PhotoFile::at(path).ok()?.size()));
            let found = size.map_or("none".into(), |(width, height)| format!("{width} x {height} pixels"));
            let path = self.paths.first().map_or(Path::new("photos"), PathBuf::as_path);
            return Err(Error::unexpected(path, "--projection equirectangular", "twice as wide as high", found));
        }
        Ok(found.into_iter().map(|(panorama, _)| panorama).collect())
    }

    fn add(&mut self, path: &Path, whole: &Whole<'_>, face: Option<Face>) {
        self.paths.push(path.into());
        self.originals.push(whole.original.into());
        self.located.push(whole.located);
        self.faces.push(face);
    }

    /// Writes the faces of a panorama, and adds them.
    fn add_faces(
        &mut self,
        whole: &Whole<'_>,
        number: usize,
        panorama: Panorama,
        out: &OutputFolder,
    ) -> Result<Cut, Error> {
        let photo = PhotoFile::at(whole.path)?;
        let mask = whole.mask.map(|mask| mask.open(whole.path, photo.clone())?.read().map_err(Error::from));
        let mut cut = Cut::new(panorama, &photo.read()?, mask.transpose()?);
        let stem = whole.path.file_stem().unwrap_or_default().to_string_lossy();
        for side in cut.shown() {
            let bytes = cut.faces[side].to_jpeg(cut::QUALITY).map_err(unwritten(whole.path))?;
            let name = out.keep(&format!("{FOLDER}/{stem}-{}.jpg", NAMES[side]), &bytes, &self.written)?;
            let face = Face {
                panorama: whole.original.into(),
                number,
                side: NAMES[side],
                rotation: cut::rotation(side),
                focal: cut::focal(),
            };
            self.add(&out.path().join(&name), whole, Some(face));
            self.written.push(name);
        }
        // Only what masks need is kept.
        cut.faces = Default::default();
        Ok(cut)
    }

    /// Writes the masks of faces, and white ones of other photos without a mask, if any face is masked.
    fn mask(
        &mut self,
        cuts: &[Option<Cut>],
        masks: Option<PhotoMasks>,
        nadir: f64,
        out: &OutputFolder,
    ) -> Result<(), Error> {
        let masked = cuts.iter().flatten().any(|cut| cut.is_masked() || nadir > 0.0);
        if !masked && masks.is_none() {
            return Ok(());
        }
        let (given, remark) = masks.map_or((None, None), |masks| (Some(masks.masks), masks.remark));
        let (mut all, mut next) = (Vec::new(), 0);
        for (i, cut) in cuts.iter().enumerate() {
            let Some(cut) = cut else {
                let path = &self.paths[next];
                all.push(match (given.as_ref(), PhotoFile::at(path)) {
                    (Some(given), _) => given[i].clone(),
                    // A photo that cannot be read needs none.
                    (None, Err(_)) => Mask::at(path.clone()),
                    (None, Ok(file)) => self.write_mask(next, &cut::white(file.size()), out)?,
                });
                next += 1;
                continue;
            };
            for side in cut.shown() {
                all.push(self.write_mask(next, &cut.mask(side, nadir), out)?);
                next += 1;
            }
        }
        self.masks = Some(PhotoMasks { masks: all, remark });
        Ok(())
    }

    fn write_mask(&mut self, photo: usize, mask: &weaver_io::Bitmap, out: &OutputFolder) -> Result<Mask, Error> {
        let stem = self.paths[photo].file_stem().unwrap_or_default().to_string_lossy();
        let bytes = mask.to_png().map_err(unwritten(&self.paths[photo]))?;
        let name = out.keep(&format!("{MASKS}/{stem}.png"), &bytes, &self.written)?;
        self.written.push(name.clone());
        Ok(Mask::at(out.path().join(name)))
    }
}

/// A picture of a photo that cannot be encoded.
fn unwritten(photo: &Path) -> impl Fn(std::io::Error) -> weaver_io::Error {
    move |source| weaver_io::Error::Io { path: photo.into(), source }
}

/// Each face has a name.
const _: () = assert!(NAMES.len() == FACES);
