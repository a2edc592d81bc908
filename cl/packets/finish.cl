// t, u and v of the exact hits of a packet: finish_extended() of exact_filter.cl, in the same precision with the same
// bounds, for eight lanes at a time, the bounds for all sixteen; and where that is not sure, finish_closer() of
// exact_closer.cl. Lanes that neither is sure of are undecided. Instead of t surfaces want the weight of vertex 0.

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

// t, or the weight of vertex 0, u and v of eight hits, the lanes where they are sure, and the bits of the weights that
// are surely zero.
typedef struct {
    float8 third, u, v;
    int8 is_sure, zeros;
} Finished8;

// In place of the weight of vertex 0 what the others leave of 1, which is near enough where it is the largest one, as
// finish_extended() has it.
void take_rest8(int8 is_rounded, Finished8* f) {
    const float8 rest = (1.0f - f->u) - f->v;
    const int8 is_rest = rest >= f->u && rest >= f->v;
    f->is_sure = f->is_sure && (is_rounded || is_rest);
    f->third = is_rest ? rest : f->third;
}

// Of eight rays and their triangles, corner by corner. `low`: second parts of origins, 0 where there are none. Of zeros
// this precision tells nothing.
Finished8 finish_eight(const float8* o, const float8* low, const float8* d, const float8* c, const bool wants_t,
                       const FinishBounds8 bounds) {
    TriangleInDoubles t;
    triangle_in_doubles(o, d, c, &t);
    if (low != 0) {
        t.from.x -= convert_double8(low[0]);
        t.from.y -= convert_double8(low[1]);
        t.from.z -= convert_double8(low[2]);
    }
    const Doubles3 normal = cross_doubles(&t.edge1, &t.edge2), moment = cross_doubles(&t.from, &t.along);
    const double8 det = dot_doubles(&normal, &t.along);
    const double8 weight1 = dot_doubles(&t.edge2, &moment), weight2 = -dot_doubles(&t.edge1, &moment);
    const double8 inverse = 1.0 / det;
    const float8 det_error = bounds.det / fabs(convert_float8(det));
    Finished8 f;
    f.zeros = (int8)(0);
    f.is_sure = bounds.det > LEAST_MAGNITUDE * EXTENDED_EPSILON && bounds.det <= FLT_MAX && det_error < MOST_DET_ERROR;
    f.is_sure = f.is_sure && round_surely8(weight1, bounds.u, inverse, det_error, &f.u);
    f.is_sure = f.is_sure && round_surely8(weight2, bounds.v, inverse, det_error, &f.v);
    const double8 third = wants_t ? dot_doubles(&normal, &t.from) : (det - weight1) - weight2;
    const int8 is_rounded = round_surely8(third, bounds.third, inverse, det_error, &f.third);
    if (wants_t)
        f.is_sure = f.is_sure && is_rounded;
    else
        take_rest8(is_rounded, &f);
    return f;
}

// The bound of finish_eight() in the precision of closer_numbers8(), and more than what underflows in it, which is less
// than 2^-180 (DECIDE_LEAST).
double8 closer_bound8(float8 bound) {
    return convert_double8(bound) * (double)(CLOSER_ERROR / EXTENDED_ERROR) + 0x1p-160;
}

// As rounds_surely_closer(): the quotient of a number and det, whose inverse in doubles that is.
int8 round_surely_closer8(const DoubleDouble8* number, double8 bound, double8 half_unit, const DoubleDouble8* det,
                          double8 det_bound, double8 half_of_det, double8 inverse, float8* rounded) {
    const double8 rough = number->high * inverse;
    const double8 error = 1.01 * (fabs(rough) * (det_bound * fabs(inverse) + 0x1p-50) + bound * fabs(inverse));
    const float8 low = convert_float8(rough - error), high = convert_float8(rough + error);
    *rounded = high;
    int8 is_sure = low == high;
    const int8 are_two = low < high && as_int8(high) - as_int8(low) <= 1 && as_int8(low) - as_int8(high) <= 1;
    if (is_any8(are_two)) {
        const double8 first = convert_double8(low), last = convert_double8(high), middle = 0.5 * (first + last);
        const double8 product = middle * det->high;
        DoubleDouble8 rest = dd8_sum(number->high, -product);
        rest.high += rest.low + ((number->low - fma(middle, det->high, -product)) - middle * det->low);
        const double8 rest_bound =
            bound + fabs(middle) * det_bound + 0x1p-102 * (fabs(number->high) + fabs(product));
        const int8 is_tie = convert_int8(
            fabs(rest.high) + rest_bound < smaller_of_doubles(half_unit, 0.5 * (last - first) * half_of_det));
        const int8 is_beside = convert_int8(fabs(rest.high) > rest_bound);
        const int8 is_below = convert_int8((rest.high > 0.0) != (det->high > 0.0));
        const int8 is_low = (is_tie && (as_int8(low) & 1) == 0) || (!is_tie && is_below);
        *rounded = are_two && is_low ? low : high;
        is_sure = is_sure || (are_two && (is_tie || is_beside));
    }
    return is_sure && fabs(*rounded) > LEAST_MAGNITUDE;
}

// As rounds_across_axis(): t, and the lanes where it is certain.
int8 round_across_axis8(const float8* o, const float8* d, const float8* c, float8* t) {
    float8 plane = (float8)(0.0f), from = (float8)(0.0f), along = (float8)(0.0f);
#pragma unroll
    for (uint axis = 0; axis < 3u; axis++) {
        const int8 is_across = c[axis] == c[3u + axis] && c[axis] == c[6u + axis] && d[axis] != 0.0f;
        plane = is_across ? c[axis] : plane;
        from = is_across ? o[axis] : from;
        along = is_across ? d[axis] : along;
    }
    const DoubleDouble8 distance = dd8_sum(convert_double8(plane), -convert_double8(from));
    const double8 divisor = convert_double8(along);
    const float8 nearest = convert_float8(distance.high / divisor);
    const double8 rounded = convert_double8(nearest), rest = fma(-rounded, divisor, distance.high);
    const int8 is_farther = convert_int8((rest > 0.0) == (distance.high > 0.0));
    const float8 beside = as_float8(as_int8(nearest) + (is_farther ? (int8)(1) : (int8)(-1)));
    const double8 half_gap = 0.5 * fabs((convert_double8(beside) - rounded) * divisor);
    const int8 is_tie = convert_int8(fabs(rest) == half_gap), is_odd = (as_int8(nearest) & 1) != 0;
    *t = convert_int8(fabs(rest) > half_gap) || (is_tie && is_odd) ? beside : nearest;
    return along != 0.0f && convert_int8(distance.low == 0.0) && fabs(*t) > LEAST_MAGNITUDE && fabs(*t) < FLT_MAX;
}

// As finish_eight(), of rays that start on no triangle, by closer.cl.
APART Finished8 finish_eight_closer(const float8* o, const float8* d, const float8* c, const bool wants_t,
                                   const FinishBounds8* bounds) {
    CloserNumbers8 n;
    closer_numbers8(o, d, c, &n);
    const double8 bound_det = closer_bound8(bounds->det), bound1 = closer_bound8(bounds->u);
    const double8 bound2 = closer_bound8(bounds->v), bound0 = bound_det + bound1 + bound2;
    const double8 inverse = 1.0 / n.det.high;
    const HalfUnits8 units = half_units8(o, d, c);
    const Numbers8 high = numbers_of_pairs8(&n);
    Finished8 f;
    f.zeros = n.is_right ? zeros_of_weights8(&high, bound0, bound1, bound2, units.of_weights) : (int8)(0);
    const int8 is_zero0 = (f.zeros & 1) != 0, is_zero1 = (f.zeros & 2) != 0, is_zero2 = (f.zeros & 4) != 0;
#define ROUND_SURELY(number, bound, of_number, rounded) \
    round_surely_closer8(&n.number, bound, units.of_number, &n.det, bound_det, units.of_weights, inverse, &f.rounded)
    f.is_sure =
        n.is_right && bounds->det <= FLT_MAX && convert_int8(bound_det * fabs(inverse) < (double)MOST_DET_ERROR);
    f.is_sure = f.is_sure && (ROUND_SURELY(weight1, bound1, of_weights, u) || is_zero1);
    f.is_sure = f.is_sure && (ROUND_SURELY(weight2, bound2, of_weights, v) || is_zero2);
    f.u = is_zero1 ? (float8)(0.0f) : f.u;
    f.v = is_zero2 ? (float8)(0.0f) : f.v;
    if (wants_t) {
        const double8 bound_t = closer_bound8(bounds->third);
        const int8 at_start = is_surely_zero8(n.distance.high, bound_t, units.of_t);
        float8 t_across;
        const int8 is_across = round_across_axis8(o, d, c, &t_across);
        f.is_sure = f.is_sure && (ROUND_SURELY(distance, bound_t, of_t, third) || at_start || is_across);
        f.third = at_start ? (float8)(0.0f) : is_across ? t_across : f.third;
    } else {
        const int8 is_rounded = ROUND_SURELY(weight0, bound0, of_weights, third);
        f.third = is_zero0 ? (float8)(0.0f) : f.third;
        take_rest8(is_rounded || is_zero0, &f);
    }
#undef ROUND_SURELY
    return f;
}

// Writes t, or the weight of vertex 0, u and v of all sixteen lanes, and the bits of the weights that are surely zero.
// `corners`: nine coordinates of their triangles, all 0 where there is none. Returns where they are certain.
int16 finish_sixteen(const RayPacket* p, const float16* corners, const bool wants_t, float16* third, float16* u,
                     float16* v, int16* zeros) {
    const FinishBounds bounds = finish_bounds(p, corners, wants_t);
    const int16 may_be_closer = p->has_low ? (int16)(0) : p->skip == NO_PRIMITIVE && bounds.det > 0.0f;
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
        Finished8 f = finish_eight(o, p->has_low ? low : 0, d, c, wants_t, of_part);
        const int8 open = HALF(may_be_closer) && !f.is_sure;
        if (is_any8(open)) {
            // Copies: what a call has the address of is not in registers before it either.
            float8 origin[3], direction[3], of_triangles[9];
            const FinishBounds8 limits = of_part;
#pragma unroll
            for (uint i = 0; i < 3u; i++) {
                origin[i] = o[i];
                direction[i] = d[i];
            }
#pragma unroll
            for (uint i = 0; i < 9u; i++) of_triangles[i] = c[i];
            const Finished8 closer = finish_eight_closer(origin, direction, of_triangles, wants_t, &limits);
            f.third = open ? closer.third : f.third;
            f.u = open ? closer.u : f.u;
            f.v = open ? closer.v : f.v;
            f.zeros = open ? closer.zeros : f.zeros;
            f.is_sure = f.is_sure || (open && closer.is_sure);
        }
        found[part] = f;
    }
#undef HALF
    *third = (float16)(found[0].third, found[1].third);
    *u = (float16)(found[0].u, found[1].u);
    *v = (float16)(found[0].v, found[1].v);
    *zeros = (int16)(found[0].zeros, found[1].zeros);
    return (int16)(found[0].is_sure, found[1].is_sure);
}
#else
// Pairs of floats are better off without vectors, and no weight is known to be zero (exact_closer.cl).
int16 finish_sixteen(const RayPacket* p, const float16* corners, const bool wants_t, float16* third, float16* u,
                     float16* v, int16* zeros) {
    int16 sure = (int16)(0);
    *zeros = (int16)(0);
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

// Writes t, u and v of the lanes `is_hit`, by their triangles' references, and the bits of the weights that are surely
// zero. Returns those of them that are left to finish_exactly() of their rays.
int16 finish_hits(GEOMETRY_PARAMETERS, const RayPacket* p, const int16 is_hit, const uint16 hit, float16* t,
                  float16* u, float16* v, int16* zeros) {
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
    return is_hit && !finish_sixteen(p, corners, true, t, u, v, zeros);
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
    int16 zeros;
    const int16 unsure = finish_hits(GEOMETRY, p, is_hit, hits->reference, &t, &u, &v, &zeros);
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
    int16 zeros;
    return finish_sixteen(p, corners, false, weight0, u, v, &zeros);
}

float leaving_t_exactly(float error, float3 direction) { return 0.0f; }
