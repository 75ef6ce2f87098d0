//! Evidence of photos for and against each Gaussian.

use std::borrow::Cow;
use weaver_geometry::Camera;
use weaver_scene::{ActivatedGaussians, CameraRows, CameraSlices, Model, Photo};
use weaver_splat::{Compared, Images, RasterError, RasterSettings, Workspace, rasterize};

/// Sum of weights from which a photo shows a Gaussian, pixels.
const SHOWN: f32 = 0.02;
/// Longest side of pictures that only say which Gaussians show, pixels.
const SMALL: usize = 200;
/// Squared error of a photo that is met to the last bit.
const LEAST: f64 = 1e-9;

/// A photo that Gaussians are judged by.
#[derive(Clone, Debug)]
pub(crate) struct Witness<'a> {
    /// The photo, and its pixels that count.
    pub photo: &'a Photo,
    pub counts: Option<Cow<'a, [bool]>>,
    /// The camera as it was refined.
    pub camera: Camera,
    /// The photo's correction of colors `[A | b]`, row by row.
    pub exposure: [f32; 12],
}

/// Sums over photos, `[N]`. A rise is that of the squared error over the pixels and channels of a photo, as a part of
/// it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evidence {
    /// Rise of the error without the Gaussian alone; below 0 where the photos are met better without it.
    pub rise: Vec<f64>,
    /// Sum of the squared rises in single photos: how unevenly photos judge.
    pub square: Vec<f64>,
    /// The largest rise in a single photo.
    pub most: Vec<f64>,
    /// Number of photos that show it.
    pub photos: Vec<u32>,
    /// Number of photos.
    pub asked: usize,
    /// Sum of the logarithms of the photos' squared errors.
    pub error: f64,
}

/// A scene to judge, with its background and rules of drawing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn<'a> {
    pub scene: &'a ActivatedGaussians,
    pub background: [f32; 3],
    pub raster: &'a RasterSettings,
}

/// Judges Gaussians by photos, as [`Workspace::removal`] says.
pub(crate) fn evidence(drawn: Drawn<'_>, witnesses: &[Witness<'_>]) -> Result<Evidence, RasterError> {
    let count = drawn.scene.opacities.len();
    let zeros = vec![0.0; count];
    let mut all = Evidence {
        rise: zeros.clone(),
        square: zeros.clone(),
        most: zeros,
        photos: vec![0; count],
        asked: witnesses.len(),
        error: 0.0,
    };
    let (mut rises, mut shown, mut workspace) = (vec![0.0_f32; count], vec![0.0_f32; count], Workspace::new());
    for witness in witnesses {
        let view = draw(drawn, witness, &mut workspace)?;
        let square = view.square().max(LEAST);
        all.error += square.ln();
        let View { image, error, counts } = &view;
        let map = std::array::from_fn(|i| witness.exposure[4 * (i / 3) + i % 3]);
        workspace.removal(&Compared { image, error, counts, map }, &mut rises, &mut shown)?;
        for i in (0..count).filter(|i| shown[*i] > SHOWN) {
            let rise = f64::from(rises[i]) / square;
            all.rise[i] += rise;
            all.square[i] += rise * rise;
            all.most[i] = all.most[i].max(rise);
            all.photos[i] += 1;
        }
    }
    Ok(all)
}

/// Adds the pictures that show each Gaussian, `[N]`, with small ones in place of a camera's own.
pub(crate) fn shown_in(drawn: Drawn<'_>, cameras: &[(Camera, Model)], shown: &mut [u32]) -> Result<(), RasterError> {
    let count = drawn.scene.opacities.len();
    let (mut sums, mut largest, mut workspace) = (vec![0.0; count], vec![0.0; count], Workspace::new());
    for (camera, model) in cameras {
        let small = camera.shrunk(SMALL);
        let pixels = small.width * small.height;
        let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
        let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
        let rows = CameraRows::new(&[small]);
        let cameras = CameraSlices { model: *model, ..rows.as_slices(&drawn.background) };
        rasterize(&drawn.scene.as_slices(), &cameras, drawn.raster, &mut workspace, images)?;
        workspace.contributions(&mut sums, &mut largest)?;
        let least = SHOWN * pixels as f32 / (camera.width * camera.height) as f32;
        shown.iter_mut().zip(&sums).for_each(|(shown, sum)| *shown += u32::from(*sum > least));
    }
    Ok(())
}

/// [`Evidence::error`] alone.
pub(crate) fn error(drawn: Drawn<'_>, witnesses: &[Witness<'_>]) -> Result<f64, RasterError> {
    let mut workspace = Workspace::new();
    witnesses.iter().map(|witness| Ok(draw(drawn, witness, &mut workspace)?.square().max(LEAST).ln())).sum()
}

/// The scene as a witness sees it.
struct View {
    image: Vec<f32>,
    /// Its difference from the photo, in the photo's light.
    error: Vec<f32>,
    /// 1 for pixels that count.
    counts: Vec<f32>,
}

impl View {
    /// The squared error of the pixels that count.
    fn square(&self) -> f64 {
        let squares = self.error.chunks_exact(3).map(|pixel| pixel.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>());
        squares.zip(&self.counts).map(|(square, counts)| f64::from(*counts) * square).sum()
    }
}

fn draw(drawn: Drawn<'_>, witness: &Witness<'_>, workspace: &mut Workspace<f32>) -> Result<View, RasterError> {
    let Witness { photo, counts, camera, exposure } = witness;
    let pixels = camera.width * camera.height;
    let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
    let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
    let rows = CameraRows::new(&[*camera]);
    let cameras = CameraSlices { model: photo.model(), ..rows.as_slices(&drawn.background) };
    rasterize(&drawn.scene.as_slices(), &cameras, drawn.raster, workspace, images)?;
    let error = image.chunks_exact(3).zip(photo.rgb.chunks_exact(3)).flat_map(|(seen, photo)| {
        [0, 1, 2].map(|c| {
            let row = &exposure[4 * c..][..4];
            let lit = row[3] + (0..3).map(|k| row[k] * seen[k]).sum::<f32>();
            lit - f32::from(photo[c]) / 255.0
        })
    });
    let error = error.collect();
    let counts = (0..pixels).map(|pixel| u8::from(counts.as_ref().is_none_or(|counts| counts[pixel])).into()).collect();
    Ok(View { image, error, counts })
}
