//! Which device `--device` means.

use super::context::{DeviceContext, DeviceHandle};
use super::list::{DeviceList, list_devices};
use crate::device_info::{DeviceInfo, DeviceKind};
use crate::error::{Error, Result};
use std::collections::HashSet;

/// The word that asks for the scalar reference instead of a device.
const REFERENCE: &str = "reference";

/// The word that asks for every device.
const ALL: &str = "all";

/// A number from here on that is no index is part of a name, such as 4090.
const LEAST_MODEL_NUMBER: usize = 100;

/// What traces the rays.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)]
pub enum Selection {
    /// An OpenCL device.
    OpenCl(DeviceHandle),
    /// The scalar reference on the host.
    Reference {
        /// Why nothing faster was taken, in one line for the user; `None` if the reference was asked for.
        notice: Option<String>,
    },
}

/// The device that `spec` means: a number of the list, part of a device's or driver's name, `cpu`, `gpu` or
/// `reference`.
///
/// `None` takes the GPU with the most compute units x clock, else the CPU with the most compute units, else the
/// reference.
///
/// # Errors
/// [`Error::NoDevice`] names what was asked for and what there is; [`Error::OpenCl`] when the loader fails.
pub fn select(spec: Option<&str>) -> Result<Selection> {
    if spec.is_some_and(|spec| spec.trim().eq_ignore_ascii_case(REFERENCE)) {
        // Without a look at the drivers, so that it works where one of them hangs or crashes.
        return Ok(Selection::Reference { notice: None });
    }
    list_devices()?.select(spec)
}

/// The devices that `spec` means: `all`, or names as in [`select`], with commas or plus signs between them. `all` are
/// those that are no processor, because a GPU's thread needs the processor's cores; processors where there is nothing
/// else; and what [`select`] takes of itself where no device is usable.
///
/// # Errors
/// As [`select`], and [`Error::Option`] when a device is named twice.
pub fn select_several(spec: &str) -> Result<Vec<Selection>> {
    if spec.trim().eq_ignore_ascii_case(ALL) {
        return list_devices()?.select_all();
    }
    let names: Vec<&str> = spec.split([',', '+']).map(str::trim).collect();
    if names.len() == 1 {
        return Ok(vec![select(Some(spec))?]);
    }
    let list = list_devices()?;
    // A name of a device may have a comma, too.
    if let Ok(one) = list.select(Some(spec)) {
        return Ok(vec![one]);
    }
    let selected = names.iter().map(|name| list.select(Some(name))).collect::<Result<Vec<_>>>()?;
    let index = |selection: &Selection| match selection {
        Selection::OpenCl(device) => Some(device.info.index),
        Selection::Reference { .. } => None,
    };
    let mut seen = HashSet::new();
    match selected.iter().zip(&names).find(|(selection, _)| !seen.insert(index(selection))) {
        Some((_, name)) => Err(Error::option("device", format!("'{name}' is a device that was named before"))),
        None => Ok(selected),
    }
}

/// Like [`select`], where the choice is left to it, among the devices that open: with one line for the user of each
/// that was passed over. The device that is taken is open already.
///
/// # Errors
/// Those of [`select`], where a device was asked for.
pub fn select_working(spec: Option<&str>) -> Result<(Selection, Vec<String>)> {
    if spec.is_some() {
        return Ok((select(spec)?, Vec::new()));
    }
    let mut list = match list_devices() {
        Ok(list) => list,
        Err(error) => {
            let notice = Some(format!("tracing with the slow scalar reference, as the OpenCL loader failed: {error}"));
            return Ok((Selection::Reference { notice }, Vec::new()));
        }
    };
    let opens = |handle: &DeviceHandle| match DeviceContext::open(handle) {
        Ok(context) => {
            handle.keep_opened(context);
            None
        }
        Err(error) => Some(error.to_string()),
    };
    let mut notes = Vec::new();
    loop {
        let selection = list.select(None)?;
        let Selection::OpenCl(handle) = &selection else { return Ok((selection, notes)) };
        let Some(failure) = opens(handle) else { return Ok((selection, notes)) };
        list.devices[handle.info.index].info.unusable = Some("it does not open".to_owned());
        notes.push(format!("the next best device is taken, as the best does not open: {failure}"));
    }
}

impl DeviceList {
    /// See [`select`]; chooses from this list.
    ///
    /// # Errors
    /// [`Error::NoDevice`] names what was asked for and what there is.
    pub fn select(&self, spec: Option<&str>) -> Result<Selection> {
        let infos: Vec<_> = self.infos().collect();
        match choose(&infos, spec) {
            Ok(Choice::Device(index)) => Ok(Selection::OpenCl(self.devices[index].clone())),
            Ok(Choice::Reference) => Ok(Selection::Reference { notice: None }),
            Ok(Choice::NothingElse) => Ok(Selection::Reference { notice: Some(self.notice()) }),
            Err(message) if infos.is_empty() => {
                Err(Error::NoDevice(format!("{message}: {}", self.diagnosis.summary())))
            }
            Err(message) => Err(Error::NoDevice(message)),
        }
    }

    fn select_all(self) -> Result<Vec<Selection>> {
        let usable = self.devices.iter().filter(|device| device.info.unusable.is_none()).cloned();
        let (processors, others): (Vec<_>, Vec<_>) = usable.partition(|device| device.info.kind == DeviceKind::Cpu);
        let chosen = if others.is_empty() { processors } else { others };
        match chosen.is_empty() {
            true => Ok(vec![self.select(None)?]),
            false => Ok(chosen.into_iter().map(Selection::OpenCl).collect()),
        }
    }

    fn notice(&self) -> String {
        let why = match self.devices.iter().find_map(|d| Some((&d.info.name, d.info.unusable.as_ref()?))) {
            Some((name, reason)) => format!("device '{name}' cannot be used: {reason}"),
            None => self.diagnosis.summary(),
        };
        format!("tracing with the slow scalar reference, as there is no usable OpenCL device: {why}")
    }
}

#[derive(Debug, PartialEq, Eq)]
enum Choice {
    Device(usize),
    /// It was asked for.
    Reference,
    /// Nothing was asked for, and there is no usable device.
    NothingElse,
}

fn choose(infos: &[&DeviceInfo], spec: Option<&str>) -> std::result::Result<Choice, String> {
    let Some(spec) = spec.map(str::trim) else {
        let best = best_of(infos, DeviceKind::Gpu).or_else(|| best_of(infos, DeviceKind::Cpu));
        // An accelerator is better than nothing, but what it is good at is unknown.
        let best = best.or_else(|| infos.iter().position(|info| info.is_usable()));
        return Ok(best.map_or(Choice::NothingElse, Choice::Device));
    };
    let wanted = spec.to_lowercase();
    match wanted.as_str() {
        REFERENCE => Ok(Choice::Reference),
        "" => Err(format!("`device` is empty; {}", what_there_is(infos))),
        "gpu" => best_or_error(infos, DeviceKind::Gpu),
        "cpu" => best_or_error(infos, DeviceKind::Cpu),
        _ => match wanted.parse::<usize>() {
            Ok(index) if index < infos.len() => usable(infos[index]),
            Ok(index) if index < LEAST_MODEL_NUMBER => {
                Err(format!("there is no device {index}; {}", what_there_is(infos)))
            }
            _ => by_name(infos, spec, &wanted),
        },
    }
}

/// How fast a device may be, as far as its description tells: only devices of one kind compare.
fn best_of(infos: &[&DeviceInfo], kind: DeviceKind) -> Option<usize> {
    let score = |info: &DeviceInfo| match kind {
        // CPUs report their clock at the moment of the call.
        DeviceKind::Cpu => u64::from(info.compute_units),
        _ => u64::from(info.compute_units) * u64::from(info.clock_mhz.max(1)),
    };
    let candidates = infos.iter().filter(|info| info.kind == kind && info.is_usable());
    // The first of equals: `max_by_key` would take the last.
    candidates.rev().max_by_key(|info| score(info)).map(|info| info.index)
}

fn best_or_error(infos: &[&DeviceInfo], kind: DeviceKind) -> std::result::Result<Choice, String> {
    if let Some(index) = best_of(infos, kind) {
        return Ok(Choice::Device(index));
    }
    match infos.iter().find(|info| info.kind == kind) {
        Some(info) => usable(info),
        None => Err(format!("no {kind} offers OpenCL; {}", what_there_is(infos))),
    }
}

fn by_name(infos: &[&DeviceInfo], spec: &str, wanted: &str) -> std::result::Result<Choice, String> {
    let names = |info: &DeviceInfo| [info.name.to_lowercase(), info.platform_name.to_lowercase()];
    let matching = |test: &dyn Fn(&str) -> bool| -> Vec<&DeviceInfo> {
        infos.iter().copied().filter(|info| names(info).iter().any(|name| test(name))).collect()
    };
    let exact = matching(&|name| name == wanted);
    let partial = matching(&|name| name.contains(wanted));
    match (&exact[..], &partial[..]) {
        ([only], _) | ([], [only]) => usable(only),
        ([], []) => Err(format!("no device is called '{spec}'; {}", what_there_is(infos))),
        ([], several) | (several, _) => {
            Err(format!("`device` '{spec}' fits several devices, choose one by its number: {}", numbered(several)))
        }
    }
}

fn usable(info: &DeviceInfo) -> std::result::Result<Choice, String> {
    match &info.unusable {
        None => Ok(Choice::Device(info.index)),
        Some(reason) => Err(format!("device '{}' cannot be used: {reason}", info.name)),
    }
}

fn what_there_is(infos: &[&DeviceInfo]) -> String {
    if infos.is_empty() {
        return format!("there is no OpenCL device; '{REFERENCE}' works everywhere");
    }
    format!("there is: {}, {REFERENCE}", numbered(infos))
}

fn numbered(infos: &[&DeviceInfo]) -> String {
    let shown = |info: &&DeviceInfo| {
        let reason = info.unusable.as_ref().map_or(String::new(), |reason| format!("; cannot be used: {reason}"));
        format!("{} = {} ({}{reason})", info.index, info.name, info.kind)
    };
    infos.iter().map(shown).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device_info::sample_info;

    fn sample(index: usize, kind: DeviceKind, name: &str, compute_units: u32, clock_mhz: u32) -> DeviceInfo {
        DeviceInfo { index, kind, name: name.to_owned(), compute_units, clock_mhz, ..sample_info() }
    }

    fn computer() -> Vec<DeviceInfo> {
        let mut infos = vec![
            sample(0, DeviceKind::Gpu, "Iris 550", 48, 1000),
            sample(1, DeviceKind::Gpu, "GeForce RTX 4090", 128, 2500),
            sample(2, DeviceKind::Cpu, "Xeon", 16, 3000),
            sample(3, DeviceKind::Cpu, "Xeon Phi", 64, 1000),
            sample(4, DeviceKind::Gpu, "Broken", 1000, 9000),
        ];
        infos[4].unusable = Some("its driver has no compiler".to_owned());
        infos[1].platform_name = "NVIDIA CUDA".to_owned();
        infos
    }

    #[test]
    fn every_way_to_name_a_device() {
        let infos = computer();
        let infos: Vec<_> = infos.iter().collect();
        for (spec, expected) in [
            (None, Choice::Device(1)),
            (Some("gpu"), Choice::Device(1)),
            (Some("GPU"), Choice::Device(1)),
            (Some("cpu"), Choice::Device(3)),
            (Some("0"), Choice::Device(0)),
            (Some(" 2 "), Choice::Device(2)),
            (Some("4090"), Choice::Device(1)),
            (Some("nvidia"), Choice::Device(1)),
            (Some("iris"), Choice::Device(0)),
            (Some("xeon"), Choice::Device(2)), // exact, although two contain it
            (Some("phi"), Choice::Device(3)),
            (Some("Reference"), Choice::Reference),
        ] {
            assert_eq!(choose(&infos, spec), Ok(expected), "{spec:?}");
        }
    }

    #[test]
    fn errors_name_what_was_asked_and_what_there_is() {
        let infos = computer();
        let infos: Vec<_> = infos.iter().collect();
        for (spec, expected) in [
            ("voodoo", "no device is called 'voodoo'; there is: 0 = Iris 550 (gpu), "),
            ("9", "there is no device 9; there is: "),
            ("-1", "no device is called '-1'; there is: "),
            ("", "`device` is empty; there is: "),
            ("4", "device 'Broken' cannot be used: its driver has no compiler"),
            ("broken", "device 'Broken' cannot be used: its driver has no compiler"),
            (
                "xeo",
                "`device` 'xeo' fits several devices, choose one by its number: 2 = Xeon (cpu), 3 = Xeon Phi (cpu)",
            ),
        ] {
            let message = choose(&infos, Some(spec)).unwrap_err();
            assert!(message.starts_with(expected), "'{spec}': {message}");
        }
        let only_cpu = [infos[2]];
        assert!(choose(&only_cpu, Some("gpu")).unwrap_err().starts_with("no gpu offers OpenCL; there is: "));
    }

    #[test]
    fn what_cannot_be_used_is_listed_with_the_reason() {
        let infos = computer();
        let message = choose(&infos.iter().collect::<Vec<_>>(), Some("voodoo")).unwrap_err();
        assert!(
            message.ends_with("4 = Broken (gpu; cannot be used: its driver has no compiler), reference"),
            "{message}"
        );
    }

    #[test]
    fn without_a_usable_device_the_reference_is_taken_with_a_notice() {
        let infos = computer();
        assert_eq!(choose(&[], None), Ok(Choice::NothingElse));
        assert_eq!(choose(&[&infos[4]], None), Ok(Choice::NothingElse));
        assert!(choose(&[], Some("gpu")).unwrap_err().contains("there is no OpenCL device"));
        assert!(choose(&[], Some("iris")).unwrap_err().contains("'reference' works everywhere"));
    }
}
