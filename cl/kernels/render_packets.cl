// The mega-kernel in packets: one work-item renders sixteen pixels, two rows of eight, in step. The rays of all of them that are next
// are traced together, and so are their shadow rays to one lamp. Each pixel's own order is that of render.cl, so that its colour is
// the same to the bit.

// A pixel on its way.
typedef struct {
    float3 radiance; // of this sample
    float3 sum;      // of the samples before
    WaitingRay stack[MAX_PENDING];
    uint stacked;
    uint counts[COUNTERS];
    PendingRay pending; // the ray that is traced next
    // Of the hit that is being shaded.
    float3 direction; // unit
    Surface surface;
    Material material;
    LocalLight light;
    SurfacePoint start; // of shadow rays
    float3 reflected;   // of one lamp
    LightSample sample;
    float3 tint; // what remains of its light
} Path;

// What became of rays: the lanes that have hit, and what.
typedef struct {
    ulong hits;
    uint primitive[16];
} PacketAnswer;

// Fewer rays are traced one after the other: what they gain by a packet is less than what it takes to make one of single rays, and to
// take it apart again.
#define FEWEST_TOGETHER 6u

// The closest hits of the `rays` of `lanes`, or with any_hit whether there are any. What is left to the second pass is added to
// *in_doubt.
void trace_lanes(GEOMETRY_PARAMETERS, const Ray* rays, ulong lanes, const bool any_hit, PacketAnswer* answer, ulong* in_doubt) {
    answer->hits = 0ul;
    ulong alone = lanes;
    if (count_lanes16(lanes) >= FEWEST_TOGETHER) {
        RayPacket packet;
        int16 used = pack_rays(rays, lanes, &packet);
        if (is_any16(used)) {
            PacketHits found;
            int16 doubtful;
            TRAVERSE_PACKETS(GEOMETRY, &packet, 1u, any_hit, &found, &doubtful);
            for (ulong open = unsettled_lanes(&found) & lanes_where16(!doubtful); open != 0ul; open = other_lanes8(open)) {
                const uint lane = first_lane16(open);
                settle_lane(GEOMETRY, &rays[lane], lane, &found, &doubtful);
            }
            used = used && !doubtful;
            alone &= ~lanes_where16(used);
            answer->hits = lanes_where16(used && found.primitive != NO_PRIMITIVE);
            vstore16(found.primitive, 0, answer->primitive);
        }
    }
    for (; alone != 0ul; alone = other_lanes8(alone)) {
        const uint lane = first_lane16(alone);
        Hit hit;
        if (trace_ray(GEOMETRY, &rays[lane], any_hit, &hit)) answer->hits |= lane_bit16(lane);
        answer->primitive[lane] = hit.primitive;
        if (TAKE_IN_DOUBT(geometry)) *in_doubt |= lane_bit16(lane);
    }
}

// What light_visibility() is for each of the shadow `rays` of `lanes`, in path->tint.
void see_lamp(SCENE_PARAMETERS, Path* paths, Ray* rays, ulong lanes, ulong* in_doubt) {
    const Geometry* geometry = &scene->geometry;
    const bool is_tinted = has_transparent(scene);
    for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
        Path* path = &paths[first_lane16(rest)];
        path->counts[COUNT_SHADOW_CAST]++;
        path->tint = (float3)(1.0f);
    }
    ulong open = lanes, dark = 0ul;
    for (uint layer = 0; layer < MAX_SHADOW_LAYERS && open != 0ul; layer++) {
        PacketAnswer answer;
        trace_lanes(GEOMETRY, rays, open, !is_tinted, &answer, in_doubt);
        open = answer.hits;
        if (!is_tinted) break;
        ulong passed = 0ul;
        for (ulong rest = open; rest != 0ul; rest = other_lanes8(rest)) {
            const uint lane = first_lane16(rest);
            Path* path = &paths[lane];
            Hit hit = no_hit();
            hit.primitive = answer.primitive[lane];
            if (pass_surface(SCENE, &path->start, &path->sample, &hit, &rays[lane], &path->tint)) passed |= lane_bit16(lane);
            if (TAKE_IN_DOUBT(geometry)) *in_doubt |= lane_bit16(lane);
        }
        dark |= open & ~passed;
        open = passed;
    }
    // Dark are also those still on their way, and where nothing is seen through all that have hit.
    for (dark |= open; dark != 0ul; dark = other_lanes8(dark)) {
        Path* path = &paths[first_lane16(dark)];
        path->counts[COUNT_SHADOW_HIT]++;
        path->tint = (float3)(0.0f);
    }
}

// Adds lamp number `index` to the light of the surfaces of `lanes`.
void add_lamp(SCENE_PARAMETERS, Path* paths, ulong lanes, uint index, ulong* in_doubt) {
    Ray rays[16];
    ulong lit = 0ul;
    for (; lanes != 0ul; lanes = other_lanes8(lanes)) {
        const uint lane = first_lane16(lanes);
        Path* path = &paths[lane];
        if (!light_term(scene, &path->surface, &path->material, path->light.diffuse, path->direction, index, &path->sample,
                        &path->reflected))
            continue;
        rays[lane] = leave_surface(&path->start, path->sample.to_light, path->sample.t_far);
        lit |= lane_bit16(lane);
    }
    if (lit == 0ul) return;
    see_lamp(SCENE, paths, rays, lit, in_doubt);
    for (; lit != 0ul; lit = other_lanes8(lit)) {
        Path* path = &paths[first_lane16(lit)];
        path->light.radiance += path->reflected * path->tint;
    }
}

// Traces the next ray of each path of `lanes`, and shades what is hit.
void follow_paths(SCENE_PARAMETERS, __global const RenderParams* render, Path* paths, ulong lanes, ulong* in_doubt) {
    const Geometry* geometry = &scene->geometry;
    Ray rays[16];
    for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        Path* path = &paths[lane];
        path->direction = normalize3(path->pending.ray.direction, (float3)(0.0f));
        path->counts[path->pending.kind]++;
        rays[lane] = path->pending.ray;
    }
    PacketAnswer answer;
    trace_lanes(GEOMETRY, rays, lanes, false, &answer, in_doubt);
    for (ulong rest = lanes; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        Path* path = &paths[lane];
        if ((answer.hits & lane_bit16(lane)) == 0ul) {
            path->radiance += path->pending.weight * limit_radiance(background(scene, path->direction));
            continue;
        }
        path->counts[path->pending.kind + 1u]++; // …_HIT follows …_CAST
        Hit hit = no_hit();
        hit.primitive = answer.primitive[lane];
        SurfaceHit at;
        SURFACE_HIT(GEOMETRY, &path->pending.ray, &hit, &at);
        if (TAKE_IN_DOUBT(geometry)) *in_doubt |= lane_bit16(lane);
        path->surface = surface_at(GEOMETRY, scene->shading, &path->pending.ray, &at);
        path->material = scene->materials[path->surface.material];
        path->light = light_without_lamps(SCENE, &path->surface, &path->material, &path->pending, path->direction);
        path->start = path->surface.point;
        lift_point(&path->start, path->surface.lift);
    }
    for (uint i = 0; i < light_count(scene); i++) add_lamp(SCENE, paths, answer.hits, i, in_doubt);
    for (ulong rest = answer.hits; rest != 0ul; rest = other_lanes8(rest)) {
        Path* path = &paths[first_lane16(rest)];
        path->radiance += path->pending.weight * limit_radiance(path->light.radiance);
        if (path->pending.depth < render->max_depth)
            path->stacked = push_secondary_rays(&path->surface, &path->material, &path->pending, path->direction,
                                                render->kill_weight, path->stack, path->stacked);
    }
}

// Runtimes for CPUs give a thread dozens of work-items in a row, of which it may be the last to be done: what is dear in a picture lies
// together. So rows take a few neighbours, which meet the same nodes, in each of several parts of the launch. Which of `count` the
// work-item i is; every one is once.
#define SPREAD_NEIGHBOURS 4u
#define SPREAD_PARTS 8u
uint spread_work(uint i, uint count) {
    const uint blocks = count / SPREAD_NEIGHBOURS, block = i / SPREAD_NEIGHBOURS;
    if (block >= blocks) return i;
    const uint part = block % SPREAD_PARTS;
    // The first parts have one block more than the others, where the number does not divide.
    const uint first = part * (blocks / SPREAD_PARTS) + min(part, blocks % SPREAD_PARTS);
    return (first + block / SPREAD_PARTS) * SPREAD_NEIGHBOURS + i % SPREAD_NEIGHBOURS;
}

// As `render`, for sixteen items at a time.
__kernel void render_packets(SCENE_ARGUMENTS, __global const RenderParams* restrict render, __global const CameraSample* restrict samples,
                             __global float4* restrict film, volatile __global uint* restrict counters,
                             DOUBTS_ARGUMENT const uint first_sample, const uint end_sample, const uint first, const uint end) {
    const uint count = (end - first + 15u) / 16u;
    if ((uint)get_global_id(0) >= count) return;
    const uint item = first + 16u * spread_work((uint)get_global_id(0), count);
    TRAVERSAL_STATE
    const Scene scene = MAKE_SCENE;
    Path paths[16];
    ulong inside = 0ul, in_doubt = 0ul;
    for (uint lane = 0; lane < 16u; lane++) {
        const uint2 pixel = pixel_of_item(render, item + lane);
        if (item + lane >= end || !is_in_film(render, pixel)) continue;
        inside |= lane_bit16(lane);
        paths[lane].sum = first_sample == 0u ? (float3)(0.0f) : film[pixel.y * render->width + pixel.x].xyz;
        for (uint i = 0; i < COUNTERS; i++) paths[lane].counts[i] = 0u;
    }
    for (uint s = first_sample; s < end_sample; s++) {
        for (ulong rest = inside; rest != 0ul; rest = other_lanes8(rest)) {
            const uint lane = first_lane16(rest);
            Path* path = &paths[lane];
            const uint2 pixel = pixel_of_item(render, item + lane);
            path->radiance = (float3)(0.0f);
            path->pending = first_of_path(render, samples, pixel, s);
            path->stacked = 0u;
        }
        for (ulong open = inside; open != 0ul;) {
            follow_paths(SCENE_AT(&scene), render, paths, open, &in_doubt);
            for (ulong rest = open; rest != 0ul; rest = other_lanes8(rest)) {
                const uint lane = first_lane16(rest);
                Path* path = &paths[lane];
                if (path->stacked == 0u) open &= ~lane_bit16(lane);
                else path->pending = load_pending(&path->stack[--path->stacked]);
            }
        }
        for (ulong rest = inside; rest != 0ul; rest = other_lanes8(rest)) {
            Path* path = &paths[first_lane16(rest)];
            path->sum += path->radiance;
        }
    }
    for (ulong rest = inside; rest != 0ul; rest = other_lanes8(rest)) {
        const uint lane = first_lane16(rest);
        const Path* path = &paths[lane];
        if ((in_doubt & lane_bit16(lane)) != 0ul) {
            ADD_DOUBT(item + lane);
            continue;
        }
        const uint2 pixel = pixel_of_item(render, item + lane);
        film[pixel.y * render->width + pixel.x] = sum_of_samples(render, path->sum, end_sample);
        add_counts(path->counts, counters, item + lane);
    }
}
