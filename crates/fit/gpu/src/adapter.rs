//! The adapters of this machine, and how one is chosen.

use std::fmt;
use std::str::FromStr;

/// A device that shaders can run on, as the driver describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Adapter {
    /// Its place in the list of all, which `gpu:N` refers to.
    pub number: usize,
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: Kind,
    /// The interface that it is used through: `vulkan`, `metal`.
    pub backend: String,
    /// The driver and its version.
    pub driver: String,
    /// Bytes of one buffer that a shader may see.
    pub binding_bytes: u64,
    /// Threads that run in step, the smallest and the largest number.
    pub subgroups: [u32; 2],
}

/// Kind of an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A card with memory of its own.
    Discrete,
    /// A part of the processor.
    Integrated,
    /// A share of a card.
    Virtual,
    /// A program on the processor.
    Software,
    /// The driver does not say.
    Other,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Kind::Discrete => "discrete",
            Kind::Integrated => "integrated",
            Kind::Virtual => "virtual",
            Kind::Software => "software",
            Kind::Other => "other",
        })
    }
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {}, {})", self.name, self.kind, self.backend, self.driver)
    }
}

/// Choice of an adapter.
///
/// ```
/// use weaver_gpu::Choice;
/// assert_eq!("gpu".parse(), Ok(Choice::Fastest));
/// assert_eq!("gpu:1".parse(), Ok(Choice::Number(1)));
/// assert_eq!("radeon".parse(), Ok(Choice::Name("radeon".into())));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Choice {
    /// The first discrete one, else integrated, else virtual; never a software one.
    Fastest,
    /// The one with this number.
    Number(usize),
    /// The first whose name contains this, in upper or lower case.
    Name(String),
}

impl FromStr for Choice {
    type Err = std::convert::Infallible;

    /// `gpu`, `gpu:N`, or a part of a name.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let number = text.strip_prefix("gpu:").and_then(|number| number.parse().ok());
        Ok(match number {
            _ if text == "gpu" => Choice::Fastest,
            Some(number) => Choice::Number(number),
            None => Choice::Name(text.into()),
        })
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Choice::Fastest => f.write_str("gpu"),
            Choice::Number(number) => write!(f, "gpu:{number}"),
            Choice::Name(name) => f.write_str(name),
        }
    }
}

/// All adapters of this machine, software ones included; none without a driver.
pub fn adapters() -> Vec<Adapter> {
    all().iter().enumerate().map(|(number, adapter)| described(number, adapter)).collect()
}

/// All adapters of wgpu.
pub(crate) fn all() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    // Checks of the driver's own are for those who write drivers.
    descriptor.flags = wgpu::InstanceFlags::empty();
    let instance = wgpu::Instance::new(descriptor);
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY))
}

/// Description of it for the user.
pub(crate) fn described(number: usize, adapter: &wgpu::Adapter) -> Adapter {
    let info = adapter.get_info();
    Adapter {
        number,
        name: info.name,
        kind: match info.device_type {
            wgpu::DeviceType::DiscreteGpu => Kind::Discrete,
            wgpu::DeviceType::IntegratedGpu => Kind::Integrated,
            wgpu::DeviceType::VirtualGpu => Kind::Virtual,
            wgpu::DeviceType::Cpu => Kind::Software,
            wgpu::DeviceType::Other => Kind::Other,
        },
        backend: info.backend.to_str().into(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().into(),
        binding_bytes: adapter.limits().max_storage_buffer_binding_size,
        subgroups: [info.subgroup_min_size, info.subgroup_max_size],
    }
}
