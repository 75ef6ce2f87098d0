//! A page in one file, to open anywhere.

use crate::curve;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write;
use std::path::Path;
use weaver_io::{Bitmap, Error, Image, Result};

/// An HTML page that is built from top to bottom. Pictures are inside the file; all text is escaped; nothing comes from
/// elsewhere.
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
    /// Paragraphs above everything else.
    warnings: String,
    body: String,
    /// Titles of sections.
    sections: Vec<String>,
    /// True if the page needs scripts.
    scripted: bool,
}

/// A part of a paragraph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Span<'a> {
    /// Text as it is.
    Plain(&'a str),
    /// Text in bold.
    Bold(&'a str),
}

const STYLE: &str = include_str!("../web/report.css");
const SCRIPT: &str = include_str!("../web/report.js");

/// Bytes of a page within a page, at most.
const EMBEDDED: usize = 20_000_000;
/// Sections from which a page has a table of contents.
const LONG: usize = 4;
/// Quality of compared pictures as libjpeg counts it.
const QUALITY: u8 = 92;

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

impl Page {
    /// An empty page with this title, which the browser shows and the page does not.
    pub fn new(title: &str) -> Self {
        let [warnings, body] = [const { String::new() }; 2];
        Self { title: escape(title), warnings, body, sections: Vec::new(), scripted: false }
    }

    /// Adds a heading of a level, 1 to 6. Headings of level 2 begin sections, which a long page lists at its top.
    pub fn heading(&mut self, level: usize, text: &str) -> &mut Self {
        let (level, text) = (level.clamp(1, 6), escape(text));
        if level != 2 {
            return self.put(format_args!("<h{level}>{text}</h{level}>"));
        }
        let number = self.sections.len() + 1;
        self.put(format_args!("<h2 id=\"section-{number}\">{text}</h2>"));
        self.sections.push(text);
        self
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.spans(&[Span::Plain(text)])
    }

    /// Adds a paragraph with bold parts.
    pub fn spans(&mut self, spans: &[Span<'_>]) -> &mut Self {
        let texts = spans.iter().map(|span| match span {
            Span::Plain(text) => escape(text),
            Span::Bold(text) => format!("<b>{}</b>", escape(text)),
        });
        let text: String = texts.collect();
        self.put(format_args!("<p>{text}</p>"))
    }

    /// Adds a warning, a paragraph above everything else.
    pub fn warning(&mut self, text: &str) -> &mut Self {
        self.warnings += &format!("<p class=\"warning\"><b>Warning:</b> {}</p>", escape(text));
        self
    }

    /// Adds a link to a file beside the page.
    pub fn link(&mut self, text: &str, file: &str) -> &mut Self {
        let (text, file) = (escape(text), escape(file));
        self.put(format_args!("<p><a class=\"open\" href=\"./{file}\">{text}</a></p>"))
    }

    /// Adds another page, which needs no further file, in a frame that ignores input until it is clicked, and a link to
    /// it as a file beside this page. A page of more than 20 MB is linked alone, with its size.
    pub fn embed(&mut self, text: &str, file: &str, page: &str) -> &mut Self {
        if page.len() > EMBEDDED {
            return self.link(&format!("{text} ({} MB)", page.len() / 1_000_000), file);
        }
        let (text, file, page) = (escape(text), escape(file), escape(page));
        self.scripted = true;
        self.put(format_args!(
            "<figure class=\"embed\"><div><iframe title=\"{text}\" srcdoc=\"{page}\" inert></iframe><button type=\"button\">{text}</button></div>\
             <figcaption><a href=\"./{file}\">On a page of its own</a></figcaption></figure>"
        ))
    }

    /// Adds text whose line breaks and spaces stay, in letters of one width.
    pub fn preformatted(&mut self, text: &str) -> &mut Self {
        self.put(format_args!("<pre>{}</pre>", escape(text)))
    }

    /// Adds a table: a row of names above the rows. The first column is aligned to the left, the others, usually
    /// numbers, to the right.
    pub fn table<T: AsRef<str>>(&mut self, header: &[&str], rows: &[impl AsRef<[T]>]) -> &mut Self {
        let cell = |tag: &str, text: &str| format!("<{tag}>{}</{tag}>", escape(text));
        let head: String = header.iter().map(|name| cell("th", name)).collect();
        self.put(format_args!("<div class=\"table\"><table><tr>{head}</tr>"));
        for row in rows {
            let cells: String = row.as_ref().iter().map(|text| cell("td", text.as_ref())).collect();
            self.put(format_args!("<tr>{cells}</tr>"));
        }
        self.put(format_args!("</table></div>"))
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
            "<figure class=\"picture\"><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
        ))
    }

    /// Adds two pictures of one size, one over the other, with a slider between them: each with its name, the first to
    /// the left.
    ///
    /// # Errors
    /// When a picture has no pixels, or more than 65535 on a side.
    ///
    /// # Panics
    /// When an image has not `height * width * 3` values.
    pub fn comparison(&mut self, caption: &str, pictures: [(&str, &Image); 2]) -> std::io::Result<&mut Self> {
        let mut images = Vec::new();
        for (name, image) in pictures {
            let Image { width, height, .. } = *image;
            let file = Bitmap { width, height, pixels: image.to_bytes() }.to_jpeg(QUALITY)?;
            images.push((escape(name), STANDARD.encode(file)));
        }
        let [(left, left_data), (right, right_data)] = &images[..] else { unreachable!("two pictures") };
        let (caption, aspect) = (escape(caption), pictures[0].1.width as f64 / pictures[0].1.height as f64);
        self.scripted = true;
        Ok(self.put(format_args!(
            "<figure class=\"compare\" style=\"--aspect:{aspect:.4}\"><div><img alt=\"{right}\" src=\"data:image/jpeg;base64,{right_data}\">\
             <img alt=\"{left}\" src=\"data:image/jpeg;base64,{left_data}\"><i></i><span>{left}</span><span>{right}</span>\
             <input type=\"range\" min=\"0\" max=\"100\" step=\"0.5\" value=\"50\" aria-label=\"{left} or {right}: {caption}\"></div>\
             <figcaption>{caption}</figcaption></figure>"
        )))
    }

    /// Adds a small line chart of points (step, value) in order of their steps; adds nothing without points.
    ///
    /// Values that are not finite are left out. The axis is logarithmic if all values are positive and the largest is
    /// more than ten times the smallest.
    pub fn curve(&mut self, name: &str, points: impl IntoIterator<Item = (usize, f64)>) -> &mut Self {
        let points: Vec<(usize, f64)> = points.into_iter().filter(|(_, value)| value.is_finite()).collect();
        let Some((svg, logarithmic, last)) = curve::svg(&points) else { return self };
        let axis = if logarithmic { ", log axis" } else { "" };
        let (name, digits) = (escape(name), if last.fract() == 0.0 { 0 } else { 4 });
        let rows: Vec<String> = points.iter().map(|(step, value)| format!("[{step},{value:?}]")).collect();
        let rows = rows.join(",");
        self.scripted = true;
        self.put(format_args!(
            "<figure class=\"curve\" data-points=\"[{rows}]\">{svg}<figcaption>{name} (last {last:.digits$}{axis})</figcaption></figure>"
        ))
    }

    /// Adds a line chart of several series of points (x, y), each in order of x, with their names beside it; adds
    /// nothing without points.
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
        let Self { title, warnings, body, sections, scripted } = self;
        let script = if *scripted { format!("<script type=\"module\">{SCRIPT}</script>") } else { String::new() };
        let entry = |(i, title): (usize, &String)| format!("<a href=\"#section-{}\">{title}</a>", i + 1);
        let entries: String = sections.iter().enumerate().map(entry).collect();
        let contents =
            if sections.len() < LONG { String::new() } else { format!("<nav aria-label=\"Contents\">{entries}</nav>") };
        // Contents stand behind the title of the page.
        let (head, rest) = body.split_at(body.find("</h1>").map_or(0, |at| at + "</h1>".len()));
        format!(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>{title}</title><style>\n\
             {STYLE}</style></head><body>{warnings}{head}{contents}{rest}{script}</body></html>\n"
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
