//! Several devices for one picture: `--device all`, `--device 0,2`, `--device gpu+cpu`.

use super::explain::Chooser;
use super::keep::Keeper;
use super::open::{self, Loaded};
use super::{DeviceArgs, Talk};
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::choose::Chosen;
use raybrook::low_level::device::{DeviceHandle, DeviceKind, list_devices};
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, Renderer, open_tracer};
use raybrook::low_level::stats::RunStats;
use raybrook::low_level::tracer::{RenderResult, Task};
use raybrook::{Error, Result};
use std::collections::HashSet;
use std::sync::Arc;

/// Every device; of processors only where there is nothing else, because they take the cores that a GPU's thread needs.
const ALL: &str = "all";

/// The devices that are asked for, one or more; `None` is the reference.
///
/// # Errors
/// As [`open::choose`], and [`Error::Option`] when a device is named twice.
pub fn choose(args: &DeviceArgs, talk: Talk) -> Result<Vec<Option<DeviceHandle>>> {
    let Some(text) = args.device.as_deref() else { return Ok(vec![open::choose(args, talk)?]) };
    if text == ALL {
        return choose_all(args, talk);
    }
    let names: Vec<&str> = text.split([',', '+']).map(str::trim).collect();
    if names.len() == 1 {
        return Ok(vec![open::choose(args, talk)?]);
    }
    let list = list_devices()?;
    // A name of a device may have a comma, too.
    if let Ok(one) = list.select(Some(text)) {
        return Ok(vec![open::taken(one, args, talk)?]);
    }
    let devices = names.iter().map(|name| open::taken(list.select(Some(name))?, args, talk));
    let devices = devices.collect::<Result<Vec<_>>>()?;
    let mut seen = HashSet::new();
    let twice = devices.iter().zip(&names).find(|(device, _)| !seen.insert(device.as_ref().map(|d| d.info.index)));
    match twice {
        Some((_, name)) => Err(Error::option("--device", format!("'{name}' is a device that was named before"))),
        None => Ok(devices),
    }
}

fn choose_all(args: &DeviceArgs, talk: Talk) -> Result<Vec<Option<DeviceHandle>>> {
    let usable = list_devices()?.devices.into_iter().filter(|device| device.info.unusable.is_none());
    let (processors, others): (Vec<_>, Vec<_>) = usable.partition(|device| device.info.kind == DeviceKind::Cpu);
    let chosen = if others.is_empty() { processors } else { others };
    let devices = chosen.into_iter().map(|device| args.compiler.apply(device).map(Some)).collect::<Result<Vec<_>>>()?;
    if devices.is_empty() { Ok(vec![open::choose_best(args, talk)?]) } else { Ok(devices) }
}

/// Renders what `keeper` has not kept yet by several devices, each of which has what was chosen for it.
///
/// # Errors
/// As [`Keeper::render_by`]; and there is no memory for a structure.
pub fn render(
    keeper: &mut Keeper,
    loaded: &Loaded,
    (devices, args): (&[Option<DeviceHandle>], &DeviceArgs),
    chosen: &[Chosen],
    (picture, budget): (&Picture, &MemoryBudget),
    talk: Talk,
) -> Result<(RenderResult, RunStats)> {
    let mut built: Vec<(TraceOptions, Arc<SceneBuffers>)> = Vec::new();
    for Chosen { options, .. } in chosen {
        if !built.iter().any(|(known, _)| known == options) {
            built.push((*options, Arc::new(SceneBuffers::within(&loaded.scene, options, budget)?)));
        }
    }
    let cache = args.cache()?;
    let renderer = |(device, Chosen { options, .. }): (&Option<DeviceHandle>, &Chosen)| {
        let (device, options, cache) = (device.clone(), *options, cache.clone());
        let buffers = built.iter().find(|(known, _)| *known == options).map(|(_, buffers)| buffers.clone());
        let name = device.as_ref().map_or("reference".to_owned(), |device| device.info.name.clone());
        let open = move || {
            let buffers = buffers.ok_or_else(|| Error::Scene("a structure is missing".to_owned()))?;
            let mut tracer = open_tracer(device.as_ref(), &buffers, &options, picture.depth, cache.as_ref())?;
            tracer.prepare(Task::Picture)?;
            Ok((buffers, tracer))
        };
        Renderer { name, open: Box::new(open) }
    };
    let renderers: Vec<Renderer> = devices.iter().zip(chosen).map(renderer).collect();
    let names: Vec<String> = renderers.iter().map(|renderer| renderer.name.clone()).collect();
    let (result, shares) = keeper.render_by(renderers, picture, talk)?;
    let stats = RunStats {
        device: names.join(" + "),
        device_kind: "several".to_owned(),
        shares,
        options: chosen[0].options,
        choices: chosen[0].decisions.clone(),
        load_s: Some(loaded.load_s),
        build_s: Some(built.iter().map(|(_, buffers)| buffers.build_s).sum()),
        triangle_count: loaded.scene.triangle_count() as u64,
        ..RunStats::default()
    };
    Ok((result, stats))
}

/// What is chosen for each device.
///
/// # Errors
/// As [`Chooser::choose`].
pub fn choose_methods(chooser: &Chooser, devices: &[Option<DeviceHandle>], loaded: &Loaded) -> Result<Vec<Chosen>> {
    let of_device = |device: &Option<DeviceHandle>| Chooser { device: device.as_ref(), ..*chooser }.choose(loaded);
    devices.iter().map(of_device).collect()
}
