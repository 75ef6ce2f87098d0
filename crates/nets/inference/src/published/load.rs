//! Recognizes a published checkpoint and maps its weights.

use crate::{Error, Partly};
use std::path::Path;
use std::sync::Arc;
use weaver_autograd::{HalfValues, ParamId, ParamValues, Params};
use weaver_io::safetensors::{Array, Mapped, Storage};
use weaver_kernels::parallel;
use weaver_model::{ModelConfig, SplatWeaver};
use weaver_nn::Builder;
use weaver_vggt::Vggt;

/// Prefixes of tensor names in published checkpoints.
const PREFIXES: [&str; 5] = ["", "encoder.", "model.encoder.", "model.", "module."];
/// A tensor that every such checkpoint has.
const KNOWN_BY: &str = "aggregator.camera_token";
/// Tensors that are ignored: an unused token, VGGT's point and track heads, the teacher networks of the distillation.
const UNUSED: [&str; 4] = ["aggregator.patch_embed.mask_token", "point_head.", "track_head.", "distill_"];
/// The entry of a file's metadata that holds the sizes of its network, where they are not the published ones.
pub const CONFIG: &str = "splatweaver_model";

/// The network that a checkpoint is for.
#[derive(Clone, Debug)]
pub enum Network {
    /// Cameras, depth and Gaussians.
    SplatWeaver(Box<SplatWeaver>),
    /// Cameras and depth only.
    Vggt(Box<Vggt>),
}

impl Network {
    /// Backbone, camera head and depth head, which every network has.
    pub fn vggt(&self) -> &Vggt {
        match self {
            Self::SplatWeaver(model) => model.vggt(),
            Self::Vggt(vggt) => vggt,
        }
    }
}

/// A recognized checkpoint whose weights are not loaded yet.
#[derive(Debug)]
pub struct Opened {
    weights: Mapped,
    prefix: &'static str,
    /// The network's configuration.
    pub config: ModelConfig,
    /// True if there are Gaussians.
    pub has_gaussians: bool,
}

/// An error of a checkpoint.
fn wrong(path: &Path, message: impl Into<String>) -> Error {
    Error::Checkpoint { path: path.to_path_buf(), message: message.into() }
}

impl Opened {
    /// Opens a safetensors file, an index of several, or a folder, and recognizes the network by its tensors' names.
    /// Without `gaussians` the Gaussian head is ignored.
    ///
    /// # Errors
    /// When it cannot be read or is a checkpoint of another model.
    pub fn new(path: &Path, gaussians: bool) -> Result<Self, Error> {
        let weights = Mapped::open(path)?;
        let known = |prefix: &&&str| weights.get(&format!("{prefix}{KNOWN_BY}")).is_some();
        let Some(prefix) = PREFIXES.iter().find(known) else {
            let first: Vec<&str> = weights.iter().take(3).map(Array::name).collect();
            let run = weights.metadata().get("format").is_some_and(|f| f.starts_with("splatweaver-checkpoint"));
            let hint = if run { "; this is the checkpoint of a training run" } else { "" };
            let expected = format!("expected the tensors of SplatWeaver or VGGT, such as encoder.{KNOWN_BY}");
            let count = weights.iter().len();
            return Err(wrong(path, format!("{expected}; found {count} others, such as {}{hint}", first.join(", "))));
        };
        let mut config = match weights.metadata().get(CONFIG) {
            Some(text) => serde_json::from_str::<ModelConfig>(text)
                .map_err(|e| e.to_string())
                .and_then(|config| config.check().map(|()| config))
                .map_err(|e| wrong(path, format!("metadata {CONFIG}: {e}")))?,
            None => ModelConfig::splatweaver_1b(),
        };
        // Parameters are declared layer by layer; each has at least one tensor.
        let layers = [config.backbone.encoder_depth, config.backbone.rounds, config.camera.depth];
        let (most, tensors) = (layers.into_iter().max().unwrap_or(0), weights.iter().len());
        if most > tensors {
            return Err(wrong(path, format!("metadata {CONFIG}: {most} layers, and there are only {tensors} tensors")));
        }
        let head = format!("{prefix}gaussian_param_head.");
        let is_splatweaver = weights.iter().any(|w| w.name().starts_with(&head));
        if !is_splatweaver {
            // VGGT's own decoding of focal lengths.
            config.camera.tangent_offset = 0.0;
        }
        let has_gaussians = gaussians && is_splatweaver;
        Ok(Self { weights, prefix, config, has_gaussians })
    }

    /// Bytes of the weights that the network uses.
    pub fn bytes(&self) -> u64 {
        self.weights.iter().filter(|w| !self.is_unused(w.name())).map(|w| w.bytes() as u64).sum()
    }

    /// Bytes of the weights that are used after the backbone.
    pub fn bytes_after_backbone(&self) -> u64 {
        let used = self.weights.iter().filter(|w| !self.is_unused(w.name()) && !w.name().contains("aggregator."));
        used.map(|w| w.bytes() as u64).sum()
    }

    /// The weights in their files.
    pub fn weights(&self) -> &Mapped {
        &self.weights
    }

    /// True if the network ignores the tensor with this name.
    fn is_unused(&self, name: &str) -> bool {
        let Some(name) = name.strip_prefix(self.prefix) else { return false };
        UNUSED.iter().any(|unused| name.starts_with(unused))
            || (!self.has_gaussians && name.starts_with("gaussian_param_head."))
    }

    /// Builds the network and points its parameters to the weights. Matrices in half precision stay as they are; other
    /// tensors in half precision (a thousandth) are copied to f32. With `bf16_products`, products with matrices in bf16
    /// round the other factor, too ([`HalfValues::Bf16Pairs`]).
    ///
    /// # Errors
    /// Names all tensors that are missing, not of this network, of another shape or type, or not finite.
    pub fn load(&self, bf16_products: bool) -> Result<(Network, Params<f32>), Error> {
        let mut params = Params::new();
        let network = if self.has_gaussians {
            Network::SplatWeaver(Box::new(SplatWeaver::declare(self.config.clone(), &mut params)))
        } else {
            Network::Vggt(Box::new(Vggt::new(Builder::declaring(&mut params), self.config.vggt())))
        };
        let ids: Vec<ParamId> = params.ids().collect();
        let mut found: Vec<Result<ParamValues<f32>, Fault>> = ids.iter().map(|_| Err(Fault::Missing)).collect();
        parallel::for_chunks(&mut found, 1, |i, found| found[0] = self.values(&params, ids[i], bf16_products));
        // The check for finite numbers has read every page; release them until they are needed.
        self.weights.forget();

        let mut faults: [Vec<String>; 4] = Default::default();
        for (id, values) in ids.iter().zip(found) {
            let name = format!("{}{}", self.prefix, params.get(*id).name());
            match values {
                Ok(values) => params.set(*id, values),
                Err(Fault::Missing) => faults[0].push(name),
                Err(Fault::Shape { expected, found }) => {
                    faults[1].push(format!("{name} (expected {expected}, found {found})"));
                }
                Err(Fault::NotFinite) => faults[2].push(name),
            }
        }
        let ours = |weight: &&Array| {
            let name = weight.name().strip_prefix(self.prefix);
            self.is_unused(weight.name()) || name.is_some_and(|name| params.find(name).is_some())
        };
        faults[3].extend(self.weights.iter().filter(|w| !ours(w)).map(|w| w.name().to_string()));
        let kinds = ["missing", "of another shape or type", "with NaN or infinity", "not of this network"];
        let messages: Vec<String> = kinds
            .iter()
            .zip(&faults)
            .filter(|(_, names)| !names.is_empty())
            .map(|(kind, names)| format!("{} tensors {kind}: {}", names.len(), names.join(", ")))
            .collect();
        if messages.is_empty() { Ok((network, params)) } else { Err(wrong(self.weights.path(), messages.join("; "))) }
    }

    /// Gives those declared parameters the checkpoint's weights that have their name and shape, widened to `f32`, and
    /// leaves the others: a network of another kind may have the published backbone.
    ///
    /// # Errors
    /// When none fits, or one that does is not finite.
    pub fn fill_partly(&self, params: &mut Params<f32>) -> Result<Partly, Error> {
        let mut partly = Partly::default();
        for id in params.ids().collect::<Vec<_>>() {
            let name = params.get(id).name().to_string();
            match self.values(params, id, false) {
                Ok(values) => {
                    params.set(id, ParamValues::Owned(Arc::new(wide(&values))));
                    partly.taken.push(name);
                }
                Err(Fault::Missing) => partly.fresh.push(format!("{name} (not there)")),
                Err(Fault::Shape { expected, found }) => {
                    partly.fresh.push(format!("{name} ({expected}, there {found})"));
                }
                Err(Fault::NotFinite) => {
                    let message =
                        format!("tensor {}{name}: expected finite numbers, found NaN or infinity", self.prefix);
                    return Err(wrong(self.weights.path(), message));
                }
            }
        }
        let others = self.weights.iter().filter(|weight| !self.is_unused(weight.name()));
        let others = others.map(|weight| weight.name().strip_prefix(self.prefix).unwrap_or(weight.name()));
        partly.unused = others.filter(|name| params.find(name).is_none()).map(String::from).collect();
        partly.some(self.weights.path())
    }

    /// The values for a parameter.
    fn values(&self, params: &Params<f32>, id: ParamId, bf16_products: bool) -> Result<ParamValues<f32>, Fault> {
        let param = params.get(id);
        let weight = self.weights.get(&format!("{}{}", self.prefix, param.name())).ok_or(Fault::Missing)?;
        let shape = param.shape();
        let mismatch = |found: String| Fault::Shape { expected: format!("{shape}"), found };
        if weight.shape() != shape.dims() {
            return Err(mismatch(format!("{:?}", weight.shape())));
        }
        let storage = weight.storage().map_err(|_| mismatch(weight.dtype()))?;
        if !storage.is_finite() {
            return Err(Fault::NotFinite);
        }
        let values = match storage {
            Storage::F32(slice) => return Ok(ParamValues::Shared(Arc::new(slice))),
            Storage::Widened(values) => return Ok(ParamValues::Owned(Arc::new(values))),
            Storage::Bf16(slice) if bf16_products => HalfValues::Bf16Pairs(Arc::new(slice)),
            Storage::Bf16(slice) => HalfValues::Bf16(Arc::new(slice)),
            Storage::F16(slice) => HalfValues::F16(Arc::new(slice)),
        };
        // Only matrices are used in half precision: products widen them as they go.
        if shape.rank() == 2 {
            return Ok(ParamValues::Half(values));
        }
        Ok(ParamValues::Owned(Arc::new(wide(&ParamValues::Half(values)))))
    }
}

/// A copy of values that are there, in full precision.
fn wide(values: &ParamValues<f32>) -> Vec<f32> {
    match values {
        ParamValues::Owned(values) => values.to_vec(),
        ParamValues::Shared(values) => (**values).as_ref().to_vec(),
        ParamValues::Half(values) => {
            let mut wide = vec![0.0; values.view().len()];
            values.view().widen(&mut wide);
            wide
        }
        ParamValues::Absent => Vec::new(),
    }
}

/// Why a parameter could not be loaded.
enum Fault {
    Missing,
    Shape { expected: String, found: String },
    NotFinite,
}
