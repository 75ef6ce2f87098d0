//! Text of Gaussians.

use crate::gaussians::blocks::Blocks;
use crate::gaussians::fields::{check_rows, unit};
use crate::{Error, Result};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;
use weaver_geometry::glam::{Mat3, Quat, Vec3};
use weaver_scene::{Gaussians, forms};

/// Standard deviations from a center to the end of the extent, where the schema's kernel has 99.7 % of its support.
const REACH: f32 = 3.0;

const HEAD: &str = r#"#usda 1.0
(
    defaultPrim = "Gaussians"
    doc = "Written by SplatWeaver"
    metersPerUnit = 1
    upAxis = "Y"
)

def ParticleField3DGaussianSplat "Gaussians"
{
    uniform token projectionModeHint = "perspective"
    uniform token sortingModeHint = "zDepth"
"#;

/// Adds the elements of one Gaussian to the text.
type Row = fn(&Gaussians, usize, &mut String);

/// The attributes of a Gaussian, in axes of USD.
const ATTRIBUTES: [(&str, Row); 5] = [
    ("point3f[] positions", |of, i, text| tuple(&of.means[i], text)),
    ("quatf[] orientations", |of, i, text| tuple(&unit(of.quats[i]), text)),
    ("float3[] scales", |of, i, text| tuple(&of.log_scales[i].map(f32::exp), text)),
    ("float[] opacities", |of, i, text| number(forms::opacity(of.opacity_logits[i]), text)),
    ("float3[] radiance:sphericalHarmonicsCoefficients", |of, i, text| {
        let width = 3 * of.coefficients();
        for (k, rgb) in of.sh[i * width..][..width].as_chunks::<3>().0.iter().enumerate() {
            text.push_str(if k > 0 { ", " } else { "" });
            tuple(rgb, text);
        }
    }),
];

/// Writes the whole text, a pass over all Gaussians for each attribute.
pub(super) fn text(path: &Path, gaussians: &dyn Blocks, extent: &[[f32; 3]; 2], w: &mut dyn Write) -> Result<()> {
    let degree = gaussians.degree();
    let mut text =
        format!("{HEAD}    uniform int radiance:sphericalHarmonicsDegree = {degree}\n    float3[] extent = [");
    tuple(&extent[0], &mut text);
    text.push_str(", ");
    tuple(&extent[1], &mut text);
    text.push_str("]\n");
    for (name, row) in ATTRIBUTES {
        write!(text, "    {name} = [").expect("a string grows");
        for rows in gaussians.blocks() {
            let mut block = gaussians.block(rows.clone())?.into_owned();
            super::turn(&mut block);
            for i in 0..block.len() {
                text.push_str(if rows.start + i > 0 { ",\n" } else { "" });
                row(&block, i, &mut text);
            }
            w.write_all(text.as_bytes()).map_err(Error::io(path))?;
            text.clear();
        }
        text.push_str("]\n");
    }
    text.push_str("}\n");
    w.write_all(text.as_bytes()).map_err(Error::io(path))
}

fn tuple(numbers: &[f32], text: &mut String) {
    for (i, x) in numbers.iter().enumerate() {
        text.push_str(if i > 0 { ", " } else { "(" });
        number(*x, text);
    }
    text.push(')');
}

/// The shortest decimal that is read as the same number.
fn number(x: f32, text: &mut String) {
    write!(text, "{x:?}").expect("a string grows");
}

/// The corners of the box around all Gaussians to their reach. Values are checked on the way.
pub(super) fn extent(path: &Path, gaussians: &dyn Blocks) -> Result<[[f32; 3]; 2]> {
    let (mut least, mut most) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for rows in gaussians.blocks() {
        let mut block = gaussians.block(rows.clone())?.into_owned();
        check_rows(path, &block, rows.start)?;
        super::turn(&mut block);
        for i in 0..block.len() {
            let [w, x, y, z] = unit(block.quats[i]);
            let axes = Mat3::from_quat(Quat::from_xyzw(x, y, z, w))
                * Mat3::from_diagonal(Vec3::from(block.log_scales[i].map(f32::exp)));
            let reach = REACH * Vec3::from_array([0, 1, 2].map(|axis| axes.row(axis).length()));
            let mean = Vec3::from(block.means[i]);
            (least, most) = (least.min(mean - reach), most.max(mean + reach));
        }
    }
    Ok(if least.is_finite() && most.is_finite() { [least.to_array(), most.to_array()] } else { [[0.0; 3]; 2] })
}
