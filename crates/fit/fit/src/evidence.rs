//! Evidence of photos for and against each Gaussian.

use weaver_geometry::Camera;
use weaver_kernels::parallel;
use weaver_scene::{ActivatedGaussians, CameraRows, Photo};
use weaver_splat::{BlendWeights, Images, RasterError, RasterSettings, Workspace, rasterize};

/// Photos side by side.
const BATCH: usize = 16;
/// Sum of weights from which a photo shows a Gaussian, pixels.
const SHOWN: f32 = 0.02;

/// A photo that Gaussians are judged by.
#[derive(Clone, Debug)]
pub(crate) struct Witness {
    /// The photo, and its pixels that count.
    pub photo: Photo,
    pub counts: Option<Vec<bool>>,
    /// The camera as it was refined.
    pub camera: Camera,
    /// The photo's correction of colors `[A | b]`, row by row.
    pub exposure: [f32; 12],
}

/// Sums over the pixels of all photos, `[N]`, squared and over the channels.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evidence {
    /// Rise of the error without the Gaussian alone; below 0 where the photos are met better without it.
    pub rise: Vec<f64>,
    /// The largest rise in a single photo.
    pub most: Vec<f64>,
    /// Number of photos that show it.
    pub photos: Vec<u32>,
    /// Error of all photos.
    pub error: f64,
}

/// Judges Gaussians by photos.
///
/// A pixel shows `C = sum_i w_i c_i` over the background, `e = A C + b - t` beside the photo. Without Gaussian i it
/// changes by `d = -A w_i (c_i - B_i)`, with `B_i` the color of everything behind, and its squared error rises by
/// `d (2 e + d)`.
pub(crate) fn evidence(
    scene: &ActivatedGaussians,
    witnesses: &[Witness],
    background: [f32; 3],
    raster: &RasterSettings,
) -> Result<Evidence, RasterError> {
    let count = scene.opacities.len();
    let mut all = Evidence { rise: vec![0.0; count], most: vec![0.0; count], photos: vec![0; count], error: 0.0 };
    for batch in witnesses.chunks(BATCH) {
        let mut found: Vec<Result<OfPhoto, RasterError>> = batch.iter().map(|_| Ok(OfPhoto::default())).collect();
        parallel::for_chunks(&mut found, 1, |i, found| found[0] = of_photo(scene, &batch[i], background, raster));
        for of in found {
            let OfPhoto { rises, error } = of?;
            all.error += error;
            for (gaussian, rise) in rises {
                let gaussian = gaussian as usize;
                all.rise[gaussian] += rise;
                all.most[gaussian] = all.most[gaussian].max(rise);
                all.photos[gaussian] += 1;
            }
        }
    }
    Ok(all)
}

/// The Gaussians that a photo shows with their rises, and the photo's error.
#[derive(Debug, Default)]
struct OfPhoto {
    rises: Vec<(u32, f64)>,
    error: f64,
}

fn of_photo(
    scene: &ActivatedGaussians,
    witness: &Witness,
    background: [f32; 3],
    raster: &RasterSettings,
) -> Result<OfPhoto, RasterError> {
    let Witness { photo, counts, camera, exposure } = witness;
    let pixels = camera.width * camera.height;
    let (mut image, mut alpha) = (vec![0.0; 3 * pixels], vec![0.0; pixels]);
    let (rows, mut workspace) = (CameraRows::new(&[*camera]), Workspace::new());
    let images = Images { image: &mut image, alpha: &mut alpha, depth: None, features: None };
    rasterize(&scene.as_slices(), &rows.as_slices(&background), raster, &mut workspace, images)?;
    let weights = BlendWeights::of(&workspace)?;
    let colors = scene.colors_from(camera.pose.center());
    let linear = |v: [f32; 3]| [0, 1, 2].map(|c| (0..3).map(|k| exposure[4 * c + k] * v[k]).sum::<f32>());
    let (mut rises, mut shown) = (vec![0.0_f64; colors.len()], vec![0.0_f32; colors.len()]);
    let (mut hits, mut error) = (Vec::new(), 0.0);
    for pixel in (0..pixels).filter(|pixel| counts.as_ref().is_none_or(|counts| counts[*pixel])) {
        let drawn = linear([0, 1, 2].map(|c| image[3 * pixel + c]));
        let off = [0, 1, 2].map(|c| drawn[c] + exposure[4 * c + 3] - f32::from(photo.rgb[3 * pixel + c]) / 255.0);
        error += off.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
        hits.clear();
        let mut transmittance = 1.0_f32;
        for (gaussian, weight) in weights.of_pixel(pixel) {
            hits.push((gaussian, weight, transmittance));
            transmittance -= weight;
        }
        // From the back: the light from behind, as it would arrive without the Gaussians before it.
        let mut behind = background;
        for &(gaussian, weight, transmittance) in hits.iter().rev() {
            let own = colors[gaussian].map(|x| x as f32);
            let change = linear([0, 1, 2].map(|c| weight * (behind[c] - own[c])));
            rises[gaussian] += (0..3).map(|c| f64::from(change[c] * (2.0 * off[c] + change[c]))).sum::<f64>();
            shown[gaussian] += weight;
            let alpha = if transmittance > 0.0 { weight / transmittance } else { 0.0 };
            behind = [0, 1, 2].map(|c| behind[c] + alpha * (own[c] - behind[c]));
        }
    }
    let shown = shown.iter().enumerate().filter(|(_, shown)| **shown > SHOWN).map(|(gaussian, _)| gaussian);
    Ok(OfPhoto { rises: shown.map(|gaussian| (gaussian as u32, rises[gaussian])).collect(), error })
}
