use weaver_io::{Appender, check_writable, create_folder, list_files, read_text, write_text};

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
