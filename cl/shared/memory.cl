// Where the scene's data lies, and the only macros that read it: no other file knows in which memory the arrays are.
//
// The host chooses by definitions (src/device/scene.rs):
//   MEMORY_BUFFER_IMAGE  the arrays are image1d_buffer_t: read through the texture cache
//   MEMORY_IMAGE2D       the arrays are image2d_t of IMAGE_WIDTH (a power of two) texels a row: for devices with small buffer images
//   CONSTANT_NODES=n     the first n nodes lie in __constant memory, too, and are read there; n = ALL_NODES: all of them
//   CONSTANT_REFERENCES, CONSTANT_VERTICES  that array lies in __constant memory
//   LEAF_ORDER           vertices and transforms are copied for each reference, in the order of the leaves
//   WHOLE_TRIANGLES      shading data lies behind the vertices of its triangle, not in an array of its own
//   DEFER_DOUBTS         what only exact integers can decide is left to a second pass over the rays or pixels that met it, so that
//                        their many registers are not in the kernels that all others run: see deferred items below
//   RESOLVE_DOUBTS       the kernels are that second pass
//   INSTANCES            vertices and shading data are those of objects, which are placed when they are read: instances.cl
//   COUNT_WORK           what is read, and what traversals COUNT, is added up in the Geometry: see COUNT below
//
// Images cannot be members of a struct (OpenCL C 1.2, section 6.9 b), so they are parameters of their own. Every function that
// reads the scene begins its parameters with GEOMETRY_PARAMETERS and is called with GEOMETRY, or GEOMETRY_AT(&a_geometry).

// Records of a triangle in `vertices`: three corners, and with WHOLE_TRIANGLES the four float4 of its Shading.
#ifdef WHOLE_TRIANGLES
#define VERTEX_STRIDE 7u
#else
#define VERTEX_STRIDE 3u
#endif

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

// Of a ray, or a packet of rays, that meets more undecided triangles, the rest is left to the second pass, or to its rays by themselves.
// Around a vertex there are six.
#define MAX_POSTPONED 8u
#ifdef DEFER_DOUBTS
typedef struct {
    uint is_deferred; // 1: something is left to the second pass
    uint count;
    uint* primitives; // triangles that the ray may hit; apart, so that the numbers above are in registers where this goes to a call
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
#ifdef DEFER_DOUBTS
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
#ifdef DEFER_DOUBTS
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
#define SCENE_VALUES                                                                                                     \
    CONSTANT_NODES_VALUE SURFACE_VERTICES_VALUE scene_params->low.xyz, scene_params->high.xyz, scene_params->high.w,           \
        scene_params->low.w, scene_params->reference_count, scene_params->scale

#ifdef IMAGE
#define IMAGES IMAGE nodes, IMAGE references, IMAGE vertices, IMAGE bounds, IMAGE transforms
#define GEOMETRY_ARGUMENTS                                                                                              \
    IMAGES, CONSTANT_NODES_ARGUMENT SURFACE_VERTICES_ARGUMENT __global const SceneParams* restrict scene_params
#define MAKE_GEOMETRY_COUNTING(sums) { SCENE_VALUES WORK_VALUE(sums) UNDECIDED_POINTER PLACED_VALUE }
#define IMAGE_PARAMETERS , IMAGES
#define IMAGE_VALUES , nodes, references, vertices, bounds, transforms
#define NODE_FROM_BUFFER(geometry, index) read_imagei(nodes, IMAGE_AT(index))
#define REFERENCE_RECORD(geometry, index) read_imageui(references, IMAGE_AT(index)).x
#define VERTEX_RECORD(geometry, index) as_float4(read_imagei(vertices, IMAGE_AT(index)))
#define BOUNDS_RECORD(geometry, index) as_float4(read_imagei(bounds, IMAGE_AT(index)))
#define TRANSFORM_RECORD(geometry, index) as_float4(read_imagei(transforms, IMAGE_AT(index)))
#else
#define GEOMETRY_ARGUMENTS                                                                                              \
    __global const int4* restrict nodes, REFERENCES_IN const uint* restrict references,                                 \
        VERTICES_IN const float4* restrict vertices, __global const float4* restrict bounds,                            \
        __global const float4* restrict transforms,                                                                     \
        CONSTANT_NODES_ARGUMENT SURFACE_VERTICES_ARGUMENT __global const SceneParams* restrict scene_params
#define MAKE_GEOMETRY_COUNTING(sums) \
    { nodes, references, vertices, bounds, transforms, SCENE_VALUES WORK_VALUE(sums) UNDECIDED_POINTER PLACED_VALUE }
#define IMAGE_PARAMETERS
#define IMAGE_VALUES
#define NODE_FROM_BUFFER(geometry, index) ((geometry)->nodes[index])
#define REFERENCE_RECORD(geometry, index) ((geometry)->references[index])
#define VERTEX_RECORD(geometry, index) ((geometry)->vertices[index])
#define BOUNDS_RECORD(geometry, index) ((geometry)->bounds[index])
#define TRANSFORM_RECORD(geometry, index) ((geometry)->transforms[index])
#endif

// What kernels declare before they make a Geometry: what traversals and readers of triangles keep in it.
#define TRAVERSAL_STATE UNDECIDED_STATE PLACED

// For rare calls from kernels, which make the Geometry anew: what a call gets a pointer to lies in memory for all of its life.
//   GEOMETRY_VALUES  the arguments for GEOMETRY_ARGUMENTS
//   STATE_ARGUMENTS  what the kernel has noted, behind these; STATE_VALUES: the arguments for them
//   TAKE_STATE       what the called function declares in place of TRAVERSAL_STATE; it returns IS_DEFERRED
//   TAKE_DEFERRED    takes that from the call
#define GEOMETRY_VALUES \
    nodes, references, vertices, bounds, transforms, CONSTANT_NODES_VALUE SURFACE_VERTICES_VALUE scene_params
#ifdef DEFER_DOUBTS
#define UNDECIDED_ARGUMENT , uint is_deferred, uint count, uint* postponed
#define UNDECIDED_VALUE , undecided.is_deferred, undecided.count, undecided.primitives
#define TAKE_UNDECIDED Undecided undecided = {is_deferred, count, postponed};
#define TAKE_DEFERRED(call) undecided.is_deferred = (call) ? 1u : 0u
#else
#define UNDECIDED_ARGUMENT
#define UNDECIDED_VALUE
#define TAKE_UNDECIDED
#define TAKE_DEFERRED(call) (void)(call)
#endif
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

#define ALL_NODES 0xffffffffu
#if !defined(CONSTANT_NODES)
#define NODE_RECORD(geometry, index) NODE_FROM_BUFFER(geometry, index)
#else
int4 load_node(const Geometry* geometry, uint index) {
    if (CONSTANT_NODES == ALL_NODES || index < CONSTANT_NODES) return geometry->constant_nodes[index];
    return geometry->nodes[index];
}
#define NODE_RECORD(geometry, index) load_node(geometry, index)
#endif

// Deferred items. Every kernel has an array `deferred` as an argument: how many items are deferred, then which.
//   postpone           puts a triangle aside until the traversal is done; false in kernels that decide everything at once
//   DECIDE_BY_INTEGERS what `call`, in exact integers, decides; or false, and the item is deferred
//   NOTE_DEFERRED      puts an item on the list if it is deferred
//   FORGET_DEFERRED    whether an item is deferred, and forgets it: for work-items with several items, which put them on the list by
//   ADD_DEFERRED
//   ITEM_OF            the item of work-item number i: in the second pass that on the list
//   RAY_OF             the same of the rays of a batch, which may have rows: ROWS_ARGUMENT, see batch.cl
#define DEFERRED_ARGUMENT volatile __global uint* restrict deferred,
#ifdef DEFER_DOUBTS
#define UNDECIDED_STATE                  \
    uint postponed[MAX_POSTPONED]; \
    Undecided undecided = {0u, 0u, postponed};
#define DECIDE_BY_INTEGERS(geometry, call) ((geometry)->undecided->is_deferred = 1u, false)
#define IS_DEFERRED (undecided.is_deferred != 0u)
#define ADD_DEFERRED(item) deferred[1u + atomic_inc(&deferred[0])] = item
#define FORGET_DEFERRED(geometry) forget_deferred(geometry)
#define NOTE_DEFERRED(item)    \
    if (IS_DEFERRED) ADD_DEFERRED(item)
bool forget_deferred(const Geometry* geometry) {
    const bool is_deferred = geometry->undecided->is_deferred != 0u;
    geometry->undecided->is_deferred = 0u;
    return is_deferred;
}
bool postpone(const Geometry* geometry, uint primitive) {
    Undecided* undecided = geometry->undecided;
    for (uint i = 0; i < undecided->count; i++)
        if (undecided->primitives[i] == primitive) return true; // met again in another leaf
    if (undecided->count == MAX_POSTPONED)
        undecided->is_deferred = 1u;
    else
        undecided->primitives[undecided->count++] = primitive;
    return true;
}
#else
#define UNDECIDED_STATE
#define DECIDE_BY_INTEGERS(geometry, call) call
#define IS_DEFERRED false
#define ADD_DEFERRED(item)
#define FORGET_DEFERRED(geometry) false
#define NOTE_DEFERRED(item)
bool postpone(const Geometry* geometry, uint primitive) { return false; }
#endif
#ifdef RESOLVE_DOUBTS
#define ITEM_OF(i) deferred[1u + (i)]
#define RAY_OF(i) ITEM_OF(i)
#else
#define ITEM_OF(i) (i)
#define RAY_OF(i) ray_at(i, row, in_bands)
#endif

// Counting (WorkCounter in src/shared.rs says what is what). A sum that outgrows 32 bits stays at the largest number. Without
// COUNT_WORK nothing of it is in the code.
//   WORK_SUMS        declares the sums of a Geometry; those of MAKE_GEOMETRY are called `work`
//   COUNT            adds n to a counter
//   COUNT_DEEPEST    raises the deepest stack to so many entries
//   COUNTED          a value that was read, counted as so many bytes
//   WORK_ARGUMENT    the kernels' array of WORK_COUNTERS numbers a ray or pixel, before the last two arguments
//   STORE_WORK       writes what was counted in a Geometry as record `index` of that array
#ifdef COUNT_WORK
void count_work(uint* work, uint counter, uint n) { work[counter] = add_sat(work[counter], n); }
void store_work(__global uint* records, uint index, const Geometry* geometry) {
    for (uint i = 0; i < WORK_COUNTERS; i++) records[(size_t)index * WORK_COUNTERS + i] = geometry->work[i];
}
#define WORK_SUMS(name) uint name[WORK_COUNTERS] = {0};
#define COUNT(geometry, counter, n) count_work((geometry)->work, WORK_##counter, n)
#define COUNT_DEEPEST(geometry, n) (geometry)->work[WORK_DEEPEST_STACK] = max((geometry)->work[WORK_DEEPEST_STACK], n)
#define COUNTED(geometry, counter, bytes, value) (COUNT(geometry, counter, bytes), value)
#define WORK_ARGUMENT __global uint* restrict work_records,
#define STORE_WORK(geometry, index) store_work(work_records, index, geometry)
#else
#define WORK_SUMS(name)
#define COUNT(geometry, counter, n)
#define COUNT_DEEPEST(geometry, n)
#define COUNTED(geometry, counter, bytes, value) value
#define WORK_ARGUMENT
#define STORE_WORK(geometry, index)
#endif

// Eight numbers: two records one behind the other, the first one with an even number; and number `lane` of these. The links of a wide
// node are such numbers, too.
#if defined(IMAGE) || defined(CONSTANT_NODES)
#define EIGHT_NODE_WORDS(geometry, record) \
    (float8)(as_float4(NODE_RECORD(geometry, record)), as_float4(NODE_RECORD(geometry, (record) + 1u)))
#define NODE_WORD(geometry, record, lane) word_of(NODE_RECORD(geometry, (record) + (lane) / 4u), (lane) % 4u)
uint word_of(int4 record, uint i) { return (uint)(i == 0u ? record.x : i == 1u ? record.y : i == 2u ? record.z : record.w); }
#else
#define EIGHT_NODE_WORDS(geometry, record) vload8(0, (__global const float*)((geometry)->nodes + (record)))
#define NODE_WORD(geometry, record, lane) ((__global const uint*)((geometry)->nodes + (record)))[lane]
#endif
#ifdef IMAGE
#define BOUNDS_WORD(geometry, record, lane) word_of(as_int4(BOUNDS_RECORD(geometry, (record) + (lane) / 4u)), (lane) % 4u)
#define EIGHT_BOUNDS_WORDS(geometry, record) \
    (float8)(BOUNDS_RECORD(geometry, record), BOUNDS_RECORD(geometry, (record) + 1u))
#else
#define BOUNDS_WORD(geometry, record, lane) ((__global const uint*)((geometry)->bounds + (record)))[lane]
#define EIGHT_BOUNDS_WORDS(geometry, record) vload8(0, (__global const float*)((geometry)->bounds + (record)))
#endif
#define LOAD_EIGHT(geometry, record) COUNTED(geometry, NODE_BYTES, sizeof(float8), EIGHT_NODE_WORDS(geometry, record))
#define LOAD_LANE(geometry, record, lane) as_float(COUNTED(geometry, NODE_BYTES, sizeof(uint), NODE_WORD(geometry, record, lane)))
#define LOAD_LINK(geometry, node, lane) COUNTED(geometry, NODE_BYTES, sizeof(uint), NODE_WORD(geometry, (node) + BVH8_LINKS, lane))
#define LOAD_PACKET(geometry, record) COUNTED(geometry, TRIANGLE_BYTES, sizeof(float8), EIGHT_BOUNDS_WORDS(geometry, record))
#define LOAD_PACKET_LANE(geometry, record, lane) \
    as_float(COUNTED(geometry, TRIANGLE_BYTES, sizeof(uint), BOUNDS_WORD(geometry, record, lane)))

#define LOAD_NODE(geometry, index) COUNTED(geometry, NODE_BYTES, sizeof(int4), NODE_RECORD(geometry, index))
#define LOAD_BOUNDS(geometry, index) COUNTED(geometry, NODE_BYTES, sizeof(float4), BOUNDS_RECORD(geometry, index))
#define LOAD_REFERENCE(geometry, index) COUNTED(geometry, TRIANGLE_BYTES, sizeof(uint), REFERENCE_RECORD(geometry, index))
#define LOAD_TRANSFORM(geometry, index) COUNTED(geometry, TRIANGLE_BYTES, sizeof(float4), TRANSFORM_RECORD(geometry, index))
#define LOAD_VERTEX(geometry, slot, corner) \
    COUNTED(geometry, TRIANGLE_BYTES, sizeof(float4), TRIANGLE_VERTEX(geometry, slot, corner))

// Where the data for testing reference `index` of triangle `primitive` lies: what the triangle tests call the slot.
#ifdef LEAF_ORDER
#define SLOT_OF(index, primitive) (index)
#define LOAD_SURFACE_VERTEX(geometry, triangle, corner) ((geometry)->surface_vertices[3u * (triangle) + (corner)].xyz)
#else
#define SLOT_OF(index, primitive) (primitive)
#define LOAD_SURFACE_VERTEX(geometry, triangle, corner) TRIANGLE_VERTEX(geometry, triangle, corner)
#endif
#ifdef INSTANCES
#define TRIANGLE_VERTEX(geometry, slot, corner) placed_vertex(GEOMETRY_AT(geometry), slot, corner)
float3 placed_vertex(GEOMETRY_PARAMETERS, uint primitive, uint corner);
#else
#define TRIANGLE_VERTEX(geometry, slot, corner) (VERTEX_RECORD(geometry, VERTEX_STRIDE * (slot) + (corner)).xyz)
#endif

// The triangle that a reference stands for.
#ifdef INSTANCES
#define PRIMITIVE_OF(geometry, reference) ((reference) + (geometry)->placed->to_primitive)
#else
#define PRIMITIVE_OF(geometry, reference) (reference)
#endif

// Shading data of a triangle, and of these its material alone. `shading` is the array of those, which WHOLE_TRIANGLES leaves empty. Where
// kernels need no normals and texture coordinates, it has numbers of materials alone, or nothing if there is one material
// (Features::need_shading_data in src/features.rs).
//   SHADING_RECORD, MATERIAL_RECORD  by the triangle's place in the array
#if FEATURES & (FEATURE_SMOOTH_NORMALS | FEATURE_IMAGE_TEXTURES | FEATURE_PROCEDURAL_TEXTURES)
#define SHADING_RECORD(shading, slot) ((shading)[slot])
#define MATERIAL_RECORD(shading, slot) ((shading)[slot].material)
#else
#define SHADING_RECORD(shading, slot) shading_of_material(shading, slot)
#define MATERIAL_RECORD(shading, slot) ((__global const uint*)(shading))[slot]
Shading shading_of_material(__global const Shading* shading, uint slot) {
    const float4 none = (float4)(0.0f);
    const Shading at = {none, none, none, 0.0f, 0.0f, 0.0f, HAS(FEATURE_SEVERAL_MATERIALS) ? MATERIAL_RECORD(shading, slot) : 0u};
    return at;
}
#endif
#ifdef WHOLE_TRIANGLES
#define LOAD_SHADING(shading, triangle) whole_shading(GEOMETRY, triangle)
#define LOAD_MATERIAL(shading, triangle) as_uint(VERTEX_RECORD(geometry, VERTEX_STRIDE * (triangle) + 6u).w)
Shading whole_shading(GEOMETRY_PARAMETERS, uint triangle) {
    Shading shading;
    shading.normal0_u0 = VERTEX_RECORD(geometry, VERTEX_STRIDE * triangle + 3u);
    shading.normal1_u1 = VERTEX_RECORD(geometry, VERTEX_STRIDE * triangle + 4u);
    shading.normal2_u2 = VERTEX_RECORD(geometry, VERTEX_STRIDE * triangle + 5u);
    const float4 rest = VERTEX_RECORD(geometry, VERTEX_STRIDE * triangle + 6u);
    shading.v0 = rest.x;
    shading.v1 = rest.y;
    shading.v2 = rest.z;
    shading.material = as_uint(rest.w);
    return shading;
}
#elif defined(INSTANCES)
#define LOAD_SHADING(shading, triangle) placed_shading(GEOMETRY, shading, triangle)
#define LOAD_MATERIAL(shading, triangle) placed_material(GEOMETRY, shading, triangle)
#else
#define LOAD_SHADING(shading, triangle) SHADING_RECORD(shading, triangle)
#define LOAD_MATERIAL(shading, triangle) MATERIAL_RECORD(shading, triangle)
#endif
