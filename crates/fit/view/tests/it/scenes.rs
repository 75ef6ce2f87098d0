//! Scenes that tests look at.

use std::path::PathBuf;
use weaver_geometry::glam::{DMat3, DVec3};
use weaver_geometry::{Camera, Intrinsics, Similarity, trajectory};
use weaver_scene::Gaussians;

/// Numbers from 0 to 1, the same in every run.
pub struct Chance(u64);

impl Chance {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next()
    }
}

/// Gaussians in a ball of radius 1 around the origin.
pub fn cloud(n: usize, degree: usize, seed: u64) -> Gaussians {
    let mut chance = Chance::new(seed);
    let mut gaussians = Gaussians { degree, ..Gaussians::default() };
    let large = -3.0 - (n as f32 / 2000.0).ln() / 3.0;
    for _ in 0..n {
        gaussians.means.push([0; 3].map(|_| chance.between(-1.0, 1.0)));
        gaussians.log_scales.push([0; 3].map(|_| chance.between(large - 1.5, large + 0.5)));
        gaussians.quats.push([0; 4].map(|_| chance.between(-1.0, 1.0)));
        gaussians.opacity_logits.push(chance.between(-3.0, 5.0));
        gaussians.sh.extend((0..3).map(|_| chance.between(-1.5, 1.5)));
        gaussians.sh.extend((3..3 * (degree + 1) * (degree + 1)).map(|_| chance.between(-0.2, 0.2)));
    }
    gaussians
}

/// A floor of Gaussians through the origin, tilted by an angle about z.
pub fn floor(tilt: f64) -> Gaussians {
    let mut gaussians = Gaussians { degree: 1, ..Gaussians::default() };
    let mut chance = Chance::new(3);
    for i in 0..61 {
        for j in 0..61 {
            gaussians.means.push([0.05 * i as f32 - 1.5, 0.0, 0.05 * j as f32 - 1.5]);
            gaussians.log_scales.push([-3.2, -7.0, -3.2]);
            gaussians.quats.push([1.0, 0.0, 0.0, 0.0]);
            gaussians.opacity_logits.push(6.0);
            gaussians.sh.extend((0..12).map(|_| chance.between(-0.3, 0.3)));
        }
    }
    let rotation = DMat3::from_rotation_z(tilt);
    gaussians.transformed(&Similarity { scale: 1.0, rotation, translation: DVec3::ZERO })
}

/// A camera that looks at the origin.
pub fn camera(eye: [f64; 3], width: usize, height: usize) -> Camera {
    let intrinsics = Intrinsics {
        fx: 0.9 * width as f64,
        fy: 0.92 * width as f64,
        cx: 0.48 * width as f64,
        cy: 0.53 * height as f64,
    };
    Camera { pose: trajectory::look_at(DVec3::from(eye), DVec3::ZERO, DVec3::NEG_Y), intrinsics, width, height }
}

/// `shared/data/NAME` in `WEAVER_SHARED`, or beside one of the folders above this crate.
pub fn shared(test: &str, name: &str) -> Option<PathBuf> {
    let roots = match std::env::var_os("WEAVER_SHARED") {
        Some(root) => vec![PathBuf::from(root)],
        None => {
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join("shared")).collect()
        }
    };
    let found = roots.iter().map(|root| root.join("data").join(name)).find(|path| path.exists());
    if found.is_none() {
        eprintln!("skipped: no data ({test})");
    }
    found
}
