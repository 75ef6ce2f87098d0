//! Promises of the network for photos of any size.

mod comparison;
mod kept;
mod network;
mod predictor;
mod prior;

use weaver_data::Scene;
use weaver_geometry::Camera;
use weaver_inference::{Photos, planar};
use weaver_procedural::{ProceduralOptions, varied_scene};

/// A drawn scene as the network takes it.
struct Drawn {
    scene: Scene,
    planes: Vec<f32>,
    cameras: Vec<Camera>,
    depth: Vec<f32>,
    size: [usize; 2],
}

impl Drawn {
    fn new(seed: u64, [height, width]: [usize; 2], views: usize) -> Self {
        let scene = varied_scene(seed, &ProceduralOptions { width, height, views });
        Self {
            planes: planar(scene.views.iter().map(|view| &view.image)),
            cameras: relative(&scene),
            depth: scene.views.iter().flat_map(|view| view.depth.clone().unwrap()).collect(),
            scene,
            size: [height, width],
        }
    }

    fn photos(&self) -> Photos<'_> {
        Photos { planes: &self.planes, inside: None, height: self.size[0], width: self.size[1] }
    }

    fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }
}

/// The cameras of a scene in the frame of the first, as its points are.
fn relative(scene: &Scene) -> Vec<Camera> {
    let first = scene.views[0].camera.pose;
    scene.views.iter().map(|view| Camera { pose: view.camera.pose.relative_to(&first), ..view.camera }).collect()
}
