//! A scene and its tracer.

use crate::choices::{Choices, GivenChoices};
use crate::error::to_python;
use crate::meshes::{Meshes, join};
use crate::output::{Arrays, ClosestHits, HitList};
use crate::parts::Parts;
use crate::picture::Picture;
use crate::points::{PointArrays, PointList};
use crate::process;
use crate::rays::{GivenRays, Rays};
use crate::run::{Call, Current, Failure, Stopped, run};
use crate::view::{BlockArrays, Regions, view_of};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use raybrook::low_level::blocks::Area;
use raybrook::low_level::tracer::rays_in_caches;
use raybrook::{AllHits, DeviceKind, Hit, Ray, Result, Scene, Tracer};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Instant;

/// Rays or points that a GPU traces at a time at the most: enough to fill it, and their memory on the way is small
/// beside that of a scene.
const AT_A_TIME: usize = 1 << 20;
/// Of several devices for each: they share what is more than a million.
const AT_A_TIME_OF_EACH: usize = 1 << 24;

/// A scene with what traces it, which is opened when it is first needed.
#[pyclass(frozen, module = "raybrook._raybrook")]
pub struct Core {
    scene: Scene,
    meshes: Meshes,
    choices: Choices,
    current: Current,
    tracer: Mutex<Option<Tracer>>,
    /// Computed when it is first asked for.
    digest: OnceLock<String>,
}

impl Drop for Core {
    fn drop(&mut self) {
        // A driver may wait for its threads before it frees anything.
        if process::is_forked() {
            let place = self.tracer.get_mut().unwrap_or_else(PoisonError::into_inner);
            std::mem::forget(place.take());
        }
    }
}

impl Core {
    fn of(scene: Scene, starts: Vec<u32>, choices: GivenChoices) -> Result<Core> {
        let choices = Choices::new(choices)?;
        let (current, tracer) = (Current::default(), Mutex::default());
        Ok(Core { scene, meshes: Meshes { starts }, choices, current, tracer, digest: OnceLock::new() })
    }

    /// Has `work` done by the tracer, for each part of `count` things. The tracer is gone when it is stopped.
    fn work(
        &self,
        call: &Arc<Call>,
        count: usize,
        mut work: impl FnMut(&mut Tracer, Range<usize>) -> Result<()>,
    ) -> std::result::Result<(), Failure> {
        let mut place = self.tracer.lock().unwrap_or_else(PoisonError::into_inner);
        self.current.set(call);
        let all = || -> Result<()> {
            if place.is_none() {
                *place = Some(self.choices.open(&self.scene, self.current.clone())?);
            }
            let tracer = place.as_mut().expect("it was opened");
            let known = tracer.notes();
            let mut parts = Parts::new(match tracer.device_count() {
                1 if DeviceKind::is_processor(tracer.device_kind()) => rays_in_caches(),
                1 => AT_A_TIME,
                several => several * AT_A_TIME_OF_EACH,
            });
            let mut first = 0;
            while first < count {
                let part = parts.size().min(count - first);
                call.begin_part(first as f64 / count as f64, part as f64 / count as f64);
                let start = Instant::now();
                work(tracer, first..first + part)?;
                parts.took(start.elapsed());
                first += part;
            }
            // Of devices that were lost.
            tracer.notes().into_iter().filter(|note| !known.contains(note)).for_each(|note| call.note(note));
            Ok(())
        };
        match catch_unwind(AssertUnwindSafe(all)) {
            Ok(result) => Ok(result?),
            Err(cause) => {
                *place = None;
                if cause.is::<Stopped>() { Err(Failure::Stopped) } else { resume_unwind(cause) }
            }
        }
    }

    /// Has `work` done by the tracer, once.
    fn once<T>(
        &self,
        call: &Arc<Call>,
        mut work: impl FnMut(&mut Tracer) -> Result<T>,
    ) -> std::result::Result<T, Failure> {
        let mut done = None;
        self.work(call, 1, |tracer, _| {
            done = Some(work(tracer)?);
            Ok(())
        })?;
        Ok(done.expect("it was done"))
    }

    /// One number for each of `count` things, from `work`, which gets a part of them and tells as many numbers.
    fn numbers<'py, T: numpy::Element + Copy>(
        &self,
        py: Python<'py>,
        count: usize,
        progress: Option<&Bound<PyAny>>,
        mut work: impl FnMut(&mut Tracer, Range<usize>) -> Result<Vec<T>> + Send,
    ) -> PyResult<Bound<'py, PyArray1<T>>> {
        let numbers = PyArray1::zeros(py, count, false);
        // SAFETY: nobody else has the new array yet.
        let results: &mut [T] = unsafe { numbers.as_slice_mut() }?;
        run(py, progress, |call| {
            self.work(call, count, |tracer, part| {
                results[part.clone()].copy_from_slice(&work(tracer, part)?);
                Ok(())
            })
        })?;
        Ok(numbers)
    }

    /// Visits the hits of each ray that are listed, with mesh and triangle, and then `None`. Of those of a mesh that
    /// tie only the first one is listed; nothing ties where `ties` is empty.
    fn for_each_hit(
        &self,
        (all, ties): (&AllHits, &[bool]),
        most: usize,
        mut visit: impl FnMut(Option<(&Hit, (u32, u32))>),
    ) {
        let mut ties = ties.iter();
        for i in 0..all.len() {
            let (mut count, mut last_mesh) = (0, u32::MAX);
            for found in all.of_ray(i) {
                let place = self.meshes.place(found.triangle);
                let is_same = *ties.next().unwrap_or(&false) && place.0 == last_mesh;
                if !is_same && count < most {
                    visit(Some((found, place)));
                    count += 1;
                }
                last_mesh = place.0;
            }
            visit(None);
        }
    }

    /// All hits of rays, or as many of each as are wanted, and whether they tie; nothing of ties if these are not
    /// merged.
    fn all_hits(
        &self,
        tracer: &mut Tracer,
        rays: &[Ray],
        most: Option<u32>,
        merge: bool,
    ) -> Result<(AllHits, Vec<bool>)> {
        let all = match most {
            Some(most) if !merge => tracer.first_hits(rays, most)?,
            _ => tracer.all_hits(rays)?,
        };
        let ties = if merge { tracer.ties(rays, &all) } else { Vec::new() };
        Ok((all, ties))
    }
}

/// The arrays of closest hits: t, u and v by twos, triangle, mesh, normals by threes.
type ClosestArrays<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<u32>>,
    Bound<'py, PyArray1<f32>>,
);

#[pymethods]
impl Core {
    /// A scene of meshes: float32 [n,3] and uint32 [m,3] each. With `is_strict` all vertices must be finite; without it
    /// triangles with others are never hit.
    #[new]
    fn new(
        py: Python,
        meshes: Vec<(PyReadonlyArray2<f32>, PyReadonlyArray2<u32>)>,
        is_strict: bool,
        choices: GivenChoices,
    ) -> PyResult<Core> {
        let made = join(&meshes, is_strict)?.and_then(|(scene, starts)| Core::of(scene, starts, choices));
        made.map_err(|error| to_python(py, &error))
    }

    /// This scene with other meshes. What traces it takes them over, if it is open, and this one opens another one when
    /// it is asked again.
    fn moved(
        &self,
        py: Python,
        meshes: Vec<(PyReadonlyArray2<f32>, PyReadonlyArray2<u32>)>,
        is_strict: bool,
    ) -> PyResult<Core> {
        let (scene, starts) = join(&meshes, is_strict)?.map_err(|error| to_python(py, &error))?;
        let mut tracer = None;
        run(py, None, |call| {
            self.current.set(call);
            let mut place = self.tracer.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(open) = place.as_mut() {
                open.update(&scene)?;
                tracer = place.take();
            }
            Ok(())
        })?;
        let (choices, current) = (self.choices.clone(), self.current.clone());
        let (tracer, digest) = (Mutex::new(tracer), OnceLock::new());
        Ok(Core { scene, meshes: Meshes { starts }, choices, current, tracer, digest })
    }

    /// The scene of a file, as one mesh.
    #[staticmethod]
    fn load(py: Python, path: PathBuf, choices: GivenChoices) -> PyResult<Core> {
        process::begin(py)?;
        let load = || Core::of(Scene::load(path)?, vec![0], choices);
        py.detach(load).map_err(|error| to_python(py, &error))
    }

    #[getter]
    fn triangle_count(&self) -> usize {
        self.scene.triangle_count()
    }

    /// What was repaired, ignored or left out of a file, a sentence each.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.scene.warnings.clone()
    }

    /// The smallest box around all triangles that can be hit.
    fn bounds(&self, py: Python) -> PyResult<Option<([f32; 3], [f32; 3])>> {
        process::begin(py)?;
        Ok(py.detach(|| self.scene.bounds()).map(|(low, high)| (low.to_array(), high.to_array())))
    }

    /// What tells scenes apart, also by what their files say of pictures.
    fn digest(&self, py: Python) -> &str {
        let Scene { picture, up, .. } = &self.scene;
        py.detach(|| self.digest.get_or_init(|| format!("{} {picture:?} {up:?}", self.scene.digest())))
    }

    /// The corners of all triangles, nine numbers each.
    fn corners<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        let corners = |i: usize| self.scene.vertices(i).into_iter().flat_map(|corner| corner.to_array());
        PyArray1::from_iter(py, (0..self.scene.triangle_count()).flat_map(corners))
    }

    /// Opens the device and builds the structure, unless that was done; tells the device's name, what was chosen and
    /// why, and what a curious user should know.
    fn open(&self, py: Python) -> PyResult<(String, Vec<String>, Vec<String>)> {
        run(py, None, |call| {
            let mut about = None;
            self.work(call, 1, |tracer, _| {
                about = Some((tracer.device_name().to_owned(), tracer.choices().to_vec(), tracer.notes()));
                Ok(())
            })?;
            Ok(about.expect("it was told"))
        })
    }

    /// The closest hit of each ray; normals only where they are wanted.
    fn closest_hits<'py>(
        &self,
        py: Python<'py>,
        rays: GivenRays,
        normals: bool,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<ClosestArrays<'py>> {
        let rays = Rays::new(&rays)?;
        let count = rays.len();
        let (t, uv) = (PyArray1::zeros(py, count, false), PyArray1::zeros(py, 2 * count, false));
        let (triangle, mesh) = (PyArray1::zeros(py, count, false), PyArray1::zeros(py, count, false));
        let normal = PyArray1::zeros(py, if normals { 3 * count } else { 0 }, false);
        // SAFETY: nobody else has the new arrays yet.
        let mut results = unsafe {
            ClosestHits {
                t: t.as_slice_mut()?,
                uv: uv.as_slice_mut()?,
                triangle: triangle.as_slice_mut()?,
                mesh: mesh.as_slice_mut()?,
                normals: normal.as_slice_mut()?,
            }
        };
        run(py, progress, |call| {
            self.work(call, count, |tracer, part| {
                let places = results.split(part.len());
                let hits = tracer.closest_hits_of(part.len(), |i| rays.ray(part.start + i))?;
                places.write(&hits, &self.meshes, &self.scene);
                Ok(())
            })
        })?;
        Ok((t, uv, triangle, mesh, normal))
    }

    /// Whether each ray hits anything.
    fn any_hit<'py>(
        &self,
        py: Python<'py>,
        rays: GivenRays,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let rays = Rays::new(&rays)?;
        self.numbers(py, rays.len(), progress, |tracer, part| {
            tracer.any_hits_of(part.len(), |i| rays.ray(part.start + i))
        })
    }

    /// How many triangles each ray hits; with `merge` those of one mesh at the same t count once.
    fn count<'py>(
        &self,
        py: Python<'py>,
        rays: GivenRays,
        merge: bool,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let rays = Rays::new(&rays)?;
        self.numbers(py, rays.len(), progress, |tracer, part| {
            let rays = rays.part(part);
            if !merge {
                return tracer.count_hits(&rays);
            }
            let (all, ties) = self.all_hits(tracer, &rays, None, true)?;
            let (mut counts, mut count) = (Vec::with_capacity(rays.len()), 0);
            self.for_each_hit((&all, &ties), usize::MAX, |hit| match hit {
                Some(_) => count += 1,
                None => counts.push(std::mem::take(&mut count)),
            });
            Ok(counts)
        })
    }

    /// How often each ray crosses a surface.
    fn count_crossings<'py>(
        &self,
        py: Python<'py>,
        rays: GivenRays,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let rays = Rays::new(&rays)?;
        self.numbers(py, rays.len(), progress, |tracer, part| tracer.count_crossings(&rays.part(part)))
    }

    /// All hits of each ray, the closest first, or the closest `most`; with `merge` of those of one mesh at the same t
    /// the first one only.
    fn list_hits<'py>(
        &self,
        py: Python<'py>,
        rays: GivenRays,
        most: Option<u32>,
        merge: bool,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<Arrays<'py>> {
        let rays = Rays::new(&rays)?;
        let list = run(py, progress, |call| {
            let mut list = HitList::new();
            self.work(call, rays.len(), |tracer, part| {
                let rays = rays.part(part);
                let (all, ties) = self.all_hits(tracer, &rays, most, merge)?;
                if !merge {
                    list.extend(&all, &self.meshes);
                    return Ok(());
                }
                let most = most.map_or(usize::MAX, |most| most as usize);
                self.for_each_hit((&all, &ties), most, |hit| match hit {
                    Some((hit, place)) => list.push(hit, place),
                    None => list.end_ray(),
                });
                Ok(())
            })?;
            Ok(list)
        })?;
        Ok(list.into_arrays(py))
    }

    /// Whether each point is inside of the scene or on its surface.
    fn contains<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<f32>,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let points = points.as_slice()?.as_chunks().0;
        self.numbers(py, points.len(), progress, |tracer, part| tracer.contains(&points[part]))
    }

    /// The closest point of the scene to each point; normals only where they are wanted.
    fn closest_points<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<f32>,
        normals: bool,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<PointArrays<'py>> {
        let points = points.as_slice()?.as_chunks().0;
        let list = run(py, progress, |call| {
            let mut list = PointList::default();
            self.work(call, points.len(), |tracer, part| {
                list.extend(&tracer.closest_points(&points[part])?, &self.meshes, normals.then_some(&self.scene));
                Ok(())
            })?;
            Ok(list)
        })?;
        Ok(list.into_arrays(py))
    }

    /// The distance of the scene from each point.
    fn distances<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<f32>,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let points = points.as_slice()?.as_chunks().0;
        self.numbers(py, points.len(), progress, |tracer, part| tracer.distances(&points[part]))
    }

    /// As `distances`, but negative inside.
    fn signed_distances<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<f32>,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let points = points.as_slice()?.as_chunks().0;
        self.numbers(py, points.len(), progress, |tracer, part| tracer.signed_distances(&points[part]))
    }

    /// How often the scene winds around each point.
    fn winding_numbers<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<f32>,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let points = points.as_slice()?.as_chunks().0;
        self.numbers(py, points.len(), progress, |tracer, part| tracer.winding_numbers(&points[part]))
    }

    /// A picture.
    fn render(&self, py: Python, view: &Bound<PyDict>, progress: Option<&Bound<PyAny>>) -> PyResult<Picture> {
        let view = view_of(view)?;
        run(py, progress, |call| self.once(call, |tracer| tracer.render(&view)).map(Picture))
    }

    /// How a picture is cut into blocks; without a device.
    fn regions(&self, py: Python, view: &Bound<PyDict>) -> PyResult<Regions> {
        let blocks = view_of(view)?.blocks(&self.scene).map_err(|error| to_python(py, &error))?;
        let region = |(area, numbers): (Area, Vec<usize>)| (rectangle(&area), numbers);
        Ok(blocks.regions().into_iter().map(region).collect())
    }

    /// Some blocks of a picture, one after the other.
    fn render_blocks<'py>(
        &self,
        py: Python<'py>,
        view: &Bound<PyDict>,
        numbers: Vec<usize>,
        progress: Option<&Bound<PyAny>>,
    ) -> PyResult<BlockArrays<'py>> {
        let view = view_of(view)?;
        let (pixels, places) = run(py, progress, |call| {
            let blocks = view.blocks(&self.scene)?;
            let pixels = self.once(call, |tracer| Ok(tracer.render_blocks(&view, &numbers)?.concat()))?;
            let places = numbers.iter().flat_map(|&number| blocks.places(number));
            let places = places.flat_map(|place| rectangle(&place.seen_from(blocks.place())).map(|n| n as u32));
            Ok((pixels, places.collect::<Vec<u32>>()))
        })?;
        Ok((PyArray1::from_vec(py, pixels.into_flattened()), PyArray1::from_vec(py, places)))
    }
}

/// Column, row, width and height.
fn rectangle(area: &Area) -> [usize; 4] {
    [area.x.start, area.y.start, area.x.len(), area.y.len()]
}
