// Where the rays of a picture begin, and where they are counted.

// Camera ray through the point (x, y) of the picture, in pixels from its upper left corner.
Ray camera_ray(__global const RenderParams* render, float x, float y) {
    const float right = fma(x, render->pixel_width, -1.0f);
    const float up = fma(-y, render->pixel_height, 1.0f);
    const float3 direction = fma3(render->right.xyz, right, fma3(render->up.xyz, up, render->forward.xyz));
    return make_ray(render->eye.xyz, direction, 0.0f, INFINITY, NO_PRIMITIVE);
}

// Looks for the closest hit of a ray, and counts the ray.
bool trace_pending(SCENE_PARAMETERS, const PendingRay* pending, Hit* hit, uint* counts) {
    counts[pending->kind]++;
    if (!trace_ray(GEOMETRY_AT(GEOMETRY_FOR(pending->kind, scene)), &pending->ray, false, hit)) return false;
    counts[pending->kind + 1u]++; // …_HIT follows …_CAST
    return true;
}

// Adds the counts of work-item `item` to `counters`: COUNTER_SLOTS groups of COUNTERS sums.
void add_counts(const uint* counts, volatile __global uint* counters, uint item) {
    for (uint i = 0; i < COUNTERS; i++)
        if (counts[i] > 0u) atomic_add(&counters[(item % COUNTER_SLOTS) * COUNTERS + i], counts[i]);
}
