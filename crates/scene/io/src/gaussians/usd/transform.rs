//! Transforms of prims.

use super::document::Prim;
use crate::{Error, Result};
use std::path::Path;
use weaver_geometry::glam::{DMat4, DQuat, DVec3};

/// From the axes of a prim to the world, when `parent` leads there from the axes of the prim around it.
pub(super) fn to_world(path: &Path, prim: &Prim, world: &DMat4, parent: &DMat4) -> Result<DMat4> {
    let mut matrix = *parent;
    for name in &prim.order {
        if name == "!resetXformStack!" {
            matrix = *world;
            continue;
        }
        let inverse = name.strip_prefix("!invert!");
        let name = inverse.unwrap_or(name);
        let Some(numbers) = prim.transforms.get(name) else {
            return Err(Error::invalid(
                path,
                &prim.path,
                format!("a value of {name}, which xformOpOrder names"),
                "none",
            ));
        };
        let Some(step) = step(name, numbers) else {
            let expected = "transforms that translate, rotate, scale, orient or have a matrix";
            return Err(Error::invalid(path, &prim.path, expected, format!("{name} of {} numbers", numbers.len())));
        };
        matrix *= if inverse.is_some() { step.inverse() } else { step };
    }
    Ok(matrix)
}

fn step(name: &str, numbers: &[f64]) -> Option<DMat4> {
    let kind = name.split(':').nth(1)?;
    Some(match (kind, numbers) {
        ("translate", &[x, y, z]) => DMat4::from_translation(DVec3::new(x, y, z)),
        ("scale", &[x, y, z]) => DMat4::from_scale(DVec3::new(x, y, z)),
        ("orient", &[w, x, y, z]) => DMat4::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()),
        // Rows there, which multiply from the left, are columns here.
        ("transform", numbers) => DMat4::from_cols_array(numbers.try_into().ok()?),
        _ => rotation(kind.strip_prefix("rotate")?, numbers)?,
    })
}

/// A rotation by angles in degrees about axes: about the first one first.
fn rotation(axes: &str, degrees: &[f64]) -> Option<DMat4> {
    let about = |axis: &str, degrees: f64| {
        Some(match axis {
            "X" => DMat4::from_rotation_x(degrees.to_radians()),
            "Y" => DMat4::from_rotation_y(degrees.to_radians()),
            "Z" => DMat4::from_rotation_z(degrees.to_radians()),
            _ => return None,
        })
    };
    match *degrees {
        [degrees] => about(axes, degrees),
        [x, y, z] if axes.len() == 3 => {
            let angle = |axis| [("X", x), ("Y", y), ("Z", z)].into_iter().find(|(name, _)| *name == axis);
            (0..3).try_fold(DMat4::IDENTITY, |done, i| {
                let (axis, degrees) = angle(axes.get(i..=i)?)?;
                Some(about(axis, degrees)? * done)
            })
        }
        _ => None,
    }
}
