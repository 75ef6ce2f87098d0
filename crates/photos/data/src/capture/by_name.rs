//! Cameras of photos by the names in a file of cameras.

use crate::Error;
use std::ffi::OsStr;
use std::path::{Component, Path, PathBuf};

/// For each photo, the position of its camera's name: the name whose file in `files` is this photo; else the name with
/// most parts in common with the end of the photo's path. A name without an extension, as synthetic captures have them,
/// fits a photo with any.
///
/// # Errors
/// When photos have no camera, several, or one between them: they are listed.
pub(super) fn cameras(file: &Path, names: &[&str], files: &[&Path], photos: &[PathBuf]) -> Result<Vec<usize>, Error> {
    let files: Vec<Option<PathBuf>> = files.iter().map(|file| file.canonicalize().ok()).collect();
    let named: Vec<Vec<&OsStr>> = names.iter().map(|name| parts(Path::new(name))).collect();
    let mut chosen = Vec::new();
    let (mut without, mut several) = (Vec::new(), Vec::new());
    for photo in photos {
        let same = photo.canonicalize().ok().and_then(|photo| only(&files, &Some(photo)));
        if let Some(same) = same {
            chosen.push(same);
            continue;
        }
        // From the root, so that it does not matter in which folder a command is run.
        let path = std::path::absolute(photo).unwrap_or_else(|_| photo.clone());
        let path = parts(&path);
        let shared: Vec<usize> = named.iter().map(|name| common_end(&path, name)).collect();
        let most = shared.iter().copied().max().unwrap_or(0);
        let best: Vec<usize> = (0..names.len()).filter(|&i| most > 0 && shared[i] == most).collect();
        match best[..] {
            [] => without.push(photo.display().to_string()),
            [one] => chosen.push(one),
            _ => several.push(format!("{} ({})", photo.display(), list(best.iter().map(|&i| names[i])))),
        }
    }
    let wrong =
        |expected: &str, found: String| Err(Error::unexpected(file, "cameras by photos' names", expected, found));
    if !without.is_empty() {
        return wrong("a camera for every photo", format!("none for {}", list(without.iter())));
    }
    if !several.is_empty() {
        return wrong("one camera for every photo", format!("several for {}", list(several.iter())));
    }
    let mut shared = Vec::new();
    for (at, name) in names.iter().enumerate() {
        let of: Vec<usize> = (0..photos.len()).filter(|&photo| chosen[photo] == at).collect();
        if of.len() > 1 {
            shared.push(format!("{name} for {}", list(of.iter().map(|&photo| photos[photo].display()))));
        }
    }
    if shared.is_empty() { Ok(chosen) } else { wrong("a camera for every photo", list(shared.iter())) }
}

/// The position of an item that is there once.
fn only<T: PartialEq>(items: &[T], item: &T) -> Option<usize> {
    let mut found = items.iter().enumerate().filter(|(_, other)| *other == item);
    let first = found.next()?.0;
    found.next().is_none().then_some(first)
}

/// The names in a path, last first. A name that `..` leads out of is left out, as is `..` where the path begins.
pub(super) fn parts(path: &Path) -> Vec<&OsStr> {
    let mut names = Vec::new();
    for part in path.components() {
        match part {
            Component::Normal(name) => names.push(name),
            Component::ParentDir => drop(names.pop()),
            _ => {}
        }
    }
    names.reverse();
    names
}

/// Number of parts, from the last one on, that a photo's path and a camera's name have in common.
fn common_end(photo: &[&OsStr], name: &[&OsStr]) -> usize {
    let (Some(file), Some(named)) = (photo.first(), name.first()) else { return 0 };
    let same = file == named || Path::new(named).extension().is_none() && Path::new(file).file_stem() == Some(named);
    if same { 1 + photo[1..].iter().zip(&name[1..]).take_while(|(a, b)| a == b).count() } else { 0 }
}

/// The first of the items, and how many more there are: a capture can have a thousand photos.
pub(super) fn list(items: impl ExactSizeIterator<Item = impl ToString>) -> String {
    const LISTED: usize = 12;
    let more = items.len().saturating_sub(LISTED);
    let listed = items.take(LISTED).map(|item| item.to_string()).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{listed} and {more} more") } else { listed }
}

#[cfg(test)]
mod tests {
    use super::cameras;
    use std::path::{Path, PathBuf};

    fn matched(names: &[&str], photos: &[&str]) -> Result<Vec<usize>, String> {
        let photos: Vec<PathBuf> = photos.iter().map(PathBuf::from).collect();
        cameras(Path::new("cameras.json"), names, &[], &photos).map_err(|error| error.to_string())
    }

    #[test]
    fn folders_tell_photos_of_one_name_apart() {
        let names = ["a/1.jpg", "b/1.jpg", "b/2.jpg"];
        assert_eq!(matched(&names, &["photos/b/1.jpg", "photos/a/1.jpg", "elsewhere/2.jpg"]), Ok(vec![1, 0, 2]));
        assert_eq!(matched(&["images/1.jpg"], &["1.jpg"]), Ok(vec![0]));
    }

    /// A name without extension fits a photo with any.
    #[test]
    fn names_without_extension_match_any() {
        let names = ["./train/r_1", "./test/r_1", "./train/r_10"];
        assert_eq!(matched(&names, &["train/r_10.png", "test/r_1.png", "train/r_1.png"]), Ok(vec![2, 1, 0]));
        assert!(matched(&["r_1.jpg"], &["r_1.png"]).is_err(), "an extension that is there counts");
    }

    #[test]
    fn what_is_not_clear_is_listed() {
        let says = |names: &[&str], photos: &[&str], words: &[&str]| {
            let message = matched(names, photos).unwrap_err();
            words.iter().for_each(|word| assert!(message.contains(word), "{word}: {message}"));
        };
        says(&["a/1.jpg", "b/1.jpg"], &["c/1.jpg"], &["cameras.json", "several", "c/1.jpg", "a/1.jpg, b/1.jpg"]);
        says(&["a/1.jpg"], &["a/1.jpg", "a/2.jpg", "3.jpg"], &["none for a/2.jpg, 3.jpg"]);
        says(&["a/1.jpg", "2.jpg"], &["a/1.jpg", "b/1.jpg"], &["a/1.jpg for a/1.jpg, b/1.jpg"]);
        let many: Vec<String> = (0..100).map(|at| format!("{at}.jpg")).collect();
        says(&["a.jpg"], &many.iter().map(String::as_str).collect::<Vec<_>>(), &["11.jpg and 88 more"]);
    }
}
