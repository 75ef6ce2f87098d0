use proptest::prelude::*;
use std::cmp::Ordering;
use weaver_io::{
    Appender, Checksum, check_writable, create_folder, list_files, natural_order, read_text, relative_path, write_text,
};

#[test]
fn lists_sorted_files_of_some_extensions() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("a/b");
    create_folder(&folder).unwrap();
    for name in ["2.JPG", "1.png", "3.txt", "none"] {
        write_text(folder.join(name), "x").unwrap();
    }
    create_folder(folder.join("0.png")).unwrap();
    let expected = ["1.png", "2.JPG"].map(|n| folder.join(n));
    assert_eq!(list_files(&folder, &["jpg", "png"]).unwrap(), expected);
    let message = list_files(folder.join("gone"), &["jpg"]).unwrap_err().to_string();
    assert!(message.contains("gone"), "{message}");
}

#[test]
fn folders_are_tried_and_left_as_they_are() {
    let root = tempfile::tempdir().unwrap();
    check_writable(root.path()).unwrap();
    check_writable(root.path().join("a/b")).unwrap();
    assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 0);
    let file = root.path().join("file");
    write_text(&file, "x").unwrap();
    for below in [file.clone(), file.join("folder")] {
        let message = check_writable(below).unwrap_err().to_string();
        assert!(message.contains("expected one that can be written to, found a file"), "{message}");
    }
}

#[test]
fn logs_grow_across_openings() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log");
    for record in ["one\n", "two\n"] {
        Appender::open(&path).unwrap().append(record.as_bytes()).unwrap();
    }
    assert_eq!(read_text(&path).unwrap(), "one\ntwo\n");
}

#[test]
fn text_must_be_utf8() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("text");
    std::fs::write(&path, b"ab\xff").unwrap();
    let message = read_text(&path).unwrap_err().to_string();
    assert!(message.contains("text: byte 2: expected UTF-8 text"), "{message}");
}

/// Promise of `a_byte_order_mark_is_no_part_of_json`.
#[test]
fn a_byte_order_mark_is_no_part_of_a_text() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.txt");
    let text = "http://a\n33000 0.5 0.8 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n";
    std::fs::write(&path, format!("\u{feff}{text}")).unwrap();
    assert_eq!(read_text(&path).unwrap(), text);
    let clip = weaver_io::realestate::Clip::read(&path).unwrap();
    assert_eq!((clip.url.as_str(), clip.frames.len()), ("http://a", 1));
    // Only where it begins, and only one.
    std::fs::write(&path, "\u{feff}\u{feff}a").unwrap();
    assert_eq!(read_text(&path).unwrap(), "\u{feff}a");
}

/// Text that Windows programs write in UTF-16 is called so.
///
/// Promise (servers): text in UTF-16 is named; lines may end in a carriage return alone; a file without cameras is
/// none of cameras.
#[test]
fn text_in_utf16_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    for (mark, swap) in [([0xff, 0xfe], false), ([0xfe, 0xff], true)] {
        let units =
            "steps = 5".encode_utf16().flat_map(|unit| if swap { unit.to_be_bytes() } else { unit.to_le_bytes() });
        std::fs::write(&path, Vec::from_iter(mark.into_iter().chain(units))).unwrap();
        let message = read_text(&path).unwrap_err().to_string();
        assert!(message.contains("mine.toml: byte 0: expected UTF-8 text, found UTF-16"), "{message}");
    }
}

/// A pipe in place of a file of weights is refused, where to open it would wait for ever.
///
/// Promise (servers): a pipe in place of weights is not waited for.
#[cfg(unix)]
#[test]
fn a_pipe_is_not_mapped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let message = weaver_io::safetensors::Mapped::open(&path).unwrap_err().to_string();
    assert!(message.contains("model.safetensors: file: expected a regular file"), "{message}");
}

/// Lines that end in a carriage return alone are lines, so that a comment at the start does not hide all that follows.
///
/// Promise of `text_in_utf16_is_named`.
#[test]
fn lines_may_end_in_a_carriage_return() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.txt");
    let text = "http://a\n33000 0.5 0.8 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n";
    std::fs::write(&path, text.replace('\n', "\r")).unwrap();
    let clip = weaver_io::realestate::Clip::read(&path).unwrap();
    assert_eq!((clip.url.as_str(), clip.frames.len()), ("http://a", 1));
    // A file without cameras is none of cameras.
    std::fs::write(&path, "http://a\n").unwrap();
    let message = weaver_io::realestate::Clip::read(&path).unwrap_err().to_string();
    assert!(message.contains("lines: expected a camera on each after the first, found none"), "{message}");
}

/// Promise (photos): estimated cameras, and a fit's cameras, can be moved together with their photos, and the COLMAP
/// model alone is a capture.
#[test]
fn a_relative_path_leads_from_a_folder_to_a_file() {
    let root = tempfile::tempdir().unwrap();
    let at = |name: &str| root.path().join(name);
    for folder in ["photos/left", "out"] {
        create_folder(at(folder)).unwrap();
    }
    let from_to = |from: &str, to: &str| relative_path(at(from), at(to)).unwrap();
    assert_eq!(from_to("out", "photos/left/a b.jpg"), "../photos/left/a b.jpg");
    assert_eq!(from_to("out", "out/upright/a.png"), "upright/a.png");
    assert_eq!(from_to("out/../out", "photos/../photos/a.jpg"), "../photos/a.jpg");
    // A target that does not exist yet is written to later.
    assert_eq!(from_to("new/deep", "photos/a.jpg"), "../../photos/a.jpg");
    assert_eq!(from_to("new/../gone", "elsewhere/./a.jpg"), "../elsewhere/a.jpg");
    // From any working directory.
    assert_eq!(relative_path("", "src/lib.rs").unwrap(), "src/lib.rs");
}

/// A relative path follows links but keeps the name of the file.
///
/// Promise of `a_relative_path_leads_from_a_folder_to_a_file`.
#[cfg(unix)]
#[test]
fn relative_paths_keep_the_name_of_the_file() {
    use std::os::unix::{ffi::OsStrExt, fs::symlink};
    let root = tempfile::tempdir().unwrap();
    let at = |name: &str| root.path().join(name);
    create_folder(at("far/away/results")).unwrap();
    create_folder(at("photos")).unwrap();
    write_text(at("photos/0.jpg"), "x").unwrap();
    symlink(at("photos/0.jpg"), at("photos/first.jpg")).unwrap();
    symlink(at("far/away/results"), at("out")).unwrap();
    let path = relative_path(at("out"), at("photos/first.jpg")).unwrap();
    assert_eq!(path, "../../../photos/first.jpg", "`..` leads out of where the link ends");
    assert!(at("out").join(path).exists());
    let named = at("photos").join(std::ffi::OsStr::from_bytes(b"\xff.jpg"));
    let message = relative_path(at("out"), named).unwrap_err().to_string();
    assert!(message.contains("photos") && message.contains("expected UTF-8"), "{message}");
}

proptest! {
    /// The order of names is one: no two are equal, and three never contradict each other. It is the order of bytes
    /// where numbers are equally long.
    ///
    /// Promise of `scans_are_taken_in_the_order_of_their_numbers`.
    #[test]
    fn natural_order_is_an_order(names in proptest::collection::hash_set("[0-2a.]{0,6}", 3), numbers: [[u8; 2]; 2]) {
        let order = |a: &str, b: &str| natural_order(a.as_ref(), b.as_ref());
        let mut names: Vec<String> = names.into_iter().collect();
        names.sort_by(|a, b| order(a, b));
        for (a, b) in [(0, 1), (1, 2), (0, 2)] {
            prop_assert_eq!(order(&names[a], &names[b]), Ordering::Less);
            prop_assert_eq!(order(&names[b], &names[a]), Ordering::Greater);
        }
        let [a, b] = numbers.map(|[a, b]| format!("scan{a:03}-{b:03}.bin"));
        prop_assert_eq!(order(&a, &b), a.cmp(&b));
    }
}

/// The checksum of a file that is read a part at a time equals the checksum of its bytes, at any length.
///
/// Promise of `inputs_are_compared_by_their_files`.
#[test]
fn files_have_the_checksum_of_their_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let part = 1 << 16;
    for length in [0, 1, 7, 8, 9, part - 1, part, part + 1, 3 * part + 13] {
        let bytes: Vec<u8> = (0..length).map(|i: usize| (i.wrapping_mul(0x9e37_79b9) >> 7) as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        let [mut whole, mut parts] = [Checksum::default(); 2];
        whole.bytes(&bytes);
        parts.file(&path).unwrap();
        assert_eq!(whole, parts, "{length} bytes");
    }
    let message = Checksum::default().file(folder.path().join("gone")).unwrap_err().to_string();
    assert!(message.contains("gone"), "{message}");
}
