// Step 3 of exact_filter.cl: the same numbers in pairs of doubles. What their bounds leave open is nearly always
// exactly zero: a ray through an edge or a vertex, whose triangles are met at the same t. A number that is a multiple
// of some power of two, and surely smaller, is zero: of models whose coordinates have up to some 40 bits between the
// largest and the last one, little is left to exact integers. Devices without double leave all of it to those at once.
// The Rust twin does so, too: both are certain.

#ifdef EXTENDED_IS_DOUBLE
// Calls, of which each is compiled once: inlined they take an H100's driver a second or more.
// With u = 2^-53, none of the numbers is off by more than 40 u^2 P (see EXTENDED_ERROR): edges are exact, the start's
// two products and sums are off by 16, its difference from p0 by 3, a vector product's component by 11, a sum of three
// products by 11; W by 9 more.
#define CLOSER_ERROR 0x1p-100f
// Of what power of two 0 is a multiple: of any, and this is more than others.
#define MOST_LOW 300

// Of a triangle.
typedef struct {
    float3 p0, p1, p2;
} Corners;

typedef struct {
    DoubleDouble distance, det, weight0, weight1, weight2; // T, D, W, U, V
    float distance_bound, det_bound, bound0, bound1, bound2;
} CloserNumbers;

RARE void closer_numbers(const TrianglePoint* start, float3 ray_direction, const Corners* corners, CloserNumbers* n) {
    const float3 p0 = corners->p0, p1 = corners->p1, p2 = corners->p2;
    const DoubleDouble3 edge1 = dd3_difference(p1, p0);
    const DoubleDouble3 edge2 = dd3_difference(p2, p0);
    DoubleDouble3 from = dd3_difference(p0, start->base);
    if (start->weight1 != 0.0f || start->weight2 != 0.0f) { // most rays start on no triangle
        const DoubleDouble3 start1 = dd3_difference(start->other1, start->base);
        const DoubleDouble3 start2 = dd3_difference(start->other2, start->base);
        from = dd3_add_product(&from, &start1, -start->weight1);
        from = dd3_add_product(&from, &start2, -start->weight2);
    }
    const DoubleDouble3 direction = dd3_from(ray_direction);
    const DoubleDouble3 normal = dd3_cross(&edge1, &edge2);
    const DoubleDouble3 moment = dd3_cross(&from, &direction);
    n->distance = dd3_dot(&normal, &from);
    n->det = dd3_dot(&normal, &direction);
    n->weight1 = dd3_dot(&edge2, &moment);
    n->weight2 = -dd3_dot(&edge1, &moment);
    n->weight0 = dd_subtract(dd_subtract(n->det, n->weight1), n->weight2);

    const float3 magnitude1 = p1 - p0, magnitude2 = p2 - p0;
    const float3 start_magnitude =
        abs3(start->other1 - start->base) * start->weight1 + abs3(start->other2 - start->base) * start->weight2;
    const float3 from_magnitude = abs3(p0 - start->base) + start_magnitude;
    const float3 normal_magnitude = magnitude_cross(magnitude1, magnitude2);
    const float3 moment_magnitude = magnitude_cross(from_magnitude, ray_direction);
    const float det_magnitude = magnitude_dot(normal_magnitude, ray_direction);
    const float magnitude_1 = magnitude_dot(magnitude2, moment_magnitude);
    const float magnitude_2 = magnitude_dot(magnitude1, moment_magnitude);
    n->distance_bound = CLOSER_ERROR * magnitude_dot(normal_magnitude, from_magnitude);
    n->det_bound = CLOSER_ERROR * det_magnitude;
    n->bound0 = CLOSER_ERROR * (det_magnitude + magnitude_1 + magnitude_2);
    n->bound1 = CLOSER_ERROR * magnitude_1;
    n->bound2 = CLOSER_ERROR * magnitude_2;
}

// Whether a bound is one: products of three floats that make it underflow only where it would be smaller than this.
#define LEAST_CLOSER_BOUND (LEAST_MAGNITUDE * 0x1p-44f)
bool is_closer_bound(float bound) { return bound > LEAST_CLOSER_BOUND && bound <= FLT_MAX; }

int sure_sign_closer(DoubleDouble number, float bound) {
    if (!is_closer_bound(bound)) return 0;
    return number.x > (double)bound ? 1 : number.x < -(double)bound ? -1 : 0;
}

// Half of what numbers are multiples of. Every term of T is a product of an x, a y and a z of positions; of D and the
// weights, of two of these and the direction's third. Where every x of a position is a multiple of 2^low_x, and so on,
// and the start's weights of 2^low_w, T is one of the product of these. Most rays start on no triangle.
typedef struct {
    double of_weights, of_t; // D is a multiple of what the weights are
} HalfUnits;

RARE HalfUnits half_closer_units(const TrianglePoint* start, float3 direction, const Corners* corners) {
    const float3 positions[6] = {corners->p0, corners->p1, corners->p2, start->base, start->other1, start->other2};
    const int count = start->weight1 == 0.0f && start->weight2 == 0.0f ? 4 : 6;
    int low_x = MOST_LOW, low_y = MOST_LOW, low_z = MOST_LOW, low_w = 0, high = -MOST_LOW;
#pragma unroll 1
    for (int i = 0; i < count; i++) {
        widen_exponents(positions[i].x, &low_x, &high);
        widen_exponents(positions[i].y, &low_y, &high);
        widen_exponents(positions[i].z, &low_z, &high);
    }
    int along_x = MOST_LOW, along_y = MOST_LOW, along_z = MOST_LOW;
    widen_exponents(direction.x, &along_x, &high);
    widen_exponents(direction.y, &along_y, &high);
    widen_exponents(direction.z, &along_z, &high);
    widen_exponents(start->weight1, &low_w, &high);
    widen_exponents(start->weight2, &low_w, &high);
    const int of_weights = min(along_x + low_y + low_z, min(low_x + along_y + low_z, low_x + low_y + along_z));
    const HalfUnits units = {ldexp(0.5, of_weights + low_w), ldexp(0.5, low_x + low_y + low_z + low_w)};
    return units;
}

// Bounds that may have underflowed count as what they are less than: those of a ray along an axis through a vertex.
bool is_surely_zero(DoubleDouble number, float bound, double half_unit) {
    return bound <= FLT_MAX && fabs(number.x) + (double)larger(bound, 2.0f * LEAST_CLOSER_BOUND) < half_unit;
}

// The signs that are certain, else 0; and which of the weights are zero for certain: bit i.
typedef struct {
    int det, weight0, weight1, weight2;
    uint zeros;
    bool is_det_zero;
} CloserSigns;

CloserSigns closer_signs(const CloserNumbers* n, double half_unit) {
    CloserSigns s = {sure_sign_closer(n->det, n->det_bound),
                     sure_sign_closer(n->weight0, n->bound0),
                     sure_sign_closer(n->weight1, n->bound1),
                     sure_sign_closer(n->weight2, n->bound2),
                     0u,
                     is_surely_zero(n->det, n->det_bound, half_unit)};
    if (is_surely_zero(n->weight0, n->bound0, half_unit)) s.zeros |= 1u;
    if (is_surely_zero(n->weight1, n->bound1, half_unit)) s.zeros |= 2u;
    if (is_surely_zero(n->weight2, n->bound2, half_unit)) s.zeros |= 4u;
    return s;
}

// The corners of a triangle that are that point, as bits.
uint corners_at(const Corners* q, float3 point) {
    return (all(q->p0 == point) ? 1u : 0u) | (all(q->p1 == point) ? 2u : 0u) | (all(q->p2 == point) ? 4u : 0u);
}

// Zero weights tell the vertex of a triangle, or the edge, that a ray meets: its ends, which are one for a vertex, as
// the first and the last corner of any weight.
float3 first_of_zeros(uint zeros, const Corners* p) {
    return (zeros & 1u) == 0u ? p->p0 : (zeros & 2u) == 0u ? p->p1 : p->p2;
}
float3 last_of_zeros(uint zeros, const Corners* p) {
    return (zeros & 4u) == 0u ? p->p2 : (zeros & 2u) == 0u ? p->p1 : p->p0;
}

// If q has that vertex or edge of p, too, the zero weights of the same point in q; else 0. There the ray meets q, too,
// unless it is in the plane of q.
uint zeros_of_same_point(uint zeros, const Corners* p, const Corners* q) {
    if (zeros == 0u) return 0u;
    const uint first = corners_at(q, first_of_zeros(zeros, p)), last = corners_at(q, last_of_zeros(zeros, p));
    return first == 0u || last == 0u ? 0u : 7u & ~(first | last);
}

// Whether numerator / denominator, off by no more than the bounds and multiples of twice `half_unit` and `half_of_det`,
// surely rounds to the float *rounded.
RARE bool rounds_surely_closer(DoubleDouble numerator, float numerator_bound, double half_unit,
                               DoubleDouble denominator, float denominator_bound, double half_of_det,
                               float* rounded) {
    const double inverse = 1.0 / denominator.x;
    const double relative = (double)denominator_bound * fabs(inverse);
    if (!is_closer_bound(numerator_bound) || !is_closer_bound(denominator_bound) || !(relative < MOST_DET_ERROR))
        return false;
    const double beside = (double)numerator_bound * fabs(inverse);
    // Mostly one double tells: the second ones, two roundings of a product and those here make less than 2^-50 of it.
    const double rough = numerator.x * inverse;
    const double rough_error = 1.01 * (fabs(rough) * (relative + 0x1p-50) + beside);
    *rounded = (float)(rough + rough_error);
    if ((float)(rough - rough_error) == *rounded) return true;
    const DoubleDouble quotient = dd_divide(numerator, denominator);
    const double error = 1.01 * (fabs(quotient.x) * (relative + 0x1p-100) + beside);
    const float low = dd_to_float(dd_add(quotient, (DoubleDouble)(-error, 0.0)));
    const float high = *rounded = dd_to_float(dd_add(quotient, (DoubleDouble)(error, 0.0)));
    if (low == high) return true;
    // Mostly the quotient is the middle between two floats, and of these the even one counts.
    if (next_up(low) != high) return false;
    const double middle = 0.5 * ((double)low + (double)high), half_gap = 0.5 * ((double)high - (double)low);
    const DoubleDouble product = dd_multiply(denominator, (DoubleDouble)(middle, 0.0));
    const DoubleDouble rest = dd_subtract(numerator, product);
    const double rest_bound = (double)numerator_bound + fabs(middle) * (double)denominator_bound +
                              0x1p-102 * (fabs(numerator.x) + fabs(product.x));
    if (fabs(rest.x) + rest_bound < fmin(half_unit, half_gap * half_of_det)) {
        if ((as_uint(low) & 1u) == 0u) *rounded = low;
        return true;
    }
    if ((rest.x > 0.0) != (denominator.x > 0.0)) *rounded = low;
    return fabs(rest.x) > rest_bound;
}

// The t of a ray that starts on no triangle, where it meets one in a plane across an axis: a difference of two floats
// by a third. How that rounds is certain, whatever the numbers on the other axes are; seen along an axis, as walls are
// to a camera that looks along the room, it is often the middle between two floats.
//
// A double holds the product of two floats, and mostly the difference. The quotient in doubles rounds to the float
// nearest to it or to one beside that, so what is left of the difference is a double, too, and where it is more than
// half of what the gap between these two floats comes to, it is the other one.
RARE bool rounds_across_axis(const TrianglePoint* start, float3 direction, const Corners* corners, float* t) {
    const float3 plane = corners->p0, from = start->base;
    const int3 across = plane == corners->p1 && plane == corners->p2 && direction != (float3)(0.0f);
    if (!any(across) || start->weight1 != 0.0f || start->weight2 != 0.0f) return false;
    const DoubleDouble distance = across.x   ? dd_difference(plane.x, from.x)
                                  : across.y ? dd_difference(plane.y, from.y)
                                             : dd_difference(plane.z, from.z);
    const double along = (double)(across.x ? direction.x : across.y ? direction.y : direction.z);
    *t = (float)(distance.x / along);
    const double rest = fma(-(double)*t, along, distance.x);
    const float beside = (rest > 0.0) == (along > 0.0) ? next_up(*t) : next_down(*t);
    const double half_gap = 0.5 * fabs(((double)beside - (double)*t) * along);
    if (fabs(rest) > half_gap || (fabs(rest) == half_gap && (as_uint(*t) & 1u) != 0u)) *t = beside;
    return distance.y == 0.0 && (distance.x == 0.0 || (fabs(*t) > LEAST_MAGNITUDE && fabs(*t) < FLT_MAX));
}

// Where a triangle has to be hit to be the nearest hit: the ray's limits of t, and those of the t of the nearest hit so
// far, whose corners are `best`. If there is none, both are t_far. is_lower: whether the triangle has a lower number
// than that hit.
typedef struct {
    float t_near, t_far, t_best_low, t_best_high;
    Corners best;
    bool has_best, is_lower;
    bool starts_on_triangle; // such a ray leaves what it meets at t = 0
} CloserLimits;

// What becomes of a triangle that is met at t = 0, which is a limit of the ray only if it is one of the caller's
// (own_limit in ray.cl). Where the hit so far may be there, too, exact integers compare the two: it would take a chain
// of calls that is deeper than all others (ONE_COPY in compiler.cl).
void decide_at_start(const CloserLimits* limits, ExtendedDecision* result) {
    if (limits->t_near > 0.0f || limits->t_far < 0.0f || limits->t_best_high < 0.0f ||
        (limits->starts_on_triangle && limits->t_near == 0.0f))
        result->decision = MISS;
    else if (!limits->has_best || limits->t_best_low > 0.0f)
        result->decision = HIT;
    result->t_low = next_down(0.0f);
    result->t_high = next_up(0.0f);
}

// As decide_extended and place_hit, of a ray that starts at `start`. *zeros of a triangle that is hit: the bits of its
// weights that are surely zero.
RARE ExtendedDecision decide_closer(TrianglePoint start, float3 direction, const Corners* corners,
                                    const CloserLimits* limits, uint* zeros) {
    ExtendedDecision result = {UNDECIDED, -INFINITY, INFINITY, false};
    CloserNumbers n;
    closer_numbers(&start, direction, corners, &n);
    const HalfUnits units = half_closer_units(&start, direction, corners);
    const CloserSigns signs = closer_signs(&n, units.of_weights);
    // A ray in the triangle's plane has D = 0 and never hits.
    if (signs.is_det_zero || signs.weight0 * signs.weight1 < 0 || signs.weight1 * signs.weight2 < 0 ||
        signs.weight2 * signs.weight0 < 0)
        result.decision = MISS;
    if (signs.det == 0 || (signs.weight0 != signs.det && (signs.zeros & 1u) == 0u) ||
        (signs.weight1 != signs.det && (signs.zeros & 2u) == 0u) ||
        (signs.weight2 != signs.det && (signs.zeros & 4u) == 0u))
        return result;
    *zeros = signs.zeros;
    if (limits->has_best && zeros_of_same_point(signs.zeros, corners, &limits->best) != 0u) {
        result.decision = limits->is_lower ? HIT : MISS;
        result.t_low = limits->t_best_low;
        result.t_high = limits->t_best_high;
        return result;
    }
    float t;
    const bool is_across = rounds_across_axis(&start, direction, corners, &t);
    if ((is_across && t == 0.0f) || is_surely_zero(n.distance, n.distance_bound, units.of_t)) {
        decide_at_start(limits, &result);
        return result;
    }
    const bool is_rounded = is_across || rounds_surely_closer(n.distance, n.distance_bound, units.of_t, n.det,
                                                              n.det_bound, units.of_weights, &t);
    if (!is_rounded || !(fabs(t) > LEAST_MAGNITUDE)) return result; // on which side of a limit it is, is open
    if (t < limits->t_near || t > limits->t_far || t > limits->t_best_high) {
        result.decision = MISS;
        return result;
    }
    if (t == limits->t_near || t == limits->t_far) return result;
    if (t >= limits->t_best_low) {
        CloserNumbers best;
        closer_numbers(&start, direction, &limits->best, &best);
        // T D' - T' D and a bound of its error; 12 u^2 for its own two products and difference.
        const DoubleDouble difference =
            dd_subtract(dd_multiply(n.distance, best.det), dd_multiply(best.distance, n.det));
        const double error =
            1.01 * (fabs(n.distance.x) * (double)best.det_bound + fabs(best.det.x) * (double)n.distance_bound +
                    fabs(best.distance.x) * (double)n.det_bound + fabs(n.det.x) * (double)best.distance_bound +
                    0x1p-102 * (fabs(n.distance.x * best.det.x) + fabs(best.distance.x * n.det.x)));
        if (!is_closer_bound(best.det_bound) || !is_closer_bound(best.distance_bound)) return result;
        if (!(fabs(difference.x) > error)) return result;
        if ((difference.x > 0.0) == ((n.det.x > 0.0) == (best.det.x > 0.0))) {
            result.decision = MISS;
            return result;
        }
    }
    result.decision = HIT;
    result.t_low = next_down(t);
    result.t_high = next_up(t);
    return result;
}

// A weight, the float nearest to numerator / D, if that is certain.
bool finish_weight_closer(DoubleDouble numerator, float bound, const CloserNumbers* n, double half_unit,
                          float* weight) {
    *weight = 0.0f;
    return is_surely_zero(numerator, bound, half_unit) ||
           rounds_surely_closer(numerator, bound, half_unit, n->det, n->det_bound, half_unit, weight);
}

// t and the weights of a triangle that is hit.
RARE FinishedHit finish_closer(TrianglePoint start, float3 direction, const Corners* corners) {
    CloserNumbers n;
    closer_numbers(&start, direction, corners, &n);
    const HalfUnits units = half_closer_units(&start, direction, corners);
    FinishedHit hit;
    hit.t = 0.0f;
    const bool is_across = rounds_across_axis(&start, direction, corners, &hit.t);
    hit.at_start = (is_across && hit.t == 0.0f) || is_surely_zero(n.distance, n.distance_bound, units.of_t);
    if (hit.at_start) hit.t = 0.0f;
    hit.is_sure = (is_across || hit.at_start ||
                   rounds_surely_closer(n.distance, n.distance_bound, units.of_t, n.det, n.det_bound,
                                        units.of_weights, &hit.t)) &&
                  finish_weight_closer(n.weight1, n.bound1, &n, units.of_weights, &hit.u) &&
                  finish_weight_closer(n.weight2, n.bound2, &n, units.of_weights, &hit.v) &&
                  finish_weight_closer(n.weight0, n.bound0, &n, units.of_weights, &hit.weight0);
    return hit;
}
#endif
