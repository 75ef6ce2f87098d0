//! Folders of results: whose files they are.

use std::fs;
use std::path::Path;
use weaver_io::{OutputFolder, check_output_file, check_output_folder, write_text};

const NOTHING: [&str; 0] = [];

/// The message of a refusal, which names this.
fn refused<T: std::fmt::Debug>(result: weaver_io::Result<T>, named: &[&str]) {
    let message = result.unwrap_err().to_string();
    named.iter().for_each(|part| assert!(message.contains(part), "{part}: {message}"));
}

fn claim(folder: &Path, command: &str) -> OutputFolder {
    OutputFolder::claim(folder, command, NOTHING).unwrap()
}

/// Files are replaced only by the command that wrote them.
///
/// Promise (kept): no command replaces its inputs, or files that the same command did not write before; it refuses
/// before any work.
#[test]
fn only_the_writer_replaces_files() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("capture");
    fs::create_dir_all(folder.join("sparse/0")).unwrap();
    fs::write(folder.join("sparse/0/points3D.bin"), "somebody's").unwrap();
    let out = claim(&folder, "cameras");
    refused(out.check(["transforms.json", "sparse/0/points3D.bin"]), &["points3D.bin", "output", "written.jsonl"]);
    refused(out.files("sparse/0", ["cameras.bin", "points3D.bin"]), &["points3D.bin"]);
    write_text(out.file("transforms.json").unwrap(), "{}").unwrap();
    drop(out);
    let again = claim(&folder, "cameras");
    again.check(["transforms.json"]).unwrap();
    again.file("transforms.json").unwrap();
    drop(again);
    let other = claim(&folder, "infer");
    refused(other.check(["transforms.json"]), &["transforms.json", "`infer`", "`cameras`"]);
    assert_eq!(fs::read_to_string(folder.join("sparse/0/points3D.bin")).unwrap(), "somebody's");
}

/// Promise of `only_the_writer_replaces_files`.
#[test]
fn nothing_is_written_where_something_is_read() {
    let parent = tempfile::tempdir().unwrap();
    let photos = parent.path().join("photos");
    fs::create_dir(&photos).unwrap();
    fs::write(photos.join("notes.txt"), "mine").unwrap();
    refused(OutputFolder::claim(&photos, "fit", [&photos]), &["photos", "apart from what is read"]);
    refused(OutputFolder::claim(photos.join("a/b"), "fit", [&photos]), &["a/b", "a place in", "photos"]);
    assert!(!photos.join("a").exists());
    #[cfg(unix)]
    {
        let link = parent.path().join("link");
        std::os::unix::fs::symlink(&photos, &link).unwrap();
        refused(OutputFolder::claim(link.join("new"), "fit", [&photos]), &["link/new"]);
        refused(OutputFolder::claim(photos.join("new"), "fit", [&link]), &["photos/new"]);
    }
    // Beside the inputs: but not in them.
    let out = OutputFolder::claim(parent.path(), "fit", [&photos]).unwrap();
    out.check(["photo"]).unwrap();
    refused(out.file("photos/new.png"), &["photos/new.png", "apart from what is read"]);
    // A file that this command wrote, and now reads.
    write_text(out.file("given.txt").unwrap(), "cameras").unwrap();
    drop(out);
    let out = OutputFolder::claim(parent.path(), "fit", [parent.path().join("given.txt")]).unwrap();
    refused(out.check(["given.txt"]), &["given.txt", "what is read"]);

    refused(check_output_file(photos.join("notes.txt"), [&photos]), &["notes.txt"]);
    refused(check_output_file(photos.join("notes.txt"), [photos.join("notes.txt")]), &["notes.txt", "what is read"]);
    refused(check_output_file(&photos, NOTHING), &["photos", "the name of a file", "a folder"]);
    check_output_file(photos.join("new.txt"), NOTHING).unwrap();
}

/// Promise of `only_the_writer_replaces_files`.
#[test]
fn results_stay_apart_from_photos() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("holiday");
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("b.JPG"), "a photo").unwrap();
    refused(OutputFolder::claim(&folder, "render", NOTHING), &["b.JPG", "apart from photos"]);
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "nothing is left behind");
    fs::remove_file(folder.join("b.JPG")).unwrap();
    // Pictures of one's own are no photos.
    let out = claim(&folder, "render");
    write_text(out.file("0000.png").unwrap(), "a picture").unwrap();
    drop(out);
    claim(&folder, "render").check(["0000.png", "0001.png"]).unwrap();
    fs::write(folder.join("0001.png"), "a photo").unwrap();
    refused(OutputFolder::claim(&folder, "render", NOTHING), &["0001.png"]);
}

/// Promise (kept): a folder is one run's at a time, whichever way it was begun.
#[test]
fn a_folder_is_written_by_one_run_at_a_time() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("run");
    let first = claim(&folder, "fit");
    refused(OutputFolder::claim(&folder, "fit", NOTHING), &["run", "nothing else writes into", "in use"]);
    refused(OutputFolder::reopen(&folder, "fit", NOTHING), &["in use"]);
    first.file("scene.ply").unwrap();
    drop(first);
    OutputFolder::reopen(&folder, "fit", NOTHING).unwrap();
}

/// A folder that nothing was written into leaves no trace.
///
/// Promise (kept): a folder that nothing was written into is gone again; a record that a kill cut short goes on; so
/// do runs from before there was one.
#[test]
fn unused_folders_leave_no_trace() {
    let parent = tempfile::tempdir().unwrap();
    drop(claim(&parent.path().join("a/b/c"), "fit"));
    assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
    let kept = parent.path().join("kept");
    fs::create_dir(&kept).unwrap();
    drop(claim(&kept, "fit"));
    assert!(kept.is_dir() && fs::read_dir(&kept).unwrap().count() == 0);
    fs::write(parent.path().join("file"), "").unwrap();
    refused(OutputFolder::claim(parent.path().join("file/out"), "fit", NOTHING), &["file"]);
}

/// Promise of `unused_folders_leave_no_trace`.
#[test]
fn a_record_that_a_kill_cut_short_goes_on() {
    let parent = tempfile::tempdir().unwrap();
    let out = claim(parent.path(), "fit");
    write_text(out.file("scene.ply").unwrap(), "").unwrap();
    drop(out);
    let record = parent.path().join("written.jsonl");
    let text = fs::read_to_string(&record).unwrap();
    fs::write(&record, format!("{text}{{\"file\":\"summary.js")).unwrap();
    let out = claim(parent.path(), "fit");
    out.check(["scene.ply"]).unwrap();
    // Windows has neither in names.
    let name = if cfg!(windows) { "a name.txt" } else { "a \"name\"\n.txt" };
    write_text(out.file(name).unwrap(), "").unwrap();
    drop(out);
    claim(parent.path(), "fit").check(["scene.ply", name]).unwrap();
    // A user's file of this name.
    fs::write(&record, "when,what\n").unwrap();
    refused(OutputFolder::claim(parent.path(), "fit", NOTHING), &["written.jsonl", "another file"]);
    assert_eq!(fs::read_to_string(&record).unwrap(), "when,what\n");
}

/// Promise of `unused_folders_leave_no_trace`.
#[test]
fn runs_from_before_there_was_a_record_go_on() {
    let parent = tempfile::tempdir().unwrap();
    for name in ["scene.ply", "notes.txt"] {
        fs::write(parent.path().join(name), "").unwrap();
    }
    let out = OutputFolder::reopen(parent.path(), "fit", ["scene.ply", "report.html"]).unwrap();
    out.file("scene.ply").unwrap();
    refused(out.file("notes.txt"), &["notes.txt"]);
}

/// Promise of `a_clip_becomes_a_capture`.
#[test]
fn only_what_the_command_wrote_is_removed() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("out");
    let out = OutputFolder::claim(&folder, "first", NOTHING).unwrap();
    fs::write(out.file("frames/other.jpg").unwrap(), "first").unwrap();
    drop(out);
    let out = OutputFolder::claim(&folder, "second", NOTHING).unwrap();
    for name in ["frames/1.jpg", "frames/2.jpg", "frames/deep/3.jpg", "frames.txt", "4.txt"] {
        fs::write(out.file(name).unwrap(), "second").unwrap();
    }
    fs::write(folder.join("frames/mine.jpg"), "mine").unwrap();
    out.file("frames/never-written.jpg").unwrap();
    out.remove_others("frames", &["frames/2.jpg"]).unwrap();
    for (name, there) in [
        ("frames/1.jpg", false),
        ("frames/deep/3.jpg", false),
        ("frames/2.jpg", true),
        ("frames/other.jpg", true),
        ("frames/mine.jpg", true),
        ("frames.txt", true),
        ("4.txt", true),
    ] {
        assert_eq!(folder.join(name).exists(), there, "{name}");
    }
}

/// A record that came along with a folder leads to no file outside of it.
///
/// Promise (files): a folder of results from elsewhere names and links to no file outside of it.
#[test]
fn a_record_leads_to_no_file_outside() {
    let parent = tempfile::tempdir().unwrap();
    let thesis = parent.path().join("thesis.txt");
    fs::write(&thesis, "mine").unwrap();
    for name in ["frames/../../thesis.txt".to_string(), "..".into(), thesis.display().to_string(), "./a".into()] {
        let folder = tempfile::tempdir_in(parent.path()).unwrap();
        let line = serde_json::json!({ "file": name, "by": "fit" }).to_string() + "\n";
        fs::write(folder.path().join("written.jsonl"), line).unwrap();
        refused(OutputFolder::claim(folder.path(), "fit", NOTHING), &["written.jsonl", "another file"]);
        refused(OutputFolder::reopen(folder.path(), "fit", NOTHING), &["written.jsonl", "another file"]);
    }
    assert_eq!(fs::read_to_string(&thesis).unwrap(), "mine");
}

/// Links in a folder of results lead to nothing that is replaced or removed.
///
/// Promise of `a_record_leads_to_no_file_outside`.
#[cfg(unix)]
#[test]
fn links_lead_to_no_file_outside() {
    use std::os::unix::fs::symlink;

    let parent = tempfile::tempdir().unwrap();
    let (victim, folder) = (parent.path().join("victim"), parent.path().join("out"));
    for path in [&victim, &folder] {
        fs::create_dir(path).unwrap();
    }
    fs::write(victim.join("thesis.txt"), "mine").unwrap();
    symlink(&victim, folder.join("frames")).unwrap();
    symlink(victim.join("thesis.txt"), folder.join("scene.ply")).unwrap();
    let lines = ["frames/thesis.txt", "scene.ply"].map(|name| format!("{{\"file\":\"{name}\",\"by\":\"fit\"}}\n"));
    fs::write(folder.join("written.jsonl"), lines.concat()).unwrap();
    let out = OutputFolder::claim(&folder, "fit", NOTHING).unwrap();
    refused(out.remove_others::<&str>("frames", &[]), &["thesis.txt", "a link to"]);
    for name in ["scene.ply", "frames/thesis.txt", "frames/new.txt"] {
        refused(out.file(name), &[name, "a file in the folder of the results"]);
        refused(out.remove(name), &[name]);
    }
    drop(out);
    // The record itself would be appended to.
    fs::remove_file(folder.join("written.jsonl")).unwrap();
    symlink(victim.join("thesis.txt"), folder.join("written.jsonl")).unwrap();
    refused(OutputFolder::claim(&folder, "fit", NOTHING), &["written.jsonl", "a link"]);
    assert_eq!(fs::read_to_string(victim.join("thesis.txt")).unwrap(), "mine");
    assert_eq!(fs::read_dir(&victim).unwrap().count(), 1);
}

/// An output is a regular file, or one that is not there yet.
///
/// Promise (files): outputs are regular files or absent: devices, pipes and links that lead nowhere stay; other links
/// are followed.
#[cfg(unix)]
#[test]
fn outputs_are_regular_files_or_absent() {
    let parent = tempfile::tempdir().unwrap();
    let path = |name: &str| parent.path().join(name);
    let _socket = std::os::unix::net::UnixListener::bind(path("socket.ply")).unwrap();
    std::os::unix::fs::symlink(path("nowhere"), path("dangling.ply")).unwrap();
    refused(check_output_file("/dev/null", NOTHING), &["/dev/null", "the name of a file", "a device"]);
    refused(check_output_file(path("socket.ply"), NOTHING), &["socket.ply", "a socket"]);
    refused(check_output_file(path("dangling.ply"), NOTHING), &["dangling.ply", "a link that leads nowhere"]);
    let out = claim(parent.path(), "fit");
    for name in ["socket.ply", "dangling.ply"] {
        refused(out.check([name]), &[name]);
        refused(weaver_io::atomic_write(path(name), |w| w.write_all(b"new")), &[name]);
        assert!(!path(name).symlink_metadata().unwrap().is_file(), "{name}");
    }
    assert!(!path("nowhere").exists());
}

/// A folder for results may lie in a run that is read, and in no capture.
///
/// Promise of `outputs_never_go_over_inputs`.
#[test]
fn results_may_lie_in_a_run_that_is_read() {
    let parent = tempfile::tempdir().unwrap();
    let (run, photos) = (parent.path().join("run"), parent.path().join("photos"));
    fs::create_dir(&photos).unwrap();
    claim(&run, "train").file("model.safetensors").unwrap();
    check_output_folder(run.join("curves"), [&run, &photos]).unwrap();
    refused(check_output_folder(&run, [&run]), &["run", "what is read"]);
    refused(check_output_folder(photos.join("new"), [&run, &photos]), &["new", "a place in"]);
}
