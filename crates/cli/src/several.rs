//! Several devices for one picture or batch of rays: `--device all`, `--device 0,2`, `--device gpu+cpu`.

use super::explain::Chooser;
use super::loss::LossArgs;
use super::open::{self, Loaded};
use super::{DeviceArgs, Talk};
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::choose::Chosen;
use raybrook::low_level::device::{DeviceHandle, DeviceKind, select_several};
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::several::{DeviceTracer, Devices, OpenTracer};
use raybrook::low_level::stats::RunStats;
use raybrook::low_level::tracer::{Backend, DeviceShare, LostDevice, Task};
use raybrook::{Error, Result};
use std::sync::Arc;

/// The devices that are asked for, one or more; `None` is the reference.
///
/// # Errors
/// As [`open::choose`], and [`Error::Option`] when a device is named twice.
pub fn choose(args: &DeviceArgs, talk: Talk) -> Result<Vec<Option<DeviceHandle>>> {
    let devices = match args.device.as_deref() {
        None => vec![open::choose(args, talk)?],
        Some(text) => {
            let selected = select_several(text)?.into_iter();
            selected.map(|selection| open::taken(selection, args, talk)).collect::<Result<_>>()?
        }
    };
    Ok(devices.into_iter().map(|device| device.map(DeviceHandle::ask_host)).collect())
}

/// The structures that several devices share where their choices agree.
pub struct Built<'a> {
    loaded: &'a Loaded,
    devices: &'a [Option<DeviceHandle>],
    chosen: &'a [Chosen],
    structures: Vec<(TraceOptions, Arc<SceneBuffers>)>,
}

impl<'a> Built<'a> {
    /// Builds what was chosen for each device.
    ///
    /// # Errors
    /// There is no memory for a structure.
    pub fn new(
        loaded: &'a Loaded,
        (devices, chosen): (&'a [Option<DeviceHandle>], &'a [Chosen]),
        budget: &MemoryBudget,
    ) -> Result<Built<'a>> {
        let mut structures: Vec<(TraceOptions, Arc<SceneBuffers>)> = Vec::new();
        for Chosen { options, .. } in chosen {
            if !structures.iter().any(|(known, _)| known == options) {
                structures.push((*options, Arc::new(SceneBuffers::within(&loaded.scene, options, budget)?)));
            }
        }
        Ok(Built { loaded, devices, chosen, structures })
    }

    /// The structure of the first device.
    pub fn first(&self) -> &Arc<SceneBuffers> {
        &self.structures[0].1
    }

    /// The devices, to be opened for `task` and chains of up to `depth` rays, and the reference where it is to take
    /// what they leave.
    ///
    /// # Errors
    /// The cache's folder has no name.
    pub fn devices(&self, args: &DeviceArgs, (task, depth): (Task, u32), loss: LossArgs) -> Result<Devices<'a>> {
        let cache = args.cache()?;
        let tracer = |device: Option<DeviceHandle>, options: TraceOptions| {
            let found = self.structures.iter().find(|(known, _)| *known == options);
            let (buffers, cache) = (found.map(|(_, buffers)| buffers.clone()), cache.clone());
            let is_processor = DeviceKind::is_processor(device.as_ref().map(|device| device.info.kind));
            let name = device.as_ref().map_or("reference".to_owned(), |device| device.info.name.clone());
            let open = move || {
                let buffers = buffers.ok_or_else(|| Error::Scene("a structure is missing".to_owned()))?;
                let mut tracer = open_tracer(device.as_ref(), &buffers, &options, depth, cache.as_ref())?;
                tracer.prepare(task)?;
                Ok((buffers, OpenTracer::Own(tracer)))
            };
            DeviceTracer { name, is_processor, open: Box::new(open) }
        };
        let all = self.devices.iter().zip(self.chosen);
        let devices = all.map(|(device, chosen)| tracer(device.clone(), chosen.options)).collect();
        let needs_none = loss.is_strict() || self.devices.iter().any(Option::is_none);
        let last_resort = (!needs_none).then(|| tracer(None, self.chosen[0].options));
        Ok(Devices { devices, last_resort })
    }

    /// What is told of a run.
    pub fn stats(&self, shares: Vec<DeviceShare>, lost: Vec<LostDevice>) -> RunStats {
        let names: Vec<&str> = shares.iter().map(|share| share.name.as_str()).collect();
        RunStats {
            device: names.join(" + "),
            device_kind: "several".to_owned(),
            shares,
            lost,
            options: self.chosen[0].options,
            choices: self.chosen[0].decisions.clone(),
            spatial_splits: self.first().splits_chosen,
            load_s: Some(self.loaded.load_s),
            build_s: Some(self.structures.iter().map(|(_, buffers)| buffers.build_s).sum()),
            triangle_count: self.loaded.scene.triangle_count() as u64,
            ..RunStats::default()
        }
    }
}

/// Does something with the first of the devices that can, before they share their work; its tracer is kept for that. A
/// device that fails is told of when they do. `None`: none can.
///
/// # Errors
/// Those of `work` that are none of a device.
pub fn with_first<T>(
    devices: &mut Devices,
    mut work: impl FnMut(&mut dyn Backend, &SceneBuffers) -> Result<T>,
) -> Result<Option<T>> {
    for device in &mut devices.devices {
        let open = std::mem::replace(&mut device.open, Box::new(|| Err(Error::Stopped)));
        let failed = match open() {
            Ok((buffers, mut tracer)) => match work(tracer.tracer(), &buffers) {
                Ok(done) => {
                    device.open = Box::new(move || Ok((buffers, tracer)));
                    return Ok(Some(done));
                }
                Err(error) => {
                    if error.is_lost_device() {
                        // A driver that failed may hang in the release of what is left.
                        std::mem::forget(tracer);
                    }
                    error
                }
            },
            Err(error) => error,
        };
        if !failed.is_of_device() {
            return Err(failed);
        }
        device.open = Box::new(move || Err(failed));
    }
    Ok(None)
}

/// What is chosen for each device; where hits are not exact, for all what is chosen for the first, so that they have
/// the same bits.
///
/// # Errors
/// As [`Chooser::choose`].
pub fn choose_methods(chooser: &Chooser, devices: &[Option<DeviceHandle>], loaded: &Loaded) -> Result<Vec<Chosen>> {
    let of_device = |device: &Option<DeviceHandle>| Chooser { device: device.as_ref(), ..*chooser }.choose(loaded);
    let mut chosen = devices.iter().map(of_device).collect::<Result<Vec<_>>>()?;
    if let Some((first, others)) = chosen.split_first_mut()
        && !first.options.is_exact()
    {
        others.iter_mut().for_each(|other| other.options = first.options);
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use raybrook::low_level::scene::Scene;

    #[test]
    fn the_first_that_can_works_ahead_and_stays_open() {
        let options = TraceOptions::default();
        let buffers = Arc::new(SceneBuffers::new(&Scene::default(), &options).unwrap());
        let (opened, no_device) = (std::cell::Cell::new(0), || Error::NoDevice("gone".to_owned()));
        let good = |name: &str| {
            let (buffers, name) = (buffers.clone(), name.to_owned());
            let open = move || Ok((buffers.clone(), OpenTracer::Own(open_tracer(None, &buffers, &options, 1, None)?)));
            DeviceTracer { name, is_processor: true, open: Box::new(open) }
        };
        let bad =
            DeviceTracer { name: "bad".to_owned(), is_processor: false, open: Box::new(move || Err(no_device())) };
        let mut devices = Devices { devices: vec![bad, good("first"), good("second")], last_resort: None };
        // A device that fails at its work is no better than one that cannot be opened.
        let mut fails = [true, false].into_iter();
        let ahead = with_first(&mut devices, |tracer, _| {
            opened.set(opened.get() + 1);
            if fails.next() == Some(true) { Err(no_device()) } else { Ok(tracer.options().structure) }
        });
        assert_eq!((ahead.unwrap(), opened.get()), (Some(options.structure), 2));
        let open: Vec<bool> = devices.devices.into_iter().map(|device| (device.open)().is_ok()).collect();
        assert_eq!(open, [false, false, true]);
        assert!(with_first(&mut Devices { devices: vec![], last_resort: None }, |_, _| Ok(())).unwrap().is_none());
        let mut devices = Devices { devices: vec![good("first")], last_resort: None };
        let stopped = with_first(&mut devices, |_, _| Err::<(), _>(Error::Stopped));
        assert!(matches!(stopped, Err(Error::Stopped)));
    }
}
