//! An exact and fast ray tracer for triangle scenes, on any OpenCL device.
//!
//! A ray tracer finds which triangle a ray (an origin and a direction) meets first. Pictures, visibility and distances
//! are made of such answers.
//!
//! From a file to a picture:
//!
//! ```no_run
//! use raybrook::{Scene, Tracer, View};
//!
//! let scene = Scene::load("bunny.obj")?; // .toml, .obj, .ply, .stl, .gltf, .glb, .off, .3mf or .nff
//! let mut tracer = Tracer::new(&scene)?; // the fastest device and method; exact: see below
//! tracer.render(&View::new(640, 480))?.save("bunny.png")?;
//! # Ok::<(), raybrook::Error>(())
//! ```
//!
//! From arrays to hits:
//!
//! ```
//! use raybrook::{Ray, Scene, Tracer};
//!
//! let positions = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0]];
//! let scene = Scene::from_mesh(&positions, &[[0, 1, 2], [0, 2, 3]])?;
//! let mut tracer = Tracer::new(&scene)?;
//! let rays = [Ray::new([1.0, 2.0, 5.0], [0.0, 0.0, -2.0]), Ray::new([9.0, 2.0, 5.0], [0.0, 0.0, -2.0])];
//! let hits = tracer.closest_hits(&rays)?;
//!
//! let hit = hits[0].expect("the first ray hits the square");
//! assert_eq!((hit.t, hit.triangle), (2.5, 1)); // t counts in the direction's length
//! assert_eq!((hit.u, hit.v), (0.25, 0.25)); // weights of the triangle's second and third vertex
//! assert_eq!(hits[1], None);
//! assert_eq!(tracer.any_hits(&rays)?, [true, false]);
//! assert_eq!(tracer.count_hits(&rays)?, [1, 0]); // and all_hits() lists them
//! assert_eq!(tracer.distances(&[[1.0, 2.0, 5.0]])?, [5.0]); // and closest_points() tells where
//! # Ok::<(), raybrook::Error>(())
//! ```
//!
//! All coordinates are world units. [`Builder`] makes scenes of solids, materials and lights; the folder `examples/`
//! has programs.
//!
//! # What exact means
//!
//! Rays and triangles are float32 numbers. Whether a ray hits a triangle, and which of two hits is nearer, has one
//! right answer, and you get it. Fast float32 arithmetic with derived error bounds decides the clear cases; exact
//! integer arithmetic decides the close ones. No ray slips through an edge that two triangles share. t, u and v are the
//! exact values, rounded once. So the hits are the same, to the bit, on every device and by every structure.
//! [`Precision::Fast`] gives that up for a plain float32 test.
//!
//! A *kernel* is code that runs on the device. Each has a *twin*: a plain Rust function that does the same operations
//! in the same order. The twins together are the *reference*: tests compare kernels with it, and it traces where there
//! is no OpenCL device.
//!
//! # What can be chosen
//!
//! [`Tracer::new`] chooses as the command line does, and [`Tracer::choices`] tells what and why. [`Tracer::builder`]
//! takes other choices:
//!
//! | choice | values | default |
//! |---|---|---|
//! | [`device`](TracerBuilder::device) | `gpu`, `cpu`, `reference`, a number or a part of a name ([`devices()`] lists them); several, as in `0,2`, or `all` | the fastest |
//! | [`method`](TracerBuilder::method) | structure, build, traversal and triangle test, as in `kd+ropes+plucker` | the fastest exact one |
//! | [`precision`](TracerBuilder::precision) | [`Precision::Exact`], [`Precision::Fast`] | exact |
//! | [`progress`](TracerBuilder::progress) | a function | none |
//! | [`stop`](TracerBuilder::stop) | a flag that stops calls | none |
//! | [`fall_back`](TracerBuilder::fall_back) | whether to continue on the processor, by the reference, if the device fails | no |
//! | [`memory_limit`](TracerBuilder::memory_limit) | bytes | 90 % of the free memory |
//! | [`cache`](TracerBuilder::cache), [`cache_folder`](TracerBuilder::cache_folder) | whether and where compiled kernels are kept | the user's cache |
//!
//! # How the code is arranged
//!
//! Everything below is in [`low_level`], for programs that replace a part or measure the parts; it may change with any
//! version.
//!
//! ```text
//!  scene file ──load──▶ Scene ──build──▶ structure ──pack──▶ SceneBuffers ──▶ kernels ──▶ Film ──▶ picture
//!              (scene/)         (accel/)             (pack/)      │   (cl/, device/)
//!  rays ──────────────────────────────────────────────────────────┤
//!                                                                 ▼
//!                                   reference/ (the same algorithms, file for file) ──▶ compare
//! ```
//!
//! | module | what it does |
//! |---|---|
//! | [`scene`](low_level::scene) | scenes in world units, their [`Builder`], loaders of files, instances of objects |
//! | [`accel`](low_level::accel) | builders of structures, their statistics, the check of a kd-tree's invariants |
//! | [`shared`](low_level::shared), [`layout`](low_level::layout) | structs that host and kernels share, defined once |
//! | [`pack`](low_level::pack) | scene and structure as flat arrays in tracing space, for kernels and twin alike |
//! | [`device`](low_level::device) | OpenCL: list, choose, compile, upload, launch |
//! | [`mod@reference`](low_level::reference) | the scalar twin, and an oracle in f64 with a hierarchy of its own |
//! | [`tracer`](low_level::tracer), [`renderer`](low_level::renderer) | the common interface of device and reference; opens one of them for a scene |
//! | [`crossings`](low_level::crossings), [`closest`](low_level::closest), [`winding`](low_level::winding) | crossings of surfaces, points inside; closest points and distances; winding numbers |
//! | [`extreme`](low_level::extreme) | rays with extremely large or small numbers |
//! | [`adaptive`](low_level::adaptive), [`features`](low_level::features) | pictures of bounded error; what a scene needs of the kernels that shade |
//! | [`options`](low_level::options) | what can be chosen, and what goes together |
//! | [`choose`](low_level::choose) | automatic choices and their reasons: by a model, or by what was measured |
//! | [`budget`](low_level::budget), [`parallel`](low_level::parallel) | how much memory may be taken; loops on all cores |
//! | [`layers`](low_level::layers), [`planes`](low_level::planes), [`animation`](low_level::animation) | depth, normals and other data of each pixel, and their files; pictures one after the other |
//! | [`film`](low_level::film), [`output`](low_level::output), [`rays`](low_level::rays) | files of pictures and rays |
//! | [`several`](low_level::several) | work by several devices at once |
//! | [`runs`](low_level::runs), [`journal`](low_level::journal) | batches of rays in runs; files that long work is kept in |
//! | [`stats`](low_level::stats), [`work`](low_level::work), [`aov`](low_level::aov), [`compare`](low_level::compare) | statistics, counted work, comparisons |
//! | `cl/` | kernels: `intersect/` and `traverse/` have one method a file |
//!
//! # Invariants
//!
//! * Nothing but `device` calls OpenCL; nothing but the command line prints, exits or reads arguments.
//! * Traversal never reads shading data. Kernels reach the scene's arrays only through the macros of `cl/memory/`.
//! * `cl/shared/compiler.cl` comes before every program: no compiler may regroup, fuse or assume away anything,
//!   whatever its options.
//! * No recursion on the device; in `cl/` no built-in whose rounding OpenCL leaves open (`dot`, `normalize`, `pow`, …).
//! * No fixed tolerance anywhere but in `cl/intersect/thesis.cl`, which is kept to show why. Error bounds are derived,
//!   in `cl/shared/ray.cl`, `cl/shared/slab.cl` and the files of exact hits; `src/bounds.rs` has the values of those
//!   that builders and kernels share.
//! * A hit does not depend on the order in which triangles are tested: at the same t the lower triangle number wins.
//!
//! The project grew out of J. Dvořák, *Streaming Raytracer na GPU*, master's thesis, FIT VUT Brno 2008: a kd-tree, one
//! mega-kernel, Whitted shading.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))] // only the command line prints

mod accel;
mod adaptive;
mod blocks;
mod bounds;
mod budget;
mod choose;
mod closest;
mod crossings;
mod device;
mod device_info;
mod error;
mod features;
mod fma;
mod front;
mod io;
mod large_pages;
mod layers;
mod layout;
pub mod low_level;
mod math;
mod names;
mod options;
mod pack;
mod parallel;
mod random;
mod ray_order;
mod reference;
mod renderer;
mod runs;
pub mod scene;
mod several;
mod shared;
mod stats;
mod streamed;
mod tracer;
mod winding;
mod work;

pub use device::DeviceKind;
pub use error::{Error, Result};
pub use front::{
    AllHits, ClosestPoint, Device, Hit, Hits, LocalSpace, Picture, Precision, Ray, Rounding, Tracer, TracerBuilder,
    View, devices,
};
pub use glam;
pub use io::planes::{Plane, PlaneGroup};
pub use layers::Layer;
pub use scene::{Builder, Camera, Light, Material, Scene, Viewpoint};

/// The samples of the README and of the book, which are tests.
#[cfg(doctest)]
mod samples {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/book/src/embedding.md")]
    struct Embedding;
}
