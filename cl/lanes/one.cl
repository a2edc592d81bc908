// What a file that is written for any number of lanes (cl/intersect/edges.cl) is compiled for next: one number at a
// time.
#undef REAL
#undef FACTOR
#undef LANES
#define REAL float
#define LANES(name) name
