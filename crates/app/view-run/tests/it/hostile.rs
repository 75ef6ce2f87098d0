//! Clients who lie, keep silent, do not read, or come in crowds.

use crate::server::{ask, connect, gaussians, get, here, place, scene_page};
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};
use weaver_view::Look;
use weaver_view_run::{Access, Listener, Moving, ScenePage, Server};

/// A bound for work of milliseconds, on a machine that does other work as well.
const SOON: Duration = Duration::from_secs(20);

/// Everything up to the server's end of a connection, as far as there is no reset before.
fn rest(stream: &mut TcpStream) -> Vec<u8> {
    let mut answer = Vec::new();
    match stream.read_to_end(&mut answer) {
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
            panic!("no end of an answer: {error}")
        }
        _ => answer,
    }
}

/// Bodies declared as large are refused before room is made for them, from every client.
///
/// Promise (servers): a body is refused by its length before room is made for it.
#[test]
fn bodies_are_refused_by_their_length() {
    let scene_page = scene_page(None);
    let network = Server::new(&scene_page, None, Listener::bind(Access::Network, None).unwrap()).unwrap();
    let here = Server::new(&scene_page, None, here()).unwrap();
    for (server, host, status) in [(&here, "anything", 403), (&here, "PLACE", 403), (&network, "anything", 403)] {
        server.during(|| {
            for length in ["5000", "99999999999999", "18446744073709551615", "99999999999999999999999"] {
                let head = format!("POST /x HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}\r\n\r\n");
                assert_eq!(ask(server, &head, b"").0, status, "{length}");
            }
        });
    }
    here.during(|| {
        for length in ["1", "99999999999999", "18446744073709551616"] {
            let head = format!("GET / HTTP/1.1\r\nHost: PLACE\r\nContent-Length: {length}\r\n\r\n");
            assert_eq!(ask(&here, &head, b"").0, 413, "{length}");
        }
        for (wrong, status) in [
            ("Content-Length: -1", 400),
            ("Content-Length: +1", 400),
            ("Content-Length: 1, 1", 400),
            ("Content-Length:", 400),
            ("Content-Length: 0\r\nContent-Length: 0", 400),
            ("Transfer-Encoding: chunked", 411),
        ] {
            let head = format!("GET / HTTP/1.1\r\nHost: PLACE\r\n{wrong}\r\n\r\n");
            assert_eq!(ask(&here, &head, b"").0, status, "{wrong}");
        }
    });
}

/// A head has at most 16 kB, however it comes.
///
/// Promise (servers): a head of a request has at most 16 kB.
#[test]
fn heads_are_bounded() {
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        for (first, part) in
            [("GET / HTTP/1.1\r\nX: ", "y"), ("GET /", "y"), ("", "\r\n"), ("GET / HTTP/1.1\r\n", "X: y\r\n")]
        {
            let mut stream = connect(&server);
            let _ = stream.write_all(first.as_bytes());
            let lines = part.repeat(1 << 16);
            // A refused client may meet a closed connection before everything is written.
            let written = (0..64).take_while(|_| stream.write_all(lines.as_bytes()).is_ok()).count();
            let answer = String::from_utf8(rest(&mut stream)).unwrap();
            assert!(answer.starts_with("HTTP/1.1 431 ") || (answer.is_empty() && written < 64), "{first}: {answer}");
        }
        assert_eq!(get(&server, "/").0, 200);
    });
}

/// The server ends the connection: clients need not wait for a limit of their own.
///
/// Promise (servers): a connection ends after its answer.
#[test]
fn a_connection_ends_after_its_answer() {
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, here()).unwrap();
    server.during(|| {
        let mut stream = connect(&server);
        let begin = Instant::now();
        write!(stream, "GET /scene HTTP/1.1\r\nHost: {}\r\nConnection: keep-alive\r\n\r\n", place(&server)).unwrap();
        assert!(rest(&mut stream).starts_with(b"HTTP/1.1 200 OK\r\nConnection: close\r\n"));
        assert!(begin.elapsed() < SOON);
    });
}

/// A thousand silent connections, and as many that promise a body, keep no other waiting.
///
/// Promise (servers): a thousand silent connections block no one.
#[test]
fn a_crowd_of_silent_clients_holds_nobody() {
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, here()).unwrap();
    let place = place(&server);
    server.during(|| {
        let mut crowd = Vec::new();
        for i in 0..1000 {
            // Connections beyond the system's limit are skipped.
            let Ok(mut stream) = TcpStream::connect(&place) else { continue };
            let said = match i % 3 {
                0 => "",
                1 => "GET / HTTP/1.1\r\nHo",
                _ => "POST /x HTTP/1.1\r\nContent-Length: 5000\r\n\r\n",
            };
            let _ = stream.write_all(said.as_bytes());
            crowd.push(stream);
            if i % 250 == 0 {
                assert_eq!(get(&server, "/progress").0, 404);
            }
        }
        assert!(crowd.len() > 500, "{}", crowd.len());
        let begin = Instant::now();
        assert_eq!(get(&server, "/").0, 200);
        assert!(begin.elapsed() < SOON, "{:?}", begin.elapsed());
    });
}

/// The server's end, and so the end of a fit, waits for no client that does not read, is silent or goes on sending.
///
/// Promise (servers): a fit ends without its page's readers.
#[test]
fn the_end_does_not_wait_for_clients() {
    let scene_page = ScenePage::new("large", gaussians(300_000), Look::default());
    let server = Server::new(&scene_page, None, here()).unwrap();
    let mut clients: Vec<TcpStream> = (0..12).map(|_| connect(&server)).collect();
    let (done, over) = mpsc::channel();
    std::thread::scope(|scope| {
        let server = &server;
        scope.spawn(move || {
            let begin = Instant::now();
            server.during(|| {
                for (i, client) in clients.iter_mut().enumerate() {
                    let said = match i % 3 {
                        0 => format!("GET /scene HTTP/1.1\r\nHost: {}\r\n\r\n", place(server)),
                        1 => "POST /x HTTP/1.1\r\nContent-Length: 5000\r\n\r\n".into(),
                        _ => "GET ".into(),
                    };
                    client.write_all(said.as_bytes()).unwrap();
                }
                let mut first = [0; 12];
                clients[0].read_exact(&mut first).unwrap();
                assert_eq!(&first, b"HTTP/1.1 200");
            });
            done.send(begin.elapsed()).unwrap();
            // They are there until then.
            drop(clients);
        });
        let took = over.recv_timeout(Duration::from_secs(60));
        assert!(took.is_ok_and(|took| took < SOON), "{took:?}");
    });
}

/// A panic while an answer is made ends that connection alone, and the work goes on.
///
/// Promise (servers): a panic while an answer is made ends one connection alone.
#[test]
fn a_panic_ends_one_connection_alone() {
    let moving = Moving::new(|time| if time > 0.9 { panic!("of this moment") } else { gaussians(5) });
    let scene_page = ScenePage { moving: Some(moving), ..scene_page(None) };
    let server = Server::new(&scene_page, None, here()).unwrap();
    let work = server.during(|| {
        for _ in 0..10 {
            let mut stream = connect(&server);
            write!(stream, "GET /scene?time=1 HTTP/1.1\r\nHost: {}\r\n\r\n", place(&server)).unwrap();
            assert!(rest(&mut stream).is_empty());
        }
        assert_eq!(get(&server, "/scene?time=0.1").0, 200);
        "done"
    });
    assert_eq!(work, "done");
}

/// A port that another program listens at is refused in one line.
///
/// Promise (servers): a taken port is refused at the start, and a port is kept.
#[test]
fn a_taken_port_is_refused() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    for access in [Access::Local, Access::Network] {
        let error = Listener::bind(access, Some(port)).unwrap_err().to_string();
        assert!(
            error.ends_with(
                ":{port}: expected a free port, found one where another program listens"
                    .replace("{port}", &port.to_string())
                    .as_str()
            ),
            "{error}"
        );
    }
    drop(taken);
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, Listener::bind(Access::Local, Some(port)).unwrap()).unwrap();
    assert!(server.address().starts_with(&format!("http://127.0.0.1:{port}/?token=")));
    assert_eq!(server.network_address(), None);
    server.during(|| assert_eq!(get(&server, "/").0, 200));
}

/// A server for the network has an address for clients in it.
///
/// Promise (servers): clients on the network get an address that they can open.
#[test]
fn the_network_is_told_an_address_that_it_can_open() {
    let scene_page = scene_page(None);
    let server = Server::new(&scene_page, None, Listener::bind(Access::Network, None).unwrap()).unwrap();
    // A machine without any network may have a name alone, or not even that.
    let Some(address) = server.network_address() else { return };
    let [own, other] = [server.address(), address].map(|address| {
        let (host, rest) = address.trim_start_matches("http://").split_once(':').unwrap();
        (host.to_string(), rest.to_string())
    });
    assert!(own.0 == "127.0.0.1" && own.1 == other.1 && !other.0.is_empty(), "{own:?} {other:?}");
    assert!(!other.0.starts_with("127.") && other.0 != "0.0.0.0", "{other:?}");
}

/// Numbers drawn at random.
struct Draws(u64);

impl Draws {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % end.max(1)
    }

    fn of<'a>(&mut self, choices: &[&'a [u8]]) -> &'a [u8] {
        choices[self.below(choices.len())]
    }

    /// A request with something wrong: bytes changed, left out, put in or repeated.
    fn request(&mut self, seeds: &[String]) -> Vec<u8> {
        const PIECES: [&[u8]; 20] = [
            b"\r\n",
            b"\n",
            b"\0",
            b" ",
            b":",
            b"?",
            b"%00",
            b"..",
            b"HTTP/2.0",
            b"Host: ",
            b"X-Token: ",
            b"\xff\xfe",
            b"0",
            b"Content-Length: 99999999999999\r\n",
            b"Content-Length: 18446744073709551615\r\n",
            b"Content-Length: -1\r\n",
            b"Transfer-Encoding: chunked\r\n",
            b"Expect: 100-continue\r\n",
            b"/photo/99999999999999999999",
            b"&time=nan",
        ];
        let mut bytes = seeds[self.below(seeds.len())].clone().into_bytes();
        for _ in 0..=self.below(4) {
            let at = self.below(bytes.len() + 1);
            match self.below(6) {
                0 => bytes.truncate(at),
                1 => drop(bytes.splice(at..at, self.of(&PIECES).iter().copied())),
                2 if at < bytes.len() => bytes[at] = self.below(256) as u8,
                3 => drop(bytes.drain(at..(at + self.below(9)).min(bytes.len()))),
                4 => {
                    let part = bytes[at..(at + self.below(40)).min(bytes.len())].repeat(1 + self.below(30));
                    drop(bytes.splice(at..at, part));
                }
                _ => bytes.extend(std::iter::repeat_n(self.below(256) as u8, self.below(3000))),
            }
        }
        bytes
    }
}

/// Every request gets an answer of HTTP or none, nothing is written without the token, and the next request is
/// answered: hundreds of mutated requests, a million under stress.
///
/// Promise (servers): mutated requests are answered or refused, a million under stress.
#[test]
fn mutated_requests_are_answered_or_refused() {
    let count = if std::env::var_os("WEAVER_STRESS").is_some() { 1_000_000 } else { 600 };
    let folder = tempfile::tempdir().unwrap();
    let scene_page = scene_page(Some(folder.path().join("scene.ply")));
    let server = Server::new(&scene_page, None, here()).unwrap();
    let place = place(&server);
    let head = format!("HTTP/1.1\r\nHost: {place}\r\nX-Token: 0123456789abcdef0123456789abcdef\r\n");
    let seeds = [
        format!("GET /scene {head}\r\n"),
        format!("GET /photo/0?token=x {head}\r\n"),
        format!("GET /progress?since=4&time=0.5 {head}\r\n"),
        format!("POST /save?format=ply {head}Content-Length: 35\r\n\r\n{}", "\0".repeat(35)),
        format!("POST /stop {head}Content-Length: 0\r\n\r\n"),
        format!("HEAD / {head}Accept: */*\r\nCookie: a=b\r\n\r\n"),
    ];
    let (mut draws, begin, failed) = (Draws(7), Instant::now(), AtomicBool::new(false));
    let mut statuses = std::collections::BTreeMap::new();
    server.during(|| {
        for i in 0..count {
            let request = draws.request(&seeds);
            let mut stream = TcpStream::connect(&place).unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
            let _ = stream.write_all(&request);
            // A request without an end: here the client has no more to say.
            let _ = stream.shutdown(Shutdown::Write);
            let answer = rest(&mut stream);
            let status = answer.get(..12).map(|start| String::from_utf8_lossy(start).into_owned());
            let known = status.as_deref().is_none_or(|status| status.starts_with("HTTP/1.1 "));
            failed.fetch_or(!known, Ordering::Relaxed);
            assert!(known, "request {i}: {request:?}: {status:?}");
            *statuses.entry(status.unwrap_or("none".into())).or_insert(0) += 1;
        }
        assert_eq!(get(&server, "/").0, 200);
    });
    println!("{count} requests in {:?}: {statuses:?}", begin.elapsed());
    assert!(statuses.len() > 4 && !statuses.contains_key("HTTP/1.1 500"), "{statuses:?}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
