//! raybrook: a ray tracer for triangle scenes, fast and right on any OpenCL device.
//!
//! It grew out of J. Dvořák, *Streaming Raytracer na GPU*, master's thesis, FIT VUT Brno 2008: a kd-tree, one mega-kernel, Whitted
//! shading. Every kernel has a scalar twin in Rust that repeats its arithmetic operation for operation, so that hits and pictures
//! can be compared bit for bit.
//!
//! # How data flows
//!
//! ```text
//!  scene.toml, .obj ──load──▶ Scene ──build──▶ KdTree ──pack──▶ SceneBuffers ──▶ render kernel ──▶ Film ──▶ picture
//!   (scene/load.rs)          (scene/)         (accel/)         (pack.rs)   │    (cl/, device/)  (io/film.rs)
//!                                                                          │       ▲ -D TRAVERSE=… -D HITS=…
//!  rays.npz ───────────────▶ RayBatch ──────────────────────▶ TraceJob ────┤
//!                            (io/rays.rs)                       (tracer.rs)   ▼
//!                                               reference/ (the same algorithms, file for file, in f32) ──▶ io/compare.rs
//! ```
//!
//! # Code map
//!
//! | module | what it does |
//! |---|---|
//! | [`scene`] | scenes in world units: containers, instances of objects (`instances.rs`), [`scene::Builder`], OBJ/MTL, PLY, STL, NFF and TOML loaders; usable alone |
//! | [`accel`] | builders of kd-trees (medians in `divide.rs`, costs in `sah.rs`, stops of all in `stop.rs`), hierarchies of boxes (`bvh.rs`, with splits of space in `bvh/spatial.rs`, improved in `bvh/reinsert.rs`; packed in `bvh2.rs` and `bvh8.rs`; triangles by eights in `leaf_packets.rs`), grids, octrees and clusters, their statistics, and the check of every invariant of a kd-tree |
//! | [`shared`], [`layout`] | the structs that host and kernels share, defined once; `cl/shared/types.cl` is generated from them |
//! | [`pack`] | scene and tree as flat arrays in tracing space, read by the kernels and by the twin alike; objects that instances share in their own coordinates (`pack/instances.rs`) |
//! | [`device`] | the only place that calls OpenCL: list, choose, compile (with a cache), upload, launch one kernel or, in `wavefront.rs`, several a picture |
//! | [`mod@reference`] | the scalar twins of `cl/`, and the f64 [`reference::oracle`] with a hierarchy of its own |
//! | [`features`] | what a scene needs of the kernels that shade; `device/definitions.rs` leaves out the rest |
//! | [`adaptive`] | pictures of bounded error: which pixels get how many samples (`adaptive/estimate.rs`: how wrong each may be); decided on the device by `device/adaptive.rs` and `cl/kernels/adaptive.cl` |
//! | [`tracer`] | the [`tracer::Backend`] trait: batches of rays and pictures, on a device or on the reference |
//! | [`reference::extreme`] | rays whose numbers tracing space cannot hold, traced on the host with the same exact answers |
//! | `ray_order.rs` | shuffled batches: sorted, traced, and their hits put back into the caller's order |
//! | [`renderer`] | from a scene and a device to a tracer that is ready |
//! | [`options`] | what can be chosen, as enums that the CLI and the tests loop over; what goes together, as a table; what is chosen where nothing is asked for, and why ([`options::Request`]) |
//! | [`tune`] | measures what is fastest on a device, and remembers it for [`options::Request::choose`] |
//! | [`budget`] | how much memory may be taken, checked against estimates before it is |
//! | [`work`] | counted work (what a step is: [`shared::WorkCounter`]) and its sums |
//! | [`io`] | files: pictures ([`io::film`]), batches of rays as NumPy archives ([`io::rays`]), files written whole or not at all ([`io::output`]), false colours ([`io::aov`]), comparisons ([`io::compare`]) |
//! | [`stats`] | statistics of a run |
//! | [`stress`] | hard rays with exact answers by rational arithmetic: generators, exact tracer, judge, replays; [`stress::closed`]: rays that must hit closed models, without exact answers |
//! | [`study`] | studies: methods timed by turns and judged, charts of speed against accuracy, the thesis's tables and graphs, and the report (`study/studies/` one question each, `lab.rs` measures, `draw.rs` and `page.rs` show) |
//! | `cl/` | `shared/` arithmetic and rays, `intersect/` and `traverse/` one method a file (triangles of instances are placed in `shared/instances.cl`), `packets/` sixteen rays at a time, or four times sixteen, through the kd-tree or the wide hierarchy, and what they have hit (`packets/surfaces.cl`), `lanes/` for how many numbers at a time a file is compiled next, `shade/` surfaces, textures and light, `kernels/` entry points (pictures: `render.cl` all steps in one kernel, `wavefront.cl` one in each) |
//!
//! # Invariants
//!
//! * Nothing but [`device`] calls OpenCL; nothing but the binary prints, exits or reads arguments.
//! * Traversal never reads shading data. Kernels reach the scene's arrays only through the macros of `cl/shared/memory.cl`.
//! * `cl/shared/compiler.cl` comes before every program: no compiler may regroup, fuse or assume away anything, whatever its options.
//! * No recursion on the device; no built-in of free rounding (`dot`, `normalize`, `pow`, …) in `cl/`.
//! * No absolute epsilon anywhere, `cl/intersect/thesis.cl` apart, which shows why: bounds are derived, and live in `cl/shared/ray.cl`, `cl/shared/slab.cl` and the files of exact hits.
//! * A hit does not depend on the order in which triangles are tested: at the same t the lower triangle number wins.
//!
//! # Example
//!
//! ```
//! use raybrook::low_level::options::TraceOptions;
//! use raybrook::low_level::pack::SceneBuffers;
//! use raybrook::low_level::scene::{Builder, Material, Samples};
//! use raybrook::low_level::renderer::{Picture, complete, open_tracer, render};
//! use std::sync::Arc;
//!
//! # fn main() -> raybrook::Result<()> {
//! let mut builder = Builder::new();
//! builder.material(Material::matt([0.8, 0.2, 0.1].into()));
//! builder.sphere(1.0, 32);
//! let mut scene = builder.finish()?;
//! complete(&mut scene, 4.0 / 3.0); // a camera that frames it, and light
//!
//! let options = TraceOptions::default();
//! let buffers = Arc::new(SceneBuffers::new(&scene, &options)?);
//! let (size, samples) = ((32, 24), Samples::PerPixel(1));
//! let picture = Picture { camera: scene.camera.unwrap(), size, samples, depth: 4, kill_weight: None };
//! let mut tracer = open_tracer(None, &buffers, &options, picture.depth, None)?; // None: the reference
//! let result = render(tracer.as_mut(), &buffers, &picture, &|_| ())?;
//! assert!(result.counts[1] > 100, "camera rays hit the sphere");
//! # Ok(())
//! # }
//! ```

#![warn(missing_docs)]

mod accel;
mod adaptive;
mod bounds;
mod budget;
mod device;
mod device_info;
mod error;
mod features;
mod io;
mod layout;
pub mod low_level;
mod math;
mod options;
mod pack;
mod random;
mod ray_order;
mod reference;
mod renderer;
mod scene;
mod shared;
mod stats;
mod tracer;
mod tune;
mod work;

pub use error::{Error, Result};
