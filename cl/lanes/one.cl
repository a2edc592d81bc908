// What a file that is written for any number of lanes (cl/intersect/) is compiled for next: one number at a time.
#undef REAL
#undef MASK
#undef FACTOR
#undef LANES
#define ONE_LANE
#define REAL float
#define MASK bool
#define LANES(name) name

bool is_any(bool comparison) { return comparison; }
