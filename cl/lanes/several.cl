// What both widths of vectors have (eight.cl, sixteen.cl); compiled after each.

// As larger() and smaller() of math.cl on a CPU.
REAL LANES(larger)(REAL a, REAL b) { return a > b ? a : b; }
REAL LANES(smaller)(REAL a, REAL b) { return a < b ? a : b; }

float LANES(lane_of)(const REAL* v, uint lane) { return ((const float*)v)[lane]; }
