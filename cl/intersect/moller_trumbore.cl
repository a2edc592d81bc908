// Ray-triangle intersection with two edges and one reciprocal, two-sided.
// Moller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", Journal of Graphics Tools 2(1), 1997.
//
// Every test in cl/intersect/ has this signature: writes t (in the ray's units) and u, v (the weights of vertices 1 and
// 2) and returns true when the ray's line meets the closed triangle; the caller compares t with its limits. Comparisons
// are written so that NaN is a miss.
//
// Fast, not watertight: a ray through a shared edge can miss both triangles, because u and v of the two neighbours are
// rounded independently. No epsilon: |det| small says nothing of the triangle's worth.

// For any number of lanes. from_p0: from vertex 0 to where the ray starts. It does not end where u tells that no lane
// hits: with that branch packets on CPUs were slower, in a kd-tree 0.7 times as fast.
MASK LANES(moller_trumbore)(LANES(Vector) from_p0, LANES(Vector) direction, LANES(Vector) edge1, LANES(Vector) edge2,
                            REAL* t, REAL* u, REAL* v) {
    const LANES(Vector) p = LANES(cross_product)(direction, edge2);
    // A parallel ray gives infinity or NaN, and so a t that is refused.
    const REAL inv_det = 1.0f / LANES(dot_product)(edge1, p);

    *u = LANES(dot_product)(from_p0, p) * inv_det;
    const LANES(Vector) q = LANES(cross_product)(from_p0, edge1);
    *v = LANES(dot_product)(direction, q) * inv_det;
    *t = LANES(dot_product)(edge2, q) * inv_det;
    return *u >= 0.0f && *v >= 0.0f && *u + *v <= 1.0f;
}

#ifdef ONE_LANE
bool intersect_moller_trumbore(GEOMETRY_PARAMETERS, const Ray* ray, uint slot, float* t, float* u, float* v) {
    const float3 p0 = LOAD_VERTEX(geometry, slot, 0);
    const float3 p1 = LOAD_VERTEX(geometry, slot, 1);
    const float3 p2 = LOAD_VERTEX(geometry, slot, 2);
    return moller_trumbore(vector_of(-from_origin(ray, p0)), vector_of(ray->direction), vector_of(p1 - p0),
                           vector_of(p2 - p0), t, u, v) &&
           is_finite(*t);
}
#endif
