// What both widths of vectors have (eight.cl, sixteen.cl); compiled after each.

// As larger() and smaller() of math.cl on a CPU.
REAL LANES(larger)(REAL a, REAL b) { return a > b ? a : b; }
REAL LANES(smaller)(REAL a, REAL b) { return a < b ? a : b; }

float LANES(lane_of)(const REAL* v, uint lane) { return ((const float*)v)[lane]; }

// difference_of_products() of math.cl, where its error is derived.
REAL LANES(difference_of_products)(REAL a, REAL b, REAL c, REAL d) {
    const REAL cd = c * d;
    return fma(a, b, -cd) + fma(-c, d, cd);
}
