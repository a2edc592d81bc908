// The mega-kernel: one work-item renders one pixel, from its camera rays to its colour (thesis, section 5.2.1).
//
// Recursion is a private stack of pending rays: every surface replaces the ray that found it by at most two, one step deeper,
// so that depth D needs room for D + 1.

#ifndef MAX_PENDING
#define MAX_PENDING 9
#endif

#ifdef COUNT_WORK
#define CAMERA_GEOMETRY_VALUE MAKE_GEOMETRY_COUNTING(camera_work),
#define GEOMETRY_FOR(kind, scene) ((kind) == COUNT_CAMERA_CAST ? &(scene)->camera_geometry : &(scene)->geometry)
#else
#define CAMERA_GEOMETRY_VALUE
#define GEOMETRY_FOR(kind, scene) (&(scene)->geometry)
#endif

typedef struct {
    Geometry geometry;
#ifdef COUNT_WORK
    Geometry camera_geometry; // where the work on camera rays is counted, apart from all other
#endif
    __global const Shading* shading;
    __global const Material* materials;
    __global const Light* lights;
    __global const TextureInfo* textures;
    __global const uint* texels;
    __global const float* srgb_to_linear;
    __global const SceneParams* params;
} Scene;

// As GEOMETRY_PARAMETERS and its kin, for functions that take the whole scene.
#define SCENE_PARAMETERS const Scene* scene IMAGE_PARAMETERS
#define SCENE_AT(pointer) pointer IMAGE_VALUES
#define SCENE SCENE_AT(scene)

// What remains of the light after it has passed the transparent surfaces on its way; zero behind an opaque one.
float3 light_visibility(SCENE_PARAMETERS, const SurfacePoint* from, const LightSample* sample, uint* counts) {
    const Geometry* geometry = &scene->geometry;
    Ray ray = leave_surface(from, sample->to_light, sample->t_far);
    Hit hit;
    counts[COUNT_SHADOW_CAST]++;
    if (scene->params->has_transparent == 0u) {
        const bool blocked = TRAVERSE(GEOMETRY, &ray, true, &hit);
        counts[COUNT_SHADOW_HIT] += blocked ? 1u : 0u;
        return (float3)(blocked ? 0.0f : 1.0f);
    }
    float3 tint = (float3)(1.0f);
    for (uint layer = 0; layer < MAX_SHADOW_LAYERS; layer++) {
        if (!TRAVERSE(GEOMETRY, &ray, false, &hit)) return tint;
        __global const Material* material = &scene->materials[LOAD_MATERIAL(scene->shading, hit.primitive)];
        if (material->transparent == 0u) break;
        tint *= material->transmission_ior.xyz;
        // On from the surface that was passed, towards the same light.
        const SurfacePoint point = surface_point(GEOMETRY, &hit);
        const float3 direction = sample->t_far == 1.0f ? from->position + sample->to_light - point.position : sample->to_light;
        ray = leave_surface(&point, direction, sample->t_far);
    }
    counts[COUNT_SHADOW_HIT]++;
    return (float3)(0.0f);
}

// The light of all lights that the surface sends back along the ray, and what it gives off itself.
float3 local_light(SCENE_PARAMETERS, const Surface* surface, const Material* material, float3 view_direction,
                   uint* counts) {
    float3 diffuse = material->diffuse.xyz;
    float3 radiance = material->ambient.xyz;
    if (material->texture != NO_TEXTURE) {
        const float3 colour = surface_colour(scene->textures, scene->texels, scene->srgb_to_linear, material->texture,
                                             surface->texture_u, surface->texture_v, solid_position(surface));
        diffuse *= colour;
        radiance *= colour;
    }
    radiance += material->emission.xyz;
    for (uint i = 0; i < scene->params->light_count; i++) {
        const LightSample sample = sample_light(scene->lights, i, surface->point.position);
        const float3 reflected = blinn_phong(surface, material, diffuse, view_direction, &sample);
        if (!(max_component(reflected) > 0.0f)) continue; // it would add nothing: no shadow ray
        radiance += reflected * light_visibility(SCENE, &surface->point, &sample, counts);
    }
    return radiance;
}

float3 background(const Scene* scene, float3 direction) {
    const float3 bottom = scene->params->background_bottom.xyz;
    const float height = fma(0.5f, direction.y, 0.5f);
    return fma3(scene->params->background_top.xyz - bottom, height, bottom);
}

// The radiance along one camera ray.
float3 radiance_along(SCENE_PARAMETERS, __global const RenderParams* render, Ray camera_ray, uint* counts) {
    const Geometry* geometry = &scene->geometry;
    PendingRay stack[MAX_PENDING];
    stack[0].ray = camera_ray;
    stack[0].weight = (float3)(1.0f);
    stack[0].depth = 1u;
    stack[0].kind = COUNT_CAMERA_CAST;
    uint stacked = 1;
    float3 radiance = (float3)(0.0f);
    while (stacked > 0) {
        const PendingRay pending = stack[--stacked];
        const float3 direction = normalize3(pending.ray.direction, (float3)(0.0f));
        Hit hit;
        counts[pending.kind]++;
        if (!TRAVERSE(GEOMETRY_AT(GEOMETRY_FOR(pending.kind, scene)), &pending.ray, false, &hit)) {
            radiance += pending.weight * background(scene, direction);
            continue;
        }
        counts[pending.kind + 1u]++; // …_HIT follows …_CAST
        const Surface surface = surface_at(GEOMETRY, scene->shading, &pending.ray, &hit);
        const Material material = scene->materials[surface.material];
        radiance += pending.weight * local_light(SCENE, &surface, &material, direction, counts);
        if (pending.depth < render->max_depth)
            stacked = push_secondary_rays(&surface, &material, &pending, direction, render->kill_weight, stack, stacked);
    }
    return radiance;
}

// Camera ray through the point (x, y) of the picture, in pixels from its upper left corner.
Ray camera_ray(__global const RenderParams* render, float x, float y) {
    const float right = fma(x, render->pixel_width, -1.0f);
    const float up = fma(-y, render->pixel_height, 1.0f);
    const float3 direction = fma3(render->right.xyz, right, fma3(render->up.xyz, up, render->forward.xyz));
    return make_ray(render->eye.xyz, direction, 0.0f, INFINITY, NO_PRIMITIVE);
}

// Pixels are numbered tile by tile: item i is pixel i % 64 of tile i / 64. `film`: linear RGB, row by row, top row first.
// `counters`: COUNTER_SLOTS groups of COUNTERS sums. Work records: two a pixel, of its camera rays and of all others.
__kernel void render(GEOMETRY_ARGUMENTS, __global const Shading* restrict shading,
                     __global const Material* restrict materials, __global const Light* restrict lights,
                     __global const TextureInfo* restrict textures, __global const uint* restrict texels,
                     __global const float* restrict srgb_to_linear, __global const RenderParams* restrict render,
                     __global const float2* restrict samples, __global float4* restrict film,
                     volatile __global uint* restrict counters, WORK_ARGUMENT DOUBTS_ARGUMENT const uint first, const uint end) {
    const uint number = first + (uint)get_global_id(0);
    if (number >= end) return;
    const uint item = ITEM_OF(number);
    const uint tile = item / (TILE_SIDE * TILE_SIDE);
    const uint in_tile = item % (TILE_SIDE * TILE_SIDE);
    const uint tiles_per_row = (render->width + TILE_SIDE - 1u) / TILE_SIDE;
    const uint x = tile % tiles_per_row * TILE_SIDE + in_tile % TILE_SIDE;
    const uint y = tile / tiles_per_row * TILE_SIDE + in_tile / TILE_SIDE;
    if (x >= render->width || y >= render->height) return;

    DOUBT_FLAG
    WORK_SUMS(work)
    WORK_SUMS(camera_work)
    const Scene scene = {MAKE_GEOMETRY, CAMERA_GEOMETRY_VALUE shading, materials, lights, textures, texels, srgb_to_linear,
                         scene_params};
    uint counts[COUNTERS] = {0};
    float3 sum = (float3)(0.0f);
    for (uint s = 0; s < render->sample_count; s++) {
        const Ray ray = camera_ray(render, (float)x + samples[s].x, (float)y + samples[s].y);
        sum += radiance_along(SCENE_AT(&scene), render, ray, counts);
    }
    NOTE_DOUBT(item);
    if (IN_DOUBT) return;
    film[y * render->width + x] = (float4)(sum * render->sample_weight, 1.0f);
    STORE_WORK(&scene.camera_geometry, 2u * (y * render->width + x));
    STORE_WORK(&scene.geometry, 2u * (y * render->width + x) + 1u);
    for (uint i = 0; i < COUNTERS; i++)
        if (counts[i] > 0u) atomic_add(&counters[(item % COUNTER_SLOTS) * COUNTERS + i], counts[i]);
}
