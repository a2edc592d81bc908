// The space that the rays of a packet lie in, where they go much the same way: what a node's eight boxes, or the eight
// triangles of a leaf, are tested against before each of them is tested against sixteen rays. Reshetov, Soupikov and
// Hurley, "Multi-Level Ray Tracing Algorithm", SIGGRAPH 2005.
//
// With z the axis along which all rays go one way, a ray has a coordinate u(z) that is linear. The least u of several
// rays is a concave function of z: between where the first one starts and where the scene ends, it is nowhere below the
// line that connects its values at these two. So there are four such lines, below and above u and v.
//
// Errors, in units of EPSILON reach, where no coordinate of the scene or of a start is larger than reach: slopes are
// below 4 (|direction| below 2 and no less than 1/2 along z), z - start no more than 2 reach, so that u of a ray, of a
// quotient with an error of 6, a difference and an fma, is off by 73; the slope of a line, off by 7 of itself, makes 56
// of its length, its start 18, and what a box or a vertex makes of the line 20: less than 170. FRUSTUM_SLACK is 320
// EPSILON.
//
// A rounded test (PACKET_TEST) may meet a triangle up to HIT_ERROR EPSILON D beside it on each axis, and D is no more
// than 2 reach: 64. Where the ray is at the z of that point of the triangle, its u is 4 times as much farther away, by
// the slope; before the start the line's slope takes the place of the ray's, 4.1. So 64 + 4.1 * 64 more, less than 500
// in all, and FRUSTUM_SLACK is 640 EPSILON.
#ifdef PACKET_TEST
#define FRUSTUM_SLACK (16.0f * SLACK)
#else
#define FRUSTUM_SLACK (8.0f * SLACK)
#endif
#define LEAST_FRUSTUM_LENGTH 0x1p-10f // of reach, so that the lines' slopes are below 4.1
// Of the scene's size along both u and v, where a frustum ends. Rays that are farther apart have no frustum: without it
// shuffled camera rays through bunny and gears run at 2.8 and 2.5 times the speed.
#define BROADEST_FRUSTUM 0.25f

typedef struct {
    uint u, v, z;     // axes
    float a[4], b[4]; // below u, above u, below v, above v:  a + b z
    bool is_upwards;  // along z
    // Coordinates as ALONG() has them: where the first and the last ray start, and by how much they may be off.
    float first_start, last_start, padding;
} Frustum;

// Coordinates z of the axis, so that they grow along the rays.
#define ALONG(f, z) ((f)->is_upwards ? (z) : -(z))

// Lines below and above the rays of a packet, from `start` to `end` along z.
void set_lines(const RayPacket* p, float start, float end, Frustum* f) {
    const float16 inv_z = 1.0f / p->direction[f->z];
    const float16 slope_u = p->direction[f->u] * inv_z, slope_v = p->direction[f->v] * inv_z;
    const float16 to_start = start - p->origin[f->z], to_end = end - p->origin[f->z];
    const float16 u0 = fma(to_start, slope_u, p->origin[f->u]), u1 = fma(to_end, slope_u, p->origin[f->u]);
    const float16 v0 = fma(to_start, slope_v, p->origin[f->v]), v1 = fma(to_end, slope_v, p->origin[f->v]);
    const float8 least = least_of_lanes(u0, -u0, v0, -v0, u1, -u1, v1, -v1);
    const float4 at_start = (float4)(least.s0, -least.s1, least.s2, -least.s3);
    const float4 at_end = (float4)(least.s4, -least.s5, least.s6, -least.s7);
    const float4 b = (at_end - at_start) / (end - start);
    vstore4(at_start - b * start + (float4)(-f->padding, f->padding, -f->padding, f->padding), 0, f->a);
    vstore4(b, 0, f->b);
}

// How broad a frustum is at that z, along u and v.
float2 breadth_of_frustum(const Frustum* f, float z) {
    return (float2)(fma(f->b[1] - f->b[0], z, f->a[1] - f->a[0]), fma(f->b[3] - f->b[2], z, f->a[3] - f->a[2]));
}

// The axis along which all rays of a range go one way and are steepest, or 3 if there is none.
uint axis_of_frusta(const PacketRange* r) {
    uint axis = 3u;
    float most = 0.5f;
#pragma unroll
    for (uint i = 0; i < 3u; i++) {
        const float slowest = fmax(r->direction_least[i], -r->direction_greatest[i]);
        axis = slowest >= most ? i : axis;
        most = fmax(most, slowest);
    }
    return axis;
}

// Makes the frusta of the packets of `members`, of that range, with the same axes. False where there are none, or some
// packet's is so broad that it tells little.
bool make_frusta(const RayPacket* packets, const uint members, const PacketRange* r, float3 low, float3 high,
                 Frustum* frusta) {
    Frustum f;
    f.z = axis_of_frusta(r);
    // What is behind the start is hit with a t_near below 0.
    if (f.z > 2u || r->t_near_least < 0.0f) return false;
    f.u = (f.z + 1u) % 3u;
    f.v = (f.z + 2u) % 3u;
    f.is_upwards = r->direction_least[f.z] >= 0.5f;
    const float lows[3] = {low.x, low.y, low.z}, highs[3] = {high.x, high.y, high.z};
    const float least = r->rays.origin_least[f.z], greatest = r->rays.origin_greatest[f.z];
    const float start = f.is_upwards ? least : greatest, end = f.is_upwards ? highs[f.z] : lows[f.z];
    float reach = 0.0f;
    for (uint axis = 0; axis < 3u; axis++) {
        reach = max_or(reach, max_or(fabs(r->rays.origin_least[axis]), fabs(r->rays.origin_greatest[axis])));
        reach = max_or(reach, max_or(fabs(lows[axis]), fabs(highs[axis])));
    }
    if (!((f.is_upwards ? end - start : start - end) > LEAST_FRUSTUM_LENGTH * reach)) return false;
    f.padding = FRUSTUM_SLACK * reach;
    const float2 broadest = BROADEST_FRUSTUM * (float2)(highs[f.u] - lows[f.u], highs[f.v] - lows[f.v]);
    f.first_start = f.is_upwards ? least : -greatest;
    f.last_start = f.is_upwards ? greatest : -least;
    for (uint rest = members; rest != 0u; rest &= rest - 1u) {
        const uint k = first_member(rest);
        set_lines(&packets[k], start, end, &f);
        if (all(breadth_of_frustum(&f, end) > broadest)) return false;
        frusta[k] = f;
    }
    return true;
}

// How far the rays of a packet reach along its frustum, if they go no farther than t_limit: no farther than this.
float reach_along(const RayPacket* p, const Frustum* f, float16 t_limit) {
    const float16 end = fma(t_limit, p->direction[f->z], p->origin[f->z]);
    const float16 along = ALONG(f, end);
    const float8 eight = larger8(along.lo, along.hi);
    const float4 four = fmax(eight.lo, eight.hi);
    const float2 two = fmax(four.lo, four.hi);
    return fmax(two.x, two.y) + f->padding;
}

// The triangles abc that the frustum meets: those whose vertices are not all beyond one of the planes.
ulong frustum_meets_triangles(const Frustum* f, const float8* a, const float8* b, const float8* c) {
    int8 met = (int8)(-1);
#pragma unroll
    for (uint line = 0; line < 4u; line++) {
        const uint axis = line < 2u ? f->u : f->v;
        const float8 slope = (float8)(-f->b[line]);
        const float8 at_a = fma(slope, a[f->z], a[axis]), at_b = fma(slope, b[f->z], b[axis]),
                     at_c = fma(slope, c[f->z], c[axis]);
        met = met && (line % 2u == 0u ? larger8(at_a, larger8(at_b, at_c)) >= f->a[line]
                                      : smaller8(at_a, smaller8(at_b, at_c)) <= f->a[line]);
    }
    return lanes_where8(met);
}
