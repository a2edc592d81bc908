// Edge functions of a triangle in sheared space, where the ray is the z axis (watertight.cl), and a bound of their
// error. For any number of lanes: one triangle in the filter of exact_filter.cl, eight in that of wide leaves
// (filter.cl).
//
// With H the largest sheared coordinate and M = H + the largest depth, to first order, no coordinate of a vertex
// relative to the origin is larger than M, because the shear is not larger than 1. In units of EPSILON: a difference
// from the origin is off by D M, where D is 1 (one rounding) for a ray that starts at its origin, 4 (two, and 2 of the
// second part) for others; the shear by 1 of itself (shear_towards in ray.cl), which its factor M passes on; the
// difference in it by D M more, and the fma rounds its result by H. So a sheared coordinate is off by delta = (2 D + 1)
// M + H. An edge function of two vertices is off by 4 H delta + 2 delta^2 and, by itself, by H^2 for its product and 2
// H^2 for its fma: H ((8 D + 4) M + 7 H) EPSILON + 2 delta^2, of which the last is no more than 200 EPSILON^2 M^2. The
// constants leave room for the roundings of H and M, and of the bound itself. LEAST_EDGE is for what underflows, and so
// large that quotients by sums of edge functions above it do not. It is for the start of a ray, too, that leaves a
// triangle at a point whose second part came out 0: that is off by 2^-66 of the triangle's coordinates at most
// (rounding_errors.cl). A difference that is off by e, below 2^-43, moves an edge function by 4 H e, which is no more
// than LEAST_EDGE and the EPSILON H^2 that EDGE_ERROR_EXTENT has to spare.
//
// EDGE_ERROR and EDGE_ERROR_LOW (D = 4) are times H M, EDGE_ERROR_EXTENT times H^2, EDGE_ERROR2 times M^2.
#ifndef HAS_EDGE_ERROR
#define HAS_EDGE_ERROR

// EDGE_ERROR of a ray whose origin has that second part.
float edge_error(float3 origin_low) {
    return origin_low.x == 0.0f && origin_low.y == 0.0f && origin_low.z == 0.0f ? EDGE_ERROR : EDGE_ERROR_LOW;
}
#endif

typedef struct {
    REAL weight0, weight1, weight2;
    REAL low, high; // the least and the greatest of them
    REAL bound;     // of their errors
} LANES(Edges);

// Of the sheared coordinates and depths of the vertices. `error`: edge_error() of the ray.
LANES(Edges)
LANES(edges_of)(float error, REAL ax, REAL ay, REAL az, REAL bx, REAL by, REAL bz, REAL cx, REAL cy, REAL cz) {
    LANES(Edges) e;
    e.weight0 = fma(cx, by, -(cy * bx));
    e.weight1 = fma(ax, cy, -(ay * cx));
    e.weight2 = fma(bx, ay, -(by * ax));
    const REAL extent =
        LANES(larger)(LANES(larger)(LANES(larger)(fabs(ax), fabs(ay)), LANES(larger)(fabs(bx), fabs(by))),
                      LANES(larger)(fabs(cx), fabs(cy)));
    const REAL farthest = extent + LANES(larger)(fabs(az), LANES(larger)(fabs(bz), fabs(cz)));
    const REAL first_order = fma((REAL)(error), farthest, EDGE_ERROR_EXTENT * extent);
    e.bound = fma(extent, first_order, fma(EDGE_ERROR2 * farthest, farthest, (REAL)(LEAST_EDGE)));
    e.low = LANES(smaller)(e.weight0, LANES(smaller)(e.weight1, e.weight2));
    e.high = LANES(larger)(e.weight0, LANES(larger)(e.weight1, e.weight2));
    return e;
}

// Where the ray passes the triangle for certain. False for NaN.
#define surely_missed(e) ((e).low < -(e).bound && (e).high > (e).bound)
