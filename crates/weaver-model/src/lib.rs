//! SplatWeaver put together: configuration, presets and the forward pass from photos to Gaussians.
