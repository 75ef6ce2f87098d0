//! A differentiable CPU rasteriser of 3-D Gaussians with gradients for every parameter and the camera.
