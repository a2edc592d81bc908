//! What a device says about itself: data that choices are made by, without OpenCL.

use crate::parallel::rays_in_caches;
use serde::Serialize;
use std::fmt;

/// What a device is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum DeviceKind {
    /// A graphics processor.
    Gpu,
    /// The host's processor.
    Cpu,
    /// Something else that computes, such as an FPGA.
    Accelerator,
    /// None of these, or several at once, as a simulator may be.
    Other,
}

impl DeviceKind {
    /// The name as the user types it.
    pub fn name(self) -> &'static str {
        match self {
            DeviceKind::Gpu => "gpu",
            DeviceKind::Cpu => "cpu",
            DeviceKind::Accelerator => "accelerator",
            DeviceKind::Other => "other",
        }
    }

    /// Whether the host's processor computes: a device of that kind, or the reference (`None`).
    pub fn is_processor(kind: Option<DeviceKind>) -> bool {
        kind.is_none_or(|kind| kind == DeviceKind::Cpu)
    }
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The name of PoCL's platform.
const POCL: &str = "Portable Computing Language";
/// The variable that switches PoCL's own store of compiled kernels off, if it is 0.
const POCL_KERNEL_CACHE: &str = "POCL_KERNEL_CACHE";

/// What a device says about itself. A number that the driver does not tell is 0, a text is empty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeviceInfo {
    /// Number on this computer, counted from 0 through all platforms in the order of their names; `--device` takes it.
    pub index: usize,
    /// Name of the driver, such as `Portable Computing Language`.
    pub platform_name: String,
    /// Version of the driver, such as `OpenCL 3.0 PoCL 3.1`.
    pub platform_version: String,
    /// Name of the device.
    pub name: String,
    /// What it is.
    pub kind: DeviceKind,
    /// Who made it.
    pub vendor: String,
    /// Version of the driver's device part.
    pub driver_version: String,
    /// Newest OpenCL C, such as `OpenCL C 1.2`.
    pub opencl_c_version: String,
    /// Compute units: cores of a CPU, multiprocessors of a GPU.
    pub compute_units: u32,
    /// Highest clock, MHz.
    pub clock_mhz: u32,
    /// Memory, bytes.
    pub global_memory_bytes: u64,
    /// Largest single buffer, bytes.
    pub max_alloc_bytes: u64,
    /// Largest constant buffer, bytes.
    pub constant_memory_bytes: u64,
    /// Local memory of a work-group, bytes.
    pub local_memory_bytes: u64,
    /// Most work items in a work-group.
    pub max_work_group_size: usize,
    /// It computes in `double`.
    pub fp64: bool,
    /// It reads images.
    pub images: bool,
    /// Most texels of an image made from a buffer.
    pub image1d_buffer_max_texels: usize,
    /// Widest 2D image, texels.
    pub image2d_max_width: usize,
    /// Highest 2D image, texels.
    pub image2d_max_height: usize,
    /// Its compiler tells what kernels take of it (`cl_nv_compiler_options`).
    pub nvidia_options: bool,
    /// NVIDIA's generation, major and minor (`cl_nv_device_attribute_query`).
    pub compute_capability: [u32; 2],
    /// Registers of a compute unit, 32 bits each (`cl_nv_device_attribute_query`).
    pub registers: u32,
    /// Kernels that take long may be ended, or keep a display from being drawn: a GPU of which the driver does not tell
    /// that it has no such limit (`cl_nv_device_attribute_query`).
    pub limits_kernel_time: bool,
    /// It has sub-groups.
    pub subgroups: bool,
    /// `float` division and square root can be rounded correctly, so that pictures agree with the reference to the last
    /// bit.
    pub correctly_rounded_divide_sqrt: bool,
    /// `float` keeps numbers too small for full precision.
    pub denormals: bool,
    /// `fma` on `float` is fast.
    pub fast_fma: bool,
    /// The lowest byte comes first.
    pub little_endian: bool,
    /// Step of the clock that times kernels, nanoseconds.
    pub profiling_timer_resolution_ns: usize,
    /// Why raybrook cannot use it; `None` if it can.
    pub unusable: Option<String>,
}

impl DeviceInfo {
    /// Whether raybrook can use the device.
    pub fn is_usable(&self) -> bool {
        self.unusable.is_none()
    }

    /// Whether its memory is the host's.
    pub(crate) fn shares_host_memory(&self) -> bool {
        self.kind == DeviceKind::Cpu
    }

    /// The most pixels of a picture that it is best given at a time. A processor is sooner done with few, each time in
    /// the same memory, than with a film that its caches do not hold.
    pub(crate) fn pixels_at_a_time(&self) -> u64 {
        match self.shares_host_memory() {
            // On two cores pictures of 2^24 pixels took .90 of the time of parts of 2^23, with four samples .92.
            true => 4 * rays_in_caches() as u64,
            false => u64::MAX,
        }
    }

    /// Whether the driver is PoCL.
    pub(crate) fn is_pocl(&self) -> bool {
        self.platform_name == POCL
    }

    /// Whether the driver keeps compiled kernels by itself: PoCL does, unless `POCL_KERNEL_CACHE` is 0.
    pub fn keeps_kernels(&self) -> bool {
        self.is_pocl() && std::env::var_os(POCL_KERNEL_CACHE).is_none_or(|value| value != "0")
    }
}

/// A device for tests that need no OpenCL.
#[cfg(test)]
pub(crate) fn sample_info() -> DeviceInfo {
    const GIB: u64 = 1 << 30;
    DeviceInfo {
        index: 0,
        platform_name: "Sample platform".to_owned(),
        platform_version: "OpenCL 3.0".to_owned(),
        name: "Sample device".to_owned(),
        kind: DeviceKind::Gpu,
        vendor: "Sample vendor".to_owned(),
        driver_version: "1.0".to_owned(),
        opencl_c_version: "OpenCL C 1.2".to_owned(),
        compute_units: 8,
        clock_mhz: 1500,
        global_memory_bytes: 8 * GIB,
        max_alloc_bytes: 2 * GIB,
        constant_memory_bytes: 65_536,
        local_memory_bytes: 32_768,
        max_work_group_size: 1024,
        fp64: true,
        images: true,
        image1d_buffer_max_texels: 65_536,
        image2d_max_width: 16_384,
        image2d_max_height: 16_384,
        nvidia_options: false,
        compute_capability: [0, 0],
        registers: 0,
        limits_kernel_time: true,
        subgroups: false,
        correctly_rounded_divide_sqrt: true,
        denormals: true,
        fast_fma: true,
        little_endian: true,
        profiling_timer_resolution_ns: 1,
        unusable: None,
    }
}
