//! Photos that are kept outside of memory.

use crate::scenes::{cloud, photos, plain};
use std::sync::{Arc, Mutex};
use weaver_fit::{Fit, StrategyKind};
use weaver_geometry::Camera;
use weaver_scene::{Gaussians, KeptBytes, Photo, Pixels};

/// Bytes elsewhere, and the number of bytes in the same place.
#[derive(Debug)]
struct Elsewhere(Vec<u8>, Arc<Mutex<usize>>);

impl Elsewhere {
    fn keep(bytes: &[u8], all: &Arc<Mutex<usize>>) -> Arc<dyn KeptBytes> {
        *all.lock().unwrap() += bytes.len();
        Arc::new(Self(bytes.to_vec(), all.clone()))
    }
}

impl AsRef<[u8]> for Elsewhere {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

impl KeptBytes for Elsewhere {
    fn beside(&self, bytes: &[u8]) -> Option<Arc<dyn KeptBytes>> {
        Some(Self::keep(bytes, &self.1))
    }
}

/// A photo of three times the size: one that is smaller than 64 pixels is not halved.
fn enlarged(photo: Photo) -> Photo {
    let Camera { width, height, intrinsics, .. } = photo.camera;
    let of = |y: usize, x: usize| 3 * (y / 3 * width + x / 3);
    let pixels = (0..3 * height).flat_map(|y| (0..3 * width).map(move |x| of(y, x)));
    let rgb = pixels.flat_map(|at| photo.rgb[at..at + 3].to_vec()).collect();
    let intrinsics = intrinsics.resized(3.0, 3.0);
    let camera = Camera { intrinsics, width: 3 * width, height: 3 * height, ..photo.camera };
    Photo { camera, rgb, ..photo }
}

fn fitted(photos: Vec<Photo>) -> Gaussians {
    let mut settings = plain(StrategyKind::Split, 40, 60);
    (settings.halvings, settings.coarse_until) = (1, 0.5);
    let mut fit = Fit::new(photos, &cloud(40, 3), settings).unwrap();
    for _ in 0..40 {
        fit.step().unwrap();
    }
    fit.gaussians()
}

/// Promise (fits): photos that are kept outside of memory, with their smaller versions, lead to the same scene.
#[test]
fn kept_photos_lead_to_the_same_scene() {
    let all = Arc::new(Mutex::new(0));
    let in_memory: Vec<Photo> = photos(4, &cloud(40, 3)).into_iter().map(enlarged).collect();
    let mut kept = in_memory.clone();
    kept.iter_mut().for_each(|photo| photo.rgb = Pixels::Kept(Elsewhere::keep(&photo.rgb, &all)));
    let own: usize = in_memory.iter().map(|photo| photo.rgb.len()).sum();
    assert!(fitted(in_memory) == fitted(kept));
    assert_eq!(*all.lock().unwrap(), own + own / 4);
}
