//! 2Xplat's networks.

mod pyramid;
