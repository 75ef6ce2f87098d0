//! Recognizes photos that were taken one after the other, by their names.

use std::path::{Path, PathBuf};

/// Fewer photos are all compared with each other in any order.
const FEWEST: usize = 30;
/// The share of the steps from one photo to the next that must be regular.
const REGULAR: f64 = 0.75;

/// True if names show that photos were taken one after the other: the same text around one number that rises by the
/// same step from one to the next, for the most part. Up to twice as far is a photo that was thrown away.
///
/// Being wrong does little harm: neighbors are compared beside the photos that look most alike.
pub(super) fn is_sequence(paths: &[PathBuf]) -> bool {
    let named: Vec<Option<(String, u64)>> = paths.iter().map(|path| numbered(path)).collect();
    let step = |pair: &[Option<(String, u64)>]| match pair {
        [Some((text, number)), Some((other, next))] if text == other && next > number => Some(next - number),
        _ => None,
    };
    let mut steps: Vec<u64> = named.windows(2).filter_map(step).collect();
    steps.sort_unstable();
    let Some(usual) = steps.get(steps.len() / 2) else { return false };
    let regular = steps.iter().filter(|step| (*usual..=2 * usual).contains(step)).count();
    paths.len() >= FEWEST && regular as f64 >= REGULAR * (paths.len() - 1) as f64
}

/// The path of a photo without the last number in its file's name, and that number.
fn numbered(path: &Path) -> Option<(String, u64)> {
    let stem = path.file_stem()?.to_str()?;
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |before| before + stem[before..].chars().next().map_or(1, char::len_utf8));
    let text = format!("{}/{}#{}", path.parent()?.display(), &stem[..start], &stem[end..]);
    Some((text, stem[start..end].parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(names: impl IntoIterator<Item = String>) -> bool {
        is_sequence(&names.into_iter().map(PathBuf::from).collect::<Vec<_>>())
    }

    #[test]
    fn regular_numbers_are_a_sequence_and_others_are_not() {
        assert!(named((0..40).map(|i| format!("photos/IMG_{:04}.JPG", 230 + i))));
        // Every fifth frame; some photos thrown away; a text behind the number; numbers without zeros, in the order of
        // letters.
        assert!(named((0..40).map(|i| format!("frame{:05}.png", 5 * i))));
        assert!(named((0..48).filter(|i| i % 6 != 2).map(|i| format!("{i:03}é.jpg"))));
        let mut letters: Vec<String> = (1..60).map(|i| format!("é{i}.jpg")).collect();
        letters.sort();
        assert!(named(letters));
        // Two walks.
        assert!(named((0..60).map(|i| format!("{}/{:03}.jpg", i / 30, i % 30))));
        // Few; numbers that say nothing; two cameras by turns; two numbers that change; none.
        assert!(!named((0..29).map(|i| format!("{i:03}.jpg"))));
        assert!(!named((0..40_u64).map(|i| format!("{:05}.jpg", i * i * i + i * 97 % 89))));
        assert!(!named((0..40).map(|i| format!("{}{:03}.jpg", if i % 2 == 0 { "a" } else { "b" }, i / 2))));
        assert!(!named((0..40).map(|i| format!("{}-{:03}.jpg", 100 + i, i))));
        assert!(!named((0..40).map(|i| "abcdefghij".repeat(i) + ".jpg")));
        assert!(!named((0..40).rev().map(|i| format!("{i:03}.jpg"))));
        assert!(!named([]));
    }
}
