//! What can be wrong with scans and settings.

/// Why scans or settings cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A scan without points that can be used.
    #[error("{of}: expected points between {near} and {far} m, found none among {points}")]
    NoPoints {
        /// Which scan.
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
        /// Which scan.
        of: String,
        /// Pixels.
        found: usize,
        /// Pixels needed.
        least: usize,
    },
    /// A cloud that was not seen from one place.
    #[error(
        "{of}: expected a single scan; of its points with a neighbor within 0.1 degrees, {percent:.0} % differ from it by more than 1 m, as in \
         merged clouds: no range image can be made of it"
    )]
    NotOneScan {
        /// Which scan.
        of: String,
        /// Share of points with a neighbor that differ from it.
        percent: f64,
    },
    /// Settings that make no sense.
    #[error("{0}")]
    Settings(String),
    /// Too few scans.
    #[error("expected at least two scans, found {0}")]
    FewScans(usize),
    /// Poses that do not fit the scans.
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
