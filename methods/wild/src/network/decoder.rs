//! Colors of Gaussians under a look.

use weaver_autograd::{Real, Var, ops};
use weaver_nn::{Builder, Context, Conv2d, Linear, WeightInit};

/// The zeroth spherical harmonic.
const DC: f64 = 0.282_094_791_773_878_14;
/// Bound on the network's own coefficients.
const BOUND: f64 = 2.0;
/// Initial recoloring: contrast of a standardized photo, and its middle.
const CONTRAST: f64 = 0.2;
const MIDDLE: f64 = 0.5;

/// Sizes of a [`LookDecoder`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookDecoderConfig {
    /// Channels C of the feature maps.
    pub features: usize,
    /// Numbers E of an embedding.
    pub embedding: usize,
    /// Hidden channels.
    pub hidden: usize,
    /// Degree of the harmonics of a color: 2 as published.
    pub sh_degree: usize,
    /// True if each photo's own pixels, standardized and then given the look's contrast and middle, are added to the
    /// colors. Not published: tokens of small networks carry no texture.
    pub recolor: bool,
}

/// Colors of the Gaussians of all pixels under each of some looks.
///
/// raw_j = 2 tanh(conv1(relu(conv3([f ; e_j everywhere])))), its coefficients times 1 for degree 0 and 0.1 / 4^l for
/// degree l. With `recolor`, a_j I^ + c_j - 1/2 over the zeroth harmonic is added to degree 0, where I^ is the photo
/// [standardized](crate::standardized), and a_j - 0.2 and c_j - 0.5, three numbers each, are linear in e_j. The columns
/// of e in the first convolution and the recoloring start at zero: a new decoder gives every look the same colors, to
/// the bit. Source: Fujimura et al., arXiv 2604.21182, and its code.
///
/// Parameters `gs_decoder.0`, `gs_decoder.2` and `recolor`.
#[derive(Clone, Debug)]
pub struct LookDecoder {
    config: LookDecoderConfig,
    first: Conv2d,
    last: Conv2d,
    recolor: Option<Linear>,
}

impl LookDecoder {
    /// Builds `gs_decoder.0`, `gs_decoder.2` and, if there is recoloring, `recolor`.
    pub fn new<T: Real>(mut b: Builder<'_, T>, config: LookDecoderConfig) -> Self {
        let LookDecoderConfig { features, embedding, hidden, recolor, .. } = config;
        let inputs = features + embedding;
        let first = Conv2d::new(b.scope("gs_decoder.0"), inputs, hidden, 3, WeightInit::FanIn);
        for filter in b.value_mut(first.weight).chunks_mut(9 * inputs) {
            filter[9 * features..].fill(T::ZERO);
        }
        let last = Conv2d::new(b.scope("gs_decoder.2"), hidden, 3 * config.coefficients(), 1, WeightInit::FanIn);
        let recolor = recolor.then(|| {
            let layer = Linear::new(b.scope("recolor"), embedding, 6, WeightInit::FanIn);
            [Some(layer.weight), layer.bias].into_iter().flatten().for_each(|id| b.value_mut(id).fill(T::ZERO));
            layer
        });
        Self { config, first, last, recolor }
    }

    /// Coefficients `[T, V H W, K, 3]` of V photos' pixels, in the axes of their cameras, under T looks.
    ///
    /// `features` `[V, C, H, W]`, `looks` `[T, E]`, and the photos `standardized` `[V, 3, H, W]`, which only `recolor`
    /// uses. Differentiable in all three and the parameters.
    #[track_caller]
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        features: Var<'t, T>,
        looks: Var<'t, T>,
        standardized: Var<'t, T>,
    ) -> Var<'t, T> {
        let colors = self.published(cx, features, looks);
        let Some(layer) = &self.recolor else { return colors };
        let (maps, plain) = (features.shape(), standardized.shape());
        let fits = plain.dims() == [maps[0], 3, maps[2], maps[3]];
        cx.tape.ensure_shapes(fits, "look_decoder", "photos [V, 3, H, W] of the maps' size", &[maps, plain]);
        let k = self.config.coefficients();
        let [count, pixels] = [0, 1].map(|axis| colors.shape()[axis]);
        let own = recolored(layer.forward(cx, looks), standardized).reshape([count, pixels, 1, 3]);
        let even = colors.slice(2, 0, 1) + own;
        if k == 1 { even } else { ops::concat(&[even, colors.slice(2, 1, k - 1)], 2) }
    }

    /// Coefficients without recoloring, as published: each is within 2.
    #[track_caller]
    pub fn published<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        features: Var<'t, T>,
        looks: Var<'t, T>,
    ) -> Var<'t, T> {
        let LookDecoderConfig { features: channels, embedding, hidden, .. } = self.config;
        let (maps, rows) = (features.shape(), looks.shape());
        let fits = maps.rank() == 4 && maps[1] == channels && rows.rank() == 2 && rows[1] == embedding;
        let expected = format_args!("maps [V, {channels}, H, W] and looks [T, {embedding}]");
        cx.tape.ensure_shapes(fits, "look_decoder", expected, &[maps, rows]);
        let [views, height, width] = [0, 2, 3].map(|axis| maps[axis]);
        let (count, k) = (rows[0], self.config.coefficients());
        // The convolution of features does not depend on the look, the one of embeddings not on the view: they run
        // apart.
        let weight = cx.param(self.first.weight);
        let bias = self.first.bias.map(|bias| cx.param(bias));
        let of_maps = ops::conv2d(features, weight.slice(1, 0, channels), bias, 1, 1);
        let everywhere = looks.reshape([count, embedding, 1, 1]).expand([count, embedding, height, width]);
        let of_looks = ops::conv2d(everywhere, weight.slice(1, channels, embedding), None, 1, 1);
        let all = [count, views, hidden, height, width];
        let of_looks = of_looks.reshape([count, 1, hidden, height, width]).expand(all);
        let x = (of_maps.expand(all) + of_looks).relu().reshape([count * views, hidden, height, width]);
        let raw = self.last.forward(cx, x).tanh() * BOUND;
        let pixels = views * height * width;
        let rows = raw.permute(&[0, 2, 3, 1]).reshape([count * pixels, 3, k]).permute(&[0, 2, 1]);
        let factors = cx.tape.constant_with([1, k, 1], |all| {
            for (i, factor) in all.iter_mut().enumerate() {
                *factor = T::from_f64(factor_of(i.isqrt()));
            }
        });
        (rows * factors.expand(rows.shape())).reshape([count, pixels, k, 3])
    }
}

/// Factor on coefficients of a degree.
fn factor_of(degree: usize) -> f64 {
    if degree == 0 { 1.0 } else { 0.1 * 0.25_f64.powi(degree as i32) }
}

impl LookDecoderConfig {
    /// Coefficients of a color channel.
    fn coefficients(&self) -> usize {
        (self.sh_degree + 1).pow(2)
    }
}

/// Zeroth coefficients `[T, V, H, W, 3]` of photos `[V, 3, H, W]` under `numbers` `[T, 6]`: offsets of contrast and
/// middle from their initial values.
fn recolored<'t, T: Real>(numbers: Var<'t, T>, standardized: Var<'t, T>) -> Var<'t, T> {
    let (count, shape) = (numbers.shape()[0], standardized.shape());
    let all = [count, shape[0], shape[2], shape[3], 3];
    let of_look = |first| numbers.slice(1, first, 3).reshape([count, 1, 1, 1, 3]).expand(all);
    let photos = standardized.permute(&[0, 2, 3, 1]).expand(all);
    ((of_look(0) + CONTRAST) * photos + of_look(3) + (MIDDLE - 0.5)) * (1.0 / DC)
}
