// Normals: a triangle's own, whatever its shape and size, and one interpolated from its vertices' normals; and how far
// the surface that these claim lies above the triangle.

// The unit normal of the plane through three points, on the side from which they run counter-clockwise; zero where they
// lie on a line. Edges are brought to lengths from 1 to 4 first, or the product of those of a tiny triangle would
// underflow.
//
// The edges' own roundings are made good to first order: without that no bit is right on a needle whose edges enclose
// an angle of 2^-24, and the wrong side would pass for its front. With E = EPSILON and s the sine of that angle each of
// the three products is off by at most 3 E of its result (see difference_of_products), the last two by E of their
// factors too, which are E times shorter: 3 E (s + 4 E) + 12 E^2 in all, so that the direction is off by less than 8 E
// + 48 E^2 / s.
float3 triangle_normal(float3 p0, float3 p1, float3 p2) {
    float3 edge1 = p1 - p0, edge2 = p2 - p0;
    float scale1 = 1.0f, scale2 = 1.0f;
    if (!scale_to_unit(&edge1, &scale1) || !scale_to_unit(&edge2, &scale2)) return (float3)(0.0f);
    const float3 low1 = difference_low3(p1, p0) * scale1, low2 = difference_low3(p2, p0) * scale2;
    return normalize3(cross3(edge1, edge2) + (cross3(edge1, low2) + cross3(low1, edge2)), (float3)(0.0f));
}

// Where all components of an interpolated normal are smaller than LARGEST_NORMAL_NOISE, none needs to have the right
// sign: the roundings of the weights (5 EPSILON together), of the vertices' unit normals (1) and of the sum (2).

// The unit normal interpolated between the unit normals of the vertices with weights w, u and v, on the side of the
// geometric one. That one itself where there is none: on flat triangles, which store zeros, and where opposite normals
// cancel.
float3 interpolated_normal(float3 normal0, float3 normal1, float3 normal2, float w, float u, float v,
                           float3 geometric_normal) {
    const float3 sum = fma3(normal0, w, fma3(normal1, u, normal2 * v));
    if (!(max_component(abs3(sum)) > LARGEST_NORMAL_NOISE)) return geometric_normal;
    const float3 normal = normalize3(sum, geometric_normal);
    return dot3(normal, geometric_normal) < 0.0f ? -normal : normal;
}

// 1: shadow rays start at the height that the vertices' normals claim; 0: on the triangle.
#ifndef SMOOTH_TERMINATOR
#define SMOOTH_TERMINATOR 1
#endif

// From a triangle's point with weights w, u and v to the smooth surface that bulges above it by the vertices' normals:
// the shadow of a coarse mesh on itself would end at its triangles' edges, in stairs, where the interpolated normals
// are still bright. The mean of the point's distances to the vertices' tangent planes, where these lie above it, each
// along its normal and with the vertex's weight. Zero on flat triangles, at the vertices and where the mesh is hollow.
// Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021, chapter 4.
//
// What lies between triangle and smooth surface throws no shadow there, and no other ray starts so: --terminator hard
// keeps shadows exact. The factor of Chiang, Li and Burley ("Taming the Shadow Terminator", SIGGRAPH 2019), which moves
// no ray, was tried: it darkens triangles that the light grazes, but leaves the stairs, whose brighter side faces the
// light more than its smooth normals do.
float3 smooth_lift(float3 edge1, float3 edge2, float3 normal0, float3 normal1, float3 normal2, float w, float u,
                   float v, float3 geometric_normal) {
    const float3 from_p0 = fma3(edge1, u, edge2 * v);
    const float side0 = dot3(normal0, geometric_normal) < 0.0f ? -1.0f : 1.0f;
    const float side1 = dot3(normal1, geometric_normal) < 0.0f ? -1.0f : 1.0f;
    const float side2 = dot3(normal2, geometric_normal) < 0.0f ? -1.0f : 1.0f;
    const float height0 = max_or(side0 * dot3(-from_p0, normal0), 0.0f);
    const float height1 = max_or(side1 * dot3(edge1 - from_p0, normal1), 0.0f);
    const float height2 = max_or(side2 * dot3(edge2 - from_p0, normal2), 0.0f);
    return fma3(normal0, side0 * (w * height0),
                fma3(normal1, side1 * (u * height1), normal2 * (side2 * (v * height2))));
}
