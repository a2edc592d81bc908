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

double8 smaller_of_doubles(double8 a, double8 b) { return a < b ? a : b; }
double8 larger_of_doubles(double8 a, double8 b) { return a > b ? a : b; }

// The bounds here are those of decide.cl times these: its numbers are off by EXTENDED_ERROR in this precision
// (exact_filter.cl), but not where a ray's origin has a second part. A hundredth is for the bounds' own roundings.
// Nothing underflows here, and DECIDE_LEAST is more than what does in the bounds.
#define CLOSELY_WEIGHT (1.01 * EXTENDED_ERROR_W / DECIDE_ERROR_WEIGHT)
#define CLOSELY_DET (1.01 * EXTENDED_ERROR / DECIDE_ERROR_DET)
#define CLOSELY_T (1.01 * EXTENDED_ERROR / DECIDE_ERROR_T)

// As decide8(), of rays whose origins have no second part, and triangles of nine coordinates, corner by corner.
Decision8 decide_closely8(const float8* origin, const float8* direction, const float8* corners, float8 weight_bound,
                          float8 det_bound, float8 t_bound) {
    const float8* c = corners;
    const Doubles3 edge1 = difference_of_doubles(c[3], c[4], c[5], c[0], c[1], c[2]);
    const Doubles3 edge2 = difference_of_doubles(c[6], c[7], c[8], c[0], c[1], c[2]);
    const Doubles3 from = difference_of_doubles(c[0], c[1], c[2], origin[0], origin[1], origin[2]);
    const Doubles3 along = {convert_double8(direction[0]), convert_double8(direction[1]),
                            convert_double8(direction[2])};
    const Doubles3 normal = cross_doubles(&edge1, &edge2), moment = cross_doubles(&from, &along);
    const double8 det = dot_doubles(&normal, &along);
    const double8 weight1 = dot_doubles(&edge2, &moment), weight2 = -dot_doubles(&edge1, &moment);
    const double8 weight0 = (det - weight1) - weight2;
    const double8 least = smaller_of_doubles(weight0, smaller_of_doubles(weight1, weight2));
    const double8 greatest = larger_of_doubles(weight0, larger_of_doubles(weight1, weight2));
    const double8 weight_error = CLOSELY_WEIGHT * convert_double8(weight_bound);
    const double8 det_error = CLOSELY_DET * convert_double8(det_bound);

    // As decide.cl has it; t and its limits are floats, which round by 3 EPSILON.
    const double8 inv_det = 1.0 / det, exact_t = dot_doubles(&normal, &from) * inv_det;
    const double8 error =
        1.4 * fabs(inv_det) * (fabs(exact_t) * det_error + CLOSELY_T * convert_double8(t_bound));
    const float8 t = convert_float8(exact_t), t_error = fma((float8)(4.0f * EPSILON), fabs(t), convert_float8(error));
    const int8 has_t = convert_int8(fabs(det) > 4.0 * det_error) && fabs(t) > LEAST_MAGNITUDE;
    const Decision8 result = {convert_int8(least >= -weight_error || greatest <= weight_error), has_t,
                              has_t && convert_int8(least > weight_error || greatest < -weight_error), t - t_error,
                              t + t_error, (int8)(0)};
    return result;
}
#endif
