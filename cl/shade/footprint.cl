// How much of a surface, and of its texture, a ray stands for. A ray is the axis of a cone, and what the cone cuts out
// of a surface is the part of its texture that the ray shows: the mean over it, not a point's colour, which would
// flicker from pixel to pixel. Amanatides, "Ray Tracing with Cones", SIGGRAPH 1984; Akenine-Moeller, Crassin,
// Boksansky, Belcour, Panteleev and Wright, "Improved Shader and Texture Level of Detail Using Ray Cones", JCGT 10(1),
// 2021.
//
// Bad at: what curved mirrors and lenses show. Surfaces pass cones on as if they were flat: behind those that spread
// rays a cone is too narrow, and something of the flicker stays; behind those that gather them too wide.

// 1: textures are averaged over what rays stand for, 0: colours are those of points.
#ifndef TEXTURE_FOOTPRINTS
#define TEXTURE_FOOTPRINTS 0
#endif
#define HAS_CONES (TEXTURE_FOOTPRINTS && HAS(FEATURE_IMAGE_TEXTURES))

typedef struct {
    float width;  // where the ray begins, tracing space
    float spread; // by how much it grows along a unit of the ray
} RayCone;

// The cone of a ray from `from`, at `to`.
RayCone cone_at(RayCone cone, float3 from, float3 to) {
    if (!HAS_CONES) return cone;
    const float3 way = to - from;
    cone.width = fma(cone.spread, sqrt(dot3(way, way)), cone.width);
    return cone;
}

// Two axes of the ellipse that a cone cuts out of a triangle's plane, from end to end, in texture coordinates.
typedef struct {
    float2 along;  // the one that leans with the ray
    float2 across; // the one at a right angle to the ray
} Footprint;

// How far texture coordinates change along `way`, which lies in the triangle's plane. `area`: dot3(cross3(edge1,
// edge2), normal).
float2 texture_way(const Shading* at, float3 edge1, float3 edge2, float3 normal, float area, float3 way) {
    const float weight1 = dot3(cross3(way, edge2), normal) / area;
    const float weight2 = dot3(cross3(edge1, way), normal) / area;
    return (float2)(fma(weight1, at->normal1_u1.w - at->normal0_u0.w, weight2 * (at->normal2_u2.w - at->normal0_u0.w)),
                    fma(weight1, at->v1 - at->v0, weight2 * (at->v2 - at->v0)));
}

// A ray that grazes its triangle sees no more of it than at LEAST_CONE_COSINE: the ellipse, which is no longer one
// where the plane is all but parallel to the cone, is then 128 times as long as wide, far more than MOST_TAPS places
// stand for.

// `direction`: of the ray, unit. `width`: of its cone at the surface.
Footprint footprint_at(GEOMETRY_PARAMETERS, __global const Shading* shading, const Surface* surface, float3 direction,
                       float width) {
    const uint primitive = surface->point.primitive;
    const float3 p0 = LOAD_SURFACE_VERTEX(geometry, primitive, 0);
    const float3 edge1 = LOAD_SURFACE_VERTEX(geometry, primitive, 1) - p0;
    const float3 edge2 = LOAD_SURFACE_VERTEX(geometry, primitive, 2) - p0;
    const Shading at = LOAD_SHADING(shading, primitive);
    const float3 normal = surface->geometric_normal;
    const float area = dot3(cross3(edge1, edge2), normal);
    // Where the ray meets the triangle at a right angle any two axes will do.
    const float3 across = normalize3(cross3(normal, direction), normalize3(edge1, (float3)(0.0f)));
    const float3 along = cross3(across, normal);
    const float cosine = max_or(-dot3(normal, direction), LEAST_CONE_COSINE);
    const Footprint footprint = {texture_way(&at, edge1, edge2, normal, area, along * (width / cosine)),
                                 texture_way(&at, edge1, edge2, normal, area, across * width)};
    return footprint;
}
