// How many hits rays have: one work-item counts those of one ray of the caller's.
//
// Where each triangle is in one leaf, one traversal meets each once and counts those that are hit, in any order
// (COUNT_HITS; leaf.cl). Else the ray is followed from each hit to the next, a traversal for each, which begins where
// the last one ended (AFTER_HITS): so triangles that are in several leaves are counted once, and nothing is kept of a
// ray but its last hit. Everything is decided at once (no DEFER_UNDECIDED): a triangle that is put aside would have to
// be compared with two others.
//
// Bad at: rays with many hits in structures of the second kind.

#ifdef COUNT_HITS
uint count_of_ray(GEOMETRY_PARAMETERS, Ray* ray, const uint most) {
    if (most == 0u) return 0u;
    ray->most = most;
    Hit hit;
    (void)TRAVERSE(GEOMETRY, ray, true, &hit);
    return counted_hits(&hit);
}
#else
// Goes on to the ray's next hit, of which the primitive alone is final. Whether there is one.
bool next_of_ray(GEOMETRY_PARAMETERS, Ray* ray) {
    Hit hit;
    if (!TRAVERSE(GEOMETRY, ray, false, &hit)) return false;
    ray->after = hit;
    ray->t_near = larger(ray->t_near, smaller(LEAST_T(&hit), ray->t_far));
    return has_float_t(GEOMETRY, ray, hit);
}

uint count_of_ray(GEOMETRY_PARAMETERS, Ray* ray, const uint most) {
    uint count = 0u;
    ray->after = no_hit();
    while (count < most && next_of_ray(GEOMETRY, ray)) count++;
    return count;
}
#endif

// How many hits each ray has, up to `most`.
__kernel void count_hits(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global uint* restrict counts,
                         WORK_ARGUMENT ORDER_ARGUMENT const uint most, const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint index = RAY_OF(item);
    TRAVERSAL_STATE
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    Ray ray = batch_ray(rays, index, geometry.scale);
    counts[index] = count_of_ray(GEOMETRY_AT(&geometry), &ray, most);
    STORE_WORK(&geometry, index);
}
