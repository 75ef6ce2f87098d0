//! Pages that are damaged, full of odd names, or opened by browsers that cannot draw.

use crate::browser::Browser;
use crate::pages::Written;
use crate::scenes::{camera, cloud};
use proptest::prelude::*;
use weaver_view::{HtmlOptions, Look, Shot, Subject, html};

const ODD: &str =
    "</script><script>document.title='taken'</script><img src=x onerror=\"document.title='taken'\">{{scene}}&amp;'\"";

fn shots(names: &[&str]) -> Vec<Shot> {
    let shot = |(i, name): (usize, &&str)| Shot {
        held_out: i == 0,
        coverage: (i > 0).then_some(0.4),
        ..Shot::new(*name, camera([0.4 * i as f64, -0.3, -2.6], 320, 240))
    };
    names.iter().enumerate().map(shot).collect()
}

/// Promise (scenes): names are shown as text; a truncated file is reported; a browser without WebGL 2 shows a
/// picture.
#[test]
fn names_of_any_kind_are_shown_as_text() {
    let Some(browser) = Browser::start("names_of_any_kind") else { return };
    let scene = cloud(50, 0, 1);
    let subject = Subject { title: ODD, gaussians: &scene, look: Look::default(), notes: None, second: None };
    let written = Written::text(&html(&subject, &shots(&[ODD, "b"]), HtmlOptions::default()).unwrap());
    browser.open_page(&written.address());
    assert_eq!(browser.text("document.title"), ODD);
    assert_eq!(browser.text("document.querySelector('h1').textContent"), ODD);
    assert_eq!(browser.text("document.querySelector('#strip span').textContent"), ODD.split('/').next_back().unwrap());
    assert_eq!(browser.number("document.querySelectorAll('script').length"), 3.0);
}

/// Promise of `names_of_any_kind_are_shown_as_text`.
#[test]
fn a_page_that_was_cut_off_says_so() {
    let Some(browser) = Browser::start("a_page_that_was_cut_off") else { return };
    let scene = cloud(500, 1, 1);
    let subject = Subject { title: "scene", gaussians: &scene, look: Look::default(), notes: None, second: None };
    let page = html(&subject, &[], HtmlOptions::default()).unwrap();
    let start = page.find(" id=\"scene\"").unwrap();
    for share in [0.3, 0.9] {
        let written = Written::text(&page[..start + (share * (page.len() - start) as f64) as usize]);
        browser.open(&written.address());
        browser.wait("document.body.classList.contains('failed')");
        let status = browser.text("document.getElementById('status').textContent");
        assert!(status.contains("incomplete"), "{status}");
    }
    // Before the scripts: the words that stand there from the start.
    let scripts = page.find("<script type=\"text/plain\"").unwrap();
    browser.open(&Written::text(&page[..scripts]).address());
    let status = browser.text("document.getElementById('status').textContent");
    assert!(status.contains("incomplete"), "{status}");
}

/// A browser without WebGL shows a picture and a sentence.
///
/// Promise of `names_of_any_kind_are_shown_as_text`.
#[test]
fn a_browser_without_webgl_shows_a_picture() {
    let flags = ["--disable-gpu", "--disable-software-rasterizer", "--disable-3d-apis"];
    let Some(browser) = Browser::with("a_browser_without_webgl", &flags) else { return };
    let scene = cloud(500, 1, 1);
    let written = Written::page(&scene, Look::default(), &[], false);
    browser.open(&written.address());
    browser.wait("document.getElementById('status').textContent.includes('WebGL2')");
    assert!(
        browser
            .is("document.getElementById('poster').naturalWidth === 640 && !document.getElementById('poster').hidden")
    );
}

#[test]
fn the_same_arguments_give_the_same_bytes() {
    let scene = cloud(200, 2, 5);
    let subject = Subject { title: "scene", gaussians: &scene, look: Look::default(), notes: None, second: None };
    for lossless in [false, true] {
        let page = || html(&subject, &shots(&["a", "b"]), HtmlOptions { lossless }).unwrap();
        assert!(page() == page());
    }
}

#[test]
fn a_scene_of_nothing_has_a_page() {
    let nothing = weaver_scene::Gaussians::default();
    let subject = Subject { title: "nothing", gaussians: &nothing, look: Look::default(), notes: None, second: None };
    assert!(html(&subject, &[], HtmlOptions::default()).is_ok());
    let lame = weaver_scene::Gaussians { means: vec![[0.0; 3]], ..nothing };
    let subject = Subject { title: "lame", gaussians: &lame, look: Look::default(), notes: None, second: None };
    assert!(html(&subject, &[], HtmlOptions::default()).is_err());
}

/// Promise of `a_rounded_scene_is_what_its_file_is`.
#[test]
fn what_rounding_would_tear_apart_is_kept_as_it_is() {
    let near = cloud(300, 1, 1);
    let size = |scene: &weaver_scene::Gaussians, lossless: bool| {
        let subject = Subject { title: "scene", gaussians: scene, look: Look::default(), notes: None, second: None };
        html(&subject, &[], HtmlOptions { lossless }).unwrap().len()
    };
    assert!(size(&near, false) + 20_000 < size(&near, true));
    for far in [3e5, 3.3e7] {
        let mut scene = near.clone();
        scene.means[7] = [0.0, far, 0.0];
        assert_eq!(size(&scene, false), size(&scene, true), "one Gaussian at {far}");
    }
    let mut small = near.clone();
    small.means.as_flattened_mut().iter_mut().for_each(|x| *x *= 1e-3);
    small.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s -= 1e3_f32.ln());
    assert_eq!(size(&small, false), size(&small, true));
}

/// Promise (fits): a scene in units so small that the rounding format has no place for its positions has a page,
/// which keeps it as it is.
#[test]
fn scenes_of_any_unit_have_a_page() {
    let near = cloud(300, 1, 1);
    for unit in [1e6_f32, 1e7, 1e12] {
        let mut large = near.clone();
        large.means.as_flattened_mut().iter_mut().for_each(|x| *x *= unit);
        large.log_scales.as_flattened_mut().iter_mut().for_each(|s| *s += unit.ln());
        let subject = Subject { title: "scene", gaussians: &large, look: Look::default(), notes: None, second: None };
        let page = |lossless| html(&subject, &[], HtmlOptions { lossless }).unwrap();
        // Every coordinate is below the limit of the format times three.
        assert_eq!(page(false) == page(true), unit > 3e6, "{unit}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 8))]

    /// No name ends an element, fills a place of the template or adds an element.
    #[test]
    fn no_name_changes_the_page(title in ".{0,40}", name in "[<>/!a-z{}\"'-]{0,30}") {
        let scene = cloud(3, 0, 1);
        let of = |title: &str, name: &str| {
            let subject = Subject { title, gaussians: &scene, look: Look::default(), notes: None, second: None };
            html(&subject, &shots(&[name]), HtmlOptions::default()).unwrap()
        };
        let (plain, odd) = (of("t", "n"), of(&title, &name));
        for tag in ["<script", "</script", "<img", "<!--", "<style"] {
            prop_assert_eq!(plain.matches(tag).count(), odd.matches(tag).count(), "{}", tag);
        }
    }
}
