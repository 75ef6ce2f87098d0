//! Errors of scans and settings.

/// Error of scans or settings.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A scan without usable points.
    #[error("{of}: expected points between {near} and {far} m, found none among {points}")]
    NoPoints {
        /// Name of the scan.
        of: String,
        /// Points in the file.
        points: usize,
        /// Least range, meters.
        near: f64,
        /// Largest range, meters.
        far: f64,
    },
    /// A scan that fills too few pixels.
    #[error("{of}: expected at least {least} pixels with a range, found {found}")]
    FewPixels {
        /// Name of the scan.
        of: String,
        /// Pixels.
        found: usize,
        /// Pixels needed.
        least: usize,
    },
    /// A cloud merged from several places.
    #[error(
        "{of}: expected a single scan; of its points with a neighbor within 0.1 degrees, {percent:.0} % differ from it by more than 1 m, as in \
         merged clouds: no range image can be made of it"
    )]
    NotOneScan {
        /// Name of the scan.
        of: String,
        /// Share of points with a neighbor at another range.
        percent: f64,
    },
    /// Invalid settings.
    #[error("{0}")]
    Settings(String),
    /// Too few scans.
    #[error("expected at least two scans, found {0}")]
    FewScans(usize),
    /// Another number of poses than scans.
    #[error("expected a pose for each of {scans} scans, found {poses}")]
    Poses {
        /// Number of scans.
        scans: usize,
        /// Number of poses.
        poses: usize,
    },
    /// Drawing failed.
    #[error(transparent)]
    Raster(#[from] weaver_surfel::RasterError),
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;
