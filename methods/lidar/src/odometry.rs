//! Poses of scans, and the map that grows with them.

use crate::loops::closing;
use crate::{
    Edge, Error, Frame, GeometricSettings, Lost, MapReport, MapSettings, MapState, Mapper, PatchTree, RangeReference,
    Registered, Result, Scan, TrackSettings, optimize_poses, register, register_ranges,
};
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_surfel::SurfelCamera;

/// Most points of a scan in the geometric stage.
const MOST_POINTS: usize = 30_000;

/// The outcome of a scan.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracked {
    /// The scan's number.
    pub scan: usize,
    /// Sensor to world.
    pub pose: Pose,
    /// Share of the scan in the last step of registration; 1 for the first.
    pub fitness: f64,
    /// Reason of failure, if the pose is only predicted.
    pub lost: Option<Lost>,
    /// Reason for leaving out the range stage, if it was.
    pub without_ranges: Option<String>,
    /// The effect on the map, if the scan is a keyframe.
    pub map: Option<MapReport>,
    /// The scan of the keyframe at the other end of a loop closure.
    pub closed: Option<usize>,
}

/// State of an [`Odometry`] beside its map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OdometryState {
    /// Poses of the scans, sensor to world.
    pub poses: Vec<Pose>,
    /// For each scan, the number of the last keyframe of all maps at that time.
    pub anchors: Vec<u32>,
    /// Measured motions between keyframes of the current map.
    pub edges: Vec<Edge>,
    /// Scans since the last keyframe.
    pub since: usize,
    /// Scans lost in a row.
    pub lost: usize,
}

/// Odometry and mapping, scan by scan.
#[derive(Debug)]
pub struct Odometry {
    settings: TrackSettings,
    mapper: Mapper,
    /// Range limits, meters.
    range: [f64; 2],
    state: OdometryState,
    /// Given poses, in place of tracking.
    given: Option<Vec<Pose>>,
    reference: Option<Reference>,
    /// Result of [`Scan::check_single`] on the first scan: the reason against range images.
    single: Option<std::result::Result<(), String>>,
    /// The first scan, until the motion of its sweep is known, if sweeps are deskewed.
    first: Option<Scan>,
}

/// The drawn last keyframe, as the reference of registration.
#[derive(Debug)]
struct Reference {
    pose: Pose,
    tree: PatchTree,
    ranges: RangeReference,
}

impl Reference {
    fn new(mapper: &mut Mapper, pose: Pose) -> Result<Self> {
        let ranges = mapper.reference(&pose)?;
        Ok(Self { pose, tree: PatchTree::new(&ranges.points()), ranges })
    }
}

impl Odometry {
    /// Begins; the first scan's frame is the world's, or given by `given`.
    ///
    /// # Errors
    /// As [`MapSettings::check`].
    pub fn new(
        camera: &SurfelCamera,
        range: [f64; 2],
        map: MapSettings,
        settings: TrackSettings,
        given: Option<Vec<Pose>>,
    ) -> Result<Self> {
        if !(range[0] >= 0.0 && range[0] < range[1] && range[1].is_finite()) {
            let [near, far] = range;
            return Err(Error::Settings(format!("range: expected meters near < far, found {near}, {far}")));
        }
        let mapper = Mapper::new(camera, map)?;
        Ok(Self {
            settings,
            mapper,
            range,
            state: OdometryState::default(),
            given,
            reference: None,
            single: None,
            first: None,
        })
    }

    /// Poses (sensor to world) of the scans so far.
    pub fn poses(&self) -> &[Pose] {
        &self.state.poses
    }

    /// The map.
    pub fn mapper(&self) -> &Mapper {
        &self.mapper
    }

    /// The map, for drawing.
    pub fn mapper_mut(&mut self) -> &mut Mapper {
        &mut self.mapper
    }

    /// State beside the map.
    pub fn state(&self) -> &OdometryState {
        &self.state
    }

    /// Returns true if tracking ended: too many scans were lost in a row. With given poses it never ends.
    pub fn ended(&self) -> bool {
        self.given.is_none() && self.state.lost >= self.settings.lost
    }

    /// Restores a state, given the first scan. The [map](Mapper::restore) follows, and then [`refer`](Self::refer).
    pub fn restore(&mut self, state: OdometryState, first: &Scan, name: &str) {
        self.state = state;
        self.first = (self.settings.deskew && self.state.poses.len() == 1).then(|| first.clone());
        let (kept, _) = first.within(self.range);
        self.single = Some(kept.check_single(name).map_err(|error| error.to_string()));
    }

    /// Draws the last keyframe as the reference of the next scan.
    ///
    /// # Errors
    /// As [`Mapper::draw`].
    pub fn refer(&mut self) -> Result<()> {
        if let Some(pose) = self.mapper.keyframes().last().map(|keyframe| keyframe.pose) {
            self.reference = Some(Reference::new(&mut self.mapper, pose)?);
        }
        Ok(())
    }

    /// The predicted pose: the last motion again.
    fn expected(&self) -> Pose {
        match self.state.poses.as_slice() {
            [] => Pose::IDENTITY,
            [only] => *only,
            [.., before, last] => last.compose(&before.inverse().compose(last)),
        }
    }

    /// The range image of scan `number`, whose predecessors have their poses already, from its points within the range,
    /// optionally moved to the sensor's position at the beginning of the sweep. The motion of the sweep is the motion
    /// from the previous scan to this one or, while this one has no pose yet, to the previous scan; for the first one,
    /// the motion to the second.
    ///
    /// # Errors
    /// When the scan has no points within the range, or fills fewer than 100 pixels.
    pub fn frame(&self, number: usize, scan: &Scan, name: &str) -> Result<Frame> {
        let poses = &self.state.poses;
        self.frame_of(scan, name, poses.get(..=number.max(1)).unwrap_or(poses))
    }

    /// The range image of a scan whose sweep continues the last motion of a path.
    fn frame_of(&self, scan: &Scan, name: &str, path: &[Pose]) -> Result<Frame> {
        let [near, far] = self.range;
        let (mut kept, _) = scan.within(self.range);
        if kept.points.is_empty() {
            return Err(Error::NoPoints { of: name.into(), points: scan.points.len(), near, far });
        }
        if let (true, [.., before, last]) = (self.settings.deskew, path) {
            kept = kept.deskewed(&before.inverse().compose(last));
        }
        Frame::new(&kept, self.mapper.camera(), name)
    }

    /// The range image of the next scan, by the motion to a pose.
    fn frame_toward(&self, pose: Pose, scan: &Scan, name: &str) -> Result<Frame> {
        let last = self.state.poses.last().copied();
        self.frame_of(scan, name, &last.into_iter().chain([pose]).collect::<Vec<_>>())
    }

    /// Tracks the next scan and adds it to the map if it becomes a keyframe.
    ///
    /// # Errors
    /// As [`frame`](Self::frame); the scan is then not added.
    pub fn add(&mut self, scan: &Scan, name: &str) -> Result<Tracked> {
        let number = self.state.poses.len();
        let mut frame = self.frame(number, scan, name)?;
        if self.single.is_none() {
            let (kept, _) = scan.within(self.range);
            self.single = Some(kept.check_single(name).map_err(|error| error.to_string()));
        }
        let mut tracked = self.untracked();
        let given = self.given.as_ref().map(|poses| poses.get(number).copied());
        match (given, &self.reference) {
            (Some(pose), _) => tracked.pose = pose.unwrap_or(tracked.pose),
            (None, Some(reference)) => self.track(reference, &frame, &mut tracked),
            (None, None) => {}
        }
        if self.settings.deskew && !scan.times.is_empty() {
            // The sweep's own motion is known now. The previous motion would oscillate: its error comes back with the
            // other sign.
            self.begin_again(&tracked)?;
            frame = self.frame_toward(tracked.pose, scan, name)?;
            if let (None, None, Some(reference)) = (given, tracked.lost, &self.reference) {
                tracked.without_ranges = None;
                self.track(reference, &frame, &mut tracked);
                self.begin_again(&tracked)?;
                frame = self.frame_toward(tracked.pose, scan, name)?;
            }
        }
        self.lost_or_found(&tracked);
        if self.is_keyframe(&tracked) {
            self.add_keyframe(frame, &mut tracked)?;
        } else {
            self.state.since += 1;
        }
        self.keep(&tracked);
        self.first = (self.settings.deskew && number == 0).then(|| scan.clone());
        Ok(tracked)
    }

    /// Makes the map of the first scan once more after the second tracked scan, which determines the motion of the
    /// first sweep.
    fn begin_again(&mut self, second: &Tracked) -> Result<()> {
        let (Some(first), [pose], None) = (&self.first, &self.state.poses[..], second.lost) else { return Ok(()) };
        let pose = *pose;
        let frame = self.frame_of(first, "the first scan", &[pose, second.pose])?;
        self.mapper.restore(MapState::default());
        self.mapper.add(0, frame, pose)?;
        self.reference = Some(Reference::new(&mut self.mapper, pose)?);
        Ok(())
    }

    fn lost_or_found(&mut self, tracked: &Tracked) {
        self.state.lost = if tracked.lost.is_some() { self.state.lost + 1 } else { 0 };
    }

    fn keep(&mut self, tracked: &Tracked) {
        self.state.poses.push(tracked.pose);
        self.state.anchors.push(self.mapper.state().count.saturating_sub(1) as u32);
    }

    /// Adds a keyframe to the map, and closes a loop if it returned to an earlier one.
    fn add_keyframe(&mut self, frame: Frame, tracked: &mut Tracked) -> Result<()> {
        let report = self.mapper.add(tracked.scan, frame, tracked.pose)?;
        self.state.since = 0;
        if report.new_map {
            self.state.edges.clear();
        }
        if let [.., before, last] = self.mapper.keyframes() {
            let to = self.mapper.keyframes().len() - 1;
            let motion = before.pose.inverse().compose(&last.pose);
            self.state.edges.push(Edge { from: to - 1, to, motion, weight: 1.0 });
        }
        tracked.map = Some(report);
        let settings = self.settings.loops.filter(|_| self.given.is_none());
        let edge = settings.and_then(|settings| closing(self.mapper.keyframes(), &settings, MOST_POINTS));
        if let Some(edge) = edge {
            tracked.closed = Some(self.mapper.keyframes()[edge.from].scan);
            self.close(edge);
            tracked.pose = self.mapper.keyframes()[edge.to].pose;
        }
        self.reference = Some(Reference::new(&mut self.mapper, tracked.pose)?);
        Ok(())
    }

    /// Moves keyframes, their surfels and their scans so that all measured motions agree best.
    fn close(&mut self, edge: Edge) {
        self.state.edges.push(edge);
        let old: Vec<Pose> = self.mapper.keyframes().iter().map(|keyframe| keyframe.pose).collect();
        let mut new = old.clone();
        optimize_poses(&mut new, &self.state.edges);
        self.mapper.move_keyframes(&new);
        let first = self.mapper.state().count - new.len();
        for (pose, anchor) in self.state.poses.iter_mut().zip(&self.state.anchors) {
            if let Some(k) = (*anchor as usize).checked_sub(first) {
                *pose = new[k].compose(&old[k].inverse()).compose(pose);
            }
        }
    }

    /// Leaves out an unusable scan: it is lost, with the predicted or the given pose.
    pub fn skip(&mut self) -> Tracked {
        let given = self.given.as_ref().and_then(|poses| poses.get(self.state.poses.len()).copied());
        let mut tracked = Tracked { fitness: 0.0, lost: Some(Lost::NoScan), ..self.untracked() };
        tracked.pose = given.unwrap_or(tracked.pose);
        self.lost_or_found(&tracked);
        self.state.since += 1;
        self.keep(&tracked);
        tracked
    }

    fn untracked(&self) -> Tracked {
        let (scan, pose) = (self.state.poses.len(), self.expected());
        Tracked { scan, pose, fitness: 1.0, lost: None, without_ranges: None, map: None, closed: None }
    }

    /// Registers a frame to the last keyframe: by geometry, then by ranges.
    fn track(&self, reference: &Reference, frame: &Frame, tracked: &mut Tracked) {
        let start = reference.pose.inverse().compose(&tracked.pose);
        let step = frame.points.len().div_ceil(MOST_POINTS).max(1);
        let query: Vec<DVec3> = frame.points.iter().step_by(step).copied().collect();
        let settings = GeometricSettings { steps: self.settings.geometric_steps, ..Default::default() };
        let mut found = register(&query, &reference.tree, &start, &settings);
        match (&self.single, found) {
            (Some(Err(reason)), _) => tracked.without_ranges = Some(reason.clone()),
            (_, Ok(Registered { pose, .. })) if self.settings.range_steps > 0 => {
                let ranges = register_ranges(&frame.points, &reference.ranges, &pose, self.settings.range_steps);
                match ranges {
                    Ok(registered) => found = Ok(registered),
                    Err(lost) => tracked.without_ranges = Some(lost.to_string()),
                }
            }
            _ => {}
        }
        match found {
            Ok(Registered { fitness, .. }) if fitness < self.settings.lost_fitness => {
                let percent = (100.0 * fitness) as u32;
                (tracked.lost, tracked.fitness) = (Some(Lost::LittleFits(percent)), fitness);
            }
            Ok(Registered { pose, fitness, .. }) => {
                (tracked.pose, tracked.fitness) = (reference.pose.compose(&pose), fitness);
            }
            Err(lost) => (tracked.lost, tracked.fitness) = (Some(lost), 0.0),
        }
    }

    /// Returns true if a scan becomes a keyframe; a lost one never does, as it would spoil the map.
    fn is_keyframe(&self, tracked: &Tracked) -> bool {
        let Some(reference) = &self.reference else { return true };
        if tracked.lost.is_some() {
            return false;
        }
        let far = reference.pose.translation.distance(tracked.pose.translation) > self.settings.farthest;
        let tracking = self.given.is_none();
        far || (tracking && tracked.fitness < self.settings.least_fitness)
            || self.state.since + 1 > self.settings.most_frames
    }
}
