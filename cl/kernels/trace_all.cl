// Batch queries for all hits: one work-item follows one ray of the caller's from each hit to the next, a traversal for
// each, which begins where the last one ended. So every structure and triangle test can be asked, triangles that are in
// several leaves are met once, hits come in their order, and nothing is kept of a ray but its last hit.
//
// Bad at: rays with many hits; a traversal that collects hits as it comes to them would go down the hierarchy once.
// Everything is decided at once (AFTER_HITS without DEFER_UNDECIDED): a triangle that is put aside would have to be
// compared with two others.

// Goes on to the ray's next hit: of *hit primitive alone is final, unless t, u and v are wanted. Whether there is one:
// what is farther than every float is none.
bool next_of_batch(GEOMETRY_PARAMETERS, Ray* ray, const bool is_wanted, Hit* hit) {
    if (!TRAVERSE(GEOMETRY, ray, false, hit)) return false;
    ray->after = *hit;
    ray->t_near = larger(ray->t_near, smaller(LEAST_T(hit), ray->t_far));
    if (is_wanted || !is_finite(callers_t(ray, hit->t))) FINISH(GEOMETRY, ray, hit);
    return is_finite(hit->t);
}

Ray ray_of_all(GEOMETRY_PARAMETERS, __global const TraceRay* rays, uint index) {
    Ray ray = batch_ray(rays, index, geometry->scale);
    ray.after = no_hit();
    return ray;
}

// How many hits each ray has, up to `most`.
__kernel void count_hits(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global uint* restrict counts,
                         WORK_ARGUMENT ROWS_ARGUMENT const uint most, const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint index = ray_at(item, row, in_bands);
    TRAVERSAL_STATE
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    Ray ray = ray_of_all(GEOMETRY_AT(&geometry), rays, index);
    Hit hit;
    uint count = 0u;
    while (count < most && next_of_batch(GEOMETRY_AT(&geometry), &ray, false, &hit)) count++;
    counts[index] = count;
    STORE_WORK(&geometry, index);
}

// The hits of rays base + first to base + end, the closest first; those of ray i from starts[i - base] on, as many as
// up to starts[i - base + 1].
__kernel void list_hits(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays,
                        __global const uint* restrict starts, __global Hit* restrict hits, const uint base,
                        const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    TRAVERSAL_STATE
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    Ray ray = ray_of_all(GEOMETRY_AT(&geometry), rays, base + item);
    for (uint i = starts[item]; i < starts[item + 1u]; i++) {
        Hit hit;
        (void)next_of_batch(GEOMETRY_AT(&geometry), &ray, true, &hit);
        hits[i] = hit;
    }
}
