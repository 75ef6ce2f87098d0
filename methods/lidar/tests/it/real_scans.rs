//! Fragments of Newer College and KITTI, if present.

use std::path::{Path, PathBuf};
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;
use weaver_lidar::{
    GeometricSettings, Lost, MapSettings, Odometry, PatchTree, Scan, SurfelCamera, TrackSettings, register,
    trajectory_errors,
};

fn data(name: &str) -> Option<PathBuf> {
    let named = std::env::var_os("WEAVER_SHARED").map(PathBuf::from);
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let path = named.unwrap_or(above).join("data").join(name);
    if !path.exists() {
        println!("skipped: no data ({name})");
        return None;
    }
    Some(path)
}

fn points(path: &Path) -> Vec<[f32; 3]> {
    let bytes = std::fs::read(path).unwrap();
    let number = |b: &[u8]| f32::from_le_bytes(b.try_into().unwrap());
    bytes.chunks_exact(12).map(|p| [number(&p[..4]), number(&p[4..8]), number(&p[8..])]).collect()
}

fn poses(folder: &Path) -> Vec<Pose> {
    let text = std::fs::read_to_string(folder.join("graph.txt")).unwrap();
    let line = |line: &str| {
        let x: Vec<f64> = line.split_whitespace().skip(1).map(|x| x.parse().unwrap()).collect();
        Pose::from_wxyz([x[6], x[3], x[4], x[5]], DVec3::from_slice(&x[..3]))
    };
    text.lines().filter(|l| l.split_whitespace().count() == 8).map(line).collect()
}

#[test]
fn newer_college_is_tracked() {
    let Some(folder) = data("lidar-newer01") else { return };
    let poses = poses(&folder);
    let scan = |i: usize| {
        let [mut all, edges] =
            ["planes", "edges"].map(|kind| points(&folder.join(format!("{kind}_{:06}.bin", 10 * i))));
        all.extend(edges);
        Scan::new(all)
    };
    let [low, high] = scan(0).elevations();
    let camera = SurfelCamera::spherical([1024, 128], [low - 0.009, high + 0.009]);
    let map = MapSettings { iterations: 60, density: 1.0, ..Default::default() };
    let mut odometry = Odometry::new(&camera, [1.0, 60.0], map, TrackSettings::default(), None).unwrap();
    for i in 0..5 {
        let tracked = odometry.add(&scan(i), "scan").unwrap();
        assert_eq!(tracked.lost, None);
    }
    let errors = trajectory_errors(odometry.poses(), &poses);
    assert!(errors.rpe < 0.025 && errors.ate < 0.02, "{errors:?}");
}

/// A scan of another place is lost by the small share of it that fits, scans of the next places are not.
///
/// Promise of `a_scan_of_which_little_fits_is_lost`.
#[test]
fn a_real_scan_of_another_place_is_lost() {
    let Some(folder) = data("lidar-newer01") else { return };
    let scan = |i: usize| Scan::new(points(&folder.join(format!("planes_{:06}.bin", 10 * i))));
    let [low, high] = scan(0).elevations();
    let camera = SurfelCamera::spherical([1024, 64], [low - 0.009, high + 0.009]);
    let map = MapSettings { iterations: 60, ..Default::default() };
    let lost = |order: [usize; 3]| {
        let mut odometry = Odometry::new(&camera, [1.0, 60.0], map.clone(), TrackSettings::default(), None).unwrap();
        order.map(|i| odometry.add(&scan(i), "scan").unwrap().lost)
    };
    assert_eq!(lost([0, 1, 2]), [None; 3]);
    let far = lost([0, 4, 1]);
    assert!(matches!(far, [None, Some(Lost::LittleFits(_)), None]), "{far:?}");
}

/// KITTI pairs are registered without a range image.
#[test]
fn kitti_pairs_are_registered() {
    let Some(folder) = data("lidar-kitti07") else { return };
    let poses = poses(&folder);
    let scans: Vec<Scan> = (0..5).map(|i| Scan::new(points(&folder.join(format!("{i:06}.bin"))))).collect();
    for scan in &scans {
        let reason = scan.check_single("cloud").unwrap_err().to_string();
        assert!(reason.contains("expected a single scan"), "{reason}");
    }
    let vectors =
        |scan: &Scan| -> Vec<DVec3> { scan.points.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect() };
    for (i, pair) in scans.windows(2).enumerate() {
        let truth = poses[i].inverse().compose(&poses[i + 1]);
        let off = Pose::new(weaver_geometry::so3::exp(DVec3::Z * 5.0_f64.to_radians()), DVec3::new(0.6, 0.8, 0.0));
        let tree = PatchTree::new(&vectors(&pair[0]));
        let settings = GeometricSettings { steps: 30, widened: 5.0, ..Default::default() };
        let found = register(&vectors(&pair[1]), &tree, &truth.compose(&off), &settings).unwrap();
        let error = truth.inverse().compose(&found.pose).translation.length();
        assert!(error < 0.06, "pair {i}: {error} m");
    }
}
