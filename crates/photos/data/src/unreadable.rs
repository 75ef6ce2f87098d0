//! Photos that cannot be read among others that can.

use crate::Error;
use crate::remarks::some_of;
use std::path::Path;

/// More damaged or missing photos than one in this many mean that something else is wrong.
const ONE_IN: usize = 4;
/// More photos to convert than one in this many are the photos that were meant.
const ONE_TO_CONVERT_IN: usize = 2;

/// Why a photo was not loaded.
#[derive(Debug)]
pub(crate) enum Fault {
    /// The file is missing, no photo, or not a whole one: the other photos may do without it.
    Unreadable(Error),
    /// An error of the photo that leaving it out would not mend.
    Other(Error),
}

impl Fault {
    /// For `map_err` on readers of photos.
    pub fn unreadable(error: impl Into<Error>) -> Self {
        Self::Unreadable(error.into())
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Self {
        Self::Other(error)
    }
}

impl From<Fault> for Error {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Unreadable(error) | Fault::Other(error) => error,
        }
    }
}

/// Number of photos that must be readable, out of how many.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Needed {
    pub least: usize,
    /// All photos that there are; some may not have been requested.
    pub all: usize,
}

/// Loaded photos, `None` in the place of those that cannot be read, and a remark that names these with reasons.
///
/// # Errors
/// The first other fault. Where fewer than `least` photos can be read, more than a quarter of all are damaged or
/// missing, or more than half are of a format that is not read, an error that names them.
pub(crate) fn without_unreadable<'a, T>(
    photos: impl IntoIterator<Item = &'a Path>,
    loaded: Vec<Result<T, Fault>>,
    Needed { least, all }: Needed,
) -> Result<(Vec<Option<T>>, Option<String>), Error> {
    let mut unreadable = Vec::new();
    let mut readable = Vec::with_capacity(loaded.len());
    for (photo, loaded) in photos.into_iter().zip(loaded) {
        readable.push(match loaded {
            Ok(loaded) => Some(loaded),
            Err(Fault::Unreadable(error)) => {
                unreadable.push((photo, error));
                None
            }
            Err(Fault::Other(error)) => return Err(error),
        });
    }
    let bad = unreadable.len();
    if bad == 0 {
        return Ok((readable, None));
    }
    let reasons = by_reason(&unreadable);
    let to_convert = unreadable.iter().filter(|(_, error)| remedy(error).is_some()).count();
    let damaged = bad - to_convert;
    if readable.len() - bad < least || ONE_IN * damaged > all || ONE_TO_CONVERT_IN * to_convert > all {
        return Err(Error::Unreadable { least, bad, all, reasons });
    }
    Ok((readable, Some(format!("{bad} of {all} photos cannot be read and are left out: {reasons}"))))
}

/// The remedy for a photo of a format that is not read.
fn remedy(error: &Error) -> Option<String> {
    match error {
        Error::Format(weaver_io::Error::ToConvert { kind, .. }) => {
            Some(format!("{kind}: {}", weaver_io::Error::CONVERSION))
        }
        _ => None,
    }
}

/// Why photos cannot be read, each reason with its photos; those with a remedy first.
fn by_reason(unreadable: &[(&Path, Error)]) -> String {
    let mut reasons: Vec<(bool, String, Vec<String>)> = Vec::new();
    for (photo, error) in unreadable {
        let (photo, text, remedy) = (photo.display().to_string(), error.to_string(), remedy(error));
        let has_none = remedy.is_none();
        // Most errors begin with the file.
        let reason = remedy.unwrap_or_else(|| text.strip_prefix(&format!("{photo}: ")).unwrap_or(&text).to_string());
        match reasons.iter_mut().find(|(_, known, _)| *known == reason) {
            Some((.., photos)) => photos.push(photo),
            None => reasons.push((has_none, reason, vec![photo])),
        }
    }
    reasons.sort_by_key(|(has_none, ..)| *has_none);
    let lines = reasons.iter().map(|(_, reason, photos)| format!("{reason} ({})", some_of(photos)));
    lines.collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(good: usize, bad: usize, least: usize) -> Result<Option<String>, Error> {
        let names: Vec<String> = (0..good + bad).map(|i| format!("{i}.jpg")).collect();
        let photo = |i: usize| {
            let fault = || Fault::unreadable(Error::unexpected(Path::new(&names[i]), "image", "a photo", "none"));
            if i < bad { Err(fault()) } else { Ok(i) }
        };
        let loaded = (0..good + bad).map(photo).collect();
        let needed = Needed { least, all: good + bad };
        let (readable, remark) = without_unreadable(names.iter().map(Path::new), loaded, needed)?;
        assert_eq!(readable.iter().flatten().count(), good);
        assert!(readable.iter().enumerate().all(|(i, photo)| photo.is_none_or(|photo| photo == i)));
        Ok(remark)
    }

    #[test]
    fn a_quarter_may_be_unreadable_and_no_more() {
        assert_eq!(sorted(3, 0, 2).unwrap(), None);
        let one = "1 of 4 photos cannot be read and are left out: image: expected a photo, found none (0.jpg)";
        assert_eq!(sorted(3, 1, 2).unwrap().unwrap(), one);
        let two = "2 of 8 photos cannot be read and are left out: image: expected a photo, found none (0.jpg, 1.jpg)";
        assert_eq!(sorted(6, 2, 2).unwrap().unwrap(), two);
        for (good, bad, least) in [(2, 1, 2), (5, 2, 2), (0, 1, 1), (1, 0, 1), (3, 1, 4)] {
            let found = sorted(good, bad, least);
            assert_eq!(found.is_err(), bad > 0, "{good} and {bad}");
            let Err(error) = found else { continue };
            let message = error.to_string();
            assert!((0..bad).all(|i| message.contains(&format!("{i}.jpg"))), "{message}");
        }
    }

    /// Photos to convert are named by their remedy first, the first of them alone, and end it when they are most of
    /// all.
    ///
    /// Promise (files): HEIC and AVIF are named by their remedy first, and end a run only where they are most of the
    /// photos.
    #[test]
    fn a_remedy_comes_before_names() {
        let said = |heic: usize, damaged: usize, good: usize| {
            let names: Vec<String> = (0..heic + damaged + good).map(|i| format!("{i}.x")).collect();
            let photo = |i: usize| match i {
                i if i < damaged => {
                    Err(Fault::unreadable(Error::unexpected(Path::new(&names[i]), "image", "a photo", "none")))
                }
                i if i < damaged + heic => {
                    Err(Fault::unreadable(weaver_io::Error::ToConvert { path: names[i].as_str().into(), kind: "HEIC" }))
                }
                _ => Ok(()),
            };
            let loaded = (0..names.len()).map(photo).collect();
            let needed = Needed { least: 2, all: names.len() };
            let done = without_unreadable(names.iter().map(Path::new), loaded, needed);
            done.map(|(_, remark)| remark.unwrap()).map_err(|error| error.to_string())
        };
        let remark = said(3, 1, 8).unwrap();
        let begins = "4 of 12 photos cannot be read and are left out: HEIC: convert it to JPEG, for instance with `";
        assert!(remark.starts_with(begins) && remark.contains("(1.x, 2.x, 3.x); image: expected a photo"), "{remark}");
        let message = said(200, 0, 8).unwrap_err();
        assert!(message.starts_with("photos: 200 of 208 cannot be read: HEIC: convert it to JPEG"), "{message}");
        assert!(message.contains("7.x and 192 more)") && message.len() < 600, "{message}");
        assert!(said(5, 0, 4).is_err() && said(4, 0, 4).is_ok() && said(0, 3, 8).is_err());
    }

    #[test]
    fn other_faults_end_it() {
        let other = || Fault::from(Error::unexpected(Path::new("b"), "pose", "one", "none"));
        let bad = || Fault::unreadable(Error::unexpected(Path::new("a"), "image", "one", "none"));
        let names = ["a", "b", "c", "d"].map(Path::new);
        let loaded = vec![Err(bad()), Err(other()), Ok(()), Ok(())];
        let error = without_unreadable(names, loaded, Needed { least: 1, all: 4 }).unwrap_err();
        assert!(error.to_string().starts_with("b: pose"), "{error}");
    }
}
