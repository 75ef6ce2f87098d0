//! Copies between the host and the device.

use crate::context::Context;
use crate::room::Room;

/// Bytes that were copied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Transfers {
    /// From the host to the device.
    pub to_device: u64,
    /// From the device to the host.
    pub from_device: u64,
}

/// Room for numbers on their way to the host, and a count of all that went either way.
#[derive(Debug, Default)]
pub(crate) struct Staging {
    pub room: Room,
    pub transfers: Transfers,
}

impl Staging {
    /// Brings numbers to the beginning of a room on the device, before the next submission.
    pub fn write<T: bytemuck::NoUninit>(&mut self, context: &Context, to: &Room, numbers: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(numbers);
        context.queue().write_buffer(to.buffer(), 0, bytes);
        self.transfers.to_device += bytes.len() as u64;
    }
}
