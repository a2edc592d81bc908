// What twice the precision tells of a ray and a triangle in each of eight lanes where decide.cl is not sure: most of
// what it leaves open, rays that pass edges and vertices. At once, so that a ray knows how far it still has to look.

#ifdef EXTENDED_IS_DOUBLE
typedef struct {
    double8 x, y, z;
} Doubles3;

Doubles3 difference_of_doubles(float8 ax, float8 ay, float8 az, float8 bx, float8 by, float8 bz) {
    const Doubles3 r = {convert_double8(ax) - convert_double8(bx), convert_double8(ay) - convert_double8(by),
                        convert_double8(az) - convert_double8(bz)};
    return r;
}

Doubles3 cross_doubles(const Doubles3* a, const Doubles3* b) {
    const Doubles3 r = {a->y * b->z - a->z * b->y, a->z * b->x - a->x * b->z, a->x * b->y - a->y * b->x};
    return r;
}
double8 dot_doubles(const Doubles3* a, const Doubles3* b) { return a->x * b->x + a->y * b->y + a->z * b->z; }

// A triangle's edges from its first corner, where that is as seen from a ray's origin, and the ray's direction. Nine
// coordinates, corner by corner.
typedef struct {
    Doubles3 edge1, edge2, from, along;
} TriangleInDoubles;

void triangle_in_doubles(const float8* o, const float8* d, const float8* c, TriangleInDoubles* t) {
    t->edge1 = difference_of_doubles(c[3], c[4], c[5], c[0], c[1], c[2]);
    t->edge2 = difference_of_doubles(c[6], c[7], c[8], c[0], c[1], c[2]);
    t->from = difference_of_doubles(c[0], c[1], c[2], o[0], o[1], o[2]);
    t->along.x = convert_double8(d[0]);
    t->along.y = convert_double8(d[1]);
    t->along.z = convert_double8(d[2]);
}

double8 smaller_of_doubles(double8 a, double8 b) { return a < b ? a : b; }
double8 larger_of_doubles(double8 a, double8 b) { return a > b ? a : b; }

// The numbers of decide.cl, and by how much each of a kind may be off.
typedef struct {
    double8 distance, det, weight0, weight1, weight2; // T, D, W, U, V
} Numbers8;
typedef struct {
    double8 distance, det, weights;
} NumberBounds8;

// The HalfUnits of exact_closer.cl, of rays that start on no triangle.
typedef struct {
    double8 of_weights, of_t;
} HalfUnits8;

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
// A call: Oclgrind 21.10 does not know what clang tells of such a result where it is inlined.
APART HalfUnits8 half_units8(const float8* origin, const float8* direction, const float8* corners) {
    const double8 x = unit_of_axis8(corners, origin, 0u), y = unit_of_axis8(corners, origin, 1u);
    const double8 z = unit_of_axis8(corners, origin, 2u);
    const double8 without_x = convert_double8(unit8(direction[0])) * y * z;
    const double8 without_y = convert_double8(unit8(direction[1])) * x * z;
    const double8 without_z = convert_double8(unit8(direction[2])) * x * y;
    const HalfUnits8 result = {0.5 * smaller_of_doubles(without_x, smaller_of_doubles(without_y, without_z)),
                               0.5 * x * y * z};
    return result;
}

// As is_surely_zero().
int8 is_surely_zero8(double8 number, double8 bound, double8 half_unit) {
    return convert_int8(fabs(number) + bound < half_unit);
}
// The bits of the weights that are surely zero.
int8 zeros_of_weights8(const Numbers8* n, double8 bound0, double8 bound1, double8 bound2, double8 half_unit) {
    return (is_surely_zero8(n->weight0, bound0, half_unit) ? (int8)(1) : (int8)(0)) |
           (is_surely_zero8(n->weight1, bound1, half_unit) ? (int8)(2) : (int8)(0)) |
           (is_surely_zero8(n->weight2, bound2, half_unit) ? (int8)(4) : (int8)(0));
}

// What is met just where a ray starts is as if it were met here: no other t, and no limit, is between 0 and this, and
// no ray of a packet ends at 0.
#define AT_START FLT_MIN

// As decide8(), but that zero weights are hits, too, where half units tell of them; without these, 0, nothing is zero.
void decide_by_numbers8(const Numbers8* n, const NumberBounds8* off, const HalfUnits8* units, Decision8* result) {
    const double8 weight0 = n->weight0, weight1 = n->weight1, weight2 = n->weight2;
    double8 least = smaller_of_doubles(weight0, smaller_of_doubles(weight1, weight2));
    double8 greatest = larger_of_doubles(weight0, larger_of_doubles(weight1, weight2));
    int8 at_start = (int8)(0), in_plane = (int8)(0);
    result->zeros = (int8)(0);
    if (units != 0) {
        result->zeros = zeros_of_weights8(n, off->weights, off->weights, off->weights, units->of_weights);
        const long8 zero0 = convert_long8((result->zeros & 1) != 0), zero1 = convert_long8((result->zeros & 2) != 0);
        const long8 zero2 = convert_long8((result->zeros & 4) != 0);
        least = smaller_of_doubles(zero0 ? (double8)(INFINITY) : weight0,
                                   smaller_of_doubles(zero1 ? (double8)(INFINITY) : weight1,
                                                      zero2 ? (double8)(INFINITY) : weight2));
        greatest = larger_of_doubles(zero0 ? (double8)(-INFINITY) : weight0,
                                     larger_of_doubles(zero1 ? (double8)(-INFINITY) : weight1,
                                                       zero2 ? (double8)(-INFINITY) : weight2));
        at_start = is_surely_zero8(n->distance, off->distance, units->of_t);
        in_plane = is_surely_zero8(n->det, off->det, units->of_weights);
    }
    // As decide.cl has it; t and its limits are floats, which round by 3 EPSILON.
    const double8 inv_det = 1.0 / n->det, exact_t = n->distance * inv_det;
    const double8 error = 1.4 * fabs(inv_det) * (fabs(exact_t) * off->det + off->distance);
    const float8 t = convert_float8(exact_t), t_error = fma((float8)(4.0f * EPSILON), fabs(t), convert_float8(error));
    result->possible = convert_int8(least >= -off->weights || greatest <= off->weights) && !in_plane;
    result->has_t = convert_int8(fabs(n->det) > 4.0 * off->det) && (at_start || fabs(t) > LEAST_MAGNITUDE);
    result->sure = result->has_t && convert_int8(least > off->weights || greatest < -off->weights);
    result->t_low = at_start ? (float8)(AT_START) : t - t_error;
    result->t_high = at_start ? (float8)(AT_START) : t + t_error;
}

// The bounds here are those of decide.cl times these: its numbers are off by EXTENDED_ERROR in this precision
// (exact_filter.cl), but not where a ray's origin has a second part. A hundredth is for the bounds' own roundings.
// Nothing underflows here, and DECIDE_LEAST is more than what does in the bounds.
#define CLOSELY_WEIGHT (1.01 * EXTENDED_ERROR_W / DECIDE_ERROR_WEIGHT)
#define CLOSELY_DET (1.01 * EXTENDED_ERROR / DECIDE_ERROR_DET)
#define CLOSELY_T (1.01 * EXTENDED_ERROR / DECIDE_ERROR_T)

// As decide8(), of rays whose origins have no second part, and triangles of nine coordinates, corner by corner.
// `units`: the HalfUnits8 of rays that start on no triangle, or 0.
Decision8 decide_closely8(const float8* origin, const float8* direction, const float8* corners, float8 weight_bound,
                          float8 det_bound, float8 t_bound, const HalfUnits8* units) {
    TriangleInDoubles t;
    triangle_in_doubles(origin, direction, corners, &t);
    const Doubles3 normal = cross_doubles(&t.edge1, &t.edge2), moment = cross_doubles(&t.from, &t.along);
    Numbers8 n;
    n.distance = dot_doubles(&normal, &t.from);
    n.det = dot_doubles(&normal, &t.along);
    n.weight1 = dot_doubles(&t.edge2, &moment);
    n.weight2 = -dot_doubles(&t.edge1, &moment);
    n.weight0 = (n.det - n.weight1) - n.weight2;
    const NumberBounds8 off = {CLOSELY_T * convert_double8(t_bound), CLOSELY_DET * convert_double8(det_bound),
                               CLOSELY_WEIGHT * convert_double8(weight_bound)};
    Decision8 result;
    decide_by_numbers8(&n, &off, units, &result);
    return result;
}
#endif
