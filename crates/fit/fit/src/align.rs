//! Where a photo of a finished scene of Gaussians was taken: its camera descends through the rasterizer, the scene
//! stays.
//!
//! ```
//! use weaver_fit::align::{Method, Options, Photo, Scene, align, mean_square};
//! use weaver_geometry::{Camera, Intrinsics, Pose};
//! use weaver_scene::ActivatedGaussians;
//! use weaver_splat::{CpuRasterizer, RasterSettings, Workspace, render};
//!
//! // Four Gaussians of different colors, and a photo of them.
//! let gaussians = ActivatedGaussians {
//!     means: vec![-0.5, -0.4, 2.0, 0.5, -0.3, 2.5, -0.4, 0.4, 3.0, 0.5, 0.5, 2.2],
//!     scales: vec![0.3; 12],
//!     quats: [1.0, 0.0, 0.0, 0.0].repeat(4),
//!     opacities: vec![0.9; 4],
//!     sh: vec![1.0, 0.0, -1.0, 0.0, 1.0, 0.5, -1.0, 1.0, 0.0, 1.0, 1.0, -1.0],
//!     degree: 0,
//! };
//! let intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 24.0, cy: 18.0 };
//! let truth = Camera { pose: Pose::IDENTITY, intrinsics, width: 48, height: 36 };
//! let settings = RasterSettings::default();
//! let pixels = render(&gaussians, &[truth], [0.0; 3], &settings, &mut Workspace::new())?.concat();
//!
//! // A guess that is off by three hundredths of the depth.
//! let guess = Camera { pose: Pose { translation: [0.06, -0.04, 0.03].into(), ..Pose::IDENTITY }, ..truth };
//! let scene = Scene { gaussians: gaussians.as_slices(), background: [0.0; 3], settings, unit: 3.0 };
//! let photo = Photo { pixels: &pixels, mask: None, camera: guess };
//! let aligned = align(&CpuRasterizer, &scene, &[photo], &Options::of(Method::Own), mean_square)?;
//! assert!(aligned[0].camera.pose.translation.length() < 0.01, "{:?}", aligned[0].camera);
//! # Ok::<(), weaver_fit::align::AlignError>(())
//! ```
//!
//! - [`align()`] finds the cameras of photos from first guesses, on slices, with any
//!   [`Rasterizer`](weaver_splat::Rasterizer).
//! - [`Method`]: ours (steps in units of the depth that a camera sees, small and blurred photos first), NoPoSplat's,
//!   2Xplat's.
//! - Any loss on slices: one of [`AlignLoss`], such as [`mean_square`] or the loss of a fit
//!   ([`Photometric`](weaver_losses::Photometric)), which finds more cameras. Masks leave pixels out. Focal lengths
//!   descend as well if asked to.
//! - [`Outcome`] tells why a guess stands where nothing better was found.
//! - [`Descent`], of weaver-pose, is the bare descent of one camera under gradients of anybody's loss.
//!
//! A photo that was aligned has been looked at: the gain of its render belongs beside the figures without, never in
//! their place.
//!
//! Sources: NoPoSplat (Ye et al., arXiv 2410.24207), 2Xplat (Jeong et al., arXiv 2603.21064), both of which align poses
//! before they judge held-out views.

mod descend;
mod drawing;
mod error;
mod loss;

pub use descend::{Aligned, Options, Outcome, align};
pub use drawing::{Photo, Scene, mean_square, unit};
pub use error::AlignError;
pub use loss::AlignLoss;
pub use weaver_pose::descent::{Descent, Method};
