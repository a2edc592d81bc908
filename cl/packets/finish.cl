// t, u and v of the hits of a packet: finish_hit() of exact.cl, in the same precision with the same bounds, for eight lanes at a
// time, the bounds for all sixteen. Lanes that it is not sure of are in doubt. For rays without a second part of the origin: those of
// batches.

#ifdef WIDE_IS_DOUBLE
typedef struct {
    double8 x, y, z;
} Doubles3;

Doubles3 cross_doubles(const Doubles3* a, const Doubles3* b) {
    const Doubles3 r = {a->y * b->z - a->z * b->y, a->z * b->x - a->x * b->z, a->x * b->y - a->y * b->x};
    return r;
}
double8 dot_doubles(const Doubles3* a, const Doubles3* b) { return a->x * b->x + a->y * b->y + a->z * b->z; }

typedef struct {
    float16 x, y, z;
} Floats3;

Floats3 magnitudes_of_cross(const Floats3* a, const Floats3* b) {
    const Floats3 r = {a->y * b->z + a->z * b->y, a->z * b->x + a->x * b->z, a->x * b->y + a->y * b->x};
    return r;
}
float16 magnitudes_of_dot(const Floats3* a, const Floats3* b) { return fma(a->x, b->x, fma(a->y, b->y, a->z * b->z)); }

// By how much the numbers of finish_eight() may be off.
typedef struct {
    float16 det, t, u, v;
} FinishBounds;

FinishBounds finish_bounds(const float16* o, const float16* d, const float16* c) {
    const Floats3 size1 = {fabs(c[3] - c[0]), fabs(c[4] - c[1]), fabs(c[5] - c[2])};
    const Floats3 size2 = {fabs(c[6] - c[0]), fabs(c[7] - c[1]), fabs(c[8] - c[2])};
    const Floats3 from_size = {fabs(c[0] - o[0]), fabs(c[1] - o[1]), fabs(c[2] - o[2])};
    const Floats3 direction_size = {fabs(d[0]), fabs(d[1]), fabs(d[2])};
    const Floats3 normal_size = magnitudes_of_cross(&size1, &size2), moment_size = magnitudes_of_cross(&from_size, &direction_size);
    const FinishBounds bounds = {WIDE_ERROR * magnitudes_of_dot(&normal_size, &direction_size),
                                 WIDE_ERROR * magnitudes_of_dot(&normal_size, &from_size),
                                 WIDE_ERROR * magnitudes_of_dot(&size2, &moment_size),
                                 WIDE_ERROR * magnitudes_of_dot(&size1, &moment_size)};
    return bounds;
}

// As rounds_surely().
int8 round_surely8(double8 numerator, float8 bound, double8 inverse, float8 det_error, float8* rounded) {
    const double8 quotient = numerator * inverse;
    const float8 error = fma(1.01f * bound, fabs(convert_float8(inverse)),
                             fabs(convert_float8(quotient)) * fma((float8)(1.01f), det_error, (float8)(8.0f * WIDE_EPSILON)));
    *rounded = convert_float8(quotient + convert_double8(error));
    return bound > LEAST_MAGNITUDE * WIDE_EPSILON && bound <= FLT_MAX && convert_float8(quotient - convert_double8(error)) == *rounded;
}

Doubles3 difference_of_doubles(float8 ax, float8 ay, float8 az, float8 bx, float8 by, float8 bz) {
    const Doubles3 r = {convert_double8(ax) - convert_double8(bx), convert_double8(ay) - convert_double8(by),
                        convert_double8(az) - convert_double8(bz)};
    return r;
}

// Of eight rays and their triangles, corner by corner; the lanes where it is sure.
int8 finish_eight(const float8* o, const float8* d, const float8* c, float8 det_bound, float8 t_bound, float8 u_bound, float8 v_bound,
                  float8* t, float8* u, float8* v) {
    const Doubles3 edge1 = difference_of_doubles(c[3], c[4], c[5], c[0], c[1], c[2]);
    const Doubles3 edge2 = difference_of_doubles(c[6], c[7], c[8], c[0], c[1], c[2]);
    const Doubles3 from = difference_of_doubles(c[0], c[1], c[2], o[0], o[1], o[2]);
    const Doubles3 direction = {convert_double8(d[0]), convert_double8(d[1]), convert_double8(d[2])};
    const Doubles3 normal = cross_doubles(&edge1, &edge2), moment = cross_doubles(&from, &direction);
    const double8 det = dot_doubles(&normal, &direction);
    const double8 inverse = 1.0 / det;
    const float8 det_error = det_bound / fabs(convert_float8(det));
    int8 is_sure = det_bound > LEAST_MAGNITUDE * WIDE_EPSILON && det_bound <= FLT_MAX && det_error < 0x1p-10f;
    is_sure = is_sure && round_surely8(dot_doubles(&normal, &from), t_bound, inverse, det_error, t);
    is_sure = is_sure && round_surely8(dot_doubles(&edge2, &moment), u_bound, inverse, det_error, u);
    is_sure = is_sure && round_surely8(-dot_doubles(&edge1, &moment), v_bound, inverse, det_error, v);
    return is_sure;
}

// Writes t, u and v of all sixteen lanes. `corners`: nine coordinates of their triangles. Returns where they are certain.
int16 finish_sixteen(const RayPacket* p, const float16* corners, float16* t, float16* u, float16* v) {
    const FinishBounds bounds = finish_bounds(p->origin, p->direction, corners);
    int8 sure[2];
    float8 ts[2], us[2], vs[2];
#define HALF(vector) (part == 0u ? (vector).lo : (vector).hi)
#pragma unroll
    for (uint part = 0; part < 2u; part++) {
        float8 o[3], d[3], c[9];
#pragma unroll
        for (uint i = 0; i < 3u; i++) {
            o[i] = HALF(p->origin[i]);
            d[i] = HALF(p->direction[i]);
        }
#pragma unroll
        for (uint i = 0; i < 9u; i++) c[i] = HALF(corners[i]);
        sure[part] = finish_eight(o, d, c, HALF(bounds.det), HALF(bounds.t), HALF(bounds.u), HALF(bounds.v), &ts[part], &us[part],
                                  &vs[part]);
    }
#undef HALF
    *t = (float16)(ts[0], ts[1]);
    *u = (float16)(us[0], us[1]);
    *v = (float16)(vs[0], vs[1]);
    return (int16)(sure[0], sure[1]);
}
#else
// Pairs of floats are better off without vectors.
int16 finish_sixteen(const RayPacket* p, const float16* corners, float16* t, float16* u, float16* v) {
    int16 sure = (int16)(0);
    for (uint lane = 0; lane < 16u; lane++) {
        WideNumbers n;
        wide_numbers(three_of_lane(p->origin, lane), (float3)(0.0f), three_of_lane(p->direction, lane), three_of_lane(corners, lane),
                     three_of_lane(corners + 3, lane), three_of_lane(corners + 6, lane), &n);
        const WideInverse det = invert_det(&n);
        float t_u_v[3];
        if (det.is_sure && rounds_surely(n.distance, n.distance_bound, &det, &t_u_v[0]) &&
            rounds_surely(n.weight1, n.bound1, &det, &t_u_v[1]) && rounds_surely(n.weight2, n.bound2, &det, &t_u_v[2])) {
            ((int*)&sure)[lane] = -1;
            set_lane16(t, lane, t_u_v[0]);
            set_lane16(u, lane, t_u_v[1]);
            set_lane16(v, lane, t_u_v[2]);
        }
    }
    return sure;
}
#endif

// Hits as the caller gets them, but for the units of t.
typedef struct {
    float16 t, u, v;
    uint16 primitive;
} FinishedHits;

// Adds what is not certain to *doubtful. With any_hit t is only no less than that of the hit, and u and v are 0.
void finish_packet(GEOMETRY_PARAMETERS, const RayPacket* p, const PacketHits* hits, const bool any_hit, FinishedHits* out,
                   int16* doubtful) {
    out->t = (float16)(INFINITY);
    out->u = (float16)(0.0f);
    out->v = (float16)(0.0f);
    out->primitive = hits->primitive;
    const int16 is_hit = hits->primitive != NO_PRIMITIVE;
    ulong open = lanes_where16(is_hit);
    if (open == 0ul) return;
    if (any_hit) {
        out->t = is_hit ? hits->t_high : out->t;
        return;
    }
    float16 corners[9];
#pragma unroll
    for (uint i = 0; i < 9u; i++) corners[i] = (float16)(0.0f);
    // One triangle after the other: the rays of a packet hit few. Their coordinates are those that were just tested.
    while (open != 0ul) {
        const uint reference = ((const uint*)&hits->reference)[first_lane16(open)];
        const int16 here = hits->reference == reference;
        const uint record = BVH8_PACKET_RECORDS * (reference / 8u);
#pragma unroll
        for (uint i = 0; i < 9u; i++)
            corners[i] = here ? (float16)(LOAD_PACKET_LANE(geometry, record + 2u * i, reference % 8u)) : corners[i];
        open &= ~lanes_where16(here);
    }
    float16 t = out->t, u = out->u, v = out->v;
    const int16 sure = finish_sixteen(p, corners, &t, &u, &v);
    out->t = is_hit ? t : out->t;
    out->u = is_hit ? u : out->u;
    out->v = is_hit ? v : out->v;
    *doubtful = *doubtful || (is_hit && !sure);
}
