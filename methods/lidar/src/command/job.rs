//! Odometry and mapping as a job in steps: a step is a scan.

use crate::command::plan::{name, read};
use crate::command::{LidarPlan, LidarRunError};
use crate::{Edge, Frame, Keyframe, Lost, MapState, Odometry, OdometryState, Tracked};
use std::path::PathBuf;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_io::safetensors::Tensors;
use weaver_run::{Job, Log, Rhythm, Save, Scalar, StepReport};
use weaver_surfel::Surfels;

/// The outcome of a scan.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanRecord {
    /// Share of the scan that fits the map.
    pub fitness: f64,
    /// Reason for the loss, or for the lack of range registration; empty without problems.
    pub remark: String,
    /// True if its pose is only predicted.
    pub lost: bool,
    /// True if it is a keyframe.
    pub keyframe: bool,
}

/// A run over the scans of a folder.
#[derive(Debug)]
pub struct LidarJob {
    plan: LidarPlan,
    files: Vec<PathBuf>,
    odometry: Odometry,
    records: Vec<ScanRecord>,
}

impl LidarJob {
    /// A new run.
    ///
    /// # Errors
    /// When there are fewer than two scans, the first cannot be used, or poses do not fit.
    pub fn new(plan: LidarPlan) -> Result<Self, LidarRunError> {
        Self::at_beginning(plan.begun()?)
    }

    /// The run of a stored plan, at its beginning.
    ///
    /// # Errors
    /// When the scans have changed since the run began; names the first changed one. Else as [`new`](Self::new).
    pub fn stored(plan: LidarPlan) -> Result<Self, LidarRunError> {
        plan.check_sources()?;
        Self::at_beginning(plan)
    }

    fn at_beginning(plan: LidarPlan) -> Result<Self, LidarRunError> {
        let files = plan.files()?;
        let trajectory = |path: &PathBuf| LidarPlan::trajectory(path, files.len());
        let given = plan.poses.as_ref().map(trajectory).transpose()?.map(|file| file.poses);
        plan.reference.as_ref().map(trajectory).transpose()?;
        let camera = plan.camera(&read(&files[0])?);
        let odometry = Odometry::new(&camera, plan.range, plan.map(), plan.track(), given)?;
        Ok(Self { plan, files, odometry, records: Vec::new() })
    }

    /// The settings of the run.
    pub fn plan(&self) -> &LidarPlan {
        &self.plan
    }

    /// The files of scans.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// Poses and the map so far.
    pub fn odometry(&self) -> &Odometry {
        &self.odometry
    }

    /// Poses and the map so far, for drawing.
    pub fn odometry_mut(&mut self) -> &mut Odometry {
        &mut self.odometry
    }

    /// The outcomes of the scans so far.
    pub fn records(&self) -> &[ScanRecord] {
        &self.records
    }

    /// Returns true if tracking ended before the last scan.
    pub fn ended(&self) -> bool {
        self.odometry.ended()
    }

    /// The range image of a tracked scan.
    ///
    /// # Errors
    /// When the file cannot be read or used any more.
    pub fn frame(&self, scan: usize) -> Result<Frame, LidarRunError> {
        let file = &self.files[scan];
        Ok(self.odometry.frame(scan, &read(file)?, &name(file))?)
    }

    fn record(&mut self, tracked: &Tracked, remark: Option<String>) {
        let remark = remark.or(tracked.lost.map(|lost| lost.to_string())).or(tracked.without_ranges.clone());
        self.records.push(ScanRecord {
            fitness: tracked.fitness,
            // A checkpoint has a line for each.
            remark: remark.unwrap_or_default().replace('\n', " "),
            lost: tracked.lost.is_some(),
            keyframe: tracked.map.is_some(),
        });
    }
}

impl Job for LidarJob {
    type Error = LidarRunError;

    fn steps(&self) -> [usize; 2] {
        let done = self.records.len();
        [done, if self.ended() { done } else { self.files.len() }]
    }

    fn step(&mut self) -> Result<StepReport, LidarRunError> {
        let number = self.records.len();
        let file = &self.files[number];
        let added = read(file).and_then(|scan| Ok(self.odometry.add(&scan, &name(file))?));
        let (tracked, remark) = match added {
            Ok(tracked) => (tracked, None),
            // Without a first scan there is nothing to track by.
            Err(error) if number == 0 || error.is_of_map() => return Err(error),
            Err(error) => {
                let path = file.display().to_string();
                (self.odometry.skip(), Some(error.to_string().replacen(&path, &name(file), 1)))
            }
        };
        self.record(&tracked, remark);
        let map = tracked.map.unwrap_or_default();
        let mut scalars = vec![Scalar::last("fitness", tracked.fitness)];
        if tracked.map.is_some() {
            scalars.push(Scalar::last("surfels", map.surfels as f64));
            scalars.push(Scalar::last("range_error", map.loss.range));
        }
        let of = self.steps()[1];
        Ok(StepReport { step: number + 1, of, stage: String::new(), loss: map.loss.total, scalars })
    }

    fn state(&mut self) -> Result<Tensors, LidarRunError> {
        let mut state = Tensors::default();
        let odometry = &self.odometry;
        let rows = |poses: &[Pose]| poses.iter().flat_map(pose_numbers).collect::<Vec<f64>>();
        state.insert("poses", &[odometry.poses().len(), POSE], rows(odometry.poses()));
        let known = odometry.state();
        state.insert("anchors", &[known.anchors.len()], known.anchors.clone());
        let edges: Vec<u64> = known.edges.iter().flat_map(|edge| [edge.from as u64, edge.to as u64]).collect();
        state.insert("edges", &[known.edges.len(), 2], edges);
        let motions: Vec<Pose> = known.edges.iter().map(|edge| edge.motion).collect();
        state.insert("edge_motions", &[motions.len(), POSE], rows(&motions));
        let MapState { surfels, owners, keyframes, finished, count } = odometry.mapper().state();
        let poses: Vec<Pose> = keyframes.iter().map(|keyframe| keyframe.pose).collect();
        state.insert("keyframe_poses", &[poses.len(), POSE], rows(&poses));
        let scans: Vec<u64> = keyframes.iter().map(|keyframe| keyframe.scan as u64).collect();
        state.insert("keyframe_scans", &[scans.len()], scans);
        let counts = [known.since, known.lost, *count, finished.len()].map(|x| x as u64);
        state.insert("counts", &[4], counts.to_vec());
        state.insert("owners", &[owners.len()], owners.clone());
        for (i, map) in finished.iter().chain([surfels]).enumerate() {
            let n = map.len();
            state.insert(format!("map.{i}.centers"), &[n, 3], map.centers.clone());
            state.insert(format!("map.{i}.quats"), &[n, 4], map.quats.clone());
            state.insert(format!("map.{i}.log_scales"), &[n, 2], map.log_scales.clone());
            state.insert(format!("map.{i}.opacity_logits"), &[n], map.opacity_logits.clone());
        }
        let fitness: Vec<f64> = self.records.iter().map(|record| record.fitness).collect();
        state.insert("fitness", &[fitness.len()], fitness);
        let flags = |record: &ScanRecord| u8::from(record.lost) | u8::from(record.keyframe) << 1;
        state.insert("flags", &[self.records.len()], self.records.iter().map(flags).collect::<Vec<u8>>());
        let remarks: Vec<&str> = self.records.iter().map(|record| record.remark.as_str()).collect();
        state.metadata.insert("remarks".into(), remarks.join("\n"));
        Ok(state)
    }

    fn restore(&mut self, state: &Tensors) -> Result<(), LidarRunError> {
        let n = state.get("fitness")?.data.len();
        let invalid = |what: &'static str, expected: String, found: String| LidarRunError::Invalid {
            path: state.origin().into(),
            what,
            expected,
            found,
        };
        if n == 0 || n > self.files.len() {
            return Err(invalid("scans", format!("up to {}, as many as there are", self.files.len()), n.to_string()));
        }
        let poses = |name: &str, n: usize| -> Result<Vec<Pose>, LidarRunError> {
            Ok(state.values::<f64>(name, &[n, POSE])?.chunks_exact(POSE).map(pose_of).collect())
        };
        let [since, lost, count, _] = *state.values::<u64>("counts", &[4])? else {
            return Err(invalid("counts", "four numbers".into(), "others".into()));
        };
        let mut complete = maps_of(state)?;
        let surfels = complete.pop().unwrap_or_default();
        let e = state.get("edges")?.data.len() / 2;
        let ends = state.values::<u64>("edges", &[e, 2])?;
        let k = state.get("keyframe_scans")?.data.len();
        if let Some(end) = ends.iter().find(|end| **end >= k as u64) {
            return Err(invalid("edges", format!("keyframes below {k}"), end.to_string()));
        }
        let motions = poses("edge_motions", e)?;
        let edges = ends.chunks_exact(2).zip(motions);
        let edges =
            edges.map(|(ends, motion)| Edge { from: ends[0] as usize, to: ends[1] as usize, motion, weight: 1.0 });
        let known = OdometryState {
            poses: poses("poses", n)?,
            anchors: state.values::<u32>("anchors", &[n])?.to_vec(),
            edges: edges.collect(),
            since: since as usize,
            lost: lost as usize,
        };
        let owners = state.values::<u32>("owners", &[surfels.len()])?.to_vec();
        if let Some(owner) = owners.iter().find(|owner| **owner as usize >= k) {
            return Err(invalid("owners", format!("keyframes below {k}"), owner.to_string()));
        }
        self.odometry.restore(known, &read(&self.files[0])?, &name(&self.files[0]));
        let scans = state.values::<u64>("keyframe_scans", &[k])?.to_vec();
        let mut keyframes = Vec::new();
        for (scan, pose) in scans.into_iter().zip(poses("keyframe_poses", k)?) {
            let scan = scan as usize;
            if scan >= n {
                return Err(invalid("keyframe_scans", format!("scans below {n}"), scan.to_string()));
            }
            // With normals, as in the fit of the map.
            keyframes.push(Keyframe { scan, frame: self.frame(scan)?.with_normals(), pose });
        }
        let count = count as usize;
        self.odometry.mapper_mut().restore(MapState { surfels, owners, keyframes, finished: complete, count });
        self.odometry.refer()?;
        let fitness = state.values::<f64>("fitness", &[n])?;
        let flags = state.values::<u8>("flags", &[n])?;
        let remarks = state.metadata.get("remarks").map_or("", String::as_str).split('\n');
        let remarks = remarks.map(String::from).chain(std::iter::repeat(String::new()));
        let records = fitness.iter().zip(flags).zip(remarks);
        self.records = records
            .map(|((fitness, flags), remark)| ScanRecord {
                fitness: *fitness,
                remark,
                lost: flags & 1 != 0,
                keyframe: flags & 2 != 0,
            })
            .collect();
        Ok(())
    }

    fn rhythm(&self) -> Rhythm {
        Rhythm { log: Log::Every(1), save: Save::Seconds(20.0) }
    }
}

/// All maps of a state: the finished ones, and last the one under way.
pub(crate) fn maps_of(state: &Tensors) -> weaver_io::Result<Vec<Surfels<f32>>> {
    let finished = state.values::<u64>("counts", &[4])?[3] as usize;
    (0..=finished).map(|i| map_of(state, i)).collect()
}

/// A map of a state.
fn map_of(state: &Tensors, i: usize) -> weaver_io::Result<Surfels<f32>> {
    let n = state.get(&format!("map.{i}.opacity_logits"))?.data.len();
    let column = |name: &str, numbers: usize| -> weaver_io::Result<Vec<f32>> {
        Ok(state.values::<f32>(&format!("map.{i}.{name}"), &[n, numbers])?.to_vec())
    };
    Ok(Surfels {
        centers: column("centers", 3)?,
        quats: column("quats", 4)?,
        log_scales: column("log_scales", 2)?,
        opacity_logits: state.values::<f32>(&format!("map.{i}.opacity_logits"), &[n])?.to_vec(),
    })
}

/// Numbers of a pose: translation, and the rotation by columns, for the same bits after reading.
const POSE: usize = 12;

fn pose_numbers(pose: &Pose) -> [f64; POSE] {
    let (t, r) = (pose.translation, pose.rotation.to_cols_array());
    std::array::from_fn(|i| if i < 3 { t[i] } else { r[i - 3] })
}

fn pose_of(x: &[f64]) -> Pose {
    Pose::new(weaver_geometry::glam::DMat3::from_cols_slice(&x[3..]), DVec3::from_slice(x))
}

/// The printed line of a scan's remark, in one form for all scans; `None` without a remark.
pub(crate) fn said(record: &ScanRecord, file: &str) -> Option<String> {
    let no_scan = Lost::NoScan.to_string();
    match (record.remark.as_str(), record.lost) {
        ("", _) => None,
        (remark, true) if remark.starts_with(file) || remark == no_scan => Some(format!("lost: {remark}")),
        (remark, true) => Some(format!("{file}: lost: {remark}")),
        (remark, false) if remark.starts_with(file) => Some(format!("ranges not used: {remark}")),
        (remark, false) => Some(format!("{file}: ranges not used: {remark}")),
    }
}
