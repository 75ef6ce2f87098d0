//! The prims of a layer, with the attributes that Gaussians and their places are made of.

use super::PRIM;
use super::text::{Text, Token};
use crate::Result;
use std::collections::BTreeMap;

/// Prims within prims at most.
const DEEPEST: usize = 64;

/// Attributes of Gaussians: name, type and numbers of an element. Those that end in h have half the bits.
const ATTRIBUTES: [(&str, &str, usize); 11] = [
    ("positions", "point3f[]", 3),
    ("positionsh", "point3h[]", 3),
    ("orientations", "quatf[]", 4),
    ("orientationsh", "quath[]", 4),
    ("scales", "float3[]", 3),
    ("scalesh", "half3[]", 3),
    ("opacities", "float[]", 1),
    ("opacitiesh", "half[]", 1),
    ("radiance:sphericalHarmonicsDegree", "int", 1),
    ("radiance:sphericalHarmonicsCoefficients", "float3[]", 3),
    ("radiance:sphericalHarmonicsCoefficientsh", "half3[]", 3),
];

/// Types of transforms: numbers of rows and of columns.
const TRANSFORMS: [(&str, usize, usize); 10] = [
    ("double", 1, 1),
    ("float", 1, 1),
    ("half", 1, 1),
    ("double3", 1, 3),
    ("float3", 1, 3),
    ("half3", 1, 3),
    ("quatd", 1, 4),
    ("quatf", 1, 4),
    ("quath", 1, 4),
    ("matrix4d", 4, 4),
];

pub(super) struct Document {
    /// True where +z is up, not +y.
    pub z_is_up: bool,
    pub meters_per_unit: f64,
    pub prims: Vec<Prim>,
}

/// A prim that is defined.
#[derive(Default)]
pub(super) struct Prim {
    pub kind: String,
    /// The names of the prims around it and its own.
    pub path: String,
    /// Numbers of attributes of Gaussians.
    pub attributes: BTreeMap<String, Vec<f32>>,
    pub transforms: BTreeMap<String, Vec<f64>>,
    /// Names of transforms, from the outermost to the innermost.
    pub order: Vec<String>,
    pub children: Vec<Prim>,
}

impl Document {
    pub(super) fn read(mut text: Text<'_>) -> Result<Self> {
        let first = text.rest_of_line()?;
        if !first.starts_with("#usda 1.") {
            let expected = "#usda 1.0, the first line of USD as text (usdcat of OpenUSD makes text of other files)";
            let found: String = first.chars().take(16).collect();
            return Err(text.invalid(expected, format!("{found:?}")));
        }
        let mut document = Self { z_is_up: false, meters_per_unit: 1.0, prims: Vec::new() };
        if text.takes('(')? {
            document.metadata(&mut text)?;
        }
        loop {
            match text.next()? {
                Token::End => return Ok(document),
                Token::Word(word) => document.prims.extend(statement(&mut text, &word, &mut Prim::default(), 0)?),
                other => return Err(text.unexpected("a prim", &other)),
            }
        }
    }

    /// Metadata of the layer, from behind the opening bracket on.
    fn metadata(&mut self, text: &mut Text<'_>) -> Result<()> {
        loop {
            match text.next()? {
                Token::Symbol(')') => return Ok(()),
                Token::Quoted(_) => {}
                Token::Word(key) => {
                    if !text.takes('=')? {
                        continue; // One of the words before a key.
                    }
                    match key.as_str() {
                        "upAxis" => {
                            let axis = text.quoted_name()?;
                            if !["Y", "Z"].contains(&axis.as_str()) {
                                return Err(text.invalid("upAxis \"Y\" or \"Z\"", format!("{axis:?}")));
                            }
                            self.z_is_up = axis == "Z";
                        }
                        "metersPerUnit" => {
                            let mut number = Vec::new();
                            text.tuple(1, &mut number)?;
                            self.meters_per_unit = number[0];
                            if !(self.meters_per_unit > 0.0 && self.meters_per_unit.is_finite()) {
                                return Err(text.invalid("a positive metersPerUnit", number[0]));
                            }
                        }
                        _ => text.skip()?,
                    }
                }
                other => return Err(text.unexpected("metadata of the layer", &other)),
            }
        }
    }
}

/// The rest of a statement that begins with a word: a prim within another, if it is defined, or a property of that.
fn statement(text: &mut Text<'_>, word: &str, of: &mut Prim, depth: usize) -> Result<Option<Prim>> {
    match word {
        "def" | "over" | "class" => {
            let prim = prim(text, &of.path, depth)?;
            return Ok((word == "def").then_some(prim));
        }
        "variantSet" => {
            text.quoted_name()?;
            text.expect('=')?;
            text.skip()?;
        }
        "reorder" => {
            text.name("the names of an order")?;
            text.expect('=')?;
            text.skip()?;
        }
        _ => property(text, word, of)?,
    }
    Ok(None)
}

/// A prim from behind its first word on.
fn prim(text: &mut Text<'_>, within: &str, depth: usize) -> Result<Prim> {
    if depth == DEEPEST {
        return Err(text.invalid(format!("prims at most {DEEPEST} deep"), "a deeper one"));
    }
    let mut prim = Prim::default();
    if let Token::Word(_) = text.peek()? {
        prim.kind = text.name("a type")?;
    }
    prim.path = format!("{within}/{}", text.quoted_name()?);
    metadata(text)?;
    text.expect('{')?;
    loop {
        match text.next()? {
            Token::Symbol('}') => return Ok(prim),
            Token::Word(word) => {
                let child = statement(text, &word, &mut prim, depth + 1)?;
                prim.children.extend(child);
            }
            other => return Err(text.unexpected("a property, a prim or }", &other)),
        }
    }
}

/// Passes over metadata in parentheses, if there is such.
fn metadata(text: &mut Text<'_>) -> Result<()> {
    if *text.peek()? == Token::Symbol('(') { text.skip() } else { Ok(()) }
}

fn property(text: &mut Text<'_>, word: &str, of: &mut Prim) -> Result<()> {
    const QUALIFIERS: [&str; 8] = ["custom", "uniform", "varying", "config", "prepend", "append", "delete", "add"];
    let mut kind = word.to_string();
    while QUALIFIERS.contains(&kind.as_str()) {
        kind = text.name("a type")?;
    }
    if text.takes('[')? {
        text.expect(']')?;
        kind.push_str("[]");
    }
    let name = text.name("the name of a property")?;
    if text.takes('=')? {
        value(text, &kind, &name, of)?;
    }
    metadata(text)
}

fn value(text: &mut Text<'_>, kind: &str, name: &str, of: &mut Prim) -> Result<()> {
    let plain = name.split('.').next().unwrap_or(name);
    let attribute = ATTRIBUTES.iter().find(|(known, ..)| *known == plain).filter(|_| of.kind == PRIM);
    if plain != name && (attribute.is_some() || plain.starts_with("xformOp:")) {
        return Err(text.invalid(format!("one value of {plain}, for all times"), name));
    }
    if let Some((_, expected, width)) = attribute {
        if kind != *expected {
            return Err(text.invalid(format!("{name} of type {expected}"), kind));
        }
        let mut numbers = Vec::new();
        if kind.ends_with("[]") {
            text.list(|text| text.tuple(*width, &mut numbers))?;
        } else {
            text.tuple(*width, &mut numbers)?;
        }
        of.attributes.insert(name.into(), numbers);
    } else if name.starts_with("xformOp:") {
        let Some((_, rows, columns)) = TRANSFORMS.iter().find(|(known, ..)| *known == kind) else {
            return Err(text.invalid(format!("{name} of a type of transforms"), kind));
        };
        let mut numbers = Vec::new();
        if *rows == 1 {
            text.tuple(*columns, &mut numbers)?;
        } else {
            text.expect('(')?;
            for row in 0..*rows {
                if row > 0 {
                    text.expect(',')?;
                }
                text.tuple(*columns, &mut numbers)?;
            }
            text.expect(')')?;
        }
        of.transforms.insert(name.into(), numbers);
    } else if name == "xformOpOrder" {
        text.list(|text| {
            of.order.push(text.quoted_name()?);
            Ok(())
        })?;
    } else {
        text.skip()?;
    }
    Ok(())
}
