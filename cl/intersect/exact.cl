// Ray-triangle intersection that is right: hit or miss as exact arithmetic decides it for the float32 numbers given, t, u and v
// the floats nearest to the exact values, and of two hits the one that is exactly nearer.
//
// Three filters, after Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", Discrete &
// Computational Geometry 18, 1997, with whole numbers in place of his expansions, which underflow:
//  1. float32 edge functions (watertight.cl) and a bound of their error discard nearly every triangle that the ray misses.
//  2. Arithmetic of twice the precision (cl/shared/wide.cl) with bounds decides nearly all the rest.
//  3. Whole numbers (cl/shared/integer.cl) decide what is left: rays through edges and vertices, in planes, equal distances.
// Every step only decides what is certain, so the answer does not depend on the kind of arithmetic of step 2: it is the same on
// devices with and without double. Weakness: the second step's instructions, and registers where hits are many.

// Step 1. With M the largest coordinate of a vertex relative to the origin and H the largest sheared coordinate, to first order:
// a difference is off by 2 EPSILON M, the shear's quotient by up to 5 EPSILON (2.5 ulp on some devices) and its product by 1, which
// its factor M passes on, the difference in it by 2 more, and the fma rounds by 2 M: a sheared coordinate is off by
// delta = (2 + 6 + 2 + 2) EPSILON M = 12 EPSILON M. An edge function of two vertices is off by 4 H delta + 2 delta^2 and, by
// itself, 1.5 ulp of at most 2 H^2, which is below 6 EPSILON H 2 M: (48 + 12) EPSILON M H + 288 EPSILON^2 M^2. The constants
// leave room for the second order, for the roundings of H and M, and of the bound itself.
#define SHEAR_ERROR (64.0f * EPSILON)
#define SHEAR_ERROR2 (320.0f * EPSILON * EPSILON)

bool surely_misses(const ShearedTriangle* s, float distance) {
    const float bound = distance * fma(SHEAR_ERROR, s->extent, SHEAR_ERROR2 * distance);
    const float low = min_or(s->weight0, min_or(s->weight1, s->weight2));
    const float high = max_or(s->weight0, max_or(s->weight1, s->weight2));
    return low < -bound && high > bound;
}

// Step 2. The numbers behind every answer, with a = p0 - origin, e1 and e2 the edges from p0, N = e1 x e2, c = a x direction:
//     T = N . a,  D = N . direction,  t = T / D;   U = e2 . c,  V = -e1 . c,  W = D - U - V: D times the vertices' weights.
// None of them is off by more than 9 WIDE_EPSILON P: 1 for an edge, 2 for a, 2 for a vector product, 3 for a sum of three products;
// W by 3 more. P, the same expression of magnitudes, is computed in float32, which the constants leave room for.
#define WIDE_ERROR (10.0f * WIDE_EPSILON)
#define WIDE_ERROR_W (14.0f * WIDE_EPSILON)
// Below this a product of floats may have underflowed: nothing is certain.
#define LEAST_MAGNITUDE 0x1p-80f

// -1 or 1 where that is the number's sign for certain, else 0.
int sure_sign(Wide number, float bound) {
    const float value = wide_to_float(number);
    if (!(bound > LEAST_MAGNITUDE * WIDE_EPSILON)) return 0;
    return value > bound ? 1 : value < -bound ? -1 : 0;
}

// Whether numerator / denominator, off by no more than the bounds, surely rounds to the float *rounded.
bool rounds_surely(Wide numerator, float numerator_bound, Wide denominator, float denominator_bound, float* rounded) {
    const float relative =
        numerator_bound / fabs(wide_to_float(numerator)) + denominator_bound / fabs(wide_to_float(denominator));
    const Wide quotient = wide_divide(numerator, denominator);
    // 1.01: what is left out here of the quotient of two sums; 8: roundings of the division and of the comparison.
    const float error = fabs(wide_to_float(quotient)) * fma(1.01f, relative, 8.0f * WIDE_EPSILON);
    return relative < 0x1p-10f && wide_rounds_surely(quotient, error, rounded);
}

// Sum of the products of magnitudes: the P of a scalar product.
float magnitude_dot(float3 a, float3 b) { return dot3(abs3(a), abs3(b)); }
float3 magnitude_cross(float3 a, float3 b) {
    const float3 x = abs3(a), y = abs3(b);
    return x.yzx * y.zxy + x.zxy * y.yzx;
}

#define MISS 0
#define HIT 1
#define DOUBTFUL 2

int intersect_wide(const Ray* ray, float3 p0, float3 p1, float3 p2, float* t, float* u, float* v) {
    const Wide3 edge1 = wide3_difference(p1, p0);
    const Wide3 edge2 = wide3_difference(p2, p0);
    const Wide3 low = wide3_from(ray->origin_low);
    const Wide3 from_high = wide3_difference(p0, ray->origin);
    const Wide3 from = wide3_subtract(&from_high, &low);
    const Wide3 direction = wide3_from(ray->direction);
    const Wide3 normal = wide3_cross(&edge1, &edge2);
    const Wide3 moment = wide3_cross(&from, &direction);
    const Wide distance = wide3_dot(&normal, &from);
    const Wide det = wide3_dot(&normal, &direction);
    const Wide weight1 = wide3_dot(&edge2, &moment);
    const Wide weight2 = wide_subtract(wide_from(0.0f), wide3_dot(&edge1, &moment));
    const Wide weight0 = wide_subtract(wide_subtract(det, weight1), weight2);

    const float3 magnitude1 = wide3_to_float(&edge1), magnitude2 = wide3_to_float(&edge2);
    const float3 from_magnitude = wide3_to_float(&from);
    const float3 normal_magnitude = magnitude_cross(magnitude1, magnitude2);
    const float3 moment_magnitude = magnitude_cross(from_magnitude, ray->direction);
    const float det_magnitude = magnitude_dot(normal_magnitude, ray->direction);
    const float magnitude_1 = magnitude_dot(magnitude2, moment_magnitude);
    const float magnitude_2 = magnitude_dot(magnitude1, moment_magnitude);
    const float det_bound = WIDE_ERROR * det_magnitude;
    const float bound1 = WIDE_ERROR * magnitude_1, bound2 = WIDE_ERROR * magnitude_2;

    const int sign = sure_sign(det, det_bound);
    const int sign0 = sure_sign(weight0, WIDE_ERROR_W * (det_magnitude + magnitude_1 + magnitude_2));
    const int sign1 = sure_sign(weight1, bound1);
    const int sign2 = sure_sign(weight2, bound2);
    if (sign0 * sign1 < 0 || sign1 * sign2 < 0 || sign2 * sign0 < 0) return MISS;
    if (sign == 0 || sign0 != sign || sign1 != sign || sign2 != sign) return DOUBTFUL;
    const float distance_bound = WIDE_ERROR * magnitude_dot(normal_magnitude, from_magnitude);
    return rounds_surely(distance, distance_bound, det, det_bound, t) &&
                   rounds_surely(weight1, bound1, det, det_bound, u) && rounds_surely(weight2, bound2, det, det_bound, v)
               ? HIT
               : DOUBTFUL;
}

// Step 3. The same numbers, whole. Positions are in units of 2^position, directions of 2^direction; n limbs hold every number here.
typedef struct {
    int position, direction;
    int n;
} WholeUnits;

// The units of a ray and `count` triangles (three vertices each). Let p and d be the bits of the largest position and direction. A
// difference has p + 1 bits, N and c have 2 p + 3 and p + d + 2, T 3 p + 6, the others 2 p + d + 6; a comparison of two t multiplies T
// by D: 5 p + d + 12. A quotient needs 26 bits to spare, a comparison with a limit 24, and all need a sign. MAX_LIMBS suffice for
// p = 217: positions whose largest is 10^65 times the last bit of the smallest. Beyond that the lowest bits of positions go.
WholeUnits whole_units(const Ray* ray, const float3* vertices, int count) {
    int low_p = 1000, high_p = -1000, low_d = 1000, high_d = -1000;
    for (int i = -2; i < 3 * count; i++) {
        const float3 p = i == -2 ? ray->origin_low : i == -1 ? ray->origin : vertices[i];
        widen_exponents(p.x, &low_p, &high_p);
        widen_exponents(p.y, &low_p, &high_p);
        widen_exponents(p.z, &low_p, &high_p);
    }
    widen_exponents(ray->direction.x, &low_d, &high_d);
    widen_exponents(ray->direction.y, &low_d, &high_d);
    widen_exponents(ray->direction.z, &low_d, &high_d);
    WholeUnits units;
    units.position = low_p;
    units.direction = low_d;
    int bits_p = max(high_p - low_p, 1);
    const int bits_d = max(high_d - low_d, 1);
    const int most = (32 * MAX_LIMBS - 40 - bits_d) / 5;
    if (bits_p > most) {
        units.position += bits_p - most;
        bits_p = most;
    }
    units.n = ((count > 1 ? 5 * bits_p + bits_d + 40 : 3 * max(bits_p, bits_d) + 34) + 31) / 32;
    return units;
}

typedef struct {
    Integer distance, det, weight1, weight2; // T, D, U, V
} WholeNumbers;

void whole_numbers(const Ray* ray, const float3* vertices, const WholeUnits* units, WholeNumbers* numbers) {
    const int n = units->n;
    Integer edge1[3], edge2[3], from[3], direction[3];
    const float origin[3] = {ray->origin.x, ray->origin.y, ray->origin.z};
    const float origin_low[3] = {ray->origin_low.x, ray->origin_low.y, ray->origin_low.z};
    const float along[3] = {ray->direction.x, ray->direction.y, ray->direction.z};
    const float p0[3] = {vertices[0].x, vertices[0].y, vertices[0].z};
    const float p1[3] = {vertices[1].x, vertices[1].y, vertices[1].z};
    const float p2[3] = {vertices[2].x, vertices[2].y, vertices[2].z};
    for (int k = 0; k < 3; k++) {
        Integer corner, start;
        integer_from_float(&corner, p0[k], units->position, n);
        integer_from_float(&start, origin[k], units->position, n);
        integer_from_float(&edge1[k], p1[k], units->position, n);
        integer_from_float(&edge2[k], p2[k], units->position, n);
        integer_from_float(&direction[k], along[k], units->direction, n);
        from[k] = corner;
        integer_add(&edge1[k], &corner, -1, n);
        integer_add(&edge2[k], &corner, -1, n);
        integer_add(&from[k], &start, -1, n);
        integer_from_float(&start, origin_low[k], units->position, n);
        integer_add(&from[k], &start, -1, n);
    }
    integer_set_zero(&numbers->distance, n);
    integer_set_zero(&numbers->det, n);
    integer_set_zero(&numbers->weight1, n);
    integer_set_zero(&numbers->weight2, n);
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        Integer component;
        integer_set_zero(&component, n); // of N
        integer_add_product(&component, &edge1[i], &edge2[j], 1, n);
        integer_add_product(&component, &edge1[j], &edge2[i], -1, n);
        integer_add_product(&numbers->distance, &component, &from[k], 1, n);
        integer_add_product(&numbers->det, &component, &direction[k], 1, n);
        integer_set_zero(&component, n); // of c
        integer_add_product(&component, &from[i], &direction[j], 1, n);
        integer_add_product(&component, &from[j], &direction[i], -1, n);
        integer_add_product(&numbers->weight1, &component, &edge2[k], 1, n);
        integer_add_product(&numbers->weight2, &component, &edge1[k], -1, n);
    }
}

RARE bool intersect_whole(const Ray* ray, float3 p0, float3 p1, float3 p2, float* t, float* u, float* v) {
    if (!(ray->t_near <= ray->t_far)) return false; // NaN or infinite: not a ray
    const float3 vertices[3] = {p0, p1, p2};
    const WholeUnits units = whole_units(ray, vertices, 1);
    WholeNumbers numbers;
    whole_numbers(ray, vertices, &units, &numbers);
    Integer weight0 = numbers.det;
    integer_add(&weight0, &numbers.weight1, -1, units.n);
    integer_add(&weight0, &numbers.weight2, -1, units.n);
    const int sign = integer_sign(&numbers.det, units.n);
    // A ray in the triangle's plane has D = 0 and never hits.
    if (sign == 0 || sign * integer_sign(&weight0, units.n) < 0 || sign * integer_sign(&numbers.weight1, units.n) < 0 ||
        sign * integer_sign(&numbers.weight2, units.n) < 0)
        return false;
    Integer det = numbers.det;
    *t = integer_quotient(&numbers.distance, &det, units.position - units.direction, units.n);
    det = numbers.det;
    *u = integer_quotient(&numbers.weight1, &det, 0, units.n);
    det = numbers.det;
    *v = integer_quotient(&numbers.weight2, &det, 0, units.n);
    return is_finite(*t);
}

bool intersect_exact(GEOMETRY_PARAMETERS, const Ray* ray, uint slot, float* t, float* u, float* v) {
    const float3 p0 = LOAD_VERTEX(geometry, slot, 0);
    const float3 p1 = LOAD_VERTEX(geometry, slot, 1);
    const float3 p2 = LOAD_VERTEX(geometry, slot, 2);
    const ShearedTriangle sheared = shear_triangle(ray, p0, p1, p2);
    if (surely_misses(&sheared, farthest_distance(ray, geometry->low, geometry->high))) return false;
    const int result = intersect_wide(ray, p0, p1, p2, t, u, v);
    if (result == DOUBTFUL) return intersect_whole(ray, p0, p1, p2, t, u, v);
    return result == HIT;
}

// The sign of the exact t = T / D of a triangle minus `limit`, which is the float nearest to it. D > 0.
int compare_with_limit(const WholeNumbers* numbers, const WholeUnits* units, float limit) {
    int exponent;
    const float significand = (float)float_significand(limit, &exponent);
    Integer factor, distance = numbers->distance, scaled;
    integer_from_float(&factor, limit < 0.0f ? -significand : significand, 0, units->n);
    integer_set_zero(&scaled, units->n);
    integer_add_product(&scaled, &factor, &numbers->det, 1, units->n);
    const int shift = significand == 0.0f ? 0 : units->position - units->direction - exponent;
    if (shift > 0) integer_shift_up(&distance, shift, units->n);
    if (shift < 0) integer_shift_up(&scaled, -shift, units->n);
    integer_add(&distance, &scaled, -1, units->n);
    return integer_sign(&distance, units->n);
}

// As is_nearer_exactly, where a comparison of floats leaves it open.
RARE bool is_nearer_whole(GEOMETRY_PARAMETERS, const Ray* ray, const Hit* hit, float t, uint primitive, uint slot) {
    float3 corners[6];
    const bool is_tie = t == hit->t;
    for (uint i = 0; i < 3u; i++) {
        corners[i] = LOAD_VERTEX(geometry, slot, i);
        COUNT(geometry, TRIANGLE_BYTES, is_tie ? sizeof(float4) : 0);
        corners[i + 3u] = is_tie ? LOAD_SURFACE_VERTEX(geometry, hit->primitive, i) : corners[i];
    }
    const WholeUnits units = whole_units(ray, corners, 2);
    WholeNumbers numbers;
    whole_numbers(ray, corners, &units, &numbers);
    if (integer_take_sign(&numbers.det, units.n) < 0) {
        Integer distance = numbers.distance;
        integer_set_zero(&numbers.distance, units.n);
        integer_add(&numbers.distance, &distance, -1, units.n);
    }
    if (t == ray->t_near && compare_with_limit(&numbers, &units, ray->t_near) < 0) return false;
    if (t == ray->t_far && compare_with_limit(&numbers, &units, ray->t_far) > 0) return false;
    if (!is_tie) return true;
    WholeNumbers best;
    whole_numbers(ray, corners + 3, &units, &best);
    const int best_sign = integer_sign(&best.det, units.n);
    Integer difference; // T D' - T' D, times the sign of D'
    integer_set_zero(&difference, units.n);
    integer_add_product(&difference, &numbers.distance, &best.det, best_sign, units.n);
    integer_add_product(&difference, &best.distance, &numbers.det, -best_sign, units.n);
    const int order = integer_sign(&difference, units.n);
    return order < 0 || (order == 0 && primitive < hit->primitive);
}

// is_nearer() of cl/shared/ray.cl for t that is the exact one rounded: the order of the exact ones decides.
bool is_nearer_exactly(GEOMETRY_PARAMETERS, const Ray* ray, const Hit* hit, float t, uint primitive, uint slot) {
    if (!(t >= ray->t_near && t <= ray->t_far && t <= hit->t)) return false;
    if (t > ray->t_near && t < ray->t_far && t < hit->t) return true;
    if (primitive == hit->primitive) return false; // met again in another leaf
    return is_nearer_whole(GEOMETRY, ray, hit, t, primitive, slot);
}
