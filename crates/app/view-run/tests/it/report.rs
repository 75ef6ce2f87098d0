//! Reports of runs in a browser.

use crate::browser::Browser;
use crate::server::{here, scene_page};
use weaver_io::Image;
use weaver_run::Page;
use weaver_view_run::{ScenePage, Server};

#[test]
fn a_report_compares_pictures_and_reads_curves() {
    let Some(browser) = Browser::start("a_report_compares") else { return };
    browser.resize(900, 700, false);
    let mut page = Page::new("report");
    let [photo, render] = [[0.8, 0.2, 0.1], [0.1, 0.3, 0.8]].map(|color| Image::filled(320, 200, color));
    page.heading(1, "Report").curve("loss", (0..50).map(|step| (step * 10, 1.0 / (step + 1) as f64)));
    page.comparison("a.jpg: 20 dB", [("photo", &photo), ("render", &render)]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    page.write(folder.path().join("report.html")).unwrap();
    browser.open(&format!("file://{}", folder.path().join("report.html").display()));
    let shown = "getComputedStyle(document.querySelector('.compare img + img')).clipPath";
    let before = browser.text(shown);
    browser.value("document.querySelector('.compare input').focus()");
    browser.press(&["\u{e014}", "\u{e014}", "\u{e014}"]);
    assert_ne!(browser.text(shown), before);
    let value = browser.text(
        "(() => { const svg = document.querySelector('svg'); const box = svg.getBoundingClientRect(); \
         svg.dispatchEvent(new PointerEvent('pointermove', { clientX: box.left + box.width / 2, clientY: box.top + 20 })); \
         return document.querySelector('.curve figcaption').textContent; })()",
    );
    assert!(value.starts_with("loss: 0.0") && value.contains(" at step 2"), "{value}");
    browser.resize(360, 640, true);
    assert!(browser.is("document.documentElement.scrollWidth <= 360"));
    assert_eq!(browser.errors(), Vec::<String>::new());
}

/// The viewer within a report draws, takes part once it is clicked, and does so too where a server sends the report.
#[test]
fn a_report_has_the_scene_within() {
    let Some(browser) = Browser::start("a_report_has_the_scene") else { return };
    browser.resize(900, 700, false);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("report.html");
    let view = scene_page(None).html(Default::default()).unwrap();
    Page::new("report").heading(1, "Report").embed("Look at the scene", "view.html", &view).write(&file).unwrap();
    let shown = ScenePage { report: Some(file.clone()), ..scene_page(None) };
    let server = Server::new(&shown, None, here()).unwrap();
    let (start, token) = server.address().split_once("/?").map(|(a, b)| (a.to_string(), b.to_string())).unwrap();
    server.during(|| {
        for address in [format!("file://{}", file.display()), format!("{start}/report?{token}")] {
            browser.open(&address);
            browser.frame(true);
            browser.wait("document.getElementById('view')?.classList.contains('shown')");
            browser.frame(false);
            assert!(browser.is("document.querySelector('iframe').inert"));
            browser.value("document.querySelector('figure.embed button').click()");
            assert!(
                browser.is("!document.querySelector('iframe').inert && !document.querySelector('figure.embed button')")
            );
        }
    });
    assert_eq!(browser.errors(), Vec::<String>::new());
}
