//! Files of other programs that cannot be read.

use crate::project::{BUNDLER, METASHAPE, OPENSFM, written};
use weaver_io::{Project, ProjectKind};

fn error(name: &str, text: &str, photos: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("list.txt"), "a.png\nb.png\nc.png\n").unwrap();
    let path = written(folder.path(), name, text, photos, [60, 80]);
    Project::read(path).unwrap_err().to_string()
}

/// Promise (files): cameras of other programs that cannot be used are refused by file, key and remedy.
#[test]
fn metashape_errors_name_the_remedy() {
    let photo = ["000001-01_00001.png"];
    let changed = |from: &str, to: &str| {
        assert!(METASHAPE.contains(from), "{from}");
        error("cameras.xml", &METASHAPE.replace(from, to), &photo)
    };
    let chunk = &METASHAPE[METASHAPE.find("<chunk").unwrap()..METASHAPE.find("</document>").unwrap()];
    for (message, said) in [
        (error("cameras.xml", METASHAPE, &[]), "camera \"nadir\\\\000001-01_00001.JPG\": expected the photo"),
        (error("cameras.xml", METASHAPE, &["x/000001-01_00001.JPG", "y/000001-01_00001.JPG"]), "several of"),
        (error("cameras.xml", &METASHAPE[..2000], &photo), "export it again if it is cut off"),
        (changed("</document>", &format!("{chunk}</document>")), "expected one chunk of aligned photos; merge"),
        (changed("sensor_id=\"0\" component", "sensor_id=\"5\" component"), "sensor_id: expected a sensor"),
        (changed("type=\"frame\" class=\"adjusted\"", "type=\"spherical\" class=\"adjusted\""), "found spherical"),
        (changed("<b2>-0.3058334293</b2>", "<b2>-9</b2>"), "optimize without B2"),
        (changed("<p1>", "<p3>0.1</p3><p1>"), "p3: expected 0; optimize without it"),
        (changed("<k4>-0.0761413904</k4>", "<k4>-3e9</k4>"), "optimize without K4"),
        (changed("7.05403071", "nan"), "transform: expected 16 finite numbers"),
        (changed("-0.99988146", "-0.5"), "transform: expected a rotation and a shift"),
        (changed("<f>3705.4728792737214</f>", "<f>0</f>"), "f: expected a positive focal length"),
        (changed("width=\"5280\"", "width=\"0\""), "width: expected a size in pixels"),
        (changed("<transform>-0.99988146", "<none>-0.99988146").replace("</none>", ""), "cut off"),
    ] {
        assert!(message.contains("cameras.xml") && message.contains(said), "{said}: {message}");
    }
    let unaligned = METASHAPE.replace("label=\"nadir", "enabled=\"false\" label=\"nadir");
    assert!(error("cameras.xml", &unaligned, &photo).contains("at least one photo with a pose: align the photos"));
    let again = METASHAPE.replace("<camera id=\"1\" sensor_id=\"0\" label=\"000001-01_00002.JPG\"/>", {
        let at = METASHAPE.find("<camera id").unwrap();
        &METASHAPE[at..METASHAPE.find("</camera>").unwrap() + 9]
    });
    assert!(error("cameras.xml", &again, &photo).contains("photos: expected each photo once"));
}

/// Promise of `metashape_errors_name_the_remedy`.
#[test]
fn other_errors_name_the_remedy() {
    let csv = |rows: &str| error("c.csv", &format!("#name,x,y,alt,heading,pitch,roll,f\n{rows}"), &["a.png"]);
    let out = |from: &str, to: &str| error("bundle.out", &BUNDLER.replacen(from, to, 1), &["a.png", "c.png"]);
    let sfm = |from: &str, to: &str| error("r.json", &OPENSFM.replace(from, to), &["a.jpg", "b.jpg"]);
    for (message, said) in [
        (csv("a.png,1,2,3,0,0,0,0\n"), "line 2, f: expected a positive focal length"),
        (csv("a.png,1,2,3,0,x,0,18\n"), "line 2, pitch: expected a finite number, found \"x\""),
        (csv("a.png,1,2,3\n"), "line 2, heading: expected a finite number, found \"\""),
        (csv("b.png,1,2,3,0,0,0,18\n"), "line 2, name: expected the photo \"b.png\""),
        (csv("a.png,1,2,3,0,0,0,18\na.png,1,2,3,0,0,0,18\n"), "expected each photo once"),
        (csv(""), "at least one photo with a pose"),
        (error("c.csv", "#name,x,y,alt,heading,pitch,roll\n", &[]), "export Internal/External camera parameters"),
        (out("# Bundle file v0.3", "# Bundle file v0.1"), "expected # Bundle file v0.3"),
        (out("3 2\n", "2 2\n"), "list.txt: photos: expected a line for each of 2 cameras"),
        (out("1 0 6 0 0\n", ""), "the end of the file: it is cut off"),
        (out("2 0 5", "2 9 5"), "expected a camera below 3, found 9"),
        (out("1 0 0\n", "1 0 5\n"), "camera 0 (a.png): expected a rotation"),
        (error("bundle.out", BUNDLER, &["a.png"]), "camera 2 (c.png): expected the photo"),
        (sfm("perspective", "spherical"), "projection_type: expected perspective"),
        (sfm("\"camera\": \"phone\"", "\"camera\": \"none\""), "cameras.none: expected a camera"),
        (sfm("\"width\": 300", "\"width\": 300.5"), "phone.width: expected a size in pixels"),
        (sfm("\"focal\": 0.9", "\"focal\": 0"), "phone.focal: expected a positive number"),
        (sfm("[1.0, 2.0, 3.0]", "[1.0, 2.0]"), "a.jpg.translation: expected 3 numbers"),
        (error("a.json", "{}", &[]), "expected cameras of Metashape (XML)"),
    ] {
        assert!(message.contains(said), "{said}: {message}");
    }
}

#[test]
fn other_files_are_of_no_project() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("a.xml", "<?xml version=\"1.0\"?><svg/>"),
        ("b.csv", "name,x,y,z\na,1,2,3\n"),
        ("c.json", "{\"frames\": []}"),
        ("d.json", "[1, 2]"),
        ("e.out", ""),
    ] {
        let path = written(folder.path(), name, text, &[], [1, 1]);
        assert_eq!(ProjectKind::of(path).unwrap(), None, "{name}");
    }
    assert_eq!(Project::find(folder.path()).unwrap(), None);
    let first = written(folder.path(), "f.xml", METASHAPE, &[], [1, 1]);
    assert_eq!(Project::find(folder.path()).unwrap(), Some(first));
    written(folder.path(), "g.out", BUNDLER, &[], [1, 1]);
    let message = Project::find(folder.path()).unwrap_err().to_string();
    assert!(message.contains("name the one to read, found f.xml, g.out"), "{message}");
}
