//! Cleaning, the error of photos, and a second scene.

use crate::browser::Browser;
use crate::page::QUIET;
use crate::pages::Written;
use crate::scenes::{camera, cloud};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use weaver_geometry::Camera;
use weaver_io::{Bitmap, Image, write_gaussians_to};
use weaver_scene::Gaussians;
use weaver_splat::{Workspace, render};
use weaver_view::{Look, Shot};

fn slide(browser: &Browser, id: &str, value: &str) {
    browser.value(&format!(
        "(() => {{ const e = document.getElementById('{id}'); e.value = {value}; e.dispatchEvent(new Event('input')); }})()"
    ));
}

/// Promise (scenes): sliders hide faint, huge and lonely Gaussians, and deleting them is one step to undo.
#[test]
fn sliders_find_gaussians_that_float() {
    let Some(browser) = Browser::start("sliders_find_gaussians") else { return };
    browser.resize(900, 600, false);
    let mut scene = cloud(2000, 0, 6);
    scene.opacity_logits.iter_mut().for_each(|logit| *logit = logit.max(0.0));
    // Two faint, one huge, three lonely ones; a pair of lonely ones has no eight neighbors either.
    scene.opacity_logits[10] = -4.0;
    scene.opacity_logits[11] = -3.5;
    scene.log_scales[20] = [1.0, -4.0, -4.0];
    for (i, x) in [(30, 9.0), (31, 9.01), (32, -14.0)] {
        scene.means[i] = [x, 0.3, 0.2];
    }
    browser.open_page(&Written::page(&scene, Look::default(), &[], true).address());
    let preview = "Array.from(splatweaver.clean.preview ?? []).flatMap((x, i) => (x ? [i] : []))";
    let found = |id: &str, value: &str, expected: &[usize]| {
        slide(&browser, id, value);
        browser.wait(&format!("JSON.stringify({preview}) === '{}'", serde_json::to_string(expected).unwrap()));
        slide(&browser, id, "0");
        browser.wait(&format!("({preview}).length === 0"));
    };
    browser.press(&["c"]);
    assert!(browser.is("document.getElementById('cleaning').open && document.activeElement.id === 'faint'"));
    found("faint", "10", &[10, 11]);
    found("huge", "60", &[20]);
    found("lonely", "40", &[30, 31, 32]);
    slide(&browser, "faint", "10");
    slide(&browser, "lonely", "40");
    browser.wait("splatweaver.clean.count === 5");
    assert_eq!(browser.text("document.getElementById('cleaned').textContent"), "5 of 2,000 Gaussians are hidden.");
    browser.press(&["\u{e017}"]);
    browser.wait("splatweaver.selection.count(4) === 5 && splatweaver.clean.count === 0");
    browser.control("z");
    assert_eq!(browser.number("splatweaver.selection.count(4)"), 0.0);
    browser.control("y");
    assert_eq!(browser.number("splatweaver.selection.count(4)"), 5.0);
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// The error of a photo is black where it equals the render, and bright where it does not.
#[test]
fn the_error_of_a_photo_is_a_picture() {
    let Some(browser) = Browser::start("the_error_of_a_photo") else { return };
    browser.resize(900, 600, false);
    let (scene, look) = (cloud(800, 1, 1), Look::default());
    let of = |x: f64| camera([x, -0.3, -2.6], 800, 600);
    let picture = |camera: Camera| {
        let pixels =
            render(&scene.to_activated(), &[camera], look.background, &look.settings, &mut Workspace::new()).unwrap();
        let pixels = Image { width: camera.width, height: camera.height, pixels: pixels.concat() }.to_bytes();
        Bitmap { width: camera.width, height: camera.height, pixels }
    };
    let plain = Bitmap { width: 80, height: 60, pixels: [200, 40, 20].repeat(80 * 60) };
    let shots = [picture(of(0.0)), plain]
        .map(|photo| Shot { photo: Some(photo.to_jpeg(95).unwrap()), ..Shot::new("photo", of(0.0)) });
    browser.open_page(&Written::page(&scene, look, &shots, true).address());
    assert!(browser.is("document.getElementById('errors').disabled"));
    let shown = |browser: &Browser| {
        browser.wait(&format!("{QUIET} && document.getElementById('error-value').textContent !== ''"));
        let decibels = browser.text("document.getElementById('error-value').textContent");
        let mean = "(() => { const c = document.getElementById('error'); const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let s = 0; for (let i = 0; i < d.length; i += 4) s += d[i]; return s / d.length * 4; })()";
        (decibels.trim_end_matches(" dB").parse::<f64>().unwrap(), browser.number(mean))
    };
    browser.press(&["n", "z"]);
    let (same, dark) = shown(&browser);
    assert_eq!(browser.text("document.getElementById('side').textContent"), "error");
    assert!(browser.is(
        "document.getElementById('error').style.left === '50px' && document.getElementById('error').width === 800"
    ));
    browser.press(&["n"]);
    browser.wait("splatweaver.shots.current === 1");
    let (other, bright) = shown(&browser);
    assert!(same > 30.0 && dark < 60.0 && other < 15.0 && bright > 150.0, "{same} dB, {dark}; {other} dB, {bright}");
    browser.drag([300, 300], [360, 330]);
    assert!(browser.is("document.getElementById('error').hidden && document.getElementById('errors').disabled"));
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// A page that comes with two scenes shows both.
#[test]
fn a_page_comes_with_a_second_scene() {
    let Some(browser) = Browser::start("a_page_with_two") else { return };
    browser.resize(900, 600, false);
    browser.open_page(&Written::both(&cloud(600, 1, 1), ("b.ply", &cloud(700, 0, 9))).address());
    browser.wait(&format!(
        "{QUIET} && document.getElementById('second-name').textContent.startsWith('b.ply, 700 Gaussians') && splatweaver.second.order?.row"
    ));
    assert!(browser.is("!document.getElementById('second').hidden && splatweaver.scene.n === 600"));
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// A file that is dropped onto the page is drawn over its scene, right of the slider.
#[test]
fn a_second_scene_lies_over_the_first() {
    let Some(browser) = Browser::start("a_second_scene") else { return };
    browser.resize(900, 600, false);
    let (scene, other) = (cloud(600, 1, 1), cloud(700, 0, 9));
    browser.open_page(&Written::page(&scene, Look::default(), &[], true).address());
    let drop = |name: &str, bytes: &[u8]| {
        let text = STANDARD.encode(bytes);
        browser.value(&format!(
            "(() => {{ const files = new DataTransfer(); files.items.add(new File([Uint8Array.from(atob('{text}'), (c) => c.charCodeAt(0))], '{name}')); \
             document.body.dispatchEvent(new DragEvent('drop', {{ dataTransfer: files, bubbles: true, cancelable: true }})); }})()"
        ));
    };
    let ply = |scene: &Gaussians| {
        let mut bytes = Vec::new();
        write_gaussians_to(&mut bytes, "ply".parse().unwrap(), scene).unwrap();
        bytes
    };
    drop("bad.ply", b"no scene at all");
    browser.wait("document.getElementById('status').textContent === 'bad.ply: The scene is neither PLY nor SPZ.'");
    let sums = "[splatweaver.renderer, splatweaver.second.renderer].map((r) => r.pixels(r.gl.canvas.width, r.gl.canvas.height).reduce((a, x, i) => (a * 31 + x) % 1000000007, 7))";
    let shown = |name: &str, n: usize| {
        browser.wait(&format!(
            "{QUIET} && document.getElementById('second-name').textContent.startsWith('{name}, {n} Gaussians') && !splatweaver.second.order?.busy && splatweaver.second.order?.row"
        ));
        browser.wait(QUIET);
        browser.value(sums)
    };
    drop("other.ply", &ply(&other));
    let different = shown("other.ply", 700);
    assert_ne!(different[0], different[1]);
    assert!(browser.is("!document.getElementById('second').hidden"));
    slide(&browser, "split", "30");
    assert!(browser.text("document.getElementById('second').style.clipPath").contains("30%"));
    drop("same.ply", &ply(&scene));
    let same = shown("same.ply", 600);
    assert_eq!(same[0], same[1]);
    browser.click_on("document.getElementById('remove-second')");
    browser.wait(&format!(
        "{QUIET} && document.getElementById('second').hidden && document.getElementById('split').hidden"
    ));
    assert_eq!(browser.errors(), Vec::<String>::new());
}
