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

// None of the numbers is off by more than 34 u^2 P, for which CLOSER_ERROR leaves room: 26 each, and weight0 by 8 more,
// for its two sums. `is_right`: the lanes where all differences are doubles.
typedef struct {
    DoubleDouble8 distance, det, weight0, weight1, weight2; // T, D, W, U, V
    int8 is_right;
} CloserNumbers8;

// Of rays that start on no triangle, by origins and directions, and triangles of nine coordinates, corner by corner.
APART void closer_numbers8(const float8* origin, const float8* direction, const float8* corners, CloserNumbers8* n) {
    TriangleInDoubles t;
    triangle_in_doubles(origin, direction, corners, &t);
    const DoubleDoubles3 normal = dd8_cross(&t.edge1, &t.edge2), moment = dd8_cross(&t.from, &t.along);
    const Doubles3 minus_edge1 = {-t.edge1.x, -t.edge1.y, -t.edge1.z};
    n->distance = dd8_dot(&t.from, &normal);
    n->det = dd8_dot(&t.along, &normal);
    n->weight1 = dd8_dot(&t.edge2, &moment);
    n->weight2 = dd8_dot(&minus_edge1, &moment);
    const DoubleDouble8 others = dd8_subtract(&n->det, &n->weight1);
    n->weight0 = dd8_subtract(&others, &n->weight2);
    n->is_right = are_differences8(corners + 3, corners, &t.edge1) &&
                  are_differences8(corners + 6, corners, &t.edge2) && are_differences8(corners, origin, &t.from);
}

// Their first parts.
APART Numbers8 numbers_of_pairs8(const CloserNumbers8* n) {
    const Numbers8 high = {n->distance.high, n->det.high, n->weight0.high, n->weight1.high, n->weight2.high};
    return high;
}

// The bounds of decide.cl times these, as in closely.cl.
#define CLOSER_WEIGHT (1.01 * CLOSER_ERROR / DECIDE_ERROR_WEIGHT)
#define CLOSER_DET (1.01 * CLOSER_ERROR / DECIDE_ERROR_DET)
#define CLOSER_T (1.01 * CLOSER_ERROR / DECIDE_ERROR_T)

// As decide_closely8(), of rays that start on no triangle.
APART Decision8 decide_closer8(const float8* origin, const float8* direction, const float8* corners,
                              float8 weight_bound, float8 det_bound, float8 t_bound) {
    const HalfUnits8 units = half_units8(origin, direction, corners);
    // Where coordinates have few bits, as those of grids, zeros are certain in doubles.
    if (is_any8(convert_int8(units.of_weights > CLOSELY_WEIGHT * convert_double8(weight_bound)))) {
        const Decision8 d = decide_closely8(origin, direction, corners, weight_bound, det_bound, t_bound, &units);
        if (!is_any8(d.possible && !d.sure)) return d;
    }
    CloserNumbers8 pairs;
    closer_numbers8(origin, direction, corners, &pairs);
    const Numbers8 n = numbers_of_pairs8(&pairs);
    const NumberBounds8 off = {CLOSER_T * convert_double8(t_bound), CLOSER_DET * convert_double8(det_bound),
                               CLOSER_WEIGHT * convert_double8(weight_bound)};
    Decision8 result;
    decide_by_numbers8(&n, &off, &units, &result);
    result.possible = result.possible || !pairs.is_right;
    result.has_t = result.has_t && pairs.is_right;
    result.sure = result.sure && pairs.is_right;
    result.zeros = pairs.is_right ? result.zeros : (int8)(0);
    return result;
}
#endif
