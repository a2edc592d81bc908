// The last step of exact_filter.cl, in exact integers (cl/shared/integer.cl): what rounded arithmetic of any precision
// cannot tell from zero.
//
// A ray that leaves a triangle starts at an exact point of it (point_of_weights in cl/shared/ray.cl), an integer, too,
// in units that are finer by the last bit of its weights.

// Positions are in units of 2^position; vertices and weights of the triangle that the ray starts on in units of
// 2^vertex and 2^weight, whose product that is; directions in units of 2^direction. n limbs hold every number here.
typedef struct {
    int position, vertex, weight, direction;
    int n;
} IntegerUnits;

// The units of a ray from `start` and of `count` triangles (three vertices each). Let p and d be the bits of the
// largest position and direction. A difference has p + 1 bits, N and c have 2 p + 3 and p + d + 2, T 3 p + 6, the
// others 2 p + d + 6; a comparison of two t multiplies T by D: 5 p + d + 12. A quotient needs 26 bits to spare, a
// comparison with a limit 25, and all need a sign (COMPARISON_BITS, QUOTIENT_BITS). MAX_LIMBS suffice for every ray:
// vertices are below 2^28 in tracing space, where the largest scenes are scaled by 2^-100 (src/pack.rs), and what is
// lowest of a float is 2^-149. A ray that starts at a point has p = 128 + 149. One that leaves a triangle starts at
// vertices times weights: p = 28 + 149 + 149. Directions have d = 61 + 149.
RARE IntegerUnits integer_units(const TrianglePoint* start, float3 direction, const float3* corners, int count) {
    int low_p = 1000, high_p = -1000, low_d = 1000, high_d = -1000, low_w = 0, high_w = 0;
    widen_exponents3(start->base, &low_p, &high_p);
    widen_exponents3(start->other1, &low_p, &high_p);
    widen_exponents3(start->other2, &low_p, &high_p);
#pragma unroll 1
    for (int i = 0; i < 3 * count; i++) widen_exponents3(corners[i], &low_p, &high_p);
    widen_exponents3(direction, &low_d, &high_d);
    widen_exponents(start->weight1, &low_w, &high_w);
    widen_exponents(start->weight2, &low_w, &high_w);
    IntegerUnits units;
    units.position = low_p + low_w;
    units.direction = low_d;
    const int bits_p = max(high_p - units.position, 1), bits_d = max(high_d - low_d, 1);
    units.weight = low_w;
    units.vertex = units.position - low_w;
    const int bits = count > 1 ? 5 * bits_p + bits_d + COMPARISON_BITS : 3 * max(bits_p, bits_d) + QUOTIENT_BITS;
    units.n = (bits + 31) / 32;
    return units;
}

typedef struct {
    Integer distance, det, weight1, weight2; // T, D, U, V
} IntegerNumbers;

// *sum += weight * (other - base), the latter two corners of the triangle that the ray starts on.
RARE void add_weighted(Integer* sum, float base, float other, float weight, const IntegerUnits* units) {
    if (weight == 0.0f) return;
    Integer edge, vertex;
    integer_from_float(&edge, other, units->vertex, units->n);
    integer_from_float(&vertex, base, units->vertex, units->n);
    integer_add(&edge, &vertex, -1, units->n);
    integer_from_float(&vertex, weight, units->weight, units->n);
    integer_add_product(sum, &vertex, &edge, 1, units->n);
}

RARE void integer_numbers(const TrianglePoint* start, float3 ray_direction, const float3* corners,
                          const IntegerUnits* units, IntegerNumbers* numbers) {
    const int n = units->n;
    Integer edge1[3], edge2[3], from[3], direction[3];
    const float base[3] = {start->base.x, start->base.y, start->base.z};
    const float other1[3] = {start->other1.x, start->other1.y, start->other1.z};
    const float other2[3] = {start->other2.x, start->other2.y, start->other2.z};
    const float along[3] = {ray_direction.x, ray_direction.y, ray_direction.z};
    const float p0[3] = {corners[0].x, corners[0].y, corners[0].z};
    const float p1[3] = {corners[1].x, corners[1].y, corners[1].z};
    const float p2[3] = {corners[2].x, corners[2].y, corners[2].z};
#pragma unroll 1
    for (int k = 0; k < 3; k++) {
        Integer corner, origin;
        integer_from_float(&corner, p0[k], units->position, n);
        integer_from_float(&origin, base[k], units->position, n);
        integer_from_float(&edge1[k], p1[k], units->position, n);
        integer_from_float(&edge2[k], p2[k], units->position, n);
        integer_from_float(&direction[k], along[k], units->direction, n);
        add_weighted(&origin, base[k], other1[k], start->weight1, units);
        add_weighted(&origin, base[k], other2[k], start->weight2, units);
        from[k] = corner;
        integer_add(&edge1[k], &corner, -1, n);
        integer_add(&edge2[k], &corner, -1, n);
        integer_add(&from[k], &origin, -1, n);
    }
    integer_set_zero(&numbers->distance, n);
    integer_set_zero(&numbers->det, n);
    integer_set_zero(&numbers->weight1, n);
    integer_set_zero(&numbers->weight2, n);
#pragma unroll 1
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

// W.
RARE void integer_weight0(const IntegerNumbers* numbers, int n, Integer* weight0) {
    *weight0 = numbers->det;
    integer_add(weight0, &numbers->weight1, -1, n);
    integer_add(weight0, &numbers->weight2, -1, n);
}

RARE float quotient_by_integers(const Integer* numerator, const Integer* denominator, int exponent, int n) {
    Integer above = *numerator, below = *denominator;
    return integer_quotient(&above, &below, exponent, n);
}

// The sign of the caller's t minus `limit`, where t is that of T / D times 2 to `exponent`; t whose nearest float is
// infinite is not less than an infinite limit.
RARE int compare_with_limit(const IntegerNumbers* numbers, const IntegerUnits* units, int exponent, float limit) {
    const int n = units->n;
    Integer distance = numbers->distance, det = numbers->det;
    const int sign = integer_take_sign(&distance, n) * integer_take_sign(&det, n);
    const int limit_sign = limit > 0.0f ? 1 : limit < 0.0f ? -1 : 0;
    if (sign != limit_sign || sign == 0) return sign > limit_sign ? 1 : sign < limit_sign ? -1 : 0;
    int limit_exponent = INFINITE_EXPONENT;
    const uint significand = is_finite(limit) ? float_significand(limit, &limit_exponent) : INFINITE_SIGNIFICAND;
    Integer factor, scaled;
    integer_set_limb(&factor, significand, n);
    integer_set_zero(&scaled, n);
    integer_add_product(&scaled, &factor, &det, 1, n);
    // Both have as many bits where they are shifted: none gets lost.
    const int shift = units->position - units->direction + exponent - limit_exponent;
    const int bits = integer_bits(&distance, n) + shift, limit_bits = integer_bits(&scaled, n);
    if (bits != limit_bits) return bits < limit_bits ? -sign : sign;
    if (shift > 0) integer_shift_up(&distance, shift, n);
    if (shift < 0) integer_shift_up(&scaled, -shift, n);
    integer_add(&distance, &scaled, -1, n);
    return sign * integer_sign(&distance, n);
}

// Whether the ray meets the triangle, and inside of its interval.
RARE bool is_hit_by_integers(const Ray* ray, const IntegerNumbers* numbers, const IntegerUnits* units) {
    const int n = units->n;
    Integer weight0;
    integer_weight0(numbers, n, &weight0);
    const int sign = integer_sign(&numbers->det, n);
    // A ray in the triangle's plane has D = 0 and never hits.
    if (sign == 0 || sign * integer_sign(&weight0, n) < 0 || sign * integer_sign(&numbers->weight1, n) < 0 ||
        sign * integer_sign(&numbers->weight2, n) < 0)
        return false;
    const int after = compare_with_limit(numbers, units, t_exponent(ray), ray->t_min);
    const int before = -compare_with_limit(numbers, units, t_exponent(ray), ray->t_max);
    // What a ray that leaves a triangle starts on, too, it leaves with it.
    const int least_after = starts_on_triangle(ray) || !is_finite(ray->t_min) ? 1 : 0;
    return after >= least_after && before >= (is_finite(ray->t_max) ? 0 : 1);
}

// Whether the triangle with corners 0 to 2 is met before the one with corners 3 to 5; of two at the same t that with
// the lower number.
RARE bool is_nearer_by_integers(const TrianglePoint* start, float3 direction, const float3* corners, bool is_lower) {
    const IntegerUnits units = integer_units(start, direction, corners, 2);
    IntegerNumbers numbers, best;
    integer_numbers(start, direction, corners, &units, &numbers);
    integer_numbers(start, direction, corners + 3, &units, &best);
    const int sign = integer_sign(&numbers.det, units.n) * integer_sign(&best.det, units.n);
    Integer difference; // T D' - T' D, times the signs of D and D'
    integer_set_zero(&difference, units.n);
    integer_add_product(&difference, &numbers.distance, &best.det, sign, units.n);
    integer_add_product(&difference, &best.distance, &numbers.det, -sign, units.n);
    const int order = integer_sign(&difference, units.n);
    return order < 0 || (order == 0 && is_lower);
}

// Whether the triangle is hit inside of the ray's interval, and nearer than *hit, as place_hit tells it; and limits of
// its t.
RARE bool decide_by_integers(GEOMETRY_PARAMETERS, const Ray* ray, float3 p0, float3 p1, float3 p2, uint primitive,
                             const Hit* hit, float* t_low, float* t_high) {
    if (!(ray->t_near <= ray->t_far)) return false; // NaN or infinite: not a ray
    const TrianglePoint start = start_of_ray(GEOMETRY, ray);
    float3 corners[6] = {p0, p1, p2, p0, p1, p2};
    const IntegerUnits units = integer_units(&start, ray->direction, corners, 1);
    IntegerNumbers numbers;
    integer_numbers(&start, ray->direction, corners, &units, &numbers);
    if (!is_hit_by_integers(ray, &numbers, &units)) return false;
    const float t = quotient_by_integers(&numbers.distance, &numbers.det, units.position - units.direction, units.n);
    *t_low = next_down(t);
    *t_high = next_up(t);
    if (hit->primitive == NO_PRIMITIVE || t < hit->u) return true;
    if (t > hit->t) return false;
#pragma unroll 1
    for (uint i = 0; i < 3u; i++) corners[i + 3u] = LOAD_SURFACE_VERTEX(geometry, hit->primitive, i);
    return is_nearer_by_integers(&start, ray->direction, corners, primitive < hit->primitive);
}

// t in the caller's units and the weights of a triangle that is hit.
RARE bool finish_by_integers(GEOMETRY_PARAMETERS, const Ray* ray, float3 p0, float3 p1, float3 p2, float* t,
                             SurfaceHit* hit) {
    const TrianglePoint start = start_of_ray(GEOMETRY, ray);
    const float3 corners[3] = {p0, p1, p2};
    const IntegerUnits units = integer_units(&start, ray->direction, corners, 1);
    IntegerNumbers numbers;
    integer_numbers(&start, ray->direction, corners, &units, &numbers);
    Integer weight0;
    integer_weight0(&numbers, units.n, &weight0);
    *t = quotient_by_integers(&numbers.distance, &numbers.det, units.position - units.direction + t_exponent(ray),
                              units.n);
    hit->weight0 = quotient_by_integers(&weight0, &numbers.det, 0, units.n);
    hit->u = quotient_by_integers(&numbers.weight1, &numbers.det, 0, units.n);
    hit->v = quotient_by_integers(&numbers.weight2, &numbers.det, 0, units.n);
    return true;
}
