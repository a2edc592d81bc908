// The hits of rays, the closest first: one work-item lists those of one ray of the caller's, in one traversal, which
// puts each hit into its place among those before it (leaf.cl). A triangle that is met again in another leaf is there
// already. Everything is decided at once (no DEFER_UNDECIDED): a triangle that is put aside would have to be compared
// with many others.
//
// Bad at: rays with very many hits whose triangles are not met in their order: a hit that comes before others moves
// them all.

// The hits of rays base + first to base + end; those of ray i from starts[i - base] on, as many as up to
// starts[i - base + 1], which are not more than it has.
__kernel void list_hits(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays,
                        __global const uint* restrict starts, __global Hit* restrict hits, const uint base,
                        const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint start = starts[item], room = starts[item + 1u] - start;
    if (room == 0u) return;
    TRAVERSAL_STATE
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    Ray ray = batch_ray(rays, base + item, geometry.scale);
    ray.list = hits + start;
    ray.room = room;
    Hit last;
    (void)TRAVERSE(GEOMETRY_AT(&geometry), &ray, false, &last);
    const uint count = counted_hits(&last);
    for (uint i = 0u; i < room; i++) {
        Hit hit = no_hit();
        if (i < count) {
            hit = ray.list[i];
            FINISH(GEOMETRY_AT(&geometry), &ray, &hit);
        }
        ray.list[i] = hit;
    }
}
