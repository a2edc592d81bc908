// What a file that is written for any number of lanes (cl/intersect/edges.cl) is compiled for next: one number at a time.
#define REAL float
#define LANES(name) name
