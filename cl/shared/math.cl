// Vector arithmetic and elementary functions of fixed rounding.
//
// OpenCL leaves the rounding of dot(), cross(), normalize(), length(), mad(), pow(), exp() and log() to the
// implementation. Everything here is built from +, -, *, fma (correctly rounded everywhere), / and sqrt (correctly
// rounded on the devices where the host asks for it), floor and bit operations, in one written order, so that every
// device and the scalar twin in src/reference/shared/math.rs return the same bits. Errors of the elementary functions
// are the largest of all float32 arguments, as tests/methods/math.rs measures them, in units in the last place of the
// result (ulp). EPSILON stands for 2^-24.

// a*b - c*d with an error of at most 1.5 ulp, and therefore with the right sign and an exact zero (short of underflow):
// Kahan's method; error bound by Jeannerod, Louvet and Muller, "Further Analysis of Kahan's Algorithm for the Accurate
// Computation of 2x2 Determinants", Mathematics of Computation 82, 2013.
float difference_of_products(float a, float b, float c, float d) {
    const float cd = c * d;
    const float rounding = fma(-c, d, cd);
    return fma(a, b, -cd) + rounding;
}

float dot3(float3 a, float3 b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }

float3 cross3(float3 a, float3 b) {
    return (float3)(difference_of_products(a.y, b.z, a.z, b.y), difference_of_products(a.z, b.x, a.x, b.z),
                    difference_of_products(a.x, b.y, a.y, b.x));
}

// a*s + b
float3 fma3(float3 a, float s, float3 b) { return (float3)(fma(a.x, s, b.x), fma(a.y, s, b.y), fma(a.z, s, b.z)); }

// max() and min() of OpenCL are undefined for NaN; these return b when a is NaN.
float max_or(float a, float b) { return a > b ? a : b; }
float min_or(float a, float b) { return a < b ? a : b; }

// The larger and the smaller of two numbers; where one of them is NaN, which one is open. One instruction each: on a
// GPU fmax(), where what max_or() promises takes two (an H200 traces with exact hits 2 % faster), on a CPU max_or(),
// where fmax() takes three (5 % with PoCL).
#ifdef GPU
float larger(float a, float b) { return fmax(a, b); }
float smaller(float a, float b) { return fmin(a, b); }
#else
float larger(float a, float b) { return max_or(a, b); }
float smaller(float a, float b) { return min_or(a, b); }
#endif
float largest_component(float3 v) { return larger(v.x, larger(v.y, v.z)); }

float max_component(float3 v) { return max_or(v.x, max_or(v.y, v.z)); }
float3 abs3(float3 v) { return (float3)(fabs(v.x), fabs(v.y), fabs(v.z)); }
float clamp01(float x) { return x > 0.0f ? (x < 1.0f ? x : 1.0f) : 0.0f; } // NaN becomes 0

// True for numbers, false for NaN and infinities. By bits: isfinite() may be folded away under fast-math options.
bool is_finite(float x) { return (as_uint(x) & 0x7f800000u) != 0x7f800000u; }
bool is_finite3(float3 v) { return is_finite(v.x) && is_finite(v.y) && is_finite(v.z); }

// What x > 0 would have in its exponent's bits if they had no lower end: less than 1 for subnormal numbers.
int exponent_field(float x) {
    const uint bits = as_uint(x);
    return bits >= 0x00800000u ? (int)(bits >> 23) : 9 - (int)clz(bits);
}

// The next float above and below a finite x.
float next_up(float x) {
    return x == 0.0f ? as_float(1u) : as_float(x > 0.0f ? as_uint(x) + 1u : as_uint(x) - 1u);
}
float next_down(float x) { return -next_up(-x); }

// x, and +0 for -0. By bits: compilers that ignore the sign of zero drop `x + 0`.
float positive_zero(float x) { return as_uint(x) == 0x80000000u ? 0.0f : x; }

// The power of two that brings `magnitude` (normal, positive, below 2^126) into [1, 2); multiplying by it is exact.
float power_of_two_scale(float magnitude) { return as_float((254u - (as_uint(magnitude) >> 23)) << 23); }

// v brought to a largest component in [1, 2) by an exact factor, which is multiplied into *scale. False when v is zero,
// infinite or NaN.
bool scale_to_unit(float3* v, float* scale) {
    float magnitude = max_component(abs3(*v));
    if (!(magnitude > 0.0f) || !is_finite3(*v)) return false;
    if (magnitude < SMALLEST_SCALED) {
        *v *= LIFT;
        *scale *= LIFT;
        magnitude *= LIFT;
    }
    if (magnitude > LARGEST_SCALED) {
        *v *= 1.0f / LIFT;
        *scale *= 1.0f / LIFT;
        magnitude *= 1.0f / LIFT;
    }
    const float s = power_of_two_scale(magnitude);
    *v *= s;
    *scale *= s;
    return true;
}

// v / |v|, or `otherwise` when v has no direction. Right for every length that a float3 can have.
float3 normalize3(float3 v, float3 otherwise) {
    float scale = 1.0f;
    if (!scale_to_unit(&v, &scale)) return otherwise;
    return v * (1.0f / sqrt(dot3(v, v)));
}

// The sine of x turns, that is of 2 pi x; 0 for NaN, and from 2^22 on, where x is a multiple of half a turn. The
// reduction to a quarter turn is exact, so that zeros are, too; the Taylor series after r^13 leaves 7e-10. Error at
// most 3.3 ulp.
float sin_turns(float x) {
    const float turns = fabs(x);
    float r = turns < MOST_TURNS ? turns - floor(turns) : 0.0f; // 0 .. 1
    r = r > 0.75f ? r - 1.0f : r > 0.25f ? 0.5f - r : r;
    r = x < 0.0f ? -r : r;
    const float r2 = r * r;
    float p = SIN_13;
    p = fma(p, r2, SIN_11);
    p = fma(p, r2, SIN_9);
    p = fma(p, r2, SIN_7);
    p = fma(p, r2, SIN_5);
    p = fma(p, r2, SIN_3);
    p = fma(p, r2, SIN_1);
    return p * r;
}

// log2 of a normal x > 0: x = m 2^e with m in (sqrt(1/2), sqrt(2)]; log2 m = 2/ln2 atanh((m-1)/(m+1)), whose series
// after f^9 leaves 2e-10. Error at most 3.1 ulp.
float log2_fixed(float x) {
    const uint bits = as_uint(x);
    float m = as_float((bits & 0x007fffffu) | 0x3f800000u);
    int e = (int)(bits >> 23) - 127;
    if (m > LOG2_MOST) {
        m *= 0.5f;
        e += 1;
    }
    const float f = (m - 1.0f) / (m + 1.0f);
    const float f2 = f * f;
    float p = LOG2_9;
    p = fma(p, f2, LOG2_7);
    p = fma(p, f2, LOG2_5);
    p = fma(p, f2, LOG2_3);
    p = fma(p, f2, LOG2_1);
    return fma(p, f, (float)e);
}

// 2^x for x <= 0, 0 below -126 and for NaN. 2^x = 2^n 2^r with r in [-1/2, 1/2]; the Taylor series after r^7 leaves
// 6e-9. Error at most 0.9 ulp.
float exp2_fixed(float x) {
    if (!(x >= -126.0f)) return 0.0f;
    const float n = floor(x + 0.5f);
    const float r = x - n;
    float p = EXP2_7;
    p = fma(p, r, EXP2_6);
    p = fma(p, r, EXP2_5);
    p = fma(p, r, EXP2_4);
    p = fma(p, r, EXP2_3);
    p = fma(p, r, EXP2_2);
    p = fma(p, r, EXP2_1);
    p = fma(p, r, 1.0f);
    return p * as_float((uint)((int)n + 127) << 23);
}

// base^exponent for base in 0..1 and exponent >= 0; 1 for bases above, and for exponents that are no numbers. 0 where
// the result, or the base, would be subnormal. The exponent of 2 is rounded, so that the relative error grows with its
// size: at most 4 EPSILON (1 + |ln result|), which is 6e-7 down to results of 0.1 and 2.2e-5 at the smallest.
float power_fixed(float base, float exponent) {
    if (!(exponent > 0.0f) || base >= 1.0f) return 1.0f;
    if (!(base >= 1.17549435e-38f)) return 0.0f;
    return exp2_fixed(exponent * log2_fixed(base));
}
