//! Growth among many photos: unchanged parts are neither found again nor adjusted.

use super::{GROWING, GROWN, Grown, LOST, TOGETHER, adjusted, contradicted, explained, join};
use crate::bundle::{Bundle, Lens, Observation};
use crate::evidence::{Evidence, FITS};
use crate::observe::Observers;
use std::cmp::Reverse;
use weaver_geometry::glam::DVec3;

/// The most photos among which everything is found and adjusted each time.
pub(crate) const MANY: usize = 30;
/// Placed photos up to which all are adjusted each time; and the growth, as a part, after which all are adjusted again.
const FEW: usize = 24;
const MORE: f64 = 0.25;
/// Photos that are tried at a time, the ones that see the most points.
const TRIED: usize = 12;
/// Placed photos that are adjusted with newly joined ones, over the number of these and at least.
const BESIDE: [usize; 2] = [1, 8];
/// Growth of the number of points that a photo sees, as a part, after which it is tried again.
const AGAIN: f64 = 0.1;

/// A scene while it grows.
struct Growth<'a> {
    evidence: &'a Evidence<'a>,
    bundle: &'a mut Bundle,
    placed: &'a mut Vec<bool>,
    /// True for lenses whose focal length is adjusted.
    free: Vec<bool>,
    refused: Vec<bool>,
    /// True for photos that were taken out again as most of their matches spoke against them.
    retracted: Vec<bool>,
    /// The tracks of each photo.
    tracks_of: Vec<Vec<u32>>,
    /// The point of each track, where photos agree about one.
    points: Vec<Option<DVec3>>,
    /// Number of points that each photo saw when it was tried.
    tried: Vec<Option<usize>>,
    /// Photos with a place when all were adjusted.
    at_last: usize,
}

impl Grown {
    /// The same as [`grow`](Self::grow), until so many photos have a place: everything is adjusted only when many
    /// photos have joined; in between, only the new ones and the photos that see most of the same points.
    ///
    /// Source: Schönberger and Frahm, Structure-from-Motion Revisited, 2016, section 4.4.
    pub fn grow_locally(&mut self, evidence: &Evidence<'_>, until: usize) {
        let Self { bundle, placed, .. } = self;
        let free: Vec<bool> = bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        Growth::new(evidence, bundle, placed, free.clone()).run(until);
        bundle.lenses.iter_mut().zip(free).for_each(|(lens, free)| lens.free_focal = free);
    }

    /// Adjusts all in the end, and sets the support.
    pub fn settle(&mut self, evidence: &Evidence<'_>) {
        let Self { bundle, placed, support } = self;
        let free: Vec<bool> = bundle.lenses.iter().map(|lens| lens.free_focal).collect();
        bundle.free_focal(&free, placed);
        adjusted(evidence, bundle, placed, &GROWN);
        *support = explained(bundle);
        bundle.lenses.iter_mut().zip(free).for_each(|(lens, free)| lens.free_focal = free);
    }
}

impl<'a> Growth<'a> {
    fn new(evidence: &'a Evidence<'a>, bundle: &'a mut Bundle, placed: &'a mut Vec<bool>, free: Vec<bool>) -> Self {
        let n = placed.len();
        let mut tracks_of = vec![Vec::new(); n];
        for (number, track) in evidence.tracks.iter().enumerate() {
            track.iter().for_each(|(photo, _)| tracks_of[*photo].push(number as u32));
        }
        let points = vec![None; evidence.tracks.len()];
        let refused = evidence.absent.to_vec();
        let (retracted, tried) = (vec![false; n], vec![None; n]);
        Self { evidence, bundle, placed, free, refused, retracted, tracks_of, points, tried, at_last: 0 }
    }

    fn count(&self) -> usize {
        self.placed.iter().filter(|placed| **placed).count()
    }

    /// Places photo after photo, as long as one sees enough points of the scene.
    fn run(&mut self, until: usize) {
        self.adjust_all();
        while self.count() < until {
            let joined = self.join();
            if !joined.is_empty() {
                let count = self.count();
                if count <= FEW || count as f64 > (1.0 + MORE) * self.at_last as f64 {
                    self.adjust_all();
                } else {
                    self.adjust_with(&joined);
                }
            } else if self.at_last != self.count() {
                self.adjust_all();
            } else {
                let mut wrong = contradicted(self.evidence, self.bundle, self.placed);
                // A photo that comes back to the same place is not taken out once more.
                wrong.retain(|photo| !std::mem::replace(&mut self.retracted[*photo], true));
                if wrong.is_empty() {
                    return;
                }
                for photo in &wrong {
                    (self.placed[*photo], self.tried[*photo]) = (false, None);
                }
                self.find(&self.tracks(&wrong));
            }
        }
    }

    /// Finds all points and adjusts them with all cameras.
    fn adjust_all(&mut self) {
        let several = self.count() > 2;
        let freed: Vec<bool> = self.free.iter().map(|free| *free && several).collect();
        self.bundle.free_focal(&freed, self.placed);
        let all: Vec<u32> = (0..self.evidence.tracks.len() as u32).collect();
        self.find(&all);
        let bundle = self.part(&all, |_| true);
        self.bundle.lenses = self.adjust(bundle, all);
        self.tried.fill(None);
        self.at_last = self.count();
    }

    /// Finds the points of these photos and adjusts them with the cameras that see most of them; the others stay.
    fn adjust_with(&mut self, joined: &[usize]) {
        self.find(&self.tracks(joined));
        // Of a rig, the first photo counts for all.
        let mut shared = vec![0; self.placed.len()];
        for track in self.tracks(joined).into_iter().filter(|track| self.points[*track as usize].is_some()) {
            self.seeing(track).for_each(|photo| shared[self.bundle.mounted(photo).on] += 1);
        }
        let joined: Vec<usize> = joined.iter().copied().filter(|photo| self.bundle.leads(*photo)).collect();
        joined.iter().for_each(|photo| shared[*photo] = usize::MAX);
        let mut moving: Vec<usize> = (0..shared.len()).filter(|photo| shared[*photo] > 0).collect();
        moving.sort_by_key(|photo| (Reverse(shared[*photo]), *photo));
        moving.truncate(joined.len() + (BESIDE[0] * joined.len()).max(BESIDE[1]));
        let moving: Vec<usize> = moving.into_iter().flat_map(|photo| self.bundle.together(photo)).collect();
        let tracks = self.tracks(&moving);
        let mut moves = vec![false; self.placed.len()];
        moving.iter().for_each(|photo| moves[*photo] = true);
        let mut bundle = self.part(&tracks, |photo| moves[photo]);
        bundle.lenses.iter_mut().for_each(|lens| *lens = lens.held());
        self.adjust(bundle, tracks);
    }

    /// The tracks that these photos have a part in, ascending.
    fn tracks(&self, photos: &[usize]) -> Vec<u32> {
        let mut tracks: Vec<u32> = photos.iter().flat_map(|photo| &self.tracks_of[*photo]).copied().collect();
        tracks.sort_unstable();
        tracks.dedup();
        tracks
    }

    /// The photos with a place that have a part in a track.
    fn seeing(&self, track: u32) -> impl Iterator<Item = usize> {
        let all = self.evidence.tracks[track as usize].iter();
        all.map(|(photo, _)| *photo).filter(|photo| self.placed[*photo])
    }

    /// Finds the points of tracks from the photos that have a place.
    fn find(&mut self, tracks: &[u32]) {
        let missing: Vec<bool> = self.placed.iter().map(|placed| !placed).collect();
        let observers = Observers::new(self.bundle, self.evidence.features, &missing, 2.0 * FITS);
        let of = |track: &u32| &self.evidence.tracks[*track as usize];
        let found = observers.points(&tracks.iter().map(of).collect::<Vec<_>>());
        tracks.iter().zip(found).for_each(|(track, point)| self.points[*track as usize] = point);
    }

    /// The points of tracks, and their observations by placed photos and by the ones that are `looking`.
    fn see(&self, tracks: &[u32], looking: impl Fn(usize) -> bool) -> (Vec<DVec3>, Vec<Observation>) {
        let missing: Vec<bool> = self.placed.iter().map(|placed| !placed).collect();
        let observers = Observers::new(self.bundle, self.evidence.features, &missing, 2.0 * FITS);
        let (mut points, mut all) = (Vec::new(), Vec::new());
        for track in tracks.iter().map(|track| *track as usize) {
            let Some(point) = self.points[track] else { continue };
            let seen = observers.observations(&self.evidence.tracks[track], point, points.len());
            all.extend(seen.filter(|o| self.placed[o.camera] || looking(o.camera)));
            points.push(point);
        }
        (points, all)
    }

    /// The part of the scene that tracks make, in which these photos move.
    fn part(&self, tracks: &[u32], moves: impl Fn(usize) -> bool) -> Bundle {
        let (points, observations) = self.see(tracks, |_| false);
        let stays = |photo: usize| self.bundle.fixed[photo] || !moves(photo);
        Bundle {
            cameras: self.bundle.cameras.clone(),
            lenses: self.bundle.lenses.clone(),
            lens_of: self.bundle.lens_of.clone(),
            rig: self.bundle.rig.clone(),
            fixed: (0..self.placed.len()).map(stays).collect(),
            points,
            observations,
            ..Bundle::default()
        }
    }

    /// Adjusts a part of the scene that these tracks make, and takes its cameras and points over; returns its lenses.
    fn adjust(&mut self, mut part: Bundle, mut tracks: Vec<u32>) -> Vec<Lens> {
        for (scale, steps) in GROWING {
            part.adjust_roughly(scale, steps);
        }
        part.leave_out(FITS);
        let agreed = part.agreed();
        let mut seen = vec![0; self.placed.len()];
        part.observations.iter().filter(|o| agreed[o.point]).for_each(|o| seen[o.camera] += 1);
        let seen = part.summed(seen);
        tracks.retain(|track| self.points[*track as usize].is_some());
        for ((track, point), agreed) in tracks.iter().zip(&part.points).zip(agreed) {
            self.points[*track as usize] = agreed.then_some(*point);
        }
        let moved = (0..seen.len()).filter(|photo| !part.fixed[*photo] && self.placed[*photo]);
        for photo in moved.filter(|photo| seen[*photo] < LOST).collect::<Vec<_>>() {
            (self.placed[photo], self.refused[photo]) = (false, true);
        }
        self.bundle.cameras = part.cameras;
        part.lenses
    }

    /// Places some of the photos that see the most points; returns which.
    fn join(&mut self) -> Vec<usize> {
        let of = |photo: usize| self.bundle.together(photo).flat_map(|photo| &self.tracks_of[photo]);
        let sees = |photo: usize| of(photo).filter(|track| self.points[**track as usize].is_some()).count();
        let grown =
            |photo: usize, now: usize| self.tried[photo].is_none_or(|then| now as f64 > (1.0 + AGAIN) * then as f64);
        let waits = |photo: &usize| !self.placed[*photo] && !self.refused[*photo] && self.bundle.leads(*photo);
        let waiting = (0..self.placed.len()).filter(waits);
        let mut waiting: Vec<(usize, usize)> = waiting.map(|photo| (photo, sees(photo))).collect();
        waiting.retain(|(photo, sees)| grown(*photo, *sees));
        waiting.sort_by_key(|(photo, sees)| (Reverse(*sees), *photo));
        for some in waiting.chunks(TRIED) {
            let photos: Vec<usize> = some.iter().flat_map(|(photo, _)| self.bundle.together(*photo)).collect();
            some.iter().for_each(|(photo, sees)| self.tried[*photo] = Some(*sees));
            let mut refused = vec![true; self.placed.len()];
            photos.iter().for_each(|photo| refused[*photo] = false);
            let (points, all) = self.see(&self.tracks(&photos), |photo| !refused[photo]);
            self.bundle.points = points;
            self.bundle.observations = all.iter().filter(|o| self.placed[o.camera]).copied().collect();
            let joined = join(self.evidence, self.bundle, self.placed, &refused, &all, TOGETHER);
            if !joined.is_empty() {
                joined.iter().for_each(|photo| self.placed[*photo] = true);
                return joined;
            }
        }
        Vec::new()
    }
}
