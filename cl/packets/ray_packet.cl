// Sixteen rays that are traced together, one in each lane of a vector: for CPUs, whose compilers do not make vectors of work-items that
// go different ways. Wald, Slusallek, Benthin and Wagner, "Interactive Rendering with Coherent Ray Tracing", Eurographics 2001.
//
// A packet only decides what it is sure of. A ray with a triangle that float32 leaves open, or of extreme numbers, leaves the packet and
// is traced by itself (trace_packets.cl): so the hits are those of one ray at a time, to the bit.

// What one or several rays have in common.
typedef struct {
    float origin_least[3], origin_greatest[3]; // box around the origins
    float steepest[3];                         // largest |direction|
} RayRange;

typedef struct {
    float16 origin[3], direction[3];    // in tracing space, directions as make_ray() scales them
    float16 inv[3], enter[3], leave[3]; // as those of Slabs
    float16 t_near, t_far;
    uint16 skip;
    RayRange range;
    uint near[3];        // for each axis the record of a node's planes where the rays enter boxes
    bool has_one_octant; // whether that is the same for all of them
} RayPacket;

float3 three_of_lane(const float16* v, uint lane) { return (float3)(lane_of16(&v[0], lane), lane_of16(&v[1], lane), lane_of16(&v[2], lane)); }

// The least lanes of eight vectors, in as many steps as one vector alone would take.
float16 least_of_halves(float16 a, float16 b) { return min_or16((float16)(a.lo, b.lo), (float16)(a.hi, b.hi)); }
float8 least_of_lanes(float16 a, float16 b, float16 c, float16 d, float16 e, float16 f, float16 g, float16 h) {
    const float16 ab = least_of_halves(a, b), cd = least_of_halves(c, d);
    const float16 ef = least_of_halves(e, f), gh = least_of_halves(g, h);
    const float16 abcd = min_or16((float16)(ab.s0123, ab.s89ab, cd.s0123, cd.s89ab),
                                  (float16)(ab.s4567, ab.scdef, cd.s4567, cd.scdef));
    const float16 efgh = min_or16((float16)(ef.s0123, ef.s89ab, gh.s0123, gh.s89ab),
                                  (float16)(ef.s4567, ef.scdef, gh.s4567, gh.scdef));
    const float16 pairs = min_or16(
        (float16)(abcd.s01, abcd.s45, abcd.s89, abcd.scd, efgh.s01, efgh.s45, efgh.s89, efgh.scd),
        (float16)(abcd.s23, abcd.s67, abcd.sab, abcd.sef, efgh.s23, efgh.s67, efgh.sab, efgh.sef));
    return min_or8(pairs.even, pairs.odd);
}

// Makes the rest of a packet of origins, directions and limits. They are numbers within MODERATE (trace_packets.cl), in lanes without a
// ray those of another lane, with t_near = infinity and t_far = -infinity. The scene's box: low..high.
void complete_packet(RayPacket* p, float3 low, float3 high) {
    const float8 least = least_of_lanes(p->origin[0], p->origin[1], p->origin[2], -p->origin[0], -p->origin[1], -p->origin[2],
                                        p->direction[0], p->direction[1]);
    const float8 rest = least_of_lanes(p->direction[2], -p->direction[0], -p->direction[1], -p->direction[2],
                                       -fabs(p->direction[0]), -fabs(p->direction[1]), -fabs(p->direction[2]), p->t_near);
    vstore3(least.s012, 0, p->range.origin_least);
    vstore3(-least.s345, 0, p->range.origin_greatest);
    vstore3(-rest.s456, 0, p->range.steepest);
    const float3 direction_least = (float3)(least.s67, rest.s0), direction_greatest = -rest.s123;
    const uint3 is_up = (uint3)(direction_least.x >= 0.0f ? 1u : 0u, direction_least.y >= 0.0f ? 1u : 0u, direction_least.z >= 0.0f ? 1u : 0u);
    p->has_one_octant = (is_up.x == 1u || direction_greatest.x < 0.0f) && (is_up.y == 1u || direction_greatest.y < 0.0f) &&
                        (is_up.z == 1u || direction_greatest.z < 0.0f);
    p->near[0] = is_up.x == 1u ? 0u : 2u;
    p->near[1] = is_up.y == 1u ? 4u : 6u;
    p->near[2] = is_up.z == 1u ? 8u : 10u;

    // As farthest_distance() and make_slabs(); the start has no second part.
    const float lows[3] = {low.x, low.y, low.z}, highs[3] = {high.x, high.y, high.z};
    float16 distance = (float16)(0.0f);
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++)
        distance = max_or16(distance, max_or16(fabs(lows[axis] - p->origin[axis]), fabs(highs[axis] - p->origin[axis])));
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
