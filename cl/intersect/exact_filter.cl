// Ray-triangle intersection that is right: hit or miss as exact arithmetic decides it for the float32 numbers given, t,
// u and v the floats nearest to the exact values, and of two hits the one that is exactly nearer.
//
// Four filters, after Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates",
// Discrete & Computational Geometry 18, 1997, with exact integers in place of his expansions, which underflow:
//  1. float32 edge functions (watertight.cl) and bounds of their error decide nearly every triangle, hit or miss, and
//     which of two hits is nearer: a hit is known by an interval that holds its t.
//  2. Arithmetic of twice the precision (cl/shared/extended.cl) with bounds decides nearly all the rest.
//  3. Where there is double, four times the precision (exact_closer.cl), which mostly tells that a number is zero, too:
//     rays exactly through edges and vertices.
//  4. Exact integers (exact_integers.cl) decide what is left, of these, of rays in planes and of equal distances.
// Registers for calls in the loop over the triangles would slow down all of it: kernels postpone what step 1 leaves
// open until the traversal is done, and leave step 4 to a second pass over the few rays concerned (postpone and
// DECIDE_BY_INTEGERS in cl/memory/deferral.cl).
// t, u and v are computed once, for the triangle that the traversal has found, in the arithmetic of steps 2 to 4.
// Every step only decides what is certain, so the answer does not depend on the kind of arithmetic of step 2: it is the
// same on devices with and without double. Weakness: the instructions of the second step.

#define MISS 0
#define HIT 1
#define UNDECIDED 2

// Step 1. The edge functions and the bound of their error are in edges.cl.
//
// In sheared space the ray is the z axis, and it meets the triangle at z = t direction_z, the mean of the vertices' z
// weighted by the edge functions. These, each off by `bound`, move that mean by at most 3 bound spread / |their sum|,
// where spread is the vertices' extent in z. The z are off by 5 EPSILON of the largest, Z; the sums, reciprocals and
// products that give t round by 3 + 2 + 10 + 2 EPSILON Z: 22, and the last room is for the rounding of the bound.
// |direction_z| is at least 1. Three products may underflow, each by up to 2^-126; their sum is divided by more than
// LEAST_EDGE. SPREAD_ERROR is the 3 and a tenth, DEPTH_ERROR 26, LEAST_DEPTH what underflows.

// Whether a triangle that is not surely missed is hit, and limits of the hit's t, if there is one: undecided those of
// all the triangle.
int decide_rounded(const ShearedTriangle* s, const Edges e, float* t_low, float* t_high) {
    const float nearest = smaller(s->az, smaller(s->bz, s->cz)), farthest = larger(s->az, larger(s->bz, s->cz));
    const float depth_error = fma(DEPTH_ERROR, larger(fabs(nearest), fabs(farthest)), LEAST_DEPTH);
    if (!(e.low > e.bound || e.high < -e.bound)) {
        const float t_nearest = nearest * s->inv_direction_z, t_farthest = farthest * s->inv_direction_z;
        *t_low = smaller(t_nearest, t_farthest) - depth_error;
        *t_high = larger(t_nearest, t_farthest) + depth_error;
        return UNDECIDED;
    }
    const float det = e.weight0 + e.weight1 + e.weight2;
    const float z_weighted = fma(e.weight0, s->az, fma(e.weight1, s->bz, e.weight2 * s->cz));
    const float inv_det = 1.0f / det;
    const float t = z_weighted * inv_det * s->inv_direction_z;
    const float error = fma(SPREAD_ERROR * e.bound, (farthest - nearest) * fabs(inv_det), depth_error);
    *t_low = t - error;
    *t_high = t + error;
    return HIT;
}

// What limits of its t say of a hit: whether it is inside of the ray's interval and nearer than *hit, of which t and u
// are limits, too, as long as the traversal goes on (no_hit_yet() in ray.cl). NaN says nothing. The interval may be off
// by less than a float's last bit, so that a float beyond its end is beyond what was given, too.
int place_hit(const Ray* ray, const Hit* hit, float t_low, float t_high) {
    if (t_high < ray->t_near || t_low > hit->t) return MISS;
    return t_low > ray->t_near && t_high < hit->u ? HIT : UNDECIDED;
}

// Step 2. The numbers behind every answer, with a = p0 - start, e1 and e2 the edges from p0, N = e1 x e2, c = a x
// direction:
//     T = N . a,  D = N . direction,  t = T / D;
//     U = e2 . c,  V = -e1 . c,  W = D - U - V: D times the vertices' weights.
// None of them is off by more than 9 EXTENDED_EPSILON P: 1 for an edge, 2 for a, 2 for a vector product, 3 for a sum of
// three products; W by 3 more. P, the same expression of magnitudes, is computed in float32, which EXTENDED_ERROR, 10
// EXTENDED_EPSILON, and EXTENDED_ERROR_W, 14 of them, leave room for.
// a is off by 2 EPSILON of the start's second part, too (start_on_triangle), as if its magnitude were larger by
// START_ERROR, 4 EPSILON / EXTENDED_ERROR, times that part. And by what no float is small enough for (PLANE_ERROR in
// ray.cl): each of nine terms by up to 2^-149, which the bounds are to cover whatever direction it is multiplied by, be
// it lifted to 2^61 (LEAST_FROM).
// Below LEAST_MAGNITUDE a product of floats may have underflowed: nothing is certain.

typedef struct {
    Extended distance, det, weight0, weight1, weight2; // T, D, W, U, V
    float distance_bound, det_bound, bound0, bound1, bound2;
} ExtendedNumbers;

// Sum of the products of magnitudes: the P of a scalar product.
float magnitude_dot(float3 a, float3 b) { return dot3(abs3(a), abs3(b)); }
float3 magnitude_cross(float3 a, float3 b) {
    const float3 x = abs3(a), y = abs3(b);
    return x.yzx * y.zxy + x.zxy * y.yzx;
}

// Values instead of a pointer to the ray: its address would keep the ray out of registers.
void extended_numbers(float3 origin, float3 origin_low, float3 ray_direction, float3 p0, float3 p1, float3 p2,
                      ExtendedNumbers* n) {
    const Extended3 edge1 = extended3_difference(p1, p0);
    const Extended3 edge2 = extended3_difference(p2, p0);
    const Extended3 low = extended3_from(origin_low);
    const Extended3 from_high = extended3_difference(p0, origin);
    const Extended3 from = extended3_subtract(&from_high, &low);
    const Extended3 direction = extended3_from(ray_direction);
    const Extended3 normal = extended3_cross(&edge1, &edge2);
    const Extended3 moment = extended3_cross(&from, &direction);
    n->distance = extended3_dot(&normal, &from);
    n->det = extended3_dot(&normal, &direction);
    n->weight1 = extended3_dot(&edge2, &moment);
    n->weight2 = extended_subtract(extended_from(0.0f), extended3_dot(&edge1, &moment));
    n->weight0 = extended_subtract(extended_subtract(n->det, n->weight1), n->weight2);

    const float3 magnitude1 = p1 - p0, magnitude2 = p2 - p0; // cheaper than what extended numbers round to
    const float3 from_magnitude = fma3(abs3(origin_low), START_ERROR, abs3((p0 - origin) - origin_low)) + LEAST_FROM;
    const float3 normal_magnitude = magnitude_cross(magnitude1, magnitude2);
    const float3 moment_magnitude = magnitude_cross(from_magnitude, ray_direction);
    const float det_magnitude = magnitude_dot(normal_magnitude, ray_direction);
    const float magnitude_1 = magnitude_dot(magnitude2, moment_magnitude);
    const float magnitude_2 = magnitude_dot(magnitude1, moment_magnitude);
    n->distance_bound = EXTENDED_ERROR * magnitude_dot(normal_magnitude, from_magnitude);
    n->det_bound = EXTENDED_ERROR * det_magnitude;
    n->bound0 = EXTENDED_ERROR_W * (det_magnitude + magnitude_1 + magnitude_2);
    n->bound1 = EXTENDED_ERROR * magnitude_1;
    n->bound2 = EXTENDED_ERROR * magnitude_2;
}

// Whether a bound is one: not so small that what it bounds may have underflowed, and not NaN or infinite.
bool is_bound(float bound) { return bound > LEAST_MAGNITUDE * EXTENDED_EPSILON && bound <= FLT_MAX; }

// -1 or 1 where that is the number's sign for certain, else 0.
int sure_sign(Extended number, float bound) {
    const float value = extended_to_float(number);
    if (!is_bound(bound)) return 0;
    return value > bound ? 1 : value < -bound ? -1 : 0;
}

typedef struct {
    int decision;
    float t_low, t_high; // of a hit
    bool crosses;        // whether the ray is surely not parallel to the triangle's plane
} ExtendedDecision;

// Hit, miss or undecided, and limits of a hit's t. A call, because it is rare, and its registers are not wanted in the
// loop over the triangles.
RARE ExtendedDecision decide_extended(float3 origin, float3 origin_low, float3 direction, float3 p0, float3 p1,
                                      float3 p2) {
    ExtendedNumbers n;
    extended_numbers(origin, origin_low, direction, p0, p1, p2, &n);
    const int sign = sure_sign(n.det, n.det_bound);
    ExtendedDecision result = {UNDECIDED, -INFINITY, INFINITY, sign != 0};
    const int sign0 = sure_sign(n.weight0, n.bound0);
    const int sign1 = sure_sign(n.weight1, n.bound1);
    const int sign2 = sure_sign(n.weight2, n.bound2);
    if (sign0 * sign1 < 0 || sign1 * sign2 < 0 || sign2 * sign0 < 0) result.decision = MISS;
    if (sign == 0 || sign0 != sign || sign1 != sign || sign2 != sign || !is_bound(n.distance_bound)) return result;
    const float t = extended_to_float(extended_divide(n.distance, n.det));
    // |D| is above its bound: by more than a rounding, as both are floats. The 4 EPSILON are for the roundings of t and
    // its limits; a smaller t loses bits, and only a comparison of T itself with zero would help.
    const float error =
        QUOTIENT_MARGIN * fma(fabs(t), n.det_bound, n.distance_bound) / (fabs(extended_to_float(n.det)) - n.det_bound);
    if (!(fabs(t) > LEAST_MAGNITUDE)) return result;
    result.decision = HIT;
    result.t_low = t - fma(4.0f * EPSILON, fabs(t), error);
    result.t_high = t + fma(4.0f * EPSILON, fabs(t), error);
    return result;
}

// 1 / D for the quotients T / D and so on, and how far D is off relative to itself.
typedef struct {
    Extended inverse;
    float det_error;
    bool is_sure; // that it is small enough for the bounds here
} ExtendedInverse;

ExtendedInverse invert_det(const ExtendedNumbers* n) {
    const float det_error = n->det_bound / fabs(extended_to_float(n->det));
    const ExtendedInverse inverse = {extended_divide(extended_from(1.0f), n->det), det_error,
                                     is_bound(n->det_bound) && det_error < MOST_DET_ERROR};
    return inverse;
}

// Whether numerator / D, the numerator off by no more than the bound, surely rounds to the float *rounded.
bool rounds_surely(Extended numerator, float bound, const ExtendedInverse* det, float* rounded) {
    const Extended quotient = extended_multiply(numerator, det->inverse);
    // QUOTIENT_MARGIN: what is left out here of the quotient of two sums; 8: roundings of inverse, product and
    // comparison.
    const float error = fma(QUOTIENT_MARGIN * bound, fabs(extended_to_float(det->inverse)),
                            fabs(extended_to_float(quotient)) *
                                fma(QUOTIENT_MARGIN, det->det_error, 8.0f * EXTENDED_EPSILON));
    // Of smaller quotients the error may have underflowed.
    return is_bound(bound) && extended_rounds_surely(quotient, error, rounded) && fabs(*rounded) > LEAST_MAGNITUDE;
}

// t, if it is wanted, and the weights of a triangle that is hit, if that is sure: the floats nearest to them. Else 0,
// and the weight of vertex 0 only if it is not the largest one, which the others tell.
typedef struct {
    bool is_sure;
    float t, weight0, u, v;
    bool at_start; // t is 0 exactly, which only more precision tells (exact_closer.cl)
} FinishedHit;

FinishedHit finish_extended(float3 origin, float3 origin_low, float3 direction, float3 p0, float3 p1, float3 p2,
                            const bool wants_t) {
    ExtendedNumbers n;
    extended_numbers(origin, origin_low, direction, p0, p1, p2, &n);
    const ExtendedInverse det = invert_det(&n);
    FinishedHit hit = {false, 0.0f, 0.0f, 0.0f, 0.0f, false};
    hit.is_sure = det.is_sure && rounds_surely(n.weight1, n.bound1, &det, &hit.u) &&
                  rounds_surely(n.weight2, n.bound2, &det, &hit.v);
    if (wants_t) hit.is_sure = hit.is_sure && rounds_surely(n.distance, n.distance_bound, &det, &hit.t);
    hit.weight0 = (1.0f - hit.u) - hit.v;
    if (!wants_t && !is_nearest_vertex0(hit.u, hit.v))
        hit.is_sure = hit.is_sure && rounds_surely(n.weight0, n.bound0, &det, &hit.weight0);
    return hit;
}

// Where the ray starts, exactly.
TrianglePoint start_of_ray(GEOMETRY_PARAMETERS, const Ray* ray) {
    TrianglePoint point = {ray->origin, ray->origin, ray->origin, 0.0f, 0.0f};
    if (starts_on_triangle(ray))
        point =
            point_of_weights(LOAD_SURFACE_VERTEX(geometry, ray->skip, 0), LOAD_SURFACE_VERTEX(geometry, ray->skip, 1),
                             LOAD_SURFACE_VERTEX(geometry, ray->skip, 2), ray->start_weights);
    return point;
}
