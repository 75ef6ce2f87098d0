//! USD: round trips, the schema's text, scenes of other layouts, and files that lie.

use crate::fixtures::assert_same;
use crate::formats::{gaussians, round_trip};
use proptest::prelude::*;
use std::io::Cursor;
use weaver_geometry::sh;
use weaver_io::{Drawing, open_scene, read_gaussians, write_blocks, write_gaussians};
use weaver_scene::{Gaussians, forms};
use zip::{CompressionMethod, ZipArchive};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(ProptestConfig::default().cases / 5))]

    #[test]
    fn usd_keeps_floats(gaussians in gaussians()) {
        let back = round_trip("a.usda", &gaussians);
        prop_assert_eq!((&back.means, &back.sh, back.degree), (&gaussians.means, &gaussians.sh, gaussians.degree));
        assert_same("a.usda", &back, &gaussians, 1e-5);
        prop_assert_eq!(round_trip("a.usdz", &gaussians), back);
    }
}

/// One Gaussian whose numbers have exact decimals.
fn one() -> Gaussians {
    Gaussians {
        means: vec![[1.0, 2.0, -3.5]],
        log_scales: vec![[0.0; 3]],
        quats: vec![[1.0, 0.0, 0.0, 0.0]],
        opacity_logits: vec![0.0],
        sh: vec![0.5, 0.25, -1.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
        degree: 1,
    }
}

/// The text that OpenUSD's schema asks for: half a turn about x negates y and z, and the harmonics of y and z.
#[test]
fn the_text_of_one_gaussian() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    write_gaussians(&path, &one()).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    for expected in [
        "#usda 1.0\n(\n    defaultPrim = \"Gaussians\"\n",
        "    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n\ndef ParticleField3DGaussianSplat \"Gaussians\"\n{\n",
        "    uniform int radiance:sphericalHarmonicsDegree = 1\n",
        "    float3[] extent = [(-2.0, -5.0, 0.5), (4.0, 1.0, 6.5)]\n",
        "    point3f[] positions = [(1.0, -2.0, 3.5)]\n",
        "    quatf[] orientations = [(0.0, -1.0, 0.0, -0.0)]\n",
        "    float3[] scales = [(1.0, 1.0, 1.0)]\n    float[] opacities = [0.5]\n",
        "Coefficients = [(0.5, 0.25, -1.0), (-1.0, -2.0, -3.0), (-4.0, -5.0, -6.0), (7.0, 8.0, 9.0)]\n}\n",
    ] {
        assert!(text.contains(expected), "{text} for {expected}");
    }
}

/// More than one block, from a file and whole.
#[test]
fn blocks_have_the_text_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let n = (1 << 14) + 5;
    let many = one().select(&vec![0; n]);
    let [source, whole, blocks] = ["a.ply", "a.usda", "b.usda"].map(|name| folder.path().join(name));
    write_gaussians(&source, &many).unwrap();
    write_gaussians(&whole, &many).unwrap();
    write_blocks(&blocks, &*open_scene(&source).unwrap().gaussians, Drawing::default()).unwrap();
    assert!(std::fs::read(&whole).unwrap() == std::fs::read(&blocks).unwrap());
    assert_eq!(read_gaussians(&blocks).unwrap().len(), n);
}

#[test]
fn packages_are_stored_and_aligned() {
    let folder = tempfile::tempdir().unwrap();
    let [text, package] = ["a.usda", "a.usdz"].map(|name| folder.path().join(name));
    write_gaussians(&text, &one()).unwrap();
    write_gaussians(&package, &one()).unwrap();
    let bytes = std::fs::read(&package).unwrap();
    let mut zip = ZipArchive::new(Cursor::new(&bytes)).unwrap();
    assert_eq!(zip.len(), 1);
    let mut file = zip.by_index(0).unwrap();
    let start = file.data_start() as usize;
    assert_eq!((file.name(), file.compression(), start % 64), ("scene.usda", CompressionMethod::Stored, 0));
    let mut content = Vec::new();
    std::io::copy(&mut file, &mut content).unwrap();
    assert!(content == std::fs::read(&text).unwrap());
    assert!(bytes[start..start + content.len()] == content);
}

/// A layer of centimeters whose up is +z, with what a reader has to pass over.
pub const LAYER: &str = r##"#usda 1.0
(
    """A text of several "lines",
    with { brackets."""
    customLayerData = {
        string made = "by # hand"
        dictionary more = {
            int n = 3
        }
    }
    metersPerUnit = 0.01
    subLayers = []
    upAxis = "Z"
)

# Nothing of these is drawn.
class ParticleField3DGaussianSplat "Model"
{
    point3f[] positions = [(9, 9, 9)]
}
over "Other"
{
    def ParticleField3DGaussianSplat "Of"
    {
        point3f[] positions = [(9, 9, 9)]
    }
}

def Xform "World" (
    kind = "component"
    prepend apiSchemas = ["SomeAPI"]
)
{
    custom rel other = </World/Mesh.points>
    rel many = [</A>, </B>]
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    double3 xformOp:translate = (100, 0, 0)
    float3 xformOp:rotateXYZ = (0, 0, 90)
    float3 xformOp:scale = (100, 100, 100) ( doc = "(" )
    variantSet "lod" = {
        "low" {
            def Mesh "Box"
            {
                point3f[] positions = [(1, 2, 3)]
            }
        }
    }

    def Mesh "Mesh"
    {
        point3f[] points = [(0, 0, 0)]
        float[] widths
        float other.timeSamples = { 0: 1, 1: 2 }
    }

    def ParticleField3DGaussianSplat "A"
    {
        point3f[] positions = [
            (1, 2, 3), (-1, 0, 0),
        ]
        quath[] orientationsh = [(1, 0, 0, 0), (0, 0, 0, 1)]
        float3[] scales = []
        half3[] scalesh = [(1, 2, 4), (1, 1, 1)]
        uniform int radiance:sphericalHarmonicsDegree = 1
        float3[] radiance:sphericalHarmonicsCoefficients = [
            (1, 0, 0), (0, 0, 0), (0, 0, 2), (0, 0, 0),
            (0, 1, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)] (
            elementSize = 4
            interpolation = "vertex"
        )
        asset texture = @a(b.png@
    }

    def ParticleField3DGaussianSplat "B"
    {
        matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 5, 1))
        token[] xformOpOrder = ["xformOp:transform"]
        point3f[] positions = [(0, 0, 1)]
    }
}
"##;

fn read(text: &str) -> weaver_io::Result<Gaussians> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usda");
    std::fs::write(&path, text).unwrap();
    read_gaussians(&path)
}

#[test]
fn a_layer_of_another_program() {
    let found = read(LAYER).unwrap();
    // In the world with +z up: a quarter turn about z, then 1 m along x. Its x, y, z are x, -z, y here.
    // (x, y, z) goes to (-y, x, z), then to (-y, -z, x): the columns are (0, 0, 1), (-1, 0, 0), (0, -1, 0).
    let turn = [0.5, 0.5, -0.5, 0.5];
    let mut sh = vec![0.0; 36];
    (sh[0], sh[13]) = (1.0, 1.0);
    // The harmonic of z is that of -y here, whose sign is another.
    sh[5] = 2.0;
    let expected = Gaussians {
        means: vec![[-1.0, -3.0, 1.0], [1.0, 0.0, -1.0], [1.0, -6.0, 0.0]],
        log_scales: vec![[0.0, 2.0_f32.ln(), 4.0_f32.ln()], [0.0; 3], [0.0; 3]],
        quats: vec![turn, [-turn[3], turn[2], -turn[1], turn[0]], turn],
        opacity_logits: vec![f32::INFINITY; 3],
        sh,
        degree: 1,
    };
    assert_same("a.usda", &found, &expected, 1e-6);
    // Without coefficients a Gaussian is gray.
    assert!((forms::color(found.sh[24]) - 0.5).abs() < 1e-6);
    assert_eq!(found.coefficients(), sh::coefficients(1));
}

#[test]
fn faults_of_layers_are_named() {
    let plain = "#usda 1.0\ndef ParticleField3DGaussianSplat \"G\"\n{\n    point3f[] positions = [(0, 0, 0), (1, 2, 3)]\nMORE}\n";
    let with = |more: &str| read(&plain.replace("MORE", more)).unwrap_err().to_string();
    let message = |text: &str| read(text).unwrap_err().to_string();
    assert_eq!(read(&plain.replace("MORE", "")).unwrap().len(), 2);
    let deep = format!("#usda 1.0\n{}", "def \"a\" {".repeat(100_000));
    let cases = [
        (message(""), "line 1: expected #usda 1.0, the first line of USD as text"),
        (message("PXR-USDC\0\0"), "found \"PXR-USDC"),
        (message("#usda 2.0\n"), "found \"#usda 2.0\""),
        (message("#usda 1.0\n"), "prims: expected a prim of type ParticleField3DGaussianSplat"),
        (message("#usda 1.0\ndef Mesh \"m\" {}\n"), "found types [\"Mesh\"]"),
        (message("#usda 1.0\n( upAxis = \"X\" )"), "line 2: expected upAxis \"Y\" or \"Z\", found \"X\""),
        (message("#usda 1.0\n( metersPerUnit = 0 )"), "line 2: expected a positive metersPerUnit, found 0"),
        (message(&plain[..60]), "line 4: expected the name of a property, found the end"),
        (message(&plain[..80]), "line 4: expected a number, found the end"),
        (message(&deep), "expected prims at most 64 deep"),
        (with("\""), "expected a quote at the end of a text"),
        (
            with("    float3[] scales = [(1, 1, 1)]\n"),
            "/G.scales: expected 6 numbers, as many as its positions ask for, found 3",
        ),
        (with("    float[] opacities = [1, 2]\n"), "/G.opacities: expected opacities from 0 to 1, found [2.0] at 1"),
        (with("    float[] opacities = [nan, 1]\n"), "/G.opacities: expected opacities from 0 to 1, found [NaN] at 0"),
        (with("    float[] opacities = [x, 1]\n"), "line 5: expected a number, found x"),
        (with("    float[] opacities = None\n"), "line 5: expected [, found None"),
        (with("    double[] opacities = [1, 1]\n"), "line 5: expected opacities of type float[], found double[]"),
        (with("    float[] opacities.timeSamples = { 0: [1, 1] }\n"), "expected one value of opacities, for all times"),
        (with("    float3[] scales = [(1, 1, 1), (1, -1, 1)]\n"), "/G.scales: expected finite scales of 0 and more"),
        (with("    float3[] scales = [(1, 1, 1), (1, 1)]\n"), "line 5: expected ,, found )"),
        (
            with("    quatf[] orientations = [(1, 0, 0, 0), (inf, 0, 0, 0)]\n"),
            "vertex 1, rotation: expected finite numbers",
        ),
        (
            with("    uniform int radiance:sphericalHarmonicsDegree = 9\n"),
            "Degree: expected a degree of 0 to 4, found 9",
        ),
        (
            with("    uniform int radiance:sphericalHarmonicsDegree = 1.5\n"),
            "Degree: expected a degree of 0 to 4, found 1.5",
        ),
        (
            with("    float3[] radiance:sphericalHarmonicsCoefficients = [(1, 1, 1)]\n"),
            "Coefficients: expected 96 numbers, as many as its positions ask for, found 3",
        ),
        (
            with("    token[] xformOpOrder = [\"xformOp:shear\"]\n"),
            "/G: expected a value of xformOp:shear, which xformOpOrder names, found none",
        ),
        (
            with("    token[] xformOpOrder = [\"xformOp:scale\"]\n    float3 xformOp:scale = (1, -1, 1)\n"),
            "/G: expected a transform of positive scales, rotation and translation",
        ),
        (
            with("    token[] xformOpOrder = [\"xformOp:shear\"]\n    float3 xformOp:shear = (1, -1, 1)\n"),
            "found xformOp:shear of 3 numbers",
        ),
    ];
    for (message, expected) in cases {
        assert!(message.contains("a.usda: ") && message.contains(expected), "{message} for {expected}");
    }
}

#[test]
fn faults_of_packages_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usdz");
    write_gaussians(&path, &one()).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let message = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read_gaussians(&path).unwrap_err().to_string()
    };
    let change = |at: usize, byte: u8| {
        let mut bytes = whole.clone();
        bytes[at] = byte;
        message(&bytes)
    };
    let digit = whole.windows(4).position(|four| four == b"-2.0").unwrap() + 1;
    let cases = [
        (change(0, b'X'), "content: expected a USDZ package, which is a ZIP archive"),
        (change(8, 8), "first file: expected one that is stored, with its length before it, found method 8"),
        (change(6, 8), "found method 0, flags 0x8"),
        (change(18, 0), "expected one that is stored"),
        (change(29, 255), "first file: expected"),
        (change(digit, b'7'), "checksum: expected"),
        (message(&whole[..100]), "first file: expected"),
        (message(b"PK\x03\x04"), "bytes of a header"),
    ];
    for (message, expected) in cases {
        assert!(message.contains("a.usdz: ") && message.contains(expected), "{message} for {expected}");
    }
}
