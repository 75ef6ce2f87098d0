//! A server for the people at this machine, or, on request, in its network.

mod answer;
mod clients;
mod guard;
mod listener;
mod request;
mod visit;

pub use listener::{Access, Listener};

use crate::{Error, LiveRun, LiveView, ScenePage, notes_file};
use answer::Answer;
use clients::{Clients, Limits};
use guard::Guard;
use request::Request;
use std::borrow::Cow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::thread::{self, Thread};
use std::time::{Duration, Instant};
use visit::Visit;
use weaver_geometry::glam::DVec3;
use weaver_io::{SceneFormat, write_gaussians_to};
use weaver_scene::Gaussians;
use weaver_view::{Notes, RunPage, ServedPage};

/// Formats that scenes are saved in.
const FORMATS: [&str; 3] = ["ply", "spz", "compressed"];
/// Bytes of notes at most.
const MOST_NOTES: u64 = 1 << 20;
/// Pauses between checks for clients: soon after a client, as they rarely come alone, and otherwise.
const PAUSES: [Duration; 2] = [Duration::from_millis(1), Duration::from_millis(20)];
/// Time after a client for which others are expected.
const SOON: Duration = Duration::from_secs(1);

/// A server that shows one scene. It answers a fixed list of addresses, and reads no other files.
pub struct Server<'a> {
    listener: Listener,
    guard: Guard,
    scene_page: Option<&'a ScenePage>,
    followed: Option<LiveRun<'a>>,
    page: String,
    policy: String,
    /// Notes as they were saved last; who holds them saves.
    saving: Mutex<Notes>,
}

impl std::fmt::Debug for Server<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("guard", &self.guard).field("followed", &self.followed).finish_non_exhaustive()
    }
}

impl<'a> Server<'a> {
    /// A server that shows a scene, and follows a run, if any. Nothing is answered before [`run`](Self::run).
    ///
    /// # Errors
    /// When the page cannot be made.
    pub fn new(scene_page: &'a ScenePage, followed: Option<LiveRun<'a>>, listener: Listener) -> Result<Self, Error> {
        let (guard, nonce) = (Guard::of(&listener)?, random()?);
        let photo = |i: usize| scene_page.has_photo(i).then(|| format!("photo/{i}?token={}", guard.token));
        let report = scene_page.report.as_ref().map(|_| format!("report?token={}", guard.token));
        let page = ServedPage {
            nonce: &nonce,
            scene: "scene",
            photo: &photo,
            formats: if scene_page.file.is_some() { &FORMATS } else { &[] },
            report: report.as_deref(),
            live: followed.is_some(),
            features: scene_page.features.is_some(),
            beginning: followed.is_none() && scene_page.has_beginning(),
            moves: scene_page.moving.is_some()
                || followed.is_some_and(|followed| matches!(followed.showing, LiveView::Film(_))),
        };
        let (html, policy) = (page.html(&scene_page.subject(), &scene_page.shots)?, page.policy());
        Ok(Self {
            listener,
            guard,
            scene_page: Some(scene_page),
            followed,
            page: html,
            policy,
            saving: Mutex::new(scene_page.notes.clone()),
        })
    }

    /// A server that follows a run without a scene: curves and the newest picture under a title.
    ///
    /// # Errors
    /// When the system has no random numbers.
    pub fn of_run(title: &str, followed: LiveRun<'a>, listener: Listener) -> Result<Self, Error> {
        let (guard, nonce) = (Guard::of(&listener)?, random()?);
        let page = RunPage { title, nonce: &nonce };
        let (page, policy) = (page.html(), page.policy());
        Ok(Self { listener, guard, scene_page: None, followed: Some(followed), page, policy, saving: Mutex::default() })
    }

    /// The address to open on this machine, with the token.
    pub fn address(&self) -> String {
        self.address_at("127.0.0.1")
    }

    /// The address that others in the network open, if they may and this machine has one.
    pub fn network_address(&self) -> Option<String> {
        self.listener.host().map(|host| self.address_at(&host))
    }

    fn address_at(&self, host: &str) -> String {
        format!("http://{host}:{}/?token={}", self.guard.port, self.guard.token)
    }

    /// Answers until `stop` is set. Clients still connected then have a second to receive their answers.
    pub fn run(&self, stop: &AtomicBool) {
        let clients = Clients::new(Limits::USUAL);
        thread::scope(|scope| {
            let mut last: Option<Instant> = None;
            while !stop.load(Ordering::Relaxed) {
                let Some(stream) = clients.has_seat().then(|| self.listener.accept()).flatten() else {
                    let soon = last.is_some_and(|last| last.elapsed() < SOON);
                    thread::park_timeout(if soon { PAUSES[0] } else { PAUSES[1] });
                    continue;
                };
                last = Some(Instant::now());
                let visit = Visit::new(&clients, stream);
                // Neither a refused thread nor a panic ends more than this connection.
                let receive = || drop(catch_unwind(AssertUnwindSafe(|| self.receive(visit))));
                let _ = thread::Builder::new().spawn_scoped(scope, receive);
            }
            clients.close();
        });
    }

    /// Does some work, and answers while it goes on.
    pub fn during<T>(&self, work: impl FnOnce() -> T) -> T {
        let done = AtomicBool::new(false);
        /// Ends the answering also when the work panics.
        struct Ends<'b>(&'b AtomicBool, Thread);
        impl Drop for Ends<'_> {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Relaxed);
                self.1.unpark();
            }
        }
        thread::scope(|scope| {
            let answering = scope.spawn(|| self.run(&done));
            let ends = Ends(&done, answering.thread().clone());
            let result = work();
            drop(ends);
            result
        })
    }

    /// Answers a client, if it sends a request. A client that goes away or is too slow needs no answer.
    fn receive(&self, mut visit: Visit<'_>) {
        let asked = Request::read(&mut visit).and_then(|request| {
            let Some(mut request) = request else { return Ok(None) };
            self.check(&request)?;
            let body = request.body(&mut visit)?;
            Ok(Some((request, body)))
        });
        let _ = match asked {
            Ok(None) => Ok(()),
            Err(refused) => visit.answer(&self.policy, false, || refused),
            Ok(Some((request, body))) => visit.answer(&self.policy, request.is_costly(), || {
                self.answer(&request, &body).unwrap_or_else(|error| Answer::text(500, error.to_string()))
            }),
        };
    }

    /// Refuses a request before a byte of its body is read: without permission, or with a body that is not for saving.
    fn check(&self, request: &Request) -> Result<(), Answer> {
        let (path, query) = request.parts();
        self.guard.check(request, query, request.method == "POST")?;
        let savable = self.scene_page.filter(|scene_page| scene_page.file.is_some());
        if path == "/notes" && savable.is_some() {
            if request.length <= MOST_NOTES {
                return Ok(());
            }
            return Err(Answer::text(413, format!("expected notes of at most {MOST_NOTES} bytes")));
        }
        let expected = savable.filter(|_| path == "/save").map_or(0, |scene_page| scene_page.gaussians.len() as u64);
        if request.length == expected {
            return Ok(());
        }
        Err(Answer::text(413, format!("expected a body of {expected} bytes")))
    }

    fn answer(&self, request: &Request, body: &[u8]) -> Result<Answer, Error> {
        let (path, query) = request.parts();
        match (request.method.as_str(), path) {
            ("GET", "/") => Ok(Answer::html(self.page.clone())),
            ("GET", "/scene") => self.scene(query),
            ("GET", "/alike") => Ok(self.alike(query)),
            ("GET", "/progress") => self.progress(query),
            ("GET", "/picture") => self.picture(),
            ("GET", "/report") => self.report(),
            ("GET", photo) if photo.starts_with("/photo/") => Ok(self.photo(&photo["/photo/".len()..])),
            ("POST", "/notes") => self.save_notes(body),
            ("POST", "/save") => self.save(body, query),
            ("POST", "/stop") => Ok(self.stop()),
            ("GET" | "POST", _) => Ok(Answer::nothing()),
            _ => Ok(Answer::text(405, "expected GET or POST")),
        }
    }

    fn scene(&self, query: &str) -> Result<Answer, Error> {
        let time = guard::value(query, "time").and_then(|time| time.parse::<f64>().ok()).filter(|t| t.is_finite());
        let moving = self.scene_page.and_then(|scene_page| scene_page.moving.as_ref());
        let at = time.unwrap_or(0.5).clamp(0.0, 1.0);
        let latest = match (&self.followed, moving) {
            (Some(followed), _) => followed.gaussians(at)?,
            (None, Some(moving)) if time.is_some() => Some(moving.at(at)),
            _ if guard::value(query, "part") == Some("beginning") => self.scene_page.map(ScenePage::beginning),
            _ => None,
        };
        let second = self.scene_page.and_then(|scene_page| scene_page.second.as_ref());
        if let (Some("second"), Some((_, scene))) = (guard::value(query, "part"), second) {
            return packed(scene);
        }
        let Some(scene) = latest.as_ref().or(self.scene_page.map(|scene_page| &scene_page.gaussians)) else {
            return Ok(Answer::nothing());
        };
        packed(scene)
    }

    fn alike(&self, query: &str) -> Answer {
        let features = self.scene_page.and_then(|scene_page| scene_page.features.as_ref());
        let gaussian = guard::value(query, "gaussian").and_then(|number| number.parse().ok());
        let alike = features.zip(gaussian).and_then(|(features, gaussian)| features.alike(gaussian));
        alike.map_or_else(Answer::nothing, |bytes| Answer::new("application/octet-stream", bytes))
    }

    fn photo(&self, number: &str) -> Answer {
        let photo = self.scene_page.zip(number.parse().ok()).and_then(|(scene_page, i)| scene_page.photo(i));
        photo.map_or_else(Answer::nothing, |bytes| {
            Answer::new(if bytes.starts_with(b"\x89PNG") { "image/png" } else { "image/jpeg" }, bytes)
        })
    }

    fn picture(&self) -> Result<Answer, Error> {
        let picture = self.followed.as_ref().map(LiveRun::picture).transpose()?.flatten();
        Ok(picture.map_or_else(Answer::nothing, |bytes| Answer::new("image/png", bytes)))
    }

    fn report(&self) -> Result<Answer, Error> {
        let path = self.scene_page.and_then(|scene_page| scene_page.report.as_ref()).filter(|path| path.is_file());
        Ok(path.map_or_else(|| Ok(Answer::nothing()), |path| weaver_io::read_text(path).map(Answer::report))?)
    }

    fn progress(&self, query: &str) -> Result<Answer, Error> {
        let Some(followed) = &self.followed else { return Ok(Answer::nothing()) };
        let since = guard::value(query, "since").and_then(|since| since.parse().ok()).unwrap_or(0);
        Ok(Answer::new("application/json", followed.progress(since)?.to_string().into_bytes()))
    }

    fn stop(&self) -> Answer {
        let Some(followed) = &self.followed else { return Answer::nothing() };
        followed.stop();
        Answer::text(200, "The run ends after this step and saves.")
    }

    /// Saves notes beside the scene.
    fn save_notes(&self, body: &[u8]) -> Result<Answer, Error> {
        let Some(file) = self.scene_page.and_then(|scene_page| scene_page.file.as_deref()) else {
            return Ok(Answer::text(400, "this scene has no file to save beside"));
        };
        let notes = match Notes::parse(&String::from_utf8_lossy(body)) {
            Ok(notes) => notes,
            Err(error) => return Ok(Answer::text(400, error.to_string())),
        };
        let Some(mut saved) = self.turn_to_save() else { return Ok(busy()) };
        let path = notes_file::write(file, &notes)?;
        *saved = notes;
        Ok(Answer::text(200, format!("Saved the notes in {}.", path.display())))
    }

    /// The notes as they were saved last, unless something else is being saved.
    fn turn_to_save(&self) -> Option<MutexGuard<'_, Notes>> {
        match self.saving.try_lock() {
            Ok(saved) => Some(saved),
            Err(TryLockError::Poisoned(saved)) => Some(saved.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    /// Saves the Gaussians that are left: the body has a byte for each Gaussian, 1 where it is deleted.
    fn save(&self, dropped: &[u8], query: &str) -> Result<Answer, Error> {
        let Some(scene_page) = self.scene_page.filter(|scene_page| scene_page.file.is_some()) else {
            return Ok(Answer::text(400, "this scene has no file to save beside"));
        };
        let name = guard::value(query, "format").unwrap_or_default();
        let Some(format) =
            FORMATS.iter().find(|format| **format == name).and_then(|name| name.parse::<SceneFormat>().ok())
        else {
            return Ok(Answer::text(400, format!("expected a format of {}", FORMATS.join(", "))));
        };
        let up = match guard::value(query, "up").map(direction) {
            None => None,
            Some(Some(up)) => Some(up),
            Some(None) => return Ok(Answer::text(400, "expected three numbers for the up axis")),
        };
        let Some(notes) = self.turn_to_save() else { return Ok(busy()) };
        let path = scene_page.save(dropped, format, &notes, up)?;
        let kept = dropped.iter().filter(|byte| **byte == 0).count();
        Ok(Answer::text(200, format!("Saved {kept} Gaussians in {}.", path.display())))
    }
}

/// A scene as a PLY file.
fn packed(scene: &Gaussians) -> Result<Answer, Error> {
    let mut bytes = Vec::new();
    let ply = "ply".parse().expect("the format is in the table");
    write_gaussians_to(&mut bytes, ply, &drawable(scene))?;
    Ok(Answer::new("application/octet-stream", bytes))
}

/// A direction of three numbers with commas between.
fn direction(text: &str) -> Option<DVec3> {
    let numbers: Vec<f64> = text.split(',').map(str::parse).collect::<Result<_, _>>().ok()?;
    let up = DVec3::from(<[f64; 3]>::try_from(numbers).ok()?);
    up.try_normalize()
}

fn busy() -> Answer {
    Answer::text(409, "something else is being saved")
}

/// 128 random bits as text.
fn random() -> Result<String, Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(Error::Random)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The Gaussians, with the non-finite Gaussians of a diverged run made invisible rather than removed: files cannot hold
/// numbers that are not finite, and marks of the page go by the number of a Gaussian.
fn drawable(scene: &Gaussians) -> Cow<'_, Gaussians> {
    let per_row = 3 * scene.coefficients();
    let is_finite = |i: &usize| {
        let fields =
            [&scene.means[*i][..], &scene.log_scales[*i], &scene.quats[*i], &scene.sh[i * per_row..][..per_row]];
        fields.into_iter().flatten().all(|x| x.is_finite()) && !scene.opacity_logits[*i].is_nan()
    };
    let lost: Vec<usize> = (0..scene.len()).filter(|i| !is_finite(i)).collect();
    if lost.is_empty() {
        return Cow::Borrowed(scene);
    }
    let mut scene = scene.clone();
    for i in lost {
        (scene.means[i], scene.log_scales[i], scene.quats[i]) = ([0.0; 3], [0.0; 3], [1.0, 0.0, 0.0, 0.0]);
        scene.opacity_logits[i] = f32::NEG_INFINITY;
        scene.sh[i * per_row..][..per_row].fill(0.0);
    }
    Cow::Owned(scene)
}
