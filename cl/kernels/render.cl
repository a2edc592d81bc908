// The mega-kernel: one work-item renders one pixel, from its camera rays to its colour (thesis, section 5.2.1).
//
// Recursion is a private stack of waiting rays: every surface replaces the ray that found it by at most two, one step
// deeper, so that depth D needs room for D; where nothing is transparent by at most one, so that there is never more
// than one.

// The light of all lights that the surface sends back along the ray, and what it gives off itself.
float3 local_light(SCENE_PARAMETERS, const Surface* surface, const Material* material, const PendingRay* pending,
                   float3 view_direction, uint* counts) {
    LocalLight light = light_without_lamps(SCENE, surface, material, pending, view_direction);
    SurfacePoint start = surface->point;
    lift_point(&start, surface->lift);
    for (uint i = 0; i < light_count(scene); i++) {
        LightSample sample;
        float3 reflected;
        if (!light_term(scene, surface, material, light.diffuse, view_direction, i, &sample, &reflected)) continue;
        light.radiance += reflected * light_visibility(SCENE, &start, &sample, counts);
    }
    return light.radiance;
}

// The radiance along one camera ray. `camera_ray`: hash_place() of it.
float3 radiance_along(SCENE_PARAMETERS, __global const RenderParams* render, PendingRay pending, uint camera_ray,
                      uint* counts) {
    const Geometry* geometry = &scene->geometry;
    WaitingRay stack[MAX_PENDING];
    uint stacked = 0;
    float3 radiance = (float3)(0.0f);
    for (;;) {
        const float3 direction = normalize3(pending.ray.direction, (float3)(0.0f));
        Hit hit;
        if (trace_pending(SCENE, &pending, &hit, counts)) {
            SurfaceHit at;
            SURFACE_HIT(GEOMETRY, &pending.ray, &hit, &at);
            const Surface surface = surface_at(GEOMETRY, scene->shading, &pending.ray, &at);
            const Material material = scene->materials[surface.material];
            radiance +=
                pending.weight * limit_radiance(local_light(SCENE, &surface, &material, &pending, direction, counts));
            if (depth_of(pending.depth) < render->max_depth) {
                Killing killing;
                begin_killing(render, camera_ray, &killing);
                stacked = push_secondary_rays(&surface, &material, &pending, direction, &killing, stack, stacked);
            }
        } else {
            radiance += pending.weight * limit_radiance(background(scene, direction));
        }
        if (stacked == 0u) return radiance;
        pending = load_pending(&stack[--stacked]);
    }
}

// Adds the samples from first_sample to end_sample to the pixels, in the order of their numbers whatever the host does
// in one launch. Items: see pixel_of_item(). `film`: linear RGB, row by row, top row first; sums until the last sample
// is there. Work records: two a pixel, of its camera rays and of all others.
//
// Where samples are apart, and a launch has several of a pixel, each is an item: those of a pixel follow each other, so
// that what runs in step traces much the same rays, and no pixel takes as long as all of its samples. `film` then has
// the radiance of each item, of as many as there is room for; add_samples() adds them to the pixels.
__kernel void render(SCENE_ARGUMENTS, __global const RenderParams* restrict render,
                     __global const CameraSample* restrict samples, __global float4* restrict film,
                     volatile __global uint* restrict counters, WORK_ARGUMENT DEFERRED_ARGUMENT const uint first_sample,
                     const uint end_sample, const uint first, const uint end) {
    const uint number = first + (uint)get_global_id(0);
    if (number >= end) return;
    const uint item = ITEM_OF(number);
    const uint apart = items_of_pixel(render, first_sample, end_sample);
    const uint2 pixel = pixel_of_item(render, item / apart);
    if (!is_in_film(render, pixel)) return;

    TRAVERSAL_STATE
    WORK_SUMS(work)
    WORK_SUMS(camera_work)
    const Scene scene = MAKE_SCENE;
    uint counts[COUNTERS] = {0};
    float3 sum = first_sum(render, film, pixel, first_sample, apart);
    for (uint s = first_sample + item % apart; s < end_sample; s += apart) {
        const uint camera_ray = hash_place(camera_sample(render, samples, pixel, s));
        sum += radiance_along(SCENE_AT(&scene), render, first_of_path(render, samples, pixel, s), camera_ray, counts);
    }
    NOTE_DEFERRED(item);
    if (IS_DEFERRED) return;
    store_sum(render, film, item, apart, end_sample, sum);
    STORE_WORK(&scene.camera_geometry, 2u * place_in_film(render, pixel));
    STORE_WORK(&scene.geometry, 2u * place_in_film(render, pixel) + 1u);
    add_counts(counts, counters, item);
}
