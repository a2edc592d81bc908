//! What a device takes where nobody asks for anything. Each function returns its reason with the choice.

use super::{DeviceInfo, DeviceKind};
use crate::options::Decisions;

/// The rays of a work-group on `device`, and why.
///
/// CPU runtimes run a work-group as a loop on one thread and keep its private arrays at once: small groups stay in
/// cache.
pub(crate) fn work_group_size(device: &DeviceInfo) -> (usize, String) {
    let (size, reason) = match device.kind {
        DeviceKind::Gpu => (64, "the device is a GPU, which fills its lanes from one work-group".to_owned()),
        kind => (16, format!("the device is of kind {kind}: what a small work-group keeps stays in cache")),
    };
    match device.max_work_group_size.max(1) {
        most if most < size => (most, format!("the device has no larger ones (it would be {size}: {reason})")),
        _ => (size, reason),
    }
}

/// Who decides what is traced next of pictures by their error on `device`, and why.
pub(crate) fn who_decides(decisions: Decisions, device: &DeviceInfo) -> (Decisions, String) {
    match decisions {
        Decisions::Auto if device.kind != DeviceKind::Gpu => {
            (Decisions::Host, format!("the device is of kind {}: the host's cores do it as fast", device.kind))
        }
        // Decisions, and with them pixels, would be others than elsewhere.
        Decisions::Auto if !device.correctly_rounded_divide_sqrt => {
            (Decisions::Host, "the device does not round divisions and roots as the host does".to_owned())
        }
        Decisions::Auto => (Decisions::Device, "the device is a GPU, which would wait for the host".to_owned()),
        given => (given, "as asked for".to_owned()),
    }
}
