// Batch queries: one work-item traces one ray of the caller's.

// Changes the units of t from those of `direction`, of which the ray has been made, in tracing space to those in the caller's space.
// The two factors are powers of two of like size: their product may be none that a float can hold while the t that it makes is a float.
void use_callers_units(Ray* ray, float3 direction, float scale) {
    int lowest = 0, highest = -1000, own_highest = -1000;
    widen_exponents(max_component(abs3(direction)), &lowest, &highest);
    widen_exponents(max_component(abs3(ray->direction)), &lowest, &own_highest);
    const int exponent = own_highest - highest + 127 - (int)(as_uint(scale) >> 23);
    ray->t_lift = as_float((uint)(exponent / 2 + 127) << 23);
    ray->t_scale = as_float((uint)(exponent - exponent / 2 + 127) << 23);
}

Ray batch_ray(__global const TraceRay* rays, uint index, float scale) {
    const TraceRay query = rays[index];
    const float3 direction = query.direction_t_max.xyz;
    const float t_min = query.origin_t_min.w, t_max = query.direction_t_max.w;
    Ray ray = make_ray(query.origin_t_min.xyz, direction, 0.0f, INFINITY, NO_PRIMITIVE);
    const bool sound = ray.t_near <= ray.t_far;
    if (sound) use_callers_units(&ray, direction, scale);
    limit_ray(&ray, sound && t_min <= t_max, t_min, t_max);
    return ray;
}

// In the caller's units of t, in which what is farther than every float is not hit.
Hit batch_hit(const Ray* ray, Hit hit) {
    hit.t = callers_t(ray, hit.t);
    return is_finite(hit.t) ? hit : no_hit();
}

void trace_batch(GEOMETRY_PARAMETERS, __global const TraceRay* rays, __global Hit* hits, uint index,
                 const bool any_hit) {
    const Ray ray = batch_ray(rays, index, geometry->scale);
    Hit hit;
    if (trace_ray(GEOMETRY, &ray, any_hit, &hit)) FINISH(GEOMETRY, &ray, &hit);
    hits[index] = batch_hit(&ray, hit);
}

// The closest hit of each ray.
__kernel void trace_closest(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global Hit* restrict hits,
                            WORK_ARGUMENT DOUBTS_ARGUMENT const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint index = ITEM_OF(item);
    UNDECIDED
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    trace_batch(GEOMETRY_AT(&geometry), rays, hits, index, false);
    STORE_WORK(&geometry, index);
    NOTE_DOUBT(index);
}

// Some hit of each ray: whether there is one is the answer, which one depends on the structure.
__kernel void trace_any(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global Hit* restrict hits,
                        WORK_ARGUMENT DOUBTS_ARGUMENT const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint index = ITEM_OF(item);
    UNDECIDED
    WORK_SUMS(work)
    const Geometry geometry = MAKE_GEOMETRY;
    trace_batch(GEOMETRY_AT(&geometry), rays, hits, index, true);
    STORE_WORK(&geometry, index);
    NOTE_DOUBT(index);
}

// The closest hit of a second ray that leaves the first one's hit, started as the renderer starts its secondary rays. A first
// ray that missed has no second one.
__kernel void trace_next(GEOMETRY_ARGUMENTS, __global const TraceRay* restrict rays, __global const float4* restrict next_directions,
                         __global const Hit* restrict hits, __global Hit* restrict next_hits,
                         WORK_ARGUMENT DOUBTS_ARGUMENT const uint first, const uint end) {
    const uint item = first + (uint)get_global_id(0);
    if (item >= end) return;
    const uint index = ITEM_OF(item);
    UNDECIDED
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
        hit = batch_hit(&ray, hit);
    }
    next_hits[index] = hit;
    STORE_WORK(&geometry, index);
    NOTE_DOUBT(index);
}
