//! Pictures of the page beside the rasterizer's.

use crate::browser::Browser;
use crate::pages::Written;
use crate::scenes::{camera, cloud, shared};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::json;
use weaver_geometry::Camera;
use weaver_io::Image;
use weaver_scene::Gaussians;
use weaver_splat::{RasterSettings, Workspace, render};
use weaver_view::Look;

/// Decibels that pictures blended in halfs reach.
const BAR: f64 = 52.0;
/// Largest difference of a pixel's color, of 255.
const MOST: u8 = 6;

/// A camera as the page takes it.
fn shot(camera: &Camera) -> serde_json::Value {
    let k = camera.intrinsics;
    let rows = camera.pose.rotation.transpose().to_cols_array();
    let lens =
        json!({ "fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy, "width": camera.width, "height": camera.height });
    json!({ "A": rows, "eye": camera.pose.center().to_array(), "lens": lens })
}

/// Largest difference and PSNR.
fn difference(page: &[u8], ours: &[u8]) -> (u8, f64) {
    let pairs = || page.as_chunks::<4>().0.iter().flat_map(|p| &p[..3]).zip(ours);
    let most = pairs().map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    let squares: f64 = pairs().map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
    (most, 10.0 * (255.0 * 255.0 * ours.len() as f64 / squares.max(1e-9)).log10())
}

fn compare(name: &str, gaussians: &Gaussians, camera: Camera, look: Look, browser: &Browser) {
    let activated = gaussians.to_activated();
    let pixels =
        render(&activated, &[camera], look.background, &look.settings, &mut Workspace::new()).unwrap().concat();
    let Camera { width, height, .. } = camera;
    let ours = Image { width, height, pixels }.to_bytes();
    let written = Written::page(gaussians, look, &[], true);
    browser.open_page(&written.address());
    assert_eq!(browser.text("splatweaver.renderer.kind"), "half");
    for kind in ["half", "byte"] {
        let found = browser.awaited(&format!("splatweaver.exactly({}, {{}}, '{kind}')", shot(&camera)));
        let page = STANDARD.decode(found.as_str().unwrap()).unwrap_or_else(|_| panic!("{name}: {found}"));
        assert_eq!(page.len(), 4 * width * height);
        let (most, psnr) = difference(&page, &ours);
        eprintln!("{name:<28} {kind}: largest difference {most:>3}, {psnr:.1} dB");
        assert!(kind == "byte" || psnr >= BAR && most <= MOST, "{name}: {most}, {psnr}");
    }
    eprintln!("{name:<28} {}", browser.awaited(PACE).as_str().unwrap());
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// Draws the page's own picture ten times and returns the time of the last.
const PACE: &str = "(async () => { for (let i = 0; i < 10; i++) { splatweaver.changed(); await new Promise((done) => setTimeout(done, 100)); } \
                    return document.getElementById('pace').title; })()";

fn look(antialiased: bool, alpha_max: f64, background: [f32; 3]) -> Look {
    Look {
        background,
        settings: RasterSettings { antialiased, alpha_max, ..RasterSettings::default() },
        ..Look::default()
    }
}

/// Pictures of generated scenes equal the rasterizer's.
///
/// Promise (scenes): pictures of the page equal the rasterizer's within 6 of 255 and 52 dB, of every degree,
/// antialiased, at both limits of alpha and from within.
#[test]
fn pictures_of_generated_scenes_agree() {
    let Some(browser) = Browser::start("pictures_of_generated_scenes") else { return };
    let eye = [0.4, -0.5, -2.6];
    for degree in 0..=4 {
        let scene = cloud(2000, degree, degree as u64);
        compare(
            &format!("2,000 of degree {degree}"),
            &scene,
            camera(eye, 320, 240),
            look(false, 0.99, [1.0; 3]),
            &browser,
        );
    }
    let scene = cloud(2000, 1, 7);
    compare("2,000 antialiased", &scene, camera([0.0, 0.0, -9.0], 320, 240), look(true, 0.99, [0.0; 3]), &browser);
    compare("2,000 to an alpha of 0.999", &scene, camera(eye, 320, 240), look(false, 0.999, [0.1, 0.5, 0.9]), &browser);
    // From within, where Gaussians are cut by the near plane and bend the projection.
    compare("2,000 from within", &scene, camera([0.3, 0.1, -0.2], 320, 240), look(false, 0.99, [1.0; 3]), &browser);
}

/// Pictures of real scenes equal the rasterizer's.
///
/// Promise of `pictures_of_generated_scenes_agree`.
#[test]
fn pictures_of_real_scenes_agree() {
    let Some(folder) = shared("pictures_of_real_scenes", "splat-files") else { return };
    let Some(browser) = Browser::start("pictures_of_real_scenes") else { return };
    for (file, eye) in [("playbot-sh2.ply", [0.9, -0.3, -2.2]), ("guitar.compressed.ply", [0.3, -0.2, -1.6])] {
        let scene = weaver_io::read_gaussians(folder.join(file)).unwrap();
        for antialiased in [false, true] {
            let name = format!("{file}{}", if antialiased { " antialiased" } else { "" });
            compare(&name, &scene, camera(eye, 640, 480), look(antialiased, 0.99, [1.0; 3]), &browser);
        }
    }
    if std::env::var_os("WEAVER_STRESS").is_some() {
        let scene = cloud(100_000, 3, 9);
        compare(
            "100,000 of degree 3",
            &scene,
            camera([0.4, -0.5, -2.6], 640, 480),
            look(false, 0.99, [1.0; 3]),
            &browser,
        );
    }
}

/// Promise (scenes): a rounded page shows the scene of its SPZ file, and nothing is rounded that would be torn apart.
#[test]
fn a_rounded_scene_is_what_its_file_is() {
    let Some(browser) = Browser::start("a_rounded_scene") else { return };
    let scene = cloud(1500, 3, 3);
    let spz: weaver_io::SceneFormat = "spz".parse().unwrap();
    let mut bytes = Vec::new();
    weaver_io::write_gaussians_to(&mut bytes, spz, &scene).unwrap();
    let rounded = weaver_io::read_gaussians_from(&bytes, spz).unwrap();
    let (camera, look) = (camera([0.4, -0.5, -2.6], 320, 240), look(false, 0.99, [1.0; 3]));
    let pixels = render(&rounded.to_activated(), &[camera], look.background, &look.settings, &mut Workspace::new())
        .unwrap()
        .concat();
    let ours = Image { width: 320, height: 240, pixels }.to_bytes();
    browser.open_page(&Written::page(&scene, look, &[], false).address());
    let found = browser.awaited(&format!("splatweaver.exactly({})", shot(&camera)));
    let (most, psnr) = difference(&STANDARD.decode(found.as_str().unwrap()).unwrap(), &ours);
    eprintln!("2,000 in SPZ: largest difference {most}, {psnr:.1} dB");
    assert!(psnr >= BAR && most <= MOST, "{most}, {psnr}");
}

/// A device without pictures of floats or halfs projects and blends by other means.
#[test]
fn a_plain_device_draws_in_eight_bits_and_says_so() {
    let Some(browser) = Browser::start("a_plain_device") else { return };
    let without = "const get = WebGL2RenderingContext.prototype.getExtension; \
                   WebGL2RenderingContext.prototype.getExtension = function (name) { return /float/.test(name) ? null : get.call(this, name); };";
    browser.browser("Page.addScriptToEvaluateOnNewDocument", json!({ "source": without }));
    let (scene, look) = (cloud(2000, 2, 3), look(false, 0.99, [1.0; 3]));
    let camera = camera([0.4, -0.5, -2.6], 320, 240);
    let activated = scene.to_activated();
    let pixels =
        render(&activated, &[camera], look.background, &look.settings, &mut Workspace::new()).unwrap().concat();
    let ours = Image { width: 320, height: 240, pixels }.to_bytes();
    browser.open_page(&Written::page(&scene, look, &[], true).address());
    assert_eq!(browser.text("splatweaver.renderer.kind"), "byte");
    assert!(browser.text("document.getElementById('status').textContent").contains("8 bits"));
    let found = browser.awaited(&format!("splatweaver.exactly({})", shot(&camera)));
    let (most, psnr) = difference(&STANDARD.decode(found.as_str().unwrap()).unwrap(), &ours);
    eprintln!("2,000 on a plain device: largest difference {most}, {psnr:.1} dB");
    assert!(psnr >= 40.0, "{most}, {psnr}");
    assert_eq!(browser.errors(), Vec::<String>::new());
}
