//! A server for the people at this machine, or, if that is asked for, for those in its network.

mod answer;
mod guard;

use crate::{Error, Exhibit, Followed, Showing};
use answer::Answer;
use guard::Guard;
use std::io::Read;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tiny_http::{Method, Request};
use weaver_io::{SceneFormat, write_gaussians_to};
use weaver_view::{RunPage, ServedPage};

/// Formats that scenes are saved in.
const FORMATS: [&str; 3] = ["ply", "spz", "compressed"];
/// Requests that are answered at the same time.
const THREADS: usize = 4;
/// Time after which threads look whether to end.
const PATIENCE: Duration = Duration::from_millis(200);

/// Who may ask the server.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Visitors {
    /// Programs on this machine, which need the token to write.
    #[default]
    Here,
    /// Everybody in the network who has the token.
    Network,
}

/// A server that shows one scene. It answers a fixed list of addresses, and reads no other files.
pub struct Server<'a> {
    http: tiny_http::Server,
    guard: Guard,
    exhibit: Option<&'a Exhibit>,
    followed: Option<Followed<'a>>,
    page: String,
    policy: String,
    saving: Mutex<()>,
}

impl std::fmt::Debug for Server<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Server").field("guard", &self.guard).field("followed", &self.followed).finish_non_exhaustive()
    }
}

impl<'a> Server<'a> {
    /// A server that shows an exhibit, and follows a run if that is said. It listens at a free port, of the loopback alone unless for the
    /// network. Nothing is answered before [`run`](Self::run).
    ///
    /// # Errors
    /// When no port is to be had, or the page cannot be made.
    pub fn bind(exhibit: &'a Exhibit, followed: Option<Followed<'a>>, visitors: Visitors) -> Result<Self, Error> {
        let (http, guard) = listen(visitors)?;
        let nonce = random()?;
        let photo = |i: usize| exhibit.has_photo(i).then(|| format!("photo/{i}?token={}", guard.token));
        let report = exhibit.report.as_ref().map(|_| format!("report?token={}", guard.token));
        let page = ServedPage {
            nonce: &nonce,
            scene: "scene",
            photo: &photo,
            formats: if exhibit.file.is_some() { &FORMATS } else { &[] },
            report: report.as_deref(),
            live: followed.is_some(),
            features: exhibit.features.is_some(),
            beginning: followed.is_none() && exhibit.has_beginning(),
            moves: exhibit.moving.is_some()
                || followed.is_some_and(|followed| matches!(followed.showing, Showing::Film(_))),
        };
        let (html, policy) = (page.html(&exhibit.subject(), &exhibit.shots)?, page.policy());
        Ok(Self { http, guard, exhibit: Some(exhibit), followed, page: html, policy, saving: Mutex::new(()) })
    }

    /// A server that follows a run without a scene, for this machine alone: curves and the newest picture under a title.
    ///
    /// # Errors
    /// When no port is to be had.
    pub fn of_run(title: &str, followed: Followed<'a>) -> Result<Self, Error> {
        let (http, guard) = listen(Visitors::Here)?;
        let nonce = random()?;
        let page = RunPage { title, nonce: &nonce };
        let (page, policy) = (page.html(), page.policy());
        Ok(Self { http, guard, exhibit: None, followed: Some(followed), page, policy, saving: Mutex::new(()) })
    }

    /// The address to open, with the token.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/?token={}", self.guard.port, self.guard.token)
    }

    /// Answers until `stop` is set.
    pub fn run(&self, stop: &AtomicBool) {
        std::thread::scope(|scope| {
            for _ in 0..THREADS {
                scope.spawn(|| self.answer_until(stop));
            }
        });
    }

    /// Does some work, and answers while it goes on.
    pub fn during<T>(&self, work: impl FnOnce() -> T) -> T {
        let done = AtomicBool::new(false);
        /// Ends the answering also when the work panics.
        struct Ends<'b>(&'b AtomicBool);
        impl Drop for Ends<'_> {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Relaxed);
            }
        }
        std::thread::scope(|scope| {
            let ends = Ends(&done);
            scope.spawn(|| self.run(&done));
            let result = work();
            drop(ends);
            result
        })
    }

    fn answer_until(&self, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            if let Ok(Some(mut request)) = self.http.recv_timeout(PATIENCE) {
                let answer = self.answer(&mut request).unwrap_or_else(|error| Answer::text(500, error.to_string()));
                // Somebody who went away needs no answer.
                let _ = answer.send(request, &self.policy);
            }
        }
    }

    fn answer(&self, request: &mut Request) -> Result<Answer, Error> {
        let url = request.url().to_string();
        let (path, query) = url.split_once('?').unwrap_or((&url, ""));
        let writes = *request.method() == Method::Post;
        if let Err(refused) = self.guard.check(request, query, writes) {
            return Ok(refused);
        }
        match (request.method(), path) {
            (Method::Get, "/") => Ok(Answer::html(self.page.clone())),
            (Method::Get, "/scene") => self.scene(query),
            (Method::Get, "/alike") => Ok(self.alike(query)),
            (Method::Get, "/progress") => self.progress(query),
            (Method::Get, "/picture") => self.picture(),
            (Method::Get, "/report") => self.report(),
            (Method::Get, photo) if photo.starts_with("/photo/") => Ok(self.photo(&photo["/photo/".len()..])),
            (Method::Post, "/save") => self.save(request, query),
            (Method::Post, "/stop") => Ok(self.stop()),
            (Method::Get | Method::Post, _) => Ok(Answer::nothing()),
            _ => Ok(Answer::text(405, "expected GET or POST")),
        }
    }

    fn scene(&self, query: &str) -> Result<Answer, Error> {
        let time = guard::value(query, "time").and_then(|time| time.parse::<f64>().ok()).filter(|t| t.is_finite());
        let moving = self.exhibit.and_then(|exhibit| exhibit.moving.as_ref());
        let at = time.unwrap_or(0.5).clamp(0.0, 1.0);
        let latest = match (&self.followed, moving) {
            (Some(followed), _) => followed.gaussians(at)?,
            (None, Some(moving)) if time.is_some() => Some(moving.at(at)),
            _ if guard::value(query, "part") == Some("beginning") => self.exhibit.map(Exhibit::beginning),
            _ => None,
        };
        let Some(scene) = latest.as_ref().or(self.exhibit.map(|exhibit| &exhibit.gaussians)) else {
            return Ok(Answer::nothing());
        };
        let mut bytes = Vec::new();
        let ply = "ply".parse().expect("the format is in the table");
        write_gaussians_to(&mut bytes, ply, scene)?;
        Ok(Answer::new("application/octet-stream", bytes))
    }

    fn alike(&self, query: &str) -> Answer {
        let features = self.exhibit.and_then(|exhibit| exhibit.features.as_ref());
        let gaussian = guard::value(query, "gaussian").and_then(|number| number.parse().ok());
        let alike = features.zip(gaussian).and_then(|(features, gaussian)| features.alike(gaussian));
        alike.map_or_else(Answer::nothing, |bytes| Answer::new("application/octet-stream", bytes))
    }

    fn photo(&self, number: &str) -> Answer {
        let photo = self.exhibit.zip(number.parse().ok()).and_then(|(exhibit, i)| exhibit.photo(i));
        photo.map_or_else(Answer::nothing, |bytes| {
            Answer::new(if bytes.starts_with(b"\x89PNG") { "image/png" } else { "image/jpeg" }, bytes)
        })
    }

    fn picture(&self) -> Result<Answer, Error> {
        let picture = self.followed.as_ref().map(Followed::picture).transpose()?.flatten();
        Ok(picture.map_or_else(Answer::nothing, |bytes| Answer::new("image/png", bytes)))
    }

    fn report(&self) -> Result<Answer, Error> {
        let Some(path) = self.exhibit.and_then(|exhibit| exhibit.report.as_ref()) else { return Ok(Answer::nothing()) };
        Ok(Answer::report(weaver_io::read_text(path)?))
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

    /// Saves what is left: the body has a byte for each Gaussian, 1 where it is deleted.
    fn save(&self, request: &mut Request, query: &str) -> Result<Answer, Error> {
        let Some(exhibit) = self.exhibit.filter(|exhibit| exhibit.file.is_some()) else {
            return Ok(Answer::text(400, "this scene has no file to save beside"));
        };
        let count = exhibit.gaussians.len();
        let name = guard::value(query, "format").unwrap_or_default();
        let Some(format) =
            FORMATS.iter().find(|format| **format == name).and_then(|name| name.parse::<SceneFormat>().ok())
        else {
            return Ok(Answer::text(400, format!("expected a format of {}", FORMATS.join(", "))));
        };
        if request.body_length() != Some(count) {
            return Ok(Answer::text(413, format!("expected {count} bytes, one for each Gaussian")));
        }
        let Ok(_one) = self.saving.try_lock() else { return Ok(Answer::text(409, "something else is being saved")) };
        let mut dropped = Vec::new();
        let read = request.as_reader().take(count as u64).read_to_end(&mut dropped);
        if read.is_err() || dropped.len() != count {
            return Ok(Answer::text(400, format!("expected {count} bytes, found {}", dropped.len())));
        }
        let path = exhibit.save(&dropped, format)?;
        let kept = dropped.iter().filter(|byte| **byte == 0).count();
        Ok(Answer::text(200, format!("Saved {kept} Gaussians in {}.", path.display())))
    }
}

/// A port to listen at, and who is answered.
fn listen(visitors: Visitors) -> Result<(tiny_http::Server, Guard), Error> {
    let ip = if visitors == Visitors::Here { Ipv4Addr::LOCALHOST } else { Ipv4Addr::UNSPECIFIED };
    let address = SocketAddr::from((ip, 0));
    let failed = |message: String| Error::Bind { address: address.to_string(), message };
    let http = tiny_http::Server::http(address).map_err(|error| failed(error.to_string()))?;
    let port = http.server_addr().to_ip().map(|address| address.port());
    let port = port.ok_or_else(|| failed("no port".into()))?;
    Ok((http, Guard { port, token: random()?, visitors }))
}

/// 128 random bits as text.
fn random() -> Result<String, Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(Error::Random)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
