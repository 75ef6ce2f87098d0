//! Cardinality experts: expert e turns a pixel's features into e Gaussians.

use crate::routes::Routes;
use crate::two_layers::TwoLayers;
use weaver_autograd::{List, Real, Var, ops};
use weaver_nn::{Builder, Context};
use weaver_router::gate;

/// The experts 1 to M: expert e turns a pixel's features into the raw numbers of e Gaussians.
///
/// Each is a linear layer F -> F, a rectifier, and a linear layer F -> e S, with S raw numbers per Gaussian.
///
/// Parameters (below the builder's path), for e = 1 to M: `<e>.0.weight` `[F, F]`, `<e>.0.bias`, `<e>.2.weight`
/// `[e S, F]`, `<e>.2.bias`.
#[derive(Clone, Debug)]
pub struct CardinalityExperts {
    experts: Vec<TwoLayers>,
    slot: usize,
}

impl CardinalityExperts {
    /// Adds the parameters of experts 1 to M = `max_per_pixel`, for F = `features` channels and S = `slot` raw numbers
    /// per Gaussian.
    ///
    /// The initial output layers are multiplied by `output_gain`: 1 as published, less for Gaussians that start alike.
    pub fn new<T: Real>(
        mut builder: Builder<'_, T>,
        features: usize,
        max_per_pixel: usize,
        slot: usize,
        output_gain: f64,
    ) -> Self {
        let expert = |e: usize| {
            let layers = TwoLayers::new(builder.scope(e), features, features, e * slot);
            layers.scale_output(&mut builder, output_gain);
            layers
        };
        Self { experts: (1..=max_per_pixel).map(expert).collect(), slot }
    }

    /// The largest number of Gaussians M of a pixel.
    pub fn max_per_pixel(&self) -> usize {
        self.experts.len()
    }

    /// The raw parameters `[N, S]` of all Gaussians, in the order of the routes.
    ///
    /// `features` `[R, F]` belong to the routed pixels, in order. If a `choice` `[P, E]` is given, each expert's output
    /// is multiplied by the entry of its pixel and expert, which carries the gradient to the router. An expert without
    /// pixels runs on no rows, so that its parameters get a gradient of zero.
    pub fn forward<'t, T: Real>(
        &self,
        cx: Context<'t, '_, T>,
        features: Var<'t, T>,
        routes: &Routes,
        choice: Option<Var<'t, T>>,
    ) -> Var<'t, T> {
        cx.part("experts", || {
            let parts = ops::split(features, 0, &routes.counts);
            let mut raw: List<Var<'t, T>> = List::with_capacity(self.experts.len());
            for (((expert, rows), pixels), e) in self.experts.iter().zip(parts).zip(routes.by_expert()).zip(1..) {
                let output = cx.part(e, || {
                    let output = expert.forward(cx, rows);
                    choice.map_or(output, |choice| gate(output, choice, pixels, e))
                });
                raw.push(output.reshape([pixels.len() * e, self.slot]));
            }
            ops::concat(&raw, 0)
        })
    }
}
