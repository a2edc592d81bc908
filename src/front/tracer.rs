//! The tracer: a scene on a device, asked for hits and pictures.

use super::all_hits::AllHits;
use super::builder::TracerBuilder;
use super::framing::{LitScene, framing_camera, is_placed, shape_up};
use super::picture::Picture;
use super::point::ClosestPoint;
use super::ray::{Hit, Hits, Ray};
use super::scene::check_indices;
use super::team::Team;
use super::view::{Frame, View};
use crate::accel::KeptBvh;
use crate::budget::{CHECKED_FROM_BYTES, DecidedBy, MemoryBudget, Need};
use crate::closest::{self, Closest, closest_points, point_scene};
use crate::crossings::{check_closed, is_tie, require_exact};
use crate::device::DeviceKind;
use crate::error::{Error, Result};
use crate::layers::{layers_bytes, trace_layers};
use crate::options::Intersector;
use crate::pack::{PointScene, SceneBuffers};
use crate::parallel;
use crate::reference::extreme::WorldRay;
use crate::renderer::{self, Crop, PictureBlocks, picture_bytes, picture_bytes_by_rows};
use crate::runs::Asked;
use crate::scene::{
    Camera, DefaultLight, Framed, Framing, Numbering, PictureDefaults, Placed, Samples, Scene, WideCamera,
};
use crate::several::{Devices, Watcher};
use crate::shared;
use crate::streamed::OfHit;
use crate::tracer::{self, AllHitsJob, Backend, Progress};
use crate::winding::WindingTree;
use glam::Vec3;
use std::fmt;
use std::sync::Arc;
use std::time::Instant;

/// What part of the work of a call something is: from where to where its progress goes.
pub(super) type Share = (f64, f64);

pub(super) const WHOLE: Share = (0.0, 1.0);

/// Tells of the progress of a part.
pub(super) fn in_share(progress: Progress<'_>, (from, to): Share) -> impl Fn(f64) + Sync {
    move |done| progress(from + (to - from) * done)
}

/// What a builder has chosen, but for the devices.
pub(super) struct Chosen {
    /// `None`: what is left when it is needed.
    pub limit: Option<MemoryBudget>,
    pub choices: Vec<String>,
    pub progress: Option<Box<dyn Fn(f64) + Send + Sync>>,
}

impl Chosen {
    pub(super) fn budget(&self) -> MemoryBudget {
        self.limit.unwrap_or_else(MemoryBudget::available)
    }

    /// What is told of the progress.
    fn progress(&self) -> Progress<'_> {
        match &self.progress {
            Some(progress) => &**progress,
            None => &|_| (),
        }
    }
}

/// A scene on a device, ready for rays and pictures.
///
/// It keeps all that it needs of the scene, and may be sent to another thread; as a device does one thing at a time,
/// tracing takes `&mut`. The first batch and the first picture compile kernels, unless they are in the cache.
///
/// ```
/// use raybrook::{Ray, Scene, Tracer};
///
/// let scene = Scene::from_mesh(&[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
/// let mut tracer = Tracer::new(&scene)?;
/// let rays = [Ray::new([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]), Ray::new([0.0, 0.0, 5.0], [0.0, 0.0, 1.0])];
/// let hits = tracer.closest_hits(&rays)?;
/// assert_eq!(hits[0].map(|hit| (hit.t, hit.triangle)), Some((5.0, 0)));
/// assert_eq!(hits[1], None);
/// assert_eq!(tracer.any_hits(&rays)?, [true, false]);
/// # Ok::<(), raybrook::Error>(())
/// ```
pub struct Tracer {
    pub(super) chosen: Chosen,
    pub(super) buffers: Arc<SceneBuffers>,
    pub(super) team: Team,
    /// The names of its devices.
    name: String,
    /// The longest chain of rays that the devices were opened for.
    pub(super) depth: u32,
    /// What the scene says of its picture.
    pub(super) defaults: PictureDefaults,
    camera: Option<Camera>,
    wide_cameras: Vec<WideCamera>,
    /// Which way is up by the format of the scene's file, or by its shape once that was asked for.
    up: Option<Vec3>,
    /// The camera that was last placed so that it frames the scene; not yet known, or not needed, at first.
    framed: Option<(Framing, Framed)>,
    /// The numbers of the scene's parts.
    numbering: Arc<Numbering>,
    /// The light that was added, if the scene has none.
    added_light: Option<DefaultLight>,
    /// Whether it is known that the scene is closed.
    is_closed: bool,
    /// The hierarchies of boxes of the last update, if there was one.
    kept: Vec<KeptBvh>,
    /// What point queries go through, once there was one.
    points: Option<Arc<PointScene>>,
    /// What tells winding numbers, once one was asked for.
    winding: Option<WindingTree>,
}

/// Bytes of a ray and of its hit as the tracers take them, once more where they are sorted or on a device, and as the
/// caller has them.
const RAY_BYTES: usize =
    3 * (size_of::<shared::TraceRay>() + size_of::<shared::Hit>()) + size_of::<Ray>() + size_of::<Option<Hit>>();

/// The same of a ray that is traced with few others at a time: its hit, and as the caller has both.
const KEPT_RAY_BYTES: usize = size_of::<shared::Hit>() + size_of::<Ray>() + size_of::<Option<Hit>>();

/// Origin, direction, `t_min` and `t_max` of a ray.
fn world_ray(Ray { origin, direction, t_min, t_max }: Ray) -> WorldRay {
    (origin.into(), direction.into(), t_min, t_max)
}

/// Winding numbers that are computed at a time, between which a call may be stopped: a number among 96,000 triangles
/// takes a tenth of a millisecond, so these take a part of a second on two cores.
const WINDING_POINTS: usize = 1 << 11;

/// Bytes of a point's answer, as it is found and as the caller has it.
const POINT_BYTES: usize = size_of::<Option<Closest>>() + size_of::<Option<ClosestPoint>>();

impl Tracer {
    /// A tracer of `scene` on the fastest device, by the fastest exact method.
    ///
    /// # Errors
    /// As [`TracerBuilder::build`].
    pub fn new(scene: &Scene) -> Result<Tracer> {
        Tracer::builder(scene).build()
    }

    /// Begins a tracer of `scene` with choices of one's own.
    pub fn builder(scene: &Scene) -> TracerBuilder<'_> {
        TracerBuilder::new(scene)
    }

    pub(super) fn open(lit: &LitScene, depth: u32, mut team: Team, chosen: Chosen) -> Result<Tracer> {
        let LitScene { scene, framed, up, added } = lit;
        let buffers = team.build(scene, depth, &chosen.budget())?;
        let numbering = Arc::new(Numbering::of(scene, &buffers.used_materials));
        Ok(Tracer {
            name: team.name(),
            team,
            buffers,
            depth,
            defaults: scene.picture,
            camera: scene.camera,
            wide_cameras: scene.wide_cameras.clone(),
            up: *up,
            framed: *framed,
            numbering,
            added_light: *added,
            is_closed: false,
            kept: Vec::new(),
            points: None,
            winding: None,
            chosen,
        })
    }

    /// Takes over a scene that has changed: vertices ([`Scene::update_vertices`]), transforms of instances
    /// ([`Instances::set_transform`](crate::scene::Instances::set_transform)), or anything else. Device, method and
    /// compiled kernels stay; answers and pictures are, to the bit, those of a new tracer of the scene.
    ///
    /// From the second update on a hierarchy of boxes (structures `bvh2` and `bvh8`, the default of most devices) gets
    /// new boxes where the triangles are those that it was built of. That makes rays slower; it is built anew as soon
    /// as they have lost as much time as building takes. Other structures are built anew each time.
    ///
    /// ```
    /// use raybrook::{Ray, Scene, Tracer};
    ///
    /// let mut scene = Scene::from_mesh(&[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// let mut tracer = Tracer::new(&scene)?;
    /// let rays = [Ray::new([0.0, 0.0, 5.0], [0.0, 0.0, -1.0])];
    /// for z in [1.0, 2.0, 3.0] {
    ///     scene.update_vertices(&[[-1.0, -1.0, z], [1.0, -1.0, z], [0.0, 1.0, z]])?;
    ///     tracer.update(&scene)?;
    ///     assert_eq!(tracer.closest_hits(&rays)?[0].map(|hit| hit.t), Some(5.0 - z));
    /// }
    /// # Ok::<(), raybrook::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`TracerBuilder::build`]; the tracer then still has the scene that it had.
    pub fn update(&mut self, scene: &Scene) -> Result<()> {
        check_indices(scene)?;
        scene.check_values()?;
        let Frame { size, samples, .. } = View::default().over(&scene.picture)?;
        let lit = LitScene::new(scene, samples.aspect(size) as f32);
        let (options, budget) = (&self.team.opening().options, self.chosen.budget());
        let buffers = Arc::new(SceneBuffers::after(&mut self.kept, &lit.scene, options, &budget)?);
        // A device may have no room for both; then what was there is opened again when it is needed.
        self.team.close();
        self.team.open(&buffers, self.depth)?;
        self.name = self.team.name();
        (self.buffers, self.is_closed) = (buffers, false);
        (self.points, self.winding) = (None, None);
        (self.defaults, self.camera, self.up) = (scene.picture, scene.camera, lit.up);
        self.wide_cameras.clone_from(&scene.wide_cameras);
        (self.framed, self.added_light) = (lit.framed, lit.added);
        self.numbering = Arc::new(Numbering::of(scene, &self.buffers.used_materials));
        Ok(())
    }

    /// The closest hit of each ray, `None` for a miss; in the order of `rays`, which are in world units.
    ///
    /// With [`Precision::Exact`](crate::Precision::Exact), the default, hit or miss and the triangle are those of exact
    /// arithmetic on the float32 numbers of ray and vertices, and t, u and v are the exact ones rounded once, whatever
    /// the device, the method and the size of the numbers. Triangles are hit from both sides, and edges and vertices
    /// belong to them; of two at the same t the lower number wins.
    ///
    /// A ray hits nothing when a number of its origin or direction is NaN or infinite, when its direction is zero, when
    /// `t_min` or `t_max` is NaN, and when `t_min` is greater than `t_max`. A hit whose t is beyond the largest float
    /// is a miss.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] and [`Error::TooLarge`] when the batch takes too much memory; [`Error::Build`],
    /// [`Error::OpenCl`] and [`Error::Hang`] when the driver fails.
    pub fn closest_hits(&mut self, rays: &[Ray]) -> Result<Vec<Option<Hit>>> {
        self.trace(rays.len(), |i| rays[i], false)
    }

    /// The closest hits of `count` rays, of which `ray` makes number i: as [`Tracer::closest_hits`], for rays and hits
    /// that are wanted in other memory than that of slices of [`Ray`] and [`Hit`].
    ///
    /// ```
    /// # use raybrook::{Ray, Scene, Tracer};
    /// # let scene = Scene::from_mesh(&[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// let mut tracer = Tracer::new(&scene)?;
    /// let heights = [5.0, 7.0];
    /// let hits = tracer.closest_hits_of(2, |i| Ray::new([0.0, 0.0, heights[i]], [0.0, 0.0, -1.0]))?;
    /// assert_eq!(hits.get(1).map(|hit| hit.t), Some(7.0));
    /// # Ok::<(), raybrook::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Tracer::closest_hits`].
    pub fn closest_hits_of(&mut self, count: usize, ray: impl Fn(usize) -> Ray + Sync) -> Result<Hits> {
        self.trace(count, ray, false).map(Hits)
    }

    /// Whether each ray hits anything, in the order of `rays`. Faster than [`Tracer::closest_hits`], and as right.
    ///
    /// # Errors
    /// As [`Tracer::closest_hits`].
    pub fn any_hits(&mut self, rays: &[Ray]) -> Result<Vec<bool>> {
        self.any_hits_of(rays.len(), |i| rays[i])
    }

    /// Whether each of `count` rays hits anything, of which `ray` makes number i.
    ///
    /// # Errors
    /// As [`Tracer::closest_hits`].
    pub fn any_hits_of(&mut self, count: usize, ray: impl Fn(usize) -> Ray + Sync) -> Result<Vec<bool>> {
        self.trace(count, ray, true)
    }

    /// How many triangles each ray hits between its `t_min` and `t_max`, in the order of `rays`. Each counts once; an
    /// edge or a vertex belongs to all triangles around it.
    ///
    /// # Errors
    /// As [`Tracer::closest_hits`].
    pub fn count_hits(&mut self, rays: &[Ray]) -> Result<Vec<u32>> {
        let found = self.trace_all(rays, u32::MAX, false)?;
        Ok((0..rays.len()).map(|ray| found.count(ray) as u32).collect())
    }

    /// All hits of each ray, in the order of `rays`; those of a ray in the order of their t, of those at the same t
    /// the lower triangle number first. t is compared exactly, also where two hits have the same t once it is rounded.
    ///
    /// Takes two traversals, of which the first only counts; in structures whose leaves share triangles (kd-trees,
    /// grids, octrees, and hierarchies that may have spatial splits) counting takes a traversal for each hit.
    ///
    /// # Errors
    /// As [`Tracer::closest_hits`]; [`Error::OutOfMemory`], too, when there are too many hits.
    pub fn all_hits(&mut self, rays: &[Ray]) -> Result<AllHits> {
        self.trace_all(rays, u32::MAX, true).map(AllHits::new)
    }

    /// The `most` closest hits of each ray, or fewer, as by [`Tracer::all_hits`].
    ///
    /// # Errors
    /// As [`Tracer::all_hits`].
    pub fn first_hits(&mut self, rays: &[Ray], most: u32) -> Result<AllHits> {
        self.trace_all(rays, most, true).map(AllHits::new)
    }

    /// Whether each of the hits of `all` is at the t of the hit before it on its ray: exactly, not only once t is
    /// rounded. So it is where a ray goes through an edge or a vertex, or where triangles lie in one another. `all`:
    /// what [`Tracer::all_hits`] or [`Tracer::first_hits`] found for `rays`. Hits that are not exact are compared as
    /// they are.
    ///
    /// # Panics
    /// Where `all` has more rays than `rays`.
    pub fn ties(&self, rays: &[Ray], all: &AllHits) -> Vec<bool> {
        let (buffers, is_exact) = (&self.buffers, self.team.opening().options.intersector == Intersector::Exact);
        let of_ray = |i: usize| {
            let (ray, hits) = (rays[i], all.of_ray(i));
            let is_tied = move |k: usize| {
                let Some([before, hit]) = k.checked_sub(1).map(|before| [hits[before], hits[k]]) else { return false };
                let triangles = [before.triangle, hit.triangle];
                let tie = || is_tie(buffers, triangles, ray.origin.into(), ray.direction.into());
                before.t == hit.t && (!is_exact || tie())
            };
            (0..hits.len()).map(is_tied)
        };
        parallel::flat_map_numbers(all.len(), of_ray)
    }

    /// How often each ray crosses a surface between its `t_min` and `t_max`, in the order of `rays`: through an edge or
    /// a vertex once, and not at all where it only touches one. Exact: of a closed mesh a ray from outside to outside
    /// crosses an even number. A ray along the plane of a triangle does not cross that triangle.
    ///
    /// # Errors
    /// As [`Tracer::all_hits`]; [`Error::Option`] when the method is not exact.
    pub fn count_crossings(&mut self, rays: &[Ray]) -> Result<Vec<u32>> {
        self.crossings(rays.len(), &|i| world_ray(rays[i]), WHOLE)
    }

    /// Whether each point is inside of the scene, which must be closed, or exactly on its surface; in the order of
    /// `points`, in world units. Exact, and with no choice of a direction in it.
    ///
    /// Closed is what has every edge in an even number of triangles, whatever their orientation; triangles without area
    /// do not count. Where closed meshes overlap, what is inside of two is outside.
    ///
    /// # Errors
    /// As [`Tracer::count_crossings`]; [`Error::Scene`] when the scene is not closed.
    pub fn contains(&mut self, points: &[[f32; 3]]) -> Result<Vec<bool>> {
        self.require_closed()?;
        self.are_inside(points, WHOLE)
    }

    fn require_closed(&mut self) -> Result<()> {
        require_exact(self.team.opening().options.intersector)?;
        if !self.is_closed {
            check_closed(&self.buffers)?;
            self.is_closed = true;
        }
        Ok(())
    }

    /// The closest point of the scene to each point, in the order of `points`, in world units. Exact, whatever the
    /// device, the method and its precision, and the size of the numbers: the nearest triangle is that of exact
    /// arithmetic on the float32 numbers of point and vertices, of several that are as near that of the lowest number,
    /// and each number of the answer is the exact one, rounded once. Triangles without area count as the segments and
    /// points that they are; those with a vertex that is not finite do not count.
    ///
    /// `None` for a point with a number that is NaN or infinite, and in a scene without triangles.
    ///
    /// The first query builds a binary hierarchy of boxes, unless the structure is one (`bvh2`) and there are no
    /// triangles without area.
    ///
    /// ```
    /// use raybrook::{Scene, Tracer};
    ///
    /// let scene = Scene::from_mesh(&[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]], &[[0, 1, 2]])?;
    /// let mut tracer = Tracer::new(&scene)?;
    /// let closest = tracer.closest_points(&[[1.0, 2.0, 3.0], [8.0, -3.0, 0.0]])?;
    /// let above = closest[0].expect("there is a triangle");
    /// assert_eq!((above.point, above.distance), ([1.0, 2.0, 0.0], 3.0));
    /// assert_eq!((above.triangle, above.u, above.v), (0, 0.25, 0.5));
    /// assert_eq!(closest[1].map(|closest| (closest.point, closest.distance)), Some(([4.0, 0.0, 0.0], 5.0)));
    /// # Ok::<(), raybrook::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Tracer::closest_hits`]; [`Error::Scene`] when there are more triangles than a hierarchy has room for.
    pub fn closest_points(&mut self, points: &[[f32; 3]]) -> Result<Vec<Option<ClosestPoint>>> {
        let closest = self.find_closest(points, WHOLE)?;
        Ok(closest.iter().map(|closest| closest.as_ref().map(ClosestPoint::of)).collect())
    }

    /// The distance of the scene from each point, in the order of `points`, in world units: that of
    /// [`Tracer::closest_points`], the exact one rounded once. NaN for a point with a number that is NaN or infinite;
    /// infinite in a scene without triangles, and beyond the largest float.
    ///
    /// # Errors
    /// As [`Tracer::closest_points`].
    pub fn distances(&mut self, points: &[[f32; 3]]) -> Result<Vec<f32>> {
        Ok(closest::distances(points, &self.find_closest(points, WHOLE)?))
    }

    /// As [`Tracer::distances`], but negative inside of the scene, which must be closed as for [`Tracer::contains`].
    /// Both the number and its sign are exact; 0 exactly on the surface.
    ///
    /// # Errors
    /// As [`Tracer::closest_points`] and [`Tracer::contains`].
    pub fn signed_distances(&mut self, points: &[[f32; 3]]) -> Result<Vec<f32>> {
        self.require_closed()?;
        let mut distances = closest::distances(points, &self.find_closest(points, (0.0, 0.5))?);
        closest::negate(&mut distances, &self.are_inside(points, (0.5, 1.0))?);
        Ok(distances)
    }

    /// How often the scene winds around each point, in the order of `points`, in world units: 1 inside of a closed mesh
    /// whose triangles are turned outwards, 0 outside, and between them near the holes of an open one, so that 0.5
    /// tells inside from outside where [`Tracer::contains`] refuses to (Jacobson, Kavan and Sorkine-Hornung, SIGGRAPH
    /// 2013).
    ///
    /// The exact number up to f64's rounding, computed on the host, whatever the device. On a face it is half of the
    /// numbers on both sides. NaN for a point with a number that is NaN or infinite; 0 in a scene without triangles.
    ///
    /// ```
    /// use raybrook::{Scene, Tracer};
    ///
    /// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    /// let scene = Scene::from_mesh(&corners, &[[0, 2, 1], [0, 1, 3], [0, 3, 2]])?; // a tetrahedron without its lid
    /// let mut tracer = Tracer::new(&scene)?;
    /// let numbers = tracer.winding_numbers(&[[0.1, 0.1, 0.1], [0.5, 0.5, 0.5]])?;
    /// assert!(numbers[0] > 0.5 && numbers[1] < 0.5);
    /// assert!(tracer.contains(&[[0.1, 0.1, 0.1]]).is_err());
    /// # Ok::<(), raybrook::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] when the hierarchy takes too much memory; [`Error::Scene`] when there are more triangles
    /// than it has room for; [`Error::Stopped`].
    pub fn winding_numbers(&mut self, points: &[[f32; 3]]) -> Result<Vec<f64>> {
        let known = self.winding.take().map_or_else(|| WindingTree::new(&self.buffers, &self.chosen.budget()), Ok)?;
        let tree = self.winding.insert(known);
        let mut numbers = Vec::with_capacity(points.len());
        for part in points.chunks(WINDING_POINTS) {
            self.team.opening().check_stop()?;
            self.chosen.progress()(numbers.len() as f64 / points.len() as f64);
            numbers.extend(tree.winding_numbers(part));
        }
        Ok(numbers)
    }

    fn find_closest(&mut self, points: &[[f32; 3]], share: Share) -> Result<Vec<Option<Closest>>> {
        let scene = self.point_scene()?;
        self.check_points(points.len())?;
        self.timed(self.depth, |backend, progress| closest_points(backend, &scene, points, &in_share(progress, share)))
    }

    /// What point queries go through, built when it is first needed.
    fn point_scene(&mut self) -> Result<Arc<PointScene>> {
        let is_for_processor = self.device_kind() == Some(DeviceKind::Cpu);
        let new = || point_scene(&self.buffers, is_for_processor, &self.chosen.budget());
        let known = self.points.take().map_or_else(new, Ok)?;
        Ok(self.points.insert(known).clone())
    }

    fn check_points(&self, count: usize) -> Result<()> {
        let what = format!("finding what is closest to {count} points");
        let remedy = "split the points, or raise the memory limit";
        let bytes = (count * POINT_BYTES) as u64;
        self.check_bytes(&Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy })
    }

    fn check_bytes(&self, need: &Need) -> Result<()> {
        if need.bytes >= CHECKED_FROM_BYTES { self.chosen.budget().check(need) } else { Ok(()) }
    }

    fn trace_all(&mut self, rays: &[Ray], most: u32, wants_hits: bool) -> Result<tracer::AllHits> {
        let ray = |i| world_ray(rays[i]);
        self.check_batch(rays.len())?;
        if self.goes_in_runs(rays.len()) {
            return self.all_hits_in_runs(rays.len(), &ray, if wants_hits { Asked::All(most) } else { Asked::Count });
        }
        let (batch, budget) = (self.buffers.batch(rays.len(), ray, None), self.chosen.limit);
        let job = AllHitsJob { most, wants_hits, budget, ..AllHitsJob::of(&batch.job(false, 1)) };
        self.timed(self.depth, |backend, progress| backend.trace_all(&job, progress))
    }

    /// What is wanted of one hit of each ray.
    fn trace<T: OfHit>(&mut self, count: usize, ray: impl Fn(usize) -> Ray + Sync, any_hit: bool) -> Result<Vec<T>> {
        self.check_batch(count)?;
        self.hits(count, |i| world_ray(ray(i)), (if any_hit { Asked::Any } else { Asked::Closest }, WHOLE))
    }

    /// Checks that there is memory for so many rays.
    fn check_batch(&self, count: usize) -> Result<()> {
        let bytes = match self.goes_in_runs(count) {
            true => count * KEPT_RAY_BYTES + self.team.len() * self.run_length() * RAY_BYTES,
            false => count * RAY_BYTES,
        } as u64;
        let what = format!("a batch of {count} rays");
        let remedy = "split the batch, or raise the memory limit";
        self.check_bytes(&Need { what: &what, bytes, decided_by: DecidedBy::Input, remedy })
    }

    /// Renders what `view` asks for: Whitted shading with shadows, mirrors, glass and textures (Whitted, "An Improved
    /// Illumination Model for Shaded Display", CACM 1980).
    ///
    /// A scene without lights is lit from above the left shoulder of the view's camera, and from all around: see
    /// [`View`].
    ///
    /// # Errors
    /// [`Error::Option`] for a size, samples or depth out of range, a part that the picture has not, and a camera that
    /// looks nowhere; [`Error::Scene`] for a scene so large that no camera shows it; [`Error::OutOfMemory`] and
    /// [`Error::TooLarge`] when the picture takes too much memory; [`Error::Build`], [`Error::OpenCl`] and
    /// [`Error::Hang`] when the driver fails.
    pub fn render(&mut self, view: &View) -> Result<Picture> {
        let frame = view.over(&self.defaults)?;
        let camera = self.aim(&frame)?;
        let Frame { size, samples, depth, crop, layers, .. } = frame;
        let layers_bytes = layers_bytes(crop.map_or(size, |crop| crop.size), &layers);
        self.check_picture(crop.map_or(size, |crop| crop.rendered_size(size, samples)), samples, layers_bytes)?;
        let (buffers, numbering) = (self.buffers.clone(), self.numbering.clone());
        let picture = renderer::Picture { camera, size, samples, depth, kill_weight: None };
        // How pixels were sampled is known to one that does all of them.
        let notes_sampling = layers.iter().any(|layer| !layer.is_of_hit());
        let mut shared = match self.team.is_several() && !notes_sampling {
            true => {
                crop.map_or(Ok(()), |crop| crop.check(size))?;
                Some(self.film_together(&picture, &PictureBlocks::new(size, samples, crop))?)
            }
            false => None,
        };
        self.timed(depth, |backend, progress| {
            let result = match shared.take() {
                Some(result) => result,
                None => renderer::render_part_noting(backend, &buffers, &picture, crop, notes_sampling, progress)?,
            };
            let (of, sampling) = ((&*buffers, &*numbering), result.sampling.as_ref());
            let layers = trace_layers(backend, of, &picture, crop, &layers, sampling, &|_| progress(1.0))?;
            Ok(Picture::new(result, layers))
        })
    }

    /// The camera of a picture; light that was added is put where it belongs.
    pub(super) fn aim(&mut self, frame: &Frame) -> Result<Camera> {
        let aspect = frame.samples.aspect(frame.size) as f32;
        let camera = WideCamera::choose(self.camera, &self.wide_cameras, aspect);
        if self.up.is_none() && camera.is_none() && frame.aim.up.is_none() {
            self.up = Some(shape_up(&self.buffers));
        }
        let placed = frame.aim.place(
            camera,
            self.up,
            || None,
            aspect,
            |framing| match self.framed {
                Some((known, framed)) if known == *framing => framed,
                _ => framing_camera(&self.buffers, framing),
            },
        );
        if !is_placed(&placed.camera) {
            let message = "it is so large that no camera which shows it has a place in float32's range; give a camera";
            return Err(Error::Scene(message.to_owned()));
        }
        placed.check(&frame.aim)?;
        if let Some(light) = self.added_light {
            self.place_light(light, &placed)?;
        }
        self.framed = placed.framed.or(self.framed);
        Ok(placed.camera)
    }

    /// Has the light that was added shine as it does where the camera is placed so. Where it did not yet, the scene is
    /// sent to the device again.
    fn place_light(&mut self, light: DefaultLight, placed: &Placed) -> Result<()> {
        let relit = self.buffers.relit(&placed.lamp(light), placed.sky(light))?;
        if !relit.is_of(&self.buffers) {
            self.team.close();
            self.points = None; // they share the arrays
            relit.replace(Arc::make_mut(&mut self.buffers));
        }
        Ok(())
    }

    fn check_picture(&self, size: (u32, u32), samples: Samples, layers_bytes: u64) -> Result<()> {
        let what = format!("a picture of {}x{} pixels", size.0, size.1);
        let bytes = picture_bytes(size, samples, &self.team.opening().options, self.team.device(), None) + layers_bytes;
        let remedy = "ask for a smaller one, or raise the memory limit";
        self.chosen.budget().check(&Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy })
    }

    /// Checks that there is memory for the blocks of a picture that are in flight, and for `kept` bytes of pixels.
    pub(super) fn check_blocks(
        &self,
        (size, crop): ((u32, u32), Option<Crop>),
        samples: Samples,
        kept: u64,
    ) -> Result<()> {
        let what = format!("blocks of a picture of {}x{} pixels", size.0, size.1);
        let (options, devices) = (&self.team.opening().options, (self.team.device(), self.team.len()));
        let bytes = picture_bytes_by_rows((size, crop), samples, options, devices, None) + kept;
        let remedy = "ask for fewer blocks at a time, or raise the memory limit";
        self.chosen.budget().check(&Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy })
    }

    /// Has one device trace, and takes note of how long that took.
    pub(super) fn timed<T>(
        &mut self,
        depth: u32,
        mut trace: impl FnMut(&mut dyn Backend, Progress) -> Result<T>,
    ) -> Result<T> {
        self.timed_as(depth, |team, of, progress| team.alone(of.0, |tracer| trace(tracer, progress)))
    }

    /// The same of all devices.
    pub(super) fn timed_together<T>(
        &mut self,
        (depth, share): (u32, Share),
        trace: impl FnOnce(Devices, &dyn Watcher) -> Result<T>,
    ) -> Result<T> {
        self.timed_as(depth, |team, of, progress| team.share(of, &in_share(progress, share), trace))
    }

    fn timed_as<T>(
        &mut self,
        depth: u32,
        trace: impl FnOnce(&mut Team, (&Arc<SceneBuffers>, u32), Progress) -> Result<T>,
    ) -> Result<T> {
        if depth > self.depth {
            self.team.close();
            self.depth = depth;
        }
        if self.team.is_closed() {
            self.team.open(&self.buffers, self.depth)?;
        }
        let start = Instant::now();
        let traced = trace(&mut self.team, (&self.buffers, self.depth), self.chosen.progress());
        let seconds = start.elapsed().as_secs_f64();
        self.kept.iter_mut().for_each(|kept| kept.add_traced(seconds));
        self.name = self.team.name();
        traced
    }

    /// What kind of device it traces on, the first of several; `None`: the reference.
    pub fn device_kind(&self) -> Option<DeviceKind> {
        self.team.device().map(|device| device.info.kind)
    }

    /// How many devices share its work.
    pub fn device_count(&self) -> usize {
        self.team.len()
    }

    /// The device's name; `reference` for the scalar reference. Of several the names with `+` between them.
    pub fn device_name(&self) -> &str {
        &self.name
    }

    /// What was chosen and why, a line each: structure, packet size, triangle test, numbers of the build, features of
    /// the kernels.
    pub fn choices(&self) -> &[String] {
        &self.chosen.choices
    }

    /// What a curious user should know, a sentence each: why a device was passed over, that there is no OpenCL, that a
    /// cache cannot be used, that a device was lost. What a scene's file has that is not usable is in
    /// [`Scene::warnings`] instead.
    pub fn notes(&self) -> Vec<String> {
        self.team.notes()
    }
}

impl fmt::Debug for Tracer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let triangles = self.buffers.triangle_count();
        f.debug_struct("Tracer").field("device", &self.device_name()).field("triangles", &triangles).finish()
    }
}
