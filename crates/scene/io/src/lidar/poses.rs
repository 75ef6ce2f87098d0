//! Trajectories as KITTI and TUM write them.

use crate::{Error, Result, atomic_write, read_text};
use std::path::Path;
use weaver_geometry::Pose;
use weaver_geometry::glam::DVec3;

/// The form of a trajectory's lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrajectoryFormat {
    /// Twelve numbers a line: the rows of the rotation, each with its part of the translation.
    Kitti,
    /// Eight numbers a line: time, translation, quaternion xyzw.
    Tum,
}

/// Poses of sensors, each from the sensor to the world.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrajectoryFile {
    /// Poses.
    pub poses: Vec<Pose>,
    /// Their times, seconds; none in a file without.
    pub times: Vec<f64>,
}

impl TrajectoryFile {
    /// Reads a trajectory, KITTI's or TUM's by the count of numbers in a line. Lines that begin with `#` are comments.
    ///
    /// The first word of TUM's lines may be a name; the file then has no times, as KITTI's.
    ///
    /// # Errors
    /// When a line is neither, a pose is not rigid, or times do not grow.
    ///
    /// ```
    /// let folder = tempfile::tempdir().unwrap();
    /// let path = folder.path().join("poses.txt");
    /// std::fs::write(&path, "# time x y z qx qy qz qw\n0.5 1 2 3 0 0 0 1\n").unwrap();
    /// let file = weaver_io::TrajectoryFile::read(&path)?;
    /// assert_eq!((file.times[0], file.poses[0].translation.z), (0.5, 3.0));
    /// # Ok::<(), weaver_io::Error>(())
    /// ```
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let text = read_text(path)?;
        let mut file = Self::default();
        let mut timed = true;
        for (number, line) in text.lines().enumerate() {
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let invalid =
                |expected: &str, found: String| Error::invalid(path, format!("line {}", number + 1), expected, found);
            let words: Vec<&str> = line.split_whitespace().collect();
            let numbers = |words: &[&str]| -> Result<Vec<f64>> {
                let number = |word: &&str| word.parse().ok().filter(|x: &f64| x.is_finite());
                words.iter().map(|w| number(w).ok_or_else(|| invalid("finite numbers", format!("{w:?}")))).collect()
            };
            let (time, pose) = match words.len() {
                12 => {
                    let x = numbers(&words)?;
                    let rows = [0, 4, 8].map(|at| [x[at], x[at + 1], x[at + 2], x[at + 3]]);
                    let pose = Pose::from_rows(&rows);
                    (None, pose.map_err(|error| invalid("the rows of a rigid motion", error.to_string()))?)
                }
                8 => {
                    let x = numbers(&words[1..])?;
                    let quat = [x[6], x[3], x[4], x[5]];
                    let length = quat.iter().map(|q| q * q).sum::<f64>().sqrt();
                    if (length - 1.0).abs() > 1e-2 {
                        return Err(invalid("a quaternion of length 1", format!("length {length}")));
                    }
                    (words[0].parse::<f64>().ok(), Pose::from_wxyz(quat, DVec3::from_slice(&x[..3])))
                }
                other => return Err(invalid("12 numbers (KITTI) or 8 (TUM)", format!("{other} words"))),
            };
            timed &= time.is_some();
            if let Some(time) = time.filter(|_| timed) {
                if !time.is_finite() || file.times.last().is_some_and(|last| *last >= time) {
                    return Err(invalid("times that grow", words[0].into()));
                }
                file.times.push(time);
            }
            file.poses.push(pose);
        }
        if !timed {
            file.times.clear();
        }
        match file.poses.is_empty() {
            true => Err(Error::invalid(path, "poses", "at least one", "none")),
            false => Ok(file),
        }
    }

    /// Writes a trajectory.
    ///
    /// # Errors
    /// When TUM's format lacks a time for each pose, or the file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>, format: TrajectoryFormat) -> Result<()> {
        let path = path.as_ref();
        if format == TrajectoryFormat::Tum && self.times.len() != self.poses.len() {
            let expected = format!("{} times", self.poses.len());
            return Err(Error::invalid(path, "poses to write", expected, self.times.len()));
        }
        atomic_write(path, |w| {
            for (i, pose) in self.poses.iter().enumerate() {
                let numbers = match format {
                    TrajectoryFormat::Kitti => pose.rows().concat(),
                    TrajectoryFormat::Tum => {
                        let ([qw, qx, qy, qz], t) = (pose.wxyz(), pose.translation);
                        vec![self.times[i], t.x, t.y, t.z, qx, qy, qz, qw]
                    }
                };
                let words: Vec<String> = numbers.iter().map(f64::to_string).collect();
                writeln!(w, "{}", words.join(" "))?;
            }
            Ok(())
        })
    }
}
