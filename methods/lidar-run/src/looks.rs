//! A run to look at while it goes on.

use crate::job::maps_of;
use crate::plan::read;
use crate::results::gaussians;
use crate::{LidarJob, LidarRunError};
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Camera, Intrinsics, trajectory};
use weaver_io::safetensors::Tensors;
use weaver_scene::forms::harmonic;
use weaver_scene::{ActivatedGaussians, Gaussians};
use weaver_view::{Look, Shot};
use weaver_view_run::ScenePage;

/// Points of the first scan that are shown, at most.
const POINTS: usize = 20_000;
/// Their size, meters.
const POINT: f32 = 0.05;
/// The first view: the place of its camera and what it looks at, meters from the first scan.
const VIEW: [DVec3; 2] = [DVec3::new(-14.0, 0.0, 9.0), DVec3::new(4.0, 0.0, 0.0)];

/// The points of the first scan, which are all that is known at the beginning, seen from behind and above.
pub(crate) fn beginning(job: &LidarJob, title: String) -> Result<ScenePage, LidarRunError> {
    let points = read(&job.files()[0])?.points;
    let shown: Vec<[f32; 3]> = points.iter().step_by(points.len().div_ceil(POINTS).max(1)).copied().collect();
    let n = shown.len();
    let look = Look { meters: Some(1.0), ..Look::default() };
    let scene = ActivatedGaussians {
        means: shown.concat(),
        quats: [1.0, 0.0, 0.0, 0.0].repeat(n),
        scales: vec![POINT; 3 * n],
        opacities: vec![0.9; n],
        sh: vec![harmonic(0.3); 3 * n],
        degree: 0,
    };
    Ok(ScenePage { shots: vec![overview()], ..ScenePage::new(title, scene.to_stored(), look) })
}

/// The view of a map to begin with: from behind and above where the first scan was taken, z upward.
pub fn overview() -> Shot {
    let [eye, target] = VIEW;
    let intrinsics = Intrinsics { fx: 560.0, fy: 560.0, cx: 320.0, cy: 240.0 };
    let camera = Camera { pose: trajectory::look_at(eye, target, DVec3::Z), intrinsics, width: 640, height: 480 };
    Shot::new("behind the first scan", camera)
}

/// All maps of a state as one scene.
pub(crate) fn scene_of(state: &Tensors) -> weaver_io::Result<Gaussians> {
    let maps: Vec<Gaussians> = maps_of(state)?.iter().map(gaussians).collect();
    Ok(Gaussians::joined(&maps))
}
