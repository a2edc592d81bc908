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
#define WIDE_IS_DOUBLE
typedef double Wide;
#define WIDE_EPSILON DOUBLE_EPSILON     // the relative error of one operation
#define WIDE_PRECISION DOUBLE_PRECISION // its inverse
Wide wide_difference(float a, float b) { return (double)a - (double)b; }
Wide wide_from(float a) { return (double)a; }
Wide wide_add(Wide a, Wide b) { return a + b; }
Wide wide_subtract(Wide a, Wide b) { return a - b; }
Wide wide_multiply(Wide a, Wide b) { return a * b; }
Wide wide_divide(Wide a, Wide b) { return a / b; }
float wide_to_float(Wide a) { return (float)a; }
#else
typedef float2 Wide; // the value is x + y, and x is that rounded
#define WIDE_EPSILON PAIR_EPSILON
#define WIDE_PRECISION PAIR_PRECISION
Wide wide_sum(float a, float b) {
    const float sum = a + b;
    const float b_part = sum - a;
    return (Wide)(sum, (a - (sum - b_part)) + (b - b_part));
}
Wide wide_normal(float high, float low) {
    const float sum = high + low;
    return (Wide)(sum, low - (sum - high));
}
Wide wide_difference(float a, float b) { return wide_sum(a, -b); }
Wide wide_from(float a) { return (Wide)(a, 0.0f); }
Wide wide_add(Wide a, Wide b) {
    const Wide high = wide_sum(a.x, b.x);
    const Wide low = wide_sum(a.y, b.y);
    const Wide sum = wide_normal(high.x, high.y + low.x);
    return wide_normal(sum.x, low.y + sum.y);
}
Wide wide_subtract(Wide a, Wide b) { return wide_add(a, -b); }
Wide wide_multiply(Wide a, Wide b) {
    const float high = a.x * b.x;
    const float low = fma(a.x, b.x, -high);
    return wide_normal(high, low + fma(a.x, b.y, a.y * b.x));
}
Wide wide_divide(Wide a, Wide b) {
    const float high = a.x / b.x;
    const Wide rest = wide_subtract(a, wide_multiply(b, wide_from(high)));
    return wide_normal(high, rest.x / b.x);
}
float wide_to_float(Wide a) { return a.x; }
#endif

// Whether every number within `error` of a rounds to the same float, which is *rounded.
bool wide_rounds_surely(Wide a, float error, float* rounded) {
    *rounded = wide_to_float(wide_add(a, wide_from(error)));
    return wide_to_float(wide_subtract(a, wide_from(error))) == *rounded;
}

typedef struct {
    Wide x, y, z;
} Wide3;

Wide3 wide3_difference(float3 a, float3 b) {
    const Wide3 r = {wide_difference(a.x, b.x), wide_difference(a.y, b.y), wide_difference(a.z, b.z)};
    return r;
}

Wide3 wide3_from(float3 a) {
    const Wide3 r = {wide_from(a.x), wide_from(a.y), wide_from(a.z)};
    return r;
}

Wide3 wide3_subtract(const Wide3* a, const Wide3* b) {
    const Wide3 r = {wide_subtract(a->x, b->x), wide_subtract(a->y, b->y), wide_subtract(a->z, b->z)};
    return r;
}

// a x b.
Wide3 wide3_cross(const Wide3* a, const Wide3* b) {
    const Wide3 r = {wide_subtract(wide_multiply(a->y, b->z), wide_multiply(a->z, b->y)),
                     wide_subtract(wide_multiply(a->z, b->x), wide_multiply(a->x, b->z)),
                     wide_subtract(wide_multiply(a->x, b->y), wide_multiply(a->y, b->x))};
    return r;
}

Wide wide3_dot(const Wide3* a, const Wide3* b) {
    return wide_add(wide_add(wide_multiply(a->x, b->x), wide_multiply(a->y, b->y)), wide_multiply(a->z, b->z));
}
