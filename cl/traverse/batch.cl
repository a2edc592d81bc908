// Rays of a batch: which comes when, and one of them from the caller's numbers to a hit in the caller's units.

// A batch may be an image, row by row (src/device/rows.rs): of `row` rays each, or 0, the first `in_bands` of them in
// whole bands of TILE_SIDE rows.
#define ROWS_ARGUMENT const uint row, const uint in_bands,

// Or its rays are sorted, and have no rows: those of `sorted`, one after the other, which is NULL if they are not
// (src/ray_order.rs).
#define ORDER_ARGUMENT ROWS_ARGUMENT __global const uint* restrict sorted,

// A tile of rays: of an image four squares of 4 x 4, else four times sixteen rays in a row.
#define TILE_RAYS 64u
typedef struct {
    uint first;       // place
    uint stride;      // from four rays to the next four of a square
    uint right, down; // from a square to those beside it
} RayTile;

// The tile number place / TILE_RAYS.
RayTile tile_at(uint place, uint row, uint in_bands) {
    const uint first = place / TILE_RAYS * TILE_RAYS;
    if (first >= in_bands) {
        const RayTile tile = {first, 4u, 16u, 32u};
        return tile;
    }
    const uint number = place / TILE_RAYS, columns = row / TILE_SIDE;
    const RayTile tile = {number / columns * TILE_SIDE * row + number % columns * TILE_SIDE, row, 4u, 4u * row};
    return tile;
}
uint square_in_tile(const RayTile* tile, uint k) {
    return tile->first + (k & 1u) * tile->right + (k >> 1) * tile->down;
}
uint place_in_square(const RayTile* tile, uint square, uint lane) {
    return square + lane / 4u * tile->stride + lane % 4u;
}

uint ray_of_rows(uint item, uint row, uint in_bands) {
    if (item >= in_bands) return item;
    const RayTile tile = tile_at(item, row, in_bands);
    return place_in_square(&tile, square_in_tile(&tile, item % TILE_RAYS / 16u), item % 16u);
}
uint ray_at(uint item, uint row, uint in_bands, __global const uint* sorted) {
    return sorted != NULL ? sorted[item] : ray_of_rows(item, row, in_bands);
}

// Changes the units of t from those of `direction`, of which the ray has been made, in tracing space to those in the
// caller's space. The two factors are powers of two of like size: their product may be none that a float can hold while
// the t that it makes is a float.
void use_callers_units(Ray* ray, float3 direction, float scale) {
    const int exponent = exponent_field(largest_component(abs3(ray->direction))) -
                         exponent_field(largest_component(abs3(direction))) + 127 - exponent_field(scale);
    ray->t_lift = as_float((uint)(exponent / 2 + 127) << 23);
    ray->t_scale = as_float((uint)(exponent - exponent / 2 + 127) << 23);
}

Ray batch_ray(__global const TraceRay* rays, uint index, float scale) {
    const TraceRay query = rays[index];
    const float3 direction = query.direction_t_max.xyz;
    const float t_min = query.origin_t_min.w, t_max = query.direction_t_max.w;
    Ray ray;
    const bool sound = aim_ray(&ray, query.origin_t_min.xyz, direction, NO_PRIMITIVE);
    if (sound) use_callers_units(&ray, direction, scale);
    limit_ray(&ray, sound && t_min <= t_max, t_min, t_max);
    return ray;
}

// A finished hit: what is farther than every float is not hit.
Hit batch_hit(Hit hit) { return hit.primitive != NO_PRIMITIVE && is_finite(hit.t) ? hit : no_hit(); }

// What answers a query for any hit: that there is one, of which t, u and v are not computed.
Hit batch_any_hit(Hit hit) {
    const Hit answer = {0.0f, 0.0f, 0.0f, hit.primitive};
    return hit.primitive == NO_PRIMITIVE ? no_hit() : answer;
}

// Traces a ray of a batch, and writes its hit if that takes nothing rare. Whether it does; else settle_batch() goes on
// with `hit`.
INLINE bool trace_batch(GEOMETRY_PARAMETERS, __global const TraceRay* rays, __global Hit* hits, uint index,
                        const bool any_hit, Hit* hit) {
    const Ray ray = batch_ray(rays, index, geometry->scale);
    const bool found = TRAVERSE(GEOMETRY, &ray, any_hit, hit);
    if (!IS_SETTLED(GEOMETRY)) return false;
    Hit finished = *hit;
    if (any_hit) {
        hits[index] = batch_any_hit(finished);
        return true;
    }
    if (found && !FINISH_MOSTLY(GEOMETRY, &ray, &finished)) return false;
    hits[index] = batch_hit(finished);
    return true;
}

// Does what trace_batch() has left: settles what is postponed, and writes the hit.
INLINE void settle_batch(GEOMETRY_PARAMETERS, __global const TraceRay* rays, __global Hit* hits, uint index,
                         const bool any_hit, Hit hit) {
    const Ray ray = batch_ray(rays, index, geometry->scale);
    SETTLE(GEOMETRY, &ray, any_hit, &hit);
    if (any_hit) {
        hits[index] = batch_any_hit(hit);
    } else {
        FINISH(GEOMETRY, &ray, &hit);
        hits[index] = batch_hit(hit);
    }
}

// The same as a call from a kernel, with what a traversal writes of a hit. Whether the ray is deferred. Where the
// kernel has these registers, too, an H200 traces camera rays at 0.92 times the speed.
RARE bool complete_batch(GEOMETRY_ARGUMENTS STATE_ARGUMENTS, __global const TraceRay* rays, __global Hit* hits,
                         uint index, const bool any_hit, float t, float u, uint primitive) {
    TAKE_STATE
    const Geometry geometry = MAKE_GEOMETRY;
    const Hit hit = {t, u, 0.0f, primitive};
    settle_batch(GEOMETRY_AT(&geometry), rays, hits, index, any_hit, hit);
    return IS_DEFERRED;
}
