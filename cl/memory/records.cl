// Records of the scene's arrays, in whatever memory they are (geometry.cl). What is read for a traversal is counted
// (work.cl); other files read by the macros LOAD_... alone.

// Records of a triangle in `vertices`: three corners, and with WHOLE_TRIANGLES the four float4 of its Shading.
#ifdef WHOLE_TRIANGLES
#define VERTEX_STRIDE 7u
#else
#define VERTEX_STRIDE 3u
#endif

// Record `index` of an array.
#ifdef IMAGE
#define NODE_FROM_BUFFER(geometry, index) read_imagei(nodes, IMAGE_AT(index))
#define REFERENCE_RECORD(geometry, index) read_imageui(references, IMAGE_AT(index)).x
#define VERTEX_RECORD(geometry, index) as_float4(read_imagei(vertices, IMAGE_AT(index)))
#define BOUNDS_RECORD(geometry, index) as_float4(read_imagei(bounds, IMAGE_AT(index)))
#define TRANSFORM_RECORD(geometry, index) as_float4(read_imagei(transforms, IMAGE_AT(index)))
#else
#define NODE_FROM_BUFFER(geometry, index) ((geometry)->nodes[index])
#define REFERENCE_RECORD(geometry, index) ((geometry)->references[index])
#define VERTEX_RECORD(geometry, index) ((geometry)->vertices[index])
#define BOUNDS_RECORD(geometry, index) ((geometry)->bounds[index])
#define TRANSFORM_RECORD(geometry, index) ((geometry)->transforms[index])
#endif

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

// Eight numbers: two records one behind the other, the first one with an even number; and number `lane` of these. The
// links of a wide node are such numbers, too.
#if defined(IMAGE) || defined(CONSTANT_NODES)
#define EIGHT_NODE_WORDS(geometry, record) \
    (float8)(as_float4(NODE_RECORD(geometry, record)), as_float4(NODE_RECORD(geometry, (record) + 1u)))
#define NODE_WORD(geometry, record, lane) word_of(NODE_RECORD(geometry, (record) + (lane) / 4u), (lane) % 4u)
uint word_of(int4 record, uint i) {
    return (uint)(i == 0u ? record.x : i == 1u ? record.y : i == 2u ? record.z : record.w);
}
#else
#define EIGHT_NODE_WORDS(geometry, record) vload8(0, (__global const float*)((geometry)->nodes + (record)))
#define NODE_WORD(geometry, record, lane) ((__global const uint*)((geometry)->nodes + (record)))[lane]
#endif
#ifdef IMAGE
#define BOUNDS_WORD(geometry, record, lane) \
    word_of(as_int4(BOUNDS_RECORD(geometry, (record) + (lane) / 4u)), (lane) % 4u)
#define EIGHT_BOUNDS_WORDS(geometry, record) \
    (float8)(BOUNDS_RECORD(geometry, record), BOUNDS_RECORD(geometry, (record) + 1u))
#else
#define BOUNDS_WORD(geometry, record, lane) ((__global const uint*)((geometry)->bounds + (record)))[lane]
#define EIGHT_BOUNDS_WORDS(geometry, record) vload8(0, (__global const float*)((geometry)->bounds + (record)))
#endif
#define LOAD_EIGHT(geometry, record) COUNTED(geometry, NODE_BYTES, sizeof(float8), EIGHT_NODE_WORDS(geometry, record))
#define LOAD_LANE(geometry, record, lane) \
    as_float(COUNTED(geometry, NODE_BYTES, sizeof(uint), NODE_WORD(geometry, record, lane)))
#define LOAD_LINK(geometry, node, lane) \
    COUNTED(geometry, NODE_BYTES, sizeof(uint), NODE_WORD(geometry, (node) + BVH8_LINKS, lane))
#define LOAD_PACKET(geometry, record) \
    COUNTED(geometry, TRIANGLE_BYTES, sizeof(float8), EIGHT_BOUNDS_WORDS(geometry, record))
#define LOAD_PACKET_LANE(geometry, record, lane) \
    as_float(COUNTED(geometry, TRIANGLE_BYTES, sizeof(uint), BOUNDS_WORD(geometry, record, lane)))

#define LOAD_NODE(geometry, index) COUNTED(geometry, NODE_BYTES, sizeof(int4), NODE_RECORD(geometry, index))
#define LOAD_BOUNDS(geometry, index) COUNTED(geometry, NODE_BYTES, sizeof(float4), BOUNDS_RECORD(geometry, index))
#define LOAD_REFERENCE(geometry, index) \
    COUNTED(geometry, TRIANGLE_BYTES, sizeof(uint), REFERENCE_RECORD(geometry, index))
#define LOAD_TRANSFORM(geometry, index) \
    COUNTED(geometry, TRIANGLE_BYTES, sizeof(float4), TRANSFORM_RECORD(geometry, index))
#define LOAD_VERTEX(geometry, slot, corner) \
    COUNTED(geometry, TRIANGLE_BYTES, sizeof(float4), TRIANGLE_VERTEX(geometry, slot, corner))

// Asks for records that are read soon, where they lie where a program can ask for them.
void ask_for_records(__global const void* first, uint count) {
#pragma unroll
    for (uint i = 0; i < count; i += 4u) PREFETCH((__global const float4*)first + i); // a cache line
}
#if defined(IMAGE) || defined(CONSTANT_NODES)
#define ASK_FOR_NODES(geometry, record, count)
#else
#define ASK_FOR_NODES(geometry, record, count) ask_for_records((geometry)->nodes + (record), count)
#endif
#ifdef IMAGE
#define ASK_FOR_BOUNDS(geometry, record, count)
#define ASK_FOR_REFERENCE(geometry, index)
#else
#define ASK_FOR_BOUNDS(geometry, record, count) ask_for_records((geometry)->bounds + (record), count)
#define ASK_FOR_REFERENCE(geometry, index) PREFETCH((geometry)->references + (index))
#endif

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

// Whether a triangle is the hit so far: met again in another leaf, where a structure may list it in several.
#ifdef REPEATS_TRIANGLES
#define IS_MET_AGAIN(primitive, hit) ((primitive) == (hit)->primitive)
#else
#define IS_MET_AGAIN(primitive, hit) false
#endif

// The triangle that a reference stands for.
#ifdef INSTANCES
#define PRIMITIVE_OF(geometry, reference) ((reference) + (geometry)->placed->to_primitive)
#else
#define PRIMITIVE_OF(geometry, reference) (reference)
#endif
