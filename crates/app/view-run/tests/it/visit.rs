//! Pages of the server in a browser.

use crate::browser::Browser;
use crate::server::{gaussians, here, scene_page};
use serde_json::json;
use std::sync::atomic::{AtomicBool, Ordering};
use weaver_geometry::{Camera, Intrinsics, Pose};
use weaver_io::Image;
use weaver_io::safetensors::Tensors;
use weaver_run::Folder;
use weaver_scene::Gaussians;
use weaver_view_run::{Features, LiveRun, LiveView, Moving, SceneFiles, ScenePage, Server};

/// Promise of `deletions_are_not_saved_and_come_back`.
#[test]
fn what_is_deleted_and_saved_is_read_back() {
    let Some(browser) = Browser::start("what_is_deleted_and_saved") else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene_page = scene_page(Some(folder.path().join("scene.ply")));
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        browser.open_page(&server.address());
        browser.value("splatweaver.selection.change((flag, i) => (i < 5 ? 1 : 0))");
        browser.press(&["\u{e017}"]);
        browser.value("[...document.querySelectorAll('#save button')].find((b) => b.textContent === 'ply').click()");
        browser.wait("document.getElementById('status').textContent.startsWith('Saved 30 Gaussians')");
    });
    let kept: Vec<usize> = (5..35).collect();
    let saved = weaver_io::read_gaussians(folder.path().join("scene-edited.ply")).unwrap();
    assert!(saved == scene_page.gaussians.select(&kept));
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// Promise of `notes_are_saved_beside_the_scene`.
#[test]
fn a_measured_scale_is_saved_and_read_back() {
    let Some(browser) = Browser::start("a_measured_scale_is_saved") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.ply");
    let page = scene_page(Some(file.clone()));
    weaver_io::write_gaussians(&file, &page.gaussians).unwrap();
    let server = Server::new(&page, None, here()).unwrap();
    let meters = server.during(|| {
        browser.open_page(&server.address());
        browser.press(&["g"]);
        browser.click([440, 350], 1);
        browser.click([560, 330], 1);
        browser.fill("document.getElementById('known')", "3");
        browser.wait("splatweaver.notes.state.meters > 0");
        browser.value("splatweaver.canvas.focus()");
        browser.press(&["o"]);
        browser.click_on("document.getElementById('save-notes')");
        browser.wait("document.getElementById('status').textContent.startsWith('Saved the notes in ')");
        browser.number("splatweaver.notes.state.meters")
    });
    let again = SceneFiles::of(&file).page().unwrap();
    assert_eq!(again.look.meters, Some(meters));
    let server = Server::new(&again, None, here()).unwrap();
    server.during(|| {
        browser.open("about:blank");
        browser.open_page(&server.address());
        assert_eq!(browser.text("document.querySelector('#lengths button').textContent"), "3 m");
        assert_eq!(browser.text("document.querySelector('#places button').textContent"), "View 1");
        assert!(browser.is("!document.getElementById('scale').hidden && !location.hash.includes('notes')"));
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn photos_of_a_camera_file_stand_beside_renders() {
    let Some(browser) = Browser::start("photos_of_a_camera_file") else { return };
    let folder = tempfile::tempdir().unwrap();
    let intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 32.0, cy: 24.0 };
    let camera = Camera { pose: Pose::IDENTITY, intrinsics, width: 64, height: 48 };
    let names = ["a.png", "b <i>.png"];
    let frames = names.map(|name| {
        Image::filled(64, 48, [0.2, 0.5, 0.3]).write_png(folder.path().join(name)).unwrap();
        weaver_scene::Frame::new(name, camera)
    });
    let file = folder.path().join("transforms.json");
    let test_filenames = Some(vec![names[1].into()]);
    weaver_io::Transforms { frames: frames.into(), test_filenames, ..Default::default() }.write(&file).unwrap();
    let scene_page = scene_page(None).with_cameras(&file, None).unwrap();
    assert_eq!(scene_page.shots.iter().map(|shot| shot.held_out).collect::<Vec<_>>(), [true, false]);
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        browser.open_page(&server.address());
        browser.press(&["n"]);
        browser.wait("document.getElementById('photo').naturalWidth === 64");
        assert_eq!(browser.text("document.querySelector('#strip span').textContent"), "b <i>");
    });
    // The page as one file.
    let page = scene_page.html(Default::default()).unwrap();
    let html = folder.path().join("view.html");
    std::fs::write(&html, page).unwrap();
    browser.open_page(&format!("file://{}", html.display()));
    browser.press(&["n"]);
    browser.wait("document.getElementById('photo').naturalWidth === 64");
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// Gaussians of a run that diverged, with numbers that are none or too large, are served and leave a page that one can
/// use.
///
/// Promise of `an_address_without_a_view_changes_nothing`.
#[test]
fn numbers_that_are_none_leave_a_page() {
    let Some(browser) = Browser::start("numbers_that_are_none") else { return };
    let mut scene = gaussians(40);
    for (i, wrong) in [f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX, 1e30].into_iter().enumerate() {
        scene.means[5 * i] = [wrong, 0.0, 1.0];
        scene.log_scales[5 * i + 1] = [wrong; 3];
        scene.quats[5 * i + 2] = [wrong, 0.0, 0.0, 0.0];
        scene.opacity_logits[5 * i + 3] = wrong;
        scene.sh[15 * i + 12] = wrong;
    }
    scene.quats[30] = [0.0; 4];
    let scene_page = ScenePage::new("diverged", scene, Default::default());
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        browser.open_page(&server.address());
        assert_eq!(browser.number("splatweaver.scene.n"), 40.0);
        assert!(browser.is("[...splatweaver.viewpoint.eye, ...splatweaver.viewpoint.forward].every(Number.isFinite)"));
        browser.press(&["h"]);
        browser.click([500, 350], 2);
        browser.wait("!splatweaver.sorting && !splatweaver.pending");
        assert!(browser.is("[...splatweaver.viewpoint.eye, ...splatweaver.viewpoint.forward].every(Number.isFinite)"));
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// An address whose numbers are no view, or that holds markup, leaves the page where it was.
///
/// Promise (servers): an address without a view changes nothing; numbers that are none leave a page.
#[test]
fn an_address_without_a_view_changes_nothing() {
    let Some(browser) = Browser::start("an_address_without_a_view") else { return };
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        browser.open_page(&server.address());
        let eye = "[...splatweaver.viewpoint.eye, ...splatweaver.viewpoint.forward].join()";
        let before = browser.text(eye);
        for hash in [
            "view=1e308,1e308,1e308,-1e308,-1e308,-1e308,0,1,0,1",
            "view=0,0,0,0,0,0,0,1,0,1",
            "view=0,0,0,0,0,NaN,0,1,0,1",
            "view=0,0,0,0,0,1,0,1,0,Infinity",
            "view=0,0,0,0,0,1,0,1,0,-1",
            "view=1e400,,,,,,,,,",
            "view=%3Cimg%20src%3Dx%20onerror%3Ddocument.title%3D1%3E",
            "view=%",
        ] {
            browser
                .value(&format!("(() => {{ location.hash = '{hash}'; dispatchEvent(new Event('hashchange')); }})()"));
            assert_eq!(browser.text(eye), before, "{hash}");
        }
        browser.value(
            "(() => { location.hash = 'view=0,0,-3,0,0,2,0,1,0,1'; dispatchEvent(new Event('hashchange')); })()",
        );
        assert_eq!(browser.text(eye), "0,0,-3,0,0,1");
        assert_eq!(browser.text("document.title"), "scene");
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// Promise (scenes): a page opened late shows the whole run, and its button ends it as Ctrl-C does.
#[test]
fn a_page_follows_a_run_and_ends_it() {
    let Some(browser) = Browser::start("a_page_follows_a_run") else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene_page = ScenePage::new("run", gaussians(10), Default::default());
    let scene = |state: &Tensors| Ok(gaussians(state.values::<u64>("n", &[1])?[0] as usize));
    let stop = AtomicBool::new(false);
    let followed =
        LiveRun { folder: folder.path(), steps: 50, names: &[], showing: LiveView::Scene(&scene), stop: &stop };
    let log = |text: &str| std::fs::write(folder.path().join(Folder::LOG), text).unwrap();
    let save = |n: u64| {
        let mut state = Tensors::default();
        state.insert("n", &[1], vec![n]);
        state.write(folder.path().join(Folder::CHECKPOINT)).unwrap();
    };
    let server = Server::new(&scene_page, Some(followed), here()).unwrap();
    server.during(|| {
        log("{\"step\":1,\"loss\":0.9,\"psnr\":12}\n{\"step\":2,\"loss\":0.5,\"psnr\":14.5}\n");
        browser.open_page(&server.address());
        // Records from before the page was opened are there, too.
        browser.wait("document.querySelectorAll('#curves figure').length === 2");
        assert_eq!(browser.text("document.getElementById('done').textContent"), "Step 2 of 50");
        save(25);
        browser.wait("splatweaver.scene.n === 25");
        save(30);
        log("{\"step\":1,\"loss\":0.9,\"psnr\":12}\n{\"step\":2,\"loss\":0.5,\"psnr\":14.5}\n{\"step\":9,\"loss\":0.2,\"psnr\":20}\n");
        browser.wait("splatweaver.scene.n === 30 && document.getElementById('done').textContent === 'Step 9 of 50'");
        assert_eq!(browser.value("document.querySelector('#curves polyline').getAttribute('points').split(' ').length"), json!(3));
        browser.value("document.getElementById('stop').click()");
        browser.wait("document.getElementById('status').textContent.includes('ends after this step')");
        assert!(stop.load(Ordering::Relaxed));
        browser.wait("document.getElementById('status').textContent.includes('has ended')");
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// The slider shows other times, hidden Gaussians stay hidden, and the film plays.
#[test]
fn a_scene_that_moves_is_shown_at_any_time() {
    let Some(browser) = Browser::start("a_scene_that_moves") else { return };
    let at = |time: f64| {
        let mut scene = gaussians(20);
        scene.means.iter_mut().for_each(|mean| mean[0] += time as f32);
        scene
    };
    let scene_page = ScenePage { moving: Some(Moving::new(at)), ..ScenePage::new("film", at(0.5), Default::default()) };
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        browser.open_page(&server.address());
        browser.value("splatweaver.selection.change((flag, i) => (i < 5 ? 2 : 0))");
        let moved = "(splatweaver.scene.means[0] + 0.6).toFixed(2)";
        assert_eq!(browser.text(moved), "0.50");
        let slide = "(() => { const time = document.getElementById('time'); time.value = 0.9; time.dispatchEvent(new Event('input')); })()";
        browser.value(slide);
        browser.wait(&format!("{moved} === '0.90'"));
        assert_eq!(browser.number("splatweaver.selection.count(2)"), 5.0);
        browser.press(&["t"]);
        browser.wait(&format!("{moved} !== '0.90'"));
        browser.press(&["t"]);
        browser.wait("document.getElementById('play').getAttribute('aria-pressed') === 'false'");
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// Promise (scenes): a large scene is seen before all of it is there, and then whole.
#[test]
fn a_large_scene_is_shown_before_all_is_there() {
    let Some(browser) = Browser::start("a_large_scene_is_shown") else { return };
    let mut scene = gaussians(250_000);
    // Small ones, which are drawn fast.
    scene.log_scales.fill([-7.0; 3]);
    let scene_page = ScenePage::new("large", scene, Default::default());
    let beginning = scene_page.beginning();
    let faintest = |scene: &Gaussians| scene.opacity_logits.iter().copied().fold(f32::INFINITY, f32::min);
    assert_eq!((scene_page.has_beginning(), beginning.len()), (true, 20_834));
    assert!(faintest(&beginning) >= faintest(&scene_page.gaussians));
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        // Numbers of Gaussians as scenes are put in place of each other.
        browser.open_page(&server.address());
        browser.wait("splatweaver.scene.n === 250000 && document.getElementById('status').textContent === ''");
        let sizes = "performance.getEntriesByType('resource').filter((r) => r.name.includes('scene')).map((r) => r.name.endsWith('part=beginning')).join()";
        assert_eq!(browser.text(sizes), "true,false");
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// A run whose scene moves is shown at the time of the slider, also after its next checkpoint.
#[test]
fn a_run_is_followed_at_any_time_of_its_film() {
    let Some(browser) = Browser::start("a_run_is_followed_at_any_time") else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene_page = ScenePage::new("run", gaussians(10), Default::default());
    let film = |state: &Tensors, time: f64| {
        let mut scene = gaussians(state.values::<u64>("n", &[1])?[0] as usize);
        scene.means.iter_mut().for_each(|mean| mean[0] += time as f32);
        Ok(scene)
    };
    let stop = AtomicBool::new(false);
    let followed =
        LiveRun { folder: folder.path(), steps: 50, names: &[], showing: LiveView::Film(&film), stop: &stop };
    std::fs::write(folder.path().join(Folder::LOG), "{\"step\":1,\"loss\":0.9}\n").unwrap();
    let save = |n: u64| {
        let mut state = Tensors::default();
        state.insert("n", &[1], vec![n]);
        state.write(folder.path().join(Folder::CHECKPOINT)).unwrap();
    };
    let server = Server::new(&scene_page, Some(followed), here()).unwrap();
    server.during(|| {
        save(20);
        browser.open_page(&server.address());
        browser.value("(() => { const time = document.getElementById('time'); time.value = 0.9; time.dispatchEvent(new Event('input')); })()");
        let at = |n: usize| format!("splatweaver.scene.n === {n} && (splatweaver.scene.means[0] + 0.6).toFixed(2) === '0.90'");
        browser.wait(&at(20));
        save(25);
        browser.wait(&at(25));
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// A click shows the Gaussians similar to the clicked one, and selects them.
///
/// Promise (scenes): a click shows and selects the Gaussians whose features are like the clicked one's.
#[test]
fn a_click_shows_and_selects_what_is_alike() {
    let Some(browser) = Browser::start("a_click_shows_and_selects") else { return };
    // Two kinds, and some between.
    let row = |i: usize| [[1.0, 0.0], [0.0, 2.0], [0.6, 0.8]][i % 3];
    let features = Features::new((0..35).flat_map(row).collect(), 2);
    let scene_page = ScenePage { features: Some(features.clone()), ..scene_page(None) };
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        browser.open_page(&server.address());
        assert!(browser.is("document.getElementById('alike').disabled"));
        browser.press(&["k"]);
        browser.click([500, 350], 1);
        browser.wait("splatweaver.look.mode === 'alike' && document.getElementById('alike').checked");
        let of = browser.number("splatweaver.selection.nearest(splatweaver.pointAt(500, 350))") as usize;
        let alike = features.alike(of).unwrap();
        assert_eq!(browser.value("Array.from(splatweaver.renderer.alike)"), json!(alike));
        browser.value("document.getElementById('select-alike').click()");
        let selected = alike.iter().filter(|alike| f64::from(**alike) >= 0.8 * 255.0).count();
        assert_eq!(browser.number("splatweaver.selection.count(1)"), selected as f64);
        assert!((1..35).contains(&selected) && browser.is("splatweaver.look.mode === 'color'"));
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// Without a scene: curves, of the loss one for each stage, and the newest picture.
#[test]
fn a_run_without_a_scene_shows_curves_and_pictures() {
    let Some(browser) = Browser::start("a_run_without_a_scene") else { return };
    let folder = tempfile::tempdir().unwrap();
    let samples = folder.path().join("samples");
    let stop = AtomicBool::new(false);
    let names = [("rate", "learning rate")];
    let followed =
        LiveRun { folder: folder.path(), steps: 9, names: &names, showing: LiveView::Pictures(&samples), stop: &stop };
    let log = |text: &str| std::fs::write(folder.path().join(Folder::LOG), text).unwrap();
    let server = Server::of_run("run </h1><script>document.title='taken'</script>", followed, here()).unwrap();
    server.during(|| {
        browser.resize(360, 640, true);
        browser.open(&server.address());
        log("{\"step\":1,\"stage\":\"a\",\"loss\":0.9}\n{\"step\":2,\"stage\":\"b\",\"loss\":4,\"rate\":0.1}\n");
        browser.wait("document.querySelectorAll('#curves figure').length === 3");
        assert_eq!(browser.text("document.querySelector('#curves span').textContent"), "loss, a");
        let rate =
            "[...document.querySelectorAll('#curves figure')].find((it) => it.textContent.includes('learning rate'))";
        browser.value(&format!(
            "{rate}.querySelector('svg').dispatchEvent(new PointerEvent('pointermove', {{ clientX: 100 }}))"
        ));
        assert!(browser.is(&format!("{rate}.textContent.includes('0.1000 at step 2')")));
        assert!(browser.text("document.title").starts_with("run </h1>"));
        std::fs::create_dir(&samples).unwrap();
        for (name, width) in [("step-000002.png", 20), ("step-000010.png", 30)] {
            Image::filled(width, 8, [0.2, 0.5, 0.3]).write_png(samples.join(name)).unwrap();
            browser.wait(&format!("document.getElementById('picture').naturalWidth === {width}"));
        }
        assert!(browser.is("document.documentElement.scrollWidth <= 360"));
        browser.value("document.getElementById('stop').click()");
        browser.wait("document.getElementById('status').textContent.includes('has ended')");
        assert!(stop.load(Ordering::Relaxed));
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}
