//! Camera geometry on the tape.

pub mod code;
mod frame;
mod gauge;
mod harmonics;
mod plane_sweep;
mod projection;
mod rays;
mod relative;
mod rotation;
mod row_map;
mod unproject;

pub use code::{CameraVars, activate, cameras, cameras_with, encode};
pub use frame::{AverageFrame, average_frame};
pub use gauge::first_camera_gauge;
pub use harmonics::harmonics;
pub use plane_sweep::plane_sweep;
pub use projection::projections;
pub use rays::Rays;
pub use relative::relative_poses;
pub use rotation::{quaternion_product, rotation_from_xyzw, xyzw_from_rotation};
pub use unproject::unproject;
