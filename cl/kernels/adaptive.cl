// Pictures of bounded error: what is known of the pixels, and which of them are traced next (src/adaptive/ says why,
// and has the twin of everything here; what it has in capitals comes from there). LATTICE in place of a class: the
// pixels of the lattice are asked for.
//
// Pixels are listed tile by tile, so that rays that are traced together run close together.

#define LEVEL_BITS 8u
#define LEVEL_OF(state) ((state) & ((1u << LEVEL_BITS) - 1u))
#define ROUND_OF(state) ((state) >> LEVEL_BITS)
#define NO_CLASS 0xffffffffu

// What is known of a picture's pixels, each an element of these arrays:
//   film     the first samples and what lies between them, linear
//   sums     of the samples
//   shown    xyz: values of a screen; w: squared error, of a mean by what parts of it differ, of an interpolated pixel
//            by what its neighbours turned out to be
//   states   level, and the round in which it had its last samples << LEVEL_BITS
//   errors   squared
//   classes  level * CLASSES + class, or NO_CLASS
#define PIXEL_ARGUMENTS \
    const uint width, const uint height, const uint lattice, const uint patch_side, const uint area_width, \
        const uint area_height, const uint blocks_of_area, const uint block_stride, __global float4* restrict film, \
        __global float4* restrict sums, __global float4* restrict shown, __global uint* restrict states, \
        __global float* restrict errors, __global uint* restrict classes

// The picture's pixels, and how they are cut into areas, patches and blocks (src/blocks.rs).
typedef struct {
    uint width, height, lattice, patch_side, area_width, area_height, blocks_of_area, block_stride;
} Grid;
#define GRID {width, height, lattice, patch_side, area_width, area_height, blocks_of_area, block_stride}

// The pixels from `low` to before `high`.
typedef struct {
    uint2 low, high;
} Place;

// The area of a pixel.
Place area_at(const Grid* grid, uint x, uint y) {
    const uint2 low = (uint2)(x / grid->area_width * grid->area_width, y / grid->area_height * grid->area_height);
    const Place place = {
        low, (uint2)(min(low.x + grid->area_width, grid->width), min(low.y + grid->area_height, grid->height))};
    return place;
}

uint areas_across(const Grid* grid) { return (grid->width + grid->area_width - 1u) / grid->area_width; }

uint number_of_area(const Grid* grid, uint x, uint y) {
    return y / grid->area_height * areas_across(grid) + x / grid->area_width;
}

uint block_at(const Grid* grid, uint x, uint y) {
    const uint column = x % grid->area_width / grid->patch_side,
               row = y % grid->area_height / grid->patch_side;
    return number_of_area(grid, x, y) * grid->blocks_of_area +
           (column + row * grid->block_stride) % grid->blocks_of_area;
}

// The pixels of a patch that are not farther than 1 from one of them.
Place near_in_patch(const Grid* grid, uint x, uint y) {
    const uint side = grid->patch_side;
    const uint2 first = (uint2)(x / side * side, y / side * side);
    const Place place = {
        (uint2)(max(x, first.x + 1u) - 1u, max(y, first.y + 1u) - 1u),
        (uint2)(min(min(x + 2u, first.x + side), grid->width),
                min(min(y + 2u, first.y + side), grid->height))};
    return place;
}

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

bool is_on_lattice(const Grid* grid, const Place* area, uint x, uint y) {
    const uint column = x - area->low.x, row = y - area->low.y;
    return (column % grid->lattice == 0u || x + 1u == area->high.x) &&
           (row % grid->lattice == 0u || y + 1u == area->high.y);
}

// How many new samples a pixel is to have: of a class from choice.x on, or of the lattice. choice.y: only interpolated
// ones.
uint wanted_samples(const Grid* grid, __global const uint* classes, uint2 choice, uint x, uint y) {
    if (choice.x == LATTICE) {
        const Place area = area_at(grid, x, y);
        return is_on_lattice(grid, &area, x, y) ? 1u : 0u;
    }
    const uint level_class = classes[y * grid->width + x];
    if (level_class == NO_CLASS || level_class % CLASSES < choice.x) return 0u;
    const uint level = level_class / CLASSES;
    if (choice.y != 0u && level > 0u) return 0u;
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
__kernel void count_wanted(PIXEL_ARGUMENTS, __global uint2* restrict tiles, __global const uint2* restrict choices,
                           const uint first, const uint end) {
    const uint tile = first + (uint)get_global_id(0);
    if (tile >= end) return;
    const Grid grid = GRID;
    uint2 low;
    const uint2 high = pixels_of_tile(width, height, tile, &low);
    const uint2 choice = choices[block_at(&grid, low.x, low.y)];
    uint2 count = (uint2)(0u);
    for (uint y = low.y; y < high.y; y++) {
        for (uint x = low.x; x < high.x; x++) {
            const uint wanted = wanted_samples(&grid, classes, choice, x, y);
            count += (uint2)(wanted != 0u ? 1u : 0u, wanted);
        }
    }
    tiles[tile] = count;
}

// Lists these pixels (x) and where the samples of each begin (y). `tiles`: how many there are in the tiles before;
// `before`: in those before the list's first tile.
__kernel void list_wanted(PIXEL_ARGUMENTS, __global const uint2* restrict tiles, __global const uint2* restrict choices,
                          __global uint2* restrict list, const uint pixels_before, const uint samples_before,
                          const uint first, const uint end) {
    const uint tile = first + (uint)get_global_id(0);
    if (tile >= end) return;
    const Grid grid = GRID;
    uint2 low;
    const uint2 high = pixels_of_tile(width, height, tile, &low);
    const uint2 choice = choices[block_at(&grid, low.x, low.y)];
    uint2 next = tiles[tile] - (uint2)(pixels_before, samples_before);
    for (uint y = low.y; y < high.y; y++) {
        for (uint x = low.x; x < high.x; x++) {
            const uint wanted = wanted_samples(&grid, classes, choice, x, y);
            if (wanted == 0u) continue;
            list[next.x] = (uint2)(y * width + x, next.y);
            next += (uint2)(1u, wanted);
        }
    }
}

// The positions of the new samples of listed pixels, in the picture, in which the first pixel is (left, top).
__kernel void place_samples(PIXEL_ARGUMENTS, __global const uint2* restrict list,
                            __global const CameraSample* restrict sequence, __global CameraSample* restrict samples,
                            const uint left, const uint top, const uint first, const uint end) {
    const uint number = first + (uint)get_global_id(0);
    if (number >= end) return;
    const uint pixel = list[number].x;
    const uint level = LEVEL_OF(states[pixel]);
    const float x = (float)(left + pixel % width), y = (float)(top + pixel / width);
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
    if (round == 1u) film[pixel] = (float4)(mean, 0.0f);
    shown[pixel] = (float4)(now, variance);
    states[pixel] = (level + 1u) | round << LEVEL_BITS;
}

// Where an interpolated pixel was wrong, those beside it in its patch may be.
__kernel void tell_neighbours(PIXEL_ARGUMENTS, __global const uint2* restrict list,
                              __global const float* restrict changes, const uint first, const uint end) {
    const uint number = first + (uint)get_global_id(0);
    if (number >= end) return;
    const uint pixel = list[number].x;
    if (LEVEL_OF(states[pixel]) != 1u) return;
    const Grid grid = GRID;
    const Place around = near_in_patch(&grid, pixel % width, pixel / width);
    // No number is below zero: as integers they have the same order.
    const uint told = as_uint(SURPRISE * changes[number]);
    for (uint row = around.low.y; row < around.high.y; row++) {
        for (uint column = around.low.x; column < around.high.x; column++) {
            const uint near = row * width + column;
            if (LEVEL_OF(states[near]) == 0u) atomic_max((volatile __global uint*)&shown[near] + 3, told);
        }
    }
}

// The points of the lattice around `i` between the first pixel of an area and its end, and how far it is from the
// first to the second.
float between(uint i, uint lattice, uint first, uint end, uint2* points) {
    const uint low = (i - first) / lattice * lattice + first;
    const uint high = min(low + lattice, end - 1u);
    *points = (uint2)(low, high);
    return high > low ? (float)(i - low) / (float)(high - low) : 0.0f;
}

// Gives the pixels without samples what lies between those of the lattice.
__kernel void interpolate(PIXEL_ARGUMENTS, __global const float* restrict curve, const uint first, const uint end) {
    const uint pixel = first + (uint)get_global_id(0);
    if (pixel >= end || LEVEL_OF(states[pixel]) != 0u) return;
    const Grid grid = GRID;
    const uint x = pixel % width, y = pixel / width;
    const Place area = area_at(&grid, x, y);
    uint2 columns, rows;
    const float across = between(x, lattice, area.low.x, area.high.x, &columns),
                down = between(y, lattice, area.low.y, area.high.y, &rows);
    // The corners have samples: nobody writes them.
    const float3 a = film[rows.x * width + columns.x].xyz, b = film[rows.x * width + columns.y].xyz;
    const float3 c = film[rows.y * width + columns.x].xyz, d = film[rows.y * width + columns.y].xyz;
    const float3 upper = fma3(b - a, across, a), lower = fma3(d - c, across, c);
    const float3 value = fma3(lower - upper, down, upper);
    film[pixel] = (float4)(value, 0.0f);
    shown[pixel].xyz = display_steps(curve, value);
}

// How many cells of the lattice an area has across and down.
uint2 cells_of(const Grid* grid, const Place* area) {
    const uint2 size = area->high - area->low;
    return (uint2)((size.x - 1u) / grid->lattice + 1u, (size.y - 1u) / grid->lattice + 1u);
}

// Room for the cells of an area: those of the largest.
uint room_for_cells(const Grid* grid) {
    return ((grid->area_width - 1u) / grid->lattice + 1u) * ((grid->area_height - 1u) / grid->lattice + 1u);
}

// The squared second difference of the lattice at a point of an area and those before and after it; 0 where there are
// none.
float lattice_bend(const Grid* grid, const Place* area, __global const float4* shown, int column, int row, int dx,
                   int dy) {
    const uint2 cells = cells_of(grid, area);
    const int2 low = (int2)(column - dx, row - dy), high = (int2)(column + dx, row + dy);
    if (low.x < 0 || low.y < 0 || high.x > (int)cells.x || high.y > (int)cells.y) return 0.0f;
    const uint step = grid->lattice;
#define AT(c, r) \
    shown[min(area->low.y + (uint)(r) * step, area->high.y - 1u) * grid->width + \
          min(area->low.x + (uint)(c) * step, area->high.x - 1u)] \
        .xyz
    return mean_square(AT(low.x, low.y) - 2.0f * AT(column, row) + AT(high.x, high.y));
#undef AT
}

// Squared errors of the interpolation in the cells of the lattice.
__kernel void estimate_cells(PIXEL_ARGUMENTS, __global float* restrict cells, const uint first, const uint end) {
    const uint cell = first + (uint)get_global_id(0);
    if (cell >= end) return;
    const Grid grid = GRID;
    const uint number = cell / room_for_cells(&grid), across = areas_across(&grid);
    const Place area = area_at(&grid, number % across * area_width, number / across * area_height);
    const uint cells_across = cells_of(&grid, &area).x, in_area = cell % room_for_cells(&grid);
    const int column = (int)(in_area % cells_across), row = (int)(in_area / cells_across);
    if (row >= (int)cells_of(&grid, &area).y) return; // of a smaller area
    float bend = 0.0f;
    for (int corner = 0; corner < 4; corner++) {
        const int x = column + (corner & 1), y = row + (corner >> 1);
        bend = max_or(bend, lattice_bend(&grid, &area, shown, x, y, 1, 0));
        bend = max_or(bend, lattice_bend(&grid, &area, shown, x, y, 0, 1));
    }
    cells[cell] = LATTICE_ERROR * bend;
}

// What is shown beside the pixel x, y: by its own patch as it is now, by others with their first samples.
float3 shown_beside(const Grid* grid, __global const float4* film, __global const float4* shown,
                    __global const float* curve, uint x, uint y, uint near_x, uint near_y) {
    const uint near = near_y * grid->width + near_x;
    const uint side = grid->patch_side;
    const bool is_in_patch = near_x / side == x / side && near_y / side == y / side;
    return is_in_patch ? shown[near].xyz : display_steps(curve, film[near].xyz);
}

// The largest squared second difference in the four directions around a pixel.
float contrast_at(const Grid* grid, __global const float4* film, __global const float4* shown,
                  __global const float* curve, uint x, uint y) {
    const float3 here = 2.0f * shown[y * grid->width + x].xyz;
    const Place area = area_at(grid, x, y);
    const bool inner_x = x > area.low.x && x + 1u < area.high.x, inner_y = y > area.low.y && y + 1u < area.high.y;
#define BESIDE(near_x, near_y) shown_beside(grid, film, shown, curve, x, y, near_x, near_y)
#define BEND(ax, ay, bx, by) mean_square(BESIDE(ax, ay) - here + BESIDE(bx, by))
    float contrast = inner_x ? BEND(x - 1u, y, x + 1u, y) : 0.0f;
    if (inner_y) contrast = max_or(contrast, BEND(x, y - 1u, x, y + 1u));
    if (inner_x && inner_y) {
        contrast = max_or(contrast, BEND(x - 1u, y - 1u, x + 1u, y + 1u));
        contrast = max_or(contrast, BEND(x + 1u, y - 1u, x - 1u, y + 1u));
    }
#undef BEND
#undef BESIDE
    return contrast;
}

// n^1.5 of the samples n = 4^(level - 1) of a level that has some.
float edge_samples(uint level) { return (float)(1u << (3u * (level - 1u))); }

// What the pixels of a patch around one turned out to be: the mean squared error that one sample of them would have.
float error_around(const Grid* grid, __global const float4* shown, __global const uint* states, uint x, uint y) {
    const Place around = near_in_patch(grid, x, y);
    float sum = 0.0f;
    for (uint row = around.low.y; row < around.high.y; row++) {
        for (uint column = around.low.x; column < around.high.x; column++) {
            const uint near = row * grid->width + column, level = LEVEL_OF(states[near]);
            if (level > 1u && (row != y || column != x)) sum += shown[near].w * edge_samples(level);
        }
    }
    return sum * 0.125f;
}

// The squared error of a pixel.
float estimate_error(const Grid* grid, __global const float4* film, __global const float4* shown,
                     __global const uint* states, __global const float* cells, __global const float* curve, uint x,
                     uint y) {
    const uint pixel = y * grid->width + x;
    const uint level = LEVEL_OF(states[pixel]);
    const float own = shown[pixel].w;
    if (level == 0u) {
        const Place area = area_at(grid, x, y);
        const uint first_cell = number_of_area(grid, x, y) * room_for_cells(grid);
        const uint2 cell = (uint2)((x - area.low.x) / grid->lattice, (y - area.low.y) / grid->lattice);
        return max_or(own, cells[first_cell + cell.y * cells_of(grid, &area).x + cell.x]);
    }
    const float of_contrast = PARTS[level][1] * contrast_at(grid, film, shown, curve, x, y);
    const float of_neighbours = PARTS[level][2] * error_around(grid, shown, states, x, y);
    return max_or(PARTS[level][0] * own, max_or(of_contrast, of_neighbours) * power_of_two_scale(edge_samples(level)));
}

// Adds to a number of 64 bits in two words, low one first: devices without atomic operations on such numbers have it,
// too.
void add_long(volatile __global uint* sum, ulong summand) {
    const uint low = (uint)summand;
    const uint carry = atomic_add(&sum[0], low) > 0xffffffffu - low ? 1u : 0u;
    atomic_add(&sum[1], (uint)(summand >> 32) + carry);
}

// Estimates anew the errors of pixels that have new samples, and of those beside them in their patches. `promises`, of
// each block: pixels by level, then by class; then SUM_SLOTS parts of the sum of all squared errors. Whole numbers have
// the same sum in any order.
__kernel void update_estimates(PIXEL_ARGUMENTS, __global const float* restrict cells,
                               __global const float* restrict curve, volatile __global uint* restrict promises,
                               const uint round, const uint first, const uint end) {
    const uint pixel = first + (uint)get_global_id(0);
    if (pixel >= end) return;
    const Grid grid = GRID;
    const uint x = pixel % width, y = pixel / width;
    const bool is_first = round == 1u;
    const Place around = near_in_patch(&grid, x, y);
    bool is_near = is_first;
    for (uint row = around.low.y; row < around.high.y; row++) {
        for (uint column = around.low.x; column < around.high.x; column++)
            is_near = is_near || ROUND_OF(states[row * width + column]) == round;
    }
    if (!is_near) return;

    const float error = estimate_error(&grid, film, shown, states, cells, curve, x, y);
    const uint level = LEVEL_OF(states[pixel]);
    const uint old_class = is_first ? NO_CLASS : classes[pixel];
    const ulong old_error = is_first ? 0ul : (ulong)(errors[pixel] * ERROR_UNITS);
    uint new_class = NO_CLASS;
    if (level < LAST_LEVEL && error > 0.0f)
        new_class = level * CLASSES + (as_uint(error * NEW_SAMPLES_RECIPROCALS[level]) >> CLASS_SHIFT);
    const ulong more = (ulong)(error * ERROR_UNITS) - old_error; // also if it is less: sums are modulo 2^64
    volatile __global uint* of_block = promises + block_at(&grid, x, y) * (LAST_LEVEL * CLASSES + 2u * SUM_SLOTS);
    if (more != 0ul) add_long(of_block + LAST_LEVEL * CLASSES + 2u * (pixel % SUM_SLOTS), more);
    if (new_class != old_class) {
        if (old_class != NO_CLASS) atomic_dec(&of_block[old_class]);
        if (new_class != NO_CLASS) atomic_inc(&of_block[new_class]);
    }
    errors[pixel] = error;
    classes[pixel] = new_class;
}

// The picture: means of the samples, or what was interpolated. It is written to `shown`, of which nothing is needed any
// more, three numbers for each pixel: so less is fetched.
__kernel void show_means(PIXEL_ARGUMENTS, const uint first, const uint end) {
    const uint pixel = first + (uint)get_global_id(0);
    if (pixel >= end) return;
    const uint level = LEVEL_OF(states[pixel]);
    const float3 mean = sums[pixel].xyz * power_of_two_scale((float)max(LEVEL_SAMPLES[level], 1u));
    vstore3(level > 0u ? mean : film[pixel].xyz, pixel, (__global float*)shown);
}
