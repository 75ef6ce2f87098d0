//! Every control of the page, once.

use crate::browser::Browser;
use crate::pages::Written;
use crate::scenes::{camera, cloud};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use weaver_io::{Bitmap, read_gaussians_from};
use weaver_view::{Look, Shot};

pub const QUIET: &str = "!splatweaver.sorting && !splatweaver.pending && !splatweaver.travel";

fn shots() -> Vec<Shot> {
    let photo = Bitmap { width: 64, height: 48, pixels: [200, 40, 20].repeat(64 * 48) }.to_jpeg(90).unwrap();
    let shot = |i: usize| Shot {
        held_out: i == 0,
        photo: (i < 2).then(|| photo.clone()),
        coverage: (i == 1).then_some(0.6),
        ..Shot::new(format!("images/{i}.jpg"), camera([0.8 * i as f64 - 0.8, -0.3, -2.6], 320, 240))
    };
    (0..3).map(shot).collect()
}

fn moves(browser: &Browser, what: &str, act: impl FnOnce()) {
    browser.wait(QUIET);
    let before = browser.text("splatweaver.viewpoint.toText()");
    act();
    browser.wait(QUIET);
    assert_ne!(browser.text("splatweaver.viewpoint.toText()"), before, "{what}");
}

/// The view moves by mouse and keys and stays in the address.
#[test]
fn the_view_moves_and_stays_in_the_address() {
    let Some(browser) = Browser::start("the_view_moves") else { return };
    browser.resize(900, 600, false);
    let scene = cloud(800, 1, 1);
    let written = Written::page(&scene, Look::default(), &shots(), false);
    browser.open_page(&written.address());
    assert_eq!(browser.text("document.getElementById('count').textContent"), "800 Gaussians");
    let covered = browser.text("document.querySelectorAll('#strip button')[1].title");
    assert!(covered.ends_with("agree about the depth of 60 % of it"), "{covered}");
    moves(&browser, "drag", || browser.drag([300, 300], [360, 330]));
    moves(&browser, "arrow", || browser.press(&["\u{e012}"]));
    moves(&browser, "fly", || browser.press(&["w"]));
    moves(&browser, "zoom", || browser.press(&["+"]));
    moves(&browser, "double click", || browser.click([400, 300], 2));
    moves(&browser, "home", || browser.press(&["h"]));
    moves(&browser, "field of view", || {
        browser.value("(() => { const f = document.getElementById('fov'); f.value = 90; f.dispatchEvent(new Event('input')); })()");
    });
    moves(&browser, "up", || {
        browser.value(
            "(() => { const u = document.getElementById('up'); u.value = 3; u.dispatchEvent(new Event('change')); })()",
        );
    });
    let kept = browser.text("splatweaver.viewpoint.toText()");
    browser.wait(&format!("location.hash.startsWith('#view={kept}')"));
    let address = browser.text("location.href");
    browser.open("about:blank");
    browser.open_page(&address);
    let again = browser.text("splatweaver.viewpoint.toText()");
    let numbers = |text: &str| text.split(',').map(|x| x.parse::<f64>().unwrap()).collect::<Vec<_>>();
    for (a, b) in numbers(&kept).iter().zip(numbers(&again)) {
        assert!((a - b).abs() < 1e-4, "{kept} and {again}");
    }
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn cameras_show_their_photos_beside_the_render() {
    let Some(browser) = Browser::start("cameras_show") else { return };
    browser.resize(900, 600, false);
    let scene = cloud(800, 1, 1);
    let written = Written::page(&scene, Look::default(), &shots(), false);
    browser.open_page(&written.address());
    assert_eq!(browser.number("document.querySelectorAll('#strip button').length"), 3.0);
    browser.press(&["n"]);
    browser.wait(QUIET);
    assert!(
        browser.is("!document.getElementById('photo').hidden && document.getElementById('photo').naturalWidth === 64")
    );
    // The photo lies where the render of its camera does: 4:3 in a page of 3:2.
    assert_eq!(
        browser.text(
            "['left', 'top', 'width', 'height'].map((name) => document.getElementById('photo').style[name]).join()"
        ),
        "50px,0px,800px,600px"
    );
    let eye = "splatweaver.viewpoint.eye.every((x, i) => Math.abs(x - splatweaver.shots.all[0].eye[i]) < 1e-6)";
    assert!(browser.is(eye));
    browser.value(
        "(() => { const w = document.getElementById('wipe'); w.value = 20; w.dispatchEvent(new Event('input')); })()",
    );
    assert!(browser.text("document.getElementById('photo').style.clipPath").contains("80%"));
    browser.press(&["v"]);
    browser.wait(QUIET);
    assert!(browser.is("splatweaver.shots.current === 2 && document.getElementById('photo').hidden"));
    browser.press(&["f"]);
    assert!(browser.is("splatweaver.overlay.frusta"));
    let drawn = "document.getElementById('over').getContext('2d').getImageData(0, 0, 900, 600).data.some((x) => x > 0)";
    browser.press(&["h"]);
    browser.wait(QUIET);
    assert!(browser.is(drawn));
    browser.drag([300, 300], [360, 330]);
    assert!(browser.is("splatweaver.shots.current === -1"));
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// The bar is as long as its text says, at any distance of the center.
///
/// Promise (scenes): the scale bar is as long as its label, and there is none where the unit is unknown.
#[test]
fn a_bar_shows_the_scale_where_it_is_known() {
    let Some(browser) = Browser::start("a_bar_shows_the_scale") else { return };
    let scene = cloud(100, 0, 1);
    let look = Look { meters: Some(0.5), ..Look::default() };
    browser.open_page(&Written::page(&scene, look, &[], false).address());
    let shown = || {
        browser.wait(QUIET);
        let text = browser.text("document.getElementById('scale').textContent");
        let (number, unit) = text.split_once(' ').unwrap();
        let unit =
            [("km", 1000.0), ("m", 1.0), ("cm", 0.01), ("mm", 0.001)].into_iter().find(|it| it.0 == unit).unwrap();
        let pixels = browser.number("document.getElementById('scale').getBoundingClientRect().width");
        let per_meter = browser.number("splatweaver.camera(1).K[0] / splatweaver.viewpoint.distance / 0.5");
        let meters = number.parse::<f64>().unwrap() * unit.1;
        assert!(
            (pixels / per_meter - meters).abs() < 0.02 * meters && (50.0..131.0).contains(&pixels),
            "{text}, {pixels}"
        );
        meters
    };
    let far = shown();
    browser.value("(splatweaver.viewpoint.zoom(0.05), splatweaver.moved())");
    assert!(shown() < 0.3 * far);
    browser.open_page(&Written::page(&scene, Look::default(), &[], false).address());
    assert!(browser.is("document.getElementById('scale').hidden"));
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// The slider of a file goes to the nearest moment that it holds, and needs no server for that.
#[test]
fn a_film_in_one_file_is_shown_at_its_moments() {
    let Some(browser) = Browser::start("a_film_in_one_file") else { return };
    let mut scene = cloud(60, 0, 1);
    let mut moment = |x: f32| {
        scene.means.iter_mut().for_each(|mean| mean[0] += x);
        scene.clone()
    };
    let moments = [moment(0.0), moment(0.25), moment(0.5)];
    browser.open_page(&Written::film(&moments).address());
    browser.value("splatweaver.selection.change((flag, i) => (i < 5 ? 2 : 0))");
    for (time, shown) in [("0.6", 1), ("1", 2), ("0.1", 0)] {
        browser.value(&format!("(() => {{ const t = document.getElementById('time'); t.value = {time}; t.dispatchEvent(new Event('input')); }})()"));
        let at = moments[shown].means[0][0];
        browser.wait(&format!("Math.abs(splatweaver.scene.means[0] - {at}) < 1e-3"));
    }
    assert_eq!(browser.number("splatweaver.selection.count(2)"), 5.0);
    browser.press(&["t"]);
    browser.wait("document.getElementById('play').getAttribute('aria-pressed') === 'true'");
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn every_mode_draws_something_else() {
    let Some(browser) = Browser::start("every_mode") else { return };
    let scene = cloud(800, 1, 1);
    browser.open_page(&Written::page(&scene, Look::default(), &[], false).address());
    let mut seen = Vec::new();
    let sum = "splatweaver.renderer.pixels(splatweaver.canvas.width, splatweaver.canvas.height).reduce((a, x, i) => (a * 31 + x) % 1000000007, 7)";
    for key in ["1", "2", "3", "4", "5"] {
        browser.press(&[key]);
        browser.wait(QUIET);
        seen.push(browser.number(sum));
    }
    browser.press(&["1"]);
    for id in ["degree", "exposure", "background"] {
        let value = ["0", "1.5", "#204060"]
            [["degree", "exposure", "background"].iter().position(|other| *other == id).unwrap()];
        browser.value(&format!("(() => {{ const e = document.getElementById('{id}'); e.value = '{value}'; e.dispatchEvent(new Event('input')); }})()"));
        browser.wait(QUIET);
        seen.push(browser.number(sum));
    }
    let mut distinct = seen.clone();
    distinct.sort_by(f64::total_cmp);
    distinct.dedup();
    assert_eq!(distinct.len(), seen.len(), "{seen:?}");
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// Promise (scenes): deleted Gaussians are not in the file; undone deletions are there to the bit.
#[test]
fn deletions_are_not_saved_and_come_back() {
    let Some(browser) = Browser::start("what_is_deleted") else { return };
    browser.resize(900, 600, false);
    let scene = cloud(400, 2, 4);
    browser.open_page(&Written::page(&scene, Look::default(), &[], true).address());
    browser.press(&["b"]);
    browser.drag([250, 150], [450, 450]);
    let selected = browser.number("splatweaver.selection.count(1)");
    assert!(selected > 20.0 && selected < 380.0, "{selected}");
    browser.press(&["x"]);
    assert_eq!(browser.number("splatweaver.selection.count(2)"), selected);
    browser.press(&["u", "r"]);
    browser.drag([300, 200], [380, 300]);
    let brushed = browser.number("splatweaver.selection.count(1)");
    assert!(brushed > 0.0 && brushed < selected, "{brushed}");
    browser.press(&["\u{e017}"]);
    let shown = browser.text("document.getElementById('selected').textContent");
    assert_eq!(shown, format!("{brushed} deleted"));
    let file = |browser: &Browser| {
        let blob = "splatweaver.background.call('ply', { dropped: splatweaver.selection.deleted() })";
        let text = browser.awaited(&format!(
            "{blob}.then(async ({{ blob }}) => btoa(String.fromCharCode(...new Uint8Array(await blob.arrayBuffer()))))"
        ));
        read_gaussians_from(&STANDARD.decode(text.as_str().unwrap()).unwrap(), "ply".parse().unwrap()).unwrap()
    };
    let kept = file(&browser);
    assert_eq!(kept.len(), 400 - brushed as usize);
    assert!(kept.means.iter().all(|mean| scene.means.contains(mean)));
    browser.value("splatweaver.history.undo()");
    assert!(file(&browser) == scene, "every bit is as it was");
    browser.value("splatweaver.history.redo()");
    assert_eq!(browser.number("splatweaver.selection.count(4)"), brushed);
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn a_phone_has_room_for_everything() {
    let Some(browser) = Browser::start("a_phone") else { return };
    browser.resize(360, 640, true);
    let scene = cloud(400, 1, 1);
    browser.open_page(&Written::page(&scene, Look::default(), &shots(), false).address());
    assert!(browser.is("document.body.classList.contains('folded')"));
    assert!(browser.is("document.documentElement.scrollWidth <= 360"));
    browser.value("document.getElementById('menu').click()");
    browser.value("document.querySelectorAll('#panel details').forEach((part) => (part.open = true))");
    browser.press(&["o", "j", "j"]);
    let outside = "[...document.querySelectorAll('#panel :is(button, input, select, textarea, summary)')].filter((e) => e.offsetParent).filter((e) => { const b = e.getBoundingClientRect(); return b.left < 0 || b.right > 360; }).length";
    assert_eq!(browser.number(outside), 0.0);
    let small = "[...document.querySelectorAll('#panel :is(button, select, summary, input[type=text])')].filter((e) => e.offsetParent && e.getBoundingClientRect().height < 44).length";
    assert_eq!(browser.number(small), 0.0);
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn everything_that_can_be_operated_has_a_name() {
    let Some(browser) = Browser::start("everything_that_can_be_operated") else { return };
    let scene = cloud(100, 1, 1);
    browser.open_page(&Written::page(&scene, Look::default(), &shots(), false).address());
    browser.press(&["o", "j", "j"]);
    let nameless = "[...document.querySelectorAll('button, input, select, textarea, summary, ul.rows, ol.rows, canvas[tabindex], dialog, nav, aside')].filter((e) => !(e.getAttribute('aria-label') || e.labels?.length || e.textContent.trim())).map((e) => e.id)";
    assert_eq!(browser.value(nameless), serde_json::json!([]));
    browser.press(&["?"]);
    assert!(browser.is("document.getElementById('help').open"));
    browser.value("document.querySelector('#help button').click()");
    browser.wait("!document.getElementById('help').open");
    assert_eq!(browser.errors(), Vec::<String>::new());
}
