//! A place in the light of photos: which, and the pictures and files of it.

use crate::pictures::{enlarged, stack};
use crate::{CameraSource, Error, Look, LookPrediction, Photos, Predictor, planar};
use std::path::PathBuf;
use weaver_data::capture;
use weaver_io::{Image, OutputFolder};
use weaver_kernels::random::Stream;

/// Photos that a strip of renders shows.
const SHOWN: usize = 4;
/// Least width of one picture in a strip, pixels.
const LEAST_WIDTH: usize = 128;

/// In whose light a place is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Looks {
    /// The photo that shows it.
    pub from: PathBuf,
    /// Another one, to which the light changes over so many frames, both ends among them: at least 2.
    pub to: Option<(PathBuf, usize)>,
}

/// A prediction under looks, and the photos that give them.
pub(crate) struct Shown {
    pub prediction: LookPrediction,
    photos: Vec<Image>,
}

impl Looks {
    /// Predicts with these looks; the photos of the looks are cropped like the photos of the place.
    pub(crate) fn predict(
        &self,
        predictor: &mut dyn Predictor,
        photos: Photos<'_>,
        cameras: CameraSource<'_>,
        stream: Stream,
    ) -> Result<Shown, Error> {
        let Photos { width, height, .. } = photos;
        let ends: Vec<PathBuf> = std::iter::once(&self.from).chain(self.to.iter().map(|(to, _)| to)).cloned().collect();
        let of_ends = capture::load_images(&ends, width, height)?;
        let planes: Vec<Vec<f32>> = of_ends.iter().map(|image| planar([image])).collect();
        let one = |planes| Photos { planes, inside: None, height, width };
        let looks: Vec<Look<'_>> = match (&planes[..], &self.to) {
            ([from, to], Some((_, frames))) if *frames >= 2 => {
                let part = |i: usize| i as f32 / (frames - 1) as f32;
                (0..*frames).map(|i| Look::Between(one(from), one(to), part(i))).collect()
            }
            (_, Some((_, frames))) => {
                return Err(Error::Input(format!(
                    "frames from one look to another: expected at least 2, found {frames}"
                )));
            }
            (all, None) => vec![Look::Of(one(&all[0]))],
        };
        let prediction = predictor.as_lights()?.predict_looks(photos, cameras, &looks, stream)?;
        Ok(Shown { prediction, photos: of_ends })
    }
}

impl Shown {
    /// Writes looks.png, a row for each of the first photos from the first look to the last, with the photos that give
    /// them at its ends, and, where there are several, looks/00.ply and so on: the same Gaussians in other colors.
    pub(crate) fn write(self, predictor: &mut dyn Predictor, out: &OutputFolder) -> Result<(), Error> {
        let LookPrediction { mut prediction, colors } = self.prediction;
        let several = colors.len() > 1;
        let mut columns = Vec::new();
        for (i, sh) in colors.into_iter().enumerate() {
            prediction.gaussians.sh = sh;
            let cameras = &prediction.cameras[..prediction.cameras.len().min(SHOWN)];
            columns.push(predictor.render(&prediction, cameras)?);
            if several {
                let path = out.file(format!("looks/{i:02}.ply"))?;
                weaver_io::write_gaussians(path, &prediction.gaussians.to_stored())?;
            }
        }
        strip(&self.photos, &columns).write_png(out.file("looks.png")?)?;
        Ok(())
    }
}

/// Columns of renders between the photos that give their looks.
fn strip(photos: &[Image], columns: &[Vec<Image>]) -> Image {
    let Image { width, height, .. } = photos[0];
    let nothing = Image::filled(width, height, [1.0; 3]);
    let times = LEAST_WIDTH.div_ceil(width.max(1));
    let row = |v: usize| {
        let end = |i: usize| photos.get(i).map(|photo| if v == 0 { photo } else { &nothing });
        let all = end(0).into_iter().chain(columns.iter().map(|column| &column[v])).chain(end(1));
        let large: Vec<Image> = all.map(|image| enlarged(image, times)).collect();
        Image::mosaic(&large.iter().collect::<Vec<_>>())
    };
    let rows: Vec<Image> = (0..columns.first().map_or(0, Vec::len)).map(row).collect();
    stack(&rows.iter().collect::<Vec<_>>())
}
