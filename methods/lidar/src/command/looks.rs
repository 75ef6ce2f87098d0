//! Live views of a run.

use crate::command::job::maps_of;
use crate::command::plan::read;
use crate::command::results::gaussians;
use crate::command::{LidarJob, LidarRunError};
use weaver_io::safetensors::Tensors;
use weaver_scene::forms::harmonic;
use weaver_scene::{ActivatedGaussians, Gaussians};
use weaver_view::Look;
use weaver_view_run::{ScenePage, overview};

/// Most points of the first scan in the view.
const POINTS: usize = 20_000;
/// Their size, meters.
const POINT: f32 = 0.05;
/// The points of the first scan, before there is a map, seen from behind and above.
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

/// All maps of a state as one scene.
pub(crate) fn scene_of(state: &Tensors) -> weaver_io::Result<Gaussians> {
    let maps: Vec<Gaussians> = maps_of(state)?.iter().map(gaussians).collect();
    Ok(Gaussians::joined(&maps))
}
