//! Mutual position of the cameras of a scene.

use crate::Scene;
use std::sync::OnceLock;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;

/// Layout of a scene's cameras: measured over all pairs once, so that each tuple costs little.
///
/// ```
/// use weaver_data::{Layout, procedural};
/// let scene = procedural::scene(1, &procedural::ProceduralOptions { width: 8, height: 8, views: 5 });
/// let layout = Layout::of(&scene);
/// assert_eq!(layout.nearest(0, &[0, 1, 2], 1), scene.nearest(0, &[0, 1, 2], 1));
/// ```
#[derive(Clone, Debug)]
pub struct Layout {
    scene: String,
    poses: Vec<Pose>,
    centers: Vec<DVec3>,
    training: Vec<usize>,
    /// Median distance over all pairs of cameras; 0 for fewer than two.
    median: f64,
    central: OnceLock<usize>,
}

impl Layout {
    /// Measures a scene. Its cameras and which of its views are held out must not change afterward.
    pub fn of(scene: &Scene) -> Self {
        let poses: Vec<Pose> = scene.views.iter().map(|view| view.camera.pose).collect();
        let centers: Vec<DVec3> = poses.iter().map(Pose::center).collect();
        let median = median_distance(&centers);
        Self {
            scene: scene.name.clone(),
            poses,
            centers,
            training: scene.training_views(),
            median,
            central: OnceLock::new(),
        }
    }

    /// The name of the scene.
    pub fn scene(&self) -> &str {
        &self.scene
    }

    /// Indices of the views to train on.
    pub fn training_views(&self) -> &[usize] {
        &self.training
    }

    /// Separation of two views: the distance between their cameras over the scene's median pairwise distance, plus the
    /// angle between them in radians.
    pub fn separation(&self, a: usize, b: usize) -> f64 {
        // Views that only turn on the spot differ by their angle alone.
        let distance = if self.median > 0.0 { self.centers[a].distance(self.centers[b]) / self.median } else { 0.0 };
        distance + self.poses[a].angle_to(&self.poses[b])
    }

    /// The `n` views of `among` nearest to view `to`, nearest first, ties by index; never `to` itself.
    pub fn nearest(&self, to: usize, among: &[usize], n: usize) -> Vec<usize> {
        let others = among.iter().filter(|&&v| v != to);
        let mut ranked: Vec<(f64, usize)> = others.map(|&v| (self.separation(to, v), v)).collect();
        let order = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if n < ranked.len() {
            ranked.select_nth_unstable_by(n, order);
            ranked.truncate(n);
        }
        ranked.sort_unstable_by(order);
        ranked.into_iter().map(|(_, v)| v).collect()
    }

    /// The training view with the smallest mean separation to the other training views: the scene's own frame. Computed
    /// at the first call.
    ///
    /// # Panics
    /// If the scene has no training views; see [`Scene::check_training`].
    pub fn central_view(&self) -> usize {
        *self.central.get_or_init(|| self.most_central())
    }

    fn most_central(&self) -> usize {
        let total = |v: usize| self.training.iter().map(|&w| self.separation(v, w)).sum::<f64>();
        let ranked = self.training.iter().map(|&v| (total(v), v));
        let central = ranked.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        central.expect("a scene with training views").1
    }
}

/// One question at a time: all pairs of views are measured for each, which [`Layout`] does once.
impl Scene {
    /// Separation of two views: the distance between their cameras over the scene's median pairwise distance, plus the
    /// angle between them in radians.
    pub fn separation(&self, a: usize, b: usize) -> f64 {
        Layout::of(self).separation(a, b)
    }

    /// The `n` views of `among` nearest to view `to`, nearest first, ties by index; never `to` itself.
    pub fn nearest(&self, to: usize, among: &[usize], n: usize) -> Vec<usize> {
        Layout::of(self).nearest(to, among, n)
    }

    /// The training view with the smallest mean separation to the other training views: the scene's own frame.
    ///
    /// # Panics
    /// If the scene has no training views; see [`Scene::check_training`].
    pub fn central_view(&self) -> usize {
        Layout::of(self).central_view()
    }
}

fn median_distance(centers: &[DVec3]) -> f64 {
    let mut distances: Vec<f64> = Vec::with_capacity(centers.len() * centers.len() / 2);
    for (i, a) in centers.iter().enumerate() {
        distances.extend(centers[..i].iter().map(|b| a.distance(*b)));
    }
    if distances.is_empty() {
        return 0.0;
    }
    let (middle, even) = (distances.len() / 2, distances.len().is_multiple_of(2));
    let (below, &mut upper, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = below.iter().copied().max_by(f64::total_cmp);
    lower.filter(|_| even).map_or(upper, |lower| (lower + upper) / 2.0)
}
