//! Methods of compression behind one trait.

use crate::{CompressionError, Training};
use std::fmt::Debug;
use weaver_compress::Pictures;
use weaver_scene::{Gaussians, Photo};

/// A scene to compress, with the training data of a method.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// The scene.
    pub gaussians: &'a Gaussians,
    /// Cameras for measuring importance and steps, and for training. Judging pictures are of other cameras.
    pub pictures: Pictures<'a>,
    /// Photos to train with; without any, pictures of the scene itself.
    pub photos: &'a [Photo],
    /// Training steps in place of 5000 in a method's paper; other numbers of steps in proportion. Nothing is trained at
    /// 0.
    pub steps: usize,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// A way to compress a scene, with its constants.
///
/// ```
/// use weaver_compress::Pictures;
/// use weaver_compression::{METHODS, Task};
/// use weaver_scene::{Gaussians, orbit};
///
/// let gaussians = Gaussians {
///     means: vec![[0.0, 0.0, 2.0]],
///     log_scales: vec![[-1.0, -1.5, -2.0]],
///     quats: vec![[1.0, 0.0, 0.0, 0.0]],
///     opacity_logits: vec![0.5],
///     sh: vec![0.1, 0.2, 0.3],
///     degree: 0,
/// };
/// let cameras = orbit(&gaussians, 3, [32, 32]).unwrap();
/// let pictures = Pictures { cameras: &cameras, background: [1.0; 3], settings: Default::default() };
/// let task = Task { gaussians: &gaussians, pictures, photos: &[], steps: 0, seed: 0 };
/// let family = METHODS.iter().find(|family| family.name == "half").unwrap();
/// let half = &(family.points)()[0];
/// let bytes = half.method.encode(&Task { ..task })?;
/// assert_eq!(half.method.decode(&bytes)?.len(), 1);
/// # Ok::<(), weaver_compression::CompressionError>(())
/// ```
pub trait Method: Debug {
    /// Steps of [training](Self::begin) for `of` in place of a paper's 5000; 0 without training.
    fn steps(&self, of: usize) -> usize {
        let _ = of;
        0
    }

    /// Begins to encode a scene.
    ///
    /// # Errors
    /// A scene that cannot be encoded, drawn or trained.
    fn begin<'a>(&'a self, task: &'a Task<'a>) -> Result<Box<dyn Training + 'a>, CompressionError>;

    /// The bytes of a scene: all steps, one after the other.
    ///
    /// # Errors
    /// A scene that cannot be encoded, drawn or trained.
    fn encode(&self, task: &Task<'_>) -> Result<Vec<u8>, CompressionError> {
        let mut training = self.begin(task)?;
        for _ in 0..training.steps()[1] {
            training.step()?;
        }
        training.finish()
    }

    /// The scene from the bytes of [`encode`](Self::encode) alone.
    ///
    /// # Errors
    /// Foreign, incomplete or changed bytes.
    fn decode(&self, bytes: &[u8]) -> Result<Gaussians, CompressionError>;
}

/// A method with certain constants: a point of its curve of quality by bytes.
#[derive(Debug)]
pub struct Point {
    /// The constants in short; empty for a method with a single point.
    pub setting: String,
    /// The method.
    pub method: Box<dyn Method>,
}
