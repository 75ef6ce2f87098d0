//! The page in one file.

use crate::home::Home;
use crate::subject::{Shot, Subject, camera_json};
use crate::template::{escape, fill};
use crate::{Notes, ViewError, modules};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Value, json};
use std::io::Write;
use weaver_io::{Checksum, SceneFormat, spz_step, write_gaussians_to};
use weaver_kernels::order::median_high;
use weaver_scene::Gaussians;

const PAGE: &str = include_str!("../web/page.html");
pub(crate) const STYLE: &str = include_str!("../web/style.css");

/// Choices of a page in one file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HtmlOptions {
    /// The scene keeps every bit of positions, scales, rotations and opacities, a multiple of the size. Else it is
    /// rounded as SPZ does, unless positions would be too coarse for its Gaussians, or have no place in it.
    pub lossless: bool,
}

/// One HTML file with scene, cameras, photos and viewer, which needs no network and no other file.
///
/// It draws as the rasterizer does by WebGL2; where a browser has none, it shows a picture from the first camera and
/// says so. Text of any kind in names is shown as text. The same arguments give the same bytes.
///
/// # Errors
/// When the fields of the scene disagree, a value is not finite where it is rounded, or the picture cannot be drawn.
///
/// ```
/// use weaver_scene::Gaussians;
/// use weaver_view::{HtmlOptions, Look, Subject, html};
///
/// let gaussians = Gaussians {
///     means: vec![[0.0, 0.0, 2.0]],
///     log_scales: vec![[-1.0; 3]],
///     quats: vec![[1.0, 0.0, 0.0, 0.0]],
///     opacity_logits: vec![2.0],
///     sh: vec![1.0, 0.0, -1.0],
///     degree: 0,
/// };
/// let subject = Subject { title: "<one> Gaussian", gaussians: &gaussians, look: Look::default(), notes: None, second: None };
/// let page = html(&subject, &[], HtmlOptions::default())?;
/// assert!(page.contains("<title>&lt;one&gt; Gaussian</title>"));
/// # Ok::<(), weaver_view::ViewError>(())
/// ```
pub fn html(subject: &Subject<'_>, shots: &[Shot], options: HtmlOptions) -> Result<String, ViewError> {
    film_html(subject, &[], shots, options)
}

/// One HTML file as [`html`], of a scene that moves: with a slider that goes through `moments`, which are evenly spread
/// over its time from beginning to end; the page begins with the subject's Gaussians.
///
/// # Errors
/// As [`html`].
pub fn film_html(
    subject: &Subject<'_>,
    moments: &[Gaussians],
    shots: &[Shot],
    options: HtmlOptions,
) -> Result<String, ViewError> {
    let text = |gaussians: &Gaussians| Ok(STANDARD.encode(encoded(gaussians, options.lossless)?));
    let scene = text(subject.gaussians)?;
    let moments = moments.iter().map(text).collect::<Result<Vec<String>, ViewError>>()?;
    let mut sum = Checksum::default();
    moments.iter().chain([&scene]).for_each(|text| sum.bytes(text.as_bytes()));
    sum.bytes(subject.title.as_bytes());
    let second = subject.second.map(|(_, gaussians)| text(gaussians)).transpose()?;
    second.iter().for_each(|text| sum.bytes(text.as_bytes()));
    let mut further = json!({ "length": scene.len() });
    if !moments.is_empty() {
        further["moments"] = moments.iter().map(String::len).collect();
        further["moves"] = json!(true);
    }
    let element =
        |id: &str, text: &str| format!("<script type=\"application/octet-stream\" id=\"{id}\">{text}</script>");
    let moments = moments.iter().enumerate().map(|(i, text)| element(&format!("moment-{i}"), text));
    let second = second.iter().map(|text| element("second-scene", text));
    let scene: String = std::iter::once(element("scene", &scene)).chain(moments).chain(second).collect();
    let photo = |i: usize| shots[i].photo.as_deref().map(data_address);
    Parts { subject, shots, photo: &photo, further, scene: &scene, nonce: &sum.to_string(), connect: "'none'" }.page()
}

/// A page that a server sends, which requests the rest from the server.
#[derive(Clone, Copy)]
pub struct ServedPage<'a> {
    /// A word that cannot be guessed, in this page and in its content security policy.
    pub nonce: &'a str,
    /// The address of the scene, a PLY or SPZ file; with `?part=second` of the scene over it, if the subject has one.
    pub scene: &'a str,
    /// The address of the photo of the shot with this number, if there is one.
    pub photo: &'a dyn Fn(usize) -> Option<String>,
    /// Names of the formats that the server saves in, at `POST save?format=NAME`, turned with `&up=X,Y,Z`; if there are
    /// any, it saves notes at `POST notes`.
    pub formats: &'a [&'a str],
    /// The address of a report.
    pub report: Option<&'a str>,
    /// The page follows a run: `progress?since=STEP`, `scene` and `POST stop`.
    pub live: bool,
    /// The Gaussians have features: `alike?gaussian=I` has a byte for each of them, 255 where its features equal the
    /// I-th's.
    pub features: bool,
    /// The scene is large: its address with `?part=beginning` has the most visible Gaussians, to look at until all is
    /// there.
    pub beginning: bool,
    /// The scene moves: `scene?time=T` has it at a time, 0 to 1, and `scene` in the middle.
    pub moves: bool,
}

impl std::fmt::Debug for ServedPage<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ServedPage").field("scene", &self.scene).field("live", &self.live).finish_non_exhaustive()
    }
}

impl ServedPage<'_> {
    /// The page as HTML. Photos that shots hold are not in it.
    ///
    /// # Errors
    /// When the picture of the scene cannot be drawn.
    pub fn html(&self, subject: &Subject<'_>, shots: &[Shot]) -> Result<String, ViewError> {
        let Self { nonce, scene, photo, formats, report, live, features, beginning, moves } = *self;
        let mut further = json!({ "source": scene, "formats": formats, "report": report, "live": live });
        (further["features"], further["moves"]) = (json!(features), json!(moves));
        further["beginning"] = json!(beginning);
        Parts { subject, shots, photo, further, scene: "", nonce, connect: "'self'" }.page()
    }

    /// The content security policy of the page, for the header of the answer.
    pub fn policy(&self) -> String {
        served_policy(self.nonce)
    }
}

/// Steps of positions over the median scale of Gaussians, at most: larger ones would be seen.
const COARSE: f64 = 0.5;

/// True if SPZ holds the positions, by steps that are small beside the Gaussians: they are not where some lie very far
/// away, or where the whole scene is small.
fn rounds_well(gaussians: &Gaussians) -> bool {
    let Some(step) = spz_step(gaussians) else { return false };
    let mut scales = gaussians.log_scales.as_flattened().to_vec();
    median_high(&mut scales).is_none_or(|median| step <= COARSE * f64::from(median).exp())
}

/// The bytes of a scene as pages take them: gzip of PLY, or SPZ.
fn encoded(gaussians: &Gaussians, lossless: bool) -> Result<Vec<u8>, ViewError> {
    let format = |name: &str| name.parse::<SceneFormat>().expect("the format is in the table");
    let mut bytes = Vec::new();
    if !lossless && rounds_well(gaussians) {
        write_gaussians_to(&mut bytes, format("spz"), gaussians)?;
        return Ok(bytes);
    }
    write_gaussians_to(&mut bytes, format("ply"), gaussians)?;
    let mut packed = GzEncoder::new(Vec::new(), Compression::default());
    packed.write_all(&bytes)?;
    Ok(packed.finish()?)
}

/// Parts of a page.
struct Parts<'a> {
    subject: &'a Subject<'a>,
    shots: &'a [Shot],
    photo: &'a dyn Fn(usize) -> Option<String>,
    /// Further keys for the scripts.
    further: Value,
    /// The element that holds the scene, if it is inside.
    scene: &'a str,
    nonce: &'a str,
    /// The places that scripts may connect to.
    connect: &'a str,
}

impl Parts<'_> {
    fn page(&self) -> Result<String, ViewError> {
        let Self { subject, shots, nonce, .. } = self;
        let home = Home::of(subject, shots)?;
        let cameras = shots.iter().enumerate().map(|(i, shot)| {
            let mut camera = camera_json(&shot.camera);
            camera["name"] = json!(shot.name);
            camera["held_out"] = json!(shot.held_out);
            camera["photo"] = json!((self.photo)(i));
            camera["coverage"] = json!(shot.coverage);
            camera
        });
        let mut about = json!({
            "home": home.json(),
            "up": home.up(),
            "look": subject.look.json(),
            "second": subject.second.map(|(name, _)| name),
            "cameras": cameras.collect::<Vec<_>>(),
        });
        for (key, value) in self.further.as_object().into_iter().flatten() {
            about[key] = value.clone();
        }
        about["notes"] = subject.notes.map_or(Value::Null, Notes::json);
        // Within a script element, nothing but `<` could end it.
        let about = about.to_string().replace('<', "\\u003c");
        let alt = format!("A picture of {}, {} Gaussians", subject.title, subject.gaussians.len());
        let (policy, title, alt) = (policy(nonce, self.connect), escape(subject.title), escape(&alt));
        let (poster, worker, script) = (data_address(&home.picture), modules::worker(), modules::page());
        let values = [
            ("policy", policy.as_str()),
            ("title", &title),
            ("alt", &alt),
            ("poster", &poster),
            ("style", STYLE),
            ("nonce", nonce),
            ("worker", &worker),
            ("script", &script),
            ("about", &about),
            ("scene", self.scene),
        ];
        Ok(fill(PAGE, &values))
    }
}

/// The content security policy: scripts and styles of the page itself, nothing from elsewhere.
fn policy(nonce: &str, connect: &str) -> String {
    format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src 'self' data: blob:; \
         worker-src blob:; connect-src {connect}; base-uri 'none'; form-action 'none'"
    )
}

/// The policy of a page that a server sends.
pub(crate) fn served_policy(nonce: &str) -> String {
    policy(nonce, "'self'") + "; frame-ancestors 'none'"
}

/// A JPEG or PNG file as an address.
fn data_address(file: &[u8]) -> String {
    let kind = if file.starts_with(b"\x89PNG") { "png" } else { "jpeg" };
    format!("data:image/{kind};base64,{}", STANDARD.encode(file))
}
