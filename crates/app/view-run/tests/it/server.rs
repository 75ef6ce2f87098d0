//! Answers and refusals of the server.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use weaver_scene::Gaussians;
use weaver_view::Look;
use weaver_view_run::{Access, Features, Listener, LiveRun, LiveView, Moving, SceneFiles, ScenePage, Server};

pub fn gaussians(n: usize) -> Gaussians {
    let at = |i: usize| [(i % 7) as f32 * 0.2 - 0.6, (i % 5) as f32 * 0.2 - 0.4, 2.0 + (i % 3) as f32 * 0.1];
    Gaussians {
        means: (0..n).map(at).collect(),
        log_scales: vec![[-2.5; 3]; n],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
        opacity_logits: (0..n).map(|i| i as f32 * 0.01).collect(),
        sh: (0..3 * n).map(|i| (i % 11) as f32 * 0.2 - 1.0).collect(),
        degree: 0,
    }
}

pub fn scene_page(file: Option<PathBuf>) -> ScenePage {
    ScenePage { file, ..ScenePage::new("scene", gaussians(35), Look::default()) }
}

/// A free port of this machine alone.
pub fn here() -> Listener {
    Listener::bind(Access::Local, None).unwrap()
}

/// Host and port of a server.
pub fn place(server: &Server<'_>) -> String {
    server.address().trim_start_matches("http://").split('/').next().unwrap().into()
}

/// A connection that waits for no answer for longer than half a minute.
pub fn connect(server: &Server<'_>) -> TcpStream {
    let stream = TcpStream::connect(place(server)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream
}

/// Status, headers and body of the answer to a request given byte by byte.
pub fn ask(server: &Server<'_>, head: &str, body: &[u8]) -> (u16, String, Vec<u8>) {
    let mut stream = connect(server);
    stream.write_all(head.replace("PLACE", &place(server)).as_bytes()).unwrap();
    stream.write_all(body).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n").expect("an answer has headers");
    let headers = String::from_utf8(answer[..end].to_vec()).unwrap();
    let status = headers.split(' ').nth(1).unwrap().parse().unwrap();
    (status, headers, answer[end + 4..].to_vec())
}

pub fn get(server: &Server<'_>, path: &str) -> (u16, String, Vec<u8>) {
    ask(server, &format!("GET {path} HTTP/1.1\r\nHost: PLACE\r\nConnection: close\r\n\r\n"), b"")
}

pub fn token(server: &Server<'_>) -> String {
    server.address().split_once("token=").unwrap().1.into()
}

/// Promise of `a_click_shows_and_selects_what_is_alike`.
#[test]
fn features_are_compared_with_those_of_one_gaussian() {
    let plain = scene_page(None);
    let server = Server::new(&plain, None, here()).unwrap();
    server.during(|| assert_eq!(get(&server, "/alike?gaussian=0").0, 404));
    let features = Features::new((0..35).flat_map(|i| [1.0, i as f32]).collect(), 2);
    let scene_page = ScenePage { features: Some(features.clone()), ..plain };
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        let (status, _, alike) = get(&server, "/alike?gaussian=3");
        assert_eq!((status, Some(alike)), (200, features.alike(3)));
        for wrong in ["/alike", "/alike?gaussian=35", "/alike?gaussian=-1", "/alike?gaussian=x"] {
            assert_eq!(get(&server, wrong).0, 404, "{wrong}");
        }
    });
}

pub fn post(server: &Server<'_>, path: &str, token: &str, body: &[u8]) -> (u16, String) {
    let head = format!(
        "POST {path} HTTP/1.1\r\nHost: PLACE\r\nX-Token: {token}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        body.len()
    );
    let (status, _, body) = ask(server, &head, body);
    (status, String::from_utf8(body).unwrap())
}

/// As browsers request the photos of a page: many connections at the same time, which stay open unless the server says
/// otherwise.
///
/// Promise (scenes): all photos of a page come, however many are asked for at once.
#[test]
fn many_who_ask_at_once_are_all_answered() {
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, here()).unwrap();
    let place = place(&server);
    server.during(|| {
        let ask = |_| {
            let mut stream = connect(&server);
            write!(stream, "GET /scene HTTP/1.1\r\nHost: {place}\r\n\r\n").unwrap();
            stream
        };
        let asked: Vec<TcpStream> = (0..12).map(ask).collect();
        let mut open = Vec::new();
        for (i, mut stream) in asked.into_iter().enumerate() {
            let mut start = [0; 200];
            stream.read_exact(&mut start).unwrap_or_else(|error| panic!("answer {i}: {error}"));
            let start = String::from_utf8_lossy(&start);
            assert!(start.starts_with("HTTP/1.1 200 OK\r\n"), "{start}");
            if !start.contains("Connection: close") {
                open.push(stream);
            }
        }
    });
}

/// Promise (scenes): the server answers listed addresses alone, refuses other hosts, and takes a token for requests
/// that write.
#[test]
fn listed_addresses_are_answered_and_no_others() {
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        let (status, headers, page) = get(&server, "/");
        assert_eq!(status, 200);
        assert!(page.starts_with(b"<!doctype html>"));
        for part in ["script-src 'nonce-", "frame-ancestors 'none'", "nosniff", "no-store", "no-referrer"] {
            assert!(headers.contains(part), "{part} in {headers}");
        }
        assert!(!headers.contains("unsafe-eval") && !headers.to_lowercase().contains("access-control"), "{headers}");
        let (status, _, scene) = get(&server, "/scene");
        assert_eq!(status, 200);
        assert!(weaver_io::read_gaussians_from(&scene, "ply".parse().unwrap()).unwrap() == scene_page.gaussians);
        for path in [
            "/index.html",
            "/../Cargo.toml",
            "/photo/0",
            "/photo/99999999999999999999",
            "/photo/../x",
            "/report",
            "/progress",
            "//",
            "/%2e%2e/",
        ] {
            assert_eq!(get(&server, path).0, 404, "{path}");
        }
        let delete = "DELETE / HTTP/1.1\r\nHost: PLACE\r\nConnection: close\r\n\r\n";
        assert_eq!(ask(&server, delete, b"").0, 405);
    });
}

#[test]
fn a_scene_that_moves_has_a_time() {
    let moving = Some(Moving::new(|time| gaussians(10 + (20.0 * time) as usize)));
    let scene_page = ScenePage { moving, ..scene_page(None) };
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        let count = |path: &str| {
            let scene = get(&server, path).2;
            weaver_io::read_gaussians_from(&scene, "ply".parse().unwrap()).unwrap().len()
        };
        let paths = ["/scene?time=0", "/scene?time=0.5", "/scene?time=1e300", "/scene", "/scene?time=nan"];
        assert_eq!(paths.map(count), [10, 20, 30, 35, 35]);
    });
}

/// Promise of `listed_addresses_are_answered_and_no_others`.
#[test]
fn other_hosts_are_refused() {
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        for host in ["evil.example", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:80", ""] {
            let head = format!("GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
            assert_eq!(ask(&server, &head, b"").0, 403, "{host}");
        }
        assert_eq!(ask(&server, "GET / HTTP/1.0\r\n\r\n", b"").0, 403);
    });
}

#[test]
fn the_network_needs_the_token_for_everything() {
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, Listener::bind(Access::Network, None).unwrap()).unwrap();
    server.during(|| {
        let token = token(&server);
        for path in ["/", "/scene", "/?token=", "/?token=00000000000000000000000000000000"] {
            assert_eq!(get(&server, path).0, 403, "{path}");
        }
        assert_eq!(get(&server, &format!("/?token={token}")).0, 200);
        assert_eq!(get(&server, &format!("/scene?token={token}")).0, 200);
    });
}

/// Promise of `listed_addresses_are_answered_and_no_others`.
#[test]
fn saving_takes_the_token_and_replaces_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.ply");
    let scene_page = scene_page(Some(file.clone()));
    weaver_io::write_gaussians(&file, &scene_page.gaussians).unwrap();
    let before = std::fs::read(&file).unwrap();
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        let token = token(&server);
        let mut dropped = vec![0; 35];
        (dropped[3], dropped[30]) = (1, 1);
        assert_eq!(post(&server, "/save?format=ply", "wrong", &dropped).0, 403);
        assert_eq!(post(&server, &format!("/save?format=ply&token={token}"), "", &dropped).0, 403);
        assert_eq!(post(&server, "/save?format=gltf", &token, &dropped).0, 400);
        assert_eq!(post(&server, "/save?format=../x", &token, &dropped).0, 400);
        assert_eq!(post(&server, "/save?format=ply", &token, &dropped[1..]).0, 413);
        assert_eq!(post(&server, "/stop", &token, b"").0, 404);
        for (format, name) in [
            ("ply", "scene-edited.ply"),
            ("ply", "scene-edited-2.ply"),
            ("spz", "scene-edited.spz"),
            ("compressed", "scene-edited.compressed.ply"),
        ] {
            let (status, text) = post(&server, &format!("/save?format={format}"), &token, &dropped);
            assert_eq!((status, text.contains(name)), (200, true), "{text}");
            assert_eq!(weaver_io::read_gaussians(folder.path().join(name)).unwrap().len(), 33);
        }
        let kept: Vec<usize> = (0..35).filter(|i| ![3, 30].contains(i)).collect();
        let saved = weaver_io::read_gaussians(folder.path().join("scene-edited.ply")).unwrap();
        assert!(saved == scene_page.gaussians.select(&kept));
    });
    assert!(std::fs::read(&file).unwrap() == before);
}

/// Promise (scenes): notes take the token, are checked, and are read back with the scene; an edited scene has them
/// beside it, and a turned one only its unit.
#[test]
fn notes_are_saved_beside_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.ply");
    let page = scene_page(Some(file.clone()));
    weaver_io::write_gaussians(&file, &page.gaussians).unwrap();
    let notes = r#"{"meters": 0.5, "up": [0, 0, 1], "lengths": [[[0, 0, 2], [1, 0, 2]]]}"#;
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    let server = Server::new(&page, None, here()).unwrap();
    server.during(|| {
        let token = token(&server);
        assert_eq!(post(&server, "/notes", "wrong", notes.as_bytes()).0, 403);
        for (wrong, said) in
            [("{", "notes: expected JSON"), (r#"{"meters": 0}"#, "meters: expected a positive number, found 0")]
        {
            let (status, text) = post(&server, "/notes", &token, wrong.as_bytes());
            assert!(status == 400 && text.starts_with(said), "{text}");
        }
        assert_eq!(post(&server, "/notes", &token, &vec![b' '; (1 << 20) + 1]).0, 413);
        assert!(!folder.path().join("scene.view.json").exists());
        let (status, text) = post(&server, "/notes", &token, notes.as_bytes());
        assert!(status == 200 && text.contains("scene.view.json"), "{text}");
        assert_eq!(post(&server, "/save?format=ply", &token, &[0; 35]).0, 200);
        assert_eq!(post(&server, "/save?format=ply&up=0,0", &token, &[0; 35]).0, 400);
        assert_eq!(post(&server, "/save?format=ply&up=0,0,0", &token, &[0; 35]).0, 400);
        assert_eq!(post(&server, "/save?format=ply&up=0,0,2", &token, &[0; 35]).0, 200);
    });
    assert_eq!(read("scene-edited.view.json"), read("scene.view.json"));
    assert_eq!(read("scene-edited-2.view.json"), "{\n  \"meters\": 0.5\n}\n");
    let turned = weaver_io::read_gaussians(folder.path().join("scene-edited-2.ply")).unwrap();
    let [x, y, z] = page.gaussians.means[3];
    let [a, b, c] = turned.means[3];
    assert!(
        (a - x).abs() < 1e-6 && (b + z).abs() < 1e-6 && (c - y).abs() < 1e-6,
        "{:?} to {:?}",
        page.gaussians.means[3],
        turned.means[3]
    );
    let again = SceneFiles::of(&file).page().unwrap();
    assert_eq!((again.look.meters, again.notes.meters()), (Some(0.5), Some(0.5)));
    assert!(again.html(Default::default()).unwrap().contains(r#""lengths":[[[0,0,2],[1,0,2]]]"#));
    std::fs::write(folder.path().join("scene.view.json"), r#"{"up": 3}"#).unwrap();
    let message = format!("{:?}", SceneFiles::of(&file).page().unwrap_err());
    assert!(message.contains("scene.view.json") && message.contains("three numbers that are not all 0"), "{message}");
}

/// Promise of `notes_are_saved_beside_the_scene`.
#[test]
fn a_scene_without_a_file_has_no_notes_to_save() {
    let page = scene_page(None);
    let server = Server::new(&page, None, here()).unwrap();
    server.during(|| {
        assert_eq!(post(&server, "/notes", &token(&server), b"{}").0, 413);
        assert_eq!(post(&server, "/notes", &token(&server), b"").0, 400);
    });
}

#[test]
fn a_run_without_a_scene_has_pictures_alone() {
    let folder = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let samples = folder.path().join("samples");
    let followed =
        LiveRun { folder: folder.path(), steps: 5, names: &[], showing: LiveView::Pictures(&samples), stop: &stop };
    let server = Server::of_run("run", followed, here()).unwrap();
    server.during(|| {
        let (status, headers, page) = get(&server, "/");
        assert!(status == 200 && page.starts_with(b"<!doctype html>") && headers.contains("script-src 'nonce-"));
        for path in ["/scene", "/photo/0", "/report", "/picture"] {
            assert_eq!(get(&server, path).0, 404, "{path}");
        }
        let (status, _, progress) = get(&server, "/progress");
        assert!(status == 200 && String::from_utf8(progress).unwrap().contains("\"version\":0"));
        std::fs::create_dir(&samples).unwrap();
        weaver_io::Image::filled(4, 3, [0.5; 3]).write_png(samples.join("step-1.png")).unwrap();
        let (status, headers, picture) = get(&server, "/picture?version=1");
        assert!(status == 200 && headers.contains("image/png") && picture.starts_with(b"\x89PNG"));
        assert_eq!(post(&server, "/save?format=ply", &token(&server), b"").0, 400);
        assert_eq!(post(&server, "/stop", &token(&server), b"").0, 200);
    });
    assert!(stop.load(Ordering::Relaxed));
}

#[test]
fn tokens_differ() {
    let scene_page = scene_page(None);
    let [a, b] = [0, 1].map(|_| token(&Server::new(&scene_page, None, here()).unwrap()));
    assert!(a != b && a.len() == 32);
}
