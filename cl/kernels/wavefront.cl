// The mega-kernel's work in several kernels, one step of a ray in each (thesis, section 5.2.1): few registers each and
// no two steps in one warp, but all that is known of a ray goes through memory between them.
// Laine, Karras and Aila, "Megakernels Considered Harmful: Wavefront Path Tracing on GPUs", HPG 2013.
//
// A path is a sample of a pixel and all the rays that come of it. A slot holds one: its pending rays and its radiance
// so far. In every wave each slot that is not out of work traces one ray, in the very order of the mega-kernel, so that
// every sum is the same to the last bit:
//
//   wavefront_camera   adds what the last wave's ray has brought; takes the next pending ray, else the camera ray of
//                      the next path of the batch; lists the slots that have a ray
//   wavefront_trace    finds the closest hit
//   wavefront_request  only for textures that the host evaluates: asks for the colours of the hits
//   wavefront_shade    misses: background; hits: light without lamps, secondary rays, and the list of hits
//   then for each light
//   wavefront_light    what it adds to each hit; lists the shadow rays
//   wavefront_shadow   traces them and adds what arrives
//
// Where no slot has a ray any more the batch, all samples of some pixels, is done:
//
//   wavefront_film     adds up each pixel's samples
//
// Where kernels defer rays to a second pass (cl/memory/deferral.cl), wavefront_trace and wavefront_shadow exist once
// more, run behind the first ones, and do what these have left.
//
// All kernels have the same arguments, so that the host sets them alike; the lists' order is left to chance, and
// matters to no result.
//
// Bad at the end of a batch: a wave has at most one ray of each path, and the path with most rays decides how many
// waves there are. Each of them costs a launch of every kernel.

// `rays`: pending rays number 0 of all slots, then number 1, and so on. `lengths`: lengths of the queues, see QUEUE_…
// `path_radiance`: of the batch's paths, which are the first sample of all its pixels, then the second, and so on; the
// pixels are numbers first_pixel .. first_pixel + batch_pixels in the order of pixel_in_tiles.
// `queue`: slots of this wave. `other_queue`: written by wavefront_camera for the next wave, by wavefront_shade with
// the hits; the host exchanges the two after wavefront_camera.
#define WAVEFRONT_ARGUMENTS \
    SCENE_ARGUMENTS, __global const RenderParams* restrict render, __global const CameraSample* restrict samples, \
        __global float4* restrict film, volatile __global uint* restrict counters, \
        __global WavefrontSlot* restrict slots, __global WaitingRay* restrict rays, \
        __global SurfaceHit* restrict hits, __global WavefrontSurface* restrict surfaces, \
        __global WavefrontYield* restrict yields, __global WavefrontShadow* restrict shadows, \
        __global TextureRequest* restrict requests, __global const float4* restrict colours, \
        __global float4* restrict path_radiance, volatile __global uint* restrict lengths, \
        DEFERRED_ARGUMENT const uint slot_count, const uint first_pixel, const uint batch_pixels, \
        __global uint* restrict queue, __global uint* restrict other_queue, const uint light, const uint first, \
        const uint end

// 1: the colours of textures come from the host, 0: they are looked up here.
#ifndef HOST_TEXTURES
#define HOST_TEXTURES 0
#endif

// Whether these kernels are the second pass, which traces the deferred rays and no others.
#ifdef RESOLVE_DEFERRED
#define IS_SECOND_PASS true
#else
#define IS_SECOND_PASS false
#endif

// The end of a queue of rays, or of the list of those that are deferred.
uint traced_end(uint end, volatile __global const uint* deferred) {
    return IS_SECOND_PASS ? min(end, deferred[0]) : end;
}

// A place in the queue of this length for every work-item that wants one. All work-items of a group must come here;
// only one of them meets the other groups at the counter. `places`: two words for the group.
uint take_place(bool wanted, volatile __global uint* length, volatile __local uint* places) {
    barrier(CLK_LOCAL_MEM_FENCE); // nobody still reads what the call before has left
    if (get_local_id(0) == 0) places[0] = 0u;
    barrier(CLK_LOCAL_MEM_FENCE);
    const uint place = wanted ? atomic_inc(&places[0]) : 0u;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (get_local_id(0) == 0) places[1] = atomic_add(length, places[0]);
    barrier(CLK_LOCAL_MEM_FENCE);
    return places[1] + place;
}

// Pixel number `index` in the order of the batches, as its number row by row: tile after tile, where those at the right
// and lower edges may be smaller.
uint pixel_in_tiles(__global const RenderParams* render, uint index) {
    const uint band_size = TILE_SIDE * render->width;
    const uint band = index / band_size, in_band = index % band_size;
    const uint tile_height = min(TILE_SIDE, render->height - band * TILE_SIDE);
    const uint tile = in_band / (TILE_SIDE * tile_height), in_tile = in_band % (TILE_SIDE * tile_height);
    const uint tile_width = min(TILE_SIDE, render->width - tile * TILE_SIDE);
    return (band * TILE_SIDE + in_tile / tile_width) * render->width + tile * TILE_SIDE + in_tile % tile_width;
}

// The pixel of a path of the batch.
uint2 pixel_of_path(__global const RenderParams* render, uint first_pixel, uint batch_pixels, uint path) {
    const uint pixel = pixel_in_tiles(render, first_pixel + path % batch_pixels);
    return (uint2)(pixel % render->width, pixel / render->width);
}

// Through a pointer: what Oclgrind 21.10 makes of a returned struct here (llvm.experimental.noalias.scope.decl) it
// cannot run.
void load_point(__global const WavefrontSurface* from, SurfacePoint* point) {
    const float4 position_error = from->position_error;
    point->position = position_error.xyz;
    point->position_low = from->position_low_lift_x.xyz;
    point->weights = from->weights.xyz;
    point->error = position_error.w;
    point->primitive = as_uint(from->geometric_normal_primitive.w);
}

float3 load_lift(__global const WavefrontSurface* from) {
    return (float3)(from->position_low_lift_x.w, from->view_direction_lift_y.w, from->diffuse_lift_z.w);
}

__kernel void wavefront_camera(WAVEFRONT_ARGUMENTS) {
    __local uint places[2];
    const uint index = first + (uint)get_global_id(0);
    if (index == 0u) deferred[0] = 0u; // for wavefront_trace
    const bool is_item = index < end;
    const uint slot = is_item ? queue[index] : 0u;
    WavefrontSlot state;
    state.path = NO_PATH;
    if (is_item) state = slots[slot];
    if (state.path != NO_PATH) {
        state.radiance.xyz += yields[slot].weight.xyz * limit_radiance(yields[slot].radiance.xyz);
        if (state.pending == 0u) {
            path_radiance[state.path] = state.radiance;
            state.path = NO_PATH;
        }
    }

    const bool wants_path = is_item && state.path == NO_PATH;
    const uint path = take_place(wants_path, &lengths[QUEUE_PATHS], places);
    if (wants_path && path < batch_pixels * render->sample_count) {
        const uint2 at = pixel_of_path(render, first_pixel, batch_pixels, path);
        const PendingRay pending = first_of_path(render, samples, at, path / batch_pixels);
        WaitingRay waiting;
        store_pending(&pending, &waiting);
        rays[slot] = waiting;
        state.path = path;
        state.pending = 1u;
        state.radiance = (float4)(0.0f);
    }

    if (is_item) slots[slot] = state;
    const bool has_ray = state.path != NO_PATH;
    const uint place = take_place(has_ray, &lengths[QUEUE_ACTIVE], places);
    if (has_ray) other_queue[place] = slot;
}

// Empties the lists that the kernels after wavefront_trace fill.
void clear_lists(const Scene* scene, volatile __global uint* lengths) {
    lengths[QUEUE_HITS] = 0u;
    lengths[QUEUE_TEXTURED] = 0u;
    lengths[QUEUE_RESOLVED] = 0u;
    for (uint i = 0; i < light_count(scene); i++) lengths[QUEUE_SHADOWS + i] = 0u;
}

__kernel void wavefront_trace(WAVEFRONT_ARGUMENTS) {
    const uint number = first + (uint)get_global_id(0);
    TRAVERSAL_STATE
    const Scene scene = MAKE_SCENE;
    if (number == 0u) {
        if (IS_SECOND_PASS) lengths[QUEUE_RESOLVED] += deferred[0];
        else clear_lists(&scene, lengths);
    }
    if (number >= traced_end(end, deferred)) return;
    const uint index = ITEM_OF(number);
    const uint slot = queue[index];
    const WaitingRay waiting = rays[(size_t)(slots[slot].pending - 1u) * slot_count + slot];
    const PendingRay pending = load_pending(&waiting);
    uint counts[COUNTERS] = {0};
    Hit hit;
    SurfaceHit at = {0.0f, 0.0f, 0.0f, NO_PRIMITIVE};
    if (trace_pending(SCENE_AT(&scene), &pending, &hit, counts))
        SURFACE_HIT(GEOMETRY_AT(&scene.geometry), &pending.ray, &hit, &at);
    NOTE_DEFERRED(index);
    if (IS_DEFERRED) return;
    hits[slot] = at;
    add_counts(counts, counters, index);
}

__kernel void wavefront_request(WAVEFRONT_ARGUMENTS) {
    __local uint places[2];
    const uint index = first + (uint)get_global_id(0);
    TRAVERSAL_STATE
    const Scene scene = MAKE_SCENE;
    bool wants_colour = false;
    uint slot = 0u;
    SurfaceHit hit;
    if (index < end) {
        slot = queue[index];
        hit = hits[slot];
        if (hit.primitive != NO_PRIMITIVE) {
            const Geometry* geometry = &scene.geometry;
            const Material material = materials[MATERIAL_OF(&scene, hit.primitive)];
            wants_colour = is_textured(&material);
        }
    }
    const uint place = take_place(wants_colour, &lengths[QUEUE_TEXTURED], places);
    if (!wants_colour) return;
    slots[slot].request = place;
    const WaitingRay waiting = rays[(size_t)(slots[slot].pending - 1u) * slot_count + slot];
    const PendingRay pending = load_pending(&waiting);
    const SurfacePoint point = surface_point(GEOMETRY_AT(&scene.geometry), &hit);
    const RayCone cone = cone_at(pending.cone, pending.ray.origin, point.position);
    requests[place].direction_width = (float4)(pending.ray.direction, cone.width);
    requests[place].weight0 = hit.weight0;
    requests[place].u = hit.u;
    requests[place].v = hit.v;
    requests[place].primitive = hit.primitive;
}

__kernel void wavefront_shade(WAVEFRONT_ARGUMENTS) {
    __local uint places[2];
    const uint index = first + (uint)get_global_id(0);
    TRAVERSAL_STATE
    const Scene scene = MAKE_SCENE;
    if (index == 0u) lengths[QUEUE_ACTIVE] = 0u; // for the next wave
    bool is_hit = false;
    uint slot = 0u;
    if (index < end) {
        slot = queue[index];
        const uint below = slots[slot].pending - 1u;
        const WaitingRay waiting = rays[(size_t)below * slot_count + slot];
        const PendingRay pending = load_pending(&waiting);
        const float3 direction = normalize3(pending.ray.direction, (float3)(0.0f));
        const SurfaceHit hit = hits[slot];
        is_hit = hit.primitive != NO_PRIMITIVE;
        float3 radiance;
        uint pushed = 0u;
        if (is_hit) {
            const Surface surface = surface_at(GEOMETRY_AT(&scene.geometry), shading, &pending.ray, &hit);
            const Material material = materials[surface.material];
            float3 colour = (float3)(1.0f);
            if (is_textured(&material))
                colour = HOST_TEXTURES ? colours[slots[slot].request].xyz
                                       : texture_colour(SCENE_AT(&scene), &surface, &material, &pending, direction);
            const LocalLight without_lamps =
                begin_local_light(&scene, &surface, &material, direction, colour);
            radiance = without_lamps.radiance;
            surfaces[slot].position_error = (float4)(surface.point.position, surface.point.error);
            surfaces[slot].position_low_lift_x = (float4)(surface.point.position_low, surface.lift.x);
            surfaces[slot].weights = (float4)(surface.point.weights, 0.0f);
            surfaces[slot].geometric_normal_primitive = pack_bits(surface.geometric_normal, hit.primitive);
            surfaces[slot].normal_material = pack_bits(surface.normal, surface.material);
            surfaces[slot].view_direction_lift_y = (float4)(direction, surface.lift.y);
            surfaces[slot].diffuse_lift_z = (float4)(without_lamps.diffuse, surface.lift.z);
            if (depth_of(pending.depth) < render->max_depth) {
                const uint path = slots[slot].path;
                const uint2 at = pixel_of_path(render, first_pixel, batch_pixels, path);
                Killing killing;
                begin_killing_of_path(render, samples, at, path / batch_pixels, &killing);
                WaitingRay secondary[2];
                pushed = push_secondary_rays(&surface, &material, &pending, direction, &killing, secondary, 0u);
                for (uint i = 0; i < pushed; i++) rays[(size_t)(below + i) * slot_count + slot] = secondary[i];
            }
        } else {
            radiance = background(&scene, direction);
        }
        slots[slot].pending = below + pushed;
        yields[slot].radiance = (float4)(radiance, 0.0f);
        yields[slot].weight = (float4)(pending.weight, 0.0f);
    }
    const uint place = take_place(is_hit, &lengths[QUEUE_HITS], places);
    if (is_hit) other_queue[place] = slot;
}

__kernel void wavefront_light(WAVEFRONT_ARGUMENTS) {
    __local uint places[2];
    const uint index = first + (uint)get_global_id(0);
    TRAVERSAL_STATE
    const Scene scene = MAKE_SCENE;
    if (index == 0u) deferred[0] = 0u; // for wavefront_shadow
    bool adds = false;
    uint slot = 0u;
    LightSample sample;
    float3 reflected;
    if (index < min(end, lengths[QUEUE_HITS])) {
        slot = other_queue[index];
        const int4 normal_material = surfaces[slot].normal_material;
        Surface surface; // as far as light_term looks at it
        load_point(&surfaces[slot], &surface.point);
        surface.geometric_normal = as_float3(surfaces[slot].geometric_normal_primitive.xyz);
        surface.normal = as_float3(normal_material.xyz);
        surface.lift = load_lift(&surfaces[slot]);
        const Material material = materials[as_uint(normal_material.w)];
        adds = light_term(&scene, &surface, &material, surfaces[slot].diffuse_lift_z.xyz,
                          surfaces[slot].view_direction_lift_y.xyz, light, &sample, &reflected);
    }
    const uint place = take_place(adds, &lengths[QUEUE_SHADOWS + light], places);
    if (!adds) return;
    shadows[place].to_light_t_far = (float4)(sample.to_light, sample.t_far);
    shadows[place].reflected_slot = pack_bits(reflected, slot);
}

__kernel void wavefront_shadow(WAVEFRONT_ARGUMENTS) {
    const uint number = first + (uint)get_global_id(0);
    if (IS_SECOND_PASS && number == 0u) lengths[QUEUE_RESOLVED] += deferred[0];
    if (number >= traced_end(min(end, lengths[QUEUE_SHADOWS + light]), deferred)) return;
    const uint index = ITEM_OF(number);
    TRAVERSAL_STATE
    const Scene scene = MAKE_SCENE;
    const float4 to_light_t_far = shadows[index].to_light_t_far;
    const int4 reflected_slot = shadows[index].reflected_slot;
    const uint slot = as_uint(reflected_slot.w);
    LightSample sample; // as far as light_visibility looks at it
    sample.to_light = to_light_t_far.xyz;
    sample.t_far = to_light_t_far.w;
    SurfacePoint point;
    load_point(&surfaces[slot], &point);
    lift_point(&point, load_lift(&surfaces[slot]));
    uint counts[COUNTERS] = {0};
    const float3 visibility = light_visibility(SCENE_AT(&scene), &point, &sample, counts);
    NOTE_DEFERRED(index);
    if (IS_DEFERRED) return;
    yields[slot].radiance.xyz += as_float3(reflected_slot.xyz) * visibility;
    add_counts(counts, counters, index);
}

__kernel void wavefront_film(WAVEFRONT_ARGUMENTS) {
    const uint index = first + (uint)get_global_id(0);
    if (index >= end) return;
    float3 sum = (float3)(0.0f);
    for (uint s = 0; s < render->sample_count; s++) sum += path_radiance[s * batch_pixels + index].xyz;
    film[pixel_in_tiles(render, first_pixel + index)] = (float4)(sum * render->sample_weight, 1.0f);
}
