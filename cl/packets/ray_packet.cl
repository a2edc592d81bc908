// Sixteen rays that are traced together, one in each lane of a vector: for CPUs, whose compilers do not make vectors of work-items that
// go different ways. Wald, Slusallek, Benthin and Wagner, "Interactive Rendering with Coherent Ray Tracing", Eurographics 2001.
//
// A packet only decides what it is sure of. A ray with a triangle that float32 leaves open, or of extreme numbers, leaves the packet
// and is traced by itself (trace_packets.cl): so the hits are those of one ray at a time, to the bit.

// What one or several rays have in common.
typedef struct {
    float origin_least[3], origin_greatest[3]; // box around the origins
    float low_most[3];                         // largest |origin_low|
    float steepest[3];                         // largest |direction|
} RayRange;

typedef struct {
    float16 origin[3], direction[3];    // in tracing space, directions as make_ray() scales them
    float16 origin_low[3];              // as that of Ray
    bool has_low;                       // whether it is not 0 everywhere
    float16 inv[3], enter[3], leave[3]; // as those of Slabs
    float16 t_near, t_far;
    uint16 skip;
    RayRange range;
    uint near[3];        // for each axis the record of a node's planes where the rays enter boxes
    bool has_one_octant; // whether that is the same for all of them
} RayPacket;

float3 three_of_lane(const float16* v, uint lane) {
    return (float3)(lane_of16(&v[0], lane), lane_of16(&v[1], lane), lane_of16(&v[2], lane));
}

void set_three_of_lane(float16* v, uint lane, float3 x) {
    set_lane16(&v[0], lane, x.x);
    set_lane16(&v[1], lane, x.y);
    set_lane16(&v[2], lane, x.z);
}

// The least lanes of eight vectors, in as many steps as one vector alone would take.
float16 least_of_halves(float16 a, float16 b) { return smaller16((float16)(a.lo, b.lo), (float16)(a.hi, b.hi)); }
float8 least_of_lanes(float16 a, float16 b, float16 c, float16 d, float16 e, float16 f, float16 g, float16 h) {
    const float16 ab = least_of_halves(a, b), cd = least_of_halves(c, d);
    const float16 ef = least_of_halves(e, f), gh = least_of_halves(g, h);
    const float16 abcd = smaller16((float16)(ab.s0123, ab.s89ab, cd.s0123, cd.s89ab),
                                   (float16)(ab.s4567, ab.scdef, cd.s4567, cd.scdef));
    const float16 efgh = smaller16((float16)(ef.s0123, ef.s89ab, gh.s0123, gh.s89ab),
                                   (float16)(ef.s4567, ef.scdef, gh.s4567, gh.scdef));
    const float16 pairs = smaller16(
        (float16)(abcd.s01, abcd.s45, abcd.s89, abcd.scd, efgh.s01, efgh.s45, efgh.s89, efgh.scd),
        (float16)(abcd.s23, abcd.s67, abcd.sab, abcd.sef, efgh.s23, efgh.s67, efgh.sab, efgh.sef));
    return smaller8(pairs.even, pairs.odd);
}

// Numbers from its reciprocal up to this, and 0, lose no bits here, and nothing that is made of them overflows.
#define MODERATE 0x1p40f

int16 is_moderate(float16 x) {
    const float16 size = fabs(x);
    return (size >= 1.0f / MODERATE && size <= MODERATE) || x == 0.0f;
}

// Gives lanes without a ray the numbers of another lane, and no t to look for a hit at. There must be a lane with one.
void leave_out_others(RayPacket* p, int16 used) {
    const uint first = first_lane16(lanes_where16(used));
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        p->origin[i] = used ? p->origin[i] : (float16)(lane_of16(&p->origin[i], first));
        p->origin_low[i] = used ? p->origin_low[i] : (float16)(0.0f);
        p->direction[i] = used ? p->direction[i] : (float16)(lane_of16(&p->direction[i], first));
    }
    p->t_near = used ? p->t_near : (float16)(INFINITY);
    p->t_far = used ? p->t_far : (float16)(-INFINITY);
}

// Makes the rest of a packet of rays. Their origins are moderate, and so are their directions. The scene's box: low..high.
void complete_packet(RayPacket* p, float3 low, float3 high) {
    const float8 least = least_of_lanes(p->origin[0], p->origin[1], p->origin[2], -p->origin[0], -p->origin[1], -p->origin[2],
                                        p->direction[0], p->direction[1]);
    const float8 rest = least_of_lanes(p->direction[2], -p->direction[0], -p->direction[1], -p->direction[2],
                                       -fabs(p->direction[0]), -fabs(p->direction[1]), -fabs(p->direction[2]), p->t_near);
    vstore3(least.s012, 0, p->range.origin_least);
    vstore3(-least.s345, 0, p->range.origin_greatest);
    vstore3(-rest.s456, 0, p->range.steepest);
    vstore3((float3)(0.0f), 0, p->range.low_most);
    if (p->has_low) {
        const float8 low_least = least_of_lanes(-fabs(p->origin_low[0]), -fabs(p->origin_low[1]), -fabs(p->origin_low[2]),
                                                p->t_near, p->t_near, p->t_near, p->t_near, p->t_near);
        vstore3(-low_least.s012, 0, p->range.low_most);
    }
    const float3 direction_least = (float3)(least.s67, rest.s0), direction_greatest = -rest.s123;
    const uint3 is_up = (uint3)(direction_least.x >= 0.0f ? 1u : 0u, direction_least.y >= 0.0f ? 1u : 0u,
                                direction_least.z >= 0.0f ? 1u : 0u);
    p->has_one_octant = (is_up.x == 1u || direction_greatest.x < 0.0f) && (is_up.y == 1u || direction_greatest.y < 0.0f) &&
                        (is_up.z == 1u || direction_greatest.z < 0.0f);
    p->near[0] = is_up.x == 1u ? 0u : 2u;
    p->near[1] = is_up.y == 1u ? 4u : 6u;
    p->near[2] = is_up.z == 1u ? 8u : 10u;

    // As farthest_distance() and make_slabs(), whose pad is for the origin's second part, too.
    const float lows[3] = {low.x, low.y, low.z}, highs[3] = {high.x, high.y, high.z};
    float16 distance = (float16)(0.0f);
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++)
        distance = larger16(distance, larger16(fabs(lows[axis] - p->origin[axis]), fabs(highs[axis] - p->origin[axis])));
    const float16 thickness = fma((float16)(SLACK), distance, (float16)(LEAST_PAD));
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        const float16 d = p->direction[axis], largest = (float16)(1.0f / LEAST_SLAB_DIRECTION);
        const float16 inv = fabs(d) >= LEAST_SLAB_DIRECTION ? 1.0f / d : d < 0.0f ? -largest : largest;
        const float16 pad = fma(fabs(p->origin[axis]), (float16)(ORIGIN_ERROR), thickness) * fabs(inv);
        const float16 at_origin = -(p->origin[axis] * inv);
        p->inv[axis] = inv;
        p->enter[axis] = at_origin - pad;
        p->leave[axis] = at_origin + pad;
    }
}

// Coordinates of one axis as seen from the start of the rays: from_origin() of ray.cl.
float16 from_origins(const RayPacket* p, uint axis, float16 x) {
    const float16 from = x - p->origin[axis];
    return p->has_low ? from - p->origin_low[axis] : from;
}

// A packet of `rays`, those of `lanes`. Returns the lanes in use: not those of extreme numbers, or that are not sound.
int16 pack_rays(const Ray* rays, ulong lanes, float3 low, float3 high, RayPacket* p) {
    p->has_low = false;
    p->t_near = (float16)(INFINITY);
    p->t_far = (float16)(-INFINITY);
#pragma unroll
    for (uint i = 0; i < 3u; i++) p->origin[i] = p->origin_low[i] = p->direction[i] = (float16)(0.0f);
    for (; lanes != 0ul; lanes = other_lanes8(lanes)) {
        const uint lane = first_lane16(lanes);
        const Ray* ray = &rays[lane];
        set_three_of_lane(p->origin, lane, ray->origin);
        set_three_of_lane(p->origin_low, lane, ray->origin_low);
        set_three_of_lane(p->direction, lane, ray->direction);
        set_lane16(&p->t_near, lane, ray->t_near);
        set_lane16(&p->t_far, lane, ray->t_far);
        ((uint*)&p->skip)[lane] = ray->skip;
        p->has_low = p->has_low || any(ray->origin_low != (float3)(0.0f));
    }
    int16 used = p->t_near <= p->t_far && is_moderate(p->t_near);
#pragma unroll
    for (uint i = 0; i < 3u; i++) used = used && is_moderate(p->origin[i]) && is_moderate(p->direction[i]);
    if (!is_any16(used)) return used;
    leave_out_others(p, used);
    complete_packet(p, low, high);
    return used;
}
