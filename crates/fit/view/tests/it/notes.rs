//! Notes on a scene: lengths, the scale, the ground, viewpoints.

use crate::browser::Browser;
use crate::page::QUIET;
use crate::pages::Written;
use crate::scenes::{camera, cloud, floor};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DQuat, DVec3};
use weaver_io::read_gaussians_from;
use weaver_view::{Look, Shot};

const STATUS: &str = "document.getElementById('status').textContent";
const UNDO: &str = "z";

/// A page that looks down at a floor tilted by an angle.
fn look_down(browser: &Browser, tilt: f64) -> Written {
    browser.resize(900, 600, false);
    let shots = [-0.3, 0.3].map(|x| Shot::new("photo", camera([x, -1.3, -2.2], 320, 240)));
    let written = Written::page(&floor(tilt), Look::default(), &shots, true);
    browser.open_page(&written.address());
    written
}

/// The point of the floor at a pixel of the page.
fn on_floor(browser: &Browser, [x, y]: [i32; 2], normal: DVec3) -> DVec3 {
    let camera = browser.value("splatweaver.camera(1)");
    let number = |key: &str, i: usize| camera[key][i].as_f64().unwrap();
    let row = |i: usize| DVec3::new(number("A", 3 * i), number("A", 3 * i + 1), number("A", 3 * i + 2));
    let (u, v) = (
        (f64::from(x) + 0.5 - number("K", 2)) / number("K", 0),
        (f64::from(y) + 0.5 - number("K", 3)) / number("K", 1),
    );
    let (eye, ray) =
        (DVec3::new(number("eye", 0), number("eye", 1), number("eye", 2)), u * row(0) + v * row(1) + row(2));
    eye - ray * (eye.dot(normal) / ray.dot(normal))
}

/// Opens the address of a page again once it has kept everything.
fn again(browser: &Browser) {
    // It is written a moment after the last change.
    browser.wait("new URLSearchParams(location.hash.slice(1)).get('notes') === splatweaver.notes.toText()");
    let address = browser.text("location.href");
    browser.open("about:blank");
    browser.open_page(&address);
}

/// Promise (scenes): a length between two clicked points is that of the surface; a true length sets the scale.
#[test]
fn two_clicks_measure_a_length_and_set_the_scale() {
    let Some(browser) = Browser::start("two_clicks_measure") else { return };
    let _page = look_down(&browser, 0.0);
    assert!(browser.is("document.getElementById('scale').hidden"));
    let ends = [[250, 300], [560, 370]];
    let expected = on_floor(&browser, ends[0], DVec3::Y).distance(on_floor(&browser, ends[1], DVec3::Y));
    browser.press(&["g"]);
    ends.iter().for_each(|end| browser.click(*end, 1));
    let row = "document.querySelector('#lengths button').textContent";
    let (number, unit) =
        browser.text(row).split_once(' ').map(|(n, u)| (n.parse::<f64>().unwrap(), u.to_string())).unwrap();
    // A pixel's depth is a mean of those of centers: off by less than a standard deviation.
    assert!((number - expected).abs() < 0.04 && unit == "units", "{number} {unit}, expected {expected}");
    // Where nothing is, there is no point.
    browser.click([300, 20], 1);
    assert!(browser.text(STATUS).contains("Nothing is there"));
    // A drag still turns the view.
    let before = browser.text("splatweaver.viewpoint.toText()");
    browser.drag([300, 300], [340, 320]);
    assert_ne!(browser.text("splatweaver.viewpoint.toText()"), before);
    assert_eq!(browser.number("splatweaver.notes.state.lengths.length"), 1.0);
    for wrong in ["0", "-2", "two", "1e999", " "] {
        browser.fill("document.getElementById('known')", wrong);
        assert!(browser.text(STATUS).contains("above 0"), "{wrong}");
        assert!(browser.is("splatweaver.notes.state.meters === null"), "{wrong}");
    }
    browser.fill("document.getElementById('known')", "2.5");
    assert_eq!(browser.text(row), "2.5 m");
    assert!(browser.is("!document.getElementById('scale').hidden"));
    assert!(browser.text("document.getElementById('meters').textContent").starts_with("A unit is "));
    browser.click_on("document.querySelectorAll('#lengths button')[1]");
    assert_eq!(browser.number("splatweaver.notes.state.lengths.length"), 0.0);
    browser.control(UNDO);
    assert_eq!(browser.text(row), "2.5 m");
    again(&browser);
    assert_eq!(browser.text(row), "2.5 m");
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn enter_takes_the_point_in_the_middle() {
    let Some(browser) = Browser::start("enter_takes_the_point") else { return };
    let _page = look_down(&browser, 0.0);
    browser.value("splatweaver.canvas.focus()");
    browser.press(&["g", "\u{e007}", "a", "\u{e007}"]);
    browser.wait("document.querySelectorAll('#lengths li').length === 1");
    assert!(
        browser
            .is("splatweaver.notes.state.lengths[0][0].some((x, i) => x !== splatweaver.notes.state.lengths[0][1][i])")
    );
}

/// Promise (scenes): three points level the ground; a turned file is the scene turned by the same rotation.
#[test]
fn three_clicks_level_the_ground() {
    let Some(browser) = Browser::start("three_clicks_level") else { return };
    let tilt = 0.3;
    let _page = look_down(&browser, tilt);
    let normal = DMat3::from_rotation_z(tilt) * DVec3::NEG_Y;
    let up = |browser: &Browser| {
        let up = browser.value("splatweaver.viewpoint.up");
        DVec3::from([0, 1, 2].map(|i| up[i].as_f64().unwrap()))
    };
    let before = up(&browser);
    browser.press(&["y"]);
    [[250, 330], [350, 330], [450, 330]].iter().for_each(|place| browser.click(*place, 1));
    assert!(browser.text(STATUS).contains("on a line"), "{}", browser.text(STATUS));
    assert!(browser.is("splatweaver.notes.state.up === null && splatweaver.toolName === 'ground'"));
    assert!(up(&browser).distance(before) < 1e-12);
    [[250, 330], [550, 330], [400, 260]].iter().for_each(|place| browser.click(*place, 1));
    assert!(up(&browser).distance(normal) < 0.01, "{} and {normal}", up(&browser));
    let tilted = "splatweaver.viewpoint.right.reduce((sum, x, i) => sum + x * splatweaver.viewpoint.up[i], 0)";
    assert!(browser.number(tilted).abs() < 1e-9);
    browser.control(UNDO);
    assert!(up(&browser).distance(before) < 1e-9);
    browser.control("y");
    assert!(up(&browser).distance(normal) < 0.01);
    again(&browser);
    assert!(up(&browser).distance(normal) < 0.01);
    let file = |browser: &Browser| {
        let bytes = browser.downloaded("scene.ply", || browser.click_on("document.getElementById('ply')"));
        read_gaussians_from(&bytes, "ply".parse().unwrap()).unwrap()
    };
    let scene = floor(tilt);
    assert!(file(&browser) == scene, "without the tick the file is as it was");
    browser.click_on("document.querySelector('#measuring summary')");
    browser.click_on("document.getElementById('turn-saved')");
    let rotation = DMat3::from_quat(DQuat::from_rotation_arc(up(&browser), DVec3::NEG_Y));
    let expected = scene.transformed(&Similarity { scale: 1.0, rotation, translation: DVec3::ZERO });
    let turned = file(&browser);
    let far = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(far(turned.means.as_flattened(), expected.means.as_flattened()) < 1e-5);
    assert!(far(turned.quats.as_flattened(), expected.quats.as_flattened()) < 1e-5);
    assert!(far(&turned.sh, &expected.sh) < 1e-5);
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// Harmonics of every degree turn as the scene does.
#[test]
fn harmonics_of_all_degrees_are_turned() {
    let Some(browser) = Browser::start("harmonics_of_all_degrees") else { return };
    for (degree, up) in [(4, DVec3::new(0.4, -0.5, 0.7)), (3, DVec3::Y), (0, DVec3::NEG_Y)] {
        let scene = cloud(40, degree, 5);
        browser.open_page(&Written::page(&scene, Look::default(), &[], true).address());
        let up = up.normalize();
        let blob = format!(
            "splatweaver.background.call('ply', {{ dropped: splatweaver.selection.deleted(), up: {:?} }})",
            up.to_array()
        );
        let text = browser.awaited(&format!(
            "{blob}.then(async ({{ blob }}) => btoa(String.fromCharCode(...new Uint8Array(await blob.arrayBuffer()))))"
        ));
        let bytes = STANDARD.decode(text.as_str().unwrap()).unwrap();
        let turned = read_gaussians_from(&bytes, "ply".parse().unwrap()).unwrap();
        let turn = if up == DVec3::Y {
            DQuat::from_rotation_x(std::f64::consts::PI)
        } else {
            DQuat::from_rotation_arc(up, DVec3::NEG_Y)
        };
        let to = Similarity { scale: 1.0, rotation: DMat3::from_quat(turn), translation: DVec3::ZERO };
        let expected = scene.transformed(&to);
        let most = turned.sh.iter().zip(&expected.sh).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let moved = turned
            .means
            .as_flattened()
            .iter()
            .zip(expected.means.as_flattened())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(most < 1e-5 && moved < 1e-5, "degree {degree}: {most}, {moved}");
    }
}

/// Promise (scenes): viewpoints with titles and texts are in the address and in the page that is saved.
#[test]
fn viewpoints_are_kept_presented_and_sent() {
    let Some(browser) = Browser::start("viewpoints_are_kept") else { return };
    let _page = look_down(&browser, 0.0);
    browser.press(&["o"]);
    browser.drag([300, 300], [400, 330]);
    browser.press(&["o"]);
    browser.wait(QUIET);
    let title = "</script><b>&amp; it's";
    browser.fill("document.getElementById('place-title')", title);
    assert_eq!(browser.text("document.querySelectorAll('#places button')[1].textContent"), title);
    browser.value("splatweaver.canvas.focus()");
    let near = |i: usize| {
        let eye = format!("splatweaver.viewpoint.ofText(splatweaver.notes.state.views[{i}].view).eye");
        format!("{eye}.every((x, i) => Math.abs(x - splatweaver.viewpoint.eye[i]) < 1e-4)")
    };
    for (key, at) in [("]", 0), ("]", 1), ("[", 0)] {
        browser.press(&[key]);
        browser.wait(&format!("!splatweaver.travel && {}", near(at)));
    }
    browser.press(&["."]);
    assert!(
        browser.is("!document.getElementById('card').hidden && document.getElementById('panel').offsetParent === null")
    );
    assert_eq!(browser.text("document.getElementById('card-number').textContent"), "1 of 2");
    browser.press(&["\u{e014}"]);
    assert_eq!(browser.text("document.getElementById('card-title').textContent"), title);
    browser.press(&["\u{e00c}"]);
    assert!(browser.is("document.getElementById('card').hidden"));
    let saved = browser.downloaded("view.html", || browser.click_on("document.getElementById('save-notes')"));
    again(&browser);
    assert_eq!(browser.text("splatweaver.notes.state.views[1].title"), title);
    let saved = Written::text(&String::from_utf8(saved).unwrap());
    browser.open("about:blank");
    browser.open_page(&saved.address());
    assert_eq!(browser.text("document.querySelectorAll('#places button')[1].textContent"), title);
    assert_eq!(browser.text("document.getElementById('count').textContent"), "3,721 Gaussians");
    // A saved page can be saved again.
    browser.click_on("document.getElementById('tour').firstElementChild");
    browser.click_on("document.querySelectorAll('#places button')[0]");
    browser.click_on("document.getElementById('place-remove')");
    let twice = browser.downloaded("view.html", || browser.click_on("document.getElementById('save-notes')"));
    let twice = Written::text(&String::from_utf8(twice).unwrap());
    browser.open_page(&twice.address());
    assert_eq!(browser.number("splatweaver.notes.state.views.length"), 1.0);
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn an_address_with_bad_notes_says_so() {
    let Some(browser) = Browser::start("an_address_with_bad_notes") else { return };
    let page = look_down(&browser, 0.0);
    for (notes, said) in [
        ("{", "cannot be read"),
        (r#"{"meters":-1}"#, "meters: expected a positive number"),
        (r#"{"keys":[{"view":"0"}]}"#, "keys[0]"),
        (r#"{"views":[null]}"#, "views[0]"),
    ] {
        browser.open("about:blank");
        browser.open_page(&format!("{}#notes={}", page.address(), notes.replace('{', "%7B").replace('"', "%22")));
        assert!(browser.text(STATUS).contains(said), "{notes}: {}", browser.text(STATUS));
        assert_eq!(browser.text("splatweaver.notes.toText()"), "");
    }
}
