// Batch queries: one work-item traces one ray of the caller's.

// The closest hit of each ray.
__kernel void trace_closest(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global Hit* restrict hits,
                            WORK_ARGUMENT DEFERRED_ARGUMENT ORDER_ARGUMENT const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint index = RAY_OF(item);
    TRAVERSAL_STATE
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    Hit hit;
    if (!trace_batch(GEOMETRY_AT(&geometry), rays, hits, index, false, &hit))
        TAKE_DEFERRED(
            complete_batch(GEOMETRY_VALUES STATE_VALUES, rays, hits, index, false, hit.t, hit.u, hit.primitive));
    STORE_WORK(&geometry, index);
    NOTE_DEFERRED(index);
}

// Some hit of each ray: whether there is one is the answer, which one depends on the structure.
__kernel void trace_any(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global Hit* restrict hits,
                        WORK_ARGUMENT DEFERRED_ARGUMENT ORDER_ARGUMENT const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint index = RAY_OF(item);
    TRAVERSAL_STATE
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    Hit hit;
    if (!trace_batch(GEOMETRY_AT(&geometry), rays, hits, index, true, &hit))
        TAKE_DEFERRED(
            complete_batch(GEOMETRY_VALUES STATE_VALUES, rays, hits, index, true, hit.t, hit.u, hit.primitive));
    STORE_WORK(&geometry, index);
    NOTE_DEFERRED(index);
}

// The closest hit of a secondary ray, which leaves the first one's hit, started as the renderer starts its own. A first
// ray that missed has none.
__kernel void trace_next(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays,
                         __global const float4* restrict next_directions, __global const Hit* restrict hits,
                         __global Hit* restrict next_hits, WORK_ARGUMENT DEFERRED_ARGUMENT ORDER_ARGUMENT
                         const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint index = RAY_OF(item);
    TRAVERSAL_STATE
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    const Hit from = hits[index];
    Hit hit = no_hit();
    if (from.primitive != NO_PRIMITIVE) {
        const Ray first_ray = batch_ray(rays, index, geometry.scale);
        SurfaceHit left;
        SURFACE_HIT(GEOMETRY_AT(&geometry), &first_ray, &from, &left);
        const SurfacePoint point = surface_point(GEOMETRY_AT(&geometry), &left);
        const float3 direction = next_directions[index].xyz;
        Ray ray = leave_surface(&point, direction, INFINITY);
        if (ray.t_near <= ray.t_far) use_callers_units(&ray, direction, geometry.scale);
        if (trace_ray(GEOMETRY_AT(&geometry), &ray, false, &hit)) FINISH(GEOMETRY_AT(&geometry), &ray, &hit);
        hit = batch_hit(hit);
    }
    next_hits[index] = hit;
    STORE_WORK(&geometry, index);
    NOTE_DEFERRED(index);
}
