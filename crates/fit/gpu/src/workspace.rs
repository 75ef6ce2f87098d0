//! Memory of the rasterizer on the device, kept between calls.

use crate::context::Context;
use crate::error::GpuError;
use crate::passes::Passes;
use crate::profile::{PassTime, Profile};
use crate::room::Room;
use crate::sort::RadixSort;
use crate::staging::{Staging, Transfers};
use weaver_splat::{Extent, RasterSettings, Region};

/// State on the device from forward for backward, and room to work in. It only grows.
#[derive(Debug, Default)]
pub struct GpuWorkspace {
    /// The sizes and settings of the last forward.
    pub(crate) drawn: Option<(Extent, RasterSettings)>,
    /// `[N, 12]`: mean, quaternion, scale, opacity, nothing.
    pub(crate) params: Room,
    /// `[N, 3]` or `[N, K, 3]`.
    pub(crate) color: Room,
    /// The views of the last forward, or bands of them; those beyond `used` are of earlier ones.
    pub(crate) drawings: Vec<Drawing>,
    pub(crate) used: usize,
    pub(crate) scratch: Scratch,
    pub(crate) gradients: GradientRooms,
    /// Numbers on their way to or from the device.
    pub(crate) host: Vec<f32>,
    pub(crate) staging: Staging,
    pub(crate) profile: Option<Profile>,
}

/// A view, or a band of it, as forward has drawn it.
#[derive(Debug, Default)]
pub(crate) struct Drawing {
    pub view: usize,
    /// Pixels of the image that it covers.
    pub region: Option<Region>,
    /// E.
    pub entries: usize,
    /// `[N, 16]`.
    pub splats: Room,
    /// Where the entries of the Gaussian at each place by depth begin, `[N + 1]`, and the place of each, `[N]`.
    pub first: Room,
    pub rank: Room,
    /// The Gaussian of each entry, `[E]`, and the entries tile by tile, front to back, `[E]`.
    pub owners: Room,
    pub entry: Room,
    /// Where the list of each tile starts, `[t + 2]`.
    pub starts: Room,
    /// `[H, W, 5]`: red, green, blue, depth, transmittance, on the device and here.
    pub pixels: Room,
    pub drawn: Vec<f32>,
}

/// Buffers of a drawing while it is drawn.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Depth keys and Gaussians, and room to sort them.
    pub keys: [Room; 2],
    pub ids: [Room; 2],
    /// Tiles per Gaussian.
    pub tiles: Room,
    /// Sums of groups of Gaussians, and of all: M, E, rejected.
    pub sums: Room,
    pub totals: Room,
    /// The tile of each entry, and room to sort them.
    pub tile_of: [Room; 2],
    pub entry: Room,
    pub sort: RadixSort,
}

/// Buffers of backward.
#[derive(Debug, Default)]
pub(crate) struct GradientRooms {
    /// `[H, W, 5]`: of image, alpha, depth.
    pub cotangents: Room,
    /// `[E, 12]` and, with statistics, `[E, 2]`.
    pub moments: Room,
    pub weights: Room,
    pub dparams: Room,
    pub dcolor: Room,
    /// Parts of the camera's gradient, and their sum.
    pub camera: Room,
    pub camera_sums: Room,
    pub statistics: Room,
}

/// Splats, Gaussians by depth with their keys, and the lists of the tiles: entries `entry[starts[t]..starts[t + 1]]`,
/// whose Gaussians are in `owners`.
#[doc(hidden)]
#[derive(Clone, Debug)]
#[allow(missing_docs, reason = "named as in docs/explain/gpu.md; for tests")]
pub struct Lists {
    pub splats: Vec<[f32; 16]>,
    pub keys: Vec<u32>,
    pub ids: Vec<u32>,
    pub owners: Vec<u32>,
    pub entry: Vec<u32>,
    pub starts: Vec<u32>,
}

impl GpuWorkspace {
    /// Time of each pass since the last call, by the device's clock; nothing where it has none, or where the rasterizer
    /// does not [measure](crate::GpuRasterizer::measured).
    pub fn pass_times(&mut self) -> Vec<PassTime> {
        self.profile.as_mut().map(Profile::take).unwrap_or_default()
    }

    /// Copies since the last call, but for the few numbers of a view.
    pub fn transfers(&mut self) -> Transfers {
        std::mem::take(&mut self.staging.transfers)
    }

    /// Lists that the first drawing has left on the device, for tests.
    ///
    /// # Errors
    ///
    /// A device that fails.
    #[doc(hidden)]
    pub fn lists(&mut self, context: &Context) -> Result<Lists, GpuError> {
        let (drawing, Scratch { keys, ids, .. }) = (&self.drawings[0], &self.scratch);
        let mut read = |room: &Room| -> Result<Vec<u32>, GpuError> {
            let bytes = Passes::new(context, None).read(&mut self.staging, &[(room.buffer(), room.bytes())])?;
            Ok(bytes.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect())
        };
        let splats = read(&drawing.splats)?.as_chunks::<16>().0.iter().map(|row| row.map(f32::from_bits)).collect();
        let (owners, entry, starts) = (read(&drawing.owners)?, read(&drawing.entry)?, read(&drawing.starts)?);
        Ok(Lists { splats, keys: read(&keys[0])?, ids: read(&ids[0])?, owners, entry, starts })
    }

    /// Fills all memory on the device with ones: tests show with it that nothing is read before it is written.
    #[doc(hidden)]
    pub fn spoil(&self, context: &Context) {
        let Scratch { keys, ids, tiles, sums, totals, tile_of, entry, sort } = &self.scratch;
        let scratch = keys.iter().chain(ids).chain(tile_of).chain([tiles, sums, totals, entry, sort.counts()]);
        let GradientRooms { cotangents, moments, weights, dparams, dcolor, camera, camera_sums, statistics } =
            &self.gradients;
        let backward = [cotangents, moments, weights, dparams, dcolor, camera, camera_sums, statistics];
        let drawings = self.drawings.iter().flat_map(|drawing| {
            let Drawing { splats, first, rank, owners, entry, starts, pixels, .. } = drawing;
            [splats, first, rank, owners, entry, starts, pixels]
        });
        let all = scratch.chain(backward).chain(drawings).chain([&self.params, &self.color]);
        all.for_each(|room| room.spoil(context));
    }
}
