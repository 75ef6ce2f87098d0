//! Scans of lidars, and the poses that they were taken at.

mod pcd;
pub(crate) mod poses;
pub(crate) mod scan;
