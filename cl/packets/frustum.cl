// The space that the rays of a packet lie in, where they go much the same way: what a node's eight boxes, or the eight triangles of a
// leaf, are tested against before each of them is tested against sixteen rays. Reshetov, Soupikov and Hurley, "Multi-Level Ray Tracing
// Algorithm", SIGGRAPH 2005.
//
// With z the axis along which all rays go one way, a ray has a coordinate u(z) that is linear. The least u of several rays is a concave
// function of z: between where the first one starts and where the scene ends, it is nowhere below the line that connects its values at
// these two. So there are four such lines, below and above u and v.
//
// Errors, in units of EPSILON reach, where no coordinate of the scene or of a start is larger than reach: slopes are below 4
// (|direction| below 2 and no less than 1/2 along z), z - start no more than 2 reach, so that u of a ray, of a quotient with an error
// of 6, a difference and an fma, is off by 73; the slope of a line, off by 7 of itself, makes 56 of its length, its start 18, and
// what a box or a vertex makes of the line 20: less than 170. FRUSTUM_SLACK is 320 EPSILON.
#define FRUSTUM_SLACK (8.0f * SLACK)
#define LEAST_FRUSTUM_LENGTH 0x1p-10f // of reach, so that the lines' slopes are below 4.1

typedef struct {
    uint u, v, z;     // axes
    float a[4], b[4]; // below u, above u, below v, above v:  a + b z
    bool is_upwards;  // along z
} Frustum;

// False where there is none.
bool make_frustum(const RayPacket* p, float3 low, float3 high, Frustum* f) {
    const float3 steepest = vload3(0, p->range.steepest);
    f->z = major_axis(steepest);
    f->u = (f->z + 1u) % 3u;
    f->v = (f->z + 2u) % 3u;
    const float16 direction_z = p->direction[f->z];
    f->is_upwards = lane_of16(&direction_z, 0) > 0.0f;
    // What is behind the start is hit with a t_near below 0.
    if (is_any16((f->is_upwards ? direction_z < 0.5f : direction_z > -0.5f) || p->t_near < 0.0f)) return false;
    const float lows[3] = {low.x, low.y, low.z}, highs[3] = {high.x, high.y, high.z};
    const float start = f->is_upwards ? p->range.origin_least[f->z] : p->range.origin_greatest[f->z];
    const float end = f->is_upwards ? highs[f->z] : lows[f->z];
    float reach = 0.0f;
    for (uint axis = 0; axis < 3u; axis++) {
        reach = max_or(reach, max_or(fabs(p->range.origin_least[axis]), fabs(p->range.origin_greatest[axis])));
        reach = max_or(reach, max_or(fabs(lows[axis]), fabs(highs[axis])));
    }
    if (!((f->is_upwards ? end - start : start - end) > LEAST_FRUSTUM_LENGTH * reach)) return false;

    const float16 slope_u = p->direction[f->u] * p->inv[f->z], slope_v = p->direction[f->v] * p->inv[f->z];
    const float16 to_start = start - p->origin[f->z], to_end = end - p->origin[f->z];
    const float16 u0 = fma(to_start, slope_u, p->origin[f->u]), u1 = fma(to_end, slope_u, p->origin[f->u]);
    const float16 v0 = fma(to_start, slope_v, p->origin[f->v]), v1 = fma(to_end, slope_v, p->origin[f->v]);
    const float8 least = least_of_lanes(u0, -u0, v0, -v0, u1, -u1, v1, -v1);
    const float4 at_start = (float4)(least.s0, -least.s1, least.s2, -least.s3);
    const float4 at_end = (float4)(least.s4, -least.s5, least.s6, -least.s7);
    const float4 b = (at_end - at_start) / (end - start);
    const float pad = FRUSTUM_SLACK * reach;
    vstore4(at_start - b * start + (float4)(-pad, pad, -pad, pad), 0, f->a);
    vstore4(b, 0, f->b);
    return true;
}

// The children of a node that the frustum meets, and numbers of them that grow along the rays. A line's least value within a box is
// at one of the box's ends along z.
ulong clip_to_frustum(GEOMETRY_PARAMETERS, const Frustum* f, uint node, float8* order) {
    const uint u = node + 4u * f->u, v = node + 4u * f->v, z = node + 4u * f->z;
    const float8 low_z = LOAD_EIGHT(geometry, z), high_z = LOAD_EIGHT(geometry, z + 2u);
    const float8 below_u = fma((float8)(f->b[0]), f->b[0] > 0.0f ? low_z : high_z, (float8)(f->a[0]));
    const float8 above_u = fma((float8)(f->b[1]), f->b[1] > 0.0f ? high_z : low_z, (float8)(f->a[1]));
    const float8 below_v = fma((float8)(f->b[2]), f->b[2] > 0.0f ? low_z : high_z, (float8)(f->a[2]));
    const float8 above_v = fma((float8)(f->b[3]), f->b[3] > 0.0f ? high_z : low_z, (float8)(f->a[3]));
    *order = f->is_upwards ? low_z : -high_z;
    // The boxes of children that there are not are upside down.
    return lanes_where8(below_u <= LOAD_EIGHT(geometry, u + 2u) && above_u >= LOAD_EIGHT(geometry, u) &&
                        below_v <= LOAD_EIGHT(geometry, v + 2u) && above_v >= LOAD_EIGHT(geometry, v) && low_z <= high_z);
}

// The triangles abc that the frustum meets: those whose vertices are not all beyond one of the planes.
ulong frustum_meets_triangles(const Frustum* f, const float8* a, const float8* b, const float8* c) {
    int8 met = (int8)(-1);
#pragma unroll
    for (uint line = 0; line < 4u; line++) {
        const uint axis = line < 2u ? f->u : f->v;
        const float8 slope = (float8)(-f->b[line]);
        const float8 at_a = fma(slope, a[f->z], a[axis]), at_b = fma(slope, b[f->z], b[axis]), at_c = fma(slope, c[f->z], c[axis]);
        met = met && (line % 2u == 0u ? larger8(at_a, larger8(at_b, at_c)) >= f->a[line]
                                      : smaller8(at_a, smaller8(at_b, at_c)) <= f->a[line]);
    }
    return lanes_where8(met);
}
