//! Writes images and gradients to a file, for comparison with other implementations.

use super::raster::Frame;
use std::path::Path;
use weaver_command::Failure;
use weaver_io::safetensors::Tensors;

/// Writes `out.image`, `out.alpha`, `out.depth` and the gradient `grad.<input>` of every input of a workload file, in
/// the input's shape, with zeros for the constants of matrices.
pub fn write(path: &Path, frame: Frame<'_>) -> Result<(), Failure> {
    let workload = frame.workload;
    let (n, size) = (workload.len(), [workload.camera.height, workload.camera.width]);
    let mut tensors = Tensors::default();
    tensors.insert("out.image", &[size[0], size[1], 3], frame.image);
    tensors.insert("out.alpha", &size, frame.alpha);
    if let Some(depth) = frame.depth {
        tensors.insert("out.depth", &size, depth);
    }
    if let Some(gradients) = frame.gradients {
        tensors.insert("grad.means", &[n, 3], gradients.means);
        tensors.insert("grad.quats", &[n, 4], gradients.quats);
        tensors.insert("grad.scales", &[n, 3], gradients.scales);
        tensors.insert("grad.opacities", &[n], gradients.opacities);
        match workload.degree() {
            Some(degree) => tensors.insert("grad.sh", &[n, (degree + 1) * (degree + 1), 3], gradients.colors),
            None => tensors.insert("grad.colors", &[n, 3], gradients.colors),
        }
        tensors.insert("grad.viewmat", &[4, 4], [gradients.viewmat, vec![0.0; 4]].concat());
        let [fx, fy, cx, cy] = gradients.intrinsics;
        tensors.insert("grad.K", &[3, 3], vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 0.0]);
        tensors.insert("grad.background", &[3], gradients.background);
    }
    Ok(tensors.write(path)?)
}
