use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use weaver_io::{Background, Image};
use weaver_run::{Page, Span};

#[test]
fn everything_is_escaped() {
    let hostile = "<script>alert(\"1 & 2\")</script>";
    let mut page = Page::new(hostile);
    page.heading(2, hostile).paragraph(hostile).spans(&[Span::Plain(hostile), Span::Bold(hostile)]).warning(hostile);
    page.preformatted(hostile).table(&[hostile], &[[hostile]]).curve(hostile, [(1, 2.0)]);
    let image = Image::filled(1, 1, [0.5; 3]);
    page.picture(hostile, &image).link(hostile, hostile);
    page.comparison(hostile, [(hostile, &image), (hostile, &image)]).unwrap();
    let html = page.html();
    assert_eq!(html.matches("<script").count(), 1, "{html}");
    // Title, heading, paragraph, two spans, warning, preformatted, two cells, curve, a picture's text and caption, a
    // link's text and place, and of a comparison the names beside and within pictures, both in the slider's, and the
    // caption there and below.
    assert_eq!(html.matches("&lt;script&gt;alert(&quot;1 &amp; 2&quot;)&lt;/script&gt;").count(), 22, "{html}");
}

#[test]
fn parts_stand_in_the_order_in_which_they_were_added() {
    let mut page = Page::new("t");
    page.heading(1, "a").spans(&[Span::Plain("b "), Span::Bold("c")]).preformatted("d\n e");
    page.table(&["view", "PSNR"], &[vec!["x".to_string(), "1.5".to_string()]]).heading(2, "f");
    let body = "<body><h1>a</h1><p>b <b>c</b></p><pre>d\n e</pre>\
                <div class=\"table\"><table><tr><th>view</th><th>PSNR</th></tr><tr><td>x</td><td>1.5</td></tr></table></div>\
                <h2 id=\"section-1\">f</h2></body>";
    assert!(page.html().contains(body), "{}", page.html());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    page.write(&path).unwrap();
    assert_eq!(std::fs::read_to_string(&path).unwrap(), page.html());
}

/// The picture inside a page, as a file would have it.
fn embedded(page: &Page) -> Vec<u8> {
    let html = page.html();
    let data = html.split("data:image/png;base64,").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
    STANDARD.decode(data).unwrap()
}

#[test]
fn pictures_of_files_and_from_memory_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("step-20.png");
    let image = Image::from_bytes(2, 1, &[0, 50, 100, 150, 200, 250]);
    image.write_png(&path).unwrap();
    let (mut of_file, mut from_memory) = (Page::new("t"), Page::new("t"));
    of_file.picture_file(&path).unwrap();
    from_memory.picture("step-20", &image);
    assert_eq!(of_file.html(), from_memory.html());
    let copy = folder.path().join("copy.png");
    std::fs::write(&copy, embedded(&of_file)).unwrap();
    assert_eq!(Image::read(&copy, Background::White).unwrap(), image);
}

#[test]
fn a_picture_that_is_none_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let mut page = Page::new("t");
    let message = page.picture_file(&path).unwrap_err().to_string();
    assert!(message.contains("a.png"), "{message}");
    std::fs::write(&path, "text").unwrap();
    let message = page.picture_file(&path).unwrap_err().to_string();
    assert!(message.contains("a.png: signature: expected a PNG image"), "{message}");
    assert_eq!(page.html(), Page::new("t").html());
}

/// The corners of the line, and the caption, of a page with one curve.
fn curve(points: &[(usize, f64)]) -> (Vec<[f64; 2]>, String) {
    let mut page = Page::new("t");
    page.curve("c", points.iter().copied());
    let html = page.html();
    let between =
        |start: &str, end: &str| html.split(start).nth(1).and_then(|s| s.split(end).next()).unwrap_or("").to_string();
    let corners = between(" points=\"", "\"");
    let corners = corners.split_whitespace().map(|pair| {
        let (x, y) = pair.split_once(',').unwrap();
        [x, y].map(|number| number.parse().unwrap())
    });
    (corners.collect(), between("<figcaption>", "</figcaption>"))
}

/// A curve of powers is a line on its logarithmic axis.
#[test]
fn powers_are_a_line_on_a_logarithmic_axis() {
    let (corners, caption) = curve(&[(10, 1.0), (20, 0.1), (30, f64::NAN), (30, 0.01)]);
    assert_eq!(corners, [[0.0, 0.0], [200.0, 70.0], [400.0, 140.0]]);
    assert_eq!(caption, "c (last 0.0100, log axis)");
}

#[test]
fn a_curve_that_touches_zero_has_a_linear_axis() {
    let (corners, caption) = curve(&[(0, 0.0), (1, 3.0), (4, 4.0)]);
    assert_eq!(corners, [[0.0, 140.0], [100.0, 35.0], [400.0, 0.0]]);
    assert_eq!(caption, "c (last 4)");
}

/// Decibels that hardly change are no matter of powers of ten; whole numbers have no digits behind the point.
#[test]
fn a_curve_of_similar_values_has_a_linear_axis() {
    let (corners, caption) = curve(&[(0, 10.0), (1, 30.0), (2, 20.0)]);
    assert_eq!((corners[2][1], caption.as_str()), (70.0, "c (last 20)"));
}

#[test]
fn curves_without_extent_are_drawn_or_left_out() {
    assert_eq!(curve(&[(7, 2.0)]).0, [[0.0, 140.0]]);
    assert_eq!(curve(&[(7, 2.0), (8, 2.0)]).0, [[0.0, 140.0], [400.0, 140.0]]);
    let mut page = Page::new("t");
    page.curve("none", []).curve("nothing finite", [(1, f64::INFINITY)]);
    assert_eq!(page.html(), Page::new("t").html());
}

/// Promise of `logs_and_report_say_what_happened`.
#[test]
fn a_curve_has_numbers_at_the_ends_of_its_axes() {
    let mut page = Page::new("t");
    page.curve("loss", [(10, 0.5), (20, 0.00002), (250, 12.5)]);
    let html = page.html();
    for number in [">12.50</text>", ">2.0e-5</text>", ">10</text>", ">250</text>"] {
        assert!(html.contains(number), "{number}: {html}");
    }
    assert_eq!(html.matches("<text").count(), 4);
}

#[test]
fn warnings_and_contents_stand_at_the_top() {
    let mut page = Page::new("t");
    page.heading(1, "a").heading(2, "b").heading(2, "c").heading(2, "d").paragraph("text");
    assert!(!page.html().contains("<nav"));
    page.heading(2, "e").warning("mind this");
    let html = page.html();
    let at = |text: &str| html.find(text).unwrap_or_else(|| panic!("{text} in {html}"));
    let places =
        ["<p class=\"warning\"", "<h1>a", "<nav", "<a href=\"#section-4\">e</a>", "<h2 id=\"section-1\">b", "<p>text"]
            .map(at);
    assert!(places.is_sorted(), "{places:?}");
}

#[test]
fn only_what_moves_has_a_script() {
    let mut page = Page::new("t");
    page.heading(1, "a").table(&["b"], &[["c"]]).picture("d", &Image::filled(2, 2, [0.5; 3]));
    assert!(!page.html().contains("<script"));
    page.curve("loss", [(1, 2.0), (2, 1.0)]);
    assert!(page.html().contains("data-points=\"[[1,2.0],[2,1.0]]\""));
    assert!(page.html().contains("<script type=\"module\">"));
}
