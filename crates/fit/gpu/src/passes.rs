//! Passes recorded one behind the other, then run at once.

use crate::context::Context;
use crate::error::GpuError;
use crate::profile::Profile;
use crate::room::mapped;
use crate::shader::{Kernel, SHADERS};
use crate::staging::Staging;

/// Passes that are being recorded.
pub(crate) struct Passes<'a> {
    context: &'a Context,
    encoder: Encoder<'a>,
    profile: Option<&'a mut Profile>,
}

/// The encoder of passes.
enum Encoder<'a> {
    Own(wgpu::CommandEncoder),
    /// An embedder's, who submits it.
    Theirs(&'a mut wgpu::CommandEncoder),
}

impl Encoder<'_> {
    fn get(&mut self) -> &mut wgpu::CommandEncoder {
        match self {
            Self::Own(encoder) => encoder,
            Self::Theirs(encoder) => encoder,
        }
    }
}

/// Work groups along one dimension that every device allows.
const ACROSS: u32 = 65_535;

impl<'a> Passes<'a> {
    pub fn new(context: &'a Context, profile: Option<&'a mut Profile>) -> Self {
        let encoder = context.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        Self { context, encoder: Encoder::Own(encoder), profile }
    }

    /// Passes of an embedder's, who submits them.
    pub fn into(context: &'a Context, encoder: &'a mut wgpu::CommandEncoder) -> Self {
        Self { context, encoder: Encoder::Theirs(encoder), profile: None }
    }

    /// Records a pass of so many work groups; none is no pass. Bindings are by their numbers in the shader.
    pub fn run(&mut self, kernel: Kernel, groups: usize, bindings: &[(u32, wgpu::BindingResource<'_>)]) {
        if groups == 0 {
            return;
        }
        let pipeline = self.context.pipeline(kernel);
        let entries: Vec<wgpu::BindGroupEntry<'_>> = bindings
            .iter()
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
            .collect();
        let bind_group = self.context.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let name = SHADERS[kernel as usize].entry;
        let timestamp_writes = self.profile.as_mut().and_then(|profile| profile.next(name));
        let descriptor = wgpu::ComputePassDescriptor { label: Some(name), timestamp_writes };
        let mut pass = self.encoder.get().begin_compute_pass(&descriptor);
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        // Folded into two dimensions where one would not do.
        let groups = u32::try_from(groups).unwrap_or(u32::MAX);
        pass.dispatch_workgroups(groups.min(ACROSS), groups.div_ceil(ACROSS), 1);
    }

    /// Runs the recorded passes; an embedder's own wait for its submission.
    pub fn submit(mut self) -> Result<(), GpuError> {
        if let Some(profile) = &mut self.profile {
            profile.resolve(self.encoder.get());
        }
        if let Encoder::Own(encoder) = self.encoder {
            self.context.queue().submit([encoder.finish()]);
        }
        match self.profile {
            Some(profile) => profile.collect(self.context),
            None => self.context.check(),
        }
    }

    /// Runs the recorded passes, and reads the first bytes of some buffers, one behind the other.
    pub fn read(mut self, staging: &mut Staging, parts: &[(&wgpu::Buffer, u64)]) -> Result<Vec<u8>, GpuError> {
        let bytes = parts.iter().map(|(_, bytes)| bytes).sum();
        staging.room.read(self.context, bytes)?;
        let mut at = 0;
        for (buffer, bytes) in parts.iter().filter(|(_, bytes)| *bytes > 0) {
            self.encoder.get().copy_buffer_to_buffer(buffer, 0, staging.room.buffer(), at, *bytes);
            at += bytes;
        }
        let context = self.context;
        self.submit()?;
        staging.transfers.from_device += bytes;
        mapped(context, staging.room.buffer(), bytes)
    }
}
