//! Gaussians of the prims of a document.

use super::document::{Document, Prim};
use super::{PRIM, transform, turn};
use crate::gaussians::fields::check_rows;
use crate::gaussians::placement::Placement;
use crate::{Error, Result};
use std::path::Path;
use weaver_geometry::glam::{DMat4, DQuat, DVec3};
use weaver_geometry::sh;
use weaver_scene::{Gaussians, forms};

/// The degree of a prim that does not name one.
const DEGREE: f32 = 3.0;

/// All Gaussians, one prim after the other.
pub(super) fn gaussians(path: &Path, document: Document) -> Result<Gaussians> {
    let Document { z_is_up, meters_per_unit, prims } = document;
    let up = if z_is_up { DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2) } else { DQuat::IDENTITY };
    let world = DMat4::from_scale_rotation_translation(DVec3::splat(meters_per_unit), up, DVec3::ZERO);
    let (mut parts, mut kinds) = (Vec::new(), Vec::new());
    let mut open: Vec<(Prim, DMat4)> = prims.into_iter().rev().map(|prim| (prim, world)).collect();
    while let Some((mut prim, parent)) = open.pop() {
        let to_world = transform::to_world(path, &prim, &world, &parent)?;
        open.extend(std::mem::take(&mut prim.children).into_iter().rev().map(|child| (child, to_world)));
        if prim.kind == PRIM {
            parts.push(placed(path, prim, &to_world)?);
        } else {
            kinds.push(prim.kind);
        }
    }
    if parts.is_empty() {
        kinds.sort_unstable();
        kinds.dedup();
        let expected = format!("a prim of type {PRIM} in this file (others that it refers to are not opened)");
        return Err(Error::invalid(path, "prims", expected, format!("types {kinds:?}")));
    }
    let mut all = if parts.len() == 1 { parts.remove(0) } else { Gaussians::joined(&parts) };
    turn(&mut all);
    check_rows(path, &all, 0)?;
    Ok(all)
}

fn placed(path: &Path, mut prim: Prim, to_world: &DMat4) -> Result<Gaussians> {
    let gaussians = of_prim(path, &mut prim)?;
    if *to_world == DMat4::IDENTITY {
        return Ok(gaussians);
    }
    let placement = Placement::of(to_world).ok_or_else(|| {
        let found = format!("{:?}", to_world.to_cols_array_2d());
        Error::invalid(path, &prim.path, "a transform of positive scales, rotation and translation", found)
    })?;
    Ok(placement.apply(&gaussians))
}

/// Gaussians in the axes of their prim.
fn of_prim(path: &Path, prim: &mut Prim) -> Result<Gaussians> {
    let degree = prim.attributes.get("radiance:sphericalHarmonicsDegree").map_or(DEGREE, |degree| degree[0]);
    if degree.fract() != 0.0 || !(0.0..=sh::MAX_DEGREE as f32).contains(&degree) {
        let place = format!("{}.radiance:sphericalHarmonicsDegree", prim.path);
        return Err(Error::invalid(path, place, format!("a degree of 0 to {}", sh::MAX_DEGREE), degree));
    }
    let positions = numbers(prim, "positions").unwrap_or_default();
    let means = positions.as_chunks::<3>().0.to_vec();
    let n = means.len();
    let mut degree = degree as usize;
    let sh = numbers(prim, "radiance:sphericalHarmonicsCoefficients").unwrap_or_else(|| {
        degree = if n > 0 { 0 } else { degree };
        vec![forms::harmonic(0.5); 3 * n]
    });
    check_length(path, prim, "radiance:sphericalHarmonicsCoefficients", [sh.len(), 3 * n * sh::coefficients(degree)])?;
    let scales = column(path, prim, "scales", vec![[1.0; 3]; n])?;
    let opacities = column(path, prim, "opacities", vec![[1.0]; n])?;
    let refused = |name: &str, expected, i, found: &[f32]| {
        Err(Error::invalid(path, format!("{}.{name}", prim.path), expected, format!("{found:?} at {i}")))
    };
    if let Some(i) = scales.iter().position(|scale| !scale.iter().all(|x| (0.0..=f32::MAX).contains(x))) {
        return refused("scales", "finite scales of 0 and more", i, &scales[i]);
    }
    if let Some(i) = opacities.iter().position(|[opacity]| !(0.0..=1.0).contains(opacity)) {
        return refused("opacities", "opacities from 0 to 1", i, &opacities[i]);
    }
    Ok(Gaussians {
        means,
        log_scales: scales.iter().map(|s| s.map(|s| s.max(f32::MIN_POSITIVE).ln())).collect(),
        quats: column(path, prim, "orientations", vec![[1.0, 0.0, 0.0, 0.0]; n])?,
        opacity_logits: opacities.iter().map(|[opacity]| forms::opacity_logit(*opacity)).collect(),
        sh,
        degree,
    })
}

/// The numbers of an attribute, of floats rather than of halves.
fn numbers(prim: &mut Prim, name: &str) -> Option<Vec<f32>> {
    let names = [name.to_string(), format!("{name}h")];
    names.iter().filter_map(|name| prim.attributes.remove(name)).find(|numbers| !numbers.is_empty())
}

/// An attribute of as many elements as it has by default, which stands for one that is not there.
fn column<const N: usize>(path: &Path, prim: &mut Prim, name: &str, default: Vec<[f32; N]>) -> Result<Vec<[f32; N]>> {
    let Some(numbers) = numbers(prim, name) else { return Ok(default) };
    check_length(path, prim, name, [numbers.len(), N * default.len()])?;
    Ok(numbers.as_chunks().0.to_vec())
}

fn check_length(path: &Path, prim: &Prim, name: &str, [found, expected]: [usize; 2]) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    let expected = format!("{expected} numbers, as many as its positions ask for");
    Err(Error::invalid(path, format!("{}.{name}", prim.path), expected, found))
}
