//! A page in one file, without scripts or links, to open anywhere.

use crate::curve;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write;
use std::path::Path;
use weaver_io::{Error, Image, Result};

/// An HTML page that is built from top to bottom. Pictures are inside the file; all text is escaped.
///
/// ```
/// let mut page = weaver_run::Page::new("Run 7");
/// page.heading(1, "Run 7 < run 8").paragraph("Three views.");
/// page.table(&["view", "PSNR"], &[["000.png", "21.50"], ["008.png", "23.00"]]);
/// page.curve("loss", (0..100).map(|step| (step, 0.9_f64.powi(step as i32))));
/// assert!(page.html().contains("<h1>Run 7 &lt; run 8</h1><p>Three views.</p>"));
/// ```
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    body: String,
    tables: bool,
}

/// A part of a paragraph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Span<'a> {
    /// Text as it is.
    Plain(&'a str),
    /// Text in bold.
    Bold(&'a str),
}

const STYLE: &str =
    "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
pre{background:#f5f5f5;padding:1rem;overflow-x:auto;font-size:13px}
figure{display:inline-block;margin:.5rem 1rem .5rem 0;vertical-align:top}
figcaption{font-size:13px;color:#666}
img{image-rendering:pixelated;max-width:100%;min-width:28rem}
";

const TABLE_STYLE: &str = "table{border-collapse:collapse;font-size:13px}
th,td{padding:.2rem .8rem;text-align:right;border-bottom:1px solid #ddd}
th:first-child,td:first-child{text-align:left}
";

const WARNING_STYLE: &str = "border-left:.4rem solid #c60;background:#fff3e0;padding:.6rem 1rem";

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

impl Page {
    /// An empty page with this title, which the browser shows and the page does not.
    pub fn new(title: &str) -> Self {
        Self { title: escape(title), body: String::new(), tables: false }
    }

    /// Adds a heading of a level, 1 to 6.
    pub fn heading(&mut self, level: usize, text: &str) -> &mut Self {
        let level = level.clamp(1, 6);
        self.put(format_args!("<h{level}>{}</h{level}>", escape(text)))
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.spans(&[Span::Plain(text)])
    }

    /// Adds a paragraph of which parts are bold.
    pub fn spans(&mut self, spans: &[Span<'_>]) -> &mut Self {
        let texts = spans.iter().map(|span| match span {
            Span::Plain(text) => escape(text),
            Span::Bold(text) => format!("<b>{}</b>", escape(text)),
        });
        let text: String = texts.collect();
        self.put(format_args!("<p>{text}</p>"))
    }

    /// Adds a paragraph that stands out: what the reader must know before the rest.
    pub fn warning(&mut self, text: &str) -> &mut Self {
        self.put(format_args!("<p style=\"{WARNING_STYLE}\"><b>Warning:</b> {}</p>", escape(text)))
    }

    /// Adds text whose line breaks and spaces stay, in letters of one width.
    pub fn preformatted(&mut self, text: &str) -> &mut Self {
        self.put(format_args!("<pre>{}</pre>", escape(text)))
    }

    /// Adds a table: a row of names above the rows. The first column is aligned to the left, the others, usually numbers, to the
    /// right.
    pub fn table<T: AsRef<str>>(&mut self, header: &[&str], rows: &[impl AsRef<[T]>]) -> &mut Self {
        self.tables = true;
        let cell = |tag: &str, text: &str| format!("<{tag}>{}</{tag}>", escape(text));
        let head: String = header.iter().map(|name| cell("th", name)).collect();
        self.put(format_args!("<table><tr>{head}</tr>"));
        for row in rows {
            let cells: String = row.as_ref().iter().map(|text| cell("td", text.as_ref())).collect();
            self.put(format_args!("<tr>{cells}</tr>"));
        }
        self.put(format_args!("</table>"))
    }

    /// Adds a picture from a PNG file, whose bytes stay as they are; its caption is the file's name without extension.
    ///
    /// # Errors
    /// When the file cannot be read, or is no PNG file.
    pub fn picture_file(&mut self, path: impl AsRef<Path>) -> Result<&mut Self> {
        let path = path.as_ref();
        let bytes = weaver_io::read_bytes(path)?;
        if !bytes.starts_with(PNG) {
            let (place, expected, found) = ("signature".into(), "a PNG image".into(), "other bytes".into());
            return Err(Error::Invalid { path: path.into(), place, expected, found });
        }
        let name = path.file_stem().map_or(String::new(), |name| name.to_string_lossy().into_owned());
        Ok(self.put_picture(&name, &bytes))
    }

    /// Adds a picture from memory, as an 8-bit PNG.
    ///
    /// # Panics
    /// When the image has no pixels, or not `height * width * 3` values.
    pub fn picture(&mut self, caption: &str, image: &Image) -> &mut Self {
        self.put_picture(caption, &image.to_png())
    }

    fn put_picture(&mut self, caption: &str, png: &[u8]) -> &mut Self {
        let (caption, data) = (escape(caption), STANDARD.encode(png));
        self.put(format_args!(
            "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
        ))
    }

    /// Adds a small line chart of points (step, value) in order of their steps; adds nothing without points.
    ///
    /// Values that are not finite are left out. The axis is logarithmic if all values are positive.
    pub fn curve(&mut self, name: &str, points: impl IntoIterator<Item = (usize, f64)>) -> &mut Self {
        let Some((svg, logarithmic, last)) = curve::svg(points) else { return self };
        let axis = if logarithmic { ", log axis" } else { "" };
        let name = escape(name);
        self.put(format_args!("<figure>{svg}<figcaption>{name} (last {last:.4}{axis})</figcaption></figure>"))
    }

    /// Adds a line chart of several series of points (x, y), each in order of x, with their names beside it; adds nothing without points.
    ///
    /// ```
    /// let mut page = weaver_run::Page::new("Codecs");
    /// page.lines("dB over bits", &[("ours", vec![(0.1, 25.0), (0.2, 27.0)]), ("theirs", vec![(0.15, 25.5)])]);
    /// assert!(page.html().contains("theirs"));
    /// ```
    pub fn lines(&mut self, name: &str, series: &[(&str, Vec<(f64, f64)>)]) -> &mut Self {
        let escaped: Vec<(String, &[(f64, f64)])> =
            series.iter().map(|(name, points)| (escape(name), &points[..])).collect();
        let Some(svg) = curve::lines(&escaped) else { return self };
        self.put(format_args!("<figure>{svg}<figcaption>{}</figcaption></figure>", escape(name)))
    }

    fn put(&mut self, html: std::fmt::Arguments<'_>) -> &mut Self {
        // Writing to a string cannot fail.
        let _ = self.body.write_fmt(html);
        self
    }

    /// The page as HTML.
    pub fn html(&self) -> String {
        let Self { title, body, tables } = self;
        let tables = if *tables { TABLE_STYLE } else { "" };
        format!(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title><style>\n\
             {STYLE}{tables}</style></head><body>{body}</body></html>\n"
        )
    }

    /// Writes the page, atomically.
    ///
    /// # Errors
    /// When the file cannot be written; an existing one is then left unchanged.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        weaver_io::write_text(path, &self.html())
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
