// Where the scene's data lies, and the only macros that read it: no other file knows in which memory the arrays are.

typedef struct {
    __global const int4* nodes;       // KdNode records
    __global const uint* references;  // leaf lists; for brute force: every triangle that can be hit
    __global const float4* vertices;  // three for each triangle, w unused
    __global const float4* bounds;     // boxes, spheres or links of the structure; what they are its own file says
    __global const float4* transforms; // precomputed data of triangles, for the triangle tests that want it
    float3 low, high;                 // box around all triangles
    uint reference_count;             // for brute force
    float scale;                      // tracing space = world units times this
} Geometry;

#define LOAD_NODE(geometry, index) ((geometry)->nodes[index])
#define LOAD_REFERENCE(geometry, index) ((geometry)->references[index])
#define LOAD_VERTEX(geometry, triangle, corner) ((geometry)->vertices[3u * (triangle) + (corner)].xyz)
#define LOAD_BOUNDS(geometry, index) ((geometry)->bounds[index])
#define LOAD_TRANSFORM(geometry, index) ((geometry)->transforms[index])

// The kernel arguments that every tracing kernel begins with, and the Geometry made of them.
#define GEOMETRY_ARGUMENTS                                                                        \
    __global const int4 *restrict nodes, __global const uint *restrict references,               \
        __global const float4 *restrict vertices, __global const float4 *restrict bounds,            \
        __global const float4 *restrict transforms, __global const SceneParams *restrict scene_params
#define MAKE_GEOMETRY                                                                             \
    { nodes, references, vertices, bounds, transforms, scene_params->low.xyz, scene_params->high.xyz, scene_params->reference_count, \
      scene_params->scale }
