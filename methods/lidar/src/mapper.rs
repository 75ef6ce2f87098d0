//! Maps of surfels from keyframes.

use crate::drawn_normals::Rays;
use crate::frame::plane_range;
use crate::map_loss::{ImageGradients, map_loss};
use crate::scan::vector;
use crate::{Frame, MapLoss, MapSettings, RangeReference, Result};
use weaver_geometry::Pose;
use weaver_geometry::glam::{DQuat, DVec3};
use weaver_kernels::nearest_neighbors::nearest_neighbors;
use weaver_kernels::optim::AdamW;
use weaver_kernels::order::median_high;
use weaver_kernels::random::Stream;
use weaver_surfel::{Limits, RangeCotangents, RangeImages, Sight, SurfelCamera, SurfelWorkspace, Surfels};

/// Rates of Adam: centers in meters, quaternions, logarithms of scales, logits.
const RATES: [f64; 4] = [5e-4, 1e-3, 5e-3, 5e-2];
/// Opacity of a new surfel.
const NEW_OPACITY: f64 = 0.9;

/// A scan among the targets of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Keyframe {
    /// The scan's number.
    pub scan: usize,
    /// Its range image.
    pub frame: Frame,
    /// Sensor to world.
    pub pose: Pose,
}

/// The effect of a keyframe on the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapReport {
    /// Number of added surfels.
    pub added: usize,
    /// Number of surfels pruned afterwards.
    pub pruned: usize,
    /// Number of surfels of the map now.
    pub surfels: usize,
    /// Loss of the last step.
    pub loss: MapLoss,
    /// True if a new map was begun.
    pub new_map: bool,
}

/// State of a [`Mapper`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MapState {
    /// The current map, in the world's frame.
    pub surfels: Surfels<f32>,
    /// Index of the keyframe from which each surfel was made.
    pub owners: Vec<u32>,
    /// The keyframes of the current map.
    pub keyframes: Vec<Keyframe>,
    /// Complete maps.
    pub finished: Vec<Surfels<f32>>,
    /// Number of keyframes of all maps.
    pub count: usize,
}

/// Surfels in the world's frame, and the keyframes of their fit.
#[derive(Debug)]
pub struct Mapper {
    settings: MapSettings,
    camera: SurfelCamera,
    rays: Rays,
    state: MapState,
    workspace: SurfelWorkspace<f32>,
    images: RangeImages<f32>,
    gradients: ImageGradients,
}

impl Mapper {
    /// An empty map.
    ///
    /// # Errors
    /// As [`MapSettings::check`].
    pub fn new(camera: &SurfelCamera, settings: MapSettings) -> Result<Self> {
        settings.check()?;
        Ok(Self {
            settings,
            camera: *camera,
            rays: Rays::new(camera),
            state: MapState::default(),
            workspace: SurfelWorkspace::new(),
            images: RangeImages::default(),
            gradients: ImageGradients::default(),
        })
    }

    /// Restores a state.
    pub fn restore(&mut self, state: MapState) {
        self.state = state;
    }

    /// The state so far.
    pub fn state(&self) -> &MapState {
        &self.state
    }

    /// The surfels of the current map.
    pub fn surfels(&self) -> &Surfels<f32> {
        &self.state.surfels
    }

    /// The keyframes of the current map.
    pub fn keyframes(&self) -> &[Keyframe] {
        &self.state.keyframes
    }

    /// Moves the keyframes of the current map to other poses, each with its surfels.
    ///
    /// # Panics
    ///
    /// If there are not as many poses.
    pub fn move_keyframes(&mut self, poses: &[Pose]) {
        let MapState { surfels, owners, keyframes, .. } = &mut self.state;
        assert_eq!(poses.len(), keyframes.len(), "a pose for each keyframe");
        let motions: Vec<Pose> = keyframes.iter().zip(poses).map(|(old, new)| new.relative_to(&old.pose)).collect();
        surfels.transform_each(|n| motions[owners[n] as usize]);
        keyframes.iter_mut().zip(poses).for_each(|(keyframe, pose)| keyframe.pose = *pose);
    }

    /// The camera.
    pub fn camera(&self) -> &SurfelCamera {
        &self.camera
    }

    /// The surfels of all maps.
    pub fn all(&self) -> Surfels<f32> {
        let mut all = Surfels::default();
        self.state.finished.iter().chain([&self.state.surfels]).for_each(|map| all.extend(map));
        all
    }

    /// Draws the map from a pose (sensor to world).
    ///
    /// # Errors
    /// As [`SurfelWorkspace::draw`].
    pub fn draw(&mut self, pose: &Pose) -> Result<&RangeImages<f32>> {
        let poses = [pose.inverse()];
        let sight = sight(&self.state.surfels, &self.camera, &poses);
        self.workspace.draw(&sight, &mut self.images)?;
        Ok(&self.images)
    }

    /// The drawn ranges from a pose at pixels with an opacity above one half: the reference for registration.
    ///
    /// # Errors
    /// As [`draw`](Self::draw).
    pub fn reference(&mut self, pose: &Pose) -> Result<RangeReference> {
        let images = self.draw(pose)?;
        let seen = images.mean_range().into_iter().zip(&images.opacity);
        let ranges = seen.map(|(r, a)| if *a > 0.5 { f64::from(r) } else { 0.0 }).collect();
        Ok(RangeReference::new(&self.camera, ranges))
    }

    /// Adds a keyframe: surfels at uncovered pixels, then steps of Adam on random keyframes, then pruning of
    /// transparent surfels.
    ///
    /// # Errors
    /// As [`draw`](Self::draw).
    pub fn add(&mut self, scan: usize, frame: Frame, pose: Pose) -> Result<MapReport> {
        let new_map = self.state.surfels.len() > self.settings.most_surfels
            || self.state.keyframes.len() >= self.settings.most_keyframes;
        if new_map {
            self.state.finished.push(std::mem::take(&mut self.state.surfels));
            self.state.owners.clear();
            self.state.keyframes.clear();
        }
        let frame = match self.settings.measured_normals || self.settings.loss.target == crate::NormalTarget::Measured {
            true => frame.with_normals(),
            false => frame,
        };
        let added = self.grow(&frame, &pose)?;
        self.state.keyframes.push(Keyframe { scan, frame, pose });
        self.state.count += 1;
        let loss = self.fit()?;
        let before = self.state.surfels.len();
        let least = logit(self.settings.prune) as f32;
        let marks: Vec<bool> = self.state.surfels.opacity_logits.iter().map(|logit| *logit >= least).collect();
        self.state.surfels.keep(&marks);
        let mut mark = marks.iter();
        self.state.owners.retain(|_| mark.next() == Some(&true));
        Ok(MapReport {
            added,
            pruned: before - self.state.surfels.len(),
            surfels: self.state.surfels.len(),
            loss,
            new_map,
        })
    }

    /// Adds surfels at a share of the uncovered pixels, drawn without replacement with the range gradient as weight.
    fn grow(&mut self, frame: &Frame, pose: &Pose) -> Result<usize> {
        let uncovered = self.settings.uncovered as f32;
        let first = self.state.surfels.is_empty();
        let images = self.draw(pose)?;
        let open = |i: &usize| first || images.opacity[frame.pixels[*i] as usize] <= uncovered;
        let open: Vec<usize> = (0..frame.pixels.len()).filter(open).collect();
        let count = (self.settings.density * open.len() as f64).floor() as usize;
        let weights = frame.log_gradients();
        let stream = Stream::new(self.settings.seed, self.state.count as u64, "surfels");
        let chosen = choose(&open, &weights, count, stream);
        let points: Vec<DVec3> = chosen.iter().map(|i| frame.points[*i]).collect();
        let scales = scales(&points, self.settings.scale_limit);
        let (turn, owner) = (DQuat::from_mat3(&pose.rotation), self.state.keyframes.len() as u32);
        for ((i, p), scale) in chosen.iter().zip(&points).zip(scales) {
            let toward = -p.normalize();
            let normal = match self.settings.measured_normals {
                true => frame.normals[*i],
                false => toward,
            };
            let q = turn * DQuat::from_rotation_arc(DVec3::Z, normal);
            let center = pose.apply(*p).to_array().map(|x| x as f32);
            let quat = [q.w, q.x, q.y, q.z].map(|x| x as f32);
            self.state.owners.push(owner);
            self.state.surfels.push(center, quat, [scale.ln() as f32; 2], logit(NEW_OPACITY) as f32);
        }
        Ok(count)
    }

    /// Steps of Adam, each on one keyframe.
    fn fit(&mut self) -> Result<MapLoss> {
        let n = self.state.surfels.len();
        let stream = Stream::new(self.settings.seed, self.state.count as u64, "keyframes");
        let (mut moments, mut squares) = (Surfels::zeros(n), Surfels::zeros(n));
        let mut gradients = Surfels::default();
        let mut loss = MapLoss::default();
        for step in 0..=self.settings.iterations as u64 {
            let Keyframe { frame, pose, .. } = &self.state.keyframes[stream.below(step, self.state.keyframes.len())];
            let poses = [pose.inverse()];
            let sight = sight(&self.state.surfels, &self.camera, &poses);
            self.workspace.draw(&sight, &mut self.images)?;
            loss = map_loss(frame, &self.images, &self.rays, &self.settings.loss, &mut self.gradients);
            let ImageGradients { range, opacity, normal, .. } = &self.gradients;
            let cotangents = RangeCotangents { range: Some(range), opacity: Some(opacity), normal: Some(normal) };
            self.workspace.backward(&sight, &cotangents, &mut gradients, None);
            self.limit_scales(&mut gradients);
            descend(step + 1, &mut self.state.surfels, &gradients, &mut moments, &mut squares);
        }
        Ok(loss)
    }

    /// Adds the gradient of w max(0, max(s) - limit), summed or averaged over surfels.
    fn limit_scales(&self, gradients: &mut Surfels<f32>) {
        let limit = self.settings.scale_limit.ln() as f32;
        let count = if self.settings.scale_mean { self.state.surfels.len() as f64 } else { 1.0 };
        let weight = (self.settings.scale_weight / count) as f32;
        let pairs = self.state.surfels.log_scales.chunks_exact(2).zip(gradients.log_scales.chunks_exact_mut(2));
        for (scales, gradient) in pairs {
            let larger = usize::from(scales[1] > scales[0]);
            if scales[larger] > limit {
                gradient[larger] += weight * scales[larger].exp();
            }
        }
    }
}

fn sight<'a>(surfels: &'a Surfels<f32>, camera: &'a SurfelCamera, poses: &'a [Pose]) -> Sight<'a, f32> {
    Sight { surfels: surfels.slices(), camera, poses, limits: Limits::default() }
}

fn logit(p: f64) -> f64 {
    (p / (1.0 - p)).ln()
}

fn descend(
    step: u64,
    surfels: &mut Surfels<f32>,
    gradients: &Surfels<f32>,
    moments: &mut Surfels<f32>,
    squares: &mut Surfels<f32>,
) {
    let adam = |rate: f64| AdamW {
        rate: rate as f32,
        beta1: 0.9,
        beta2: 0.999,
        eps: 1e-15,
        weight_decay: 0.0,
        gradient_scale: 1.0,
    };
    let [centers, quats, scales, logits] = RATES.map(adam);
    centers.step(step, &mut surfels.centers, &gradients.centers, &mut moments.centers, &mut squares.centers);
    quats.step(step, &mut surfels.quats, &gradients.quats, &mut moments.quats, &mut squares.quats);
    let (m, v) = (&mut moments.log_scales, &mut squares.log_scales);
    scales.step(step, &mut surfels.log_scales, &gradients.log_scales, m, v);
    let (m, v) = (&mut moments.opacity_logits, &mut squares.opacity_logits);
    logits.step(step, &mut surfels.opacity_logits, &gradients.opacity_logits, m, v);
}

/// Draws `count` of `from` without replacement by `weights`; entries of weight 0 come last, uniformly.
///
/// The smallest of -ln(u) / w, for a number u between 0 and 1 for each, are such a draw.
fn choose(from: &[usize], weights: &[f64], count: usize, stream: Stream) -> Vec<usize> {
    let key = |i: usize| {
        let time = -(1.0 - stream.uniform::<f64>(i as u64)).max(f64::MIN_POSITIVE).ln();
        if weights[i] > 0.0 { (0, time / weights[i]) } else { (1, time) }
    };
    let mut keyed: Vec<((u8, f64), usize)> = from.iter().map(|i| (key(*i), *i)).collect();
    keyed.sort_by(|(a, i), (b, j)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(i.cmp(j)));
    let mut chosen: Vec<usize> = keyed[..count].iter().map(|(_, i)| *i).collect();
    chosen.sort_unstable();
    chosen
}

/// sqrt(clamp(mean squared distance to three neighbors, 1e-7, limit^2)) of each point.
fn scales(points: &[DVec3], limit: f64) -> Vec<f64> {
    let flat: Vec<f64> = points.iter().flat_map(|p| p.to_array()).collect();
    let mut neighbors = vec![0; 4 * points.len()];
    nearest_neighbors(&flat, 3, &mut neighbors);
    let mean = |row: &[u32]| {
        let near = row[1..].iter().filter(|i| **i != row[0]);
        let squares = near.map(|i| points[*i as usize].distance_squared(points[row[0] as usize]));
        let (sum, count) = squares.fold((0.0, 0.0), |(sum, count), d| (sum + d, count + 1.0));
        if count > 0.0 { sum / count } else { limit * limit }
    };
    neighbors.chunks_exact(4).map(|row| mean(row).clamp(1e-7, limit * limit).sqrt()).collect()
}

/// The share of the rays of a scan with a drawn opacity above one half and a drawn range within `near` meters of the
/// measured one, and the median difference there.
///
/// The range of a pixel is extrapolated to the exact ray along the plane of the drawn normal.
///
/// # Errors
/// As [`Mapper::draw`].
pub fn held_out(mapper: &mut Mapper, points: &[[f32; 3]], pose: &Pose, near: f64) -> Result<[f64; 2]> {
    let camera = *mapper.camera();
    let images = mapper.draw(pose)?;
    let ranges = images.mean_range();
    let mut differences = Vec::new();
    for p in points {
        let p = vector(p);
        let at = camera.project(p);
        if !(at.y >= 0.0 && at.y < camera.height as f64) {
            continue;
        }
        let column = (at.x.floor().rem_euclid(camera.width as f64) as usize).min(camera.width - 1);
        let pixel = at.y as usize * camera.width + column;
        if images.opacity[pixel] > 0.5 {
            let range = f64::from(ranges[pixel]);
            let drawn = camera.pixel_ray(pixel % camera.width, pixel / camera.width) * range;
            let normal = DVec3::from_array([0, 1, 2].map(|k| f64::from(images.normal[3 * pixel + k])));
            let range = plane_range(drawn, normal.normalize_or_zero(), p.normalize()).unwrap_or(range);
            differences.push((range - p.length()).abs());
        }
    }
    let hits = differences.iter().filter(|d| **d < near).count();
    let median = median_high(&mut differences).unwrap_or(f64::INFINITY);
    Ok([hits as f64 / points.len().max(1) as f64, median])
}
