//! Every OpenCL device of this computer, with what matters to a tracer.

use super::context::{DeviceHandle, lock_runtime};
use super::diagnosis::{Diagnosis, Problem};
use super::errors::{NOT_FOUND, cl_error, code_name};
use super::owner::Owner;
use super::watchdog::{Limit, watch};
use crate::device_info::{DeviceInfo, DeviceKind};
use crate::error::Result;
use opencl3::device::{
    CL_DEVICE_TYPE_ACCELERATOR, CL_DEVICE_TYPE_ALL, CL_DEVICE_TYPE_CPU, CL_DEVICE_TYPE_GPU, CL_EXEC_KERNEL,
    CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT, CL_FP_DENORM, CL_FP_FMA, CL_FP_INF_NAN, CL_FP_ROUND_TO_NEAREST, Device,
};
use opencl3::platform::{Platform, get_platforms};

/// The kind that a device says it is.
fn kind_of_bits(bits: u64) -> DeviceKind {
    const KINDS: u64 = CL_DEVICE_TYPE_GPU | CL_DEVICE_TYPE_CPU | CL_DEVICE_TYPE_ACCELERATOR;
    // Only one: Oclgrind, a simulator, claims to be all three, and must not be taken for the fastest GPU.
    match bits & KINDS {
        CL_DEVICE_TYPE_GPU => DeviceKind::Gpu,
        CL_DEVICE_TYPE_CPU => DeviceKind::Cpu,
        CL_DEVICE_TYPE_ACCELERATOR => DeviceKind::Accelerator,
        _ => DeviceKind::Other,
    }
}

/// What there is on this computer.
#[derive(Debug, Clone, Default)]
pub struct DeviceList {
    /// Every device, usable or not; a device's place is its index.
    pub devices: Vec<DeviceHandle>,
    /// Drivers that were found but offer no device.
    pub empty_platforms: Vec<String>,
    /// What is missing, and how to mend it.
    pub diagnosis: Diagnosis,
}

impl DeviceList {
    /// What each device says about itself.
    pub fn infos(&self) -> impl Iterator<Item = &DeviceInfo> {
        self.devices.iter().map(|d| &d.info)
    }
}

/// Every platform's devices. A computer without any is no error: [`DeviceList::diagnosis`] tells what is missing.
///
/// # Errors
/// [`crate::Error::OpenCl`] when the loader fails in an unexpected way.
pub fn list_devices() -> Result<DeviceList> {
    let _lock = lock_runtime();
    let mut list = DeviceList::default();
    // One call may be many of the drivers', which are loaded now.
    let _watched = watch(&Owner::new("none yet"), "clGetPlatformIDs, clGetDeviceIDs or clGetDeviceInfo", Limit::Call);
    let mut platforms = match get_platforms() {
        Ok(platforms) => platforms,
        Err(error) if error.0 == super::errors::NO_LOADER => {
            list.diagnosis = Diagnosis::of_missing_loader();
            return Ok(list);
        }
        Err(error) if error.0 == super::errors::NO_PLATFORM => Vec::new(),
        Err(error) => return Err(cl_error("none yet", "clGetPlatformIDs", error)),
    };

    // Loaders read the drivers in the folder's order or by their own preference: sort for indices that stay the same.
    platforms.sort_by_cached_key(|p| p.name().unwrap_or_default());
    let mut failures = Vec::new();
    for platform in &platforms {
        // A driver whose device list fails (PoCL without its libraries, say) must not hide the others.
        let name = || platform.name().unwrap_or_default().trim().to_owned();
        let devices = platform.get_devices(CL_DEVICE_TYPE_ALL).unwrap_or_else(|error| {
            failures.extend((error.0 != NOT_FOUND).then(|| Problem::of_failed_driver(&name(), &error)));
            Vec::new()
        });
        if devices.is_empty() {
            list.empty_platforms.push(name());
        }
        for id in devices {
            let device = Device::new(id);
            let info = query(list.devices.len(), platform, &device);
            list.devices.push(DeviceHandle::new(info, device));
        }
    }
    list.diagnosis = Diagnosis::of_this_computer(list.infos(), &list.empty_platforms);
    list.diagnosis.problems.splice(0..0, failures);
    Ok(list)
}

/// Answers of a driver that kernels depend on.
#[derive(Default)]
struct Answers {
    /// The first one that failed.
    failure: Option<String>,
}

impl Answers {
    /// An answer that must not fail. A device that does not tell is none to trust: which instructions it gets, and so
    /// which bits come out, hangs on some answers, and the cache knows it by others.
    fn must<T: Default>(&mut self, call: &str, answer: opencl3::Result<T>) -> T {
        answer.unwrap_or_else(|error| {
            self.failure.get_or_insert_with(|| format!("{call} failed: {}", code_name(error.0)));
            T::default()
        })
    }

    fn of_device<T: Default>(&mut self, answer: opencl3::Result<T>) -> T {
        self.must("clGetDeviceInfo", answer)
    }

    fn text(&mut self, answer: opencl3::Result<String>) -> String {
        self.of_device(answer).trim().to_owned()
    }
}

fn query(index: usize, platform: &Platform, device: &Device) -> DeviceInfo {
    let mut answers = Answers::default();
    let single = answers.of_device(device.single_fp_config());
    let images = device.image_support().unwrap_or(false);
    let image_size = |value: opencl3::Result<usize>| if images { value.unwrap_or(0) } else { 0 };
    let extensions = answers.text(device.extensions());
    let has = |name: &str| extensions.split_whitespace().any(|e| e == name);
    let tells_attributes = has("cl_nv_device_attribute_query");
    let kind = kind_of_bits(answers.of_device(device.dev_type()));
    let mut info = DeviceInfo {
        index,
        platform_name: answers.must("clGetPlatformInfo", platform.name()).trim().to_owned(),
        platform_version: answers.must("clGetPlatformInfo", platform.version()).trim().to_owned(),
        name: answers.text(device.name()),
        kind,
        vendor: device.vendor().unwrap_or_default().trim().to_owned(),
        driver_version: answers.text(device.driver_version()),
        opencl_c_version: answers.text(device.opencl_c_version()),
        compute_units: device.max_compute_units().unwrap_or(0),
        clock_mhz: device.max_clock_frequency().unwrap_or(0),
        global_memory_bytes: device.global_mem_size().unwrap_or(0),
        max_alloc_bytes: device.max_mem_alloc_size().unwrap_or(0),
        constant_memory_bytes: device.max_constant_buffer_size().unwrap_or(0),
        local_memory_bytes: device.local_mem_size().unwrap_or(0),
        max_work_group_size: device.max_work_group_size().unwrap_or(0),
        fp64: device.double_fp_config().unwrap_or(0) != 0,
        images,
        image1d_buffer_max_texels: image_size(device.image_max_buffer_size()),
        image2d_max_width: image_size(device.image2d_max_width()),
        image2d_max_height: image_size(device.image2d_max_height()),
        nvidia_options: has("cl_nv_compiler_options"),
        compute_capability: [device.compute_capability_major_nv(), device.compute_capability_minor_nv()]
            .map(|number| number.ok().filter(|_| tells_attributes).unwrap_or(0)),
        registers: device.registers_per_block_nv().ok().filter(|_| tells_attributes).unwrap_or(0),
        limits_kernel_time: kind == DeviceKind::Gpu
            && !(tells_attributes && device.compute_kernel_exec_timeout_nv().is_ok_and(|limit| limit == 0)),
        subgroups: has("cl_khr_subgroups") || has("cl_intel_subgroups") || device.max_num_sub_groups().unwrap_or(0) > 0,
        correctly_rounded_divide_sqrt: single & CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT != 0,
        denormals: single & CL_FP_DENORM != 0,
        fast_fma: single & CL_FP_FMA != 0,
        little_endian: answers.of_device(device.endian_little()),
        profiling_timer_resolution_ns: device.profiling_timer_resolution().unwrap_or(0),
        unusable: None,
    };
    let lack = reason_against(&mut answers, device, &info, single);
    info.unusable = answers.failure.or(lack);
    info
}

/// The first thing that the kernels need and the device lacks.
fn reason_against(answers: &mut Answers, device: &Device, info: &DeviceInfo, single: u64) -> Option<String> {
    let runs_kernels = answers.of_device(device.execution_capabilities()) & CL_EXEC_KERNEL != 0;
    let needs = [
        (answers.of_device(device.available()), "the driver says that it is not available"),
        (answers.of_device(device.compiler_available()), "its driver has no compiler"),
        (info.little_endian, "it is big endian"),
        (runs_kernels, "it runs no kernels"),
        (is_at_least_1_2(&info.opencl_c_version), "it lacks OpenCL C 1.2"),
        (
            single & CL_FP_INF_NAN != 0 && single & CL_FP_ROUND_TO_NEAREST != 0,
            "its arithmetic lacks infinities or rounding to nearest",
        ),
    ];
    needs.into_iter().find(|(fulfilled, _)| !fulfilled).map(|(_, reason)| reason.to_owned())
}

/// Whether `version`, such as `OpenCL C 3.0 vendor's words`, is 1.2 or newer.
fn is_at_least_1_2(version: &str) -> bool {
    let number = version.trim().strip_prefix("OpenCL C ").and_then(|rest| rest.split_whitespace().next());
    let mut parts = number.unwrap_or_default().split('.').map(|part| part.parse::<u32>().unwrap_or(0));
    (parts.next(), parts.next()) >= (Some(1), Some(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_compared_as_numbers() {
        for (version, expected) in [
            ("OpenCL C 1.2 PoCL", true),
            ("OpenCL C 1.2", true),
            ("OpenCL C 3.0 ", true),
            ("OpenCL C 10.0", true),
            ("OpenCL C 1.1", false),
            ("OpenCL C 1.0 old", false),
            ("", false),
            ("nonsense", false),
        ] {
            assert_eq!(is_at_least_1_2(version), expected, "'{version}'");
        }
    }

    #[test]
    fn a_kind_ignores_the_default_bit() {
        assert_eq!(kind_of_bits(1 | CL_DEVICE_TYPE_CPU), DeviceKind::Cpu);
        assert_eq!(kind_of_bits(1 | CL_DEVICE_TYPE_GPU), DeviceKind::Gpu);
        assert_eq!(kind_of_bits(1), DeviceKind::Other);
        assert_eq!(kind_of_bits(CL_DEVICE_TYPE_CPU | CL_DEVICE_TYPE_GPU), DeviceKind::Other);
    }
}
