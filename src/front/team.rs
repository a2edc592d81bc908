//! The devices of a tracer: one, or several that share large batches and pictures.

use crate::budget::MemoryBudget;
use crate::device::{Cache, DeviceHandle, DeviceKind};
use crate::error::{Error, Result};
use crate::options::TraceOptions;
use crate::pack::SceneBuffers;
use crate::parallel::{self, lock, unlocked};
use crate::renderer::{FallBack, build_and_open_within, open_tracer};
use crate::scene::Scene;
use crate::several::{DeviceTracer, Devices, OpenTracer, Takeover, Watcher};
use crate::tracer::{Backend, LostDevice, Progress};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// How devices are opened.
pub(super) struct Opening {
    pub options: TraceOptions,
    pub cache: Option<Cache>,
    /// Stops calls.
    pub stop: Option<Arc<AtomicBool>>,
    /// Whether the reference takes the place of the last device that is lost.
    pub falls_back: bool,
}

impl Opening {
    /// `None`: the reference.
    fn open(&self, device: Option<&DeviceHandle>, buffers: &Arc<SceneBuffers>, depth: u32) -> Result<Box<dyn Backend>> {
        Ok(self.stoppable(open_tracer(device, buffers, &self.options, depth, self.cache.as_ref())?))
    }

    /// Refuses to go on where the flag stops calls.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub fn check_stop(&self) -> Result<()> {
        let is_stopped = self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed));
        if is_stopped { Err(Error::Stopped) } else { Ok(()) }
    }

    fn stoppable(&self, mut tracer: Box<dyn Backend>) -> Box<dyn Backend> {
        self.stop.iter().for_each(|stop| tracer.stop_when(stop.clone()));
        tracer
    }
}

/// A device.
struct Member {
    /// `None`: the reference.
    device: Option<DeviceHandle>,
    /// Gone while it is opened anew.
    tracer: Option<Box<dyn Backend>>,
    /// Whether the reference takes its place once it is lost.
    is_guarded: bool,
}

impl Member {
    fn new(device: Option<DeviceHandle>) -> Member {
        Member { device, tracer: None, is_guarded: false }
    }

    fn name(&self) -> &str {
        match (&self.tracer, &self.device) {
            (Some(tracer), _) => tracer.device_name(),
            (None, Some(device)) => &device.info.name,
            (None, None) => "reference",
        }
    }

    /// The device that was lost, where the reference has taken its place.
    fn lost(&self) -> Option<&LostDevice> {
        self.tracer.as_ref()?.lost()
    }

    /// A driver that failed may hang in the release of what is left.
    fn forget(self) {
        std::mem::forget(self.tracer);
    }
}

/// The devices of a tracer, at least one. What is not shared, the first does, and where it fails the next.
pub(super) struct Team {
    members: Vec<Member>,
    opening: Opening,
    notes: Vec<String>,
}

impl Team {
    /// Of devices that are opened later; `None` is the reference.
    pub fn new(devices: Vec<Option<DeviceHandle>>, opening: Opening, notes: Vec<String>) -> Team {
        Team { members: devices.into_iter().map(Member::new).collect(), opening, notes }
    }

    pub fn is_several(&self) -> bool {
        self.members.len() > 1
    }

    /// How many devices there are.
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// How devices are opened.
    pub fn opening(&self) -> &Opening {
        &self.opening
    }

    /// The first device; `None` is the reference, or that it has taken the place of one that was lost.
    pub fn device(&self) -> Option<&DeviceHandle> {
        let first = &self.members[0];
        first.device.as_ref().filter(|_| first.lost().is_none())
    }

    /// The names of all.
    pub fn name(&self) -> String {
        self.members.iter().map(Member::name).collect::<Vec<_>>().join(" + ")
    }

    /// What a curious user should know.
    pub fn notes(&self) -> Vec<String> {
        let tracers = self.members.iter().filter_map(|member| member.tracer.as_ref());
        let lost = self.members.iter().filter_map(Member::lost).map(by_reference);
        self.notes.iter().chain(tracers.flat_map(|tracer| tracer.notes())).cloned().chain(lost).collect()
    }

    /// Builds the structure of a scene, while the first device is opened, and opens the others.
    ///
    /// # Errors
    /// As [`build_and_open_within`]; of devices where none can be opened.
    pub fn build(&mut self, scene: &Scene, depth: u32, budget: &MemoryBudget) -> Result<Arc<SceneBuffers>> {
        let Opening { options, cache, .. } = &self.opening;
        let first = self.members[0].device.as_ref();
        match build_and_open_within(first, scene, options, depth, cache.as_ref(), &[], budget) {
            Ok((buffers, tracer)) => {
                self.members[0].tracer = Some(self.opening.stoppable(tracer));
                self.open(&buffers, depth)?;
                Ok(buffers)
            }
            Err(error) if self.is_several() && error.is_of_device() => {
                self.leave(0, &error);
                self.build(scene, depth, budget)
            }
            Err(error) => Err(error),
        }
    }

    /// Whether some device is to be opened.
    pub fn is_closed(&self) -> bool {
        self.members.iter().any(|member| member.tracer.is_none())
    }

    /// Opens the devices that are not. Those that cannot be are left out.
    ///
    /// # Errors
    /// As [`open_tracer`], where that fails for another reason, or no device can be opened.
    pub fn open(&mut self, buffers: &Arc<SceneBuffers>, depth: u32) -> Result<()> {
        let (opening, several) = (&self.opening, self.is_several());
        let closed: Vec<_> = self.members.iter_mut().filter(|member| member.tracer.is_none()).collect();
        let opened = parallel::map(closed.into_iter(), |member| {
            let tracer = opening.open(member.device.as_ref(), buffers, depth)?;
            member.tracer = Some(tracer);
            Ok(())
        });
        let still_closed = self.members.iter().enumerate().filter(|(_, member)| member.tracer.is_none());
        let mut failed = Vec::new();
        for ((number, _), error) in still_closed.zip(opened.into_iter().filter_map(Result::err)) {
            match several && error.is_of_device() {
                true => failed.push((number, error)),
                false => return Err(error),
            }
        }
        if failed.len() == self.members.len()
            && let Some((_, error)) = failed.pop()
        {
            return Err(error);
        }
        failed.iter().rev().for_each(|(number, error)| self.leave(*number, error));
        self.guard_the_last(buffers);
        Ok(())
    }

    /// Lets go of what traces.
    pub fn close(&mut self) {
        for member in &mut self.members {
            member.is_guarded = false;
            if let Some(lost) = member.tracer.take().and_then(|tracer| tracer.lost().cloned()) {
                // It is not opened again.
                member.device = None;
                self.notes.push(by_reference(&lost));
            }
        }
    }

    /// Has one device do something, the first that does not fail in that.
    ///
    /// # Errors
    /// Those of `work`, of the last device if all fail.
    pub fn alone<T>(
        &mut self,
        buffers: &Arc<SceneBuffers>,
        mut work: impl FnMut(&mut dyn Backend) -> Result<T>,
    ) -> Result<T> {
        loop {
            let first = self.members[0].tracer.as_mut().expect("it was opened");
            match work(first.as_mut()) {
                Err(error) if self.is_several() && error.is_lost_device() => {
                    self.leave(0, &error);
                    self.guard_the_last(buffers);
                }
                other => return other,
            }
        }
    }

    /// Has all devices share some work. Where one fails the others go on, or, if that is wanted, the reference where
    /// none is left.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn share<T>(
        &mut self,
        (buffers, depth): (&Arc<SceneBuffers>, u32),
        progress: Progress,
        work: impl FnOnce(Devices, &dyn Watcher) -> Result<T>,
    ) -> Result<T> {
        let watching = Watching { progress, done: AtomicU64::new(0), lost: Mutex::default() };
        let (opening, has_reference) = (&self.opening, self.members.iter().any(|member| member.device.is_none()));
        let devices = self.members.iter_mut().map(|member| {
            let (name, kind) = (member.name().to_owned(), member.device.as_ref().map(|device| device.info.kind));
            let tracer = OpenTracer::Lent(member.tracer.as_mut().expect("it was opened").as_mut());
            let open = move || Ok((buffers.clone(), tracer));
            DeviceTracer { name, is_processor: DeviceKind::is_processor(kind), open: Box::new(open) }
        });
        let last_resort = (opening.falls_back && !has_reference).then(|| {
            let open = move || Ok((buffers.clone(), OpenTracer::Own(opening.open(None, buffers, depth)?)));
            DeviceTracer { name: "reference".to_owned(), is_processor: true, open: Box::new(open) }
        });
        let done = work(Devices { devices: devices.collect(), last_resort }, &watching);
        let mut lost = unlocked(watching.lost);
        for (number, error, takeover) in &lost {
            let lost = LostDevice { device: self.members[*number].name().to_owned(), error: error.to_string() };
            self.notes.push(if *takeover == Takeover::OtherDevices { by_others(&lost) } else { by_reference(&lost) });
        }
        // Each by its place, as long as nothing before it is removed.
        lost.sort_unstable_by_key(|(number, ..)| *number);
        for (number, _, takeover) in lost.into_iter().rev() {
            match takeover {
                Takeover::OtherDevices => self.members.remove(number).forget(),
                Takeover::LastResort => {
                    let tracer = Some(self.opening.open(None, buffers, depth)?);
                    std::mem::replace(&mut self.members[number], Member { tracer, ..Member::new(None) }).forget();
                }
            }
        }
        self.guard_the_last(buffers);
        done
    }

    /// Goes on without a device, which failed.
    fn leave(&mut self, number: usize, error: &Error) {
        let member = self.members.remove(number);
        self.notes.push(by_others(&LostDevice { device: member.name().to_owned(), error: error.to_string() }));
        member.forget();
    }

    /// Has the reference take the place of the only device that is left, once that is lost, if it is wanted.
    fn guard_the_last(&mut self, buffers: &Arc<SceneBuffers>) {
        if let [member] = &mut self.members[..]
            && self.opening.falls_back
            && member.device.is_some()
            && !member.is_guarded
            && let Some(tracer) = member.tracer.take()
        {
            member.is_guarded = true;
            member.tracer = Some(self.opening.stoppable(Box::new(FallBack::new(tracer, buffers, Box::new(|_| ())))));
        }
    }
}

fn by_others(lost: &LostDevice) -> String {
    format!("the other devices trace in place of '{}', which failed: {}", lost.device, lost.error)
}

fn by_reference(lost: &LostDevice) -> String {
    format!("the reference traces in place of '{}', which failed: {}", lost.device, lost.error)
}

/// Tells how far several devices are, and takes note of those that fail.
struct Watching<'a> {
    progress: Progress<'a>,
    /// The bits of the part that is done.
    done: AtomicU64,
    lost: Mutex<Vec<(usize, Error, Takeover)>>,
}

impl Watcher for Watching<'_> {
    fn progress(&self, done: f64) {
        // Bits of numbers that are not negative are in the order of the numbers.
        self.done.fetch_max(done.to_bits(), Ordering::Relaxed);
        self.is_over();
    }

    /// Between launches whoever is told of the progress may stop the work, too: by unwinding.
    fn is_over(&self) -> bool {
        (self.progress)(f64::from_bits(self.done.load(Ordering::Relaxed)));
        false
    }

    fn lost(&self, (number, _): (usize, &str), error: Error, takeover: Takeover) -> Result<()> {
        lock(&self.lost).push((number, error, takeover));
        Ok(())
    }
}
