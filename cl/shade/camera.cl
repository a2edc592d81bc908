// Where the rays of a picture begin, and where they are counted.

// Direction of the camera ray through the point (x, y) of the picture, in pixels from its upper left corner. Its
// component along the view is 1.
float3 camera_direction(__global const RenderParams* render, float x, float y) {
    const float right = fma(x, render->pixel_width, -1.0f);
    const float up = fma(-y, render->pixel_height, 1.0f);
    return fma3(render->right.xyz, right, fma3(render->up.xyz, up, render->forward.xyz));
}

// Where a pixel of the film lies in the picture, of which the film may be a part.
uint2 place_in_picture(__global const RenderParams* render, uint2 pixel) {
    return pixel + (uint2)(render->first_pixel & 0xffffu, render->first_pixel >> 16);
}

// The number of a pixel of the film, row by row.
uint place_in_film(__global const RenderParams* render, uint2 pixel) { return pixel.y * render->width + pixel.x; }

// A ray's place in the picture, in pixels from the upper left corner: that of sample number `s` of a pixel, or of a
// list which has this place in the film.
CameraSample camera_sample(__global const RenderParams* render, __global const CameraSample* samples, uint2 pixel,
                           uint s) {
    if (render->ray_count != 0u) return samples[place_in_film(render, pixel)];
    const uint2 place = place_in_picture(render, pixel);
    CameraSample at = samples[s];
    at.x = (float)place.x + at.x;
    at.y = (float)place.y + at.y;
    return at;
}

// What a camera ray is beside the ray.
void begin_path(__global const RenderParams* render, CameraSample at, PendingRay* first) {
    first->weight = (float3)(1.0f);
    first->depth = 1u;
    first->kind = COUNT_CAMERA_CAST;
    first->cone.width = 0.0f;
    first->cone.spread = 0.0f;
    if (HAS_CONES) {
        // A pixel away from the middle is farther off and seen at a slant. Of its sides as the ray sees them this is
        // the shorter.
        const float3 direction = camera_direction(render, at.x, at.y);
        first->cone.spread = at.footprint * render->pixel_size / dot3(direction, direction);
    }
}

// A camera ray.
PendingRay first_of_path(__global const RenderParams* render, __global const CameraSample* samples, uint2 pixel,
                         uint s) {
    const CameraSample at = camera_sample(render, samples, pixel, s);
    PendingRay first;
    first.ray = make_ray(render->eye.xyz, camera_direction(render, at.x, at.y), 0.0f, INFINITY, NO_PRIMITIVE);
    begin_path(render, at, &first);
    return first;
}

// What decides about the rays that come of it.
void begin_killing_of_path(__global const RenderParams* render, __global const CameraSample* samples, uint2 pixel,
                           uint s, Killing* killing) {
    begin_killing(render, hash_place(camera_sample(render, samples, pixel, s)), killing);
}

// Whether the film has this pixel. The last row of a list's rays may not be full.
bool is_in_film(__global const RenderParams* render, uint2 pixel) {
    if (pixel.x >= render->width || pixel.y >= render->height) return false;
    return render->ray_count == 0u || place_in_film(render, pixel) < render->ray_count;
}

// Pixels are numbered tile by tile: item i is pixel i % TILE_PIXELS of tile i / TILE_PIXELS, row by row. It may lie
// outside of the picture.
uint2 pixel_of_item(__global const RenderParams* render, uint item) {
    const uint tile = item / TILE_PIXELS, in_tile = item % TILE_PIXELS;
    const uint tiles_per_row = (render->width + TILE_SIDE - 1u) / TILE_SIDE;
    return (uint2)(tile % tiles_per_row * TILE_SIDE + in_tile % TILE_SIDE,
                   tile / tiles_per_row * TILE_SIDE + in_tile / TILE_SIDE);
}

// What the film keeps of the sum of a pixel's samples before number `end`: after the last one their mean.
float4 sum_of_samples(__global const RenderParams* render, float3 sum, uint end) {
    return (float4)(end == render->sample_count ? sum * render->sample_weight : sum, 1.0f);
}

// Items of a pixel in a launch of these samples: see `render`.
uint items_of_pixel(__global const RenderParams* render, uint first_sample, uint end_sample) {
    return render->samples_apart != 0u ? end_sample - first_sample : 1u;
}

// The sum to which an item adds its samples, the first of which has this number.
float3 first_sum(__global const RenderParams* render, __global const float4* film, uint2 pixel, uint first_sample,
                 uint apart) {
    if (first_sample == 0u || apart > 1u) return (float3)(0.0f);
    return film[place_in_film(render, pixel)].xyz;
}

// Stores the sum of an item's samples; end_sample: the number behind the launch's last one.
void store_sum(__global const RenderParams* render, __global float4* film, uint item, uint apart, uint end_sample,
               float3 sum) {
    if (apart > 1u) film[item % render->samples_apart] = (float4)(sum, 1.0f);
    else film[place_in_film(render, pixel_of_item(render, item))] = sum_of_samples(render, sum, end_sample);
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
