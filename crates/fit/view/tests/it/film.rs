//! A camera path of keyframes.

use crate::browser::Browser;
use crate::page::QUIET;
use crate::pages::Written;
use crate::scenes::{camera, cloud};
use weaver_geometry::glam::DVec3;
use weaver_io::Transforms;
use weaver_scene::Keyframes;
use weaver_view::{Look, Shot};

const STATUS: &str = "document.getElementById('status').textContent";

fn page(browser: &Browser) -> Written {
    browser.resize(900, 600, false);
    let shots = [Shot::new("photo", camera([0.2, -0.5, -2.6], 320, 240))];
    let written = Written::page(&cloud(300, 1, 2), Look::default(), &shots, false);
    browser.open_page(&written.address());
    written
}

/// Three keys, with a drag before each.
fn keys(browser: &Browser) {
    for by in [0, 90, -160] {
        browser.drag([300, 300], [300 + by, 300 + by / 3]);
        browser.press(&["w", "j"]);
        browser.wait(QUIET);
    }
}

/// Promise (scenes): the film of `render --path` has the poses that the page plays.
#[test]
fn a_film_has_the_poses_of_the_page() {
    let Some(browser) = Browser::start("a_film_has_the_poses") else { return };
    let _page = page(&browser);
    keys(&browser);
    browser.fill("document.querySelectorAll('#path-keys input')[1]", "0.7");
    let exported = browser.downloaded("path.json", || browser.click_on("document.getElementById('export-path')"));
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("path.json");
    std::fs::write(&file, exported).unwrap();
    let film = Keyframes::new(&Transforms::read_cameras(&file).unwrap().frames).unwrap();
    assert!((film.seconds() - 2.7).abs() < 1e-9);
    assert_eq!(browser.text("document.getElementById('path-length').textContent"), "3 keys, 2.7 seconds.");
    for i in 0..=27 {
        let t = 0.1 * f64::from(i);
        let shown = browser.value(&format!("splatweaver.keyframes.path().at({t})"));
        let vector = |key: &str| DVec3::from([0, 1, 2].map(|j| shown[key][j].as_f64().unwrap()));
        let ours = film.at(t);
        assert!(ours.pose.center().distance(vector("eye")) < 1e-9, "{t}");
        for (row, key) in ["right", "down", "forward"].iter().enumerate() {
            assert!(ours.pose.rotation.row(row).distance(vector(key)) < 1e-9, "{t}: {key}");
        }
        let focal = shown["focal"].as_f64().unwrap();
        assert!((ours.intrinsics.fx / ours.width as f64 - focal).abs() < 1e-9, "{t}");
        // The page shows this pose.
        browser.value(&format!("splatweaver.viewpoint.along(splatweaver.keyframes.path().at({t}))"));
        let eye = browser.value("splatweaver.camera(1).eye");
        assert!((eye[0].as_f64().unwrap() - ours.pose.center().x).abs() < 1e-9);
    }
    assert_eq!(browser.errors(), Vec::<String>::new());
}

#[test]
fn keys_are_moved_removed_played_and_read_back() {
    let Some(browser) = Browser::start("keys_are_moved") else { return };
    let _page = page(&browser);
    browser.press(&["0"]);
    assert!(browser.text(STATUS).contains("two keys"));
    keys(&browser);
    let views = |browser: &Browser| browser.value("splatweaver.notes.state.keys.map((key) => key.view)");
    let first = views(&browser);
    browser.click_on("document.querySelectorAll('#path-keys li')[0].querySelectorAll('button')[2]");
    let moved = views(&browser);
    assert_eq!((&moved[0], &moved[1]), (&first[1], &first[0]));
    browser.control("z");
    assert_eq!(views(&browser), first);
    for wrong in ["0", "-1", "x"] {
        browser.fill("document.querySelector('#path-keys input')", wrong);
        assert!(browser.text(STATUS).contains("above 0"), "{wrong}");
        assert_eq!(browser.number("splatweaver.notes.state.keys[0].seconds"), 2.0);
    }
    browser.fill("document.querySelector('#path-keys input')", "0.3");
    browser.fill("document.querySelectorAll('#path-keys input')[1]", "0.3");
    let json = browser.text("JSON.stringify(splatweaver.keyframes.file())");
    browser.value("splatweaver.canvas.focus()");
    browser.press(&["0"]);
    let last = "splatweaver.viewpoint.ofText(splatweaver.notes.state.keys[2].view).eye";
    browser.wait(&format!(
        "!splatweaver.travel && {last}.every((x, i) => Math.abs(x - splatweaver.viewpoint.eye[i]) < 1e-4)"
    ));
    browser.click_on("document.querySelectorAll('#path-keys li')[0].lastElementChild");
    assert_eq!(browser.number("splatweaver.notes.state.keys.length"), 2.0);
    let take = |text: &str| {
        let text = serde_json::to_string(text).unwrap();
        browser.value(&format!("splatweaver.keyframes.take('path.json', {text})"));
        browser.text(STATUS)
    };
    assert_eq!(take(&json), "3 keys of path.json.");
    let near = |a: &serde_json::Value, b: &serde_json::Value| {
        let numbers = |v: &serde_json::Value| {
            v.as_str().unwrap().split(',').map(|x| x.parse::<f64>().unwrap()).collect::<Vec<_>>()
        };
        // Eyes, the direction and the lens; the target's distance is not in a file.
        numbers(a)[..3].iter().zip(&numbers(b)[..3]).all(|(a, b)| (a - b).abs() < 1e-4)
    };
    let read = views(&browser);
    assert!((0..3).all(|i| near(&read[i], &first[i])), "{read} and {first}");
    let one = |time: &str, matrix: &str| {
        format!(r#"{{"file_path":"k","time":{time},"w":4,"h":3,"fl_x":4,"transform_matrix":{matrix}}}"#)
    };
    let unit = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
    let file = |frames: &[String]| format!(r#"{{"frames":[{}]}}"#, frames.join(","));
    for (text, said) in [
        ("{\"frames\": [".to_string(), "expected JSON"),
        (file(&[one("NaN", unit)]), "expected JSON"),
        ("[]".to_string(), "frames: expected a list"),
        (file(&[one("0", unit)]), "at least two keys, found 1"),
        (file(&[one("0", unit), one("0", unit)]), "frames[1].time: expected a time after 0, found 0"),
        (file(&[one("0", unit), one("null", unit)]), "frames[1].time: expected a time in seconds"),
        (file(&[one("0", unit), one("1", "[[1,0,0]]")]), "frames[1].transform_matrix: expected 4 rows of 4 numbers"),
        (
            file(&[one("0", unit), one("1", &unit.replacen('1', "2", 1))]),
            "frames[1].transform_matrix: expected a rigid",
        ),
    ] {
        let status = take(&text);
        assert!(status.starts_with("path.json: ") && status.contains(said), "{text}: {status}");
        assert_eq!(views(&browser), read, "nothing changes");
    }
    assert_eq!(browser.errors(), Vec::<String>::new());
}
