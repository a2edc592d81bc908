//! What there is to trace on.

use crate::device::{DeviceKind, list_devices};
use crate::error::Result;

/// An OpenCL device of this computer.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Device {
    /// Its name; a part of it is enough for [`TracerBuilder::device`](crate::TracerBuilder::device).
    pub name: String,
    /// The driver's name.
    pub platform: String,
    /// What it is.
    pub kind: DeviceKind,
    /// Why raybrook cannot use it; `None` for a device that it can use.
    pub unusable: Option<String>,
}

/// The OpenCL devices of this computer; the place of a device is its number for
/// [`TracerBuilder::device`](crate::TracerBuilder::device).
///
/// Without any the list is empty, and rays are traced by the scalar reference.
///
/// # Errors
/// [`Error::OpenCl`](crate::Error::OpenCl) when the OpenCL loader fails in an unexpected way.
pub fn devices() -> Result<Vec<Device>> {
    let device = |info: crate::device::DeviceInfo| Device {
        name: info.name,
        platform: info.platform_name,
        kind: info.kind,
        unusable: info.unusable,
    };
    Ok(list_devices()?.infos().cloned().map(device).collect())
}
