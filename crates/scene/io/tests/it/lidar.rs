//! Scans and trajectories.

use proptest::prelude::*;
use std::path::PathBuf;
use weaver_geometry::glam::DVec3;
use weaver_geometry::{Pose, so3};
use weaver_io::{TrajectoryFile, TrajectoryFormat, read_lidar_scan, write_lidar_scan, write_npy};

fn file(name: &str, content: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    (folder, path)
}

fn bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn message(name: &str, content: impl AsRef<[u8]>) -> String {
    let (_folder, path) = file(name, content);
    read_lidar_scan(path).unwrap_err().to_string()
}

const POINTS: [[f32; 3]; 4] = [[1.0, -2.0, 3.0], [4.0, 5.0, -6.0], [-7.0, 8.0, 9.0], [0.25, 0.5, f32::INFINITY]];

#[test]
fn bin_of_three_and_of_four_numbers() {
    let (folder, path) = file("a.bin", bytes(POINTS.as_flattened()));
    assert_eq!(read_lidar_scan(&path).unwrap().points, POINTS);
    // Twelve numbers are four points of three, or three of four; intensities decide.
    let path = folder.path().join("b.bin");
    write_lidar_scan(&path, &POINTS[..3]).unwrap();
    assert_eq!(read_lidar_scan(&path).unwrap().points, POINTS[..3]);
    assert!(message("c.bin", [0; 20]).contains("multiple of 16 bytes (x y z intensity) or 12 (x y z), found 20 bytes"));
    assert!(message("c.bin", []).ends_with("points: expected at least one, found none"));
    assert!(message("c.txt", []).contains(".bin, .ply, .pcd or .npy"));
}

#[test]
fn ply_and_npy() {
    let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty double t\nend_header\n1 2 3 100\n4 5 6 300\n";
    let (folder, path) = file("a.ply", text);
    let scan = read_lidar_scan(path).unwrap();
    assert_eq!((scan.points, scan.times), (vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], vec![0.0, 1.0]));
    let path = folder.path().join("a.npy");
    write_npy(&path, &[2, 4], &[1.0, 2.0, 3.0, 9.0, 4.0, 5.0, 6.0, 9.0]).unwrap();
    assert_eq!(read_lidar_scan(&path).unwrap().points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    write_npy(&path, &[2, 2], &[0.0; 4]).unwrap();
    assert!(read_lidar_scan(&path).unwrap_err().to_string().contains("[points, 3] or more columns, found [2, 2]"));
}

fn pcd(points: usize, data: &str) -> Vec<u8> {
    let header = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z i t\nSIZE 4 4 4 1 4\nTYPE F F F U U\nCOUNT 1 1 1 2 1\n";
    format!("{header}WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n").into_bytes()
}

#[test]
fn pcd_of_all_kinds() {
    let rows: Vec<Vec<u8>> = (0..3_u32)
        .map(|i| [bytes(&POINTS[i as usize]), vec![7, 7], (100 + 50 * i).to_le_bytes().to_vec()].concat())
        .collect();
    let columns: Vec<u8> = [0..4, 4..8, 8..12, 12..14, 14..18]
        .into_iter()
        .flat_map(|part| rows.iter().flat_map(move |row| row[part.clone()].to_vec()))
        .collect();
    // Runs of at most 32 bytes; the last two bytes again as a copy of those that are two back would need a match.
    let stream: Vec<u8> =
        columns.chunks(32).flat_map(|run| [vec![run.len() as u8 - 1], run.to_vec()].concat()).collect();
    let sizes = [stream.len() as u32, columns.len() as u32].map(u32::to_le_bytes).concat();
    let text = "1 -2 3 7 7 100\n4 5 -6 7 7 150\n-7 8 9 7 7 200\n";
    for content in [
        [pcd(3, "binary"), rows.concat()].concat(),
        [pcd(3, "ascii"), text.into()].concat(),
        [pcd(3, "binary_compressed"), sizes, stream].concat(),
    ] {
        let (_folder, path) = file("a.pcd", content);
        let scan = read_lidar_scan(path).unwrap();
        assert_eq!((scan.points, scan.times), (POINTS[..3].to_vec(), vec![0.0, 0.5, 1.0]));
    }
}

#[test]
fn copies_of_lzf_repeat() {
    let header = "FIELDS x y z\nSIZE 1 1 1\nTYPE U U U\nPOINTS 4\nDATA binary_compressed\n";
    // One byte, then eleven more of the same: a copy of length 7 + 2 + 2 from one back.
    let stream = [0, 5, 7 << 5, 2, 0];
    let sizes = [stream.len() as u32, 12].map(u32::to_le_bytes).concat();
    let (_folder, path) = file("a.pcd", [header.as_bytes(), &sizes, &stream].concat());
    assert_eq!(read_lidar_scan(path).unwrap().points, [[5.0; 3]; 4]);
}

#[test]
fn broken_pcd_is_refused() {
    assert!(message("a.pcd", "FIELDS x y z\n").contains("a line beginning with DATA"));
    assert!(message("a.pcd", [pcd(1000, "binary"), vec![0; 18]].concat()).contains("18000 bytes of points, found 18"));
    assert!(message("a.pcd", pcd(usize::MAX, "binary")).contains("fewer points"));
    assert!(message("a.pcd", pcd(2, "zip")).contains("ascii, binary or binary_compressed, found zip"));
    assert!(message("a.pcd", [pcd(1, "ascii"), b"1 2 x 4 5 6".to_vec()].concat()).contains("point 0, z"));
    let bomb = [4_u32, 18_000_000].map(u32::to_le_bytes).concat();
    assert!(
        message("a.pcd", [pcd(1_000_000, "binary_compressed"), bomb, vec![0; 4]].concat()).contains("become 18000000")
    );
}

proptest! {
    #[test]
    fn no_bytes_make_a_reader_panic(content in proptest::collection::vec(any::<u8>(), 0..300), cut in 0_usize..200) {
        let mut mutated = [pcd(3, "binary_compressed"), content.clone()].concat();
        mutated.truncate(mutated.len().saturating_sub(cut));
        for (name, content) in [("a.pcd", mutated), ("b.bin", content.clone()), ("c.ply", content)] {
            let (_folder, path) = file(name, content);
            let _ = read_lidar_scan(path);
        }
    }

    #[test]
    fn trajectories_come_back(turns in proptest::collection::vec(proptest::array::uniform6(-3.0_f64..3.0), 1..9)) {
        let poses: Vec<Pose> = turns
            .iter()
            .map(|x| Pose::new(so3::exp(DVec3::from_slice(&x[..3])), 10.0 * DVec3::from_slice(&x[3..])))
            .collect();
        let times = (0..poses.len()).map(|i| 0.1 * i as f64).collect();
        let file = TrajectoryFile { poses, times };
        let folder = tempfile::tempdir().unwrap();
        for (format, name) in [(TrajectoryFormat::Kitti, "k.txt"), (TrajectoryFormat::Tum, "t.txt")] {
            let path = folder.path().join(name);
            file.write(&path, format).unwrap();
            let read = TrajectoryFile::read(&path).unwrap();
            for (a, b) in read.poses.iter().zip(&file.poses) {
                prop_assert!((a.translation - b.translation).length() < 1e-12 && a.angle_to(b) < 1e-7);
            }
            if format == TrajectoryFormat::Tum {
                prop_assert_eq!(&read.times, &file.times);
            }
        }
    }
}

/// Poses of a file without times have none: neither KITTI's, nor those that have names in their place.
///
/// Promise of `what_is_undefined_is_not_given`.
#[test]
fn a_trajectory_without_times_has_none() {
    let times = |text: &str| {
        let (_folder, path) = file("poses.txt", text);
        TrajectoryFile::read(path).map(|file| (file.poses.len(), file.times)).unwrap()
    };
    assert_eq!(times("1 0 0 0 0 1 0 0 0 0 1 0\n"), (1, vec![]));
    assert_eq!(times("v0 0 0 0 0 0 0 1\nv1 0 0 0 0 0 0 1\n"), (2, vec![]));
    assert_eq!(times("3 0 0 0 0 0 0 1\n4 0 0 0 0 0 0 1\n"), (2, vec![3.0, 4.0]));
}

#[test]
fn broken_trajectories_are_refused() {
    let message = |text: &str| {
        let (_folder, path) = file("poses.txt", text);
        TrajectoryFile::read(path).unwrap_err().to_string()
    };
    assert!(message("").ends_with("poses: expected at least one, found none"));
    assert!(message("1 2 3\n").contains("line 1: expected 12 numbers (KITTI) or 8 (TUM), found 3 words"));
    assert!(message("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").contains("line 2: expected times that grow"));
    assert!(message("1 0 0 0 0 0 0 2\n").contains("a quaternion of length 1, found length 2"));
    assert!(message("2 0 0 0 0 1 0 0 0 0 1 0\n").contains("the rows of a rigid motion"));
    assert!(message("1 0 0 nan 0 0 0 1\n").contains("finite numbers"));
}

#[test]
fn surfaces_come_back_and_broken_ones_are_refused() {
    use weaver_io::ply::{read_triangles, write_triangles};
    let (vertices, triangles) =
        (vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]], vec![[0, 1, 2], [1, 3, 2]]);
    let (_folder, path) = file("a.ply", []);
    write_triangles(&path, &vertices, &[], &triangles).unwrap();
    assert_eq!(read_triangles(&path).unwrap(), (vertices.clone(), triangles.clone()));
    let colored = path.with_file_name("colored.ply");
    write_triangles(&colored, &vertices, &[[255, 0, 7]; 4], &triangles).unwrap();
    assert_eq!(read_triangles(&colored).unwrap(), (vertices.clone(), triangles));
    assert_eq!(weaver_io::ply::read_points(&colored).unwrap().colors, [[255, 0, 7]; 4]);
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() - 3]).unwrap();
    assert!(read_triangles(&path).unwrap_err().to_string().contains("as many lists as it says"));
    let text = |faces: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 1\n{faces}\n"
        )
    };
    std::fs::write(&path, text("4 0 1 3 2")).unwrap();
    assert_eq!(read_triangles(&path).unwrap(), (vertices, vec![[0, 1, 3], [0, 3, 2]]));
    std::fs::write(&path, text("3 0 1 9")).unwrap();
    assert!(read_triangles(&path).unwrap_err().to_string().contains("face 0: expected corners below 4, found 9"));
}
