// The mega-kernel in packets: a work-item renders tiles of PACKETS_OF_ITEM times sixteen pixels, or samples of pixels
// (render.cl). A tile's camera rays are traced together; then sixteen items at a time, of pixels two rows of eight, go
// on in step: the rays of all of them that are next are traced together, and so are their shadow rays to one lamp. What
// they have hit is computed for sixteen lanes at once (packets/surfaces.cl); a ray of one lane is only made where it is
// traced by itself. Each pixel's own order is that of render.cl, so that its colour is the same to the bit.

// What is kept of an item from sample to sample.
typedef struct {
    float3 sum; // of the samples before
    uint counts[COUNTERS];
} Item;

// Items of a tile.
#define TILE_ITEMS (16u * PACKETS_OF_ITEM)

// A sample on its way.
typedef struct {
    float3 radiance;
    WaitingRay stack[MAX_PENDING]; // behind the last one the ray that is traced, but for camera rays
    uint stacked;
    // Of the hit that is being shaded.
    PendingRay pending; // the ray
    float3 direction;   // unit
    Surface surface;
    Material material;
    LocalLight light;
    SurfacePoint start; // of shadow rays
    float3 reflected;   // of one lamp
    LightSample sample;
    float3 tint;         // what remains of its light
    SurfacePoint passed; // where a shadow ray goes on behind a transparent surface
    float3 towards;      // and its direction there
} Path;

// Sixteen items: the first one, how many are samples of the same pixel, the number of the sample that is rendered, or
// of those the first, and the lanes that are left to the second pass. Only camera rays are also traced for the items
// that follow; their lanes count on.
typedef struct {
    __global const RenderParams* render;
    __global const CameraSample* samples;
    uint item, apart, sample;
    Item* items;
    Path* paths;
    ulong* is_deferred;
} ItemGroup;

// Which of a path's rays.
#define CAMERA_RAYS 0u
#define WAITING_RAYS 1u
#define SHADOW_RAYS 2u
#define PASSED_RAYS 3u // shadow rays behind a transparent surface

const WaitingRay* waiting_ray(const Path* path) { return &path->stack[path->stacked]; }

// Where an item lies: its pixel, and which of those that are samples of the same pixel it is. From item to item this
// takes a division for each pixel only.
typedef struct {
    uint number, sample; // of the pixel, and in it
    uint2 pixel;
} ItemPlace;

void find_item(__global const RenderParams* render, uint item, uint apart, ItemPlace* place) {
    place->number = item / apart;
    place->sample = item % apart;
    place->pixel = pixel_of_item(render, place->number);
}

void next_item(__global const RenderParams* render, uint apart, ItemPlace* place) {
    if (++place->sample < apart) return;
    place->sample = 0u;
    place->pixel = pixel_of_item(render, ++place->number);
}

// A lane's pixel, and the number of its sample.
uint2 pixel_of_lane(const ItemGroup* group, uint lane) {
    return pixel_of_item(group->render, (group->item + lane) / group->apart);
}
uint sample_of_lane(const ItemGroup* group, uint lane) { return group->sample + (group->item + lane) % group->apart; }

// A camera ray or one that was waiting.
void take_pending(const ItemGroup* group, const uint kind, uint lane, PendingRay* pending) {
    if (kind == CAMERA_RAYS)
        *pending =
            first_of_path(group->render, group->samples, pixel_of_lane(group, lane), sample_of_lane(group, lane));
    else
        *pending = load_pending(waiting_ray(&group->paths[lane]));
}

// All of it but the ray.
void take_history(const ItemGroup* group, const uint kind, uint lane, PendingRay* pending) {
    if (kind == CAMERA_RAYS)
        begin_path(
            group->render,
            camera_sample(group->render, group->samples, pixel_of_lane(group, lane), sample_of_lane(group, lane)),
            pending);
    else
        load_history(waiting_ray(&group->paths[lane]), pending);
}

void take_ray_of(const ItemGroup* group, const uint kind, uint lane, Ray* ray) {
    if (kind == SHADOW_RAYS || kind == PASSED_RAYS) {
        const Path* path = &group->paths[lane];
        const SurfacePoint* from = kind == SHADOW_RAYS ? &path->start : &path->passed;
        *ray = leave_surface(from, kind == SHADOW_RAYS ? path->sample.to_light : path->towards, path->sample.t_far);
    } else {
        PendingRay pending;
        take_pending(group, kind, lane, &pending);
        *ray = pending.ray;
    }
}

// The same rays of `lanes` for make_packet().
void pack_rays(const ItemGroup* group, const uint kind, ulong lanes, RayPacket* p) {
    begin_packet(p);
    for (; lanes != 0ul; lanes = other_lanes8(lanes)) {
        const uint lane = first_lane16(lanes);
        const Path* path = &group->paths[lane];
        if (kind == WAITING_RAYS) {
            const WaitingRay* ray = waiting_ray(path);
            add_ray(p, lane, ray->origin_t_near.xyz, ray->origin_low_width.xyz, as_float3(ray->direction_skip.xyz),
                    ray->origin_t_near.w, INFINITY, as_uint(ray->direction_skip.w));
        } else {
            const SurfacePoint* from = kind == SHADOW_RAYS ? &path->start : &path->passed;
            const float3 direction = kind == SHADOW_RAYS ? path->sample.to_light : path->towards;
            add_ray(p, lane, from->position, from->position_low, direction, leaving_t(from->error, direction),
                    path->sample.t_far, from->primitive);
        }
    }
}

// The camera rays of `lanes` from lane `from` on, as first_of_path() makes them.
void pack_camera_rays(const ItemGroup* group, uint from, ulong lanes, RayPacket* p) {
    __global const RenderParams* render = group->render;
    const int16 is_ray = mask_of_lanes16(lanes);
    float16 x = (float16)(0.0f), y = (float16)(0.0f);
    if (render->ray_count == 0u && group->apart == 1u) {
        const uint2 first = place_in_picture(render, pixel_of_lane(group, from));
        const int16 lane = NUMBERS16;
        const CameraSample at = group->samples[group->sample];
        x = convert_float16((int)first.x + lane % (int)TILE_SIDE) + at.x;
        y = convert_float16((int)first.y + lane / (int)TILE_SIDE) + at.y;
    } else {
        ItemPlace place;
        find_item(render, group->item + from, group->apart, &place);
        for (uint i = 0; i < 16u; i++) {
            if ((lanes & lane_bit16(i)) != 0ul) {
                const CameraSample at =
                    camera_sample(render, group->samples, place.pixel, group->sample + place.sample);
                set_lane16(&x, i, at.x);
                set_lane16(&y, i, at.y);
            }
            next_item(render, group->apart, &place);
        }
    }
    // camera_direction()
    const float16 right = fma(x, (float16)(render->pixel_width), (float16)(-1.0f));
    const float16 up = fma(-y, (float16)(render->pixel_height), (float16)(1.0f));
    const float4 rightwards = render->right, upwards = render->up, forward = render->forward, eye = render->eye;
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        p->origin[i] = (float16)(((const float*)&eye)[i]);
        p->origin_low[i] = (float16)(0.0f);
        p->direction[i] = fma((float16)(((const float*)&rightwards)[i]), right,
                              fma((float16)(((const float*)&upwards)[i]), up, (float16)(((const float*)&forward)[i])));
    }
    p->has_low = false;
    p->t_near = is_ray ? (float16)(0.0f) : (float16)(INFINITY);
    p->t_far = is_ray ? (float16)(INFINITY) : (float16)(-INFINITY);
    p->skip = (uint16)(NO_PRIMITIVE);
}

// Fewer rays are traced one after the other: what they gain by a packet is less than what it takes to make one of
// single rays, and to take it apart again.
#define FEWEST_TOGETHER 6u

// The closest hits of the rays of `lanes`, or with any_hit whether there are any. Only camera rays have more than one
// packet: theirs go on in the next items. *packet: the rays that were traced together.
void trace_lanes(GEOMETRY_PARAMETERS, const ItemGroup* group, const uint kind, const ulong* lanes, const bool any_hit,
                 RayPacket* packet, PacketAnswer* answer) {
    const uint packets = kind == CAMERA_RAYS ? PACKETS_OF_ITEM : 1u;
    PacketHits found[PACKETS_OF_ITEM];
    int16 used[PACKETS_OF_ITEM];
    uint traced = 0u;
    for (uint k = 0; k < packets; k++) {
        answer[k].hits = answer[k].together = 0ul;
        if (count_lanes16(lanes[k]) < FEWEST_TOGETHER) continue;
        if (kind == CAMERA_RAYS) pack_camera_rays(group, 16u * k, lanes[k], &packet[k]);
        else pack_rays(group, kind, lanes[k], &packet[k]);
        float16 unit;
        used[k] = make_packet(&packet[k], 1.0f, &unit);
        if (is_any16(used[k])) traced |= 1u << k;
    }
    if (traced != 0u) TRAVERSE_PACKETS(GEOMETRY, packet, traced, any_hit, found);
    for (uint k = 0; k < packets; k++) {
        Ray ray;
        ulong single = lanes[k];
        if ((traced >> k & 1u) != 0u) {
            answer[k].together = lanes_where16(used[k]);
            for (ulong open = unsettled_lanes(&found[k], any_hit); open != 0ul; open = other_lanes8(open)) {
                const uint lane = first_lane16(open);
                take_ray_of(group, kind, 16u * k + lane, &ray);
                settle_lane(GEOMETRY, &ray, lane, any_hit, &found[k]);
            }
            const int16 is_settled = used[k] && !found[k].undecided_lanes;
            single &= ~lanes_where16(is_settled);
            answer[k].hits = lanes_where16(is_settled && found[k].primitive != NO_PRIMITIVE);
            keep_packet(&answer[k], &found[k]);
        }
        for (; single != 0ul; single = other_lanes8(single)) {
            const uint lane = first_lane16(single);
            Hit hit;
            take_ray_of(group, kind, 16u * k + lane, &ray);
            if (trace_ray(GEOMETRY, &ray, any_hit, &hit)) answer[k].hits |= lane_bit16(lane);
            keep_hit(&answer[k], lane, &hit);
            if (FORGET_DEFERRED(geometry)) group->is_deferred[k] |= lane_bit16(lane);
        }
    }
}

// Lets the shadow rays of that kind, which were traced, go on behind what they have hit, if it is transparent. Returns
// those that do.
ulong pass_surfaces(SCENE_PARAMETERS, const ItemGroup* group, const uint kind, const RayPacket* packet,
                    const PacketAnswer* answer) {
    const Geometry* geometry = &scene->geometry;
    ulong passed = 0ul;
    for (ulong rest = answer->hits; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        if (pass_surface(SCENE, answer->primitive[lane], &group->paths[lane].tint)) passed |= lane_bit16(lane);
    }
    PacketSurfaces surfaces;
    float16 corners[9];
    ulong found = passed & answer->together;
    if (count_lanes16(found) < FEWEST_SURFACES) found = 0ul;
    if (found != 0ul) found = points_of_packet(GEOMETRY, packet, answer, found, corners, &surfaces);
    for (ulong rest = passed; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        Path* path = &group->paths[lane];
        if ((found & lane_bit16(lane)) != 0ul) {
            point_of_lane(GEOMETRY, &surfaces, lane, answer->primitive[lane], &path->passed);
        } else {
            Ray ray;
            take_ray_of(group, kind, lane, &ray);
            Hit hit;
            hit_of_answer(answer, lane, &hit);
            SurfaceHit at;
            SURFACE_HIT(GEOMETRY, &ray, &hit, &at);
            if (FORGET_DEFERRED(geometry)) *group->is_deferred |= lane_bit16(lane);
            path->passed = surface_point(GEOMETRY, &at);
        }
        path->towards = still_to_light(&path->start, &path->sample, path->passed.position);
    }
    return passed;
}

// What light_visibility() is for each of the shadow rays of `lanes`, in path->tint.
void see_lamp(SCENE_PARAMETERS, const ItemGroup* group, ulong lanes) {
    const Geometry* geometry = &scene->geometry;
    const bool is_tinted = has_transparent(scene);
    for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        group->items[lane].counts[COUNT_SHADOW_CAST]++;
        group->paths[lane].tint = (float3)(1.0f);
    }
    RayPacket packet;
    PacketAnswer answer;
    trace_lanes(GEOMETRY, group, SHADOW_RAYS, &lanes, !is_tinted, &packet, &answer);
    ulong open = answer.hits, dark = 0ul;
    if (is_tinted) {
        ulong passed = pass_surfaces(SCENE, group, SHADOW_RAYS, &packet, &answer);
        dark = open & ~passed;
        for (uint layer = 1; layer < MAX_SHADOW_LAYERS && passed != 0ul; layer++) {
            trace_lanes(GEOMETRY, group, PASSED_RAYS, &passed, false, &packet, &answer);
            passed = pass_surfaces(SCENE, group, PASSED_RAYS, &packet, &answer);
            dark |= answer.hits & ~passed;
        }
        open = passed;
    }
    // Dark are also those still on their way, and where nothing is seen through all that have hit.
    for (dark |= open; dark != 0ul; dark = other_lanes8(dark)) {
        const uint lane = first_lane16(dark);
        group->items[lane].counts[COUNT_SHADOW_HIT]++;
        group->paths[lane].tint = (float3)(0.0f);
    }
}

// Where a lamp is as seen from sixteen points: LampDirection; and halfway between it and the viewer.
typedef struct {
    float16 to_light[3], direction[3], scale, inv_length, halfway[3];
} PacketLamp;

// Of a lamp at `position`. *has_halfway: the lanes of which it is sure of that. Returns those of which it is sure of
// all else.
ulong directions_to_lamp(const ItemGroup* group, ulong lanes, float3 position, PacketLamp* lamp, ulong* has_halfway) {
    float16 from[3], view[3], scale, inverse;
#pragma unroll
    for (uint i = 0; i < 3u; i++) from[i] = view[i] = (float16)(0.0f);
    for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        const Path* path = &group->paths[lane];
        set_three_of_lane(from, lane, path->surface.point.position);
        set_three_of_lane(view, lane, path->direction);
    }
    const float at[3] = {position.x, position.y, position.z};
#pragma unroll
    for (uint i = 0; i < 3u; i++) lamp->direction[i] = lamp->to_light[i] = at[i] - from[i];
    const int16 is_known = normalize16(lamp->direction, &lamp->scale, &lamp->inv_length);
#pragma unroll
    for (uint i = 0; i < 3u; i++) lamp->halfway[i] = lamp->direction[i] - view[i];
    const int16 is_halfway = normalize16(lamp->halfway, &scale, &inverse);
    *has_halfway = lanes_where16(is_halfway);
    return lanes & lanes_where16(is_known);
}

// Adds lamp number `index` to the light of the surfaces of `lanes`.
void add_lamp(SCENE_PARAMETERS, const ItemGroup* group, ulong lanes, uint index) {
    __global const Light* light = &scene->lights[index];
    PacketLamp lamp;
    ulong lit = 0ul, known = 0ul, has_halfway = 0ul;
    // The direction alone is as fast lane by lane.
    if (HAS(FEATURE_HIGHLIGHTS) && !is_directional(light) && count_lanes16(lanes) >= FEWEST_SURFACES)
        known = directions_to_lamp(group, lanes, light->position.xyz, &lamp, &has_halfway);
    for (; lanes != 0ul; lanes = other_lanes8(lanes)) {
        const uint lane = first_lane16(lanes);
        Path* path = &group->paths[lane];
        bool is_lit;
        if ((known & lane_bit16(lane)) != 0ul) {
            const LampDirection towards = {three_of_lane(lamp.direction, lane), lane_of16(&lamp.scale, lane),
                                           lane_of16(&lamp.inv_length, lane)};
            float3 halfway;
            const bool is_halfway = (has_halfway & lane_bit16(lane)) != 0ul;
            if (is_halfway) halfway = three_of_lane(lamp.halfway, lane);
            sample_lamp(light, three_of_lane(lamp.to_light, lane), &towards, &path->sample);
            is_lit = reflect_sample(&path->surface, &path->material, path->light.diffuse, path->direction,
                                    is_halfway ? &halfway : 0, &path->sample, &path->reflected);
        } else {
            is_lit = light_term(scene, &path->surface, &path->material, path->light.diffuse, path->direction, index,
                                &path->sample, &path->reflected);
        }
        if (is_lit) lit |= lane_bit16(lane);
    }
    if (lit == 0ul) return;
    see_lamp(SCENE, group, lit);
    for (; lit != 0ul; lit = other_lanes8(lit)) {
        Path* path = &group->paths[first_lane16(lit)];
        path->light.radiance += path->reflected * path->tint;
    }
}

// What the paths of `lanes` have hit: path->pending (of its ray only what shading wants, origin and direction), surface
// and direction; of those that have missed the direction alone.
void find_surfaces(SCENE_PARAMETERS, const ItemGroup* group, const uint kind, ulong lanes, const RayPacket* packet,
                   const PacketAnswer* answer) {
    const Geometry* geometry = &scene->geometry;
    float16 unit[3], scale, inverse;
    PacketSurfaces surfaces;
    ulong found = answer->hits & answer->together;
    if (answer->together != 0ul) {
#pragma unroll
        for (uint i = 0; i < 3u; i++) unit[i] = packet->direction[i];
        (void)normalize16(unit, &scale, &inverse);
    }
    if (count_lanes16(found) < FEWEST_SURFACES) found = 0ul;
    if (found != 0ul) found = surfaces_of_packet(GEOMETRY, packet, answer, found, &surfaces);
    for (; lanes != 0ul; lanes = other_lanes8(lanes)) {
        const uint lane = first_lane16(lanes);
        Path* path = &group->paths[lane];
        const bool is_hit = (answer->hits & lane_bit16(lane)) != 0ul;
        if ((answer->together & lane_bit16(lane)) != 0ul) {
            path->direction = three_of_lane(unit, lane);
            if (!is_hit) continue;
        }
        SurfaceHit at;
        if ((found & lane_bit16(lane)) != 0ul) {
            PendingRay* pending = &path->pending;
            pending->ray.origin = three_of_lane(packet->origin, lane);
            pending->ray.direction = three_of_lane(packet->direction, lane);
            take_history(group, kind, lane, pending);
            at = hit_of_lane(&surfaces, lane, answer->primitive[lane]);
            point_of_lane(GEOMETRY, &surfaces, lane, answer->primitive[lane], &path->surface.point);
            path->surface.largest_coordinate = lane_of16(&surfaces.largest_coordinate, lane);
            complete_surface(GEOMETRY, scene->shading, pending->ray.direction, &at,
                             three_of_lane(surfaces.outward, lane), &path->surface);
            continue;
        }
        take_pending(group, kind, lane, &path->pending);
        path->direction = normalize3(path->pending.ray.direction, (float3)(0.0f));
        if (!is_hit) continue;
        Hit hit;
        hit_of_answer(answer, lane, &hit);
        SURFACE_HIT(GEOMETRY, &path->pending.ray, &hit, &at);
        if (FORGET_DEFERRED(geometry)) *group->is_deferred |= lane_bit16(lane);
        path->surface = surface_at(GEOMETRY, scene->shading, &path->pending.ray, &at);
    }
}

// Shades what the paths of `lanes` have hit.
void follow_paths(SCENE_PARAMETERS, const ItemGroup* group, const uint kind, ulong lanes, const RayPacket* packet,
                  const PacketAnswer* answer) {
    find_surfaces(SCENE, group, kind, lanes, packet, answer);
    for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        Path* path = &group->paths[lane];
        const uint counted = kind == CAMERA_RAYS ? COUNT_CAMERA_CAST : kind_of_waiting(waiting_ray(path));
        group->items[lane].counts[counted]++;
        if ((answer->hits & lane_bit16(lane)) == 0ul) {
            const float3 weight =
                kind == CAMERA_RAYS ? (float3)(1.0f) : as_float3(waiting_ray(path)->weight_kind_depth.xyz);
            path->radiance += weight * limit_radiance(background(scene, path->direction));
            continue;
        }
        group->items[lane].counts[counted + 1u]++; // …_HIT follows …_CAST
        path->material = scene->materials[path->surface.material];
        path->light = light_without_lamps(SCENE, &path->surface, &path->material, &path->pending, path->direction);
        path->start = path->surface.point;
        lift_point(&path->start, path->surface.lift);
    }
    for (uint i = 0; i < light_count(scene); i++) add_lamp(SCENE, group, answer->hits, i);
    for (ulong rest = answer->hits; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        Path* path = &group->paths[lane];
        path->radiance += path->pending.weight * limit_radiance(path->light.radiance);
        if (depth_of(path->pending.depth) < group->render->max_depth) {
            Killing killing;
            begin_killing_of_path(group->render, group->samples, pixel_of_lane(group, lane),
                                  sample_of_lane(group, lane), &killing);
            path->stacked = push_secondary_rays(&path->surface, &path->material, &path->pending, path->direction,
                                                &killing, path->stack, path->stacked);
        }
    }
}

// Adds the sample of the paths of `lanes`, whose camera rays were traced, to their items.
void add_sample(SCENE_PARAMETERS, const ItemGroup* group, ulong lanes, RayPacket* packet, PacketAnswer* answer) {
    const Geometry* geometry = &scene->geometry;
    for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
        Path* path = &group->paths[first_lane16(rest)];
        path->radiance = (float3)(0.0f);
        path->stacked = 0u;
    }
    follow_paths(SCENE, group, CAMERA_RAYS, lanes, packet, answer);
    for (;;) {
        ulong open = 0ul;
        for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
            const uint lane = first_lane16(rest);
            if (group->paths[lane].stacked == 0u) continue;
            group->paths[lane].stacked--;
            open |= lane_bit16(lane);
        }
        if (open == 0ul) break;
        trace_lanes(GEOMETRY, group, WAITING_RAYS, &open, false, packet, answer);
        follow_paths(SCENE, group, WAITING_RAYS, open, packet, answer);
    }
    for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        group->items[lane].sum += group->paths[lane].radiance;
    }
}

// What a launch renders: of the items before `end` the samples from first_sample to end_sample.
typedef struct {
    __global const RenderParams* render;
    __global const CameraSample* samples;
    __global float4* film;
    volatile __global uint* counters;
    uint first_sample, end_sample, end;
} PictureLaunch;

// Renders a tile, the items from `item` on.
void render_tile(SCENE_PARAMETERS, const PictureLaunch* launch, DEFERRED_ARGUMENT uint item) {
    const Geometry* geometry = &scene->geometry;
    __global const RenderParams* render = launch->render;
    __global float4* film = launch->film;
    const uint apart = items_of_pixel(render, launch->first_sample, launch->end_sample);
    Item items[TILE_ITEMS];
    ulong inside[PACKETS_OF_ITEM], is_deferred[PACKETS_OF_ITEM];
    for (uint k = 0; k < PACKETS_OF_ITEM; k++) inside[k] = is_deferred[k] = 0ul;
    ItemPlace place;
    find_item(render, item, apart, &place);
    for (uint i = 0; i < TILE_ITEMS; i++, next_item(render, apart, &place)) {
        if (item + i >= launch->end || !is_in_film(render, place.pixel)) continue;
        inside[i / 16u] |= lane_bit16(i % 16u);
        items[i].sum = first_sum(render, film, place.pixel, launch->first_sample, apart);
        for (uint j = 0; j < COUNTERS; j++) items[i].counts[j] = 0u;
    }
    for (uint s = launch->first_sample; s < launch->end_sample; s += apart) {
        Path paths[16];
        RayPacket packets[PACKETS_OF_ITEM];
        PacketAnswer answers[PACKETS_OF_ITEM];
        const ItemGroup all = {render, launch->samples, item, apart, s, items, paths, is_deferred};
        trace_lanes(GEOMETRY, &all, CAMERA_RAYS, inside, false, packets, answers);
        for (uint k = 0; k < PACKETS_OF_ITEM; k++) {
            const ItemGroup sixteen = {
                render, launch->samples, item + 16u * k, apart, s, items + 16u * k, paths, is_deferred + k};
            add_sample(SCENE, &sixteen, inside[k], &packets[k], &answers[k]);
        }
    }
    // In registers: sums in memory wait for each other.
    uint sums[COUNTERS];
#pragma unroll
    for (uint j = 0; j < COUNTERS; j++) sums[j] = 0u;
    for (uint i = 0; i < TILE_ITEMS; i++) {
        if ((inside[i / 16u] & lane_bit16(i % 16u)) == 0ul) continue;
        if ((is_deferred[i / 16u] & lane_bit16(i % 16u)) != 0ul) {
            ADD_DEFERRED(item + i);
            continue;
        }
        store_sum(render, film, item + i, apart, launch->end_sample, items[i].sum);
#pragma unroll
        for (uint j = 0; j < COUNTERS; j++) sums[j] += items[i].counts[j];
    }
    uint counts[COUNTERS];
    for (uint j = 0; j < COUNTERS; j++) counts[j] = sums[j];
    add_counts(counts, launch->counters, item / TILE_ITEMS);
}

// As `render`. What is dear in a picture lies together: work-items take the tiles of a launch one after the other, so
// that none has more of it to do than others while these wait.
__kernel void render_packets(SCENE_ARGUMENTS, __global const RenderParams* restrict render,
                             __global const CameraSample* restrict samples, __global float4* restrict film,
                             volatile __global uint* restrict counters, DEFERRED_ARGUMENT const uint first_sample,
                             const uint end_sample, const uint first, const uint end) {
    const uint tiles = (end - first + TILE_ITEMS - 1u) / TILE_ITEMS;
    TRAVERSAL_STATE
    const Scene scene = MAKE_SCENE;
    const PictureLaunch launch = {render, samples, film, counters, first_sample, end_sample, end};
    for (;;) {
        const uint tile = atomic_inc(&counters[TAKEN_TILES]);
        if (tile >= tiles) return;
        render_tile(SCENE_AT(&scene), &launch, deferred, first + TILE_ITEMS * tile);
    }
}
