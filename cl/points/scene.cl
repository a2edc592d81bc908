// The scene as point queries read it. Macros have the names of those of cl/memory/, for cl/traverse/wide_stack.cl.

typedef struct {
    __global const int4* nodes;
    __global const uint* references;
    // Of a binary hierarchy three vertices for each triangle, by its number. Of a wide one packets of eight triangles,
    // by references.
    __global const float4* triangles;
} PointScene;

#define GEOMETRY_PARAMETERS const PointScene* geometry
#define GEOMETRY geometry
#define LOAD_EIGHT(geometry, record) vload8(0, (__global const float*)((geometry)->nodes + (record)))
#define LOAD_LINK(geometry, node, lane) ((__global const uint*)((geometry)->nodes + (node) + BVH8_LINKS))[lane]
#define LOAD_PACKET(geometry, record) vload8(0, (__global const float*)((geometry)->triangles + (record)))
#define COUNT_DEEPEST(geometry, n)
