//! Lifts the photos of a built-in scene to gray balls on its surfaces, and prints each solver's quality on a held-out
//! photo.

use weaver_geometry::glam::DVec2;
use weaver_lift::{LiftOptions, Maps, Operator, Raster, Solver, Stop, lift};
use weaver_procedural::{ProceduralOptions, scene};
use weaver_scene::ActivatedGaussians;
use weaver_splat::RasterSettings;

/// Stride of the balls, pixels.
const STEP: usize = 3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let scene = scene(7, &ProceduralOptions { width: 128, height: 96, views: 12 });
    let mut splats = ActivatedGaussians::default();
    for view in scene.training_views().into_iter().step_by(3).map(|v| &scene.views[v]) {
        let depth = view.depth.as_deref().unwrap_or_default();
        for (x, y) in (0..96).step_by(STEP).flat_map(|y| (0..128).step_by(STEP).map(move |x| (x, y))) {
            let z = f64::from(depth[y * 128 + x]);
            if z > 0.0 {
                let point = view.camera.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5), z);
                splats.means.extend(point.as_vec3().to_array());
                splats.scales.extend([(0.5 * STEP as f64 * z / view.camera.intrinsics.fx) as f32; 3]);
                splats.quats.extend([1.0, 0.0, 0.0, 0.0]);
                splats.opacities.push(0.9);
                splats.sh.extend([0.0; 3]);
            }
        }
    }
    let of = |views: &[usize]| {
        let cameras: Vec<_> = views.iter().map(|&v| scene.views[v].camera).collect();
        let colors: Vec<_> = views.iter().map(|&v| scene.views[v].image.pixels.clone()).collect();
        (cameras, colors)
    };
    let ((cameras, colors), (held_out, truth)) = (of(&scene.training_views()), of(&scene.held_out_views()));
    let mut raster = Raster::new(splats.as_slices(), &cameras, RasterSettings::default());
    let mut judge = Raster::new(splats.as_slices(), &held_out, RasterSettings::default());
    let mut maps = Maps { views: colors, channels: 3 };
    println!("{} splats, {} photos", splats.len(), cameras.len());
    let damped = Solver::Damped { mu: 0.1, stop: Stop { passes: 10, ..Stop::default() } };
    let solvers = [("row sum", Solver::RowSum), ("squared", Solver::Squared), ("exact, 5", Solver::exact(5))];
    for (name, solver) in solvers.into_iter().chain([("exact, 30", Solver::exact(30)), ("damped, 0.1", damped)]) {
        let lifted = lift(&mut raster, &mut maps, &LiftOptions::with(solver), &mut || ())?;
        let (mut squares, mut count) = (0.0, 0);
        for (view, truth) in truth.iter().enumerate() {
            let (mut image, mut alpha) = (vec![0.0; truth.len()], vec![0.0; truth.len() / 3]);
            judge.forward(view, &lifted.features, 3, &mut image)?;
            judge.forward(view, &vec![1.0; splats.len()], 1, &mut alpha)?;
            for ((drawn, truth), alpha) in image.chunks_exact(3).zip(truth.chunks_exact(3)).zip(alpha) {
                if alpha >= 0.5 {
                    count += 3;
                    squares += drawn.iter().zip(truth).map(|(a, b)| f64::from(a - alpha * b).powi(2)).sum::<f64>();
                }
            }
        }
        let psnr = -10.0 * (squares / f64::from(count)).log10();
        println!("{name:<12} {psnr:.2} dB on {} photos held out", truth.len());
    }
    Ok(())
}
