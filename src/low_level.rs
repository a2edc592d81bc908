//! Everything below the front door: scenes as arrays, structures, what kernels are given, devices, the scalar twin. For
//! programs that replace a part, and for those that test and measure the parts: the command line, the stress test and
//! the studies are built on it.
//!
//! What stands here may change with any version.

/// Passes rooms of the library on.
macro_rules! rooms {
    ($($(#[doc = $doc:literal])+ $room:ident $(in $parent:ident)?,)+) => { $(
        $(#[doc = $doc])+
        pub mod $room {
            #[doc(inline)]
            pub use crate::$($parent::)?$room::*;
        }
    )+ };
}

rooms! {
    /// Builders of the structures that rays are traced through, their statistics, and the check of a kd-tree's
    /// invariants.
    accel,
    /// Pictures of bounded error: which pixels get how many samples.
    adaptive,
    /// Pictures one after the other in one file.
    animation in io,
    /// False-colour pictures of counted work.
    aov in io,
    /// How pictures are cut into blocks that are finished one by one, with the same pixels in any order.
    blocks,
    /// Bounds of rounding errors that builders, kernels and the twin share.
    bounds,
    /// How much memory may be taken, checked against estimates before it is.
    budget,
    /// What is taken where nothing is asked for: by the model, or by measuring.
    choose,
    /// Closest points of scenes to points, and distances.
    closest,
    /// Comparisons of pictures and of hits.
    compare in io,
    /// How often rays cross surfaces, and which points closed meshes contain.
    crossings,
    /// OpenCL devices: list, choose, compile, upload, launch.
    device,
    /// Rays whose numbers tracing space cannot hold, traced on the host with the same exact answers.
    extreme in reference,
    /// What a scene needs of the kernels that shade.
    features,
    /// Pictures in linear radiance, and their files.
    film in io,
    /// Input files, read whole.
    input in io,
    /// Journals: files that long work is kept in, piece by piece.
    journal in io,
    /// What a picture knows beside light: depth, normals, numbers of primitives and the like.
    layers,
    /// Vectors as kernels have them.
    layout,
    /// Arithmetic with the same bits everywhere.
    math,
    /// What can be chosen, and what goes together.
    options,
    /// Output files, written whole or not at all.
    output in io,
    /// Scene and structure as flat arrays in tracing space, which kernels and twin read alike.
    pack,
    /// Loops over many things on all cores.
    parallel,
    /// Layers of numbers of pixels, and OpenEXR files of them.
    planes in io,
    /// Random numbers that are the same on every machine.
    random,
    /// Batches of rays as NumPy archives, and answers about points.
    rays in io,
    /// The scalar twin of every kernel, and an oracle in f64.
    reference,
    /// From a scene and a device to what is ready to render it.
    renderer,
    /// Files of pictures, written row by row.
    rows in io,
    /// Batches of rays in runs, which are kept in a journal as they are finished.
    runs,
    /// Scenes in world units, and their loaders.
    scene,
    /// Work in pieces by several devices at once: blocks of pictures, runs of batches.
    several,
    /// The structs and constants that host and kernels share.
    shared,
    /// Statistics of a run.
    stats,
    /// The interface of everything that traces rays: batches and pictures, on a device or on the reference.
    tracer,
    /// Generalised winding numbers, of open meshes, too.
    winding,
    /// Counted work, and its sums.
    work,
}
