//! The record of a folder, read by others than its writer.

use std::fs;
use weaver_io::{OutputFolder, write_text, written};

/// A record is read while another command has the folder; a cut line and names that lead elsewhere are left out.
///
/// Promise (files): the record of a folder is read without a claim; names that lead out of it are left out.
#[test]
fn a_record_is_read_without_a_claim() {
    let folder = tempfile::tempdir().unwrap();
    assert!(written(folder.path()).unwrap().is_empty());
    let out = OutputFolder::claim(folder.path(), "fit", [""; 0]).unwrap();
    // Windows has no quotes in names.
    let name = if cfg!(windows) { "sparse/0/a b.bin" } else { "sparse/0/a \"b\".bin" };
    write_text(out.file(name).unwrap(), "").unwrap();
    let found = written(folder.path()).unwrap();
    assert_eq!(found.into_iter().collect::<Vec<_>>(), [(name.to_string(), "fit".to_string())]);
    drop(out);
    let record = folder.path().join("written.jsonl");
    let lines = "{\"by\":\"fit\",\"file\":\"../thesis.txt\"}\n{\"by\":\"fit\",\"file\":\"/etc/motd\"}\n{\"by\":\"fit\",\"file\":\"a.p";
    fs::write(&record, fs::read_to_string(&record).unwrap() + lines).unwrap();
    assert_eq!(written(folder.path()).unwrap().len(), 1);
}
