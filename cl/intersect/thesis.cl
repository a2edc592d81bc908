// The triangle test of the thesis, listing 5.1, with its faults: a yardstick, never the default.
// J. Dvořák, "Streaming Raytracer na GPU", master's thesis, FIT VUT Brno 2008, section 5.4.2; after Moller and Trumbore
// 1997, the variant that divides last.
//
// What is wrong with it, all asserted in tests/methods/intersect.rs:
//   * `det < Epsilon` drops every back face: the ray's way out of glass, and half of a mesh that is not wound alike;
//   * it is absolute: triangles with det, twice the area times the cosine, below Epsilon do not exist (legs of 1 mm in
//     metres);
//   * `dist < Epsilon` comes before the division, when dist is still multiplied by det: the nearest possible hit lies
//     at Epsilon / det, 1e-6 for a unit triangle and 0.25 for one with legs of 2e-3;
//   * as in every test of its kind a ray through a shared edge can miss both triangles.
//
// The thesis worked in world units with directions of length 1; the tracer does not. In tracing space det is larger by
// scale^2 |direction| and dist, before the division, by scale^3. Epsilon is multiplied by the same, which keeps the
// printed order of operations and drops what the thesis would have dropped, whatever the scale. Its value is not
// printed there; that of the paper is taken: THESIS_EPSILON.

bool intersect_thesis(GEOMETRY_PARAMETERS, const Ray* ray, uint slot, float* t, float* u, float* v) {
    const float3 a = LOAD_VERTEX(geometry, slot, 0);
    const float3 b = LOAD_VERTEX(geometry, slot, 1);
    const float3 c = LOAD_VERTEX(geometry, slot, 2);
    // These three lines depend on the ray alone; compilers move them out of the loop over triangles.
    const float area_epsilon = THESIS_EPSILON * geometry->scale * geometry->scale;
    const float det_epsilon = area_epsilon * sqrt(dot3(ray->direction, ray->direction));
    const float dist_epsilon = area_epsilon * geometry->scale;

    const float3 edge1 = b - a;
    const float3 edge2 = c - a;
    const float3 pvec = cross3(ray->direction, edge2);
    const float det = dot3(edge1, pvec);
    if (det < det_epsilon) return false;

    const float3 tvec = ray->origin - a;
    *u = dot3(tvec, pvec);
    if (*u < 0.0f || *u > det) return false;

    const float3 qvec = cross3(tvec, edge1);
    *v = dot3(ray->direction, qvec);
    if (*v < 0.0f || *u + *v > det) return false;

    *t = dot3(edge2, qvec);
    if (*t < dist_epsilon) return false;

    *u /= det;
    *v /= det;
    *t /= det; // NaN came through all the comparisons above; the caller's limits reject it
    return true;
}
