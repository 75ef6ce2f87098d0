//! A scene to measure the rasterizer with: read from a file, or synthetic.

use crate::arguments::Synthetic;
use std::path::Path;
use weaver_command::Failure;
use weaver_geometry::sh::MAX_DEGREE;
use weaver_io::safetensors::Mapped;
use weaver_kernels::parallel;
use weaver_kernels::random::Stream;
use weaver_scene::{ActivatedGaussians, CameraRows, CameraSlices, Color, GaussianSlices};

/// Largest width and height.
const LARGEST: usize = 1 << 20;
/// Tolerance for the constant entries of a camera's matrices, which may be rounded.
const ROUNDING: f32 = 1e-5;

/// One view of Gaussians, and the incoming gradients of its images.
#[derive(Debug)]
pub struct Workload {
    /// The file's name, or a description of the synthetic scene.
    pub name: String,
    pub antialiased: bool,
    /// The Gaussians, without coefficients if colors are plain.
    pub gaussians: ActivatedGaussians,
    /// Colors `[N, 3]` in place of spherical harmonics.
    pub plain: Option<Vec<f32>>,
    /// One camera.
    pub camera: CameraRows,
    /// `[3]`
    pub background: Vec<f32>,
    /// `None` without the backward pass.
    pub cotangents: Option<Cotangents>,
}

/// Incoming gradients of the images.
#[derive(Debug)]
pub struct Cotangents {
    /// `[H, W, 3]`
    pub image: Vec<f32>,
    /// `[H, W]`
    pub alpha: Vec<f32>,
    /// `[H, W]`
    pub depth: Option<Vec<f32>>,
}

impl Workload {
    /// Reads a file; the cotangents, by far the largest part of some, only with `backward`.
    pub fn read(path: &Path, backward: bool) -> Result<Self, Failure> {
        let file = Mapped::open(path)?;
        let (width, height) = (pixels(&file, "width")?, pixels(&file, "height")?);
        let antialiased = match file.metadata().get("mode").map(String::as_str) {
            None | Some("classic") => false,
            Some("antialiased") => true,
            Some(other) => {
                return Err(file.invalid("metadata mode", "classic or antialiased", format!("`{other}`")).into());
            }
        };
        let n = match *file.array("means")?.shape() {
            [n, 3] => n,
            ref found => return Err(file.invalid("tensor means", "[N, 3]", format!("{found:?}")).into()),
        };
        let (key, degree) = colors(&file, n)?;
        let terms = degree.map(|degree| (degree + 1) * (degree + 1));
        let color_shape: &[usize] = match terms {
            Some(terms) => &[n, terms, 3],
            None => &[n, 3],
        };
        // All shapes before the first number: reading much takes time.
        let mut expected = vec![
            ("quats", vec![n, 4]),
            ("scales", vec![n, 3]),
            ("opacities", vec![n]),
            (key, color_shape.to_vec()),
            ("viewmat", vec![4, 4]),
            ("K", vec![3, 3]),
            ("background", vec![3]),
            ("v_image", vec![height, width, 3]),
            ("v_alpha", vec![height, width]),
        ];
        let depth = file.get("v_depth").is_some();
        if depth {
            expected.push(("v_depth", vec![height, width]));
        }
        for (key, shape) in &expected {
            if file.array(key)?.shape() != shape {
                let found = format!("{:?}", file.array(key)?.shape());
                return Err(file.invalid(format!("tensor {key}"), format!("{shape:?}"), found).into());
            }
        }
        let cotangents = match backward {
            true => Some(Cotangents {
                image: file.array("v_image")?.f32s()?,
                alpha: file.array("v_alpha")?.f32s()?,
                depth: if depth { Some(file.array("v_depth")?.f32s()?) } else { None },
            }),
            false => None,
        };
        let colors = file.array(key)?.f32s()?;
        let (sh, plain) = if degree.is_some() { (colors, None) } else { (Vec::new(), Some(colors)) };
        let gaussians = ActivatedGaussians {
            means: file.array("means")?.f32s()?,
            quats: file.array("quats")?.f32s()?,
            scales: file.array("scales")?.f32s()?,
            opacities: file.array("opacities")?.f32s()?,
            sh,
            degree: degree.unwrap_or(0),
        };
        let (viewmats, intrinsics) = (viewmat(&file)?, intrinsics(&file)?.to_vec());
        Ok(Self {
            name: path.display().to_string(),
            antialiased,
            gaussians,
            plain,
            camera: CameraRows { viewmats, intrinsics, width, height },
            background: file.array("background")?.f32s()?,
            cotangents,
        })
    }

    /// A view full of Gaussians: depths uniform from 1.5 to 8, positions over 1.1 times the view, log-normal scales
    /// around 0.005 sqrt(10^6 / N), opacities sigmoid of normal numbers, spherical harmonics of degree 3 whose bands
    /// halve. The scene is determined by the three numbers.
    pub fn synthetic(scene: Synthetic, backward: bool) -> Self {
        const SEED: u64 = 3;
        const DEGREE: usize = 3;
        let Synthetic { gaussians: n, width, height } = scene;
        let stream = |purpose| Stream::new(SEED, 0, purpose);
        let normal = |purpose, len, of: fn(f64) -> f64| {
            let stream = stream(purpose);
            filled(len, move |i| of(stream.normal(i as u64)))
        };
        let focal = 0.78 * width as f64;
        let median = 0.005 * (1e6 / n.max(1) as f64).sqrt();
        // World to camera: a turn of 0.3 about y, then a shift.
        let (sin, cos) = 0.3_f64.sin_cos();
        let axes = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]];
        let shift = [0.1, -0.2, 0.5];
        let place = stream("bench.means");
        let means = filled(3 * n, |i| {
            let draw = |axis| place.uniform::<f64>((i / 3 * 3 + axis) as u64);
            let z = 1.5 + 6.5 * draw(2);
            let side = |axis: usize, pixels: usize| (1.1 * draw(axis) - 0.55) * pixels as f64 / focal * z;
            let seen = [side(0, width), side(1, height), z];
            (0..3).map(|row| (seen[row] - shift[row]) * axes[row][i % 3]).sum()
        });
        let scale = stream("bench.scales");
        let harmonics = stream("bench.sh");
        let terms = (DEGREE + 1) * (DEGREE + 1);
        let cotangents = backward.then(|| Cotangents {
            image: normal("bench.v_image", 3 * width * height, |x| x),
            alpha: normal("bench.v_alpha", width * height, |x| x),
            depth: None,
        });
        let rows = axes.into_iter().zip(shift).flat_map(|([x, y, z], t)| [x, y, z, t]);
        let camera = CameraRows {
            viewmats: rows.map(|x| x as f32).collect(),
            intrinsics: [focal, focal, width as f64 / 2.0, height as f64 / 2.0].map(|x| x as f32).to_vec(),
            width,
            height,
        };
        let gaussians = ActivatedGaussians {
            means,
            quats: normal("bench.quats", 4 * n, |x| x),
            scales: filled(3 * n, |i| (median.ln() + 0.6 * scale.normal::<f64>(i as u64)).exp()),
            opacities: normal("bench.opacities", n, |x| 1.0 / (1.0 + (-1.5 * x).exp())),
            sh: filled(3 * terms * n, |i| {
                let band = (i / 3 % terms).isqrt();
                0.5 * harmonics.normal::<f64>(i as u64) / (1 << band) as f64
            }),
            degree: DEGREE,
        };
        let name = format!("synthetic {n},{width},{height}");
        Self { name, antialiased: false, gaussians, plain: None, camera, background: vec![0.0; 3], cotangents }
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.gaussians.len()
    }

    /// Degree of the spherical harmonics; `None` for plain colors.
    pub fn degree(&self) -> Option<usize> {
        self.plain.is_none().then_some(self.gaussians.degree)
    }

    /// The values of colors, plain or harmonics, in the file's shape.
    pub fn colors(&self) -> &[f32] {
        self.plain.as_deref().unwrap_or(&self.gaussians.sh)
    }

    /// The Gaussians as the rasterizer's input.
    pub fn gaussians(&self) -> GaussianSlices<'_, f32> {
        let gaussians = self.gaussians.as_slices();
        match &self.plain {
            Some(colors) => GaussianSlices { color: Color::Plain(colors), ..gaussians },
            None => gaussians,
        }
    }

    /// The camera as the rasterizer's input.
    pub fn camera(&self) -> CameraSlices<'_, f32> {
        self.camera.as_slices(&self.background)
    }
}

/// A number of pixels among the header's strings.
fn pixels(file: &Mapped, key: &str) -> Result<usize, Failure> {
    let found = file.metadata().get(key);
    let number = found.and_then(|text| text.parse().ok()).filter(|n| (1..=LARGEST).contains(n));
    number.ok_or_else(|| {
        let found = found.map_or("none".into(), |text| format!("`{text}`"));
        file.invalid(format!("metadata {key}"), format!("a number of pixels, 1 to {LARGEST}"), found).into()
    })
}

/// Name of the color tensor, and the degree if it holds spherical harmonics.
fn colors(file: &Mapped, n: usize) -> Result<(&'static str, Option<usize>), Failure> {
    match (file.get("colors").is_some(), file.get("sh").is_some()) {
        (true, false) => Ok(("colors", None)),
        (false, true) => {
            let shape = file.array("sh")?.shape();
            let degree = match *shape {
                [_, terms, 3] => (0..=MAX_DEGREE).find(|degree| (degree + 1) * (degree + 1) == terms),
                _ => None,
            };
            let expected = || format!("[{n}, K, 3] with K of 1, 4, 9, 16 or 25");
            match degree {
                Some(degree) => Ok(("sh", Some(degree))),
                None => Err(file.invalid("tensor sh", expected(), format!("{shape:?}")).into()),
            }
        }
        (both, _) => {
            let found = if both { "both" } else { "neither" };
            Err(file.invalid("tensors", "either colors or sh", found).into())
        }
    }
}

/// The rows of the matrix that are not constant, `[3, 4]`.
fn viewmat(file: &Mapped) -> Result<Vec<f32>, Failure> {
    let mut values = file.array("viewmat")?.f32s()?;
    let last = &values[12..];
    if !near(last, &[0.0, 0.0, 0.0, 1.0]) {
        return Err(file.invalid("tensor viewmat", "0 0 0 1 as the last row", format!("{last:?}")).into());
    }
    values.truncate(12);
    Ok(values)
}

fn intrinsics(file: &Mapped) -> Result<[f32; 4], Failure> {
    let values = file.array("K")?.f32s()?;
    let [fx, skew, cx, zero, fy, cy, ref last @ ..] = values[..] else { unreachable!("3 x 3, as was checked") };
    if !near(&[skew, zero], &[0.0; 2]) || !near(last, &[0.0, 0.0, 1.0]) {
        let expected = "[fx, 0, cx, 0, fy, cy, 0, 0, 1]";
        return Err(file.invalid("tensor K", expected, format!("{values:?}")).into());
    }
    Ok([fx, fy, cx, cy])
}

fn near(values: &[f32], expected: &[f32]) -> bool {
    values.iter().zip(expected).all(|(a, b)| (a - b).abs() <= ROUNDING)
}

/// Numbers by their index, made in parallel.
fn filled(len: usize, of: impl Fn(usize) -> f64 + Sync) -> Vec<f32> {
    const GRAIN: usize = 1 << 12;
    let mut values = vec![0.0; len];
    parallel::for_chunks(&mut values, GRAIN, |chunk, values| {
        for (i, value) in values.iter_mut().enumerate() {
            *value = of(chunk * GRAIN + i) as f32;
        }
    });
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn made_up_gaussians_are_in_view() {
        let scene = Synthetic { gaussians: 2000, width: 64, height: 48 };
        let workload = Workload::synthetic(scene, true);
        let m = &workload.camera.viewmats;
        let seen = |p: &[f32], row: usize| (0..3).map(|i| m[4 * row + i] * p[i]).sum::<f32>() + m[4 * row + 3];
        let mut farthest = [0.0_f32; 2];
        for mean in workload.gaussians.means.chunks(3) {
            let z = seen(mean, 2);
            assert!((1.49..8.01).contains(&z), "{z}");
            for (axis, pixels) in [64.0, 48.0].into_iter().enumerate() {
                let place = seen(mean, axis) / z * workload.camera.intrinsics[axis] / pixels;
                farthest[axis] = farthest[axis].max(place.abs());
            }
        }
        assert!(farthest.iter().all(|x| (0.54..0.551).contains(x)), "{farthest:?}");
        let mean_log = workload.gaussians.scales.iter().map(|s| f64::from(s.ln())).sum::<f64>() / 6000.0;
        assert!((mean_log - (0.005 * 500.0_f64.sqrt()).ln()).abs() < 0.03, "{mean_log}");
        let band = |k: usize| workload.colors().chunks(3).skip(k).step_by(16).flatten().map(|x| x * x).sum::<f32>();
        assert!((3.6..4.4).contains(&(band(0) / band(1))) && (3.6..4.4).contains(&(band(3) / band(4))));
        assert_eq!(workload.cotangents.unwrap().image.len(), 3 * 64 * 48);
    }

    #[test]
    fn no_gaussians_are_a_scene_too() {
        let scene = Synthetic { gaussians: 0, width: 1, height: 1 };
        let workload = Workload::synthetic(scene, false);
        assert!(workload.len() == 0 && workload.cotangents.is_none());
    }
}
