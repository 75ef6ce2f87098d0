//! Detectors in safetensors files. Public weights of UR-DMU are read without conversion.

use crate::detector::{Detector, EXPERT, GATE};
use crate::encoder::{ConvolutionSizes, DeepMilSizes, EncoderKind};
use crate::temporal_transformer::UrDmuSizes;
use crate::{Error, Result};
use std::path::Path;
use weaver_autograd::ParamValues;
use weaver_io::safetensors::Tensors;

/// Numbers of an attention head of the published network; its weights do not determine it.
const PUBLISHED_HEAD: usize = 128;
/// Prefix of the detector's tensors in files.
const ENCODER: &str = "vad.encoder";
const HEADS: &str = "vad.heads";
const EXPERTS: &str = "vad.experts";
const PUBLISHED: &str = "vad.experts.published";
const METADATA: &str = "vad.told";

impl Detector {
    /// Writes the detector, atomically, with `metadata`.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path, metadata: &str) -> Result<()> {
        Ok(self.tensors(metadata).write(path)?)
    }

    /// The weights as tensors of a file, with `metadata`.
    pub fn tensors(&self, metadata: &str) -> Tensors {
        let mut tensors = Tensors::default();
        for (_, param) in self.params.iter() {
            tensors.insert(param.name(), param.shape().dims(), param.value().to_vec());
        }
        let (encoder, heads) = match self.kind {
            EncoderKind::UrDmu(sizes) => ("urdmu", sizes.heads),
            EncoderKind::Convolutions(_) => ("convolutions", 0),
            EncoderKind::DeepMil(_) => ("deepmil", 0),
            EncoderKind::Rtfm(_) => ("rtfm", 0),
        };
        let names = self.names.join(",");
        let (heads, published) = (heads.to_string(), self.published.to_string());
        for (key, value) in
            [(ENCODER, encoder), (HEADS, &heads), (EXPERTS, &names), (PUBLISHED, &published), (METADATA, metadata)]
        {
            tensors.metadata.insert(key.into(), value.into());
        }
        tensors
    }

    /// Reads a detector with its metadata, or the weights of the public UR-DMU.
    ///
    /// # Errors
    /// When the file cannot be read, lacks a weight or has one of another shape, or a weight is not finite.
    pub fn read(path: &Path) -> Result<(Self, String)> {
        Self::of_tensors(&Tensors::read(path)?)
    }

    /// The detector in tensors of a file, with its metadata.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn of_tensors(tensors: &Tensors) -> Result<(Self, String)> {
        let path = tensors.origin();
        let mut detector = Self::new(kind(tensors, path)?, 0);
        let value = |key: &str| tensors.metadata.get(key).map_or("", String::as_str);
        let names: Vec<String> =
            value(EXPERTS).split(',').filter(|name| !name.is_empty()).map(str::to_string).collect();
        detector.published = value(PUBLISHED) == "true";
        if !names.is_empty() {
            detector.add_experts(names, 0);
        }
        if tensors.tensors.contains_key(&format!("{GATE}.in.weight")) {
            detector.add_gate(0);
        }
        for id in detector.params.ids() {
            let (name, shape) = (detector.params.get(id).name().to_string(), detector.params.get(id).shape());
            let values = tensors.widened(&name, shape.dims())?.into_owned();
            if let Some(value) = values.iter().find(|x| !x.is_finite()) {
                return Err(Error::invalid(path, format!("tensor {name}"), "finite numbers", value));
            }
            detector.params.set(id, ParamValues::Owned(values.into()));
        }
        if let Some(name) = tensors.tensors.keys().find(|name| detector.params.find(name).is_none()) {
            let kinds = format!("weights of an encoder, of `{EXPERT}` and of `{GATE}`");
            return Err(Error::invalid(path, "tensors", kinds, format!("also {name}")));
        }
        Ok((detector, value(METADATA).to_string()))
    }
}

/// Kind and sizes of the encoder in a file.
fn kind(tensors: &Tensors, path: &Path) -> Result<EncoderKind> {
    let side = |name: &str, rank: usize, axis: usize| -> Result<usize> {
        let shape = &tensors.get(name)?.shape;
        if shape.len() != rank {
            return Err(Error::invalid(path, format!("tensor {name}"), format!("{rank} dimensions"), shape.len()));
        }
        Ok(shape[axis])
    };
    let classes = match tensors.tensors.contains_key("class_head.mlp.2.weight") {
        true => side("class_head.mlp.2.weight", 2, 0)?,
        false => 0,
    };
    // The public file has no such entry.
    match tensors.metadata.get(ENCODER).map_or("urdmu", String::as_str) {
        "urdmu" => {
            let count = |i: &usize| tensors.tensors.contains_key(&format!("selfatt.layers.{i}.0.norm.weight"));
            let inner = side("selfatt.layers.0.0.fn.to_qkv.weight", 2, 0)? / 4;
            let stored = tensors.metadata.get(HEADS).and_then(|heads| heads.parse().ok());
            let heads: usize = stored.unwrap_or(inner / PUBLISHED_HEAD);
            if heads == 0 || !inner.is_multiple_of(heads) {
                return Err(Error::invalid(path, HEADS, format!("a divisor of {inner}"), heads));
            }
            Ok(EncoderKind::UrDmu(UrDmuSizes {
                features: side("embedding.conv_1.0.weight", 3, 1)?,
                width: side("embedding.conv_1.0.weight", 3, 0)?,
                layers: (0..).take_while(count).count(),
                heads,
                head: inner / heads,
                hidden: side("selfatt.layers.0.1.fn.net.0.weight", 2, 0)?,
                memory: side("Amemory.memory_block", 2, 0)?,
                score_hidden: side("cls_head.mlp.0.weight", 2, 0)?,
                classes,
            }))
        }
        "convolutions" => {
            let (features, width) = (side("conv.0.weight", 3, 1)?, side("conv.0.weight", 3, 0)?);
            Ok(EncoderKind::Convolutions(ConvolutionSizes { features, width, classes }))
        }
        "deepmil" => {
            let hidden = [side("fc1.weight", 2, 0)?, side("fc2.weight", 2, 0)?];
            Ok(EncoderKind::DeepMil(DeepMilSizes { features: side("fc1.weight", 2, 1)?, hidden }))
        }
        "rtfm" => {
            let (features, width) = (side("fc1.weight", 2, 1)?, side("fc1.weight", 2, 0)?);
            Ok(EncoderKind::Rtfm(ConvolutionSizes { features, width, classes }))
        }
        other => Err(Error::invalid(path, ENCODER, "urdmu, convolutions, deepmil or rtfm", other)),
    }
}
