//! How long each pass takes, by the device's own clock.

use crate::context::Context;
use crate::error::GpuError;
use crate::room::mapped;
use std::time::Duration;

/// Time of the passes of one name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PassTime {
    /// The pass, by the function in its shader.
    pub name: &'static str,
    /// Number of its runs.
    pub runs: usize,
    /// Time of all runs together.
    pub time: Duration,
}

/// Passes that are measured together at most; each takes two times.
const MOST: u32 = 1024;

/// Times of passes, collected where the adapter has a clock.
#[derive(Debug)]
pub(crate) struct Profile {
    times: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    read: wgpu::Buffer,
    /// Nanoseconds per tick.
    period: f32,
    /// The passes since the last submission.
    names: Vec<&'static str>,
    passes: Vec<PassTime>,
}

impl Profile {
    /// `None` where the adapter has no clock.
    pub fn new(context: &Context) -> Option<Self> {
        let device = context.device();
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let buffer = |usage| {
            let size = u64::from(2 * MOST) * 8;
            device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
        };
        Some(Self {
            times: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MOST,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            read: buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
            period: context.queue().get_timestamp_period(),
            names: Vec::new(),
            passes: Vec::new(),
        })
    }

    /// Destination of the next pass's times; none when there are too many.
    pub fn next(&mut self, name: &'static str) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let at = 2 * self.names.len() as u32;
        if at >= 2 * MOST {
            return None;
        }
        self.names.push(name);
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.times,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        })
    }

    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        let count = 2 * self.names.len() as u32;
        if count > 0 {
            encoder.resolve_query_set(&self.times, 0..count, &self.resolved, 0);
            encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.read, 0, u64::from(count) * 8);
        }
    }

    /// Waits for the passes since the last call, and adds their times.
    pub fn collect(&mut self, context: &Context) -> Result<(), GpuError> {
        let bytes = mapped(context, &self.read, 16 * self.names.len() as u64)?;
        let ticks = bytes.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes));
        let ticks: Vec<u64> = ticks.collect();
        for (name, time) in self.names.drain(..).zip(ticks.as_chunks::<2>().0) {
            let taken = (time[1].saturating_sub(time[0]) as f64 * f64::from(self.period)).round();
            let time = Duration::from_nanos(taken as u64);
            match self.passes.iter_mut().find(|pass| pass.name == name) {
                Some(pass) => (pass.runs, pass.time) = (pass.runs + 1, pass.time + time),
                None => self.passes.push(PassTime { name, runs: 1, time }),
            }
        }
        Ok(())
    }

    /// The times so far, which start anew.
    pub fn take(&mut self) -> Vec<PassTime> {
        std::mem::take(&mut self.passes)
    }
}
