// What float32 tells of a ray and a triangle in each lane: of eight triangles and one ray, or of one triangle and
// sixteen rays.
//
// The numbers of Moller and Trumbore with a = p0 - origin, e1 and e2 the edges from p0, N = e1 x e2, c = a x direction:
//     T = N . a,  D = N . direction,  t = T / D;
//     U = e2 . c,  V = -e1 . c,  W = D - U - V: D times the vertices' weights.
//
// Errors in units of EPSILON, with magnitudes for numbers (A of a, M of N, P of c, Q1, Q2, R and S of V, U, D and T),
// to first order: an edge is off by 1 of itself, a by 5 A (from_origin in ray.cl); N by 1 + 1 + 2 = 4 M, c by 5 + 2 = 7
// P; U and V by 1 + 7 + 3 = 11 (Q2, Q1), D by 4 + 3 = 7 R, T by 4 + 5 + 3 = 12 S; W by those of its summands and of two
// sums: 9 R + 13 (Q1 + Q2). The halves are for the second order and for the roundings of the bounds themselves.
#ifndef DECIDE_ERROR_WEIGHT
#define DECIDE_ERROR_WEIGHT (13.5f * EPSILON) // times Q1 + Q2 + R: of all three weights
#define DECIDE_ERROR_DET (7.5f * EPSILON)
#define DECIDE_ERROR_T (12.5f * EPSILON)
// For what underflows: a few times 2^-126, times numbers below 2^43 (edges of up to 4, and MODERATE).
#define DECIDE_LEAST 0x1p-80f
#endif

typedef struct {
    MASK possible;      // not missed for certain
    MASK has_t;         // if it is hit, then at a t within the limits
    MASK sure;          // hit for certain, and there
    REAL t_low, t_high; // the limits
    MASK zeros;         // bits of the weights that are surely zero, of which float32 tells none
} LANES(Decision);

// What is of the triangles alone; the bounds of the weights, of D and of T are for all rays that it is asked about.
typedef struct {
    REAL e1[3], e2[3], n[3];
    REAL weight_bound, det_bound, t_bound;
} LANES(DecideTriangle);

// Nothing but `possible` is written where that is nowhere.
LANES(Decision) LANES(decide)(const REAL* a, const REAL* direction, const LANES(DecideTriangle)* triangle) {
    const REAL ax = a[0], ay = a[1], az = a[2], dx = direction[0], dy = direction[1], dz = direction[2];
    const REAL e1x = triangle->e1[0], e1y = triangle->e1[1], e1z = triangle->e1[2];
    const REAL e2x = triangle->e2[0], e2y = triangle->e2[1], e2z = triangle->e2[2];
    const REAL nx = triangle->n[0], ny = triangle->n[1], nz = triangle->n[2];
    const REAL weight_bound = triangle->weight_bound, det_bound = triangle->det_bound;
    LANES(Decision) result;
    result.zeros = (MASK)(0);
    const REAL cx = fma(ay, dz, -(az * dy)), cy = fma(az, dx, -(ax * dz)), cz = fma(ax, dy, -(ay * dx));
    const REAL weight1 = fma(e2x, cx, fma(e2y, cy, e2z * cz));
    const REAL minus_weight2 = fma(e1x, cx, fma(e1y, cy, e1z * cz));
    const REAL weight2 = -minus_weight2;
    const REAL det = fma(nx, dx, fma(ny, dy, nz * dz));
    const REAL weight0 = (det - weight1) + minus_weight2;
    const REAL least = LANES(smaller)(weight0, LANES(smaller)(weight1, weight2));
    const REAL greatest = LANES(larger)(weight0, LANES(larger)(weight1, weight2));
    result.possible = least >= -weight_bound || greatest <= weight_bound;
    if (!LANES(is_any)(result.possible)) return result;

    // With D beyond four of its bounds, dividing by it instead of by what it may be makes no more than 4/3 of an error;
    // 1.4 and 8 leave room for roundings. The reciprocal and the product are off by 6 EPSILON.
    result.has_t = fabs(det) > 4.0f * det_bound;
    result.sure = result.has_t && (least > weight_bound || greatest < -weight_bound);
    const REAL inv_det = 1.0f / det;
    const REAL t = fma(nx, ax, fma(ny, ay, nz * az)) * inv_det;
    const REAL error = fma(1.4f * fabs(inv_det), fma(fabs(t), det_bound, triangle->t_bound), 8.0f * EPSILON * fabs(t));
    result.t_low = t - error;
    result.t_high = t + error;
    return result;
}
