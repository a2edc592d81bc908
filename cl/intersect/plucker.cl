// Ray-triangle intersection by the volumes that ray and edges span (Plucker coordinates), two-sided.
// Amanatides and Choi, "Ray Tracing Triangular Meshes", Western Computer Graphics Symposium 1997; relative to the ray's
// origin as in Davidovič, Engelhardt, Georgiev, Slusallek and Dachsbacher, "3D Rasterization: A Bridge between
// Rasterization and Ray Casting", Graphics Interface 2012.
//
// The ray hits when it passes all three edges on the same side: d . (a x b) for the edge from a to b, vertices relative
// to the origin. What neighbours share must come out alike. d . (a x b) = b . (d x a) = -a . (d x b), and these three
// round differently; the one is taken whose vertex is nearer to the ray:
//   * its value depends on the edge, not on the triangle: with the vertices exchanged it is the same number with the
//     opposite sign, to the bit. A ray near the middle of an edge hits one of the two triangles, or both;
//   * near a vertex p all its edges are measured by one vector d x p, exact to 1.5 ulp (cross3) however small it is, so
//     that they agree on which side of the vertex the ray passes. With d . (a x b) each edge has noise of its own: of
//     100,000 rays aimed at a vertex of six triangles 1,575 passed between all of them (3,707 with cross3, which is not
//     antisymmetric to the bit and loses rays through edges as well).
// So a closed mesh is tight, short of triangles so thin that all neighbours of a vertex lie in one plane with the ray
// but for rounding; watertight.cl needs no such exception. t is that of the plane: noise over noise for a triangle seen
// edge-on, so that a traversal may then find another hit than brute force. (The mean of the vertices' t weighted by the
// volumes is better there and worse where the ray starts close to the triangle: measured, a hit behind the origin.) The
// slowest of the tests.

// For any number of lanes. d . (a x b); moment: d x vertex; distance: the square of its length, that is of the vertex's
// distance from the ray, times |d|^2.
REAL LANES(edge_volume)(LANES(Vector) a, LANES(Vector) b, LANES(Vector) moment_a, LANES(Vector) moment_b,
                        REAL distance_a, REAL distance_b) {
    const REAL by_a = LANES(dot_product)(b, moment_a);
    const REAL by_b = LANES(dot_product)(a, moment_b);
    return distance_a < distance_b ? by_a : distance_b < distance_a ? -by_b : 0.5f * (by_a - by_b);
}

// The vertices as seen from where the ray starts.
MASK LANES(plucker)(LANES(Vector) a, LANES(Vector) b, LANES(Vector) c, LANES(Vector) direction, REAL* t, REAL* u,
                    REAL* v) {
    const LANES(Vector) moment_a = LANES(cross_product)(direction, a);
    const LANES(Vector) moment_b = LANES(cross_product)(direction, b);
    const LANES(Vector) moment_c = LANES(cross_product)(direction, c);
    const REAL distance_a = LANES(dot_product)(moment_a, moment_a);
    const REAL distance_b = LANES(dot_product)(moment_b, moment_b);
    const REAL distance_c = LANES(dot_product)(moment_c, moment_c);

    const REAL volume0 = LANES(edge_volume)(b, c, moment_b, moment_c, distance_b, distance_c);
    const REAL volume1 = LANES(edge_volume)(c, a, moment_c, moment_a, distance_c, distance_a);
    const REAL volume2 = LANES(edge_volume)(a, b, moment_a, moment_b, distance_a, distance_b);
    const MASK all_positive = volume0 >= 0.0f && volume1 >= 0.0f && volume2 >= 0.0f;
    const MASK all_negative = volume0 <= 0.0f && volume1 <= 0.0f && volume2 <= 0.0f;
    const MASK is_inside = all_positive || all_negative;
    if (!LANES(is_any)(is_inside)) return is_inside;

    const LANES(Vector) normal = LANES(cross_product)(LANES(minus)(b, a), LANES(minus)(c, a));
    // A parallel ray gives infinity or NaN: refused.
    *t = LANES(dot_product)(normal, a) / LANES(dot_product)(normal, direction);
    const REAL sum = volume0 + volume1 + volume2;
    *u = volume1 / sum;
    *v = volume2 / sum;
    return is_inside && sum != 0.0f;
}

#ifdef ONE_LANE
bool intersect_plucker(GEOMETRY_PARAMETERS, const Ray* ray, uint slot, float* t, float* u, float* v) {
    const Vector a = vector_of(from_origin(ray, LOAD_VERTEX(geometry, slot, 0)));
    const Vector b = vector_of(from_origin(ray, LOAD_VERTEX(geometry, slot, 1)));
    const Vector c = vector_of(from_origin(ray, LOAD_VERTEX(geometry, slot, 2)));
    return plucker(a, b, c, vector_of(ray->direction), t, u, v) && is_finite(*t);
}
#endif
