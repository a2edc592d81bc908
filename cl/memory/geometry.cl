// Where the scene's data lies. These five files are the only ones that know in which memory the arrays are:
//   geometry.cl  the arrays, how kernels get them, and how functions pass them on
//   deferral.cl  triangles and items that are left to a second pass
//   work.cl      counting of what traversals do and read
//   records.cl   the macros that read nodes, references, vertices and precomputed data
//   shading.cl   those that read shading data
//
// The host chooses by definitions (src/device/scene.rs and definitions.rs):
//
//   macro                where it is defined                                      where it is not
//   MEMORY_BUFFER_IMAGE  the arrays are image1d_buffer_t: read through the        they are __global pointers
//                        texture cache
//   MEMORY_IMAGE2D       the arrays are image2d_t of IMAGE_WIDTH (a power of      the same
//                        two) texels a row: for devices with small buffer images
//   CONSTANT_NODES=n     the first n nodes lie in __constant memory, too, and     all nodes are read from `nodes`
//                        are read there; n = ALL_NODES: all of them
//   CONSTANT_REFERENCES  `references` lies in __constant memory                   it lies in __global memory
//   CONSTANT_VERTICES    `vertices` lies in __constant memory                     it lies in __global memory
//   LEAF_ORDER           vertices and transforms are copied for each reference,   they are there once for each triangle
//                        in the order of the leaves
//   WHOLE_TRIANGLES      shading data lies behind the vertices of its triangle    it lies in an array of its own
//   DEFER_UNDECIDED      what only exact integers can decide is left to a second  every test is decided at once
//                        pass over the rays or pixels that met it: the many
//                        registers for it are not in the kernels that all others
//                        run (deferral.cl)
//   RESOLVE_DEFERRED     the kernels are that second pass                         work-item i takes item i
//   INSTANCES            vertices and shading data are those of objects, which    triangles are in tracing space
//                        are placed when they are read (shared/instances.cl)
//   COUNT_WORK           what is read, and what traversals COUNT, is added up in  nothing is counted (work.cl)
//                        the Geometry
//
// Images cannot be members of a struct (OpenCL C 1.2, section 6.9 b), so they are parameters of their own. Every
// function that reads the scene begins its parameters with GEOMETRY_PARAMETERS and is called with GEOMETRY, or
// GEOMETRY_AT(&a_geometry).

#ifdef CONSTANT_REFERENCES
#define REFERENCES_IN __constant
#else
#define REFERENCES_IN __global
#endif
#ifdef CONSTANT_VERTICES
#define VERTICES_IN __constant
#else
#define VERTICES_IN __global
#endif

#if defined(MEMORY_BUFFER_IMAGE)
#define IMAGE __read_only image1d_buffer_t
#define IMAGE_AT(index) (int)(index)
#elif defined(MEMORY_IMAGE2D)
#define IMAGE __read_only image2d_t
#define IMAGE_AT(index) (int2)((int)((index) % IMAGE_WIDTH), (int)((index) / IMAGE_WIDTH))
#endif

// A ray that meets more triangles undecided is left to the second pass. Around a vertex there are six, and some rays go
// from one vertex to another.
#define MAX_POSTPONED 16u
#ifdef DEFER_UNDECIDED
typedef struct {
    uint is_deferred; // 1: something is left to the second pass
    uint count;
    // Triangles that the ray may hit; apart, so that the numbers above are in registers where this goes to a call.
    uint* primitives;
} Undecided;
#endif

#ifdef INSTANCES
// The instance that was read last, and the one that a traversal is in.
typedef struct {
    uint first, count; // its triangles; none at first
    uint to_slot;      // a triangle's place in the arrays is its number and this
    uint instance;
    float4 row0, row1, row2; // to the world
    uint to_primitive;       // of the traversal's instance: a triangle's number is its place and this
} Placed;
#endif

// The arrays:
//   nodes             KdNode records
//   references        leaf lists; for brute force: every triangle that can be hit
//   vertices          VERTEX_STRIDE for each triangle or, with LEAF_ORDER, reference
//   bounds            boxes, spheres, links or instances of the structure; what they are its own file says
//   transforms        precomputed data of triangles (or references), for the triangle tests that want it
//   surface_vertices  with LEAF_ORDER: three for each triangle, for who knows a triangle and not where it is listed
typedef struct {
#ifndef IMAGE
    __global const int4* nodes;
    REFERENCES_IN const uint* references;
    VERTICES_IN const float4* vertices;
    __global const float4* bounds;
    __global const float4* transforms;
#endif
#ifdef CONSTANT_NODES
    __constant const int4* constant_nodes;
#endif
#ifdef LEAF_ORDER
    __global const float4* surface_vertices;
#endif
    float3 low, high;     // box around all triangles
    float near_reach;     // how far most triangles reach, where few others reach very much farther, else 0 (slab.cl)
    float padding;        // by how much boxes are larger than what they hold (slab.cl)
    uint reference_count; // for brute force; with INSTANCES how many there are
    float scale;          // tracing space = world units times this
#ifdef COUNT_WORK
    uint* work; // WORK_COUNTERS sums
#endif
#ifdef DEFER_UNDECIDED
    Undecided* undecided;
#endif
#ifdef INSTANCES
    Placed* placed;
#endif
} Geometry;

// GEOMETRY_ARGUMENTS: what every tracing kernel's arguments begin with. MAKE_GEOMETRY: the Geometry made of them.
#ifdef CONSTANT_NODES
#define CONSTANT_NODES_ARGUMENT __constant const int4* restrict constant_nodes,
#define CONSTANT_NODES_VALUE constant_nodes,
#else
#define CONSTANT_NODES_ARGUMENT
#define CONSTANT_NODES_VALUE
#endif
#ifdef LEAF_ORDER
#define SURFACE_VERTICES_ARGUMENT __global const float4* restrict surface_vertices,
#define SURFACE_VERTICES_VALUE surface_vertices,
#else
#define SURFACE_VERTICES_ARGUMENT
#define SURFACE_VERTICES_VALUE
#endif
#ifdef COUNT_WORK
#define WORK_VALUE(sums) , sums
#else
#define WORK_VALUE(sums)
#endif
#ifdef DEFER_UNDECIDED
#define UNDECIDED_POINTER , &undecided
#else
#define UNDECIDED_POINTER
#endif
#ifdef INSTANCES
#define PLACED Placed placed = {0u, 0u, 0u, 0u, (float4)(0.0f), (float4)(0.0f), (float4)(0.0f), 0u};
#define PLACED_VALUE , &placed
#else
#define PLACED
#define PLACED_VALUE
#endif
#define SCENE_VALUES                                                                                                 \
    CONSTANT_NODES_VALUE SURFACE_VERTICES_VALUE scene_params->low.xyz, scene_params->high.xyz, scene_params->high.w, \
        scene_params->low.w, scene_params->reference_count, scene_params->scale

#ifdef IMAGE
#define IMAGES IMAGE nodes, IMAGE references, IMAGE vertices, IMAGE bounds, IMAGE transforms
#define GEOMETRY_ARGUMENTS \
    IMAGES, CONSTANT_NODES_ARGUMENT SURFACE_VERTICES_ARGUMENT __global const SceneParams* restrict scene_params
#define MAKE_GEOMETRY_COUNTING(sums) { SCENE_VALUES WORK_VALUE(sums) UNDECIDED_POINTER PLACED_VALUE }
#define IMAGE_PARAMETERS , IMAGES
#define IMAGE_VALUES , nodes, references, vertices, bounds, transforms
#else
#define GEOMETRY_ARGUMENTS                                                                   \
    __global const int4* restrict nodes, REFERENCES_IN const uint* restrict references,      \
        VERTICES_IN const float4* restrict vertices, __global const float4* restrict bounds, \
        __global const float4* restrict transforms,                                          \
        CONSTANT_NODES_ARGUMENT SURFACE_VERTICES_ARGUMENT __global const SceneParams* restrict scene_params
#define MAKE_GEOMETRY_COUNTING(sums) \
    { nodes, references, vertices, bounds, transforms, SCENE_VALUES WORK_VALUE(sums) UNDECIDED_POINTER PLACED_VALUE }
#define IMAGE_PARAMETERS
#define IMAGE_VALUES
#endif

// What kernels declare before they make a Geometry: what traversals and readers of triangles keep in it.
#define TRAVERSAL_STATE UNDECIDED_STATE PLACED

// For rare calls from kernels, which make the Geometry anew: what a call gets a pointer to lies in memory for all of
// its life.
//   GEOMETRY_VALUES  the arguments for GEOMETRY_ARGUMENTS
//   STATE_ARGUMENTS  what the kernel has noted, behind these; STATE_VALUES: the arguments for them
//   TAKE_STATE       what the called function declares in place of TRAVERSAL_STATE; it returns IS_DEFERRED
//   TAKE_DEFERRED       takes that from the call
#define GEOMETRY_VALUES \
    nodes, references, vertices, bounds, transforms, CONSTANT_NODES_VALUE SURFACE_VERTICES_VALUE scene_params
#ifdef COUNT_WORK
#define STATE_ARGUMENTS , uint* work UNDECIDED_ARGUMENT
#define STATE_VALUES , work UNDECIDED_VALUE
#else
#define STATE_ARGUMENTS UNDECIDED_ARGUMENT
#define STATE_VALUES UNDECIDED_VALUE
#endif
#define TAKE_STATE TAKE_UNDECIDED PLACED

#define MAKE_GEOMETRY MAKE_GEOMETRY_COUNTING(work)
#define GEOMETRY_PARAMETERS const Geometry* geometry IMAGE_PARAMETERS
#define GEOMETRY_AT(pointer) pointer IMAGE_VALUES
#define GEOMETRY GEOMETRY_AT(geometry)
