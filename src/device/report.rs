//! What `raybrook devices` shows, for people and as JSON.

use super::list::DeviceList;
use super::{Problem, Selection};
use crate::device_info::DeviceInfo;
use serde::Serialize;
use std::fmt::Write;

/// The list of devices for people; the one that is taken by default has a star.
pub fn devices_report(list: &DeviceList) -> String {
    report(&list.infos().collect::<Vec<_>>(), default_index(list), list)
}

/// The list of devices as JSON: `devices`, `default` (an index or null), `empty_platforms`, `problems`.
pub fn devices_json(list: &DeviceList) -> String {
    #[derive(Serialize)]
    struct Report<'a> {
        devices: Vec<&'a DeviceInfo>,
        default: Option<usize>,
        empty_platforms: &'a [String],
        problems: &'a [Problem],
    }
    let report = Report {
        devices: list.infos().collect(),
        default: default_index(list),
        empty_platforms: &list.empty_platforms,
        problems: &list.diagnosis.problems,
    };
    serde_json::to_string_pretty(&report).expect("strings, numbers and lists are always JSON")
}

fn default_index(list: &DeviceList) -> Option<usize> {
    match list.select(None) {
        Ok(Selection::OpenCl(handle)) => Some(handle.info.index),
        _ => None,
    }
}

fn report(infos: &[&DeviceInfo], default: Option<usize>, list: &DeviceList) -> String {
    let mut text = String::new();
    if infos.is_empty() {
        text += "No OpenCL device. `device = reference` works everywhere, slowly.\n";
    } else {
        text += "   #  kind         units    MHz      memory   max buffer  device\n";
    }
    for info in infos {
        let star = if default == Some(info.index) { '*' } else { ' ' };
        let _ = writeln!(
            text,
            "{star}{:>3}  {:<11}  {:>5}  {:>5}  {:>10}  {:>11}  {}",
            info.index,
            info.kind,
            info.compute_units,
            info.clock_mhz,
            bytes(info.global_memory_bytes),
            bytes(info.max_alloc_bytes),
            info.name
        );
        for line in details(info) {
            let _ = writeln!(text, "      {line}");
        }
    }
    if default.is_some() {
        text += "* is taken unless `device` or RAYBROOK_DEVICE says otherwise.\n";
    }
    for platform in &list.empty_platforms {
        let _ = writeln!(text, "The driver '{platform}' offers no device.");
    }
    for problem in &list.diagnosis.problems {
        let _ = writeln!(text, "Problem: {}\n  to mend it: {}", problem.what, problem.remedy);
    }
    text
}

fn details(info: &DeviceInfo) -> Vec<String> {
    let yes = |value: bool| if value { "yes" } else { "no" };
    let images = match info.images {
        true => format!(
            "{}x{} or {} texels of a buffer",
            info.image2d_max_width, info.image2d_max_height, info.image1d_buffer_max_texels
        ),
        false => "no".to_owned(),
    };
    let mut lines = vec![
        format!(
            "{}, {}, driver {}, {}",
            info.platform_name, info.platform_version, info.driver_version, info.opencl_c_version
        ),
        format!(
            "constant {}, local {}, work-group {}, images {images}",
            bytes(info.constant_memory_bytes),
            bytes(info.local_memory_bytes),
            info.max_work_group_size
        ),
        format!(
            "exact division and root {}, denormals {}, fast fma {}, double {}, sub-groups {}, clock step {} ns",
            yes(info.correctly_rounded_divide_sqrt),
            yes(info.denormals),
            yes(info.fast_fma),
            yes(info.fp64),
            yes(info.subgroups),
            info.profiling_timer_resolution_ns
        ),
    ];
    lines.extend(info.unusable.as_ref().map(|reason| format!("NOT USABLE: {reason}")));
    lines
}

/// A size in the largest binary unit that leaves at least 1.
fn bytes(value: u64) -> String {
    const UNITS: [&str; 4] = ["GiB", "MiB", "KiB", "B"];
    const STEP: u64 = 1024;
    let mut size = STEP.pow(3);
    for unit in UNITS {
        if value >= size || size == 1 {
            let whole = value.is_multiple_of(size);
            return if whole {
                format!("{} {unit}", value / size)
            } else {
                format!("{:.1} {unit}", value as f64 / size as f64)
            };
        }
        size /= STEP;
    }
    unreachable!("the last unit takes every value")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Diagnosis;
    use crate::device_info::sample_info;

    #[test]
    fn sizes_are_readable() {
        for (value, expected) in [
            (0, "0 B"),
            (1023, "1023 B"),
            (65_536, "64 KiB"),
            (1_500_000, "1.4 MiB"),
            (141 << 30, "141 GiB"),
            (1 << 45, "32768 GiB"),
        ] {
            assert_eq!(bytes(value), expected);
        }
    }

    #[test]
    fn the_report_shows_devices_the_default_and_problems() {
        let good = sample_info();
        let bad = DeviceInfo { index: 1, unusable: Some("it is big endian".to_owned()), ..sample_info() };
        let problem = Problem { what: "something is missing".to_owned(), remedy: "install it".to_owned() };
        let list = DeviceList {
            empty_platforms: vec!["rusticl".to_owned()],
            diagnosis: Diagnosis { problems: vec![problem] },
            ..DeviceList::default()
        };
        let text = report(&[&good, &bad], Some(0), &list);
        for expected in [
            "*  0  gpu              8   1500       8 GiB        2 GiB  Sample device\n",
            "   1  gpu",
            "NOT USABLE: it is big endian",
            "* is taken unless",
            "The driver 'rusticl' offers no device.",
            "Problem: something is missing\n  to mend it: install it\n",
        ] {
            assert!(text.contains(expected), "'{expected}' is not in\n{text}");
        }
    }

    #[test]
    fn a_computer_without_devices_has_a_report_too() {
        let list = DeviceList { diagnosis: Diagnosis::of_missing_loader(), ..DeviceList::default() };
        assert!(devices_report(&list).starts_with("No OpenCL device."));
        let json: serde_json::Value = serde_json::from_str(&devices_json(&list)).unwrap();
        assert_eq!(json["devices"].as_array().unwrap().len(), 0);
        assert!(json["default"].is_null());
        assert_eq!(json["problems"].as_array().unwrap().len(), 1);
    }
}
