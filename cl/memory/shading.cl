// Shading data of a triangle, and of these its material alone. `shading` is the array of those, which WHOLE_TRIANGLES
// leaves empty. Where kernels need no normals and texture coordinates, it has numbers of materials alone, or nothing if
// there is one material (Features::need_shading_data in src/features.rs).
//   SHADING_RECORD, MATERIAL_RECORD  by the triangle's place in the array
#if FEATURES & (FEATURE_SMOOTH_NORMALS | FEATURE_IMAGE_TEXTURES | FEATURE_PROCEDURAL_TEXTURES)
#define SHADING_RECORD(shading, slot) ((shading)[slot])
#define MATERIAL_RECORD(shading, slot) ((shading)[slot].material)
#else
#define SHADING_RECORD(shading, slot) shading_of_material(shading, slot)
#define MATERIAL_RECORD(shading, slot) ((__global const uint*)(shading))[slot]
Shading shading_of_material(__global const Shading* shading, uint slot) {
    const float4 none = (float4)(0.0f);
    const Shading at = {
        none, none, none, 0.0f, 0.0f, 0.0f, HAS(FEATURE_SEVERAL_MATERIALS) ? MATERIAL_RECORD(shading, slot) : 0u};
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
