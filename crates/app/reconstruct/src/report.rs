//! report.html of a run.

mod cameras;

use crate::fitting::{Fitting, HELD_OUT};
use crate::judged::Judged;
use crate::outcome::{Outcome, Views};
use crate::{Error, maps};
use weaver_data::CamerasSummary;
use weaver_fit::{Photo, Quality};
use weaver_geometry::lens::LensCamera;
use weaver_io::Image;
use weaver_run::Page;
use weaver_splat::Workspace;

/// Fewer photos than this leave much of a scene unseen.
const FEW: usize = 4;
/// Longest side of pictures of transients, pixels.
const TINTED: usize = 400;
/// Views with pictures.
const PICTURES: usize = 6;

/// Readable names of curves, by their names in the log.
pub const CURVES: [(&str, &str); 4] = [
    (HELD_OUT, "PSNR of held-out photos, dB"),
    ("psnr", "PSNR of the photos looked at, dB"),
    ("gaussians", "Gaussians"),
    ("pairs", "million pairs of Gaussian and pixel"),
];

/// Numbers of the views with pictures, among `views`.
pub fn pictured(views: usize) -> impl Iterator<Item = usize> {
    let chosen = views.min(PICTURES);
    (0..chosen).map(move |i| i * views / chosen)
}

/// The page, but for its curves; `look` is the page to look at the scene.
pub fn page(
    run: &Fitting,
    outcome: &Outcome,
    look: Option<&str>,
    (train, test): (&[Judged], &[Judged]),
) -> Result<Page, Error> {
    let mut page = Page::new("SplatWeaver fit");
    let cameras = CamerasSummary::of_capture(&run.settings.capture);
    if let Some(cameras) = &cameras {
        cameras::warning(cameras, &mut page);
    }
    if !outcome.outliers.is_empty() {
        page.warning(&format!(
            "These photos are met far worse than the others; they may show something else, or their cameras may be wrong: {}.",
            outcome.outliers.join(", ")
        ));
    }
    if !outcome.missing.is_empty() {
        page.warning(&format!("Not all results could be made: {}.", outcome.missing.join("; ")));
    }
    if run.fit().photos() < FEW {
        page.warning(&format!(
            "The scene was fitted to {} photos only: from elsewhere it may look different from what is there.",
            run.fit().photos()
        ));
    }
    page.heading(1, &format!("Fit of {}", run.settings.capture.display()));
    let [width, height] = outcome.size;
    page.paragraph(&format!(
        "{} Gaussians (budget {}), {} steps of {} planned, {:.1} s, photos of {width}x{height}, seed {}.",
        outcome.gaussians,
        run.settings.fit.gaussians,
        outcome.steps,
        outcome.planned,
        outcome.seconds,
        run.settings.fit.seed
    ));
    let row = |name: &str, views: &Views| {
        let [psnr, aligned, ssim, lpips] = numbers(&views.quality);
        [name.to_string(), views.views.to_string(), psnr, aligned, ssim, lpips]
    };
    if let Some(look) = look {
        page.embed("Look at the scene", crate::view::FILE, look);
    }
    let rows: Vec<_> = [outcome.test.as_ref().map(|t| row("held out", t)), Some(row("fitted", &outcome.train))]
        .into_iter()
        .flatten()
        .collect();
    page.table(&["photos", "number", "PSNR, dB", "colors aligned", "SSIM", "LPIPS"], &rows);
    if run.capture.colors.differ() {
        let corrected = if outcome.exposures.is_empty() {
            "Nothing is corrected."
        } else {
            "Each is compared in a light of its own; held-out ones in that of the nearest fitted ones."
        };
        let percent = 100.0 * run.capture.colors.spread();
        page.paragraph(&format!(
            "Photos differ in exposure or white balance, by {percent:.0} % in the median. {corrected}"
        ));
    }
    coverage(outcome, &mut page);
    transients(run, outcome, &mut page);
    if let Some(cleaning) = &outcome.cleaning {
        page.paragraph(&format!("{cleaning}."));
    }
    if outcome.poses.refined {
        let p = &outcome.poses;
        page.paragraph(&format!(
            "Cameras were refined: photos agree about {} points, which are off by {:.2} pixels; cameras turned by {:.3} degrees and moved by {:.3} % of the scene's size (medians); focal lengths are {:.4} of those given.",
            p.points, p.pixels.unwrap_or(f64::NAN), p.degrees, 100.0 * p.distance, p.focal
        ));
    }
    let (title, shown) = if test.is_empty() { ("Fitted photos", train) } else { ("Held-out photos", test) };
    page.heading(2, title);
    page.paragraph("Below each: error (brightest: a quarter of the range), Gaussians blended per pixel, Gaussians per cell of 8 x 8 pixels.");
    pictures(run, shown, test.is_empty(), &mut page)?;
    page.heading(2, "Every photo");
    let quality = |(kind, j): (&str, &Judged)| {
        let [psnr, aligned, ssim, lpips] = numbers(&j.quality);
        [j.name.clone(), kind.to_string(), psnr, aligned, ssim, lpips]
    };
    let all = test.iter().map(|j| ("held out", j)).chain(train.iter().map(|j| ("fitted", j)));
    page.table(&["photo", "", "PSNR, dB", "colors aligned", "SSIM", "LPIPS"], &all.map(quality).collect::<Vec<_>>());
    if let Some(cameras) = &cameras {
        cameras::section(cameras, &run.settings.capture, &mut page);
    }
    Ok(page)
}

/// Reports the part of photos that others agree about, and the photos that stand alone.
fn coverage(outcome: &Outcome, page: &mut Page) {
    if outcome.coverage.is_empty() {
        return;
    }
    page.paragraph(&format!(
        "Two other photos agree about the depth of {:.0} % of a photo in the mean. Elsewhere photos do not tell where things are.",
        100.0 * outcome.coverage.mean()
    ));
    let alone = outcome.coverage.alone();
    if !alone.is_empty() {
        page.warning(&format!(
            "What these photos show, hardly another one does, which leaves its depth open; photos from beside them would help: {}.",
            alone.join(", ")
        ));
    }
}

/// Parts of photos that no other shows, the most first.
fn transients(run: &Fitting, outcome: &Outcome, page: &mut Page) {
    let part = |photo: &usize| run.fit().transients(*photo).map_or(0.0, weaver_fit::Transients::part);
    let mut with: Vec<usize> = (0..run.fit().photos()).filter(|photo| part(photo) > 0.0).collect();
    if with.is_empty() {
        return;
    }
    with.sort_by(|a, b| part(b).total_cmp(&part(a)));
    page.paragraph(&format!(
        "Parts of {} photos show what no other photo does, such as passers-by or shadows that move. They were left out (red; masks are in transients): {}.",
        with.len(),
        outcome.transients.iter().map(|(name, part)| format!("{name} {:.1} %", 100.0 * part)).collect::<Vec<_>>().join(", ")
    ));
    let pictures: Vec<Image> = with.iter().take(PICTURES).map(|photo| tinted(run, *photo)).collect();
    page.picture("What was left out", &Image::mosaic(&pictures.iter().collect::<Vec<_>>()));
}

/// A photo with its transients in red.
fn tinted(run: &Fitting, photo: usize) -> Image {
    let Photo { camera, rgb, .. } = run.fit().photo(photo);
    let step = camera.width.max(camera.height).div_ceil(TINTED);
    let (width, height) = (camera.width.div_ceil(step), camera.height.div_ceil(step));
    let pixel = |at: usize| 3 * ((at / width) * step * camera.width + (at % width) * step);
    let bytes: Vec<u8> = (0..width * height).flat_map(|at| rgb[pixel(at)..][..3].iter().copied()).collect();
    let mut image = Image::from_bytes(width, height, &bytes);
    let hidden = run.fit().transients(photo).map(|it| it.at_size(width, height)).unwrap_or_default();
    for (pixel, _) in image.pixels.chunks_exact_mut(3).zip(&hidden).filter(|(_, hidden)| **hidden) {
        pixel[0] = 0.5 + 0.5 * pixel[0];
        pixel[1..].iter_mut().for_each(|c| *c *= 0.5);
    }
    image
}

fn pictures(run: &Fitting, shown: &[Judged], training: bool, page: &mut Page) -> Result<(), Error> {
    let gaussians = run.fit().gaussians().to_activated();
    let (settings, mut workspace) = (run.fit().raster_settings(), Workspace::new());
    for i in pictured(shown.len()) {
        let Judged { name, number, camera, image: Some(image), quality } = &shown[i] else { continue };
        let photo = if training { run.fit().photo(*number) } else { &run.capture.held_out[*number] };
        let (count, most) = maps::count(&gaussians, (camera, photo.model()), &settings, &mut workspace)?;
        let seen = LensCamera::new(*camera, photo.lens);
        let (density, densest) = maps::density(&gaussians, &seen, settings.near);
        let given = Image::from_bytes(camera.width, camera.height, &photo.rgb);
        let render = maps::picture(image, camera);
        page.comparison(&format!("{name}: {:.2} dB", quality.psnr), [("photo", &given), ("render", &render)])
            .map_err(weaver_view::ViewError::from)?;
        let row = [&maps::error(image, &photo.rgb, camera), &count, &density];
        page.picture(
            &format!("{name}: at most {most} Gaussians in a pixel, {densest} in a cell"),
            &Image::mosaic(&row),
        );
    }
    Ok(())
}

fn numbers(quality: &Quality) -> [String; 4] {
    let optional = |x: Option<f64>, digits| x.map_or("-".into(), |x| format!("{x:.digits$}"));
    let Quality { psnr, psnr_aligned, ssim, lpips } = *quality;
    [format!("{psnr:.2}"), optional(psnr_aligned, 2), optional(ssim, 4), optional(lpips, 4)]
}
