//! Forward: project, sort by depth, list by tile, composite.

use crate::context::Context;
use crate::error::GpuError;
use crate::passes::Passes;
use crate::room::{Room, uniform};
use crate::shader::Kernel;
use crate::sort::{Pairs, RadixSort};
use crate::uniforms::{Grid, SIDE, Share, view_words, with_capacity, with_share};
use crate::workspace::{Drawing, GpuWorkspace, Scratch};
use weaver_scene::{CameraSlices, GaussianSlices};
use weaver_splat::{Extent, Images, RasterSettings, RasterStats, Region};

/// Bytes of a Gaussian's parameters, a splat, and the sums of an entry.
pub(crate) const PARAMS: u64 = 48;
const SPLAT: u64 = 64;
pub(crate) const MOMENTS: u64 = 48;
/// Gaussians of a work group of most passes, and of those that sum.
pub(crate) const GROUP: usize = 256;
const SUM_GROUP: usize = 2048;
/// Entries that shaders can count to; their sums stop there.
const MOST_ENTRIES: u64 = 0x7fff_ffff;

/// Arguments of a call.
pub(crate) type Call<'a> = (&'a GaussianSlices<'a, f32>, &'a CameraSlices<'a, f32>, &'a RasterSettings, &'a Extent);

/// A forward pass under way.
pub(crate) struct Forward<'a> {
    context: &'a Context,
    call: Call<'a>,
    workspace: &'a mut GpuWorkspace,
    stats: RasterStats,
    end: End<'a>,
}

/// Destination of the image.
enum End<'a> {
    /// On the host.
    Host,
    /// On the device.
    Device,
    /// On the device, once an embedder submits the recorded passes.
    Later(&'a mut wgpu::CommandEncoder),
}

/// The Gaussians of a view, at most so many that their parameters and colors fit into a binding each.
pub(crate) fn shares(context: &Context, extent: &Extent) -> Vec<Share> {
    let each = PARAMS.max(4 * extent.color_len as u64);
    // A multiple of the groups that sum the camera's parts, and of the alignment of offsets.
    let most = ((context.binding_bytes() / each) as usize / GROUP * GROUP).max(GROUP);
    let starts = (0..extent.gaussians).step_by(most);
    starts.map(|first| Share { first, count: most.min(extent.gaussians - first), ..Share::default() }).collect()
}

impl<'a> Forward<'a> {
    pub fn new(context: &'a Context, call: Call<'a>, workspace: &'a mut GpuWorkspace) -> Self {
        Self { context, call, workspace, stats: RasterStats::default(), end: End::Host }
    }

    /// Draws all views.
    pub fn run(mut self, mut images: Images<'_, f32>) -> Result<RasterStats, GpuError> {
        let (_, cameras, _, extent) = self.call;
        self.upload()?;
        self.workspace.used = 0;
        for v in 0..extent.views {
            self.draw(v, extent.region)?;
        }
        let whole = extent.region;
        for drawing in &self.workspace.drawings[..self.workspace.used] {
            let Some(region) = drawing.region else { continue };
            let from = drawing.view * whole.pixels() + (region.y - whole.y) * whole.width;
            let background = cameras.background_of(drawing.view);
            for (i, pixel) in drawing.drawn.as_chunks::<5>().0.iter().enumerate() {
                let at = from + i;
                let [color @ .., depth, transmittance] = *pixel;
                if extent.color_len > 0 {
                    (0..3).for_each(|c| images.image[3 * at + c] = color[c] + transmittance * background[c]);
                }
                images.alpha[at] = 1.0 - transmittance;
                if let Some(depths) = &mut images.depth {
                    depths[at] = depth;
                }
            }
        }
        Ok(self.stats)
    }

    /// Draws the one view of Gaussians that are on the device, and leaves the image there.
    pub fn resident(mut self) -> Result<RasterStats, GpuError> {
        self.end = End::Device;
        self.workspace.used = 0;
        self.draw(0, self.call.3.region)?;
        if self.workspace.used > 1 {
            let (entries, found) = (self.stats.entries, self.context.binding_bytes());
            let what = || format!("{entries} splats over tiles, for a fit on the device; smaller photos have fewer");
            self.context.at_most("max_storage_buffer_binding_size", MOMENTS * entries as u64, found, what)?;
        }
        Ok(self.stats)
    }

    /// Records the drawing of the one view of Gaussians that are on the device, as far as `capacity` entries go, and
    /// waits for nothing.
    pub fn record(mut self, encoder: &'a mut wgpu::CommandEncoder, capacity: usize) -> Result<(), GpuError> {
        let (region, found) = (self.call.3.region, self.context.binding_bytes());
        let what = || format!("a capacity of {capacity} entries");
        self.context.at_most("max_storage_buffer_binding_size", 4 * capacity as u64, found, what)?;
        self.end = End::Later(encoder);
        self.workspace.used = 0;
        self.prepare();
        self.project(0, region)?;
        self.composite(capacity)?;
        self.workspace.used = 1;
        Ok(())
    }

    /// Makes room for one more drawing.
    fn prepare(&mut self) {
        if self.workspace.used == self.workspace.drawings.len() {
            self.workspace.drawings.push(Drawing::default());
        }
    }

    /// Brings the Gaussians to the device.
    fn upload(&mut self) -> Result<(), GpuError> {
        let (gaussians, _, _, extent) = self.call;
        let GpuWorkspace { params, color, host, staging, .. } = &mut *self.workspace;
        params.storage(self.context, "parameters of the Gaussians", extent.gaussians, PARAMS)?;
        color.storage(self.context, "colors of the Gaussians", extent.gaussians, 4 * extent.color_len as u64)?;
        host.clear();
        for n in 0..extent.gaussians {
            host.extend_from_slice(&gaussians.means[3 * n..][..3]);
            host.extend_from_slice(&gaussians.quats[4 * n..][..4]);
            host.extend_from_slice(&gaussians.scales[3 * n..][..3]);
            host.extend_from_slice(&[gaussians.opacities[n], 0.0]);
        }
        staging.write(self.context, params, host);
        staging.write(self.context, color, gaussians.color.values().0);
        Ok(())
    }

    /// Draws a region of a view, in bands where it has more entries than fit into a binding.
    fn draw(&mut self, v: usize, region: Region) -> Result<(), GpuError> {
        let (.., extent) = self.call;
        self.prepare();
        let [seen, entries, rejected] = self.project(v, region)?;
        if region == extent.region {
            self.stats.splats += seen as usize;
            self.stats.entries += entries as usize;
            self.stats.rejected += rejected as usize;
        }
        let most = (self.context.binding_bytes() / MOMENTS).min(MOST_ENTRIES - 1);
        if u64::from(entries) <= most {
            self.composite(entries as usize)?;
            self.workspace.used += 1;
            return Ok(());
        }
        let grid = Grid::of(&region);
        if grid.count[1] == 1 {
            let (needed, found) = (MOMENTS * u64::from(entries), self.context.binding_bytes());
            let what = || format!("{entries} splats in one row of tiles; draw a narrower region");
            self.context.at_most("max_storage_buffer_binding_size", needed, found, what)?;
        }
        let middle = (grid.first[1] + grid.count[1] / 2) * SIDE;
        let bottom = region.y + region.height;
        self.draw(v, Region { height: middle - region.y, ..region })?;
        self.draw(v, Region { y: middle, height: bottom - middle, ..region })
    }

    /// Projects and sorts by depth: splats that some tile sees, entries, rejected Gaussians; zeros where nothing is
    /// waited for.
    fn project(&mut self, v: usize, region: Region) -> Result<[u32; 3], GpuError> {
        let (gaussians, cameras, settings, extent) = self.call;
        let (context, n) = (self.context, extent.gaussians);
        let words = view_words(cameras, v, settings, &gaussians.color, extent, &region);
        let GpuWorkspace { params, color, drawings, used, scratch, staging, profile, .. } = &mut *self.workspace;
        let drawing = &mut drawings[*used];
        (drawing.view, drawing.region) = (v, Some(region));
        let need = SPLAT * n as u64;
        context.at_most("max_storage_buffer_binding_size", need, context.binding_bytes(), || format!("{n} splats"))?;
        drawing.splats.storage(context, "splats", n, SPLAT)?;
        drawing.first.storage(context, "places of entries", n + 1, 4)?;
        drawing.rank.storage(context, "places of Gaussians", n, 4)?;
        let Scratch { keys, ids, tiles, sums, totals, sort, .. } = scratch;
        for room in keys.iter_mut().chain(ids.iter_mut()).chain([&mut *tiles]) {
            room.storage(context, "depth keys", n, 4)?;
        }
        // One more place, where the last Gaussian's entries end.
        let groups = (n + 1).div_ceil(SUM_GROUP);
        sums.storage(context, "sums of tiles", groups, 12)?;
        totals.storage(context, "totals", 3, 4)?;

        let waits = !matches!(self.end, End::Later(..));
        let mut passes = match &mut self.end {
            End::Later(encoder) => Passes::into(context, encoder),
            _ => Passes::new(context, profile.as_mut()),
        };
        for share in shares(context, extent) {
            let view = uniform(context, &with_share(words, share));
            let bindings = [
                (0, view.as_entire_binding()),
                (1, of_share(params, share, PARAMS)),
                (2, of_share(color, share, 4 * extent.color_len as u64)),
                (3, drawing.splats.all()),
                (4, keys[0].all()),
                (5, ids[0].all()),
                (6, tiles.all()),
            ];
            passes.run(Kernel::Project, share.count.div_ceil(GROUP), &bindings);
        }
        let (from, to) = (Pairs { keys: &keys[0], values: &ids[0] }, Pairs { keys: &keys[1], values: &ids[1] });
        // An even number of passes: the result is where the keys were.
        sort.encode(context, &mut passes, (n, 32), from, to)?;
        let length = uniform(context, &[n as u32, groups as u32, 0, 0]);
        let length = || (0, length.as_entire_binding());
        let (ids, tiles) = ((1, ids[0].all()), (2, tiles.all()));
        passes.run(Kernel::SumGroups, groups, &[length(), ids.clone(), tiles.clone(), (3, sums.all())]);
        passes.run(Kernel::ScanGroups, 1, &[length(), (3, sums.all()), (4, totals.all())]);
        let places = [(3, sums.all()), (5, drawing.first.all()), (6, drawing.rank.all())];
        passes.run(Kernel::Place, groups, &[&[length(), ids, tiles], &places[..]].concat());
        if !waits {
            return Ok([0; 3]);
        }
        let read = passes.read(staging, &[(totals.buffer(), 12)])?;
        let words = read.as_chunks::<4>().0;
        Ok([0, 1, 2].map(|i| u32::from_le_bytes(words[i])))
    }

    /// Lists the entries by tile and blends them; `entries` is their number, or the room for them.
    fn composite(&mut self, entries: usize) -> Result<(), GpuError> {
        let (gaussians, cameras, settings, extent) = self.call;
        let context = self.context;
        let GpuWorkspace { drawings, used, scratch, staging, profile, .. } = &mut *self.workspace;
        let drawing = &mut drawings[*used];
        let region = drawing.region.unwrap_or(extent.region);
        let words = view_words(cameras, drawing.view, settings, &gaussians.color, extent, &region);
        drawing.entries = entries;
        let tiles = Grid::of(&region).tiles();
        let Scratch { tile_of, entry: spare, ids, sort, .. } = scratch;
        for room in [&mut drawing.owners, &mut drawing.entry, &mut *spare].into_iter().chain(tile_of.iter_mut()) {
            room.storage(context, "entries", entries, 4)?;
        }
        drawing.starts.storage(context, "lists of tiles", tiles + 2, 4)?;
        drawing.pixels.storage(context, "pixels", region.pixels(), 20)?;

        // The tile behind the last is a key, too. An odd number of passes ends where it did not begin.
        let bits = usize::BITS - tiles.leading_zeros();
        let even = RadixSort::passes(bits).is_multiple_of(2);
        let (kept, other) =
            (Pairs { keys: &tile_of[0], values: &drawing.entry }, Pairs { keys: &tile_of[1], values: &*spare });
        let (from, to) = if even { (kept, other) } else { (other, kept) };
        let view = uniform(context, &with_capacity(words, entries));
        let view = || (0, view.as_entire_binding());
        let comes_back = matches!(self.end, End::Host);
        let mut passes = match &mut self.end {
            End::Later(encoder) => Passes::into(context, encoder),
            _ => Passes::new(context, profile.as_mut()),
        };
        let bindings = [
            view(),
            (1, drawing.splats.all()),
            (2, ids[0].all()),
            (3, drawing.first.all()),
            (4, from.keys.all()),
            (5, from.values.all()),
            (6, drawing.owners.all()),
        ];
        // The rest of the room belongs to no tile, and is filled even where there are no Gaussians.
        passes.run(Kernel::Emit, extent.gaussians.div_ceil(GROUP).max(entries.min(1)), &bindings);
        sort.encode(context, &mut passes, (entries, bits), from, to)?;
        let lists = uniform(context, &[entries as u32, tiles as u32, 0, 0]);
        let bindings = [(0, lists.as_entire_binding()), (1, kept.keys.all()), (2, drawing.starts.all())];
        passes.run(Kernel::Start, (entries + 1).div_ceil(GROUP), &bindings);
        let bindings = [
            view(),
            (1, drawing.splats.all()),
            (2, drawing.owners.all()),
            (3, drawing.entry.all()),
            (4, drawing.starts.all()),
            (5, drawing.pixels.all()),
        ];
        passes.run(Kernel::Composite, tiles, &bindings);
        if !comes_back {
            return passes.submit();
        }
        let read = passes.read(staging, &[(drawing.pixels.buffer(), 20 * region.pixels() as u64)])?;
        drawing.drawn.clear();
        drawing.drawn.extend(read.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)));
        Ok(())
    }
}

/// The numbers of a share of the Gaussians, `each` bytes per Gaussian.
pub(crate) fn of_share(room: &Room, share: Share, each: u64) -> wgpu::BindingResource<'_> {
    room.part(each * share.first as u64, each * share.count as u64)
}
