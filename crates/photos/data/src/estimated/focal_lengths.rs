//! Focal lengths in files, and outliers among them.

use crate::remarks::some_of;
use std::collections::BTreeSet;
use weaver_geometry::Camera;
use weaver_sfm::{Estimate, EstimateOptions, Features, LeftOut, PairMatcher, Photo, estimate_from, estimate_with};

/// A focal length is an outlier if it is off by more than this factor from the others'.
const OFF: f64 = 3.0;

/// The focal lengths without those that are more than three times off the median of the others, either way; and a
/// remark that names the photos of these.
///
/// Where the others are an even number, it is the nearer of the two in the middle that counts.
pub(super) fn without_outliers(names: &[String], focals: &[Option<f64>]) -> (Vec<Option<f64>>, Option<String>) {
    let kept = |(i, own): (usize, &Option<f64>)| {
        let others = focals.iter().enumerate().filter(|(j, _)| *j != i);
        let mut others: Vec<f64> = others.filter_map(|(_, other)| *other).collect();
        others.sort_by(f64::total_cmp);
        let Some(last) = others.len().checked_sub(1) else { return *own };
        let middle = [others[last / 2], others[others.len() / 2]];
        own.filter(|own| middle.iter().any(|other| own / other <= OFF && other / own <= OFF))
    };
    let kept: Vec<Option<f64>> = focals.iter().enumerate().map(kept).collect();
    let ignored = focals.iter().zip(&kept).zip(names).filter(|((focals, kept), _)| focals != kept);
    let ignored: Vec<String> =
        ignored.map(|((focals, _), name)| format!("{name} ({} mm)", focals.unwrap_or_default())).collect();
    let none_left = kept.iter().all(Option::is_none);
    let remark = match none_left {
        true => "focal lengths in EXIF that are more than three times apart are not used",
        false => "focal lengths in EXIF that are more than three times off those of the other photos are not used",
    };
    let remark = (!ignored.is_empty()).then(|| format!("{remark}: {}", some_of(&ignored)));
    (kept, remark)
}

/// A given focal length is contradicted by photos when it is so many deviations off their estimate.
const CONTRADICTED: f64 = 2.0;

/// Estimates cameras, without the focal lengths in files for lenses where photos contradict them; and a remark on
/// these.
///
/// A given focal length is a measurement, whose deviation holds back the estimate from photos. Where the estimate is
/// far off nevertheless, the given number is no measurement of this lens, and half way between both is wrong for
/// certain.
pub(super) fn estimate(
    photos: &[Photo<'_>],
    settings: &EstimateOptions,
    matcher: Option<&dyn PairMatcher>,
) -> (Estimate, Option<String>) {
    let features: Vec<Features> = photos.iter().map(|photo| photo.features(settings.keypoints)).collect();
    let estimate_from = |photos: &[Photo<'_>]| match matcher {
        Some(matcher) => estimate_with(photos, &features, settings, matcher),
        None => estimate_from(photos, &features, settings),
    };
    let estimate = estimate_from(photos);
    let most = CONTRADICTED * settings.focal_deviation;
    let contradicted = |estimate: &Estimate| -> BTreeSet<usize> {
        let off = |(photo, camera): (&Photo<'_>, &Result<Camera, LeftOut>)| {
            let factor = camera.ok()?.intrinsics.fx / photo.focal?;
            (most > 0.0 && factor.ln().abs() > most).then_some(photo.lens)
        };
        photos.iter().zip(&estimate.cameras).filter_map(off).collect()
    };
    let wrong = contradicted(&estimate);
    if wrong.is_empty() {
        return (estimate, None);
    }
    let mut freed = photos.to_vec();
    freed.iter_mut().filter(|photo| wrong.contains(&photo.lens)).for_each(|photo| photo.focal = None);
    let other = estimate_from(&freed);
    let placed = |estimate: &Estimate| estimate.cameras.iter().flatten().count();
    if placed(&other) < placed(&estimate) || !wrong.is_subset(&contradicted(&other)) {
        return (estimate, None);
    }
    let remark = |(photo, camera): (&Photo<'_>, &Result<Camera, LeftOut>)| {
        let factor = camera.ok()?.intrinsics.fx / photo.focal?;
        wrong.contains(&photo.lens).then(|| {
            let percent = 100.0 * (factor - 1.0);
            format!(
                "focal lengths in EXIF are not used: photos show one that is {percent:+.0} % off; were photos cropped?"
            )
        })
    };
    let remark = photos.iter().zip(&other.cameras).find_map(remark);
    (other, remark)
}

#[cfg(test)]
mod tests {
    use super::without_outliers;

    fn kept(focals: &[Option<f64>]) -> (Vec<Option<f64>>, Option<String>) {
        let names: Vec<String> = (0..focals.len()).map(|i| format!("{i}.jpg")).collect();
        without_outliers(&names, focals)
    }

    #[test]
    fn what_is_far_off_the_others_is_named_and_not_used() {
        let focals = [28.0, 28.0, 5000.0, 84.0, 26.0, 1.0].map(Some);
        let (left, remark) = kept(&focals);
        assert_eq!(left, [Some(28.0), Some(28.0), None, Some(84.0), Some(26.0), None]);
        let remark = remark.unwrap();
        assert!(
            remark.ends_with("off those of the other photos are not used: 2.jpg (5000 mm), 5.jpg (1 mm)"),
            "{remark}"
        );
        // One in three; and photos without one.
        let (left, remark) = kept(&[None, Some(28.0), Some(5000.0), None, Some(30.0)]);
        assert_eq!(left, [None, Some(28.0), None, None, Some(30.0)]);
        assert!(remark.unwrap().ends_with(": 2.jpg (5000 mm)"));
    }

    /// Promise of `an_absurd_focal_length_is_named`.
    #[test]
    fn two_that_disagree_are_both_not_used() {
        let (left, remark) = kept(&[Some(28.0), None, Some(85.0)]);
        assert_eq!(left, [None; 3]);
        assert!(remark.unwrap().ends_with("apart are not used: 0.jpg (28 mm), 2.jpg (85 mm)"));
        assert_eq!(kept(&[Some(28.0), Some(84.0)]), (vec![Some(28.0), Some(84.0)], None));
        for few in [&[][..], &[None], &[Some(28.0)], &[None, Some(5000.0)]] {
            assert_eq!(kept(few), (few.to_vec(), None));
        }
    }
}
