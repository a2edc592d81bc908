//! What can be chosen of a tracer.

use super::framing::LitScene;
use super::scene::check_indices;
use super::team::{Opening, Team};
use super::tracer::{Chosen, Tracer};
use super::view::{Frame, View};
use crate::budget::MemoryBudget;
use crate::choose::tune::{DeviceKey, TunedFile};
use crate::choose::{Request, Workload};
use crate::device::{Cache, DeviceHandle, Selection, cache_folder, select_several, select_working};
use crate::error::{Error, Result};
use crate::options::Intersector;
use crate::scene::Scene;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// How right hits are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Precision {
    /// Exact: hit or miss, and which triangle is the closest, as exact arithmetic has it; t, u and v are the exact ones
    /// rounded once.
    Exact,
    /// The fastest test in float32 (Möller and Trumbore 1997), which loses some hits at edges. On a CPU it is about as
    /// fast as exact hits.
    Fast,
}

/// Where compiled kernels, and what `raybrook tune` found, are kept.
enum Place {
    Usual,
    Nowhere,
    Folder(PathBuf),
}

/// Makes a [`Tracer`] with choices of one's own; [`Tracer::builder`] begins it.
///
/// ```
/// use raybrook::{Precision, Scene, Tracer};
///
/// let scene = Scene::from_mesh(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
/// let tracer = Tracer::builder(&scene)
///     .device("reference")
///     .method("kd+ropes")
///     .precision(Precision::Exact)
///     .progress(|done| eprintln!("{:.0} %", 100.0 * done))
///     .build()?;
/// assert!(tracer.choices()[0].starts_with("structure kd"));
/// # Ok::<(), raybrook::Error>(())
/// ```
#[must_use]
pub struct TracerBuilder<'a> {
    scene: &'a Scene,
    device: Option<String>,
    method: Option<String>,
    precision: Option<Precision>,
    progress: Option<Box<dyn Fn(f64) + Send + Sync>>,
    stop: Option<Arc<AtomicBool>>,
    falls_back: bool,
    asks_host: bool,
    memory_limit: Option<u64>,
    place: Place,
}

impl<'a> TracerBuilder<'a> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        TracerBuilder {
            scene,
            device: None,
            method: None,
            precision: None,
            progress: None,
            stop: None,
            falls_back: false,
            asks_host: true,
            memory_limit: None,
            place: Place::Usual,
        }
    }

    /// Where to trace: `gpu`, `cpu`, `reference` (scalar code, without OpenCL), a device's number in
    /// [`devices`](crate::devices) or a part of its name. Default: the GPU, CPU or other device that is likely to be
    /// the fastest, else the reference.
    ///
    /// Several, as in `0,2` or `gpu+cpu`, share large batches of rays, which of many points are inside, and pictures,
    /// with the same answers; closest points are found by the first of them. `all` is every GPU, or every other device
    /// where there is none. They trace by the method that is best for the first. One that does not open, or fails in
    /// the middle of the work, is left out, which [`Tracer::notes`] tells; the last one that is left is as a single
    /// one.
    pub fn device(mut self, device: &str) -> Self {
        self.device = Some(device.to_owned());
        self
    }

    /// What to trace with: names of a structure, a build, a traversal and a triangle test, joined by `+`, such as
    /// `bvh8`, `kd+ropes` or `grid+watertight`; `raybrook methods` lists them. Default: the fastest, for parts that are
    /// not named, too. With an exact triangle test the hits are the same whatever the method.
    pub fn method(mut self, method: &str) -> Self {
        self.method = Some(method.to_owned());
        self
    }

    /// The device settles by itself what only exact integers decide, also where the host would do so sooner than its
    /// kernels for that are compiled: see [`ask_host`](crate::low_level::device::DeviceHandle::ask_host).
    #[doc(hidden)]
    pub fn device_alone(mut self) -> Self {
        self.asks_host = false;
        self
    }

    /// How right hits are. Default: [`Precision::Exact`].
    pub fn precision(mut self, precision: Precision) -> Self {
        self.precision = Some(precision);
        self
    }

    /// Called from time to time, while rays are traced, with the part of them that is done, 0 to 1; by any thread.
    /// Default: nothing is called.
    ///
    /// It may unwind ([`resume_unwind`](std::panic::resume_unwind)) to stop the call, which unwinds then. Drop the
    /// tracer after that; [`TracerBuilder::stop`] leaves it as it was.
    pub fn progress(mut self, progress: impl Fn(f64) + Send + Sync + 'static) -> Self {
        self.progress = Some(Box::new(progress));
        self
    }

    /// A flag that stops calls: while it is true, each ends with [`Error::Stopped`] as soon as the device has done what
    /// it was last given, which takes about 20 ms; the reference finishes the rows of a picture that it is in. The
    /// tracer is as good as before. Set it to false again before the next call. Default: nothing stops them.
    pub fn stop(mut self, stop: Arc<AtomicBool>) -> Self {
        self.stop = Some(stop);
        self
    }

    /// Whether the reference goes on where the driver fails in the middle of the work: with the same answers, many
    /// times as slowly, for all that is asked from then on. [`Tracer::notes`] tells of it, and [`Tracer::device_name`]
    /// is `reference` then. What the device had is not released, because a driver that failed may hang in that.
    /// Default: no, the call ends with [`Error::OpenCl`].
    ///
    /// ```
    /// # use raybrook::{Scene, Tracer};
    /// # let scene = Scene::from_mesh(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// let tracer = Tracer::builder(&scene).fall_back(true).build()?;
    /// # Ok::<(), raybrook::Error>(())
    /// ```
    pub fn fall_back(mut self, falls_back: bool) -> Self {
        self.falls_back = falls_back;
        self
    }

    /// The most memory that the process may take, bytes: what would take more is an error before it is taken. Default:
    /// what the process has, and nine tenths of what it can still get.
    pub fn memory_limit(mut self, bytes: u64) -> Self {
        self.memory_limit = Some(bytes);
        self
    }

    /// Whether compiled kernels are kept on disk, and what `raybrook tune` found is used. Default: yes, in
    /// `$RAYBROOK_CACHE_DIR`, else `$XDG_CACHE_HOME/raybrook`, else `~/.cache/raybrook`.
    pub fn cache(mut self, is_used: bool) -> Self {
        self.place = if is_used { Place::Usual } else { Place::Nowhere };
        self
    }

    /// The folder for [`TracerBuilder::cache`]; it is made when something is put into it.
    pub fn cache_folder(mut self, folder: impl Into<PathBuf>) -> Self {
        self.place = Place::Folder(folder.into());
        self
    }

    /// Chooses, opens the device, and builds the structure. Kernels are compiled by the first batch and by the first
    /// picture.
    ///
    /// # Errors
    /// [`Error::NoDevice`] when there is no such device; [`Error::Option`] for an unknown method, or parts that do not
    /// go together; [`Error::Scene`] when a value of the scene is out of range; [`Error::OutOfMemory`] and
    /// [`Error::TooLarge`] when the scene takes too much memory; [`Error::OpenCl`] and [`Error::Hang`] when the driver
    /// fails.
    pub fn build(self) -> Result<Tracer> {
        let request = self.request()?;
        // What is wrong on any device comes before what takes time.
        request.choose(&Workload::without_scene(None), None)?;
        check_indices(self.scene)?;
        self.scene.check_values()?;
        let Frame { size, samples, depth, .. } = View::default().over(&self.scene.picture)?;
        let mut notes = Vec::new();
        let devices = self.select_devices(&mut notes)?;
        let (cache, tuned_folder) = match &self.place {
            Place::Usual => (Cache::open()?, cache_folder()),
            Place::Nowhere => (None, None),
            Place::Folder(folder) => (Some(Cache::at(folder.clone())), Some(folder.clone())),
        };
        let info = devices[0].as_ref().map(|device| &device.info);
        let lit = LitScene::new(self.scene, samples.aspect(size) as f32);
        let workload = Workload::of_scene(info, &lit.scene, true);
        let tuned = tuned_folder.zip(workload.triangle_count).and_then(|(folder, triangle_count)| {
            let found = TunedFile::in_folder(folder).find(&DeviceKey::new(info), triangle_count);
            found.unwrap_or_else(|why| {
                notes.push(why);
                None
            })
        });
        let chosen = request.choose(&workload, tuned.as_ref())?;
        notes.extend(chosen.limit.as_ref().map(|limit| format!("the structure is {}: {limit}", chosen.options.kind())));
        notes.extend(workload.slower_than_exact(&chosen.options));
        let choices = chosen.decisions.iter().map(ToString::to_string).collect();
        let limit = self.memory_limit.map(MemoryBudget::of_bytes);
        let options = chosen.options;
        let TracerBuilder { progress, stop, falls_back, .. } = self;
        let team = Team::new(devices, Opening { options, cache, stop, falls_back }, notes);
        Tracer::open(&lit, depth, team, Chosen { limit, choices, progress })
    }

    /// The method that was asked for, with what is left to be chosen.
    fn request(&self) -> Result<Request> {
        let mut request = Request::default();
        self.method.as_deref().map_or(Ok(()), |method| request.set_method(method))?;
        if let Some(precision) = self.precision {
            let (name, intersector) = match precision {
                Precision::Exact => ("exact", Intersector::Exact),
                Precision::Fast => ("fast", Intersector::FASTEST),
            };
            if let Some(named) = request.intersector() {
                let message = format!("'{name}', but the method names the triangle test '{named}'; leave one out");
                return Err(Error::option("precision", message));
            }
            request.set(Intersector::OPTION, intersector.name())?;
        }
        Ok(request)
    }

    /// One or more; `None` is the reference.
    fn select_devices(&self, notes: &mut Vec<String>) -> Result<Vec<Option<DeviceHandle>>> {
        let selected = match self.device.as_deref() {
            Some(spec) => select_several(spec)?,
            None => {
                let (selection, passed_over) = select_working(None)?;
                notes.extend(passed_over);
                vec![selection]
            }
        };
        let device = |selection| match selection {
            Selection::OpenCl(device) if self.asks_host => Some(device.ask_host()),
            Selection::OpenCl(device) => Some(device),
            Selection::Reference { notice } => {
                notes.extend(notice);
                None
            }
        };
        Ok(selected.into_iter().map(device).collect())
    }
}
