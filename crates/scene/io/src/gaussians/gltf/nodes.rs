//! Transforms of the meshes of a scene.

use super::document::{Document, Node};
use crate::{Error, Result};
use std::path::Path;
use weaver_geometry::Similarity;
use weaver_geometry::glam::{DMat3, DMat4, DQuat, DVec3};

/// Largest difference from a similarity, in scales along axes and angles between them.
const TOLERANCE: f64 = 1e-4;

/// The meshes of a scene, each with its transform; `None` for the identity.
pub(super) fn placed(path: &Path, document: &Document) -> Result<Vec<(usize, Option<Similarity>)>> {
    if document.scenes.is_empty() {
        return Ok((0..document.meshes.len()).map(|mesh| (mesh, None)).collect());
    }
    let index = document.scene.unwrap_or(0);
    let Some(scene) = document.scenes.get(index) else {
        return Err(Error::invalid(path, "scene", format!("below {}", document.scenes.len()), index));
    };
    let mut open: Vec<(usize, DMat4)> = scene.nodes.iter().rev().map(|node| (*node, DMat4::IDENTITY)).collect();
    let (mut seen, mut placed) = (vec![false; document.nodes.len()], Vec::new());
    while let Some((index, parent)) = open.pop() {
        let place = format!("nodes[{index}]");
        let Some(node) = document.nodes.get(index) else {
            let expected = format!("fewer than {} nodes", document.nodes.len());
            return Err(Error::invalid(path, place, expected, "an index beyond"));
        };
        if std::mem::replace(&mut seen[index], true) {
            return Err(Error::invalid(path, place, "a node of one parent", "several"));
        }
        let to_world = parent * matrix(node);
        if let Some(mesh) = node.mesh {
            let to = (to_world != DMat4::IDENTITY).then(|| {
                similarity(&to_world).ok_or_else(|| {
                    let found = format!("{:?}", to_world.to_cols_array_2d());
                    Error::invalid(path, &place, "a transform of rotation, translation and one scale", found)
                })
            });
            placed.push((mesh, to.transpose()?));
        }
        open.extend(node.children.iter().rev().map(|child| (*child, to_world)));
    }
    Ok(placed)
}

fn matrix(node: &Node) -> DMat4 {
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(matrix);
    }
    let scale = node.scale.map_or(DVec3::ONE, DVec3::from);
    let rotation = node.rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_array(q).normalize());
    DMat4::from_scale_rotation_translation(scale, rotation, node.translation.map_or(DVec3::ZERO, DVec3::from))
}

fn similarity(matrix: &DMat4) -> Option<Similarity> {
    let linear = DMat3::from_mat4(*matrix);
    let scale = linear.determinant().cbrt();
    let rotation = linear * (1.0 / scale);
    let straight = (rotation.transpose() * rotation).abs_diff_eq(DMat3::IDENTITY, TOLERANCE);
    let affine = matrix.row(3).abs_diff_eq(DMat4::IDENTITY.row(3), TOLERANCE);
    let usable = scale > 0.0 && scale.is_finite() && matrix.is_finite();
    (usable && straight && affine).then_some(Similarity { scale, rotation, translation: matrix.w_axis.truncate() })
}
