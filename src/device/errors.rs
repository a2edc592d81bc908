//! OpenCL's error codes: their names, and what to do about the ones that a tracer meets.

use crate::error::Error;
use opencl3::error_codes::{ClError, error_text};

/// opencl3's own code for "the OpenCL loader library could not be loaded".
pub(super) const NO_LOADER: i32 = -2000;
/// The loader found no usable driver (ICD).
pub(super) const NO_PLATFORM: i32 = -1001;
/// The driver has no such device.
pub(super) const NOT_FOUND: i32 = -1;
/// The compiler refused the source.
const BUILD_FAILURE: i32 = -11;

/// What the log of a command that failed long ago may say on NVIDIA: a code that no header names.
const NVIDIA_ILLEGAL_ACCESS: i32 = -9999;

/// The code's name and number, such as `CL_OUT_OF_RESOURCES (-5)`.
pub fn code_name(code: i32) -> String {
    match code {
        NVIDIA_ILLEGAL_ACCESS => format!("illegal memory access by a kernel ({code})"),
        NO_LOADER => format!("no OpenCL loader library ({code})"),
        -2001 => format!("the OpenCL loader lacks this function ({code})"),
        _ => format!("{} ({code})", error_text(code)),
    }
}

/// What usually lies behind `code` and what to do; empty where the name says it all.
pub fn code_hint(code: i32) -> &'static str {
    match code {
        -2 => "the device is in use or was lost; try again, or choose another with `device`",
        -3 => "this OpenCL driver has no compiler for the device; choose another with `device`",
        -4 => "the device has not enough free memory; close other programs that use it, or use `device = reference`",
        -5 => {
            "the device ran out of resources: a kernel was stopped (a display driver's time limit), or memory is short"
        }
        -6 => "this computer ran out of memory",
        -7 => "the event has no times: the command failed or the queue does not profile",
        BUILD_FAILURE => "the device's compiler refused the kernels",
        -14 => "an earlier command that this one waited for failed",
        -36 | -34 => "the device was lost, usually by a kernel that crashed; start again",
        -42 => "the binary is not for this device or driver; use `no_cache`",
        -43 => "the driver does not know one of the build options",
        -45 => "the program was not built for this device",
        -46 => "the program has no kernel of that name",
        -52..=-48 => "the kernel's arguments do not fit; this is a bug in raybrook, please report it",
        -54 | -55 => "the work-group does not fit the kernel on this device",
        -61 => "the buffer is larger than the device's largest single allocation",
        -63 => "the number of work items is zero or more than the device can count",
        NO_PLATFORM => "no OpenCL driver (ICD) is installed; apt-get install pocl-opencl-icd",
        NO_LOADER => "apt-get install ocl-icd-libopencl1",
        NVIDIA_ILLEGAL_ACCESS => "a kernel read or wrote outside a buffer; this is a bug in raybrook, please report it",
        _ => "",
    }
}

/// An [`Error::OpenCl`] for a call that failed on `device`; `call` says which call and what it was asked to do.
pub fn cl_error(device: &str, call: &str, error: ClError) -> Error {
    cl_error_with_hint(device, call, error.0, code_hint(error.0))
}

/// Like [`cl_error`], where the caller knows more than the code says, such as the limit that was met.
pub(super) fn cl_error_with_hint(device: &str, call: &str, code: i32, hint: impl Into<String>) -> Error {
    Error::OpenCl { device: device.into(), call: call.into(), code: code_name(code), hint: hint.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_names_device_call_code_and_remedy() {
        let text = cl_error("toaster", "clFinish of the render kernel", ClError(-5)).to_string();
        assert!(
            text.starts_with("device 'toaster': clFinish of the render kernel failed: CL_OUT_OF_RESOURCES (-5) ("),
            "{text}"
        );
        assert_eq!(code_name(-2000), "no OpenCL loader library (-2000)");
        assert_eq!(code_name(-12345), "UNKNOWN_ERROR (-12345)");
    }

    #[test]
    fn an_error_without_a_hint_has_no_empty_brackets() {
        assert!(cl_error("toaster", "clFoo", ClError(-30)).to_string().ends_with("CL_INVALID_VALUE (-30)"));
    }
}
