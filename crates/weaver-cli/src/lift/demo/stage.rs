//! A built-in scene as Gaussians on its surfaces, with everything known about it.

use weaver_data::Scene;
use weaver_data::procedural::{ProceduralOptions, scene};
use weaver_geometry::Camera;
use weaver_geometry::glam::DVec2;
use weaver_kernels::random::Stream;
use weaver_lift::Maps;
use weaver_scene::ActivatedGaussians;

/// How large the scene is.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    pub photos: ProceduralOptions,
    /// Every so many pixels of every second view there is a splat.
    pub step: usize,
}

impl Size {
    /// Nine photos to lift from, three to judge by, some 12,000 splats.
    pub const DEMO: Self = Self { photos: ProceduralOptions { width: 192, height: 144, views: 12 }, step: 3 };
}

/// Cameras, and what their pixels show.
pub struct Views {
    pub cameras: Vec<Camera>,
    /// The thing at each pixel, 0 for the sky.
    pub ids: Vec<Vec<u32>>,
}

pub struct Stage {
    pub splats: ActivatedGaussians,
    /// The thing that each splat lies on.
    pub labels: Vec<u32>,
    /// Things, and the sky.
    pub classes: usize,
    pub training: Views,
    pub held_out: Views,
}

impl Stage {
    pub fn of_seed(seed: u64, Size { photos, step }: Size) -> Self {
        let scene = scene(seed, &photos);
        let stream = Stream::new(seed, 0, "lift.demo");
        let (mut splats, mut labels) = (ActivatedGaussians::default(), Vec::new());
        for view in scene.training_views().into_iter().step_by(2).map(|v| &scene.views[v]) {
            let (depth, ids) =
                (view.depth.as_deref().unwrap_or_default(), view.instances.as_deref().unwrap_or_default());
            let camera = &view.camera;
            for y in (step / 2..camera.height).step_by(step) {
                for x in (step / 2..camera.width).step_by(step) {
                    let at = y * camera.width + x;
                    let z = f64::from(depth[at]);
                    if z == 0.0 {
                        continue;
                    }
                    let point = camera.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), z);
                    let logit = 2.0 + stream.normal::<f32>(labels.len() as u64);
                    splats.means.extend(point.as_vec3().to_array());
                    splats.scales.extend([(0.5 * step as f64 * z / camera.intrinsics.fx) as f32; 3]);
                    splats.quats.extend([1.0, 0.0, 0.0, 0.0]);
                    splats.opacities.push(1.0 / (1.0 + (-logit).exp()));
                    splats.sh.extend([0.0; 3]);
                    labels.push(u32::from(ids[at]));
                }
            }
        }
        let [training, held_out] = [scene.training_views(), scene.held_out_views()].map(|which| views(&scene, &which));
        let most = training.ids.iter().chain(&held_out.ids).flatten().max().copied().unwrap_or(0);
        Self { splats, labels, classes: most as usize + 1, training, held_out }
    }

    /// One channel per thing, 1 where a pixel shows it.
    pub fn one_hot(&self) -> Maps<f32> {
        let views = self.training.ids.iter().map(|ids| one_hot(ids, self.classes)).collect();
        Maps { views, channels: self.classes }
    }
}

fn views(scene: &Scene, which: &[usize]) -> Views {
    let ids = |v: &usize| scene.views[*v].instances.iter().flatten().map(|id| u32::from(*id)).collect();
    Views { cameras: which.iter().map(|v| scene.views[*v].camera).collect(), ids: which.iter().map(ids).collect() }
}

/// `[N, classes]`
pub fn one_hot(labels: &[u32], classes: usize) -> Vec<f32> {
    let mut rows = vec![0.0; labels.len() * classes];
    labels.iter().enumerate().for_each(|(i, label)| rows[i * classes + *label as usize] = 1.0);
    rows
}
