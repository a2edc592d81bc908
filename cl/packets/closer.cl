// Step 3 of exact_filter.cl in eight lanes, each of a ray and a triangle: the numbers of exact_closer.cl in pairs of
// doubles, for what closely.cl leaves open. Of rays that pass an edge or a vertex a weight is so small that only these
// tell which float it is, and of those that meet one exactly, that it is zero.
//
// Faster than exact_closer.cl by what nearly always holds: the edges, and where the first corner is as seen from the
// ray's origin, are doubles, differences of floats that lose nothing. Lanes where one does lose something tell nothing.
#ifdef EXTENDED_IS_DOUBLE
// Pairs of doubles: double_double.cl.
typedef struct {
    double8 high, low;
} DoubleDouble8;
typedef struct {
    DoubleDouble8 x, y, z;
} DoubleDoubles3;

// As dd_sum().
DoubleDouble8 dd8_sum(double8 a, double8 b) {
    const double8 sum = a + b, b_part = sum - a;
    const DoubleDouble8 r = {sum, (a - (sum - b_part)) + (b - b_part)};
    return r;
}
// Off by 4 u^2 of its operands, with u = 2^-53: two roundings, each of what is below 2 u.
DoubleDouble8 dd8_subtract(const DoubleDouble8* a, const DoubleDouble8* b) {
    const DoubleDouble8 high = dd8_sum(a->high, -b->high);
    return dd8_sum(high.high, high.low + (a->low - b->low));
}
// a b - c d, off by 3 u^2 of its products: their second parts are exact, and below u of them.
DoubleDouble8 dd8_difference_of_products(double8 a, double8 b, double8 c, double8 d) {
    const double8 p = a * b, q = c * d;
    DoubleDouble8 r = dd8_sum(p, -q);
    r.low += fma(a, b, -p) - fma(c, d, -q);
    return r;
}
DoubleDoubles3 dd8_cross(const Doubles3* a, const Doubles3* b) {
    const DoubleDoubles3 r = {dd8_difference_of_products(a->y, b->z, a->z, b->y),
                              dd8_difference_of_products(a->z, b->x, a->x, b->z),
                              dd8_difference_of_products(a->x, b->y, a->y, b->x)};
    return r;
}
// a . b, off by 26 u^2 of its products: by 3 as b is, 3 for what is behind each of them, and 20 for four sums of what
// is below 5 u.
DoubleDouble8 dd8_dot(const Doubles3* a, const DoubleDoubles3* b) {
    const double8 x = a->x * b->x.high, y = a->y * b->y.high, z = a->z * b->z.high;
    const DoubleDouble8 two = dd8_sum(x, y), three = dd8_sum(two.high, z);
    const double8 behind_x = fma(a->x, b->x.low, fma(a->x, b->x.high, -x));
    const double8 behind_y = fma(a->y, b->y.low, fma(a->y, b->y.high, -y));
    const double8 behind_z = fma(a->z, b->z.low, fma(a->z, b->z.high, -z));
    return dd8_sum(three.high, ((behind_x + behind_y) + behind_z) + (two.low + three.low));
}

// Where a - b is that double.
int8 is_difference8(float8 a, float8 b, double8 difference) {
    const double8 x = convert_double8(a), y = convert_double8(b);
    return convert_int8(x - difference == y && difference + y == x);
}
int8 are_differences8(const float8* a, const float8* b, const Doubles3* d) {
    return is_difference8(a[0], b[0], d->x) && is_difference8(a[1], b[1], d->y) && is_difference8(a[2], b[2], d->z);
}

// The largest power of two that a float is a multiple of: more than others if it is 0, 0 if that is too small to tell.
float8 unit8(float8 x) {
    const uint8 bits = as_uint8(x), exponent = bits & 0x7f800000u, digits = (bits & 0x7fffffu) | 0x800000u;
    const float8 last_digit = convert_float8(digits & (0u - digits)) * 0x1p-23f;
    const float8 unit = last_digit * as_float8(exponent);
    return x == 0.0f ? (float8)(0x1p100f) : unit < LEAST_MAGNITUDE ? (float8)(0.0f) : unit;
}
// That of the coordinates of a triangle and an origin on one axis.
double8 unit_of_axis8(const float8* corners, const float8* origin, uint axis) {
    return convert_double8(smaller8(smaller8(unit8(corners[axis]), unit8(corners[3u + axis])),
                                    smaller8(unit8(corners[6u + axis]), unit8(origin[axis]))));
}

// None of the numbers is off by more than 34 u^2 P, for which CLOSER_ERROR leaves room: 26 each, and weight0 by 8 more,
// for its two sums. `half_unit`, of the weights, and `half_unit_t` are the HalfUnits of exact_closer.cl. `is_right`:
// the lanes where all differences are doubles.
typedef struct {
    DoubleDouble8 distance, det, weight0, weight1, weight2; // T, D, W, U, V
    double8 half_unit, half_unit_t;
    int8 is_right;
} CloserNumbers8;

// Of rays that start on no triangle, by origins and directions, and triangles of nine coordinates, corner by corner.
RARE void closer_numbers8(const float8* origin, const float8* direction, const float8* corners, CloserNumbers8* n) {
    const float8 *c = corners, *o = origin;
    const Doubles3 edge1 = difference_of_doubles(c[3], c[4], c[5], c[0], c[1], c[2]);
    const Doubles3 edge2 = difference_of_doubles(c[6], c[7], c[8], c[0], c[1], c[2]);
    const Doubles3 from = difference_of_doubles(c[0], c[1], c[2], o[0], o[1], o[2]);
    const Doubles3 along = {convert_double8(direction[0]), convert_double8(direction[1]),
                            convert_double8(direction[2])};
    const DoubleDoubles3 normal = dd8_cross(&edge1, &edge2), moment = dd8_cross(&from, &along);
    const Doubles3 minus_edge1 = {-edge1.x, -edge1.y, -edge1.z};
    n->distance = dd8_dot(&from, &normal);
    n->det = dd8_dot(&along, &normal);
    n->weight1 = dd8_dot(&edge2, &moment);
    n->weight2 = dd8_dot(&minus_edge1, &moment);
    const DoubleDouble8 others = dd8_subtract(&n->det, &n->weight1);
    n->weight0 = dd8_subtract(&others, &n->weight2);
    n->is_right =
        are_differences8(c + 3, c, &edge1) && are_differences8(c + 6, c, &edge2) && are_differences8(c, o, &from);

    const double8 x = unit_of_axis8(c, o, 0u), y = unit_of_axis8(c, o, 1u), z = unit_of_axis8(c, o, 2u);
    const double8 without_x = convert_double8(unit8(direction[0])) * y * z;
    const double8 without_y = convert_double8(unit8(direction[1])) * x * z;
    const double8 without_z = convert_double8(unit8(direction[2])) * x * y;
    n->half_unit = 0.5 * smaller_of_doubles(without_x, smaller_of_doubles(without_y, without_z));
    n->half_unit_t = 0.5 * x * y * z;
}

// As is_surely_zero().
int8 is_surely_zero8(const DoubleDouble8* number, double8 bound, double8 half_unit) {
    return convert_int8(fabs(number->high) + bound < half_unit);
}
// The bits of the weights that are surely zero, of numbers that are right.
int8 zeros_of_weights8(const CloserNumbers8* n, double8 bound0, double8 bound1, double8 bound2) {
    const int8 zero0 = is_surely_zero8(&n->weight0, bound0, n->half_unit);
    const int8 zero1 = is_surely_zero8(&n->weight1, bound1, n->half_unit);
    const int8 zero2 = is_surely_zero8(&n->weight2, bound2, n->half_unit);
    return n->is_right ? (zero0 ? (int8)(1) : (int8)(0)) | (zero1 ? (int8)(2) : (int8)(0)) |
                             (zero2 ? (int8)(4) : (int8)(0))
                       : (int8)(0);
}

// The bounds of decide.cl times these, as in closely.cl.
#define CLOSER_WEIGHT (1.01 * CLOSER_ERROR / DECIDE_ERROR_WEIGHT)
#define CLOSER_DET (1.01 * CLOSER_ERROR / DECIDE_ERROR_DET)
#define CLOSER_T (1.01 * CLOSER_ERROR / DECIDE_ERROR_T)

// As decide8(), where zero weights are hits, too.
RARE Decision8 decide_closer8(const float8* origin, const float8* direction, const float8* corners,
                              float8 weight_bound, float8 det_bound, float8 t_bound) {
    CloserNumbers8 n;
    closer_numbers8(origin, direction, corners, &n);
    const double8 weight_error = CLOSER_WEIGHT * convert_double8(weight_bound);
    const double8 det_error = CLOSER_DET * convert_double8(det_bound);
    const int8 zeros = zeros_of_weights8(&n, weight_error, weight_error, weight_error);
    const int8 up0 = convert_int8(n.weight0.high > weight_error), down0 = convert_int8(n.weight0.high < -weight_error);
    const int8 up1 = convert_int8(n.weight1.high > weight_error), down1 = convert_int8(n.weight1.high < -weight_error);
    const int8 up2 = convert_int8(n.weight2.high > weight_error), down2 = convert_int8(n.weight2.high < -weight_error);
    const int8 zero0 = (zeros & 1) != 0, zero1 = (zeros & 2) != 0, zero2 = (zeros & 4) != 0;
    const int8 misses = ((up0 || up1 || up2) && (down0 || down1 || down2)) ||
                        is_surely_zero8(&n.det, det_error, n.half_unit); // in the triangle's plane
    const int8 hits = ((up0 || zero0) && (up1 || zero1) && (up2 || zero2)) ||
                      ((down0 || zero0) && (down1 || zero1) && (down2 || zero2));

    // As in closely.cl.
    const double8 inv_det = 1.0 / n.det.high, exact_t = n.distance.high * inv_det;
    const double8 error = 1.4 * fabs(inv_det) * (fabs(exact_t) * det_error + CLOSER_T * convert_double8(t_bound));
    const float8 t = convert_float8(exact_t), t_error = fma((float8)(4.0f * EPSILON), fabs(t), convert_float8(error));
    Decision8 result;
    result.possible = !n.is_right || !misses;
    result.has_t = n.is_right && convert_int8(fabs(n.det.high) > 4.0 * det_error) && fabs(t) > LEAST_MAGNITUDE;
    result.sure = result.has_t && hits;
    result.t_low = t - t_error;
    result.t_high = t + t_error;
    result.zeros = zeros;
    return result;
}
#endif
