// What a file that is written for any number of lanes (cl/intersect/edges.cl) is compiled for next: one number at a time.
#undef REAL
#undef FACTOR
#undef LANES
#define REAL float
#define LANES(name) name

// The larger and the smaller of two numbers; where one of them is NaN, which one is open. One instruction on GPUs, where what max_or() and
// min_or() promise takes two: an H200 traces with exact hits 2 % faster.
float larger(float a, float b) { return fmax(a, b); }
float smaller(float a, float b) { return fmin(a, b); }
