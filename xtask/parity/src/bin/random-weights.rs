//! `cargo xtask random-weights`: a checkpoint of any size with numbers drawn at random, in the published names and
//! types, so that size, time and memory can be shown without the real one.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use weaver_autograd::Params;
use weaver_io::safetensors::{Planned, write_weights};

use weaver_kernels::parallel;
use weaver_kernels::random::Stream;
use weaver_model::{ModelConfig, SplatWeaver};

const USAGE: &str = "usage: cargo xtask random-weights --preset NAME FILE [--seed S]

NAME is splatweaver-1b, vggt-1b (its names, no Gaussian head), or a preset of `splatweaver train`. The aggregator is
written as bf16, the heads as f32, as published.";

/// Numbers drawn and written at a time.
const CHUNK: usize = 1 << 20;
/// The entry of the metadata with sizes other than the published ones, for `splatweaver infer`.
const CONFIG: &str = "splatweaver_model";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match command(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

fn command(arguments: &[String]) -> Result<(), String> {
    let (mut preset, mut file, mut seed) = (None, None, 0);
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let mut value = || rest.next().cloned().ok_or_else(|| format!("{argument} needs a value\n{USAGE}"));
        match argument.as_str() {
            "--preset" => preset = Some(value()?),
            "--seed" => seed = value()?.parse().map_err(|_| format!("--seed: a number\n{USAGE}"))?,
            flag if flag.starts_with('-') => return Err(format!("unknown flag {flag}\n{USAGE}")),
            path => file = Some(PathBuf::from(path)),
        }
    }
    let (Some(preset), Some(file)) = (preset, file) else { return Err(USAGE.into()) };
    let vggt = preset == "vggt-1b";
    let name = if vggt { "splatweaver-1b" } else { &preset };
    let config = ModelConfig::preset(name).ok_or_else(|| format!("no preset `{preset}`\n{USAGE}"))?;

    let mut params = Params::<f32>::new();
    SplatWeaver::declare(config.clone(), &mut params);
    let prefix = if vggt { "" } else { "encoder." };
    let dim = config.backbone.dim;
    let plan = |name: &str, shape: &[usize]| {
        let (dtype, width) = if name.starts_with("aggregator.") { ("BF16", 2) } else { ("F32", 4) };
        Planned { name: format!("{prefix}{name}"), dtype, width, shape: shape.to_vec() }
    };
    let mut planned: Vec<Planned> = params
        .iter()
        .filter(|(_, param)| !(vggt && param.name().starts_with("gaussian_param_head.")))
        .map(|(_, param)| plan(param.name(), param.shape().dims()))
        .collect();
    planned.push(plan("aggregator.patch_embed.mask_token", &[1, dim]));
    let mut metadata = BTreeMap::from([("format".to_string(), "pt".to_string())]);
    metadata.insert("note".into(), format!("random numbers, not trained; preset {preset}, seed {seed}"));
    if config != ModelConfig::splatweaver_1b() {
        let text = serde_json::to_string(&config).map_err(|e| e.to_string())?;
        metadata.insert(CONFIG.into(), text);
    }
    let bytes: usize = planned.iter().map(Planned::bytes).sum();
    write_weights(&file, &metadata, &planned, |tensor, out| {
        let name = tensor.name.strip_prefix(prefix).unwrap_or(&tensor.name);
        write(tensor, Draw::of(name, &tensor.shape), Stream::new(seed, 0, name), out)
    })
    .map_err(|e| e.to_string())?;
    println!("{} tensors, {:.2} GB: {}", planned.len(), bytes as f64 / 1e9, file.display());
    Ok(())
}

/// Distribution of a tensor's numbers.
enum Draw {
    Constant(f32),
    /// Between minus and plus this.
    Uniform(f32),
    /// The last bias of the camera head: cameras near the origin, unrotated, one radian wide after four refinements.
    PoseCode,
    /// The last bias of the router.
    Logits,
}

impl Draw {
    /// The initial distribution of a network, so that no activation grows beyond bounds.
    fn of(name: &str, shape: &[usize]) -> Self {
        match name {
            "camera_head.pose_branch.fc2.bias" => Self::PoseCode,
            "gaussian_param_head.gs_moe.gating.2.bias" => Self::Logits,
            _ if name.ends_with("gamma") => Self::Constant(if name.contains("patch_embed") { 1.0 } else { 0.1 }),
            _ if name.contains("norm") && name.ends_with("weight") => Self::Constant(1.0),
            _ if name.ends_with("bias") => Self::Constant(0.0),
            _ if name.ends_with("weight") => {
                let fan_in = shape[1..].iter().product::<usize>().max(1);
                Self::Uniform(1.0 / (fan_in as f32).sqrt())
            }
            _ => Self::Uniform(0.03),
        }
    }

    fn number(&self, stream: Stream, i: usize) -> f32 {
        match self {
            Self::Constant(value) => *value,
            Self::Uniform(bound) => bound * (2.0 * stream.uniform::<f32>(i as u64) - 1.0),
            Self::PoseCode => [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25, 0.25, 0.25][i % 9],
            Self::Logits => [2.5, 2.0, 0.0, 0.0][i % 4],
        }
    }
}

fn write(tensor: &Planned, draw: Draw, stream: Stream, out: &mut dyn Write) -> std::io::Result<()> {
    let count: usize = tensor.shape.iter().product();
    let mut bytes = vec![0; CHUNK.min(count) * tensor.width];
    for start in (0..count).step_by(CHUNK) {
        let part = CHUNK.min(count - start) * tensor.width;
        parallel::for_chunks(&mut bytes[..part], 8192 * tensor.width, |chunk, bytes| {
            for (i, to) in bytes.chunks_exact_mut(tensor.width).enumerate() {
                let bits = draw.number(stream, start + chunk * 8192 + i).to_bits();
                // A bf16 is the upper half of an f32; rounding does not matter to random numbers.
                let all = bits.to_le_bytes();
                to.copy_from_slice(&all[4 - tensor.width..]);
            }
        });
        out.write_all(&bytes[..part])?;
    }
    Ok(())
}
