//! Photos that cannot be read among others that can.

use crate::Error;
use std::path::Path;

/// More photos than one in this many mean that something else is wrong.
const ONE_IN: usize = 4;

/// Why a photo was not loaded.
#[derive(Debug)]
pub(crate) enum Fault {
    /// The file is missing, no photo, or not a whole one: the other photos may do without it.
    Unreadable(Error),
    /// An error of the photo that leaving it out would not mend.
    Other(Error),
}

impl Fault {
    /// For `map_err` on what reads a photo.
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
    /// All photos that there are, of which some may not have been asked for.
    pub all: usize,
}

/// Loaded photos, `None` in the place of those that cannot be read, and a remark that names these with reasons.
///
/// # Errors
/// The first other fault. Where fewer than `least` photos can be read, or more than a quarter of all cannot, an error that names them.
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
    if readable.len() - bad < least || ONE_IN * bad > all {
        return Err(Error::Unreadable { least, bad, all, reasons });
    }
    Ok((readable, Some(format!("{bad} of {all} photos cannot be read and are left out: {reasons}"))))
}

/// Photos and why they cannot be read, those of one reason together.
fn by_reason(unreadable: &[(&Path, Error)]) -> String {
    let mut reasons: Vec<(String, Vec<String>)> = Vec::new();
    for (photo, error) in unreadable {
        let (photo, text) = (photo.display().to_string(), error.to_string());
        // Most errors begin with the file.
        let reason = text.strip_prefix(&format!("{photo}: ")).unwrap_or(&text).to_string();
        match reasons.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, photos)) => photos.push(photo),
            None => reasons.push((reason, vec![photo])),
        }
    }
    reasons.iter().map(|(reason, photos)| format!("{}: {reason}", photos.join(", "))).collect::<Vec<_>>().join("; ")
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
        let one = "1 of 4 photos cannot be read and are left out: 0.jpg: image: expected a photo, found none";
        assert_eq!(sorted(3, 1, 2).unwrap().unwrap(), one);
        let two = "2 of 8 photos cannot be read and are left out: 0.jpg, 1.jpg: image: expected a photo, found none";
        assert_eq!(sorted(6, 2, 2).unwrap().unwrap(), two);
        for (good, bad, least) in [(2, 1, 2), (5, 2, 2), (0, 1, 1), (1, 0, 1), (3, 1, 4)] {
            let found = sorted(good, bad, least);
            assert_eq!(found.is_err(), bad > 0, "{good} and {bad}");
            let Err(error) = found else { continue };
            let message = error.to_string();
            assert!((0..bad).all(|i| message.contains(&format!("{i}.jpg"))), "{message}");
        }
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
