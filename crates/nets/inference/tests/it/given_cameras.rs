//! Cameras that come with points: units, messages about them, and the cameras that are passed on.

use std::sync::mpsc::{Sender, channel};
use weaver_autograd::Params;
use weaver_data::SparsePoints;
use weaver_geometry::Camera;
use weaver_inference::{
    CameraSource, Density, Effort, Error, Photos, Prediction, Predictor, Refined, SplatWeaverPredictor, planar,
};
use weaver_kernels::random::Stream;
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_router::AllocationKind;
use weaver_splat::Renderer;

const VIEWS: usize = 3;

/// A network that was never trained, photos for it, and their cameras and points in units of `unit` training units.
fn untrained(unit: f64) -> (SplatWeaverPredictor, Vec<f32>, Vec<Camera>, SparsePoints) {
    let config = ModelConfig::preset("micro").unwrap();
    let [height, width] = [config.height, config.width];
    let mut params = Params::new();
    let model = SplatWeaver::new(config, &mut params, 1);
    let predictor = SplatWeaverPredictor::new(model, params, AllocationKind::Dithered, 0.5);
    let scene = scene(3, &ProceduralOptions { width, height, views: VIEWS });
    let planes = planar(scene.views.iter().map(|view| &view.image));
    let views: Vec<usize> = (0..VIEWS).collect();
    let distance = scene.points_seen(&views, 1.0).mean_distance(weaver_geometry::glam::DVec3::ZERO).unwrap();
    let scale = 1.0 / distance / unit;
    let first = scene.views[0].camera.pose;
    let camera = |v: &usize| {
        let camera = scene.views[*v].camera;
        Camera { pose: camera.pose.relative_to(&first).scaled(scale), ..camera }
    };
    (predictor, planes, views.iter().map(camera).collect(), scene.points_seen(&views, scale))
}

fn predict(predictor: &mut dyn Predictor, planes: &[f32], source: CameraSource<'_>) -> Result<Prediction, Error> {
    let [height, width] = predictor.image_size();
    predictor.predict(
        Photos { planes, inside: None, height, width },
        source,
        Density::default(),
        Stream::new(0, 0, "test"),
    )
}

/// Promise of `infer_and_eval_make_the_same_of_the_same_photos`.
#[test]
fn units_of_cameras_and_points_do_not_matter() {
    let of = |unit: f64| {
        let (mut predictor, planes, cameras, points) = untrained(unit);
        let source = CameraSource::GivenWithPoints { cameras: &cameras, points: &points };
        (predict(&mut predictor, &planes, source).unwrap(), points)
    };
    let ((one, points), (other, _)) = (of(1.0), of(0.02));
    assert!((one.scaled_by.unwrap() - 1.0).abs() < 1e-9 && (other.scaled_by.unwrap() - 0.02).abs() < 1e-9);
    for (a, b) in one.gaussians.means.iter().zip(&other.gaussians.means) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
    for (used, visible) in one.points_used.iter().zip(&points.visible) {
        assert!(*used > 12 && *used <= visible.len(), "{used} of {}", visible.len());
    }
}

#[test]
fn depth_comes_nearer_to_the_points() {
    let (mut predictor, planes, cameras, points) = untrained(1.0);
    let plain = predict(&mut predictor, &planes, CameraSource::Given(&cameras)).unwrap();
    let source = CameraSource::GivenWithPoints { cameras: &cameras, points: &points };
    let brought = predict(&mut predictor, &planes, source).unwrap();
    assert!(plain.points_used.is_empty());
    let off = |prediction: &Prediction| {
        let mut errors = Vec::new();
        for (v, (camera, visible)) in cameras.iter().zip(&points.visible).enumerate() {
            for point in visible {
                let local = camera.pose.apply(points.positions[*point as usize]);
                let at = camera.intrinsics.project(local);
                let cell = (v * camera.height + at.y as usize) * camera.width + at.x as usize;
                errors.push((f64::from(prediction.depth[cell]) / local.z).ln().abs());
            }
        }
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    assert!(off(&brought) < 0.7 * off(&plain), "{} {}", off(&brought), off(&plain));
}

#[test]
fn points_that_no_photo_sees_are_no_points() {
    let (mut predictor, planes, cameras, mut points) = untrained(0.3);
    points.visible = vec![Vec::new(); VIEWS];
    let plain = predict(&mut predictor, &planes, CameraSource::GivenUnscaled(&cameras)).unwrap();
    let source = CameraSource::GivenWithPoints { cameras: &cameras, points: &points };
    let found = predict(&mut predictor, &planes, source).unwrap();
    assert_eq!(plain.scaled_by, found.scaled_by);
    assert_eq!(plain.gaussians, found.gaussians);
    assert_eq!(found.points_used, [0; VIEWS]);
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let (mut predictor, planes, cameras, points) = untrained(1.0);
    let mut refused = |cameras: &[Camera], points: &SparsePoints, said: &str| {
        let message = predict(&mut predictor, &planes, CameraSource::GivenWithPoints { cameras, points }).unwrap_err();
        assert!(message.to_string().contains(said), "{message}");
    };
    refused(&cameras[1..], &points, "given cameras: expected 3, as many as photos, found 2");
    let fewer = SparsePoints { visible: points.visible[1..].to_vec(), ..points.clone() };
    refused(&cameras, &fewer, "lists of visible points: expected 3");
    let mut unknown = points.clone();
    unknown.visible[1].push(1_000_000);
    refused(&cameras, &unknown, "found 1000000");
}

/// A predictor without Gaussians that reports its given cameras.
#[derive(Debug)]
struct Listener {
    heard: Sender<(Vec<Camera>, SparsePoints)>,
    renderer: Renderer,
}

impl Predictor for Listener {
    fn predict(&mut self, _: Photos<'_>, source: CameraSource<'_>, _: Density, _: Stream) -> Result<Prediction, Error> {
        let CameraSource::GivenWithPoints { cameras, points } = source else { panic!("{source:?}") };
        self.heard.send((cameras.to_vec(), points.clone())).unwrap();
        Ok(Prediction { scaled_by: Some(2.0), points_used: vec![1; cameras.len()], ..Prediction::default() })
    }

    fn image_size(&self) -> [usize; 2] {
        [6, 8]
    }

    fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }
}

#[test]
fn refinement_passes_points_on() {
    let (_, _, cameras, points) = untrained(1.0);
    let large: Vec<Camera> = cameras.iter().map(|camera| Camera { width: 16, height: 12, ..*camera }).collect();
    let (heard, listened) = channel();
    let listener = Listener { heard, renderer: Renderer::default() };
    let mut refined = Refined::new(Box::new(listener), [12, 16], Effort::Steps(1));
    let planes = vec![0.5; VIEWS * 3 * 12 * 16];
    let source = CameraSource::GivenWithPoints { cameras: &large, points: &points };
    let prediction = predict(&mut refined, &planes, source).unwrap();
    assert_eq!((prediction.scaled_by, prediction.points_used), (Some(2.0), vec![1; VIEWS]));
    let (small, passed_on) = listened.recv().unwrap();
    assert_eq!(passed_on, points);
    assert!(small.iter().zip(&large).all(|(small, large)| {
        small.width == 8 && small.intrinsics.fx == large.intrinsics.fx / 2.0 && small.pose == large.pose
    }));
}
