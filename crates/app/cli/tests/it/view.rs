//! Scenes that are looked at: pages in files, servers, live runs, paths and moving pictures.

use crate::command::{BINARY, capture, printed, refused};
use crate::compare::gaussians;
use crate::in_process::with_slashes;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use weaver_io::safetensors::Tensors;

fn scene(folder: &Path) {
    weaver_io::write_gaussians(folder.join("scene.ply"), &gaussians()).unwrap();
}

/// The first line with an address, and the output after it.
fn address(output: impl Read) -> (String, BufReader<impl Read>) {
    let mut lines = BufReader::new(output);
    let mut line = String::new();
    while lines.read_line(&mut line).unwrap() > 0 {
        if let Some(at) = line.find("http://") {
            return (line[at..].trim().to_string(), lines);
        }
        line.clear();
    }
    panic!("no address");
}

/// Status line and body of an answer.
fn asked(address: &str, method: &str, path: &str) -> (String, Vec<u8>) {
    let (place, token) = address.trim_start_matches("http://").split_once("/?token=").unwrap();
    let mut stream = TcpStream::connect(place).unwrap();
    let head = format!(
        "{method} {path} HTTP/1.1\r\nHost: {place}\r\nX-Token: {token}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let end = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
    (String::from_utf8_lossy(&answer[..end]).lines().next().unwrap().to_string(), answer[end + 4..].to_vec())
}

fn start(folder: &Path, line: &str) -> Child {
    let mut command = Command::new(BINARY);
    command
        .current_dir(folder)
        .args(line.split_whitespace())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

#[test]
fn a_page_is_one_file_and_replaces_nothing_else() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    scene(folder);
    let said = printed(folder, "view scene.ply --html out.html");
    assert!(said.starts_with("page: 24 Gaussians, 0.") && said.contains("out.html"), "{said}");
    let small = std::fs::metadata(folder.join("out.html")).unwrap().len();
    printed(folder, "view scene.ply --html out.html --lossless");
    assert!(std::fs::metadata(folder.join("out.html")).unwrap().len() > small);
    let before = std::fs::read(folder.join("scene.ply")).unwrap();
    let message = refused(folder, "view scene.ply --html scene.ply", 2);
    assert!(message.contains("scene.ply"), "{message}");
    assert!(std::fs::read(folder.join("scene.ply")).unwrap() == before);
    refused(folder, "view scene.ply --lossless", 2);
    refused(folder, "view scene.ply --expert keys", 2);
    let message = refused(folder, "view nothere", 1);
    assert!(
        message.contains("nothere: expected a file of Gaussians (.ply, ") && message.ends_with("found neither\n"),
        "{message}"
    );
    std::fs::create_dir(folder.join("empty")).unwrap();
    assert!(refused(folder, "view empty", 1).contains("empty: expected a folder with one of scene.ply, "));
}

#[test]
fn a_fit_leaves_a_page_that_its_report_leads_to() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    let said = printed(folder, "fit capture -o fit --steps 3 --gaussians 200");
    assert!(with_slashes(&said).contains("look: fit/view.html"), "{said}");
    let report = std::fs::read_to_string(folder.join("fit/report.html")).unwrap();
    let page = std::fs::read_to_string(folder.join("fit/view.html")).unwrap();
    assert!(page.contains("<title>capture</title>") && page.contains("images/00.png"));
    // The page is in the report as well.
    let within = "srcdoc=\"&lt;!doctype html&gt;";
    assert!(report.contains("href=\"./view.html\"") && report.contains(within) && report.len() > page.len());
    printed(folder, "fit capture -o bare --steps 3 --gaussians 200 --no-html");
    assert!(!folder.join("bare/view.html").exists());
    assert!(!std::fs::read_to_string(folder.join("bare/report.html")).unwrap().contains("view.html"));
    // A folder is opened with all files in it.
    printed(folder, "view fit --html again.html");
    assert!(std::fs::read_to_string(folder.join("again.html")).unwrap().contains("images/00.png"));
}

#[cfg(unix)]
#[test]
fn a_server_shows_a_folder_until_it_is_interrupted() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    printed(folder, "fit capture -o fit --steps 3 --gaussians 200");
    let mut child = start(folder, "view fit");
    let (address, _rest) = address(child.stdout.take().unwrap());
    for (path, status) in
        [("/", "200"), ("/scene", "200"), ("/photo/0", "200"), ("/report", "200"), ("/fit/run.json", "404")]
    {
        let (line, body) = asked(&address, "GET", path);
        assert!(line.contains(status) && !body.is_empty(), "{path}: {line}");
    }
    interrupt(child);
}

/// A port that another program listens at is refused in one line, by runs before there is a folder; one that is free is
/// kept.
///
/// Promise of `a_taken_port_is_refused`.
#[test]
fn a_taken_port_is_refused_before_any_work() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    scene(folder);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    for line in ["fit capture -o run", "reconstruct capture -o run", "train --preset micro -o run"] {
        let message = refused(folder, &format!("{line} --live --port {port}"), 1);
        let expected = format!("127.0.0.1:{port}: expected a free port, found one where another program listens\n");
        assert!(message.ends_with(&expected) && message.lines().count() == 1, "{message}");
        assert!(!folder.join("run").exists(), "{line}");
    }
    refused(folder, "fit capture -o run --port 8080", 2);
    refused(folder, "view scene.ply --port 0", 2);
    refused(folder, &format!("view scene.ply --port {port}"), 1);
    drop(taken);
    let mut child = start(folder, &format!("view scene.ply --port {port}"));
    let (address, _rest) = address(child.stdout.take().unwrap());
    assert!(address.starts_with(&format!("http://127.0.0.1:{port}/?token=")), "{address}");
    assert!(asked(&address, "GET", "/scene").0.contains("200"));
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Waits until a followed run reports this progress.
fn progress(address: &str, expected: &str) -> String {
    let mut progress = String::new();
    for _ in 0..1200 {
        progress = String::from_utf8(asked(address, "GET", "/progress?since=0").1).unwrap();
        if progress.contains(expected) {
            return progress;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    panic!("waited in vain for {expected}: {progress}");
}

/// Interrupts a server, which then ends well.
#[cfg(unix)]
fn interrupt(mut child: Child) {
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    assert!(child.wait().unwrap().success());
}

/// Ends a server where no signal can be sent to it.
#[cfg(not(unix))]
fn interrupt(mut child: Child) {
    child.kill().unwrap();
    child.wait().unwrap();
}

/// Promise of `a_click_shows_and_selects_what_is_alike`.
#[test]
fn lifted_features_are_served_beside_their_scene() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    scene(folder);
    let lifted = |name: &str, gaussians: usize| {
        let mut tensors = Tensors::default();
        tensors.insert("features", &[gaussians, 2], (0..2 * gaussians).map(|i| i as f32).collect());
        tensors.write(folder.join(name)).unwrap();
    };
    lifted("lifted.safetensors", 24);
    let mut child = start(folder, "view scene.ply --lifted lifted.safetensors --meters 0.5");
    let (address, _rest) = address(child.stdout.take().unwrap());
    let (status, alike) = asked(&address, "GET", "/alike?gaussian=5");
    assert!(status.contains("200") && alike.len() == 24 && alike[5] == 255, "{status}, {alike:?}");
    assert!(String::from_utf8(asked(&address, "GET", "/").1).unwrap().contains("\"meters\":0.5"));
    interrupt(child);
    lifted("others.safetensors", 23);
    let message = refused(folder, "view scene.ply --lifted others.safetensors", 1);
    assert!(message.contains("others.safetensors: expected features of 24 Gaussians"), "{message}");
    refused(folder, "view scene.ply --meters 0", 2);
    refused(folder, "view scene.ply --lifted lifted.safetensors --html a.html", 2);
}

/// Promise of `a_page_follows_a_run_and_ends_it`.
#[test]
fn a_live_fit_is_stopped_from_its_page_and_saves() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    let mut child = start(folder, "fit capture -o fit --steps 100000 --gaussians 300 --live");
    let (address, mut rest) = address(child.stderr.take().unwrap());
    assert!(progress(&address, "PSNR of the photos looked at, dB").contains("\"of\":100000"));
    let (line, _) = asked(&address, "POST", "/stop");
    assert!(line.contains("200"), "{line}");
    let mut said = String::new();
    rest.read_to_string(&mut said).unwrap();
    assert!(child.wait().unwrap().success(), "{said}");
    assert!(said.contains("to go on: splatweaver fit --resume fit"), "{said}");
    assert!(folder.join("fit/checkpoint.safetensors").is_file() && folder.join("fit/view.html").is_file());
}

/// A picture under way is drawn from its checkpoints. A fit of one file leaves nothing but the file.
///
/// Promise (scenes): fits of pictures are followed, and one file leaves one file.
#[test]
fn fits_of_pictures_are_followed() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    let photos = folder.join("capture/images");
    let photo = std::fs::read_dir(&photos).unwrap().next().unwrap().unwrap().path();
    std::fs::copy(photo, folder.join("photo.png")).unwrap();
    let lines = [
        ("image fit photo.png -o photo.wgi --gaussians 20 --steps 200000 --live", ": photo.wgi"),
        ("image fit photo.png -o small.wgi --bytes 500 --steps 200000 --live", ": small.wgi"),
        (
            "image fit capture/images -o run --gaussians 20 --steps 200000 --live",
            "saved; to go on: splatweaver image fit",
        ),
    ];
    // Each waits for its first checkpoint: all at once.
    for (line, end, mut child) in lines.map(|(line, end)| (line, end, start(folder, line))) {
        let (address, _rest) = address(child.stderr.take().unwrap());
        let png = (0..600).find_map(|_| {
            std::thread::sleep(std::time::Duration::from_millis(50));
            let (status, body) = asked(&address, "GET", "/picture");
            status.contains("200").then_some(body)
        });
        assert!(png.is_some_and(|png| png.starts_with(b"\x89PNG")), "{line}");
        assert!(progress(&address, "\"Gaussians\"").contains("\"loss"));
        assert!(asked(&address, "POST", "/stop").0.contains("200"));
        let mut said = String::new();
        child.stdout.take().unwrap().read_to_string(&mut said).unwrap();
        assert!(child.wait().unwrap().success() && said.contains(end), "{said}");
    }
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort_unstable();
    assert_eq!(names, ["capture", "photo.png", "photo.wgi", "run", "small.wgi"]);
}

/// A network has no scene to show: its page has curves and pictures. A film's has the scene of the expert at hand.
#[test]
fn other_runs_are_followed_as_well() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let film =
        "dynamic train -o film --shots 2x4 --long-side 16 --experts keys,poly --gaussians 40 --steps 100000 --live";
    printed(
        folder,
        "dynamic train -o small --shots 2x4 --long-side 16 --experts keys,poly --gaussians 40 --steps 2 --router-steps 2",
    );
    printed(folder, "view small --html film.html --moments 3");
    let page = std::fs::read_to_string(folder.join("film.html")).unwrap();
    assert!(page.contains("id=\"moment-2\"") && !page.contains("id=\"moment-3\""));
    let lines = [
        ("train --preset micro --steps 100000 -o run --live", "404"),
        ("vad train --steps 100000 --out anomalies --live", "404"),
        (film, "200"),
        ("dynamic prune --run small --keep 0.5 --steps 100000 -o pruned --live", "200"),
        ("dynamic distil --run small --expert poly --steps 100000 -o distilled --live", "200"),
    ];
    for (line, scene) in lines {
        let mut child = start(folder, line);
        let (address, mut rest) = address(child.stderr.take().unwrap());
        assert!(progress(&address, "loss").contains("\"version\":"));
        assert!(asked(&address, "GET", "/").0.contains("200"));
        let (status, _) = asked(&address, "GET", "/scene");
        assert!(status.contains(scene), "{line}: {status}");
        assert!(asked(&address, "POST", "/stop").0.contains("200"));
        let mut said = String::new();
        rest.read_to_string(&mut said).unwrap();
        assert!(child.wait().unwrap().success() && said.contains("to go on:"), "{said}");
    }
}

#[test]
fn paths_along_cameras_become_moving_pictures() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    capture(folder);
    scene(folder);
    for path in ["ellipse", "spline", "dolly"] {
        let line = format!(
            "render scene.ply --cameras capture/transforms.json --path {path} --pictures 4 --gif {path}.gif --webp {path}.webp -o {path}"
        );
        let said = printed(folder, &line);
        let files = format!("{path} and {path}.gif and {path}.webp");
        assert!(said.contains(&format!("pictures: 4 of 24 Gaussians, in {files}")), "{said}");
        let webp = std::fs::read(folder.join(format!("{path}.webp"))).unwrap();
        assert_eq!(webp.windows(4).filter(|part| *part == b"ANMF").count(), 4);
        let gif = std::fs::read(folder.join(format!("{path}.gif"))).unwrap();
        assert!(gif.starts_with(b"GIF89a") && gif.windows(11).any(|part| part == b"NETSCAPE2.0"));
        // One graphic control block for each picture.
        assert_eq!(gif.windows(3).filter(|part| *part == [0x21, 0xf9, 0x04]).count(), 4);
        assert_eq!(
            std::fs::read_dir(folder.join(path))
                .unwrap()
                .filter(|e| e.as_ref().unwrap().path().extension().is_some_and(|e| e == "png"))
                .count(),
            4
        );
    }
    let message = refused(folder, "render scene.ply --orbit 4 --path spline -o x", 2);
    assert!(message.contains("--orbit"), "{message}");
}
