// Sixteen rays that are traced together, one in each lane of a vector: for CPUs, whose compilers do not make vectors of
// work-items that go different ways. Wald, Slusallek, Benthin and Wagner, "Interactive Rendering with Coherent Ray
// Tracing", Eurographics 2001.
//
// A packet only decides what it is sure of. A triangle that float32 and double leave open waits until the packet is
// done, and is settled for one ray after the other as for single rays (settle_lane in triangles.cl); a ray of extreme
// numbers, or with too many such triangles, leaves the packet and is traced by itself (trace_packets.cl): so the hits
// are those of one ray at a time, to the bit.

// What the rays of packets have in common.
typedef struct {
    float origin_least[3], origin_greatest[3]; // box around the origins
    float low_most[3];                         // largest |origin_low|
    float steepest[3];                         // largest |direction|
} RayRange;

// The same of packets, with what else is asked of all of their rays.
typedef struct {
    RayRange rays;
    float direction_least[3], direction_greatest[3];
    float t_near_least;
} PacketRange;

typedef struct {
    float16 origin[3], direction[3]; // in tracing space, directions as make_ray() scales them
    float16 origin_low[3];           // as that of Ray
    bool has_low;                    // whether it is not 0 everywhere
    float16 t_near, t_far;
    uint16 skip;
    // Only once boxes are to be tested: add_slabs().
    bool has_slabs;
    float16 inv[3], enter[3], leave[3]; // as those of Slabs
    uint near[3];                       // for each axis the record of a node's planes where the rays enter boxes
    uint mixed_axes;                    // bits: axes that some go up and others down
} RayPacket;

// Packets that are traced together are bits of a word: the lowest one.
uint first_member(uint members) { return lowest_bit(members); }

float3 three_of_lane(const float16* v, uint lane) {
    return (float3)(lane_of16(&v[0], lane), lane_of16(&v[1], lane), lane_of16(&v[2], lane));
}

// The ray of a lane with slabs, where it goes on by itself.
typedef struct {
    Slabs slabs;
    float3 origin, origin_low, direction;
    float t_near;
} LaneRay;

LaneRay ray_of_lane(const RayPacket* p, uint lane) {
    const LaneRay ray = {{three_of_lane(p->inv, lane), three_of_lane(p->enter, lane), three_of_lane(p->leave, lane)},
                         three_of_lane(p->origin, lane),
                         three_of_lane(p->origin_low, lane),
                         three_of_lane(p->direction, lane),
                         lane_of16(&p->t_near, lane)};
    return ray;
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

// The lanes where all of `count` vectors have moderate numbers. Without their sign, bits grow with the number; 0 less
// one is the largest.
int16 are_moderate(const float16* v, uint count) {
    uint16 least = (uint16)(~0u), greatest = (uint16)(0u);
#pragma unroll
    for (uint i = 0; i < count; i++) {
        const uint16 size = as_uint16(v[i]) & 0x7fffffffu, from_one = size - 1u;
        least = from_one < least ? from_one : least;
        greatest = size > greatest ? size : greatest;
    }
    return least >= as_uint(1.0f / MODERATE) - 1u && greatest <= as_uint(MODERATE);
}

// Gives lanes without a ray the numbers of another lane, and no t to look for a hit at. There must be a lane with one.
void leave_out_others(RayPacket* p, int16 used) {
    if (!is_any16(!used)) return;
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

// A packet without rays, to which add_ray() adds some as make_ray() takes them. make_packet() follows.
void begin_packet(RayPacket* p) {
    p->has_low = false;
    p->t_near = (float16)(INFINITY);
    p->t_far = (float16)(-INFINITY);
    p->skip = (uint16)(NO_PRIMITIVE);
#pragma unroll
    for (uint i = 0; i < 3u; i++) p->origin[i] = p->origin_low[i] = p->direction[i] = (float16)(0.0f);
}

void add_ray(RayPacket* p, uint lane, float3 origin, float3 origin_low, float3 direction, float t_near, float t_far,
             uint skip) {
    set_three_of_lane(p->origin, lane, origin);
    set_three_of_lane(p->origin_low, lane, origin_low);
    set_three_of_lane(p->direction, lane, direction);
    set_lane16(&p->t_near, lane, t_near);
    set_lane16(&p->t_far, lane, t_far);
    ((uint*)&p->skip)[lane] = skip;
    p->has_low = p->has_low || any(origin_low != (float3)(0.0f));
}

// Brings directions and limits of t to tracing space as make_ray() and limit_ray() do. Returns the lanes in use: not
// those of extreme numbers, or that are not sound, or that end at t = 0 (AT_START in closely.cl). *unit: by what
// directions were multiplied. `scale`: the scene's where t is in the caller's units, else 1.
int16 make_packet(RayPacket* p, float scale, float16* unit) {
    const float16 size = larger16(fabs(p->direction[0]), larger16(fabs(p->direction[1]), fabs(p->direction[2])));
    const float16 c[8] = {
        p->origin[0],    p->origin[1],    p->origin[2],    p->t_near,
        p->direction[0], p->direction[1], p->direction[2], p->t_far == INFINITY ? (float16)(0.0f) : p->t_far};
    const int16 used = are_moderate(c, 8u) && size > 0.0f && p->t_near <= p->t_far && p->t_far != 0.0f;
    p->has_slabs = false;
    // power_of_two_scale() of the largest component
    *unit = used ? as_float16((254u - (as_uint16(size) >> 23)) << 23) : (float16)(1.0f);
    if (!is_any16(used)) return used;
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        const uint16 bits = as_uint16(p->direction[i] * *unit);
        p->direction[i] = as_float16(bits == 0x80000000u ? (uint16)(0u) : bits); // positive_zero()
    }
    const float16 to_own = scale * (used ? as_float16(as_uint16(size) >> 23 << 23) : (float16)(1.0f)); // scale / unit
    p->t_near *= to_own;
    p->t_far = smaller16(smaller16(p->t_far, (float16)(FLT_MAX)) * to_own, (float16)(FLT_MAX));
    leave_out_others(p, used);
    return used;
}

// The range of the packets of `members`, whose numbers are moderate.
void range_of(const RayPacket* packets, uint members, PacketRange* r) {
    float16 least[3], greatest[3], low[3], direction_least[3], direction_greatest[3];
    const RayPacket* p = &packets[first_member(members)];
    bool has_low = p->has_low;
    float16 t_near = p->t_near;
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        least[axis] = greatest[axis] = p->origin[axis];
        direction_least[axis] = direction_greatest[axis] = p->direction[axis];
        low[axis] = fabs(p->origin_low[axis]);
    }
    for (uint rest = members & (members - 1u); rest != 0u; rest &= rest - 1u) {
        p = &packets[first_member(rest)];
        has_low = has_low || p->has_low;
        t_near = smaller16(t_near, p->t_near);
#pragma unroll
        for (uint axis = 0; axis < 3u; axis++) {
            least[axis] = smaller16(least[axis], p->origin[axis]);
            greatest[axis] = larger16(greatest[axis], p->origin[axis]);
            direction_least[axis] = smaller16(direction_least[axis], p->direction[axis]);
            direction_greatest[axis] = larger16(direction_greatest[axis], p->direction[axis]);
            low[axis] = larger16(low[axis], fabs(p->origin_low[axis]));
        }
    }
    const float8 origins =
        least_of_lanes(least[0], least[1], least[2], -greatest[0], -greatest[1], -greatest[2], t_near, t_near);
    const float8 directions =
        least_of_lanes(direction_least[0], direction_least[1], direction_least[2], -direction_greatest[0],
                       -direction_greatest[1], -direction_greatest[2], t_near, t_near);
    vstore3(origins.s012, 0, r->rays.origin_least);
    vstore3(-origins.s345, 0, r->rays.origin_greatest);
    r->t_near_least = origins.s6;
    vstore3(directions.s012, 0, r->direction_least);
    vstore3(-directions.s345, 0, r->direction_greatest);
    vstore3(fmax(-directions.s012, -directions.s345), 0, r->rays.steepest);
    vstore3((float3)(0.0f), 0, r->rays.low_most);
    if (has_low) {
        const float8 lows = least_of_lanes(-low[0], -low[1], -low[2], t_near, t_near, t_near, t_near, t_near);
        vstore3(-lows.s012, 0, r->rays.low_most);
    }
}

// What boxes are tested with: `r` is the range of the packet, or of it and others. The scene's box: low..high.
void add_slabs(RayPacket* p, const PacketRange* r, float3 low, float3 high, float near_reach) {
    p->has_slabs = true;
    p->mixed_axes = 0u;
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        const bool is_up = r->direction_least[axis] >= 0.0f;
        p->near[axis] = 4u * axis + (is_up ? 0u : 2u);
        if (!is_up && r->direction_greatest[axis] >= 0.0f) p->mixed_axes |= 1u << axis;
    }
    // As padding_distance() and make_slabs(), whose padding is for the origin's second part, too.
    const float lows[3] = {low.x, low.y, low.z}, highs[3] = {high.x, high.y, high.z};
    float16 distance = (float16)(0.0f);
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++)
        distance =
            larger16(distance, larger16(fabs(lows[axis] - p->origin[axis]), fabs(highs[axis] - p->origin[axis])));
    if (near_reach > 0.0f) {
        const float16 size = larger16(fabs(p->origin[0]), larger16(fabs(p->origin[1]), fabs(p->origin[2])));
        distance = size <= near_reach && 2.0f * near_reach < distance ? (float16)(2.0f * near_reach) : distance;
    }
    const float16 thickness = fma((float16)(SLACK), distance, (float16)(LEAST_PADDING));
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        const float16 d = p->direction[axis], largest = (float16)(1.0f / LEAST_SLAB_DIRECTION);
        const float16 inv = fabs(d) >= LEAST_SLAB_DIRECTION ? 1.0f / d : d < 0.0f ? -largest : largest;
        const float16 padding = fma(fabs(p->origin[axis]), (float16)(ORIGIN_ERROR), thickness) * fabs(inv);
        const float16 at_origin = -(p->origin[axis] * inv);
        p->inv[axis] = inv;
        p->enter[axis] = at_origin - padding;
        p->leave[axis] = at_origin + padding;
    }
}

// Coordinates of one axis as seen from the start of the rays: from_origin() of ray.cl.
float16 from_origins(const RayPacket* p, uint axis, float16 x) {
    const float16 from = x - p->origin[axis];
    return p->has_low ? from - p->origin_low[axis] : from;
}
