//! Transforms of the meshes of a scene.

use super::document::{Document, Node};
use crate::gaussians::placement::Placement;
use crate::{Error, Result};
use std::path::Path;
use weaver_geometry::glam::{DMat4, DQuat, DVec3};

/// The meshes of a scene, each with its transform; `None` for the identity.
pub(super) fn placed(path: &Path, document: &Document) -> Result<Vec<(usize, Option<Placement>)>> {
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
                Placement::of(&to_world).ok_or_else(|| {
                    let found = format!("{:?}", to_world.to_cols_array_2d());
                    Error::invalid(path, &place, "a transform of positive scales, rotation and translation", found)
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
