// Ray-triangle intersection with two edges and one reciprocal, two-sided.
// Moller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", Journal of Graphics Tools 2(1), 1997.
//
// Every test in cl/intersect/ has this signature: writes t (in the ray's units) and u, v (the weights of vertices 1 and
// 2) and returns true when the ray's line meets the closed triangle; the caller compares t with its limits. Comparisons
// are written so that NaN is a miss.
//
// Fast, not watertight: a ray through a shared edge can miss both triangles, because u and v of the two neighbours are
// rounded independently. No epsilon: |det| small says nothing of the triangle's worth.
bool intersect_moller_trumbore(GEOMETRY_PARAMETERS, const Ray* ray, uint slot, float* t, float* u,
                               float* v) {
    const float3 p0 = LOAD_VERTEX(geometry, slot, 0);
    const float3 p1 = LOAD_VERTEX(geometry, slot, 1);
    const float3 p2 = LOAD_VERTEX(geometry, slot, 2);
    const float3 edge1 = p1 - p0;
    const float3 edge2 = p2 - p0;
    const float3 p = cross3(ray->direction, edge2);
    const float inv_det = 1.0f / dot3(edge1, p); // a parallel ray gives infinity or NaN: rejected below

    const float3 from_p0 = -from_origin(ray, p0);
    *u = dot3(from_p0, p) * inv_det;
    const float3 q = cross3(from_p0, edge1);
    *v = dot3(ray->direction, q) * inv_det;
    *t = dot3(edge2, q) * inv_det;
    return *u >= 0.0f && *v >= 0.0f && *u + *v <= 1.0f && is_finite(*t);
}
