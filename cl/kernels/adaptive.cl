// Pictures of bounded error: what is known of the pixels, and which of them are traced next (src/adaptive.rs says why,
// and has the twin of everything here; what it has in capitals comes from there). LATTICE in place of a class: the
// pixels of the lattice are asked for.
//
// Pixels are listed tile by tile, so that rays that are traced together run close together.

#define LEVEL_BITS 8u
#define LEVEL_OF(state) ((state) & ((1u << LEVEL_BITS) - 1u))
#define ROUND_OF(state) ((state) >> LEVEL_BITS)
#define NO_CLASS 0xffffffffu

// What is known of a picture's pixels, each an element of these arrays:
//   film     as shown, linear
//   sums     of the samples
//   shown    xyz: values of a screen; w: squared error, of a mean by what parts of it differ, of an interpolated pixel
//            by what its neighbours turned out to be
//   states   level, and the round in which it had its last samples << LEVEL_BITS
//   errors   squared
//   classes  level * CLASSES + class, or NO_CLASS
#define PIXEL_ARGUMENTS \
    const uint width, const uint height, const uint lattice, __global float4* restrict film, \
        __global float4* restrict sums, __global float4* restrict shown, __global uint* restrict states, \
        __global float* restrict errors, __global uint* restrict classes

// Mean of the squared channels.
float mean_square(float3 v) { return (v.x * v.x + v.y * v.y + v.z * v.z) * (1.0f / 3.0f); }

float display_step(__global const float* curve, float radiance) {
    const float at = sqrt(radiance > 0.0f ? min_or(radiance, 1.0f) : 0.0f) * (float)CURVE_INTERVALS;
    const uint low = (uint)at;
    return curve[low] + (curve[low + 1u] - curve[low]) * (at - (float)low);
}

// Values of a screen, 0 to 255 without rounding.
float3 display_steps(__global const float* curve, float3 radiance) {
    return (float3)(display_step(curve, radiance.x), display_step(curve, radiance.y), display_step(curve, radiance.z));
}

uint2 pixels_of_tile(uint width, uint height, uint tile, uint2* low) {
    const uint tiles_across = (width + TILE_SIDE - 1u) / TILE_SIDE;
    *low = (uint2)(tile % tiles_across * TILE_SIDE, tile / tiles_across * TILE_SIDE);
    return (uint2)(min(low->x + TILE_SIDE, width), min(low->y + TILE_SIDE, height));
}

bool is_on_lattice(uint i, uint end, uint lattice) { return i % lattice == 0u || i + 1u == end; }

// How many new samples a pixel is to have: of a class from `lowest` on, or of the lattice.
uint wanted_samples(uint x, uint y, uint width, uint height, uint lattice, __global const uint* classes, uint lowest,
                    uint only_interpolated) {
    if (lowest == LATTICE) return is_on_lattice(x, width, lattice) && is_on_lattice(y, height, lattice) ? 1u : 0u;
    const uint level_class = classes[y * width + x];
    if (level_class == NO_CLASS || level_class % CLASSES < lowest) return 0u;
    const uint level = level_class / CLASSES;
    if (only_interpolated != 0u && level > 0u) return 0u;
    return LEVEL_SAMPLES[level + 1u] - LEVEL_SAMPLES[level];
}

// Nothing is known of any pixel.
__kernel void forget_pixels(PIXEL_ARGUMENTS, const uint first, const uint end) {
    const uint pixel = first + (uint)get_global_id(0);
    if (pixel >= end) return;
    states[pixel] = 0u;
    shown[pixel] = (float4)(0.0f);
}

// How many pixels (x) of each tile are to have more samples, and how many samples (y).
__kernel void count_wanted(PIXEL_ARGUMENTS, __global uint2* restrict tiles, const uint lowest,
                           const uint only_interpolated, const uint first, const uint end) {
    const uint tile = first + (uint)get_global_id(0);
    if (tile >= end) return;
    uint2 low;
    const uint2 high = pixels_of_tile(width, height, tile, &low);
    uint2 count = (uint2)(0u);
    for (uint y = low.y; y < high.y; y++) {
        for (uint x = low.x; x < high.x; x++) {
            const uint wanted = wanted_samples(x, y, width, height, lattice, classes, lowest, only_interpolated);
            count += (uint2)(wanted != 0u ? 1u : 0u, wanted);
        }
    }
    tiles[tile] = count;
}

// Lists these pixels (x) and where the samples of each begin (y). `tiles`: how many there are in the tiles before;
// `before`: in those before the list's first tile.
__kernel void list_wanted(PIXEL_ARGUMENTS, __global const uint2* restrict tiles, const uint lowest,
                          const uint only_interpolated, __global uint2* restrict list, const uint pixels_before,
                          const uint samples_before, const uint first, const uint end) {
    const uint tile = first + (uint)get_global_id(0);
    if (tile >= end) return;
    uint2 low;
    const uint2 high = pixels_of_tile(width, height, tile, &low);
    uint2 next = tiles[tile] - (uint2)(pixels_before, samples_before);
    for (uint y = low.y; y < high.y; y++) {
        for (uint x = low.x; x < high.x; x++) {
            const uint wanted = wanted_samples(x, y, width, height, lattice, classes, lowest, only_interpolated);
            if (wanted == 0u) continue;
            list[next.x] = (uint2)(y * width + x, next.y);
            next += (uint2)(1u, wanted);
        }
    }
}

// The positions of the new samples of listed pixels.
__kernel void place_samples(PIXEL_ARGUMENTS, __global const uint2* restrict list,
                            __global const CameraSample* restrict sequence, __global CameraSample* restrict samples,
                            const uint first, const uint end) {
    const uint number = first + (uint)get_global_id(0);
    if (number >= end) return;
    const uint pixel = list[number].x;
    const uint level = LEVEL_OF(states[pixel]);
    const float x = (float)(pixel % width), y = (float)(pixel / width);
    uint to = list[number].y;
    for (uint i = LEVEL_SAMPLES[level]; i < LEVEL_SAMPLES[level + 1u]; i++) {
        const CameraSample in_pixel = sequence[i];
        const CameraSample sample = {x + in_pixel.x, y + in_pixel.y, in_pixel.footprint};
        samples[to++] = sample;
    }
}

float3 sum_of(__global const float4* radiances, float3 sum, uint from, uint end) {
    for (uint i = from; i < end; i++) sum += radiances[i].xyz;
    return sum;
}

// Takes note of the radiances of new samples. `changes`: of pixels that have their first ones the square of how much
// these are not what was there.
__kernel void take_samples(PIXEL_ARGUMENTS, __global const uint2* restrict list,
                           __global const float4* restrict radiances, __global const float* restrict curve,
                           __global float* restrict changes, const uint round, const uint first, const uint end) {
    const uint number = first + (uint)get_global_id(0);
    if (number >= end) return;
    const uint pixel = list[number].x, from = list[number].y;
    const uint level = LEVEL_OF(states[pixel]);
    const uint before = LEVEL_SAMPLES[level], all = LEVEL_SAMPLES[level + 1u];
    const float3 old = level == 0u ? (float3)(0.0f) : sums[pixel].xyz;
    const float3 sum = sum_of(radiances, old, from, from + (all - before));
    const float3 mean = sum * power_of_two_scale((float)all); // which is 1 / all
    const float3 now = display_steps(curve, mean);
    float variance = 0.0f;
    if (level == 0u) {
        changes[number] = mean_square(now - shown[pixel].xyz);
    } else {
        // Four sets of samples that cover the pixel alike: the old ones, and as many new ones three times.
        const float part = power_of_two_scale((float)before);
        const float3 zero = (float3)(0.0f);
        const float3 a = display_steps(curve, old * part);
        const float3 b = display_steps(curve, sum_of(radiances, zero, from, from + before) * part);
        const float3 c = display_steps(curve, sum_of(radiances, zero, from + before, from + 2u * before) * part);
        const float3 d = display_steps(curve, sum_of(radiances, zero, from + 2u * before, from + 3u * before) * part);
        const float3 middle = (a + b + c + d) * 0.25f;
        const float spread =
            mean_square(a - middle) + mean_square(b - middle) + mean_square(c - middle) + mean_square(d - middle);
        variance = spread * (1.0f / 12.0f);
    }
    sums[pixel] = (float4)(sum, 0.0f);
    film[pixel] = (float4)(mean, 0.0f);
    shown[pixel] = (float4)(now, variance);
    states[pixel] = (level + 1u) | round << LEVEL_BITS;
}

// Where an interpolated pixel was wrong, those beside it may be.
__kernel void tell_neighbours(PIXEL_ARGUMENTS, __global const uint2* restrict list,
                              __global const float* restrict changes, const uint first, const uint end) {
    const uint number = first + (uint)get_global_id(0);
    if (number >= end) return;
    const uint pixel = list[number].x;
    if (LEVEL_OF(states[pixel]) != 1u) return;
    const uint x = pixel % width, y = pixel / width;
    // No number is below zero: as integers they have the same order.
    const uint told = as_uint(SURPRISE * changes[number]);
    for (uint row = max(y, 1u) - 1u; row < min(y + 2u, height); row++) {
        for (uint column = max(x, 1u) - 1u; column < min(x + 2u, width); column++) {
            const uint near = row * width + column;
            if (LEVEL_OF(states[near]) == 0u) atomic_max((volatile __global uint*)&shown[near] + 3, told);
        }
    }
}

// The points of the lattice around `i`, and how far it is from the first to the second.
float between(uint i, uint lattice, uint end, uint2* points) {
    const uint low = i / lattice * lattice;
    const uint high = min(low + lattice, end - 1u);
    *points = (uint2)(low, high);
    return high > low ? (float)(i - low) / (float)(high - low) : 0.0f;
}

// Gives the pixels without samples what lies between those of the lattice.
__kernel void interpolate(PIXEL_ARGUMENTS, __global const float* restrict curve, const uint first, const uint end) {
    const uint pixel = first + (uint)get_global_id(0);
    if (pixel >= end || LEVEL_OF(states[pixel]) != 0u) return;
    uint2 columns, rows;
    const float across = between(pixel % width, lattice, width, &columns),
                down = between(pixel / width, lattice, height, &rows);
    // The corners have samples: nobody writes them.
    const float3 a = film[rows.x * width + columns.x].xyz, b = film[rows.x * width + columns.y].xyz;
    const float3 c = film[rows.y * width + columns.x].xyz, d = film[rows.y * width + columns.y].xyz;
    const float3 upper = fma3(b - a, across, a), lower = fma3(d - c, across, c);
    const float3 value = fma3(lower - upper, down, upper);
    film[pixel] = (float4)(value, 0.0f);
    shown[pixel].xyz = display_steps(curve, value);
}

// The squared second difference of the lattice at a point and those before and after it; 0 where there are none.
float lattice_bend(uint width, uint height, uint lattice, __global const float4* shown, int column, int row, int dx,
                   int dy) {
    const int columns = (int)((width - 1u) / lattice + 1u), rows = (int)((height - 1u) / lattice + 1u);
    const int2 low = (int2)(column - dx, row - dy), high = (int2)(column + dx, row + dy);
    if (low.x < 0 || low.y < 0 || high.x > columns || high.y > rows) return 0.0f;
    const uint step = lattice;
#define AT(c, r) shown[min((uint)(r) * step, height - 1u) * width + min((uint)(c) * step, width - 1u)].xyz
    return mean_square(AT(low.x, low.y) - 2.0f * AT(column, row) + AT(high.x, high.y));
#undef AT
}

// Squared errors of the interpolation in the cells of the lattice.
__kernel void estimate_cells(PIXEL_ARGUMENTS, __global float* restrict cells, const uint first, const uint end) {
    const uint cell = first + (uint)get_global_id(0);
    if (cell >= end) return;
    const uint cells_across = (width - 1u) / lattice + 1u;
    const int column = (int)(cell % cells_across), row = (int)(cell / cells_across);
    float bend = 0.0f;
    for (int corner = 0; corner < 4; corner++) {
        const int x = column + (corner & 1), y = row + (corner >> 1);
        bend = max_or(bend, lattice_bend(width, height, lattice, shown, x, y, 1, 0));
        bend = max_or(bend, lattice_bend(width, height, lattice, shown, x, y, 0, 1));
    }
    cells[cell] = LATTICE_ERROR * bend;
}

// The largest squared second difference in the four directions around a pixel.
float contrast_at(uint width, uint height, __global const float4* shown, uint x, uint y) {
    const uint pixel = y * width + x;
    const float3 here = 2.0f * shown[pixel].xyz;
    const bool inner_x = x > 0u && x + 1u < width, inner_y = y > 0u && y + 1u < height;
#define BEND(a, b) mean_square(shown[a].xyz - here + shown[b].xyz)
    float contrast = inner_x ? BEND(pixel - 1u, pixel + 1u) : 0.0f;
    if (inner_y) contrast = max_or(contrast, BEND(pixel - width, pixel + width));
    if (inner_x && inner_y) {
        contrast = max_or(contrast, BEND(pixel - width - 1u, pixel + width + 1u));
        contrast = max_or(contrast, BEND(pixel - width + 1u, pixel + width - 1u));
    }
#undef BEND
    return contrast;
}

// n^1.5 of the samples n = 4^(level - 1) of a level that has some.
float edge_samples(uint level) { return (float)(1u << (3u * (level - 1u))); }

// What the pixels around one turned out to be: the mean squared error that one sample of them would have.
float error_around(uint width, uint height, __global const float4* shown, __global const uint* states, uint x, uint y) {
    float sum = 0.0f;
    for (uint row = max(y, 1u) - 1u; row < min(y + 2u, height); row++) {
        for (uint column = max(x, 1u) - 1u; column < min(x + 2u, width); column++) {
            const uint near = row * width + column, level = LEVEL_OF(states[near]);
            if (level > 1u && (row != y || column != x)) sum += shown[near].w * edge_samples(level);
        }
    }
    return sum * 0.125f;
}

// The squared error of a pixel.
float estimate_error(uint width, uint height, uint lattice, __global const float4* shown, __global const uint* states,
                     __global const float* cells, uint x, uint y) {
    const uint pixel = y * width + x;
    const uint level = LEVEL_OF(states[pixel]);
    const float own = shown[pixel].w;
    if (level == 0u) return max_or(own, cells[y / lattice * ((width - 1u) / lattice + 1u) + x / lattice]);
    const float of_contrast = PARTS[level][1] * contrast_at(width, height, shown, x, y);
    const float of_neighbours = PARTS[level][2] * error_around(width, height, shown, states, x, y);
    return max_or(PARTS[level][0] * own, max_or(of_contrast, of_neighbours) * power_of_two_scale(edge_samples(level)));
}

// Adds to a number of 64 bits in two words, low one first: devices without atomic operations on such numbers have it,
// too.
void add_long(volatile __global uint* sum, ulong summand) {
    const uint low = (uint)summand;
    const uint carry = atomic_add(&sum[0], low) > 0xffffffffu - low ? 1u : 0u;
    atomic_add(&sum[1], (uint)(summand >> 32) + carry);
}

// Estimates anew the errors of pixels that have new samples, and of those beside them. `promises`: pixels by level,
// then by class; then SUM_SLOTS parts of the sum of all squared errors. Whole numbers have the same sum in any order.
__kernel void update_estimates(PIXEL_ARGUMENTS, __global const float* restrict cells,
                               volatile __global uint* restrict promises, const uint round, const uint first,
                               const uint end) {
    const uint pixel = first + (uint)get_global_id(0);
    if (pixel >= end) return;
    const uint x = pixel % width, y = pixel / width;
    const bool is_first = round == 1u;
    bool is_near = is_first;
    for (uint row = max(y, 1u) - 1u; row < min(y + 2u, height); row++) {
        for (uint column = max(x, 1u) - 1u; column < min(x + 2u, width); column++)
            is_near = is_near || ROUND_OF(states[row * width + column]) == round;
    }
    if (!is_near) return;

    const float error = estimate_error(width, height, lattice, shown, states, cells, x, y);
    const uint level = LEVEL_OF(states[pixel]);
    const uint old_class = is_first ? NO_CLASS : classes[pixel];
    const ulong old_error = is_first ? 0ul : (ulong)(errors[pixel] * ERROR_UNITS);
    uint new_class = NO_CLASS;
    if (level < LAST_LEVEL && error > 0.0f)
        new_class = level * CLASSES + (as_uint(error * NEW_SAMPLES_RECIPROCALS[level]) >> CLASS_SHIFT);
    const ulong more = (ulong)(error * ERROR_UNITS) - old_error; // also if it is less: sums are modulo 2^64
    if (more != 0ul) add_long(promises + LAST_LEVEL * CLASSES + 2u * (pixel % SUM_SLOTS), more);
    if (new_class != old_class) {
        if (old_class != NO_CLASS) atomic_dec(&promises[old_class]);
        if (new_class != NO_CLASS) atomic_inc(&promises[new_class]);
    }
    errors[pixel] = error;
    classes[pixel] = new_class;
}
