//! Pictures of lifted features of one scene.

use super::figures::drawn_labels;
use super::noise::Noise;
use super::stage::Stage;
use crate::command::lift::pca::PcaColors;
use crate::{LiftOptions, Raster, Solver, lift};
use weaver_command::Failure;
use weaver_geometry::Camera;
use weaver_io::{Image, OutputFolder, label_color};

/// Names of the written files.
pub const NAMES: [&str; 7] = [
    "ids.png",
    "labels-row-sum.png",
    "labels-exact-5.png",
    "pca-lifted.png",
    "pca-aggregated.png",
    "masks.png",
    "masks-kept.png",
];

/// Writes the pictures of a held-out view, and of one with a wrong mask.
pub fn write(stage: &Stage, noise: &Noise, out: &OutputFolder) -> Result<(), Failure> {
    let save = |name: &str, image: &Image| image.write_png(out.file(format!("{name}.png"))?);
    let settings = stage.settings;
    let mut training = Raster::new(stage.splats.as_slices(), &stage.training.cameras, settings);
    let mut held_out = Raster::new(stage.splats.as_slices(), &stage.held_out.cameras, settings);
    let labels = |camera: &Camera, ids: &[u32]| label_color(ids, camera.width, camera.height);
    let camera = &stage.held_out.cameras[0];
    save("ids", &labels(camera, &stage.held_out.ids[0]))?;
    for (name, solver) in [("row-sum", Solver::RowSum), ("exact-5", Solver::exact(5))] {
        let lifted = lift(&mut training, &mut stage.one_hot(), &LiftOptions::with(solver), &mut || ())?;
        let drawn = drawn_labels(&mut held_out, &lifted.features, 0, stage.classes)?;
        save(&format!("labels-{name}"), &labels(camera, &drawn))?;
    }
    let channels = noise.features.len() / stage.labels.len();
    let Some(cleaned) = noise.cleaned.last() else { return Ok(()) };
    for (name, features) in [("lifted", &noise.features), ("aggregated", &cleaned.features)] {
        let colors = PcaColors::of(features, channels, &vec![1.0; stage.labels.len()]);
        save(&format!("pca-{name}"), &colors.draw(&mut held_out, 0, camera)?)?;
    }
    // The masks of a view with a wrong one, and the kept ones among them.
    let view = noise.masks.iter().zip(&noise.wrong).find(|(_, wrong)| **wrong).map_or(0, |(mask, _)| mask.view);
    let camera = &stage.training.cameras[view];
    let of_masks = |counts: &dyn Fn(usize) -> bool| {
        let mut ids = vec![0; camera.width * camera.height];
        let masks = noise.masks.iter().enumerate().filter(|(_, mask)| mask.view == view);
        for (number, (i, mask)) in (1..).zip(masks) {
            mask.pixels.iter().filter(|_| counts(i)).for_each(|pixel| ids[*pixel as usize] = number);
        }
        labels(camera, &ids)
    };
    save("masks", &of_masks(&|_| true))?;
    save("masks-kept", &of_masks(&|i| cleaned.kept[i]))?;
    Ok(())
}
