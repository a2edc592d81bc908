// Numbers of about twice float32's precision, for decisions that float32 leaves open: double where the device has it,
// else pairs of floats. Whatever is decided with them is certified by an error bound, so that both kinds lead to the
// same answers.
//
// Pairs: Dekker, "A Floating-Point Technique for Extending the Available Precision", Numerische Mathematik 18, 1971;
// bounds of relative errors by Joldes, Muller and Popescu, "Tight and Rigorous Error Bounds for Basic Building Blocks
// of Double-Word Arithmetic", ACM TOMS 44(2), 2017: below 2^-45 for a sum of equal signs and a product. A difference's
// error is as small relative to the magnitudes of its operands, and that is how the bounds here use it.

#if defined(cl_khr_fp64) && !defined(FLOAT_ONLY)
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#define EXTENDED_IS_DOUBLE
typedef double Extended;
#define EXTENDED_EPSILON DOUBLE_EPSILON // the relative error of one operation
// Of cl/intersect/exact_filter.cl.
#define EXTENDED_ERROR DOUBLE_ERROR
#define EXTENDED_ERROR_W DOUBLE_ERROR_W
#define START_ERROR DOUBLE_START_ERROR
#define LEAST_FROM DOUBLE_LEAST_FROM
Extended extended_difference(float a, float b) { return (double)a - (double)b; }
Extended extended_from(float a) { return (double)a; }
Extended extended_add(Extended a, Extended b) { return a + b; }
Extended extended_subtract(Extended a, Extended b) { return a - b; }
Extended extended_multiply(Extended a, Extended b) { return a * b; }
Extended extended_divide(Extended a, Extended b) { return a / b; }
float extended_to_float(Extended a) { return (float)a; }
#else
typedef float2 Extended; // the value is x + y, and x is that rounded
#define EXTENDED_EPSILON PAIR_EPSILON
#define EXTENDED_ERROR PAIR_ERROR
#define EXTENDED_ERROR_W PAIR_ERROR_W
#define START_ERROR PAIR_START_ERROR
#define LEAST_FROM PAIR_LEAST_FROM
Extended extended_sum(float a, float b) {
    const float sum = a + b;
    const float b_part = sum - a;
    return (Extended)(sum, (a - (sum - b_part)) + (b - b_part));
}
Extended extended_normal(float high, float low) {
    const float sum = high + low;
    return (Extended)(sum, low - (sum - high));
}
Extended extended_difference(float a, float b) { return extended_sum(a, -b); }
Extended extended_from(float a) { return (Extended)(a, 0.0f); }
Extended extended_add(Extended a, Extended b) {
    const Extended high = extended_sum(a.x, b.x);
    const Extended low = extended_sum(a.y, b.y);
    const Extended sum = extended_normal(high.x, high.y + low.x);
    return extended_normal(sum.x, low.y + sum.y);
}
Extended extended_subtract(Extended a, Extended b) { return extended_add(a, -b); }
Extended extended_multiply(Extended a, Extended b) {
    const float high = a.x * b.x;
    const float low = fma(a.x, b.x, -high);
    return extended_normal(high, low + fma(a.x, b.y, a.y * b.x));
}
Extended extended_divide(Extended a, Extended b) {
    const float high = a.x / b.x;
    const Extended rest = extended_subtract(a, extended_multiply(b, extended_from(high)));
    return extended_normal(high, rest.x / b.x);
}
float extended_to_float(Extended a) { return a.x; }
#endif

// Whether every number within `error` of a rounds to the same float, which is *rounded.
bool extended_rounds_surely(Extended a, float error, float* rounded) {
    *rounded = extended_to_float(extended_add(a, extended_from(error)));
    return extended_to_float(extended_subtract(a, extended_from(error))) == *rounded;
}

typedef struct {
    Extended x, y, z;
} Extended3;

Extended3 extended3_difference(float3 a, float3 b) {
    const Extended3 r = {extended_difference(a.x, b.x), extended_difference(a.y, b.y), extended_difference(a.z, b.z)};
    return r;
}

Extended3 extended3_from(float3 a) {
    const Extended3 r = {extended_from(a.x), extended_from(a.y), extended_from(a.z)};
    return r;
}

Extended3 extended3_subtract(const Extended3* a, const Extended3* b) {
    const Extended3 r = {extended_subtract(a->x, b->x), extended_subtract(a->y, b->y), extended_subtract(a->z, b->z)};
    return r;
}

// a x b.
Extended3 extended3_cross(const Extended3* a, const Extended3* b) {
    const Extended3 r = {extended_subtract(extended_multiply(a->y, b->z), extended_multiply(a->z, b->y)),
                         extended_subtract(extended_multiply(a->z, b->x), extended_multiply(a->x, b->z)),
                         extended_subtract(extended_multiply(a->x, b->y), extended_multiply(a->y, b->x))};
    return r;
}

Extended extended3_dot(const Extended3* a, const Extended3* b) {
    return extended_add(extended_add(extended_multiply(a->x, b->x), extended_multiply(a->y, b->y)),
                        extended_multiply(a->z, b->z));
}
