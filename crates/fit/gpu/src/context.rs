//! An open device with its shaders compiled.

use crate::adapter::{Adapter, Choice, Kind, all, described};
use crate::error::GpuError;
use crate::shader::{Kernel, SHADERS, Shader};
use std::sync::{Arc, Mutex, PoisonError};

/// An open device, its queue, and all passes compiled for it. Cloning shares them.
#[derive(Clone, Debug)]
pub struct Context {
    device: wgpu::Device,
    queue: wgpu::Queue,
    adapter: Adapter,
    pipelines: Arc<[wgpu::ComputePipeline]>,
    fault: Fault,
}

/// The text that is compiled of a shader.
type Source = dyn Fn(&Shader) -> String;

/// The driver's report since the last check.
type Fault = Arc<Mutex<Option<String>>>;

fn report(fault: &Fault, message: String) {
    // The first is the cause, the rest follow from it.
    fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
}

impl Context {
    /// Opens an adapter with the largest buffers that it offers, and compiles the shaders.
    ///
    /// # Errors
    ///
    /// No such adapter, one that offers less than WebGPU promises, one that refuses to be opened, or a shader.
    pub fn open(choice: &Choice) -> Result<Self, GpuError> {
        let (adapter, handle) = find(choice)?;
        let offered = handle.limits();
        let limits = wgpu::Limits {
            max_buffer_size: offered.max_buffer_size,
            max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
            ..wgpu::Limits::default()
        };
        Self::opened(adapter, &handle, limits, &Shader::source)
    }

    /// The same with these limits, such as [`wgpu::Limits::default`], which WebGPU promises everywhere.
    ///
    /// # Errors
    ///
    /// As for [`open`](Self::open).
    pub fn open_with(choice: &Choice, limits: wgpu::Limits) -> Result<Self, GpuError> {
        Self::open_edited(choice, limits, &Shader::source)
    }

    /// On a device that is open already, such as a viewer's: its limits hold, and its errors go to its own handler.
    ///
    /// # Errors
    ///
    /// A shader that is refused.
    pub fn on(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, GpuError> {
        let adapter = described(0, adapter);
        let pipelines = compile(&device, &adapter, &Shader::source)?;
        Ok(Self { device, queue, adapter, pipelines, fault: Fault::default() })
    }

    /// The same with other texts in place of the shaders': tests show with it that a wrong shader is noticed.
    ///
    /// # Errors
    ///
    /// As for [`open`](Self::open).
    #[doc(hidden)]
    pub fn open_edited(choice: &Choice, limits: wgpu::Limits, source: &Source) -> Result<Self, GpuError> {
        let (adapter, handle) = find(choice)?;
        Self::opened(adapter, &handle, limits, source)
    }

    fn opened(
        adapter: Adapter,
        handle: &wgpu::Adapter,
        limits: wgpu::Limits,
        source: &Source,
    ) -> Result<Self, GpuError> {
        let mut short = None;
        limits.check_limits_with_fail_fn(&handle.limits(), true, |limit, needed, found| {
            short.get_or_insert((limit, needed, found));
        });
        if let Some((limit, needed, found)) = short {
            let what = "every device of WebGPU has as much".into();
            return Err(GpuError::Limit { adapter: adapter.to_string(), limit, found, needed, what });
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("weaver-gpu"),
            required_features: handle.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: limits,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(handle.request_device(&descriptor))
            .map_err(|error| GpuError::Refused { adapter: adapter.to_string(), message: error.to_string() })?;
        let fault = Fault::default();
        let (lost, failed) = (fault.clone(), fault.clone());
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                report(&lost, format!("the device is lost: {message}"));
            }
        });
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| report(&failed, error.to_string())));
        let pipelines = compile(&device, &adapter, source)?;
        Ok(Self { device, queue, adapter, pipelines, fault })
    }

    /// The adapter.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// The device, for buffers and shaders of an embedder.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    pub(crate) fn pipeline(&self, kernel: Kernel) -> &wgpu::ComputePipeline {
        &self.pipelines[kernel as usize]
    }

    /// Bytes of a buffer that a shader may see.
    pub(crate) fn binding_bytes(&self) -> u64 {
        self.device.limits().max_storage_buffer_binding_size.min(self.device.limits().max_buffer_size)
    }

    /// An error where the adapter allows less than `needed` of a limit, for `what`.
    pub(crate) fn at_most(
        &self,
        limit: &'static str,
        needed: u64,
        found: u64,
        what: impl Fn() -> String,
    ) -> Result<(), GpuError> {
        if needed <= found {
            return Ok(());
        }
        Err(GpuError::Limit { adapter: self.adapter.to_string(), limit, found, needed, what: what() })
    }

    /// The driver's report since the last call, as an error.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        match self.fault.lock().unwrap_or_else(PoisonError::into_inner).take() {
            None => Ok(()),
            Some(message) => Err(self.failure(message)),
        }
    }

    pub(crate) fn failure(&self, message: impl Into<String>) -> GpuError {
        GpuError::Failed { adapter: self.adapter.to_string(), message: message.into() }
    }
}

fn compile(
    device: &wgpu::Device,
    adapter: &Adapter,
    source: &Source,
) -> Result<Arc<[wgpu::ComputePipeline]>, GpuError> {
    let compiled = SHADERS.iter().map(|shader| {
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let internal = device.push_error_scope(wgpu::ErrorFilter::Internal);
        let text = wgpu::ShaderSource::Wgsl(source(shader).into());
        let descriptor = wgpu::ShaderModuleDescriptor { label: Some(shader.entry), source: text };
        let module = device.create_shader_module(descriptor);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(shader.entry),
            layout: None,
            module: &module,
            entry_point: Some(shader.entry),
            // Shaders set the memory that they read.
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..wgpu::PipelineCompilationOptions::default()
            },
            cache: None,
        });
        let inner = pollster::block_on(internal.pop());
        match pollster::block_on(scope.pop()).or(inner) {
            None => Ok(pipeline),
            Some(error) => {
                Err(GpuError::Shader { file: shader.file(), adapter: adapter.to_string(), message: error.to_string() })
            }
        }
    });
    compiled.collect()
}

/// The adapter that a choice means.
///
/// # Errors
///
/// When there is none; the error lists the adapters.
fn find(choice: &Choice) -> Result<(Adapter, wgpu::Adapter), GpuError> {
    let all = all();
    let found: Vec<Adapter> = all.iter().enumerate().map(|(number, adapter)| described(number, adapter)).collect();
    let number = match choice {
        Choice::Fastest => [Kind::Discrete, Kind::Integrated, Kind::Virtual]
            .into_iter()
            .find_map(|kind| found.iter().position(|adapter| adapter.kind == kind)),
        Choice::Number(number) => (*number < found.len()).then_some(*number),
        Choice::Name(name) => {
            let part = name.to_lowercase();
            found.iter().position(|adapter| !part.is_empty() && adapter.name.to_lowercase().contains(&part))
        }
    };
    let chosen = number.and_then(|number| all.into_iter().nth(number).map(|adapter| (number, adapter)));
    match chosen {
        Some((number, adapter)) => Ok((found[number].clone(), adapter)),
        None => Err(GpuError::NoAdapter { asked: choice.to_string(), found }),
    }
}
