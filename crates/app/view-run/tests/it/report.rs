//! Reports of runs in a browser.

use crate::browser::Browser;
use weaver_io::Image;
use weaver_run::Page;

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
