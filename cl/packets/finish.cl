// t, u and v of the exact hits of a packet: finish_extended() of exact_filter.cl, in the same precision with the same
// bounds, for eight lanes at a time, the bounds for all sixteen. Lanes that it is not sure of are undecided. Instead of
// t surfaces want the weight of vertex 0.

#ifdef EXTENDED_IS_DOUBLE
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
    float16 det, third, u, v;
} FinishBounds;

float16 from_magnitude(const RayPacket* p, uint axis, float16 x) {
    const float16 size = fabs(from_origins(p, axis, x));
    return p->has_low ? fma(fabs(p->origin_low[axis]), (float16)(START_ERROR), size) : size;
}

FinishBounds finish_bounds(const RayPacket* p, const float16* c, const bool wants_t) {
    const Floats3 size1 = {fabs(c[3] - c[0]), fabs(c[4] - c[1]), fabs(c[5] - c[2])};
    const Floats3 size2 = {fabs(c[6] - c[0]), fabs(c[7] - c[1]), fabs(c[8] - c[2])};
    const Floats3 from_size = {from_magnitude(p, 0u, c[0]), from_magnitude(p, 1u, c[1]), from_magnitude(p, 2u, c[2])};
    const Floats3 direction_size = {fabs(p->direction[0]), fabs(p->direction[1]), fabs(p->direction[2])};
    const Floats3 normal_size = magnitudes_of_cross(&size1, &size2),
                  moment_size = magnitudes_of_cross(&from_size, &direction_size);
    const float16 det = magnitudes_of_dot(&normal_size, &direction_size);
    const float16 u = magnitudes_of_dot(&size2, &moment_size), v = magnitudes_of_dot(&size1, &moment_size);
    const FinishBounds bounds = {EXTENDED_ERROR * det,
                                 wants_t ? EXTENDED_ERROR * magnitudes_of_dot(&normal_size, &from_size)
                                         : EXTENDED_ERROR_W * (det + u + v),
                                 EXTENDED_ERROR * u, EXTENDED_ERROR * v};
    return bounds;
}

// As rounds_surely().
int8 round_surely8(double8 numerator, float8 bound, double8 inverse, float8 det_error, float8* rounded) {
    const double8 quotient = numerator * inverse;
    const float8 error =
        fma(QUOTIENT_MARGIN * bound, fabs(convert_float8(inverse)),
            fabs(convert_float8(quotient)) *
                fma((float8)(QUOTIENT_MARGIN), det_error, (float8)(8.0f * EXTENDED_EPSILON)));
    *rounded = convert_float8(quotient + convert_double8(error));
    return bound > LEAST_MAGNITUDE * EXTENDED_EPSILON && bound <= FLT_MAX && fabs(*rounded) > LEAST_MAGNITUDE &&
           convert_float8(quotient - convert_double8(error)) == *rounded;
}

// The bounds of eight lanes.
typedef struct {
    float8 det, third, u, v;
} FinishBounds8;

// t, or the weight of vertex 0, u and v of eight hits, and the lanes where they are sure.
typedef struct {
    float8 third, u, v;
    int8 is_sure;
} Finished8;

// Of eight rays and their triangles, corner by corner. `low`: second parts of origins, 0 where there are none. `zeros`:
// bits of the weights that are zero.
Finished8 finish_eight(const float8* o, const float8* low, const float8* d, const float8* c, const uint8 zeros,
                       const bool wants_t, const FinishBounds8 bounds) {
    const Doubles3 edge1 = difference_of_doubles(c[3], c[4], c[5], c[0], c[1], c[2]);
    const Doubles3 edge2 = difference_of_doubles(c[6], c[7], c[8], c[0], c[1], c[2]);
    Doubles3 from = difference_of_doubles(c[0], c[1], c[2], o[0], o[1], o[2]);
    if (low != 0) {
        from.x -= convert_double8(low[0]);
        from.y -= convert_double8(low[1]);
        from.z -= convert_double8(low[2]);
    }
    const Doubles3 direction = {convert_double8(d[0]), convert_double8(d[1]), convert_double8(d[2])};
    const Doubles3 normal = cross_doubles(&edge1, &edge2), moment = cross_doubles(&from, &direction);
    const double8 det = dot_doubles(&normal, &direction);
    const double8 weight1 = dot_doubles(&edge2, &moment), weight2 = -dot_doubles(&edge1, &moment);
    const double8 inverse = 1.0 / det;
    const float8 det_error = bounds.det / fabs(convert_float8(det));
    Finished8 f;
    int8 is_sure =
        bounds.det > LEAST_MAGNITUDE * EXTENDED_EPSILON && bounds.det <= FLT_MAX && det_error < MOST_DET_ERROR;
    const int8 is_u_zero = (zeros & 2u) != 0u, is_v_zero = (zeros & 4u) != 0u;
    is_sure = is_sure && (round_surely8(weight1, bounds.u, inverse, det_error, &f.u) || is_u_zero);
    is_sure = is_sure && (round_surely8(weight2, bounds.v, inverse, det_error, &f.v) || is_v_zero);
    f.u = is_u_zero ? (float8)(0.0f) : f.u;
    f.v = is_v_zero ? (float8)(0.0f) : f.v;
    if (wants_t) {
        f.is_sure =
            is_sure && round_surely8(dot_doubles(&normal, &from), bounds.third, inverse, det_error, &f.third);
        return f;
    }
    // As finish_extended(): what the others leave of 1 is near enough where it is the largest weight.
    const float8 rest = (1.0f - f.u) - f.v;
    const int8 is_rest = rest >= f.u && rest >= f.v;
    const double8 weight0 = (det - weight1) - weight2;
    f.is_sure = is_sure && (round_surely8(weight0, bounds.third, inverse, det_error, &f.third) || is_rest);
    f.third = is_rest ? rest : f.third;
    return f;
}

// Writes t, or the weight of vertex 0, u and v of all sixteen lanes. `corners`: nine coordinates of their triangles.
// `zeros`: bits of the weights that are zero. Returns where they are certain.
int16 finish_sixteen(const RayPacket* p, const float16* corners, const uint16 zeros, const bool wants_t,
                     float16* third, float16* u, float16* v) {
    const FinishBounds bounds = finish_bounds(p, corners, wants_t);
    Finished8 found[2];
#define HALF(vector) (part == 0u ? (vector).lo : (vector).hi)
#pragma unroll
    for (uint part = 0; part < 2u; part++) {
        float8 o[3], low[3], d[3], c[9];
#pragma unroll
        for (uint i = 0; i < 3u; i++) {
            o[i] = HALF(p->origin[i]);
            low[i] = HALF(p->origin_low[i]);
            d[i] = HALF(p->direction[i]);
        }
#pragma unroll
        for (uint i = 0; i < 9u; i++) c[i] = HALF(corners[i]);
        const FinishBounds8 of_part = {HALF(bounds.det), HALF(bounds.third), HALF(bounds.u), HALF(bounds.v)};
        found[part] = finish_eight(o, p->has_low ? low : 0, d, c, HALF(zeros), wants_t, of_part);
    }
#undef HALF
    *third = (float16)(found[0].third, found[1].third);
    *u = (float16)(found[0].u, found[1].u);
    *v = (float16)(found[0].v, found[1].v);
    return (int16)(found[0].is_sure, found[1].is_sure);
}
#else
// Pairs of floats are better off without vectors, and no weight is known to be zero (exact_closer.cl).
int16 finish_sixteen(const RayPacket* p, const float16* corners, const uint16 zeros, const bool wants_t,
                     float16* third, float16* u, float16* v) {
    int16 sure = (int16)(0);
    for (uint lane = 0; lane < 16u; lane++) {
        ExtendedNumbers n;
        extended_numbers(three_of_lane(p->origin, lane), three_of_lane(p->origin_low, lane),
                         three_of_lane(p->direction, lane), three_of_lane(corners, lane),
                         three_of_lane(corners + 3, lane), three_of_lane(corners + 6, lane), &n);
        const ExtendedInverse det = invert_det(&n);
        float rounded[3];
        if (!det.is_sure || !rounds_surely(n.weight1, n.bound1, &det, &rounded[1]) ||
            !rounds_surely(n.weight2, n.bound2, &det, &rounded[2]))
            continue;
        if (wants_t) {
            if (!rounds_surely(n.distance, n.distance_bound, &det, &rounded[0])) continue;
        } else if (is_nearest_vertex0(rounded[1], rounded[2])) {
            rounded[0] = (1.0f - rounded[1]) - rounded[2];
        } else if (!rounds_surely(n.weight0, n.bound0, &det, &rounded[0])) {
            continue;
        }
        ((int*)&sure)[lane] = -1;
        set_lane16(third, lane, rounded[0]);
        set_lane16(u, lane, rounded[1]);
        set_lane16(v, lane, rounded[2]);
    }
    return sure;
}
#endif

// Writes t, u and v of the lanes `is_hit`, by their triangles' references. Returns those of them that are left to
// finish_exactly() of their rays.
int16 finish_hits(GEOMETRY_PARAMETERS, const RayPacket* p, const int16 is_hit, const uint16 hit, const uint16 zeros,
                  float16* t, float16* u, float16* v) {
    float16 corners[9];
#pragma unroll
    for (uint i = 0; i < 9u; i++) corners[i] = (float16)(0.0f);
    // One triangle after the other: the rays of a packet hit few. Their coordinates are those that were just tested.
    for (ulong open = lanes_where16(is_hit); open != 0ul;) {
        const uint reference = ((const uint*)&hit)[first_lane16(open)];
        const int16 here = hit == reference;
        const uint record = BVH8_PACKET_RECORDS * (reference / 8u);
#pragma unroll
        for (uint i = 0; i < 9u; i++)
            corners[i] = here ? (float16)(LOAD_PACKET_LANE(geometry, record + 2u * i, reference % 8u)) : corners[i];
        open &= ~lanes_where16(here);
    }
    return is_hit && !finish_sixteen(p, corners, zeros, true, t, u, v);
}

// Returns the lanes that are left to finish_lane_exactly(). With any_hit there are none, t is only no less than that of
// the hit, and u and v are 0.
int16 finish_packet_exactly(GEOMETRY_PARAMETERS, const RayPacket* p, const PacketHits_exactly* hits, const bool any_hit,
                            FinishedHits* out) {
    out->t = (float16)(INFINITY);
    out->u = (float16)(0.0f);
    out->v = (float16)(0.0f);
    out->primitive = hits->primitive;
    const int16 is_hit = hits->primitive != NO_PRIMITIVE;
    if (!is_any16(is_hit)) return (int16)(0);
    if (any_hit) {
        out->t = is_hit ? hits->t_high : out->t;
        return (int16)(0);
    }
    float16 t = out->t, u = out->u, v = out->v;
    const int16 unsure = finish_hits(GEOMETRY, p, is_hit, hits->reference, hits->zeros, &t, &u, &v);
    out->t = is_hit ? t : out->t;
    out->u = is_hit ? u : out->u;
    out->v = is_hit ? v : out->v;
    return unsure;
}

// Finishes the hit of one lane, whose ray that is, in more precision. Whether that takes no exact integers.
bool finish_lane_exactly(GEOMETRY_PARAMETERS, const Ray* ray, uint lane, const PacketHits_exactly* hits, Hit* hit) {
    *hit = no_hit();
    hit->primitive = ((const uint*)&hits->primitive)[lane];
    finish_exactly(GEOMETRY, ray, hit);
    return !FORGET_DEFERRED(geometry);
}

// What became of rays: the lanes that have hit, and what; those that were traced together.
typedef struct {
    ulong hits, together;
    uint primitive[16];
} PacketAnswer_exactly;

void keep_packet_exactly(PacketAnswer_exactly* answer, const PacketHits_exactly* hits) {
    vstore16(hits->primitive, 0, answer->primitive);
}
void keep_hit_exactly(PacketAnswer_exactly* answer, uint lane, const Hit* hit) {
    answer->primitive[lane] = hit->primitive;
}
void hit_of_answer_exactly(const PacketAnswer_exactly* answer, uint lane, Hit* hit) {
    *hit = no_hit();
    hit->primitive = answer->primitive[lane];
}

// The weights of hits on triangles of those corners, and the lanes where they are sure.
int16 weights_of_answer_exactly(const PacketAnswer_exactly* answer, const RayPacket* p, const float16* corners,
                                float16* weight0, float16* u, float16* v) {
    *weight0 = *u = *v = (float16)(0.0f); // some lanes may get none
    return finish_sixteen(p, corners, (uint16)(0u), false, weight0, u, v);
}

float leaving_t_exactly(float error, float3 direction) { return 0.0f; }
