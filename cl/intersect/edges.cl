// Edge functions of a triangle in sheared space, where the ray is the z axis (watertight.cl), and a bound of their error. For any number
// of lanes: one triangle in the filter of exact_filter.cl, eight in that of wide leaves (filter.cl).
//
// With H the largest sheared coordinate and M = H + the largest depth, to first order, no coordinate of a vertex relative to the origin is
// larger than M, because the shear is not larger than 1:
// a difference is off by 4 EPSILON M (two roundings and 2 of the origin's second part), the shear's quotient by up to 5 EPSILON (2.5
// ulp on some devices) and its product by 1, which its factor M passes on, the difference in it by 4 more, and the fma rounds by 2 M: a
// sheared coordinate is off by delta = (4 + 6 + 4 + 2) EPSILON M = 16 EPSILON M. An edge function of two vertices is off by
// 4 H delta + 2 delta^2 and, by itself, by EPSILON H^2 for its product and 2 EPSILON H^2 for its fma, which is no more than
// 3 EPSILON H 2 M: (64 + 6) EPSILON M H + 512 EPSILON^2 M^2. The constants leave room for the second order, for the roundings of H and M,
// and of the bound itself. LEAST_EDGE is for what underflows, and so large that quotients by sums of edge functions above it do not.
#ifndef SHEAR_ERROR
#define SHEAR_ERROR (74.0f * EPSILON)
#define SHEAR_ERROR2 (544.0f * EPSILON * EPSILON)
#define LEAST_EDGE 0x1p-60f
#endif

typedef struct {
    REAL weight0, weight1, weight2;
    REAL low, high; // the least and the greatest of them
    REAL bound;     // of their errors
} LANES(Edges);

// Of the sheared coordinates and depths of the vertices.
LANES(Edges) LANES(edges_of)(REAL ax, REAL ay, REAL az, REAL bx, REAL by, REAL bz, REAL cx, REAL cy, REAL cz) {
    LANES(Edges) e;
    e.weight0 = fma(cx, by, -(cy * bx));
    e.weight1 = fma(ax, cy, -(ay * cx));
    e.weight2 = fma(bx, ay, -(by * ax));
    const REAL extent = LANES(larger)(LANES(larger)(LANES(larger)(fabs(ax), fabs(ay)), LANES(larger)(fabs(bx), fabs(by))),
                                      LANES(larger)(fabs(cx), fabs(cy)));
    const REAL farthest = extent + LANES(larger)(fabs(az), LANES(larger)(fabs(bz), fabs(cz)));
    e.bound = fma(farthest, fma((REAL)(SHEAR_ERROR), extent, (REAL)(SHEAR_ERROR2) * farthest), (REAL)(LEAST_EDGE));
    e.low = LANES(smaller)(e.weight0, LANES(smaller)(e.weight1, e.weight2));
    e.high = LANES(larger)(e.weight0, LANES(larger)(e.weight1, e.weight2));
    return e;
}

// Where the ray passes the triangle for certain. False for NaN.
#define surely_missed(e) ((e).low < -(e).bound && (e).high > (e).bound)
