// What a file that is written for any number of lanes (cl/shared/rounding_errors.cl) is compiled for first: the three
// axes of one point, which have one FACTOR. Its names end in 3.
#define REAL float3
#define FACTOR float
#define LANES(name) name##3
