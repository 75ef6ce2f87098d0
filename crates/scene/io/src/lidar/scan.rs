//! Scans as files: KITTI's .bin, PLY, PCD and NPY.

use super::pcd::{self, TIMES};
use crate::files::file::read_bytes;
use crate::gaussians::ply::Table;
use crate::{Error, Npy, Result};
use std::path::Path;

/// Endings of the files that [`read_lidar_scan`] reads.
pub const LIDAR_FORMATS: [&str; 4] = ["bin", "ply", "pcd", "npy"];

/// The points of one sweep as in the file, including ones that are not finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LidarScan {
    /// Points `[P]`, meters, x forward, y left, z up.
    pub points: Vec<[f32; 3]>,
    /// When each point was measured, from 0 for the first to 1 for the last; empty where the file does not say.
    pub times: Vec<f32>,
}

impl LidarScan {
    /// A scan of columns; times of any unit and beginning.
    pub(crate) fn new(points: Vec<[f32; 3]>, times: Option<Vec<f64>>) -> Self {
        let finite = |times: &Vec<f64>| times.len() == points.len() && times.iter().all(|t| t.is_finite());
        let times = times.filter(finite).map_or(Vec::new(), |times| {
            let (low, high) = times.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(*t), b.max(*t)));
            // All at once is as good as not known.
            if high > low { times.iter().map(|t| ((t - low) / (high - low)) as f32).collect() } else { Vec::new() }
        });
        Self { points, times }
    }
}

/// Reads a scan: by the ending `.bin` (32-bit x y z intensity as KITTI's, or x y z), `.ply`, `.pcd` (ascii, binary,
/// binary_compressed) or `.npy` (`[P, 3]` or more columns).
///
/// Columns `time`, `t`, `timestamp` or `time_stamp` of PLY and PCD become times. A `.bin` whose size is a multiple of
/// 16 and of 12 bytes has four numbers a point if every fourth is between 0 and 255, and three else.
///
/// # Errors
/// When the file cannot be read, is malformed or has no points.
///
/// ```
/// let folder = tempfile::tempdir().unwrap();
/// let path = folder.path().join("scan.bin");
/// let numbers = [1.0_f32, 2.0, 3.0, 0.5];
/// std::fs::write(&path, numbers.map(f32::to_le_bytes).concat()).unwrap();
/// assert_eq!(weaver_io::read_lidar_scan(&path)?.points, [[1.0, 2.0, 3.0]]);
/// # Ok::<(), weaver_io::Error>(())
/// ```
pub fn read_lidar_scan(path: impl AsRef<Path>) -> Result<LidarScan> {
    let path = path.as_ref();
    let ending = path.extension().map_or(String::new(), |e| e.to_string_lossy().to_lowercase());
    let scan = match ending.as_str() {
        "bin" => numbers(path, &read_bytes(path)?)?,
        "ply" => ply(path)?,
        "pcd" => {
            let (points, times) = pcd::decode(path, &read_bytes(path)?)?;
            LidarScan::new(points, times)
        }
        "npy" => npy(path)?,
        _ => {
            let expected = "a scan that ends in .bin, .ply, .pcd or .npy";
            return Err(Error::invalid(path, "file name", expected, format!(".{ending}")));
        }
    };
    match scan.points.is_empty() {
        true => Err(Error::invalid(path, "points", "at least one", "none")),
        false => Ok(scan),
    }
}

/// Writes a scan as KITTI has them: 32-bit x y z intensity, with intensities of 0.
///
/// # Errors
/// When the file cannot be written.
pub fn write_lidar_scan(path: impl AsRef<Path>, points: &[[f32; 3]]) -> Result<()> {
    crate::atomic_write(path, |w| {
        points.iter().try_for_each(|[x, y, z]| w.write_all(&[*x, *y, *z, 0.0].map(f32::to_le_bytes).concat()))
    })
}

fn numbers(path: &Path, bytes: &[u8]) -> Result<LidarScan> {
    let number = |at: usize| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let intensities = || (12..bytes.len()).step_by(16).all(|at| (0.0..=255.0).contains(&number(at)));
    let stride = match (bytes.len() % 16, bytes.len() % 12) {
        (0, 0) if !intensities() => 12,
        (0, _) => 16,
        (_, 0) => 12,
        _ => {
            let found = format!("{} bytes", bytes.len());
            return Err(Error::invalid(path, "size", "a multiple of 16 bytes (x y z intensity) or 12 (x y z)", found));
        }
    };
    let points = (0..bytes.len()).step_by(stride).map(|at| [number(at), number(at + 4), number(at + 8)]);
    Ok(LidarScan::new(points.collect(), None))
}

fn ply(path: &Path) -> Result<LidarScan> {
    let table = Table::read(path, &read_bytes(path)?)?;
    let [x, y, z] = [table.column("x")?, table.column("y")?, table.column("z")?];
    let time = TIMES.iter().find_map(|name| table.column(name).ok());
    let rows = || (0..table.rows).map(|row| table.row(row));
    let times = time.map(|t| rows().map(|row| f64::from(row[t])).collect());
    Ok(LidarScan::new(rows().map(|row| [row[x], row[y], row[z]]).collect(), times))
}

fn npy(path: &Path) -> Result<LidarScan> {
    let array = Npy::open(path)?;
    let shape = array.shape();
    let Some(columns) = shape.get(1).copied().filter(|columns| shape.len() == 2 && *columns >= 3) else {
        return Err(Error::invalid(path, "shape", "[points, 3] or more columns", format!("{:?}", array.shape())));
    };
    let rows = array.numbers(0..array.len());
    Ok(LidarScan::new(rows.chunks_exact(columns).map(|row| [row[0], row[1], row[2]]).collect(), None))
}
