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

// d . (a x b); moment: d x vertex; distance: the square of its length, that is of the vertex's distance from the ray,
// times |d|^2.
float edge_volume(float3 a, float3 b, float3 moment_a, float3 moment_b, float distance_a, float distance_b) {
    const float by_a = dot3(b, moment_a);
    const float by_b = dot3(a, moment_b);
    return distance_a < distance_b ? by_a : distance_b < distance_a ? -by_b : 0.5f * (by_a - by_b);
}

bool intersect_plucker(GEOMETRY_PARAMETERS, const Ray* ray, uint slot, float* t, float* u, float* v) {
    const float3 a = from_origin(ray, LOAD_VERTEX(geometry, slot, 0));
    const float3 b = from_origin(ray, LOAD_VERTEX(geometry, slot, 1));
    const float3 c = from_origin(ray, LOAD_VERTEX(geometry, slot, 2));
    const float3 moment_a = cross3(ray->direction, a);
    const float3 moment_b = cross3(ray->direction, b);
    const float3 moment_c = cross3(ray->direction, c);
    const float distance_a = dot3(moment_a, moment_a);
    const float distance_b = dot3(moment_b, moment_b);
    const float distance_c = dot3(moment_c, moment_c);

    const float volume0 = edge_volume(b, c, moment_b, moment_c, distance_b, distance_c);
    const float volume1 = edge_volume(c, a, moment_c, moment_a, distance_c, distance_a);
    const float volume2 = edge_volume(a, b, moment_a, moment_b, distance_a, distance_b);
    const bool all_positive = volume0 >= 0.0f && volume1 >= 0.0f && volume2 >= 0.0f;
    const bool all_negative = volume0 <= 0.0f && volume1 <= 0.0f && volume2 <= 0.0f;
    if (!(all_positive || all_negative)) return false;

    const float3 normal = cross3(b - a, c - a);
    *t = dot3(normal, a) / dot3(normal, ray->direction); // a parallel ray gives infinity or NaN: rejected
    const float sum = volume0 + volume1 + volume2;
    *u = volume1 / sum;
    *v = volume2 / sum;
    return is_finite(*t) && sum != 0.0f;
}
